"""Scenarios in units: what is read and refused, and that kilovolts in are kilovolts out."""

from __future__ import annotations

import copy
import json
import math
import pickle
from decimal import Decimal, localcontext
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, PlainSerializer, ValidationError

from simulator import units
from simulator.scenario import Problem, Scenario, ScenarioError, Table, dimension_of, load_scenario
from simulator.scenario.fields import ByName, Chosen, ElectricCharge, Frozen, Volume
from simulator.units import VACUUM_PERMITTIVITY, Dimension, Scales, as_written

GENT = {"model": "gent", "J_lim": 270}
REFERENCE = {"shear_modulus": "45 kPa", "thickness": "0.5 mm", "radius": "20 mm", "permittivity": 4.7}
PRESSURE = 45e3 * 0.5e-3 / 20e-3  # μH/R
FIELD = math.sqrt(45e3 / (4.7 * 8.8541878128e-12))  # √(μ/ε)
VOLTAGE = 0.5e-3 * FIELD


def written(**changes: object) -> dict[str, object]:
    return {
        "title": "t",
        "scales": REFERENCE,
        "gas": {"ambient_pressure": "101.325 kPa"},
        "balloon": [
            {"name": "a", "electrodes": True, "elastomer": GENT},
            {"name": "b", "radius": "60 mm", "thickness": "1.5 mm", "elastomer": GENT},
        ],
        "step": [{"inflate": "1.2 kPa"}, {"ramp": "5.5 kV", "over": "30 s"}],
        **changes,
    }


def with_step(step: dict[str, object], **changes: object) -> dict[str, object]:
    return written(step=[step], **changes)


def refusal(source: object) -> ScenarioError:
    with pytest.raises(ScenarioError) as caught:
        load_scenario(source)  # type: ignore[arg-type]
    return caught.value


def value_of(scenario: Scenario, key: str) -> float:
    """A number of a scenario by the names of its attributes."""
    here: object = scenario
    for part in key.split("."):
        if part.isdecimal():
            here = here[int(part)]  # type: ignore[index]
        else:
            here = here[part] if isinstance(here, dict) else getattr(here, part)
    return here  # type: ignore[return-value]


# -- scales ----------------------------------------------------------------------------------------------


def test_scales_are_those_of_the_model() -> None:
    """The film of docs/physics.md: 1 kPa, 7.1 kV, 35 MV/m."""
    scales = Scales(50e3, 0.2e-3, 10e-3, 4e-11 / VACUUM_PERMITTIVITY)
    assert scales.pressure == pytest.approx(1e3, rel=1e-15)
    assert scales.voltage == pytest.approx(7071.0678, rel=1e-8)
    assert scales.field == pytest.approx(35.355339e6, rel=1e-8)
    assert scales.charge == pytest.approx(4 * math.pi * 1e-4 * math.sqrt(4e-11 * 50e3), rel=1e-14)
    assert scales.volume == pytest.approx(4 * math.pi * 1e-6, rel=1e-15)
    assert scales.energy == pytest.approx(4 * math.pi * 1e-4 * 0.2e-3 * 50e3, rel=1e-15)


@given(*[st.floats(1e-6, 1e6)] * 4)
def test_scales_agree_with_each_other(modulus: float, thickness: float, radius: float, eps: float) -> None:
    scales = Scales(modulus, thickness, radius, eps)
    # Charge times voltage, pressure times volume and modulus times volume of the wall are energies.
    assert scales.charge * scales.voltage == pytest.approx(scales.energy, rel=1e-13)
    assert scales.pressure * scales.volume == pytest.approx(scales.energy, rel=1e-13)
    assert scales.field * thickness == pytest.approx(scales.voltage, rel=1e-13)
    # A sphere of the wall is a plate capacitor of area 4πR².
    capacitance = eps * VACUUM_PERMITTIVITY * 4 * math.pi * radius**2 / thickness
    assert scales.charge / scales.voltage == pytest.approx(capacitance, rel=1e-13)


