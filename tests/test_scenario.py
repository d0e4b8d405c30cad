"""The scenario file: what is read, what is refused and in which words, what comes back out."""

from __future__ import annotations

import copy
import itertools
import json
import pickle
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from simulator import scenario as room
from simulator.scenario import (
    Cycle,
    Gent,
    Hold,
    Inflate,
    Jump,
    NeoHookean,
    Problem,
    Ramp,
    ScenarioError,
    Sine,
    Table,
    Triangle,
    duration,
    load_scenario,
)

SHIPPED = sorted((Path(__file__).parent.parent / "scenarios").glob("*.toml"))

VALID = """
title = "A pair"
[gas]
ambient_pressure = 1.0
[[balloon]]
name = "active"
radius = 0.5
electrodes = true
breakdown = { field = 12.0 }
elastomer = { model = "gent", J_lim = 100 }
[[balloon]]
name = "passive"
elastomer = { model = "neo-hookean" }
[[step]]
inflate = 2.4
[[step]]
ramp = 0.2
over = 10
[[step]]
cycle = 3
steps = [ { hold = 5 }, { cycle = 2, steps = [ { jump = 0.1 } ] } ]
[output]
points = 101
[solver]
rtol = 1e-5
"""
TITLE, GAS, ACTIVE, PASSIVE = (
    'title = "A pair"',
    "ambient_pressure = 1.0",
    'name = "active"',
    'name = "passive"',
)
GENT, RAMP, HOLD, POINTS = 'model = "gent", J_lim = 100', "ramp = 0.2\nover = 10", "hold = 5", "points = 101"
KINDS = "inflate, ramp, charge, hold, jump, sine, triangle, table, cycle"
VOLTAGE = "a number, or a table of one or more numbers by balloon name"
A_NAME = "a name of letters, digits and _, no digit first"
TOP = "title, source, scales, gas, balloon, step, dynamics, supply, shape, output, solver"
IN_GAS = "ambient_pressure, chamber, law, exponent"
VALUE = "a number > 0, or a table of one or more numbers > 0 by balloon name"
ENDS = "a table with one or more of event, stretch, pressure, field"
MODELS = (
    '"gent", "neo-hookean", "mooney-rivlin", "ogden", "arruda-boyce", '
    '"yeoh", "gent-gent", "fung" or "tabulated"'
)
MATERIALS = '"VHB-4910", "Sylgard-186" or "natural-rubber"'
AN_ELASTOMER = 'must be a table such as { model = "gent", J_lim = 100 } or { preset = "VHB-4910" }'
EXPONENTS = "a list of one or more numbers other than 0"
A_CURVE = "the path of a CSV file with columns stretch,pressure or stretch,stress"
TOO_MANY = "must ask for at most 10,000,000 samples over the whole scenario"


def minimal(**changes: object) -> dict[str, object]:
    balloon = {"name": "a", "electrodes": True, "elastomer": {"model": "gent", "J_lim": 100}}
    return {
        "title": "t",
        "gas": {"ambient_pressure": 1},
        "balloon": [balloon],
        "step": [{"inflate": 1}],
        **changes,
    }


