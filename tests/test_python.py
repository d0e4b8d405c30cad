"""docs/python.md: every public name is on the page, and its examples say the truth."""

from __future__ import annotations

import doctest
import inspect
import re
from pathlib import Path

import pytest

import simulator

PAGE = Path("docs/python.md").read_text("utf-8")
API = Path("docs/reference/api.md").read_text("utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


def run(text: str, name: str, names: dict[str, object]) -> str:
    """Run the examples of a text, which may leave names behind; what did not come out as it says."""
    example = doctest.DocTestParser().get_doctest(text, names, name, None, 0)
    report: list[str] = []
    doctest.DocTestRunner().run(example, out=report.append, clear_globs=False)
    names.update(example.globs)
    return "".join(report)


def test_the_examples_of_the_page_give_what_they_say(tmp_path: Path) -> None:
    names: dict[str, object] = {"folder": tmp_path}
    for number, block in enumerate(BLOCKS, start=1):
        assert run(block, f"block {number}", names) == ""


@pytest.mark.parametrize("name", simulator.__all__)
def test_every_public_name_has_its_line_and_an_example(name: str) -> None:
    assert f"**`{name}`**" in PAGE
    assert any(re.search(rf"\b{name}\b", block) for block in BLOCKS)
    assert f"\n   {name}\n" in API


@pytest.mark.parametrize("name", simulator.__all__)
def test_the_examples_of_a_docstring_give_what_they_say(name: str) -> None:
    value = getattr(simulator, name)
    members = [m for n, m in vars(value).items() if not n.startswith("_")] if inspect.isclass(value) else []
    for documented in [value, *members]:
        text = inspect.getdoc(documented) or ""
        if ">>>" in text:
            scenario = simulator.load_scenario("scenarios/fig3c_state_b.toml")
            names = {**{n: getattr(simulator, n) for n in simulator.__all__}, "scenario": scenario}
            assert run(text, name, dict(names)) == ""