# -- reading ---------------------------------------------------------------------------------------------

SINE = {"mean": "1 kV", "amplitude": "500 V", "period": "2 min", "cycles": 2}
TRIANGLE = {"low": "-1 kV", "high": "1 kV", "period": "250 ms", "cycles": 2}
BALLOON = {"name": "a", "electrodes": True, "elastomer": GENT}


@pytest.mark.parametrize(
    ("changes", "key", "expected"),
    [
        ({"gas": {"ambient_pressure": "1 atm"}}, "gas.ambient_pressure", 101325 / PRESSURE),
        ({"gas": {"ambient_pressure": "0 mbar"}}, "gas.ambient_pressure", 0),
        ({"balloon": [{**BALLOON, "radius": "1 cm"}]}, "balloons.0.radius", 0.5),
        ({"balloon": [{**BALLOON, "thickness": "250 µm"}]}, "balloons.0.thickness", 0.5),
        ({"balloon": [{**BALLOON, "modulus": "0.09 N/mm^2"}]}, "balloons.0.modulus", 2),
        ({"balloon": [{**BALLOON, "permittivity": 1.5}]}, "balloons.0.permittivity", 1.5),
        (
            {"balloon": [{**BALLOON, "permittivity": "40 pF/m"}]},
            "balloons.0.permittivity",
            40e-12 / (4.7 * 8.8541878128e-12),
        ),
        (
            {"balloon": [{**BALLOON, "breakdown": {"field": "250 V/µm"}}]},
            "balloons.0.breakdown.field",
            250e6 / FIELD,
        ),
        ({"step": [{"inflate": "20 mbar"}]}, "steps.0.inflate", 2e3 / PRESSURE),
        ({"step": [{"inflate": 1, "over": "1 h"}]}, "steps.0.over", 3600),
        ({"step": [{"ramp": "8kV"}]}, "steps.0.ramp", 8e3 / VOLTAGE),
        ({"step": [{"ramp": " -8.0e3  V "}]}, "steps.0.ramp", -8e3 / VOLTAGE),
        ({"step": [{"ramp": {"a": "8 kV"}}]}, "steps.0.ramp.a", 8e3 / VOLTAGE),
        ({"step": [{"jump": ".5 kilovolt"}]}, "steps.0.jump", 500 / VOLTAGE),
        ({"step": [{"hold": "5 s"}]}, "steps.0.hold", 5),
        ({"step": [{"sine": SINE}]}, "steps.0.sine.amplitude", 500 / VOLTAGE),
        ({"step": [{"sine": SINE}]}, "steps.0.sine.period", 120),
        ({"step": [{"triangle": TRIANGLE}]}, "steps.0.triangle.low", -1e3 / VOLTAGE),
        ({"step": [{"triangle": TRIANGLE}]}, "steps.0.triangle.period", 0.25),
        ({"step": [{"cycle": 2, "steps": [{"ramp": "1 kV"}]}]}, "steps.0.steps.0.ramp", 1e3 / VOLTAGE),
        ({"output": {"every": "0.1 s"}}, "output.every", 0.1),
        # Numbers are what they are without scales.
        ({"step": [{"inflate": 2, "over": 3}]}, "steps.0.inflate", 2),
        ({"step": [{"inflate": 2, "over": 3}]}, "steps.0.over", 3),
        # The permittivity of the reference may have a unit too.
        (
            {"scales": {**REFERENCE, "permittivity": "41.61468272016 pF/m"}, "step": [{"ramp": "8 kV"}]},
            "steps.0.ramp",
            8e3 / VOLTAGE,
        ),
    ],
)
def test_texts_with_units_are_dimensionless_numbers(
    changes: dict[str, object], key: str, expected: float
) -> None:
    data = written(**changes)
    scenario = load_scenario(data)
    assert value_of(scenario, key) == pytest.approx(expected, rel=4e-16)
    assert scenario.to_dict() == data
    assert load_scenario(scenario.to_dict()) == scenario


