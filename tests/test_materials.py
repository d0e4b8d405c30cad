"""Elastomers from the scenario to the history: tables, presets, objects, and where a measured curve ends."""

from __future__ import annotations

import json
import pickle
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from simulator.analysis.fold import fold
from simulator.analysis.trace import trace, trace_all, trace_inflation
from simulator.cli import app
from simulator.model.device import Device
from simulator.model.elastomers import (
    ArrudaBoyce,
    Gent,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Tabulated,
    as_written,
    tension_force,
    tension_stiffness,
)
from simulator.scenario import PRESETS, Preset, Python, ScenarioError, load_scenario
from simulator.simulation.explanation import explain
from simulator.solver.follow import PathError
from tests.pairs import kinds, pair, run, single

MODELS = [
    {"model": "gent", "J_lim": 50},
    {"model": "neo-hookean"},
    {"model": "mooney-rivlin", "C1": 3e5, "C2": 3e4},
    {"model": "ogden", "mu": [6.3e5, 1.2e3, -1.0e4], "alpha": [1.3, 5.0, -2.0]},
    {"model": "ogden", "mu": [-1.0, 0.2], "alpha": [-1.5, 3.0]},
    {"model": "arruda-boyce", "lambda_L": 3.0},
    {"model": "yeoh", "C1": 0.5, "C2": -0.01, "C3": 2.5e-4},
    {"model": "gent-gent", "C1": 2e5, "C2": 6e4, "J_lim": 50},
    {"model": "fung", "b": 0.03},
    *({"preset": name} for name in PRESETS),
]


def table(folder: Path, elastomer, end: float, rows: int = 40, column: str = "pressure") -> dict[str, str]:
    """The elastomer as a CSV file and the scenario's words for it."""
    stretch = np.linspace(1.0, end, rows)
    force = tension_force(elastomer, stretch)
    values = force / stretch**2 if column == "pressure" else force / 2.0
    lines = [f"{x!r},{y!r}" for x, y in zip(stretch.tolist(), values.tolist(), strict=True)]
    (folder / f"{column}.csv").write_text("\n".join([f"stretch,{column}", *lines]), encoding="utf-8")
    return {"model": "tabulated", "table": str(folder / f"{column}.csv")}


def both(elastomer, inflate, *steps, **sections):
    made = {"elastomer": elastomer}
    return pair(inflate, *steps, active=made, passive=made, **sections)


# -- histories -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ambient", [0.015, 1.0])
@pytest.mark.parametrize("elastomer", MODELS, ids=str)
def test_a_sealed_pair_of_each(elastomer, ambient):
    history = run(both(elastomer, 1.0, {"ramp": 0.6}, {"ramp": 0.0}, ambient=ambient))
    assert history.energy_balance.relative_imbalance < 1e-10
    assert history.energy_balance.exchanged > 1e-3
    device = Device.from_scenario(history.scenario)
    # Every sample before an end is an equilibrium of the closed form g = f − pλ² − 2φ²λ³.
    rest = slice(0, -2 if history.outcome != "completed" else None)
    for i, voltage in enumerate((history.voltage[:, 0], 0.0 * history.pressure)):
        stretch = history.stretch[:, i]
        force = tension_force(device.elastomers[i], stretch)
        gap = force - history.pressure * stretch**2 - 2.0 * voltage**2 * stretch**3
        assert np.max(np.abs(gap[rest]) / np.maximum(np.abs(force[rest]), 1.0)) < 1e-11


def test_the_snap_of_an_ogden_pair_is_that_of_the_mooney_rivlin_pair():
    steps = ({"inflate": 2.4}, {"ramp": 0.4})
    one = run(both(MODELS[2], 1.0, *steps))
    two = run(both({"model": "ogden", "mu": [3e5, -3e4], "alpha": [2, -2]}, 1.0, *steps))
    assert kinds(one) == kinds(two)
    assert "limit_point" in kinds(one)
    for a, b in zip(one.events, two.events, strict=True):
        assert a.time == pytest.approx(b.time, rel=1e-11)
        assert a.stretch_before == pytest.approx(b.stretch_before, rel=1e-9)


# -- measured curves -------------------------------------------------------------------------------------


