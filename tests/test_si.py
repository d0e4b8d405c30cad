"""Results of scenarios in units: the same history, its SI columns, and what people see of it."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from simulator import units
from simulator.analysis.fold import fold
from simulator.analysis.trace import trace, trace_inflation
from simulator.cli import app
from simulator.scenario import ScenarioError, load_scenario
from simulator.units import Dimension, Scales
from tests.pairs import run

ROOT = Path(__file__).parent.parent
VHB = ROOT / "scenarios" / "vhb_snap.toml"
GENT = {"model": "gent", "J_lim": 270}
BALLOON = {"name": "active", "electrodes": True, "elastomer": GENT}
PRESSURE = 45e3 * 0.5e-3 / 20e-3  # μH/R of that scenario
FIELD = math.sqrt(45e3 / (4.7 * 8.8541878128e-12))  # √(μ/ε)
VOLTAGE = 0.5e-3 * FIELD


@pytest.fixture(scope="module")
def history():
    return run(load_scenario(VHB))


def test_a_scenario_in_units_and_its_twin_have_one_history(history) -> None:
    twin = run(
        load_scenario(
            {
                "title": "twin",
                "gas": {"ambient_pressure": 101325 / PRESSURE},
                "balloon": [
                    BALLOON,
                    {"name": "passive", "radius": 3, "thickness": 3, "elastomer": GENT},
                ],
                "step": [
                    {"inflate": 1200 / PRESSURE, "over": 10},
                    {"ramp": 5500 / VOLTAGE, "over": 30},
                    {"ramp": 0, "over": 30},
                ],
                "output": {"every": 0.1},
            }
        )
    )
    for name in ("time", "voltage", "stretch", "pressure", "volume", "field", "charge"):
        np.testing.assert_allclose(getattr(history, name), getattr(twin, name), rtol=1e-12, atol=1e-12)
    for name in ("gas", "energy", "stability"):
        np.testing.assert_allclose(getattr(history, name), getattr(twin, name), rtol=1e-11)
    assert len(history.events) == len(twin.events) == 2
    for event, other in zip(history.events, twin.events, strict=True):
        assert event.kind is other.kind
        assert event.voltage == pytest.approx(other.voltage, rel=1e-12)
        assert event.stretch_after == pytest.approx(other.stretch_after, rel=1e-12)


def test_si_columns_satisfy_the_equations_in_si(history) -> None:
    """Laplace's law, plate capacitor, gas law: no scale of ours in them."""
    table = history.to_dataframe()
    permittivity = 4.7 * 8.8541878128e-12
    volume = 0.0
    for name, radius, thickness in (("active", 20e-3, 0.5e-3), ("passive", 60e-3, 1.5e-3)):
        r = table[f"radius_{name} [m]"]
        stretch = r / radius
        h = thickness / stretch**2
        stress = 45e3 * (stretch**2 - stretch**-4) * 270 / (270 - (2 * stretch**2 + stretch**-4 - 3))
        if name == "active":
            field = table["voltage_active [V]"] / h
            np.testing.assert_allclose(table["field_active [V/m]"], field, rtol=1e-12)
            charge = permittivity * field * 4 * np.pi * r**2
            np.testing.assert_allclose(table["charge_active [C]"], charge, rtol=1e-12)
            stress -= permittivity * field**2
        np.testing.assert_allclose(table["pressure [Pa]"], 2 * stress * h / r, rtol=1e-9, atol=1e-9)
        volume = volume + 4 / 3 * np.pi * r**3
    np.testing.assert_allclose(table["volume [m^3]"], volume, rtol=1e-13)
    gas = (table["pressure [Pa]"] + 101325) * volume
    np.testing.assert_allclose(table["gas [J]"], gas, rtol=1e-12)
    closed = table["step"] > 1
    np.testing.assert_allclose(gas[closed], gas.iloc[-1], rtol=1e-12)
    np.testing.assert_array_equal(table["time [s]"], table["time"])


