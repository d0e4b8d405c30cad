"""The files of every shipped scenario, byte by byte, while the code is reorganised.

`python -m tests.test_unchanged` writes what they are now to `tests/unchanged.json`.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from simulator import load_scenario
from simulator.cli import app

STORED = Path(__file__).parent / "unchanged.json"
SCENARIOS = sorted(Path("scenarios").glob("*.toml"))
VOLATILE = {"seconds", "versions", "created", "simulator", "version"}


def stripped(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: stripped(item) for key, item in value.items() if key not in VOLATILE}
    if isinstance(value, str):
        return value.replace(str(Path.cwd()), "")  # tables are told by their absolute path
    return [stripped(item) for item in value] if isinstance(value, list) else value


def digests(scenario: Path) -> dict[str, str]:
    ambient = load_scenario(scenario).gas.ambient_pressure
    found: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        vary = ["--vary", "gas.ambient_pressure", "--to", repr(1.1 * float(ambient) + 0.01)]
        for verb, more in {"run": [], "trace": [], "fold": vary}.items():
            directory = out / verb
            result = CliRunner().invoke(app, [verb, str(scenario), "--out", str(directory), "--quiet", *more])
            found[f"{verb} exit code"] = str(result.exit_code)
            for file in sorted(directory.glob("*")) if directory.exists() else ():
                content = file.read_bytes()
                if file.suffix == ".json":
                    content = json.dumps(stripped(json.loads(content)), sort_keys=True).encode()
                found[file.name] = hashlib.sha256(content).hexdigest()[:16]
    return found


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda path: path.stem)
def test_the_files_of_a_shipped_scenario_are_what_they_were(scenario: Path) -> None:
    assert digests(scenario) == json.loads(STORED.read_text())[scenario.stem]


if __name__ == "__main__":
    STORED.write_text(json.dumps({s.stem: digests(s) for s in SCENARIOS}, indent=1) + "\n")
