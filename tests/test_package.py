"""The package as others meet it: names, version, types, and what importing it costs."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib.metadata import entry_points, metadata
from pathlib import Path

import pytest
from hatchling.builders.sdist import SdistBuilder
from hatchling.builders.wheel import WheelBuilder
from hatchling.metadata.core import ProjectMetadata
from hatchling.plugin.manager import PluginManager

import simulator

ROOT = Path(__file__).parent.parent


def python(program: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_version_is_the_same_everywhere():
    # What a build gives, and not what the environment of this run was made with.
    assert ProjectMetadata(str(ROOT), PluginManager()).version == simulator.__version__
    assert f"\nversion: {simulator.__version__}\n" in (ROOT / "CITATION.cff").read_text("utf-8")
    assert simulator.__version__ in (ROOT / "CHANGELOG.md").read_text("utf-8")


def test_distribution_names_command_licence_and_python():
    (command,) = (e for e in entry_points(group="console_scripts") if e.name == "balloons")
    assert command.value == "simulator.cli:app"
    assert metadata("dielectric-balloons")["Requires-Python"] == ">=3.11"
    assert metadata("dielectric-balloons")["License-Expression"] == "BSD-3-Clause"


def test_every_requirement_has_a_lower_bound():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    for requirement in [*project["dependencies"], *(one for extra in extras.values() for one in extra)]:
        assert re.fullmatch(r"[a-z-]+>=[0-9.]+", requirement)
    # Tests need what every extra brings.
    assert {*extras["sweep"], *extras["dask"], *extras["live"], *extras["fit"]} <= {*extras["dev"]}


def test_the_wheel_holds_the_package_and_nothing_of_the_tests(tmp_path):
    wheel = next(WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"]))
    names = zipfile.ZipFile(wheel).namelist()
    modules = {path.relative_to(ROOT).as_posix() for path in (ROOT / "simulator").rglob("*.py")}
    assert {name for name in names if name.endswith(".py")} == modules
    assert {name.partition("/")[0] for name in names} == {
        "simulator",
        f"dielectric_balloons-{simulator.__version__}.dist-info",
    }
    assert {"simulator/py.typed", "simulator/scenarios/fig5b_state_b.toml"} <= set(names)


def test_the_source_distribution_holds_what_is_needed_to_test_it(tmp_path):
    archive = next(SdistBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"]))
    with tarfile.open(archive) as packed:
        names = {name.partition("/")[2] for name in packed.getnames()}
    tests = {path.relative_to(ROOT).as_posix() for path in (ROOT / "tests").rglob("*.py")}
    assert tests <= names
    assert {"README.md", "CONTRIBUTING.md", "LICENSE", "Makefile", "docs/paper.md"} <= names
    assert not any(name.startswith("results/") or "__pycache__" in name for name in names)


def test_the_package_imports_nothing_of_the_tests():
    for path in (ROOT / "simulator").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.partition(".")[0] == "tests" for name in names), path


def test_the_help_lists_the_verbs_of_a_users_work():
    done = subprocess.run(
        [sys.executable, "-m", "simulator", "--help"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, "COLUMNS": "200", "NO_COLOR": "1", "PYTHONIOENCODING": "utf-8"},
        check=True,
    )
    listed = re.findall(r"^│ (\w+) ", done.stdout, re.MULTILINE)
    assert sorted(listed) == sorted(
        [
            "run",
            "live",
            "animate",
            "trace",
            "fold",
            "states",
            "unload",
            "explain",
            "presets",
            "schema",
            "sweep",
            "map",
            "optimize",
            "fit",
        ]
    )


@pytest.mark.parametrize("name", simulator.__all__)
def test_every_public_name_is_there(name):
    assert getattr(simulator, name).__module__.startswith("simulator.")
    assert name in dir(simulator)


def test_unknown_names_are_refused_as_everywhere():
    with pytest.raises(AttributeError, match="module 'simulator' has no attribute 'simulat'"):
        simulator.simulat  # noqa: B018
    with pytest.raises(ImportError):
        from simulator import nothing_of_the_kind  # noqa: F401


def test_package_is_typed():
    assert (Path(simulator.__file__).parent / "py.typed").exists()


def test_names_are_not_modules():
    """No module of the package is named like a function of it, so import order cannot matter."""
    python(
        "import simulator.simulation.run, simulator.simulation.explanation; "
        "from simulator import simulate, explain; assert callable(simulate) and callable(explain)"
    )


def test_importing_the_package_loads_next_to_nothing():
    loaded = python(
        "import sys; before = set(sys.modules); import simulator; print(*set(sys.modules) - before)"
    )
    heavy = {"numpy", "scipy", "pandas", "matplotlib", "sksundae", "pydantic", "typer", "rich"}
    assert not heavy & set(loaded.split())


def test_running_in_python_needs_no_tables_pictures_or_terminal():
    program = "import sys; from simulator import load_scenario, simulate, History; print(*sys.modules)"
    assert not {"pandas", "matplotlib", "typer", "rich"} & set(python(program).split())


def test_a_run_is_independent_of_the_closed_form_that_it_is_measured_against(tmp_path):
    program = (
        "import sys; from simulator.cli import app; "
        f"app(['run', 'scenarios/fig5b_state_b.toml', '--out', {str(tmp_path / 'run')!r}], "
        "standalone_mode=False); print(*sys.modules)"
    )
    assert "tests.oracle.closed_form" not in python(program).split()


def test_the_closed_form_loads_nothing_of_the_solver():
    loaded = python("import sys, tests.oracle.closed_form; print(*sys.modules)").split()
    assert {"tests.oracle.closed_form.history", "simulator.model.elastomers"} <= set(loaded)
    assert not {
        "sksundae",
        "scipy",
        "simulator.model.equations",
        "simulator.solver.newton",
        "simulator.scenario",
    } & set(loaded)