def test_work_in_joules_balances_in_joules(history) -> None:
    """Over the loop at constant gas, ∫Φ dQ is what the snaps dissipate."""
    table, events = history.to_dataframe(), history.events_to_dataframe()
    loop = table[table["step"] > 1]
    voltage, charge = loop["voltage_active [V]"].to_numpy(), loop["charge_active [C]"].to_numpy()
    work = float(np.sum(0.5 * (voltage[1:] + voltage[:-1]) * np.diff(charge)))
    assert work == pytest.approx(events["dissipated [J]"].sum(), rel=1e-3)  # trapezia of 0.1 s


def test_columns_have_their_unit_in_the_name(history, tmp_path: Path) -> None:
    columns = list(history.to_dataframe().columns)
    assert columns[14:] == [
        "time [s]", "voltage_active [V]", "radius_active [m]", "radius_passive [m]", "pressure [Pa]",
        "volume [m^3]", "gas [J]", "field_active [V/m]", "charge_active [C]", "energy [J]",
    ]  # fmt: skip
    assert list(history.events_to_dataframe().columns)[14:] == [
        "time [s]", "voltage_active [V]", "radius_active_before [m]", "radius_active_after [m]",
        "radius_passive_before [m]", "radius_passive_after [m]", "pressure_before [Pa]",
        "pressure_after [Pa]", "field_active_before [V/m]", "field_active_after [V/m]", "dissipated [J]",
    ]  # fmt: skip
    history.to_csv(tmp_path)
    for name, expected in (("history.csv", columns), ("events.csv", history.events_to_dataframe().columns)):
        assert (tmp_path / name).read_text("utf-8").split("\n")[0] == ",".join(expected)
    record = json.loads((tmp_path / "run.json").read_text("utf-8"))
    assert record["scales"]["voltage [V]"] == pytest.approx(VOLTAGE, rel=1e-15)
    assert record["scales"]["shear_modulus [Pa]"] == 45e3
    assert load_scenario(record["scenario"]) == history.scenario


def test_the_shipped_snap_is_where_its_title_says(history) -> None:
    up, down = history.events_to_dataframe()["voltage_active [V]"]
    assert round(up / 1e3, 1) == 4.4
    assert f"{up / 1e3:.1f} kV" in history.scenario.title
    assert 0 < down < up
    # Far from the 218 MV/m that prestretched films of this tape were found to bear.
    assert history.field.max() * FIELD < 100e6


def test_names_with_suffixes_of_events_keep_their_radius() -> None:
    columns = {"stretch_x_after": np.array([2.0]), "stretch_x_after_before": np.array([3.0])}
    found = units.in_si(columns, Scales(1, 1, 1, 1), {"x_after": 0.5})
    assert {name: float(values[0]) for name, values in found.items()} == {
        "radius_x_after [m]": 1.0,
        "radius_x_after_before [m]": 1.5,
    }


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [
        (units.VOLTAGE, 4414.67, "4.41467 kV"),
        (units.VOLTAGE, 999.9999999999, "1 kV"),
        (units.VOLTAGE, 0.0, "0 V"),
        (units.VOLTAGE, -1500.0, "-1.5 kV"),
        (units.PRESSURE, 101325.0, "101.325 kPa"),
        (units.RADIUS, 0.02, "20 mm"),
        (units.RADIUS, 2000.0, "2000 m"),
        (units.FIELD, 2.5e8, "250 MV/m"),
        (units.CHARGE, 3e-9, "3 nC"),
        (units.TIME, 3600.0, "3600 s"),
        (units.VOLUME, 5e-4, "0.0005 m^3"),
        (units.ENERGY, 1e-30, "1e-18 pJ"),
        (units.ENERGY, 1e30, "1e+18 TJ"),
    ],
)
def test_prefixes_for_people(kind: Dimension, value: float, expected: str) -> None:
    assert units.with_prefix(kind, value) == expected


# -- paths, limit points, pictures -----------------------------------------------------------------------