@pytest.mark.parametrize("column", ["pressure", "stress"])
def test_a_table_of_gent_plays_as_gent(tmp_path, column):
    steps = ({"ramp": 0.4}, {"ramp": 0.0})
    gent = run(both({"model": "gent", "J_lim": 100}, 1.2, *steps, ambient=0.015))
    told = run(both(table(tmp_path, Gent(100.0), 6.9, 400, column), 1.2, *steps, ambient=0.015))
    assert kinds(gent) == kinds(told) == ["limit_point", "limit_point"]
    assert told.outcome == "completed"
    assert told.energy_balance.relative_imbalance < 1e-10
    for a, b in zip(gent.events, told.events, strict=True):
        assert a.time == pytest.approx(b.time, rel=1e-9)
        assert a.stretch_after == pytest.approx(b.stretch_after, rel=1e-7)


def test_a_history_ends_where_its_elastomer_is_no_longer_known(tmp_path):
    short = table(tmp_path, Gent(100.0), 1.5)
    whole = {"model": "gent", "J_lim": 100}
    scenario = both(short, 1.2, {"ramp": 0.38}, ambient=0.2)
    history = run(scenario)
    assert (history.outcome, kinds(history)) == ("out_of_range", ["out_of_range"])
    (event,) = history.events
    assert event.stretch_after is None
    assert event.stretch_before[0] == pytest.approx(1.5, abs=1e-12)
    assert history.stretch.max() == event.stretch_before[0]
    # On the way there it is the history of the elastomer that was sampled.
    same = run(both(whole, 1.2, {"ramp": 0.38}, ambient=0.2))
    at = np.interp(1.5, same.stretch[101:, 0], same.voltage[101:, 0])
    assert event.voltage[0] == pytest.approx(at, rel=1e-3)
    # The path ends there too, and its other rests lie within.
    assert trace(scenario).end.kind == "out_of_range"
    assert trace(scenario).end.stretch[0] == pytest.approx(1.5, abs=1e-12)
    assert max(curve.stretch.max() for curve in trace_all(scenario)) <= 1.5 + 1e-12


