"""The page of `balloons live`, served as a user does, in Debian's Chromium."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")


def served_by(*arguments: str) -> Iterator[tuple[str, int]]:
    """The address of a page that is served until the test is done, and the number of its process."""
    yield from served_as("simulator", "live", *arguments, "--no-show")


def served_as(*module: str) -> Iterator[tuple[str, int]]:
    """The same of a module that is run with arguments."""
    command = [sys.executable, "-m", *module]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as server:
        try:
            assert server.stdout is not None
            found = re.search(r"http://\S+", server.stdout.readline())
            assert found, "the page is not served"
            yield found[0].rstrip(";"), server.pid
        finally:
            server.kill()  # at SIGTERM Bokeh prints, into a pipe that nobody reads any more


@pytest.fixture(scope="session")
def address() -> Iterator[str]:
    for found, _ in served_by("scenarios/fig5b_state_b.toml"):
        yield found


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    if BROWSER is None:
        pytest.skip("there is no Chromium on this machine: apt-get install chromium")
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with sync_api.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield chromium
        chromium.close()


class Visit:
    """A page in the browser, and what it complained of."""

    def __init__(self, browser: Any, address: str, query: str = "", **options: Any) -> None:
        self.page = browser.new_page(**{"viewport": {"width": 1360, "height": 860}, **options})
        self.complaints: list[str] = []
        self.page.set_default_timeout(20_000)
        self.page.on("console", self._hear)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self._see(request.url, address))
        self.page.goto(address + query)
        self.page.get_by_text(re.compile("(completed|ended) ")).first.wait_for(timeout=60_000)
        self.page.wait_for_function("Bokeh.documents[0]?.is_idle", timeout=20_000)

    def _hear(self, message: Any) -> None:
        if message.type in ("error", "warning"):
            self.complaints.append(message.text)

    def _see(self, url: str, address: str) -> None:
        own = (address, address.replace("http", "ws"), "data:", "blob:")
        if not url.startswith(own):
            self.complaints.append(f"asked for {url}")

    def column(self, source: str, name: str) -> list[float]:
        """One column of what is drawn."""
        found: list[float] = self.page.evaluate(
            # Those of another device may still be there.
            "([source, name]) => Array.from("
            "[...Bokeh.documents[0]._all_models.values()].filter((m) => m.name === source).pop().data[name])",
            [source, name],
        )
        return found

    def slider(self, name: str) -> Any:
        return self.page.get_by_label(f"{name} (slider)", exact=True).first

    def field(self, name: str) -> Any:
        return self.page.get_by_label(name, exact=True).first

    def until(self, condition: Any) -> None:
        """Wait until a condition on what is drawn holds."""
        for _ in range(200):
            if condition():
                return
            self.page.wait_for_timeout(50)
        raise AssertionError("it did not come about")


@pytest.fixture
def visit(browser, address) -> Iterator[Any]:
    visits: list[Visit] = []

    def visited(query: str = "", **options: Any) -> Visit:
        visits.append(Visit(browser, address, query, **options))
        return visits[-1]

    yield visited
    for one in visits:
        assert one.complaints == []
        one.page.close()


@pytest.fixture
def failing(browser) -> Iterator[Any]:
    """A visit of a page on which some runs fail."""
    for address, _ in served_as("tests.browser.failing"):
        one = Visit(browser, address)
        yield one
        assert one.complaints == []