def write(folder: Path, text: str, name: str = "x.toml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def refusal(source: object) -> ScenarioError:
    with pytest.raises(ScenarioError) as caught:
        load_scenario(source)  # type: ignore[arg-type]
    return caught.value


# What replaces what in VALID, and the lines that come of it (key, value, allowed).
REFUSED = [
    # numbers that make no sense
    (GAS, "ambient_pressure = -1", [("gas.ambient_pressure", -1, "must be a number >= 0")]),
    (GAS, "ambient_pressure = nan", [("gas.ambient_pressure", ..., "must be a finite number >= 0")]),
    (GAS, "ambient_pressure = inf", [("gas.ambient_pressure", np.inf, "must be a finite number >= 0")]),
    (GAS, "ambient_pressure = true", [("gas.ambient_pressure", True, "must be a number >= 0")]),
    (GAS, 'ambient_pressure = "1"', [("gas.ambient_pressure", "1", "must be a number >= 0")]),
    (GAS, "ambient_pressure = []", [("gas.ambient_pressure", [], "must be a number >= 0")]),
    ("radius = 0.5", "radius = 0", [("balloon.active.radius", 0, "must be a number > 0")]),
    ("radius = 0.5", "thickness = -2", [("balloon.active.thickness", -2, "must be a number > 0")]),
    ("radius = 0.5", "modulus = nan", [("balloon.active.modulus", ..., "must be a finite number > 0")]),
    (
        "radius = 0.5",
        "permittivity = inf",
        [("balloon.active.permittivity", np.inf, "must be a finite number > 0")],
    ),
    ("field = 12.0", "field = 0", [("balloon.active.breakdown.field", 0, "must be a number > 0")]),
    ("J_lim = 100", "J_lim = 0", [("balloon.active.elastomer.J_lim", 0, "must be a number > 0")]),
    ("J_lim = 100", "J_lim = -3", [("balloon.active.elastomer.J_lim", -3, "must be a number > 0")]),
    ("inflate = 2.4", "inflate = -1", [("step.1.inflate", -1, "must be a number >= 0")]),
    ("inflate = 2.4", "inflate = 1\nover = 0", [("step.1.over", 0, "must be a number > 0")]),
    (
        "ramp = 0.2",
        "ramp = nan",
        [("step.2.ramp", ..., f"must be {VOLTAGE.replace('a num', 'a finite num')}")],
    ),
    ("ramp = 0.2", 'ramp = "up"', [("step.2.ramp", "up", f"must be {VOLTAGE}")]),
    ("over = 10", "over = 0", [("step.2.over", 0, "must be a number > 0")]),
    (HOLD, "hold = 0", [("step.3.steps.1.hold", 0, "must be a number > 0")]),
    ("jump = 0.1", "jump = true", [("step.3.steps.2.steps.1.jump", True, f"must be {VOLTAGE}")]),
    # until
    ("over = 10", "until = 3", [("step.2.until", 3, f"must be {ENDS}")]),
    ("over = 10", "until = {}", [("step.2.until", {}, f"must be {ENDS}")]),
    (
        "over = 10",
        'until = { event = "breakdown" }',
        [("step.2.until.event", "breakdown", 'must be "limit_point" or "loss_of_sphericity"')],
    ),
    (
        "over = 10",
        "until = { stretch = 0, pressure = -1, field = {} }",
        [
            ("step.2.until.stretch", 0, f"must be {VALUE}"),
            ("step.2.until.pressure", -1, "must be a number > 0"),
            ("step.2.until.field", {}, f"must be {VALUE}"),
        ],
    ),
    (
        "over = 10",
        "until = { stretch = { active = -2 } }",
        [("step.2.until.stretch.active", -2, "must be a number > 0")],
    ),
    (
        "over = 10",
        "until = { field = { active = inf } }",
        [("step.2.until.field.active", np.inf, "must be a finite number > 0")],
    ),
    (
        "over = 10",
        "until = { field = inf }",
        [("step.2.until.field", np.inf, f"must be {VALUE.replace('a number', 'a finite number')}")],
    ),
    (
        "over = 10",
        "until = { volume = 1 }",
        [("step.2.until.volume", 1, "unknown key, allowed here: event, stretch, pressure, field")],
    ),
    (
        "over = 10",
        "until = { stretch = { third = 2 }, field = { passive = 3, active = 1 } }",
        [
            ("step.2.until.stretch.third", 2.0, "no such balloon, must be one of active, passive"),
            ("step.2.until.field.passive", 3.0, "has no electrodes, must be one of active"),
        ],
    ),
    (
        "over = 10",
        'valve = "open"\nuntil = { pressure = 1 }',
        [("step.2.until.pressure", 1.0, "needs the valve closed, open it keeps the pressure")],
    ),
    (
        '{ model = "neo-hookean" }',
        '{ model = "neo-hookean" }\nelectrodes = true\n'
        "[[step]]\nramp = 1\nuntil = { stretch = 2, field = 3 }",
        [
            ("step.1.until.stretch", 2.0, "must be a table by balloon name, active, passive have electrodes"),
            ("step.1.until.field", 3.0, "must be a table by balloon name, active, passive have electrodes"),
        ],
    ),
    (
        HOLD,
        "hold = 5, until = { pressure = 1 }",
        [("step.3.steps.1.until", {"pressure": 1}, "unknown key, allowed here: hold, valve")],
    ),
    ("cycle = 3", "cycle = 0", [("step.3.cycle", 0, "must be a whole number >= 1")]),
    ("cycle = 3", "cycle = 2.5", [("step.3.cycle", 2.5, "must be a whole number >= 1")]),
    ("cycle = 3", "cycle = true", [("step.3.cycle", True, "must be a whole number >= 1")]),
    (POINTS, "points = 1", [("output.points", 1, "must be a whole number >= 2")]),
    (POINTS, "points = 5.0", [("output.points", 5.0, "must be a whole number >= 2")]),
    (POINTS, "every = 0", [("output.every", 0, "must be a number > 0")]),
    ("rtol = 1e-5", "rtol = 1", [("solver.rtol", 1, "must be a number from 1e-12 to 0.1")]),
    ("rtol = 1e-5", "rtol = 0", [("solver.rtol", 0, "must be a number from 1e-12 to 0.1")]),
    # words that make no sense
    (TITLE, 'title = " "', [("title", " ", "must be a non-empty text")]),
    (TITLE, "title = 3", [("title", 3, "must be a non-empty text")]),
    (TITLE, TITLE + '\nsource = ""', [("source", "", "must be a non-empty text")]),
    (PASSIVE, 'name = "a b"', [("balloon.2.name", "a b", f"must be {A_NAME}")]),
    (PASSIVE, 'name = "2nd"', [("balloon.2.name", "2nd", f"must be {A_NAME}")]),
    (PASSIVE, 'name = ""', [("balloon.2.name", "", f"must be {A_NAME}")]),
    ("electrodes = true", "electrodes = 1", [("balloon.active.electrodes", 1, "must be true or false")]),
    ("over = 10", 'valve = "ajar"', [("step.2.valve", "ajar", 'must be "closed" or "open"')]),
    # elastomers
    ('"gent"', '"marlow"', [("balloon.active.elastomer.model", "marlow", f"must be {MODELS}")]),
    ('"gent"', '["gent"]', [("balloon.active.elastomer.model", ["gent"], f"must be {MODELS}")]),
    (GENT, "J_lim = 100", [("balloon.active.elastomer", {"J_lim": 100}, AN_ELASTOMER)]),
    (GENT, 'preset = "VHB"', [("balloon.active.elastomer.preset", "VHB", f"must be {MATERIALS}")]),
    (GENT, "preset = 4910", [("balloon.active.elastomer.preset", 4910, f"must be {MATERIALS}")]),
    (
        GENT,
        'preset = "natural-rubber", mu = 2',
        [("balloon.active.elastomer.mu", 2, "unknown key, allowed here: preset")],
    ),
    (
        GENT,
        GENT + ', preset = "natural-rubber"',
        [
            (
                "balloon.active.elastomer",
                {"model": "gent", "J_lim": 100, "preset": "natural-rubber"},
                "must have a model or a preset, not both",
            )
        ],
    ),
    (
        GENT,
        'model = "mooney-rivlin", C1 = -1, C2 = "x"',
        [
            ("balloon.active.elastomer.C1", -1, "must be a number >= 0"),
            ("balloon.active.elastomer.C2", "x", "must be a number >= 0"),
        ],
    ),
    (
        GENT,
        'model = "mooney-rivlin", C1 = 0, C2 = 0',
        [("balloon.active.elastomer.C1", 0, "must be > 0 where C2 is 0")],
    ),
    (
        GENT,
        'model = "ogden", mu = [1]',
        [("balloon.active.elastomer.alpha", None, f"is missing, must be {EXPONENTS}")],
    ),
    (
        GENT,
        'model = "ogden", mu = [], alpha = 2',
        [
            ("balloon.active.elastomer.mu", [], "must be a list of one or more numbers"),
            ("balloon.active.elastomer.alpha", 2, f"must be {EXPONENTS}"),
        ],
    ),
    (
        GENT,
        'model = "ogden", mu = [1, "2"], alpha = [1, 2]',
        [("balloon.active.elastomer.mu.2", "2", "must be a number")],
    ),
    (
        GENT,
        'model = "ogden", mu = [1, 2], alpha = [2]',
        [("balloon.active.elastomer.alpha", [2], "must have as many numbers as mu, 2, has 1")],
    ),
    (
        GENT,
        'model = "ogden", mu = [1, 2], alpha = [2, 0]',
        [("balloon.active.elastomer.alpha", [2, 0], f"must be {EXPONENTS}")],
    ),
    (
        GENT,
        'model = "ogden", mu = [1, 2], alpha = [2, -3]',
        [
            (
                "balloon.active.elastomer.mu",
                [1, 2],
                "must give a shear modulus Σ mu alpha / 2 > 0, gives -2",
            )
        ],
    ),
    (
        GENT,
        'model = "arruda-boyce", lambda_L = 1',
        [("balloon.active.elastomer.lambda_L", 1, "must be a number > 1")],
    ),
    (
        GENT,
        'model = "yeoh", C1 = 0, C2 = 1',
        [("balloon.active.elastomer.C1", 0, "must be a number > 0")],
    ),
    (
        GENT,
        'model = "gent-gent", C1 = 1, C2 = -1, J_lim = 50',
        [("balloon.active.elastomer.C2", -1, "must be a number >= 0")],
    ),
    (
        GENT,
        'model = "fung", b = 0',
        [("balloon.active.elastomer.b", 0, "must be a number > 0")],
    ),
    (
        GENT,
        'model = "tabulated", table = 3',
        [("balloon.active.elastomer.table", 3, f"must be {A_CURVE}")],
    ),
    (
        '"neo-hookean"',
        '"neo-hookean", J_lim = 100',
        [("balloon.passive.elastomer.J_lim", 100, "unknown key, allowed here: model")],
    ),
    (
        'elastomer = { model = "neo-hookean" }',
        'elastomer = "gent"',
        [("balloon.passive.elastomer", "gent", AN_ELASTOMER)],
    ),
    # what is missing
    (TITLE, "", [("title", None, "is missing, must be a non-empty text")]),
    (GAS, "", [("gas.ambient_pressure", None, "is missing, must be a number >= 0")]),
    (PASSIVE, "", [("balloon.2.name", None, f"is missing, must be {A_NAME}")]),
    (", J_lim = 100", "", [("balloon.active.elastomer.J_lim", None, "is missing, must be a number > 0")]),
    (
        'elastomer = { model = "neo-hookean" }',
        "",
        [("balloon.passive.elastomer", None, "is missing, must be a table with the model or a preset")],
    ),
    (HOLD, "cycle = 2", [("step.3.steps.1.steps", None, "is missing, must be one or more steps")]),
    (
        HOLD,
        "sine = { mean = 0, period = 1, cycles = 2 }",
        [("step.3.steps.1.sine.amplitude", None, "is missing, must be a number")],
    ),
    # unknown keys
    (TITLE, TITLE + "\ntau = 1", [("tau", 1, f"unknown key, allowed here: {TOP}")]),
    (TITLE, TITLE + '\nfile = "x"', [("file", "x", f"unknown key, allowed here: {TOP}")]),
    (TITLE, TITLE + "\nsteps = []", [("steps", [], f"unknown key, allowed here: {TOP}")]),
    (GAS, GAS + "\ngamma = 1.4", [("gas.gamma", 1.4, f"unknown key, allowed here: {IN_GAS}")]),
    (
        "field = 12.0",
        "field = 12, x = 1",
        [("balloon.active.breakdown.x", 1, "unknown key, allowed here: law, field")],
    ),
    (
        "field = 12.0",
        'law = "weibull", field = 12.0',
        [("balloon.active.breakdown.law", "weibull", 'must be "constant" or "power"')],
    ),
    (
        "field = 12.0",
        'law = "power", field = 12.0',
        [
            ("balloon.active.breakdown.stretch_exponent", None, "is missing, must be a number"),
            ("balloon.active.breakdown.thickness_exponent", None, "is missing, must be a number"),
        ],
    ),
    (
        "field = 12.0",
        'law = "power", field = -1, stretch_exponent = inf, thickness_exponent = 0, exponent = 1',
        [
            ("balloon.active.breakdown.field", -1, "must be a number > 0"),
            ("balloon.active.breakdown.stretch_exponent", np.inf, "must be a finite number"),
            (
                "balloon.active.breakdown.exponent",
                1,
                "unknown key, allowed here: law, field, stretch_exponent, thickness_exponent",
            ),
        ],
    ),
    (
        "breakdown = { field = 12.0 }",
        "breakdown = 12.0",
        [("balloon.active.breakdown", 12.0, "must be a table such as { field = 12 }")],
    ),
    (
        "field = 12.0",
        'law = "constant"',
        [("balloon.active.breakdown.field", None, "is missing, must be a number > 0")],
    ),
    ("{ field = 12.0 }", "{}", [("balloon.active.breakdown", {}, "must be a table such as { field = 12 }")]),
    (
        RAMP,
        "ramp = 0.2\novr = 10",
        [("step.2.ovr", 10, "unknown key, allowed here: ramp, over, valve, until")],
    ),
    (RAMP, "jump = 0.2\nover = 10", [("step.2.over", 10, "unknown key, allowed here: jump, valve")]),
    (HOLD, "hold = 5, over = 1", [("step.3.steps.1.over", 1, "unknown key, allowed here: hold, valve")]),
    (
        "inflate = 2.4",
        'inflate = 2.4\nvalve = "open"',
        [("step.1.valve", "open", "unknown key, allowed here: inflate, over")],
    ),
    (
        "cycle = 3",
        'cycle = 3\nvalve = "open"',
        [("step.3.valve", "open", "unknown key, allowed here: cycle, steps")],
    ),
    (
        HOLD,
        "triangle = { low = 0, high = 1, period = 1, cycles = 1, mean = 0 }",
        [("step.3.steps.1.triangle.mean", 0, "unknown key, allowed here: low, high, period, cycles")],
    ),
    (POINTS, "point = 4", [("output.point", 4, "unknown key, allowed here: points, every, rows, chord")]),
    ("rtol = 1e-5", "atol = 1", [("solver.atol", 1, "unknown key, allowed here: rtol")]),
    # kinds of step
    (
        RAMP,
        "ramp = 0.2\nhold = 5",
        [
            (
                "step.2",
                {"ramp": 0.2, "hold": 5},
                f"must be a table with exactly one of {KINDS}, has ramp and hold",
            )
        ],
    ),
    (
        RAMP,
        "rmap = 0.2",
        [("step.2", {"rmap": 0.2}, f"must be a table with exactly one of {KINDS}, has none")],
    ),
    (HOLD, "", [("step.3.steps.1", {}, f"must be a table with exactly one of {KINDS}, has none")]),
    ("{ hold = 5 }", "7", [("step.3.steps.1", 7, f"must be a table with exactly one of {KINDS}")]),
    ("[ { jump = 0.1 } ]", "[]", [("step.3.steps.2.steps", [], "must be one or more steps")]),
    ("[ { jump = 0.1 } ]", "4", [("step.3.steps.2.steps", 4, "must be one or more steps")]),
    (
        HOLD,
        "sine = 0.1",
        [("step.3.steps.1.sine", 0.1, "must be a table of mean, amplitude, period, cycles")],
    ),
    # waves by name
    (
        HOLD,
        "sine = { active = { mean = 0, amplitude = nan, phse = 1 }, cycles = 0 }",
        [
            ("step.3.steps.1.sine.period", None, "is missing, must be a number > 0"),
            ("step.3.steps.1.sine.cycles", 0, "must be a number > 0"),
            ("step.3.steps.1.sine.active.amplitude", ..., "must be a finite number"),
            ("step.3.steps.1.sine.active.phse", 1, "unknown key, allowed here: mean, amplitude, phase"),
        ],
    ),
    (
        HOLD,
        "sine = { active = { mean = 0, amplitude = 1 }, mean = 0, period = 1, cycles = 1 }",
        [("step.3.steps.1.sine.mean", 0, "must be a table of mean, amplitude, phase")],
    ),
    (
        HOLD,
        "sine = { passive = { mean = 0, amplitude = 1 }, third = { mean = 0, amplitude = 1 }, "
        "period = 1, cycles = 1 }",
        [
            (
                "step.3.steps.1.sine.passive",
                {"mean": 0.0, "amplitude": 1.0},
                "has no electrodes, must be one of active",
            ),
            (
                "step.3.steps.1.sine.third",
                {"mean": 0.0, "amplitude": 1.0},
                "no such balloon, must be one of active",
            ),
        ],
    ),
    (
        HOLD,
        "triangle = { active = { low = 0, phase = true }, period = 1, cycles = 1 }",
        [
            ("step.3.steps.1.triangle.active.high", None, "is missing, must be a number"),
            ("step.3.steps.1.triangle.active.phase", True, "must be a number"),
        ],
    ),
    (
        HOLD,
        "triangle = { active = 1, passive = { low = 0, high = 1 }, period = 1, cycles = 1 }",
        [("step.3.steps.1.triangle.active", 1, "must be a table of low, high, phase")],
    ),
    # what no field sees by itself
    (PASSIVE, ACTIVE, [("balloon.2.name", "active", "must be unique, balloon 1 has this name too")]),
    (
        PASSIVE,
        PASSIVE + "\nbreakdown = { field = 3 }",
        [("balloon.passive.breakdown", {"field": 3.0}, "needs electrodes = true on this balloon")],
    ),
    (
        "electrodes = true\nbreakdown = { field = 12.0 }",
        "",
        [
            ("step.2.ramp", 0.2, "needs a balloon with electrodes = true, there is none"),
            ("step.3.steps.2.steps.1.jump", 0.1, "needs a balloon with electrodes = true, there is none"),
        ],
    ),
    (
        "ramp = 0.2",
        "ramp = { passive = 0.1, third = 0.2, active = 0.3 }",
        [
            ("step.2.ramp.passive", 0.1, "has no electrodes, must be one of active"),
            ("step.2.ramp.third", 0.2, "no such balloon, must be one of active"),
        ],
    ),
    (
        "jump = 0.1",
        "jump = { passive = 1 }",
        [("step.3.steps.2.steps.1.jump.passive", 1.0, "has no electrodes, must be one of active")],
    ),
    ("ramp = 0.2", "ramp = {}", [("step.2.ramp", {}, f"must be {VOLTAGE}")]),
    ("ramp = 0.2", 'ramp = { active = "x" }', [("step.2.ramp.active", "x", "must be a number")]),
    ("ramp = 0.2", "ramp = { over = inf }", [("step.2.ramp.over", np.inf, "must be a finite number")]),
    (
        POINTS,
        "points = 3\nevery = 1",
        [("output", {"points": 3, "every": 1.0}, "must have points or every, not both")],
    ),
    (POINTS, "points = 5_000_000", [("output.points", 5_000_000, TOO_MANY)]),
    (POINTS, "every = 1e-7", [("output.every", 1e-7, TOO_MANY)]),
    ("cycle = 3", "cycle = 1_000_000", [("output.points", 101, TOO_MANY)]),
    ("cycle = 3", f"cycle = 1{'0' * 400}", [("output.points", 101, TOO_MANY)]),
    # several at once, in the order of the file
    (
        GAS,
        "pressure = 1",
        [
            ("gas.ambient_pressure", None, "is missing, must be a number >= 0"),
            ("gas.pressure", 1, f"unknown key, allowed here: {IN_GAS}"),
        ],
    ),
    (
        PASSIVE,
        'name = "active"\nradius = -1',
        [("balloon.2.radius", -1, "must be a number > 0")],
    ),
]


@pytest.mark.parametrize(
    ("old", "new", "expected"), REFUSED, ids=[new.replace("\n", " ; ") for _, new, _ in REFUSED]
)
def test_refusals_name_file_key_value_and_what_is_allowed(
    tmp_path: Path, old: str, new: str, expected: list[tuple[str, object, str]]
) -> None:
    assert old in VALID
    path = write(tmp_path, VALID.replace(old, new, 1))
    error = refusal(path)
    assert error.file == str(path)
    assert (error.key, error.value, error.allowed) == error.problems[0]
    assert [(key, allowed) for key, _, allowed in error.problems] == [
        (key, text) for key, _, text in expected
    ]
    for problem, (_, value, _) in zip(error.problems, expected, strict=True):
        assert value is ... or problem.value == value
    lines = str(error).splitlines()
    assert len(lines) == len(expected)
    for line, (key, value, text) in zip(lines, expected, strict=True):
        assert line.startswith(f"{path}: {key}" + (": " if value is None else " = "))
        assert line.endswith(f": {text}")


def test_the_line_of_an_error() -> None:
    negative = {"ambient_pressure": -1}
    assert str(refusal(minimal(gas=negative))) == "<dict>: gas.ambient_pressure = -1: must be a number >= 0"
    assert str(refusal(minimal(title=""))) == '<dict>: title = "": must be a non-empty text'
    assert "ambient_pressure = nan: " in str(refusal(minimal(gas={"ambient_pressure": float("nan")})))
    assert 'source = ["µ", true]: ' in str(refusal(minimal(source=["µ", True])))
    long = str(refusal(minimal(source=["long"] * 1000)))
    assert len(long) < 150
    assert "\n" not in long
    assert len(str(refusal(minimal(source=["a\n\u2028\x1b"]))).splitlines()) == 1
    assert str(refusal(minimal(**{"a\nb": 1}))).startswith("<dict>: a\\u000ab = 1: unknown key")


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"gas": 5}, "gas = 5: must be a table of ambient_pressure"),
        ({"balloon": {"name": "a"}}, 'balloon = {"name": "a"}: must be one or more [[balloon]] tables'),
        ({"balloon": []}, "balloon = []: must be one or more [[balloon]] tables"),
        ({"balloon": ["a"]}, 'balloon.1 = "a": must be a table of name, radius'),
        ({"step": {"hold": 1}}, 'step = {"hold": 1}: must be one or more [[step]] tables'),
        ({"step": []}, "step = []: must be one or more [[step]] tables"),
        ({"step": [None]}, f"step.1: must be a table with exactly one of {KINDS}"),
        ({"output": 3}, "output = 3: must be a table of points, every"),
        ({"solver": None}, "solver: must be a table of rtol"),
        ({"title": None}, "title: must be a non-empty text"),
        ({"gas": {"ambient_pressure": np.bool_(True)}}, "gas.ambient_pressure = true: must be a number >= 0"),
    ],
)
def test_wrong_shapes(changes: dict[str, object], expected: str) -> None:
    line = str(refusal(minimal(**changes)))
    assert line.startswith(f"<dict>: {expected}")
    assert "\n" not in line