def test_the_reference_balloon_has_ratios_of_exactly_one() -> None:
    data = written(balloon=[{**BALLOON, "radius": "2 cm", "thickness": "500 um", "modulus": "0.045 MPa"}])
    balloon = load_scenario(data).balloons[0]
    assert (balloon.radius, balloon.thickness, balloon.modulus) == (1.0, 1.0, 1.0)


def test_balloons_written_alike_in_two_ways_are_alike() -> None:
    """The quotient of the two texts in float arithmetic is 0.7494000000000001."""
    scales = Scales(199405.3396075284, 0.4479e-3, 41.10695254341851e-3, 5.257)
    assert units.read("0.33565626 mm", units.THICKNESS, scales) == 0.7494


@pytest.mark.parametrize(
    ("key", "name"),
    [
        ("gas.ambient_pressure", "pressure"),
        ("step.1.inflate", "pressure"),
        ("step.2.over", "time"),
        ("balloon.b.radius", "radius"),
        ("balloon.*.thickness", "thickness"),
        ("balloon.a.modulus", "shear_modulus"),
        ("balloon.2.permittivity", "absolute_permittivity"),
        ("balloon.a.elastomer.J_lim", None),
        ("output.points", None),
    ],
)
def test_fields_say_what_they_measure(key: str, name: str | None) -> None:
    found = dimension_of(load_scenario(written()), key)
    assert (found and found.scale) == name


class Vessel(Frozen):
    """As a new table would be written."""

    chamber: Volume = 0.0
    charge: Annotated[
        float | dict[str, float],
        Chosen(ByName(ElectricCharge)),
        PlainSerializer(as_written),
        Field(description="a number, or a table of numbers"),
    ] = 0.0


def test_a_new_field_declares_its_dimension_and_no_more() -> None:
    scales = load_scenario(written()).scales
    assert scales is not None
    data = {"chamber": "0.5 l", "charge": {"a": "2 uC"}}
    vessel = Vessel.model_validate(data, context={"scales": scales})
    assert vessel.chamber == pytest.approx(0.5e-3 / (4 * math.pi * 20e-3**3), rel=1e-15)
    charge = 4 * math.pi * 20e-3**2 * math.sqrt(4.7 * 8.8541878128e-12 * 45e3)
    assert vessel.charge == pytest.approx({"a": 2e-6 / charge}, rel=1e-15)
    assert vessel.model_dump(mode="json") == data
    with pytest.raises(ValidationError) as caught:
        Vessel.model_validate({"chamber": "1 m", "charge": "1 V"}, context={"scales": scales})
    assert [(error["loc"], error["msg"]) for error in caught.value.errors()] == [
        (("chamber",), 'must be a volume >= 0 such as "0.5 l"'),
        (("charge",), 'must be a charge such as "1 µC"'),
    ]


# -- what is refused -------------------------------------------------------------------------------------


def line(key: str, value: str, allowed: str) -> str:
    return f"<dict>: {key} = {value}: must be {allowed}"


