"""Units of sweeps and optima: a header for every unit, and the numbers of a twin without units."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from simulator import load_scenario, load_sweep, load_table, optimize, read_question, simulate
from simulator.analysis.sensitivity import sensitivities
from simulator.scenario import ScenarioError
from simulator.scenario.dimensions import bare_numbers
from simulator.sweep import read_sweep, run_sweep
from simulator.sweep.measures import quantity
from simulator.sweep.rows import columns
from simulator.units import Scales
from tests.sweeps import Here, balloons

VHB = Path(__file__).parent.parent / "scenarios" / "vhb_snap.toml"
SCALES = Scales(45e3, 0.5e-3, 20e-3, 4.7)
UNITS = {"shear_modulus": "45 kPa", "thickness": "0.5 mm", "radius": "20 mm", "permittivity": 4.7}
GENT = {"model": "gent", "J_lim": 270}
AMBIENT, INFLATIONS, RAMPS = 101.325e3, np.linspace(1.1e3, 1.2e3, 4), np.linspace(3e3, 5.5e3, 8)
# Columns of numbers that have no unit: pure numbers, and what belongs to the sweep itself.
PURE = re.compile(
    r"(landing|sealed|largest|residual)_stretch_\w+|least_sphericity_\w+|energy_imbalance|seconds"
    r"|run|limit_points|branch_points|inflation_snaps|.*J_lim"
)


def snap(*, with_units: bool) -> dict[str, object]:
    """The device of vhb_snap, in units, or as multiples of its scales."""
    sizes = {"radius": "60 mm", "thickness": "1.5 mm"} if with_units else {"radius": 3, "thickness": 3}
    return {
        "title": "twins",
        **({"scales": UNITS} if with_units else {}),
        "gas": {"ambient_pressure": "101.325 kPa" if with_units else AMBIENT / SCALES.pressure},
        "balloon": [
            {"name": "active", "electrodes": True, "elastomer": GENT},
            {"name": "passive", "elastomer": GENT, **sizes},
        ],
        "step": [
            {"inflate": "1.2 kPa" if with_units else 1.2e3 / SCALES.pressure},
            {"ramp": "5.5 kV" if with_units else 5.5e3 / SCALES.voltage},
            {"ramp": 0},
        ],
        "output": {"points": 2},
    }


@pytest.fixture(scope="module")
def twins(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Sweeps of the two, which are played in lockstep."""
    folder = tmp_path_factory.mktemp("twins")
    inflations = [f"{p / 1e3!r} kPa" for p in INFLATIONS.tolist()]
    vary = {"step.1.inflate": inflations, "step.2.ramp": {"from": "3 kV", "to": "5.5 kV", "points": 8}}
    run_sweep(
        read_sweep({"scenario": snap(with_units=True), "vary": vary}),
        folder / "si",
        executor=Here(),
        chunk=32,
    )
    bare = {
        "step.1.inflate": (INFLATIONS / SCALES.pressure).tolist(),
        "step.2.ramp": (RAMPS / SCALES.voltage).tolist(),
    }
    run_sweep(
        read_sweep({"scenario": snap(with_units=False), "vary": bare}),
        folder / "bare",
        executor=Here(),
        chunk=32,
    )
    return folder / "si", folder / "bare"


def test_every_header_has_its_unit(twins):
    with open(twins[0] / "sweep.csv", newline="") as stream:
        header = next(csv.reader(stream))
    assert {"step.1.inflate [kPa]", "step.2.ramp [kV]", "limit_point_1_voltage_active [V]"} <= set(header)
    assert {"landing_pressure [Pa]", "largest_field_active [V/m]", "loop_work [J]", "dissipated [J]"} <= set(
        header
    )
    kinds = columns(read_sweep({"scenario": snap(with_units=True), "vary": {"step.2.ramp": ["3 kV"]}}).job)
    numbers = [name for name, kind in kinds.items() if kind in ("number", "whole")]
    titled = {title.partition(" [")[0] for title in header if " [" in title}
    assert [name for name in numbers if name not in titled and not PURE.fullmatch(name)] == []
    assert header == load_table(twins[0]).columns.tolist()


def test_without_scales_nothing_has_a_unit(twins):
    assert not any("[" in title for title in load_table(twins[1]).columns)
    assert not any(variable.attrs for variable in load_sweep(twins[1]).variables.values())