def test_a_limit_point_follows_a_text_with_a_unit() -> None:
    scenario = load_scenario(VHB)
    curve = fold(scenario, "step.1.inflate", "800 Pa")
    assert curve.value[-1] * PRESSURE == pytest.approx(800, rel=1e-12)
    table = curve.to_dataframe()
    assert list(table.columns)[5:] == ["step.1.inflate [Pa]", "voltage [V]", "pressure [Pa]"]
    assert table["step.1.inflate [Pa]"].iloc[0] == pytest.approx(1200, rel=1e-12)
    data = scenario.to_dict()
    data["step"][0]["inflate"] = "0.8 kPa"
    data["step"][1]["ramp"] = "9 kV"
    (event, *_) = run(load_scenario(data)).events
    assert table["voltage [V]"].iloc[-1] == pytest.approx(event.voltage[0] * VOLTAGE, rel=1e-10)


@pytest.mark.parametrize(
    ("file", "to", "expected"),
    [
        (VHB, "8 kV", 'to = "8 kV": must be a pressure such as "2 kPa"'),
        (VHB, "8 kW", 'to = "8 kW": must be a pressure such as "2 kPa"'),
        (VHB, "8 Kpa", 'to = "8 Kpa": must be a pressure such as "2 kPa"; the unit Kpa is not known'),
        (VHB, "much", 'to = "much": must be a number, or a pressure such as "2 kPa"'),
        (VHB, "inf", 'to = "inf": must be a number, or a pressure such as "2 kPa"'),
        (
            ROOT / "scenarios/fig3c_state_b.toml",
            "2 kPa",
            'to = "2 kPa": must be a number; a unit needs [scales]',
        ),
        (ROOT / "scenarios/fig3c_state_b.toml", "much", 'to = "much": must be a number'),
    ],
)
def test_values_to_follow_to_that_are_refused(file: Path, to: str, expected: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        fold(load_scenario(file), "gas.ambient_pressure", to)
    assert str(caught.value) == f"{file}: {expected}"


def balloons(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words])
    return " ".join(result.output.split())


def test_the_terminal_says_kilovolts(tmp_path: Path) -> None:
    said = balloons("run", VHB, "--plot", "--out", tmp_path)
    assert "event active passive [kPa]" in said
    assert (
        "34.08002, 2 φ [kV] 4.41467 limit_point λ 1.38476 1.17033 1.17551 lost 52.3873 mJ to 2.4665" in said
    )
    assert "completed at time 70 s" in said
    assert (tmp_path / "history.png").read_bytes().startswith(b"\x89PNG")