def test_an_empty_scenario_misses_everything_required() -> None:
    assert [problem.key for problem in refusal({}).problems] == ["title", "gas", "balloon", "step"]


def test_nothing_of_pydantic_shows() -> None:
    for old, new, _ in REFUSED:
        try:
            data = tomllib.loads(VALID.replace(old, new, 1))
        except tomllib.TOMLDecodeError:  # pragma: no cover
            pytest.fail(new)
        error = refusal(data)
        assert error.__suppress_context__ or error.__context__ is None
        for word in ("pydantic", "http", "Input", "input_type", "type=", "refused", "tag"):
            assert word not in str(error)


def test_every_field_says_what_it_allows() -> None:
    models = [m for m in vars(room).values() if isinstance(m, type) and issubclass(m, BaseModel)]
    assert len(models) > 15
    for model in models:
        model.model_rebuild()  # those that name each other are complete once they are used
        for name, field in model.model_fields.items():
            assert field.description or name == "model", f"{model.__name__}.{name}"


# -- files ---------------------------------------------------------------------------------------------


def test_missing_file(tmp_path: Path) -> None:
    error = refusal(tmp_path / "none.toml")
    assert str(error) == f"{tmp_path / 'none.toml'}: cannot be read, no such file or directory"
    assert (error.key, error.value) == ("", None)