def test_all_paths_of_a_wall_that_stiffens_exponentially_are_found_without_a_word():
    """Far out its pressure is more than a float can be."""
    gent, fung = {"model": "gent", "J_lim": 100.0}, {"model": "fung", "b": 0.04336}
    scenario = load_scenario(
        {
            "title": "liquid between two films",
            "gas": {"ambient_pressure": 0.2885, "chamber": 5.937, "law": "liquid"},
            "balloon": [
                {"name": "small", "radius": 0.2708, "electrodes": True, "elastomer": fung},
                {"name": "large", "electrodes": True, "elastomer": gent},
            ],
            "step": [{"inflate": 2.054}, {"ramp": 0.7323}],
        }
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        curves = trace_all(scenario)
    assert all(np.all(np.isfinite(curve.stretch)) for curve in curves)


def test_out_of_range_while_inflating_by_a_snap_and_with_the_valve_open(tmp_path):
    known = table(tmp_path, Gent(100.0), 3.0)
    inflated = run(single({"inflate": 1.3}, elastomer=known))
    # The snap from the peak would end at 6.26.
    assert kinds(inflated) == ["limit_point", "out_of_range"]
    assert inflated.events[0].stretch_before[0] == pytest.approx(1.3972279560, abs=1e-5)
    assert inflated.events[1].stretch_before[0] == pytest.approx(3.0, abs=1e-9)
    jumped = run(single({"inflate": 0.5}, {"jump": 2.0, "valve": "open"}, elastomer=known))
    assert kinds(jumped) == ["jump", "out_of_range"]
    curve = trace_inflation(single({"inflate": 0.5}, elastomer=known))
    assert [point.kind for point in curve.points] == ["limit_point", "out_of_range"]
    assert curve.end.stretch[0] == pytest.approx(3.0, abs=1e-12)


def test_a_limit_point_is_not_followed_beyond_its_curve(tmp_path):
    scenario = both(table(tmp_path, Gent(100.0), 2.1), 1.2, {"ramp": 0.5}, ambient=0.015)
    assert fold(scenario, "gas.ambient_pressure", 0.02).end == "reached"
    with pytest.raises(PathError, match="the limit point leaves the measured curve of an elastomer"):
        fold(scenario, "gas.ambient_pressure", 0.2)


def test_the_measured_rubber_is_near_ogdens_formula():
    """Treloar's rows against the constants that Ogden fitted to them, an independent copy of both."""
    made = load_scenario("scenarios/treloar_pair.toml").balloons[0].elastomer
    ogden = as_written(Preset(preset="natural-rubber"))
    ratio = tension_force(ogden, made.stretches[1:]) / made.forces[1:]
    assert np.abs(ratio - 1.0).max() < 0.09


WRONG = [
    ("", "table", "must have the header stretch,pressure or stretch,stress, is empty"),
    ("time,voltage\n", "table", "must have the header stretch,pressure or stretch,stress, has time,voltage"),
    ("stretch,stress\n1,0\n2,1\n", "table", "must have at least six rows below the header, has 2"),
    ("stretch,stress\n1,0\n2,x\n3,1\n4,1\n5,1\n6,1", "table", "row 3: must be two finite numbers, is 2,x"),
    ("stretch,stress\n2,0\n3,1\n4,1\n5,1\n6,1\n7,1", "table", "row 2: stretch must start at 1, is 2,0"),
    ("stretch,stress\n1,0\n3,1\n3,1\n5,1\n6,1\n7,1", "table", "row 4: stretch must increase, is 3,1"),
    ("stress,stretch\n1,1\n1,2\n1,3\n1,4\n1,5\n1,6", "table", "row 2: stress must be 0 at stretch 1, is 1,1"),
    (
        "stretch,pressure\n1,0\n2,-1\n3,1\n4,1\n5,1\n6,1",
        "table",
        "row 3: pressure must be > 0 beyond stretch 1, is 2,-1",
    ),
]


@pytest.mark.parametrize(("text", "key", "message"), WRONG, ids=[message for *_, message in WRONG])
def test_curves_that_make_no_sense(tmp_path, text, key, message):
    (tmp_path / "x.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        single({"inflate": 1}, elastomer={"model": "tabulated", "table": str(tmp_path / "x.csv")})
    assert caught.value.key == f"balloon.only.elastomer.{key}"
    assert str(caught.value).endswith(message)


def test_a_curve_that_swings_below_zero_is_refused(tmp_path):
    (tmp_path / "x.csv").write_text("stretch,stress\n1,0\n2,9\n3,.1\n4,.1\n5,9\n6,.1", encoding="utf-8")
    scenario = single({"inflate": 1}, elastomer={"model": "tabulated", "table": str(tmp_path / "x.csv")})
    with pytest.raises(ScenarioError, match=r"only.elastomer = .* falls below 0 near stretch .*, smooth it"):
        run(scenario)


def test_a_curves_path_starts_at_the_folder_of_the_scenario(tmp_path, monkeypatch):
    table(tmp_path, NeoHookean(), 4.0)
    text = Path("scenarios/treloar_pair.toml").read_text("utf-8")
    (tmp_path / "x.toml").write_text(
        text.replace("treloar_equibiaxial.csv", "pressure.csv"), encoding="utf-8"
    )
    monkeypatch.chdir("/")
    scenario = load_scenario(tmp_path / "x.toml")
    (tmp_path / "pressure.csv").unlink()  # read once
    made = scenario.balloons[0].elastomer
    assert made.table == str(tmp_path / "pressure.csv")
    assert made.forces == pytest.approx(tension_force(NeoHookean(), made.stretches), rel=1e-14)
    assert pickle.loads(pickle.dumps(scenario)) == scenario
    assert as_written(made) == as_written(scenario.balloons[1].elastomer)


# -- presets ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_materials_with_their_source(name):
    material, law = PRESETS[name], as_written(Preset(preset=name))
    assert material.source
    assert material.fitted_to
    assert material.citation.split()[0] in material.source
    assert tension_stiffness(law, 1.0) == pytest.approx(12.0)
    assert material.shear_modulus is None or 1e3 < material.shear_modulus < 1e7
    assert material.permittivity is None or 1.0 < material.permittivity < 20.0


def test_the_moduli_of_presets_are_those_of_their_constants():
    rubber = PRESETS["natural-rubber"].elastomer
    modulus = 0.5 * sum(m * a for m, a in zip(rubber["mu"], rubber["alpha"], strict=True))
    assert PRESETS["natural-rubber"].shear_modulus == pytest.approx(modulus, rel=1e-12)
    # The source's nkT = 15.36 kPa, μ = nkT λ_L β₀/3. At the pole D f is 2(λ − λ⁻⁵)·2/(β₀/x₀).
    law = ArrudaBoyce(5.99)
    limit = law.stretch_limit
    chain = 4.0 * (limit - limit**-5) / law.pole_form(limit)[0]  # β₀/x₀
    assert PRESETS["VHB-4910"].shear_modulus == pytest.approx(15.36e3 * chain / 3.0, rel=1e-4)


def test_a_preset_is_its_model():
    for name, law in (("Sylgard-186", Gent(30.04)), ("VHB-4910", ArrudaBoyce(5.99))):
        scenario = single({"inflate": 1}, elastomer={"preset": name})
        assert Device.from_scenario(scenario).elastomers == (law,)
        assert scenario.to_dict()["balloon"][0]["elastomer"] == {"preset": name}
        assert load_scenario(scenario.to_dict()) == scenario


def test_the_command_lists_the_presets():
    done = CliRunner().invoke(app, ["presets"], env={"COLUMNS": "200"})
    assert done.exit_code == 0
    for name, material in PRESETS.items():
        assert name in done.stdout
        assert " ".join(material.source.split()[:3]) in done.stdout
    assert "Arruda–Boyce, lambda_L = 5.99" in done.stdout
    assert "4.225e+05" in done.stdout


# -- in plain words --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("elastomer", "words"),
    [
        (MODELS[0], "Gent, J_lim = 50"),
        (MODELS[1], "neo-Hookean"),
        (MODELS[2], "Mooney–Rivlin, C1 : C2 = 300000 : 30000"),
        (MODELS[4], "Ogden, mu = -1, 0.2, alpha = -1.5, 3"),
        (MODELS[5], "Arruda–Boyce, lambda_L = 3"),
        ({"preset": "Sylgard-186"}, "Sylgard-186 (Gent, J_lim = 30.04; Akbari et al. 2013)"),
        (MooneyRivlin(2.0, 1.0), "from Python, MooneyRivlin(C1=2.0, C2=1.0)"),
    ],
    ids=str,
)
def test_histories_and_explanations_name_the_elastomer(elastomer, words, tmp_path):
    scenario = single({"inflate": 0.1}, elastomer=elastomer)
    history = run(scenario)
    assert history.elastomers == {"only": words}
    assert f"; {words}\n" in explain(scenario)
    history.to_csv(tmp_path)
    record = json.loads((tmp_path / "run.json").read_text("utf-8"))
    assert record["elastomers"] == {"only": words}


def test_tables_are_named_by_file_and_range(tmp_path):
    scenario = single({"inflate": 0.1}, elastomer=table(tmp_path, NeoHookean(), 4.0))
    assert "tabulated in pressure.csv, 40 rows up to stretch 4" in explain(scenario)
    assert "events     limit_point, out_of_range" in explain(scenario)
    assert "out_of_range" not in explain(single({"inflate": 0.1}))


# -- objects from Python ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Yeoh:
    """ŵ = ½I + ½cI³ with I = I₁ − 3."""

    c: float = 3e-4
    stretch_limit: float = float("inf")

    def energy(self, x):
        excess = 2 * x**2 + x**-4 - 3
        return 0.5 * excess + 0.5 * self.c * excess**3

    def pole_form(self, x):
        excess = 2 * x**2 + x**-4 - 3
        return 2 * (x - x**-5) * (1 + 3 * self.c * excess**2), 1.0

    def pole_form_slope(self, x):
        excess, rise = 2 * x**2 + x**-4 - 3, 4 * (x - x**-5)
        stiff = 2 * (1 + 5 * x**-6) * (1 + 3 * self.c * excess**2)
        return stiff + 12 * self.c * (x - x**-5) * excess * rise, 0.0


def test_an_object_of_ones_own():
    scenario = pair(1.2, {"ramp": 0.4}, {"ramp": 0.0}, ambient=0.015)
    history = run(scenario.with_elastomers({"active": Yeoh(), "passive": Yeoh()}))
    assert kinds(history) == ["limit_point", "limit_point"]
    assert history.energy_balance.relative_imbalance < 1e-10
    assert history.elastomers["active"] == f"from Python, {Yeoh()!r}"
    assert isinstance(scenario.balloons[0].elastomer, type(pair(1.0).balloons[0].elastomer))  # as it was


def test_an_elastomer_of_this_package_is_its_model():
    steps = ({"ramp": 0.4}, {"ramp": 0.0})
    written = run(both(MODELS[3], 1.0, *steps))
    passed = Ogden((6.3e5, 1.2e3, -1.0e4), (1.3, 5.0, -2.0))
    same = run(both(passed, 1.0, *steps))
    assert np.array_equal(written.stretch, same.stretch)
    swapped = both(MODELS[0], 1.0, *steps).with_elastomers({"active": MODELS[3], "passive": passed})
    assert np.array_equal(run(swapped).stretch, same.stretch)
    stretch = np.linspace(1.0, 3.0, 9)
    known = Tabulated.through(stretch, tension_force(passed, stretch))
    assert run(single({"inflate": 1.35}, elastomer=known)).outcome == "out_of_range"


def test_what_is_no_elastomer_is_refused_by_name():
    @dataclass(frozen=True)
    class Wrong(Yeoh):
        def pole_form_slope(self, x):
            return 12.0 * x, 0.0

    scenario = pair(1.0).with_elastomers({"passive": Wrong()})
    for use in (run, explain, trace):
        with pytest.raises(ScenarioError, match=r"must have N′ in pole_form_slope .* at stretch") as caught:
            use(scenario)
        assert caught.value.key == "balloon.passive.elastomer"


def test_other_elastomers_are_refused_in_the_words_of_the_file():
    with pytest.raises(ScenarioError) as caught:
        pair(1.0).with_elastomers({"third": Yeoh(), "active": 3, "passive": {"model": "gent"}})
    assert [(p.key, p.allowed) for p in caught.value.problems] == [
        ("balloon", "must be one of active, passive"),
        (
            "balloon.active.elastomer",
            'must be a table such as { model = "gent", J_lim = 100 } or { preset = "VHB-4910" }',
        ),
        ("balloon.passive.elastomer.J_lim", "is missing, must be a number > 0"),
    ]


def test_objects_go_into_run_json_by_name_only():
    scenario = single({"inflate": 0.1}, elastomer=Yeoh())
    assert isinstance(scenario.balloons[0].elastomer, Python)
    written = scenario.to_dict()
    assert written["balloon"][0]["elastomer"] == {"model": "python", "elastomer": repr(Yeoh())}
    with pytest.raises(ScenarioError, match=r'elastomer\.model = "python": must be "gent", '):
        load_scenario(written)


# -- elastomers without a limit --------------------------------------------------------------------------


def test_growth_without_end_at_a_finite_voltage():
    """Valve open, C₂ = ½: f/λ³ falls to 2C₂ = 1 for large stretches; as 2φ² nears it λ runs off."""
    elastomer = {"model": "mooney-rivlin", "C1": 1.0, "C2": 1.0}
    history = run(single({"inflate": 0.5}, {"ramp": 1.0, "valve": "open"}, elastomer=elastomer))
    assert (history.outcome, kinds(history)[-1]) == ("runaway", "runaway")
    event = history.events[-1]
    assert event.stretch_before[0] == pytest.approx(1e3, rel=1e-12)
    # f = pλ² + 2φ²λ³ with f → λ³ + λ, but for λ⁻³.
    assert 2.0 * event.voltage[0] ** 2 == pytest.approx(1.0 - 0.5e-3 + 1e-6, rel=1e-9)
    assert history.energy_balance.relative_imbalance < 1e-8
    assert "runaway" in explain(history.scenario)


def test_ogden_terms_with_small_exponents_keep_their_digits():
    # The two powers of a term are nearly equal; against 40 digits.
    import mpmath

    alpha, stretch = 1e-3, 1.01
    with mpmath.workdps(40):
        x, a = mpmath.mpf(stretch), mpmath.mpf(alpha)
        exact = 4 / a * (x ** (a - 1) - x ** (-2 * a - 1))
    assert tension_force(Ogden((1.0,), (alpha,)), stretch) == pytest.approx(float(exact), rel=1e-14)