@pytest.mark.parametrize(
    ("step", "expected"),
    [
        # a wrong dimension
        ({"ramp": "8 kPa"}, line("step.1.ramp", '"8 kPa"', 'a voltage such as "8 kV"')),
        ({"ramp": {"a": "8 s"}}, line("step.1.ramp.a", '"8 s"', 'a voltage such as "8 kV"')),
        ({"jump": "8 kV/m"}, line("step.1.jump", '"8 kV/m"', 'a voltage such as "8 kV"')),
        ({"hold": "5 m"}, line("step.1.hold", '"5 m"', 'a time > 0 such as "30 s"')),
        ({"inflate": "2 kV"}, line("step.1.inflate", '"2 kV"', 'a pressure >= 0 such as "2 kPa"')),
        ({"hold": "20 degC"}, line("step.1.hold", '"20 degC"', 'a time > 0 such as "30 s"')),
        ({"hold": "20 dB"}, line("step.1.hold", '"20 dB"', 'a time > 0 such as "30 s"')),
        # an unknown unit
        (
            {"ramp": "8 kv"},
            line("step.1.ramp", '"8 kv"', 'a voltage such as "8 kV"; the unit kv is not known'),
        ),
        (
            {"hold": "1 fortnite"},
            line("step.1.hold", '"1 fortnite"', 'a time > 0 such as "30 s"; the unit fortnite is not known'),
        ),
        # no unit, no number
        ({"ramp": "8"}, line("step.1.ramp", '"8"', 'a voltage such as "8 kV"')),
        ({"ramp": "1e3"}, line("step.1.ramp", '"1e3"', 'a voltage such as "8 kV"')),
        ({"ramp": "kV"}, line("step.1.ramp", '"kV"', 'a voltage such as "8 kV"')),
        ({"ramp": "8,5 kV"}, line("step.1.ramp", '"8,5 kV"', 'a voltage such as "8 kV"')),
        ({"ramp": "nan V"}, line("step.1.ramp", '"nan V"', 'a voltage such as "8 kV"')),
        ({"ramp": ""}, line("step.1.ramp", '""', 'a voltage such as "8 kV"')),
        (
            {"ramp": True},
            line("step.1.ramp", "true", "a number, or a table of one or more numbers by balloon name"),
        ),
        # arithmetic, which would take for ever
        ({"ramp": "9**9**9**9 V"}, line("step.1.ramp", '"9**9**9**9 V"', 'a voltage such as "8 kV"')),
        ({"ramp": "1 V**9**9**9"}, line("step.1.ramp", '"1 V**9**9**9"', 'a voltage such as "8 kV"')),
        # out of range
        ({"hold": "0 s"}, line("step.1.hold", '"0 s"', 'a time > 0 such as "30 s"')),
        ({"inflate": "-1 Pa"}, line("step.1.inflate", '"-1 Pa"', 'a pressure >= 0 such as "2 kPa"')),
        ({"ramp": "1e400 V"}, line("step.1.ramp", '"1e400 V"', 'a voltage such as "8 kV"; it is too large')),
        # where no unit belongs
        ({"sine": {**SINE, "cycles": "2 s"}}, line("step.1.sine.cycles", '"2 s"', "a number > 0")),
        ({"cycle": "2 s", "steps": [{"hold": 1}]}, line("step.1.cycle", '"2 s"', "a whole number >= 1")),
    ],
)
def test_refusals_say_what_would_be_allowed(step: dict[str, object], expected: str) -> None:
    assert str(refusal(with_step(step))) == expected


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (
            {"gas": {"ambient_pressure": "1 kV"}},
            line("gas.ambient_pressure", '"1 kV"', 'a pressure >= 0 such as "2 kPa"'),
        ),
        (
            {"balloon": [{**BALLOON, "radius": "1 kg"}]},
            line("balloon.a.radius", '"1 kg"', 'a length > 0 such as "20 mm"'),
        ),
        (
            {"balloon": [{**BALLOON, "thickness": "1 s"}]},
            line("balloon.a.thickness", '"1 s"', 'a length > 0 such as "0.5 mm"'),
        ),
        (
            {"balloon": [{**BALLOON, "modulus": "1 N"}]},
            line("balloon.a.modulus", '"1 N"', 'a modulus > 0 such as "45 kPa"'),
        ),
        (
            {"balloon": [{**BALLOON, "permittivity": "1 pF"}]},
            line("balloon.a.permittivity", '"1 pF"', 'a permittivity > 0 such as "41.6 pF/m"'),
        ),
        (
            {"balloon": [{**BALLOON, "breakdown": {"field": "9 kV"}}]},
            line("balloon.a.breakdown.field", '"9 kV"', 'an electric field > 0 such as "250 MV/m"'),
        ),
        ({"output": {"every": "1 V"}}, line("output.every", '"1 V"', 'a time > 0 such as "30 s"')),
    ],
)
def test_every_field_names_its_own_dimension(changes: dict[str, object], expected: str) -> None:
    assert str(refusal(written(**changes))) == expected