def test_directory(tmp_path: Path) -> None:
    assert str(refusal(str(tmp_path))) == f"{tmp_path}: cannot be read, is a directory"


def test_impossible_path() -> None:
    assert "null byte" in str(refusal("a\0b"))


def test_broken_toml_names_the_line(tmp_path: Path) -> None:
    path = write(tmp_path, 'title = "x"\n[gas\n')
    assert str(refusal(path)).startswith(f"{path}: must be TOML: ")
    assert "line 2" in str(refusal(path))


def test_not_utf8(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_bytes(b'title = "\xff"')
    assert str(refusal(path)) == f"{path}: must be text in UTF-8, byte 9 is not"


def test_byte_order_mark_is_no_obstacle(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_bytes(b"\xef\xbb\xbf" + VALID.encode())
    assert load_scenario(path).title == "A pair"


def test_bottomless_nesting() -> None:
    step: dict[str, object] = {"hold": 1}
    for _ in range(5000):
        step = {"cycle": 1, "steps": [step]}
    assert str(refusal(minimal(step=[step]))) == "<dict>: step: is nested too deeply"


def test_the_file_is_remembered_as_given(tmp_path: Path) -> None:
    path = write(tmp_path, VALID)
    assert load_scenario(path).file == load_scenario(str(path)).file == str(path)
    assert load_scenario(minimal()).file == "<dict>"


# -- what comes out ------------------------------------------------------------------------------------


def test_a_whole_scenario(tmp_path: Path) -> None:
    scenario = load_scenario(write(tmp_path, VALID))
    active, passive = scenario.balloons
    assert (active.radius, active.thickness, active.modulus, active.permittivity) == (0.5, 1, 1, 1)
    assert active.breakdown is not None
    assert active.breakdown.field == 12
    assert isinstance(active.elastomer, Gent)
    assert active.elastomer.J_lim == 100
    assert isinstance(passive.elastomer, NeoHookean)
    assert not passive.electrodes
    assert passive.breakdown is None
    assert scenario.electroded == ("active",)
    inflate, ramp, cycle = scenario.steps
    assert isinstance(inflate, Inflate)
    assert isinstance(ramp, Ramp)
    assert isinstance(cycle, Cycle)
    assert (inflate.inflate, inflate.over) == (2.4, 1)
    assert (ramp.ramp, ramp.over, ramp.valve) == (0.2, 10, "closed")
    assert scenario.solver.rtol == 1e-5


def test_defaults() -> None:
    scenario = load_scenario(minimal())
    assert scenario.source is None
    assert scenario.output.points == 101
    assert scenario.output.every is None
    assert scenario.solver.rtol == 1e-3
    assert isinstance(scenario.gas.ambient_pressure, float)


def test_every_kind_of_step() -> None:
    sine = {"mean": 0.1, "amplitude": -0.1, "period": 2, "cycles": 2.5}
    triangle = {"low": 0.2, "high": -0.4, "period": 4, "cycles": 0.25}
    steps = load_scenario(
        minimal(
            step=[
                {"inflate": 0},
                {"ramp": {"a": -0.2}, "valve": "open"},
                {"hold": 3},
                {"jump": 0},
                {"sine": sine},
                {"triangle": triangle, "valve": "open"},
            ]
        )
    ).steps
    assert [type(step) for step in steps] == [Inflate, Ramp, Hold, Jump, Sine, Triangle]
    assert [duration(step) for step in steps if not isinstance(step, Cycle)] == [1, 1, 3, 0, 5, 1]
    assert isinstance(steps[1], Ramp)
    assert steps[1].ramp == {"a": -0.2}
    assert steps[1].valve == "open"


def test_numpy_scalars_are_numbers() -> None:
    scenario = load_scenario(
        minimal(
            gas={"ambient_pressure": np.float32(0.5)},
            step=[
                {"inflate": np.int64(2)},
                {"ramp": {"a": np.float64(0.1)}},
                {"cycle": np.int64(2), "steps": [{"hold": 1}]},
            ],
        )
    )
    assert type(scenario.gas.ambient_pressure) is float
    json.dumps(scenario.to_dict())


def test_played_steps_unroll_nested_cycles() -> None:
    inner = {"cycle": 2, "steps": [{"ramp": 2}, {"hold": 1}]}
    scenario = load_scenario(
        minimal(step=[{"inflate": 1}, {"cycle": 3, "steps": [{"ramp": 1}, inner]}, {"jump": 0}])
    )
    played = [next(iter(type(step).model_fields)) for step in scenario.played_steps()]
    assert played == ["inflate", *(["ramp"] + ["ramp", "hold"] * 2) * 3, "jump"]
    assert list(scenario.played_steps()) == list(scenario.played_steps())


def test_played_steps_are_lazy() -> None:
    scenario = load_scenario(minimal(step=[{"cycle": 4_000_000, "steps": [{"jump": 1}]}]))
    assert len(list(itertools.islice(scenario.played_steps(), 5))) == 5


def test_scenarios_are_frozen() -> None:
    scenario = load_scenario(tomllib.loads(VALID))
    for part, name in [
        (scenario, "title"),
        (scenario.gas, "ambient_pressure"),
        (scenario.balloons[0], "radius"),
        (scenario.steps[0], "inflate"),
        (scenario.output, "points"),
        (scenario, "file"),
    ]:
        with pytest.raises(ValidationError):
            setattr(part, name, 3)


def test_equality_is_of_the_run_and_not_of_the_file(tmp_path: Path) -> None:
    data = tomllib.loads(VALID)
    one, other = load_scenario(write(tmp_path, VALID)), load_scenario(data)
    assert one == other
    assert hash(one) == hash(other)
    data["gas"]["ambient_pressure"] = 2
    assert load_scenario(data) != one
    assert one != "a scenario"


def test_pickles_and_copies(tmp_path: Path) -> None:
    write(tmp_path, "time,voltage\n0,0\n1,0.5\n", "w.csv")
    path = write(tmp_path, VALID.replace(HOLD, 'table = "w.csv"'))
    scenario = load_scenario(path)
    for twin in (pickle.loads(pickle.dumps(scenario)), copy.deepcopy(scenario)):
        assert twin == scenario
        assert twin.file == str(path)
        table = next(step for step in twin.played_steps() if isinstance(step, Table))
        assert not table.voltages.flags.writeable
    error = pickle.loads(pickle.dumps(refusal({})))
    assert str(error) == str(refusal({}))
    assert error.problems == refusal({}).problems


def test_errors_can_be_raised_by_others() -> None:
    error = ScenarioError("x.toml", Problem("step.1.hold", 3, "must rest"), Problem("", None, "is bad"))
    assert str(error) == "x.toml: step.1.hold = 3: must rest\nx.toml: is bad"
    assert isinstance(error, ValueError)


# -- round trips ---------------------------------------------------------------------------------------

positive = st.floats(min_value=1e-6, max_value=1e6) | st.integers(1, 10**6)
number = st.floats(-1e6, 1e6) | st.integers(-(10**6), 10**6)
valve = st.sampled_from(["closed", "open"])
text = st.text(min_size=1).filter(str.strip)
value = positive | st.dictionaries(st.just("a"), positive, min_size=1)
until = st.fixed_dictionaries(
    {}, optional={"event": st.just("limit_point"), "stretch": value, "pressure": positive, "field": value}
).filter(bool)
voltage = number | st.dictionaries(st.just("a"), number, min_size=1)
wave = {"period": positive, "cycles": st.floats(min_value=1e-6, max_value=2.0) | st.integers(1, 2)}
played = st.one_of(
    st.fixed_dictionaries({"inflate": st.floats(0, 1e6)}, optional={"over": positive}),
    st.fixed_dictionaries({"ramp": voltage}, optional={"over": positive, "until": until}),
    st.fixed_dictionaries({"ramp": voltage}, optional={"over": positive, "valve": valve}),
    st.fixed_dictionaries({"hold": positive}, optional={"valve": valve}),
    st.fixed_dictionaries({"jump": voltage}, optional={"valve": valve}),
    st.fixed_dictionaries(
        {"sine": st.fixed_dictionaries({"mean": number, "amplitude": number, **wave})},
        optional={"valve": st.just("closed"), "until": until},
    ),
    st.fixed_dictionaries(
        {
            "sine": st.fixed_dictionaries(
                {
                    "a": st.fixed_dictionaries(
                        {"mean": number, "amplitude": number}, optional={"phase": number}
                    ),
                    **wave,
                }
            )
        },
        optional={"valve": valve},
    ),
    st.fixed_dictionaries(
        {
            "triangle": st.fixed_dictionaries(
                {
                    "a": st.fixed_dictionaries({"low": number, "high": number}, optional={"phase": number}),
                    **wave,
                }
            )
        },
        optional={"valve": valve},
    ),
    st.fixed_dictionaries(
        {"triangle": st.fixed_dictionaries({"low": number, "high": number, **wave})},
        optional={"valve": st.just("closed"), "until": until},
    ),
)
step = st.recursive(
    played,
    lambda inner: st.fixed_dictionaries(
        {"cycle": st.integers(1, 9), "steps": st.lists(inner, min_size=1, max_size=3)}
    ),
    max_leaves=5,
)
ratios = dict.fromkeys(("radius", "thickness", "modulus", "permittivity"), positive)
elastomer = st.fixed_dictionaries({"model": st.just("gent"), "J_lim": positive}) | st.just(
    {"model": "neo-hookean"}
)
active = st.fixed_dictionaries(
    {"name": st.just("a"), "electrodes": st.just(True), "elastomer": elastomer},
    optional={
        **ratios,
        "breakdown": st.fixed_dictionaries({"field": positive}, optional={"law": st.just("constant")})
        | st.fixed_dictionaries(
            {
                "law": st.just("power"),
                "field": positive,
                "stretch_exponent": number,
                "thickness_exponent": number,
            }
        ),
    },
)
passive = st.fixed_dictionaries(
    {"name": st.sampled_from(["b", "β", "_b1"]), "elastomer": elastomer}, optional=ratios
)
scenarios = st.fixed_dictionaries(
    {
        "title": text,
        "gas": st.fixed_dictionaries({"ambient_pressure": st.floats(0, 1e6)}),
        "balloon": st.tuples(active, passive).map(list) | st.tuples(active).map(list),
        "step": st.lists(step, min_size=1, max_size=4),
    },
    optional={
        "source": text,
        "output": st.fixed_dictionaries({}, optional={"points": st.integers(2, 10)}),
        "solver": st.fixed_dictionaries({"rtol": st.floats(1e-12, 0.1)}),
    },
)


@given(scenarios)
def test_round_trip(data: dict[str, object]) -> None:
    scenario = load_scenario(data)
    back = scenario.to_dict()
    assert back == data  # what was written, no more and no less
    assert load_scenario(back) == scenario
    assert load_scenario(json.loads(json.dumps(back))) == scenario
    assert pickle.loads(pickle.dumps(scenario)) == scenario


json_like = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from([*TOP.split(", "), *KINDS.split(", "), "name", "model", "a", "\n"]),
            inner,
            max_size=4,
        )
    ),
    max_leaves=8,
)