def test_a_sweep_in_units_and_its_twin_have_the_same_numbers(twins):
    si, bare = (load_sweep(folder) for folder in twins)
    assert set(si["way"].values.ravel()) == {"lockstep"}
    assert {"snap_returns", "continuous"} == set(si["behaviour"].values.ravel())
    factors = {"V": SCALES.voltage, "Pa": SCALES.pressure, "V/m": SCALES.field, "J": SCALES.energy}
    compared = set()
    for name, variable in bare.data_vars.items():
        if name in ("seconds", "energy_imbalance", "error"):
            continue
        unit = si[name].attrs.get("units", "")
        found = si[name].values
        if variable.dtype.kind == "f":
            np.testing.assert_allclose(
                found / factors.get(unit, 1.0), variable.values, rtol=1e-12, atol=1e-12
            )
            compared.add(unit)
        else:
            np.testing.assert_array_equal(found, variable.values)
    assert compared == {*factors, ""}
    assert si["step.1.inflate"].attrs["units"] == "kPa"
    np.testing.assert_allclose(si["step.1.inflate"].values * 1e3, INFLATIONS, rtol=1e-15)


def test_numbers_without_a_unit_say_what_they_are_multiples_of(tmp_path):
    vary = {"step.1.inflate": [1.0], "balloon.passive.radius": [3.0], "balloon.*.elastomer.J_lim": [270.0]}
    run_sweep(read_sweep({"scenario": snap(with_units=True), "vary": vary}), tmp_path / "a", executor=Here())
    titles = load_table(tmp_path / "a").columns
    assert {"step.1.inflate [μH/R]", "balloon.passive.radius [R]", "balloon.*.elastomer.J_lim"} <= set(titles)


def test_each_run_has_the_scales_of_its_own(tmp_path):
    """A film twice as thick, all else in proportion to it, snaps at twice the voltage."""
    device = {**snap(with_units=True), "gas": {"ambient_pressure": 90.0}}
    device["balloon"] = [device["balloon"][0], {**device["balloon"][1], "thickness": 3.0}]
    device["step"] = [{"inflate": 1.05}, {"ramp": 0.33}]
    vary = {"scales.thickness": ["0.5 mm", "1 mm"]}
    run_sweep(read_sweep({"scenario": device, "vary": vary}), tmp_path / "a", executor=Here())
    table = load_table(tmp_path / "a")
    thin, thick = table["limit_point_1_voltage_active [V]"]
    assert thick == pytest.approx(2.0 * thin, rel=1e-12)
    assert table["largest_field_active [V/m]"].nunique() == 1
    thin, thick = table["landing_pressure [Pa]"]
    assert thick == pytest.approx(2.0 * thin, rel=1e-12)


def test_values_in_several_units_are_refused():
    vary = {"step.1.inflate": ["1 kPa", "1100 Pa"]}
    with pytest.raises(ScenarioError, match=r"must be all in one unit"):
        read_sweep({"scenario": snap(with_units=True), "vary": vary})


def question(**where: object) -> dict[str, object]:
    return {
        "scenario": snap(with_units=True),
        "maximize": "largest_field_active",
        "vary": {"step.2.ramp": {"from": "3 kV", "to": "5.5 kV"}},
        "where": where,
        "search": {"population": 4, "generations": 2},
    }


def test_conditions_are_texts_with_units(tmp_path):
    above = {"above": 1.0}
    asked = read_question(
        question(largest_field_active={"below": "16.5 MV/m"}, residual_stretch_active=above)
    )
    best = optimize(asked)
    assert best.row is not None
    assert 15e6 < best.value == best.row["largest_field_active"] <= 16.5e6
    voltage = f"{best.row['step.2.ramp']!r} kV"
    history = simulate(load_scenario(snap(with_units=True)).with_values({"step.2.ramp": voltage}))
    assert best.value == pytest.approx(history.field.max() * SCALES.field, rel=1e-9)
    titles = best.to_csv(tmp_path)[0].read_text().splitlines()[0].split(",")
    assert {"step.2.ramp [kV]", "largest_field_active [V/m]"} <= set(titles)


@pytest.mark.parametrize(
    ("where", "told"),
    [
        ({"largest_field_active": {"below": 1.5}}, 'such as "250 MV/m": with [scales] the column has a unit'),
        ({"largest_field_active": {"below": "2 kV"}}, 'must be an electric field such as "250 MV/m"'),
        ({"largest_field_active": {"below": "2 MX/m"}}, "the unit MX/m is not known"),
        ({"largest_stretch_active": {"below": "2 kV"}}, "must be a number without a unit"),
        ({"step.2.ramp": {"below": "400 V"}}, "must be in the unit that is varied, kV"),
        ({"loop_work": {"below": "much"}}, 'must be a number, or with [scales] a text such as "218 MV/m"'),
    ],
)
def test_conditions_refused(where, told):
    with pytest.raises(ScenarioError) as caught:
        read_question(question(**where))
    assert told in str(caught.value)