def test_units_need_scales() -> None:
    data = written(step=[{"ramp": "8 kV", "over": "1 s"}, {"jump": {"a": "1 V"}}, {"hold": "long"}])
    del data["scales"]
    assert refusal(data).problems == (
        Problem("gas.ambient_pressure", "101.325 kPa", "must be a number >= 0; a unit needs [scales]"),
        Problem("balloon.b.radius", "60 mm", "must be a number > 0; a unit needs [scales]"),
        Problem("balloon.b.thickness", "1.5 mm", "must be a number > 0; a unit needs [scales]"),
        Problem(
            "step.1.ramp",
            "8 kV",
            "must be a number, or a table of one or more numbers by balloon name; a unit needs [scales]",
        ),
        Problem("step.1.over", "1 s", "must be a number > 0; a unit needs [scales]"),
        Problem("step.2.jump.a", "1 V", "must be a number; a unit needs [scales]"),
        Problem("step.3.hold", "long", "must be a number > 0"),
    )


RELATIVE = 'a relative permittivity > 0 such as 4.7, or one such as "41.6 pF/m"'


@pytest.mark.parametrize(
    ("scales", "expected"),
    [
        ({"shear_modulus": 45e3}, line("scales.shear_modulus", "45000.0", 'a modulus > 0 such as "45 kPa"')),
        (
            {"shear_modulus": "45 KPa"},
            line(
                "scales.shear_modulus",
                '"45 KPa"',
                'a modulus > 0 such as "45 kPa"; the unit KPa is not known',
            ),
        ),
        ({"thickness": "-1 mm"}, line("scales.thickness", '"-1 mm"', 'a length > 0 such as "0.5 mm"')),
        ({"radius": "20 kPa"}, line("scales.radius", '"20 kPa"', 'a length > 0 such as "20 mm"')),
        ({"permittivity": 0}, line("scales.permittivity", "0", RELATIVE)),
        ({"permittivity": "4.7"}, line("scales.permittivity", '"4.7"', RELATIVE)),
        ({"permittivity": "4.7 F"}, line("scales.permittivity", '"4.7 F"', RELATIVE)),
        (
            {"mu": 1},
            f"<dict>: scales.mu = 1: unknown key, allowed here: {', '.join(REFERENCE)}",
        ),
    ],
)
def test_wrong_scales(scales: dict[str, object], expected: str) -> None:
    """And nothing else is wrong then: texts with units stay what they are."""
    assert str(refusal(written(scales={**REFERENCE, **scales}))) == expected


def test_missing_scales_are_named() -> None:
    assert str(refusal(written(scales={"radius": "1 m"}))).splitlines() == [
        '<dict>: scales.shear_modulus: is missing, must be a modulus > 0 such as "45 kPa"',
        '<dict>: scales.thickness: is missing, must be a length > 0 such as "0.5 mm"',
        f"<dict>: scales.permittivity: is missing, must be {RELATIVE}",
    ]
    table = "a table of shear_modulus, thickness, radius, permittivity"
    assert str(refusal(written(scales="SI"))) == line("scales", '"SI"', table)


@pytest.mark.parametrize("size", ["1e-200 m", "1e200 m"])
def test_scales_that_no_number_can_hold(size: str) -> None:
    allowed = 'must be a length > 0 such as "20 mm"; in numbers it must be a number from 1e-30 to 1e30'
    expected = f'<dict>: scales.radius = "{size}": {allowed}'
    assert str(refusal(written(scales={**REFERENCE, "radius": size}, balloon=[BALLOON]))) == expected