@given(st.dictionaries(st.sampled_from(TOP.split(", ")), json_like), st.booleans())
def test_nonsense_is_refused_in_one_way(data: dict[str, object], complete: bool) -> None:
    error = None
    try:
        load_scenario({**minimal(), **data} if complete else data)
    except ScenarioError as caught:
        error = caught
    assert error is None or len(str(error).splitlines()) == len(error.problems)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_scenarios(path: Path) -> None:
    scenario = load_scenario(path)
    assert scenario.source
    assert load_scenario(scenario.to_dict()) == scenario


def test_all_figures_are_shipped() -> None:
    figures = [f"fig{figure}_state_{state}" for figure in ("3a", "3b", "3c", "5b", "5c") for state in "abc"]
    assert {"fig2_inflation", *figures} <= {path.stem for path in SHIPPED}


def test_the_example_of_the_reference_is_valid(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("left.csv").write_text("time,voltage\n0,0\n1,0.5\n")
    Path("rec.csv").write_text("Amplifier\ntime_s;CH1;CH2\n1,5;0;0\n2;0,5;0,1\n3;0;0\n")
    scales = {"shear_modulus": "45 kPa", "thickness": "0.5 mm", "radius": "20 mm", "permittivity": 4.7}
    page = (Path(__file__).parent.parent / "docs" / "scenario-format.md").read_text(encoding="utf-8")
    examples = [block.split("```")[0] for block in page.split("```toml\n")[1:]]
    assert load_scenario(tomllib.loads(examples[0])).electroded == ("active",)
    for example in examples[1:]:
        names = [
            {"name": name, "electrodes": True, "elastomer": {"model": "neo-hookean"}}
            for name in ("left", "right")
        ]
        load_scenario({**minimal(balloon=names, scales=scales), **tomllib.loads(example)})


# -- tables --------------------------------------------------------------------------------------------


def with_table(folder: Path, csv: str | bytes) -> Path:
    (folder / "w.csv").write_bytes(csv if isinstance(csv, bytes) else csv.encode())
    return write(folder, VALID.replace(HOLD, 'table = "w.csv"'))


@pytest.mark.parametrize(
    "csv",
    [
        "time,voltage\n0,0\n0.5,0.25\n2,-1\n",
        "voltage,time\n0,0\n0.25,0.5\n-1,2\n",
        " time , voltage \n 0 , 0 \n0.5,\t0.25\n2,-1e0",
        '"time","voltage"\r\n"0","0"\r\n0.5,0.25\r\n\r\n2,-1\r\n\r\n',
        "\ufefftime,voltage\n0,0\n0.5,0.25\n2,-1\n",
    ],
)
def test_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, csv: str) -> None:
    monkeypatch.chdir("/")
    scenario = load_scenario(with_table(tmp_path, csv))
    table = next(step for step in scenario.played_steps() if isinstance(step, Table))
    np.testing.assert_array_equal(table.times, [0, 0.5, 2])
    np.testing.assert_array_equal(table.voltages, [0, 0.25, -1])
    assert table.times.dtype == table.voltages.dtype == np.float64
    assert duration(table) == 2
    for column in (table.times, table.voltages):
        with pytest.raises(ValueError, match="read-only"):
            column[0] = 1
    # The dict knows the table wherever it is read from.
    assert table.table == str(tmp_path / "w.csv")
    assert load_scenario(scenario.to_dict()) == scenario