def test_the_optimum_is_told_in_units(tmp_path):
    best = tmp_path / "best.toml"
    best.write_text(
        f'scenario = "{VHB}"\nmaximize = "largest_field_active"\n'
        '[vary]\n"step.2.ramp" = { from = "3 kV", to = "4 kV" }\n'
        '[where]\nlargest_field_active = { below = "218 MV/m" }\n[search]\npopulation = 2\ngenerations = 1\n'
    )
    said = balloons("optimize", best, "--out", tmp_path / "out").stdout
    assert re.search(r"largest  largest_field_active = \d+\.\d+ MV/m\n", said)
    assert re.search(r"at       step\.2\.ramp = 3\.\d+ kV\n", said)


def test_sensitivities_are_those_of_the_twin_in_units():
    one, other = (simulate(load_scenario(snap(with_units=flag))) for flag in (True, False))
    keys = [
        "step.1.inflate",
        "balloon.passive.radius",
        "balloon.active.modulus",
        "balloon.active.elastomer.J_lim",
    ]
    units = dict(zip(keys, ("V/kPa", "V/mm", "V/μ", "V"), strict=True))
    sizes = {"V/kPa": 1e3 / SCALES.pressure, "V/mm": 1e-3 / SCALES.radius, "V/μ": 1.0, "V": 1.0}
    found = sensitivities(one, one.mechanical[0], keys)
    for here, there in zip(found, sensitivities(other, other.mechanical[0], keys), strict=True):
        assert here.derivative_unit == units[here.key]
        size = SCALES.voltage * sizes[here.derivative_unit]
        assert here.derivative == pytest.approx(there.derivative * size, rel=1e-7)
        assert (here.value, here.unit) == (pytest.approx(there.value * SCALES.voltage, rel=1e-12), "V")


def test_every_column_of_results_is_known_to_have_a_unit_or_none():
    asked = {"limit_points": 1, "shapes": True}
    sweep = read_sweep(
        {"scenario": snap(with_units=True), "vary": {"step.2.ramp": ["3 kV"]}, "record": asked}
    )
    for name, kind in columns(sweep.job).items():
        assert kind in ("text", "truth") or quantity(name) or PURE.fullmatch(name) or name == "step.2.ramp", (
            name
        )


def test_bare_numbers_by_key(tmp_path):
    scenario = load_scenario(snap(with_units=True))
    assert bare_numbers(scenario) == ()
    (tmp_path / "bare.csv").write_text("time,voltage\n0,0\n1,-0.25\n2,0\n")
    (tmp_path / "kv.csv").write_text("time,voltage [kV]\n0,0\n1,1\n")
    steps = [
        {"inflate": "1.2 kPa", "over": 4},
        {"ramp": {"active": 0.3}, "until": {"field": 1.5, "stretch": 3}},
        {"cycle": 2, "steps": [{"sine": {"mean": 0, "amplitude": 0.1, "period": 1, "cycles": 1}}]},
        {"table": str(tmp_path / "bare.csv")},
        {"table": str(tmp_path / "kv.csv")},
        {"table": {"file": str(tmp_path / "bare.csv"), "units": {"voltage": "1"}}},
        {"table": {"active": {"file": str(tmp_path / "bare.csv")}}},
    ]
    found = bare_numbers(load_scenario({**snap(with_units=True), "step": steps}))
    assert [(bare.key, bare.value, bare.dimension.unit) for bare in found] == [
        ("step.2.ramp.active", 0.3, "V"),
        ("step.2.until.field", 1.5, "V/m"),
        ("step.3.steps.1.sine.amplitude", 0.1, "V"),
        ("step.4.table", 0.25, "V"),
        ("step.7.table.active", 0.25, "V"),
    ]
    assert bare_numbers(load_scenario({**snap(with_units=False), "step": steps[1:3]})) == ()


def test_the_summary_says_what_a_bare_number_is(tmp_path):
    text = VHB.read_text()
    (tmp_path / "bare.toml").write_text(text.replace('ramp = "5.5 kV"', "ramp = 0.1"))
    said = balloons("run", tmp_path / "bare.toml", "--out", tmp_path / "out").stdout
    assert f"units    step.2.ramp = 0.1 is {0.1 * SCALES.voltage / 1e3:.6g} kV\n" in said
    (tmp_path / "units.toml").write_text(text)
    assert "units " not in balloons("run", tmp_path / "units.toml", "--out", tmp_path / "out").stdout