def test_disagreements_show_what_was_written() -> None:
    balloons = [{"name": "a", "breakdown": {"field": "9 MV/m"}, "elastomer": GENT}, BALLOON | {"name": "b"}]
    data = written(
        balloon=balloons,
        step=[{"ramp": {"c": "1 kV"}}, {"hold": "1e9 s"}],
        output={"every": "1 ms"},
    )
    assert [(problem.key, problem.value) for problem in refusal(data).problems] == [
        ("balloon.a.breakdown", {"field": "9 MV/m"}),
        ("step.1.ramp.c", "1 kV"),
        ("output.every", "1 ms"),
    ]


# -- tables ----------------------------------------------------------------------------------------------


def table(folder: Path, csv: str, **changes: object) -> dict[str, object]:
    (folder / "w.csv").write_text(csv, encoding="utf-8")
    return with_step({"table": str(folder / "w.csv")}, **changes)


@pytest.mark.parametrize(
    "csv",
    [
        "time [s],voltage [kV]\n0,0\n60,8\n",
        "time[min],voltage [V]\n0,0\n1,8000\n",
        '"voltage [kV]" , "time"\n0,0\n8,60\n',
    ],
)
def test_tables_with_units(tmp_path: Path, csv: str) -> None:
    scenario = load_scenario(table(tmp_path, csv))
    (step,) = scenario.played_steps()
    assert isinstance(step, Table)
    assert step.times == pytest.approx([0, 60], rel=1e-15)
    assert step.voltages == pytest.approx([0, 8e3 / VOLTAGE], rel=1e-15)
    assert load_scenario(scenario.to_dict()) == scenario


def test_tables_without_units_stay_dimensionless(tmp_path: Path) -> None:
    (step,) = load_scenario(table(tmp_path, "time,voltage\n0,0\n2,0.3\n")).played_steps()
    assert isinstance(step, Table)
    np.testing.assert_array_equal(step.voltages, [0, 0.3])


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("time [s],voltage [kPa]", "header voltage [kPa]: must have a unit of voltage such as [kV]"),
        ("time [V],voltage [kV]", "header time [V]: must have a unit of time such as [s]"),
        (
            "time,voltage [kv]",
            "header voltage [kv]: must have a unit of voltage such as [kV]; the unit kv is not known",
        ),
        ("time,voltage []", "header voltage []: must have a unit of voltage such as [kV]"),
        (
            "time (s),voltage",
            "must have the header time,voltage or, with units, time [s],voltage [kV], has time (s),voltage",
        ),
    ],
)
def test_headers_that_are_refused(tmp_path: Path, header: str, expected: str) -> None:
    data = table(tmp_path, f"{header}\n0,0\n1,1\n")
    assert refusal(data).allowed == expected


def test_headers_with_units_need_scales(tmp_path: Path) -> None:
    data = table(tmp_path, "time,voltage [kV]\n0,0\n1,1\n", gas={"ambient_pressure": 1}, balloon=[BALLOON])
    del data["scales"]
    assert refusal(data).allowed == "header voltage [kV]: a unit needs [scales]"


# -- round trips -----------------------------------------------------------------------------------------

PREFIXES = {"": 0, "k": 3, "M": 6, "m": -3, "u": -6, "µ": -6, "n": -9, "kilo": 3, "milli": -3}
numbers = st.decimals(-(10**6), 10**6, places=6, allow_nan=False).map(lambda d: d.normalize())
sizes = st.floats(1e-3, 1e3)
references = st.builds(
    lambda modulus, thickness, radius, permittivity: {
        "shear_modulus": f"{modulus!r} kPa",
        "thickness": f"{thickness!r} mm",
        "radius": f"{radius!r} cm",
        "permittivity": permittivity,
    },
    *[sizes] * 4,
)
kinds = st.sampled_from([units.VOLTAGE, units.PRESSURE, units.TIME, units.RADIUS, units.FIELD, units.CHARGE])