def test_a_table_of_a_dict_is_found_from_the_current_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, "time,voltage\n0,0\n1,1\n", "w.csv")
    monkeypatch.chdir(tmp_path)
    scenario = load_scenario(minimal(step=[{"table": "w.csv"}]))
    monkeypatch.chdir("/")
    assert load_scenario(scenario.to_dict()) == scenario


def test_scenarios_differ_when_their_tables_do(tmp_path: Path) -> None:
    one = load_scenario(with_table(tmp_path, "time,voltage\n0,0\n1,1\n"))
    assert load_scenario(with_table(tmp_path, "time,voltage\n0,0\n1,2\n")) != one


@pytest.mark.parametrize(
    ("csv", "expected"),
    [
        ("", "must have the header time,voltage, is empty"),
        ("\n\n", "must have the header time,voltage, is empty"),
        ("t,V\n0,0\n1,1\n", "must have the header time,voltage, has t,V"),
        ("0,0\n1,1\n", "must have the header time,voltage, has 0,0"),
        ("time,voltage,current\n0,0,0\n", "must have the header time,voltage, has time,voltage,current"),
        ("time;voltage\n0;0\n1;1\n", "must have the header time,voltage, has time;voltage"),
        ("time,time\n0,0\n1,1\n", "must have the header time,voltage, has time,time"),
        ("time,voltage\n", "must have at least two rows below the header, has 0"),
        ("time,voltage\n0,0\n", "must have at least two rows below the header, has 1"),
        ("time,voltage\n0,0\n1,abc\n", "row 3: must be two finite numbers, is 1,abc"),
        ("time,voltage\n0,0\n1,\n", "row 3: must be two finite numbers, is 1,"),
        ("time,voltage\n0,0\n\n1,2,3\n", "row 4: must be two finite numbers, is 1,2,3"),
        ("time,voltage\n0,0\n1\n", "row 3: must be two finite numbers, is 1"),
        ("time,voltage\n0,nan\n1,1\n", "row 2: must be two finite numbers, is 0,nan"),
        ("time,voltage\n0,0\n1,-inf\n", "row 3: must be two finite numbers, is 1,-inf"),
        ("time,voltage\n0,0\ninf,1\n", "row 3: must be two finite numbers, is inf,1"),
        ("time,voltage\n0.1,0\n1,1\n", "row 2: time must start at 0, is 0.1,0"),
        ("time,voltage\n-1,0\n1,1\n", "row 2: time must start at 0, is -1,0"),
        ("time,voltage\n0,0\n1,1\n1,2\n2,0\n", "row 4: time must increase, is 1,2"),
        ("voltage,time\n0,0\n5,2\n6,1\n", "row 4: time must increase, is 6,1"),
        (b"time,voltage\n\xff,0\n", "must be text in UTF-8, byte 13 is not"),
    ],
)
def test_tables_that_are_refused(tmp_path: Path, csv: str | bytes, expected: str) -> None:
    path = with_table(tmp_path, csv)
    assert str(refusal(path)) == f'{path}: step.3.steps.1.table = "w.csv": {expected}'


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ('"none.csv"', "cannot be read, no such file or directory"),
        ('"."', "cannot be read, is a directory"),
        ('""', "must be the path of a CSV file with columns time,voltage, or a table with its file"),
        ("3", "must be the path of a CSV file with columns time,voltage, or a table with its file"),
    ],
)
def test_tables_that_are_not_there(tmp_path: Path, value: str, expected: str) -> None:
    path = write(tmp_path, VALID.replace(HOLD, f"table = {value}"))
    assert str(refusal(path)) == f"{path}: step.3.steps.1.table = {value}: {expected}"


def test_a_table_needs_electrodes(tmp_path: Path) -> None:
    path = with_table(tmp_path, "time,voltage\n0,0\n1,1\n")
    text = path.read_text().replace("electrodes = true\nbreakdown = { field = 12.0 }\n", "")
    keys = [problem.key for problem in refusal(write(tmp_path, text)).problems]
    assert "step.3.steps.1.table" in keys


# -- speed ---------------------------------------------------------------------------------------------


def fastest(function, times: int) -> float:
    """The least seconds of this process: other processes of the machine do not count."""
    seconds = []
    for _ in range(times):
        start = time.process_time()
        function()
        seconds.append(time.process_time() - start)
    return min(seconds)


def test_loading_takes_no_time(tmp_path: Path) -> None:
    path = write(tmp_path, VALID)
    assert fastest(lambda: load_scenario(path), 20) < 2e-3


def test_large_tables_are_read_quickly(tmp_path: Path) -> None:
    rows = "\n".join(f"{k * 1e-3!r},{k % 7 / 7!r}" for k in range(100_000))
    path = with_table(tmp_path, f"time,voltage\n{rows}\n")
    assert fastest(lambda: load_scenario(path), 3) < 0.5
