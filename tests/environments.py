"""The suite in environments of its own: the lowest releases allowed, and every Python of this machine.

    python -m tests.environments lowest [PYTEST OPTIONS]
    python -m tests.environments pythons [PYTEST OPTIONS]

Each environment is made once, as `.venv-lowest`, `.venv-3.12` and so on, and brought up to date in each run.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
MINORS = range(11, 16)  # from `requires-python` to what may come
TOOLS = ("import-linter", "mypy", "pandas-stubs", "pre-commit", "ruff")  # the suite does not use them


def lower_bounds(project: dict[str, Any]) -> list[str]:
    """Every requirement and extra of a project at its lower bound, as constraints of pip; no tools.

    Parameters
    ----------
    project : dict
        The table `[project]` of pyproject.toml; each requirement is of the form ``name>=version``.
    """
    extras = project["optional-dependencies"].values()
    everything = {*project["dependencies"], *(one for extra in extras for one in extra)}
    split = (requirement.split(">=") for requirement in sorted(everything))
    return [f"{name}=={version}" for name, version in split if name not in TOOLS]


def interpreter(minor: int) -> str | None:
    """A Python 3.minor of this machine that starts, on the path or of pyenv."""
    candidates = [
        f"python3.{minor}",
        *map(str, sorted(Path.home().glob(f".pyenv/versions/3.{minor}.*/bin/python"))),
    ]
    for candidate in candidates:
        if shutil.which(candidate) and _says(candidate) == f"3.{minor}":
            return candidate
    return None


def _says(python: str) -> str:
    program = "import sys; print('%d.%d' % sys.version_info[:2])"
    done = subprocess.run([python, "-c", program], capture_output=True, text=True, check=False)
    return done.stdout.strip()


def suite(python: str, name: str, options: Sequence[str], constraints: Sequence[str] = ()) -> int:
    """Make the environment `.venv-<name>` and run the suite in it; pytest's exit code, or that of pip."""
    folder = ROOT / f".venv-{name}"
    own = folder / "bin" / "python"
    if not own.exists():
        subprocess.run([python, "-m", "venv", str(folder)], check=True)
    held = folder / "constraints.txt"
    held.write_text("".join(f"{line}\n" for line in constraints), "utf-8")
    pip = [str(own), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    done = subprocess.run([*pip, "--constraint", str(held), "--editable", ".[dev]"], cwd=ROOT, check=False)
    if done.returncode:
        print(f"{name}: could not be installed", file=sys.stderr)
        return done.returncode
    return subprocess.run([str(own), "-m", "pytest", *options], cwd=ROOT, check=False).returncode


def lowest(options: Sequence[str]) -> int:
    """The suite with the oldest releases that pyproject.toml allows, all together."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    oldest = re.fullmatch(r">=3\.(\d+)", project["requires-python"])
    assert oldest is not None, "requires-python has another form"
    python = interpreter(int(oldest[1]))
    if python is None:
        print(f"lowest: skipped, there is no Python 3.{oldest[1]} on this machine")
        return 0
    return suite(python, "lowest", options, lower_bounds(project))


def pythons(options: Sequence[str]) -> int:
    """The suite on every supported Python that this machine has."""
    codes = {}
    for minor in MINORS:
        python = interpreter(minor)
        if python is None:
            print(f"Python 3.{minor}: skipped, not on this machine", flush=True)
            continue
        print(f"Python 3.{minor}: {python}", flush=True)
        codes[minor] = suite(python, f"3.{minor}", options)
    for minor, code in codes.items():
        print(f"Python 3.{minor}: {f'failed, exit code {code}' if code else 'passed'}")
    return max(codes.values(), default=0)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.environments", description=__doc__)
    parser.add_argument("which", choices=["lowest", "pythons"])
    given, options = parser.parse_known_args()
    return {"lowest": lowest, "pythons": pythons}[given.which](options)


if __name__ == "__main__":
    sys.exit(main())