@given(numbers, st.sampled_from(list(PREFIXES)), kinds, st.tuples(*[sizes] * 4))
def test_prefixes_change_nothing(
    number: Decimal, prefix: str, kind: Dimension, reference: tuple[float, float, float, float]
) -> None:
    """To the last bit: "8 kV" is "8000 V" is "8e3 V"."""
    scales = Scales(*reference)
    symbols = {"V": "volt", "Pa": "pascal", "s": "second", "m": "meter", "V/m": "V/m", "C": "coulomb"}
    unit = f"{prefix}{symbols[kind.unit] if len(prefix) > 1 else kind.unit}"
    with localcontext(prec=60):
        plain = number.scaleb(PREFIXES[prefix])
    expected = units.read(f"{plain:f} {kind.unit}", kind, scales)
    assert units.read(f"{number:f} {unit}", kind, scales) == expected
    assert units.read(f"{number:e}{unit}", kind, scales) == expected
    exact = float(plain) / scales.of(kind)
    assert expected == (pytest.approx(exact, rel=5e-15) if kind is units.RADIUS else exact)


@given(references, st.tuples(*[sizes] * 6))
def test_any_scenario_and_its_dimensionless_twin(
    reference: dict[str, object], numbers: tuple[float, ...]
) -> None:
    """SI texts made from dimensionless numbers by the formulas of the model come back as these."""
    ambient, inflation, voltage, radius, field, time = numbers
    modulus, thickness, length = (
        float(str(reference[name]).split()[0]) * size
        for name, size in (("shear_modulus", 1e3), ("thickness", 1e-3), ("radius", 1e-2))
    )
    strength = math.sqrt(modulus / (float(str(reference["permittivity"])) * VACUUM_PERMITTIVITY))
    pascal = modulus * thickness / length
    data = written(
        scales=reference,
        gas={"ambient_pressure": f"{ambient * pascal!r} Pa"},
        balloon=[
            {
                **BALLOON,
                "radius": f"{radius * length!r} m",
                "breakdown": {"field": f"{field * strength!r} V/m"},
            }
        ],
        step=[
            {"inflate": f"{inflation * pascal / 1e3!r} kPa", "over": f"{time!r} s"},
            {"ramp": f"{voltage * thickness * strength / 1e3!r} kV"},
        ],
    )
    scenario = load_scenario(data)
    for key, expected in (
        ("gas.ambient_pressure", ambient),
        ("balloons.0.radius", radius),
        ("balloons.0.breakdown.field", field),
        ("steps.0.inflate", inflation),
        ("steps.0.over", time),
        ("steps.1.ramp", voltage),
    ):
        assert value_of(scenario, key) == pytest.approx(expected, rel=1e-14)
    assert scenario.to_dict() == data
    assert load_scenario(json.loads(json.dumps(scenario.to_dict()))) == scenario


def test_copies_and_pickles_remember_what_was_written() -> None:
    data = written(step=[{"ramp": {"a": "8 kV"}}, {"sine": SINE}])
    scenario = load_scenario(data)
    for twin in (pickle.loads(pickle.dumps(scenario)), copy.deepcopy(scenario)):
        assert twin == scenario
        assert twin.to_dict() == data
        assert twin.scales == scenario.scales


def test_scenarios_are_equal_when_they_ask_for_the_same_run() -> None:
    assert load_scenario(with_step({"ramp": "8 kV"})) == load_scenario(with_step({"ramp": "8000 V"}))
    assert load_scenario(with_step({"ramp": "8 kV"})) != load_scenario(with_step({"ramp": "9 kV"}))
    other = {**REFERENCE, "permittivity": 4.6}
    assert load_scenario(with_step({"ramp": 0.1})) != load_scenario(with_step({"ramp": 0.1}, scales=other))


def test_a_written_number_is_a_number() -> None:
    ramp = load_scenario(with_step({"ramp": "8 kV"})).steps[0].ramp  # type: ignore[union-attr]
    assert isinstance(ramp, float)
    assert type(ramp + 0.0) is float
    assert repr(ramp) == f"{ramp}" == repr(float(ramp))
    assert as_written({"a": ramp, "b": 1.0}) == {"a": "8 kV", "b": 1.0}
