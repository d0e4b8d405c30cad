"""Sweep files that make no sense, each with its message."""

from __future__ import annotations

import math

import pytest

from simulator.results.files import OutputError
from simulator.scenario import ScenarioError
from simulator.sweep import load_sweep, read_sweep
from tests.sweeps import CHEAP, FIG3C, balloons


def refusal(**definition):
    base = {"scenario": CHEAP, "vary": {"gas.ambient_pressure": [1.0]}}
    with pytest.raises(ScenarioError) as caught:
        read_sweep({**base, **definition})
    return str(caught.value)


@pytest.mark.parametrize(
    ("definition", "told"),
    [
        (
            {"vary": {"gas.ambient_presure": [1.0]}},
            'vary."gas.ambient_presure": no such key in the scenario, did you mean gas.ambient_pressure',
        ),
        ({"vary": {"balloon.activ.radius": [1.0]}}, "did you mean balloon.active.radius or"),
        ({"vary": {"step.3.ramp": [1.0]}}, "did you mean step.2.ramp"),
        ({"vary": {"gas": [1.0]}}, "vary.gas: no such key"),
        ({"vary": {}}, "vary = {}: must be a table with one or more keys of the scenario"),
        ({"vary": {"step.1.inflate": []}}, 'vary."step.1.inflate" = []: must have one or more values'),
        ({"vary": {"step.1.inflate": 3}}, "must be a list of values, or a table such as"),
        ({"vary": {"step.1.inflate": [1, "a"]}}, "must be all numbers, all texts or all true or false"),
        ({"vary": {"step.1.inflate": [1, 1.0]}}, "must not have a value twice"),
        ({"vary": {"step.1.inflate": [math.inf]}}, "must be finite numbers"),
        ({"vary": {"step.1.inflate": [0.5, -1.0]}}, 'vary."step.1.inflate" = -1.0: must be a number >= 0'),
        (
            {"vary": {"step.1.inflate": {"from": 1, "to": 2, "points": 3, "spacing": "cubic"}}},
            'vary."step.1.inflate".spacing = "cubic": must be "linear" or "log"',
        ),
        (
            {"vary": {"step.1.inflate": {"from": 0, "to": 2, "points": 3, "spacing": "log"}}},
            'vary."step.1.inflate".from = 0.0: must be > 0 with log spacing',
        ),
        (
            {"vary": {"step.1.inflate": {"from": 1, "to": 1, "points": 3}}},
            'vary."step.1.inflate".to = 1.0: must differ from from',
        ),
        (
            {"vary": {"step.1.inflate": {"from": 1, "to": 2}}},
            'vary."step.1.inflate".points: is missing, must be a whole number >= 2',
        ),
        (
            {"vary": {"step.1.inflate": {"from": 1, "to": 2, "points": 1}}},
            "points = 1: must be a whole number >= 2",
        ),
        (
            {"vary": {"step.1.inflate": {"from": "1 kPa", "to": "2 Pa", "points": 2}}},
            "must be in the unit of from, kPa",
        ),
        (
            {"vary": {"step.1.inflate": {"from": [], "to": 2, "points": 2}}},
            "must be a finite number, or a text such as",
        ),
        ({"vary": {"balloon.active.name": ["a"]}}, "cannot be varied, results have columns by name"),
        (
            {"vary": {"step.1.inflate": {"from": 0, "to": 1, "points": 20_000_000}}},
            "must ask for at most 10,000,000 runs, asks for 20,000,000",
        ),
        (
            {"sample": {"method": "sobl", "size": 4}},
            'sample.method = "sobl": must be "sobol", "latin-hypercube" or "random"',
        ),
        ({"sample": {"method": "sobol", "size": 4}}, "must be an interval such as { from = 0.1, to = 1 }"),
        (
            {"sample": {"method": "sobol", "size": 100}, "vary": {"step.1.inflate": {"from": 0.1, "to": 1}}},
            "sample.size = 100: must be a power of 2 for sobol, such as 128",
        ),
        (
            {
                "sample": {"method": "random", "size": 4},
                "vary": {"step.1.inflate": {"from": 0.1, "to": 1, "points": 3}},
            },
            "points = 3: does not go with sample",
        ),
        (
            {"past_limit_point": {"step.1.inflate": {"times": 1.1}}},
            "must be a ramp of the scenario, step.2.ramp",
        ),
        (
            {"past_limit_point": {"step.2.ramp": {"times": 1.0}}},
            'past_limit_point."step.2.ramp".times = 1.0: must be a number > 1',
        ),
        (
            {"past_limit_point": {"step.2.ramp": {"times": 1.1}}, "vary": {"step.2.ramp": [1.0]}},
            "is varied, too",
        ),
        (
            {"record": {"sensitivities": ["gas.pressure"]}},
            'record.sensitivities = "gas.pressure": no number of the device; did you mean gas.amb',
        ),
        ({"record": {"limit_points": -1}}, "record.limit_points = -1: must be a whole number from 0 to 100"),
        (
            {"out": "x"},
            'out = "x": unknown key, allowed here: title, scenario, sample, vary, past_limit_point, record',
        ),
    ],
)
def test_refused(definition, told):
    message = refusal(**definition)
    assert message.startswith("<dict>: ")
    assert told in message


def test_files_that_are_not_there_or_not_toml(tmp_path):
    result = balloons("sweep", tmp_path / "none.toml")
    assert (result.exit_code, "none.toml: cannot be read, no such file" in result.stderr) == (2, True)
    (tmp_path / "bad.toml").write_text("scenario = ")
    assert "bad.toml: must be TOML" in balloons("sweep", tmp_path / "bad.toml").stderr
    (tmp_path / "lost.toml").write_text('scenario = "lost_pair.toml"\n[vary]\n"a.b" = [1]\n')
    assert "lost_pair.toml: cannot be read" in balloons("sweep", tmp_path / "lost.toml").stderr
    with pytest.raises(OutputError, match=r"no sweep in .*sweep\.json cannot be read, no such file"):
        load_sweep(tmp_path)


def test_a_scheduler_that_is_not_there(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    from simulator.sweep import cluster

    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    (tmp_path / "sweep.toml").write_text(f'scenario = "{FIG3C}"\n[vary]\n"step.1.inflate" = [0.1]\n')
    for address in ("tcp://127.0.0.1:1", "nowhere"):
        result = balloons("sweep", tmp_path / "sweep.toml", "--dask", address, "--out", tmp_path / "x")
        assert result.exit_code == 2
        assert f"--dask {address}: no scheduler answers there" in result.stderr
    assert not (tmp_path / "x").exists()
