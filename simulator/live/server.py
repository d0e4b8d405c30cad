"""The page served to this machine: `balloons live`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

import panel as pn
from tornado.httputil import HTTPServerRequest
from tornado.routing import Matcher, Rule
from tornado.web import ErrorHandler

from simulator.live import links, worker
from simulator.live.controls import check_size
from simulator.live.figures import ACCENT, INK, PAPER, PROBLEM
from simulator.live.page import Page
from simulator.scenario import ScenarioError, load_scenario

if TYPE_CHECKING:
    from simulator.scenario import Scenario

_TEMPLATE = """{% extends base %}
{% block postamble %}
<style>
:root { color-scheme: {{ scheme }}; --ink: {{ ink }}; --problem: {{ problem }}; --accent: {{ accent }}; }
body { margin: 0; background: {{ paper }}; }
</style>
{% endblock %}
{% block contents %}<main>{% for root in roots %}{{ embed(root) }}{% endfor %}</main>{% endblock %}"""
LOOPBACK = ("127.0.0.1", "localhost")


class Foreign(Matcher):  # type: ignore[misc]
    """Matches requests that ask for another host than the page's, or come from another page."""

    def __init__(self, hosts: frozenset[str]) -> None:
        self._hosts = hosts

    def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
        """A match for what is to be refused."""
        origin = request.headers.get("Origin")
        is_own = origin is None or origin.partition("://")[2] in self._hosts
        return None if request.headers.get("Host") in self._hosts and is_own else {}


def presets() -> dict[str, str]:
    """The scenarios that come with the package, by name."""
    here = Path(__file__).parent.parent
    folder = next((f for f in (here / "scenarios", here.parent / "scenarios") if f.is_dir()), None)
    return {path.stem: str(path) for path in sorted(folder.glob("*.toml"))} if folder else {}


def serve(scenario: Scenario | None, *, host: str, port: int, show: bool) -> None:
    """Serve the page until Ctrl-C.

    Parameters
    ----------
    scenario : Scenario or None
        What is opened first; None for the first preset.
    host : str
        Address to listen on.
    port : int
        0 for any that is free.
    show : bool
        Whether to open the page in the browser.
    """
    server, address = make_server(scenario, host=host, port=port)
    print(f"The page is at {address}; Ctrl-C ends it.", flush=True)
    if show:
        server.io_loop.add_callback(partial(server.show, "/"))
    server.run_until_shutdown()


def make_server(scenario: Scenario | None, *, host: str, port: int) -> tuple[Any, str]:
    """The server of the page, not yet running, and its address."""
    known = presets()
    opened = scenario or load_scenario(known["fig5b_state_b"])
    compute, slower = worker.Worker(), worker.Worker()
    compute(worker.play, opened)  # loads what histories need
    pn.extension(notifications=False)
    names = (host, *LOOPBACK) if host in LOOPBACK else (host,)
    from bokeh.server.util import bind_sockets

    sockets, found = bind_sockets(host, port)
    for socket in sockets:
        socket.close()
    hosts = frozenset(f"{name}:{found}" for name in names)
    server = pn.io.server.get_server(
        {"/": lambda: _visit(opened, compute, slower, known)},
        port=found, address=host, websocket_origin=sorted(hosts), title="balloons live",
    )  # fmt: skip
    rule = Rule(Foreign(hosts), ErrorHandler, {"status_code": 403})
    server._tornado.default_router.rules.insert(0, rule)
    return server, f"http://{host}:{found}/"


def _visit(opened: Scenario, compute: worker.Worker, slower: worker.Worker, known: dict[str, str]) -> Any:
    """The page of one visitor."""
    said = {k: v[0].decode() for k, v in (pn.state.session_args or {}).items()}
    document = pn.state.curdoc
    scenario, problem = opened, ""
    try:
        if name := said.get("scenario"):
            if name not in known:
                raise ScenarioError("link", *_unknown(name, known))
            opened = scenario = load_scenario(known[name])
        scenario = links.opened_at(opened, urlencode(said))
        check_size(scenario)
    except ScenarioError as error:
        scenario, problem = opened, f"The link was not followed: {error}"
    dark = said.get("theme") == "dark"
    page = Page(
        opened,
        scenario,
        compute,
        document.add_next_tick_callback,
        compute_map=slower,
        dark=dark,
        presets=known,
        preset=said.get("scenario", "") if not problem else "",
        problem=problem,
    )
    template = pn.Template(_TEMPLATE)
    template.location = True
    template.add_panel("page", page.view)
    colours = {"ink": INK, "paper": PAPER, "problem": PROBLEM, "accent": ACCENT, "scheme": ("light", "dark")}
    for name, pair in colours.items():
        template.add_variable(name, pair[dark])
    return template


def _unknown(name: str, known: dict[str, str]) -> list[Any]:
    from simulator.scenario import Problem

    return [Problem("scenario", name, f"must be one of {', '.join(known)}")]