def test_paths_end_at_a_text_with_a_unit(tmp_path: Path) -> None:
    said = balloons("trace", VHB, "--to-voltage", "3000 V", "--plot", "--out", tmp_path)
    assert "point [kV] active passive [kPa]" in said
    assert "reached 3 1.2202 1.17776" in said
    header, *_, last = (tmp_path / "curve.csv").read_text("utf-8").splitlines()
    row = dict(zip(header.split(","), last.split(","), strict=True))
    assert float(row["voltage_active [V]"]) == pytest.approx(3000, rel=1e-12)
    assert float(row["radius_passive [m]"]) == pytest.approx(float(row["stretch_passive"]) * 60e-3, rel=1e-12)
    balloons("trace", VHB, "--inflation", "--to-pressure", "1 kPa", "--out", tmp_path)
    header, point = (tmp_path / "points.csv").read_text("utf-8").splitlines()
    row = dict(zip(header.split(","), point.split(","), strict=True))
    assert row["kind"] == "reached"
    assert float(row["pressure [Pa]"]) == pytest.approx(1000, rel=1e-12)
    said = balloons("fold", VHB, "--vary", "gas.ambient_pressure", "--to", "0.9 atm", "--out", tmp_path)
    assert "from gas.ambient_pressure = 101.325 kPa: voltage 4.41467" in said
    assert "to gas.ambient_pressure = 91.1925 kPa: voltage 4.41" in said


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ((VHB, "--to-voltage", "3 kPa"), '--to-voltage = "3 kPa": must be a voltage >= 0 such as "8 kV"'),
        ((VHB, "--to-voltage", "-3 kV"), '--to-voltage = "-3 kV": must be a voltage >= 0 such as "8 kV"'),
        (
            (VHB, "--inflation", "--to-pressure", "3 kX"),
            '--to-pressure = "3 kX": must be a pressure >= 0 such as "2 kPa"; the unit kX is not known',
        ),
        (
            (VHB, "--to-voltage", "x"),
            '--to-voltage = "x": must be a number >= 0, or a voltage >= 0 such as "8 kV"',
        ),
        (
            ("scenarios/fig3c_state_b.toml", "--to-voltage", "3 kV"),
            '--to-voltage = "3 kV": must be a number >= 0; a unit needs [scales]',
        ),
    ],
)
def test_options_that_are_refused(
    words: tuple[object, ...], expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    assert expected in balloons("trace", *words)


def test_explanations_say_what_one_is() -> None:
    said = balloons("explain", VHB)
    assert "reference balloon: μ = 45 kPa, H = 500 µm, R = 20 mm, ε = 4.7 of the vacuum" in said
    assert "pressure 1 is 1.125 kPa voltage 1 is 16.4419 kV field 1 is 32.8839 MV/m" in said


def test_pictures_show_kilovolts_and_millimetres(history) -> None:
    voltage, pressure, radius, loop = history.plot().axes
    assert voltage.get_ylabel() == "voltage\nΦ [kV]"
    assert pressure.get_ylabel() == "pressure\nP [kPa]"
    assert radius.get_ylabel() == "radius\nr [mm]"
    assert radius.get_xlabel() == "time  t [s]"
    assert loop.get_xlabel() == "voltage on active  Φ [kV]"
    assert loop.get_ylabel() == "radius of active  r [mm]"
    (stretch,) = loop.child_axes
    assert stretch.get_ylabel() == "stretch  λ = r/R"
    loop.figure.draw_without_rendering()
    assert np.divide(loop.get_ylim(), 20) == pytest.approx(stretch.get_ylim())
    (ramps, *_) = voltage.get_lines()
    assert np.nanmax(ramps.get_xydata(), axis=0) == pytest.approx([70, 5.5])
    drawn = [line for line in radius.get_lines() if len(line.get_xdata()) > 10]
    assert max(np.nanmax(line.get_ydata()) for line in drawn) == pytest.approx(
        60 * history.stretch[:, 1].max()
    )
    # Events are marked where they happen.
    marks = [line.get_xydata()[0] for line in loop.get_lines() if line.get_marker() == "*"]
    events = history.events_to_dataframe()
    assert np.array(marks) == pytest.approx(
        np.column_stack([events["voltage_active [V]"] / 1e3, events["radius_active_before [m]"] * 1e3])
    )


def test_pictures_of_paths_show_them_too() -> None:
    scenario = load_scenario(VHB)
    ax = trace(scenario).plot().axes[0]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("voltage on active  Φ [kV]", "radius of active  r [mm]")
    # Cut off before the stretch limit, where pressures are of another size.
    ax = trace_inflation(scenario).plot().axes[0]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("pressure  P [kPa]", "radius of passive  r [mm]")
    assert 1 < ax.get_xlim()[1] < 10
    ax = fold(scenario, "balloon.passive.thickness", "1.4 mm").plot().axes[0]
    assert ax.get_xlabel() == "balloon.passive.thickness [mm]"
    assert ax.get_ylabel() == "voltage of the limit point  Φ [kV]"
    ax = fold(scenario, "balloon.*.elastomer.J_lim", 250, inflation="active").plot().axes[0]
    assert ax.get_xlabel() == "balloon.*.elastomer.J_lim"
    assert ax.get_ylabel() == "pressure of the limit point  P [kPa]"


# -- what is left out ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("program", "needed"),
    [
        ("load_scenario('scenarios/fig3c_state_b.toml')", False),
        ("simulate(load_scenario('scenarios/fig5b_state_c.toml'))", False),
        ("load_scenario('scenarios/vhb_snap.toml')", True),
        # A unit without [scales] is refused without it.
        ("load_scenario({'gas': {'ambient_pressure': '1 kPa'}})", False),
    ],
)
def test_pint_is_loaded_by_units_alone(program: str, needed: bool) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(program)], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert done.stdout.strip() == str(needed)


PROGRAM = """
import sys
from simulator import ScenarioError, load_scenario, simulate
try:
    {}
except ScenarioError:
    pass
print("pint" in sys.modules)
"""
