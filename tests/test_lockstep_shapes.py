"""Shapes of runs played in lockstep come out as those of runs by themselves."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.sweep import read_sweep
from simulator.sweep.lockstep import chunk
from simulator.sweep.rows import columns
from tests.sweeps import ROOT
from tests.test_lockstep import PAIR, both_ways, sampled

SHAPES = {"record": {"shapes": True}}


@pytest.mark.parametrize(
    ("steps", "vary", "words"),
    [
        ([{"inflate": 1.1}, {"triangle": {"low": 0.1, "high": 0.6, "period": 1, "cycles": 2.5}}],
         {"step.2.triangle.high": (0.3, 0.8), "gas.ambient_pressure": (0.005, 0.1)},
         {"sphere", "pear_without_snap", "pear_before_snap"}),
        ([{"inflate": 0.8}, {"jump": 0.3}, {"jump": 0.0}, {"jump": 0.5}],
         {"step.2.jump": (0.1, 0.9), "gas.ambient_pressure": (0.005, 0.3)}, {"sphere", "pear_without_snap"}),
        ([{"inflate": 1.0}, {"ramp": 0.5, "valve": "open"}, {"hold": 1.0}, {"ramp": 0.9}],
         {"step.2.ramp": (0.1, 0.6), "gas.ambient_pressure": (0.005, 0.1)},
         {"pear_in_snap", "pear_without_snap"}),
        ([{"inflate": 1.2}, {"ramp": 0.6}, {"ramp": 0.0}],
         {"balloon.active.radius": (0.4, 1.0), "gas.ambient_pressure": (0.001, 0.1),
          "step.1.inflate": (0.8, 2.6)},
         {"sphere", "snap_of_a_sphere", "pear_without_snap"}),
    ],
)  # fmt: skip
def test_shapes_come_out_the_same(steps, vary, words):
    found = both_ways(sampled({**PAIR, "step": steps}, vary, **SHAPES), least=0.9)
    assert words <= {row["shape"] for row in found}


def test_what_may_lose_its_sphere_without_a_voltage_is_left_to_simulate():
    ogden = {"model": "ogden", "mu": [6.3, 0.012, -0.1], "alpha": [1.3, 5, -2]}
    active, passive = PAIR["balloon"]
    scenario = {**PAIR, "balloon": [active, {**passive, "elastomer": ogden}]}
    both_ways(sampled(scenario, {"gas.ambient_pressure": (0.02, 1.0)}, **SHAPES), least=0.0)
    sweep = read_sweep(sampled(scenario, {"gas.ambient_pressure": (0.02, 1.0)}, **SHAPES))
    names = list(columns(sweep.job))
    rows = chunk.rows(sweep.job, 0, sweep.values(0, 40), (), names, lambda job, index, values: {})
    assert {row[names.index("way")] for row in rows} == {chunk.ALONE}


def test_the_map_of_shapes_is_played_in_lockstep():
    sweep = read_sweep(ROOT / "scenarios/sweeps/paper_shapes.toml")
    some = np.random.default_rng(5).choice(sweep.size, 400, replace=False).tolist()
    values = [sweep.values(k, k + 1)[0] for k in some]
    names = list(columns(sweep.job))
    rows = chunk.rows(sweep.job, 0, values, (), names, lambda job, index, values: {})
    assert sum(row[names.index("way")] == chunk.LOCKSTEP for row in rows) >= 398
