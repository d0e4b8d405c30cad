"""Viscoelastic branches: closed forms of small strains, exact relaxation, limits, energy, messages."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from simulator import EventKind, ScenarioError, explain, load_history, load_scenario, simulate
from simulator.cli.summary_material import material_lines
from simulator.model.viscoelastic import LinearBranch, NewtonianBranch
from simulator.solver.passage import Material
from tests.oracle.general.real_time import play_real_time
from tests.pairs import run

FloatArray = NDArray[np.float64]

THREE = [{"modulus": 0.5, "time": 0.1}, {"modulus": 1.5, "time": 1.0}, {"modulus": 0.8, "time": 10.0}]
NEO_HOOKEAN_PEAK = 2.0 * (7.0 ** (-1 / 6) - 7.0 ** (-7 / 6))  # of the pressure of a balloon, at 7^(1/6)


def balloon(*steps: dict[str, Any], tau: float = 1e-6, **more: Any) -> Any:
    one = {"name": "one", "electrodes": True, "elastomer": {"model": "neo-hookean"}, **more}
    return load_scenario(
        {
            "title": "one balloon",
            "gas": {"ambient_pressure": 1.0},
            "balloon": [one],
            "step": list(steps),
            "dynamics": {"relaxation_time": tau},
            "shape": {"on_loss": "ignore"},
        }
    )


def maxwell_solid(branches: list[dict[str, float]], tau: float) -> tuple[FloatArray, FloatArray]:
    """A and b of ẏ = A y + b F, the strain and those of the dashpots: a generalised Maxwell solid, k = 1."""
    k, t = np.array([[one["modulus"], one["time"]] for one in branches]).T
    a = np.zeros((1 + k.size, 1 + k.size))
    a[0, 0], a[0, 1:] = -12.0 * (1.0 + k.sum()) / tau, 12.0 * k / tau
    a[1:, 0], a[1:, 1:] = 1.0 / t, -np.diag(1.0 / t)
    return a, np.eye(1 + k.size)[0] / tau


@pytest.mark.parametrize("flow", ["linear", "newtonian"])
def test_small_strains_creep_as_a_generalised_maxwell_solid(flow: str) -> None:
    """A pressure put on at once and held: ε(t) = A⁻¹(e^{At} − 1) b p."""
    pressure, tau = 1e-5, 0.3
    branches = [{**one, "flow": flow} for one in THREE]
    history = run(
        balloon(
            {"inflate": pressure, "over": 1e-9}, {"hold": 20.0, "valve": "open"}, tau=tau, maxwell=branches
        )
    )
    a, b = maxwell_solid(THREE, tau)
    for time, stretch in zip(history.time[101::10], history.stretch[101::10, 0], strict=True):
        exact = np.linalg.solve(a, (expm(a * time) - np.eye(4)) @ b)[0] * pressure
        assert stretch - 1.0 == pytest.approx(exact, rel=1e-4, abs=1e-13)


def test_storage_and_loss_modulus_over_four_decades() -> None:
    """Under φ² = m² + 2ma sin ωt + … the strain follows with the complex modulus of the Maxwell solid."""
    mean, amplitude, tau = 1e-2, 3e-3, 1e-6
    for omega in (1e-2, 1e-1, 1.0, 1e1, 1e2):
        period = 2.0 * np.pi / omega
        wave = {"mean": mean, "amplitude": amplitude, "period": period, "cycles": 3}
        rest = {"jump": mean, "valve": "open"}, {"hold": 400.0, "valve": "open"}
        history = run(balloon(*rest, {"sine": wave, "valve": "open"}, tau=tau, maxwell=THREE))
        sine = history.step == 3
        time, strain = history.time[sine] - 400.0, history.stretch[sine, 0] - 1.0
        angle = omega * time
        a, _ = maxwell_solid(THREE, tau)
        slow = [np.exp(rate * time) for rate in np.linalg.eigvals(a).real if rate > -1e3]
        waves = [f(n * angle) for n in (1, 2) for f in (np.sin, np.cos)]
        found = np.linalg.lstsq(np.stack([*waves, np.ones_like(time), *slow], axis=1), strain, rcond=None)[0]
        modulus = 4.0 * mean * amplitude / complex(found[0], found[1])
        parts = [12.0 * b["modulus"] * 1j * omega * b["time"] / (1 + 1j * omega * b["time"]) for b in THREE]
        exact = 12.0 + sum(parts)
        assert modulus.real == pytest.approx(exact.real, rel=2e-4)
        assert modulus.imag == pytest.approx(exact.imag, rel=1e-3)


def test_at_a_given_stretch_the_stress_of_the_linear_flow_decays_exponentially_whatever_the_stretch() -> None:
    branch, stretch = LinearBranch(0.7, 2.0, 1.0), 3.0
    own = np.array(branch.at_rest)
    first = branch.moves(stretch, own.tolist(), 0.0)[0]
    assert first == pytest.approx(0.7 * 2.0 * (stretch - stretch**-5), rel=1e-14)
    rest = np.array([stretch**-2, stretch**4])
    for time in (0.5, 2.0, 9.0):
        later = rest + (own - rest) * np.exp(-time / 2.0)
        assert branch.moves(stretch, later.tolist(), 0.0)[0] == pytest.approx(first * np.exp(-time / 2.0))


@pytest.mark.parametrize("kind", [LinearBranch, NewtonianBranch])
def test_a_branch_is_the_derivative_of_its_energy_and_what_it_loses_is_heat(kind: type) -> None:
    branch = kind(0.7, 2.0, 1.3)
    rng = np.random.default_rng(5)
    for _ in range(20):
        stretch = float(np.exp(rng.uniform(0.0, 1.5)))
        own = [float(at * np.exp(rng.uniform(-1.0, 1.0))) for at in branch.at_rest]
        share, rates, (heat,) = branch.moves(stretch, own, 0.0)

        def along(place: int, function: Any, at: tuple[float, ...] = (stretch, *own)) -> Any:
            """The derivative of a function of (stretch, own unknowns) in the one at a place."""
            there = np.array(at)
            step = 1e-6 * there[place] * np.eye(len(at))[place]
            up, down = (np.asarray(function(y[0], list(y[1:]))) for y in (there + step, there - step))
            return (up - down) / (2.0 * step[place])

        def close(value: Any) -> Any:
            return pytest.approx(value, rel=1e-7, abs=1e-7)

        assert along(0, branch.energy) == close(1.3 * share)
        lost = -sum(along(i + 1, branch.energy) * rate for i, rate in enumerate(rates))
        assert heat == close(lost)
        assert heat >= 0.0
        tangent = branch.tangent(stretch, own, 0.0)
        first = along(0, lambda x, y: branch.moves(x, y, 0.0)[0])
        assert tangent.share_per_stretch == pytest.approx(first)
        assert branch.stiffness(stretch, own) == close(first)
        assert branch.sphericity(stretch, own) == close(first - share / stretch)
        assert tangent.rates_per_stretch == close(along(0, lambda x, y: branch.moves(x, y, 0.0)[1]))
        assert tangent.books_per_stretch == close(along(0, lambda x, y: branch.moves(x, y, 0.0)[2]))
        for i in range(len(own)):
            moves = [along(i + 1, lambda x, y, k=k: branch.moves(x, y, 0.0)[k]) for k in range(3)]
            assert tangent.share_per_own[i] == close(moves[0])
            assert tangent.rates_per_own[i] == close(moves[1][i])
            assert tangent.books_per_own[0][i] == close(moves[2][0])


def test_quick_and_slow_branches_tend_to_elastic_films() -> None:
    """Times → 0: modulus k; times → ∞: k + Σk_j. Both in proportion to the time, or to one over it."""
    steps = {"inflate": 0.6, "over": 1.0}, {"ramp": 0.2, "over": 1.0, "valve": "open"}

    def end(modulus: float, **more: Any) -> float:
        return float(run(balloon(*steps, modulus=modulus, tau=1e-3, **more)).stretch[-1, 0])

    branches = [0.5, 0.7]
    for modulus, times in ((1.0, (1e-3, 1e-4, 1e-5)), (1.0 + sum(branches), (1e3, 1e4, 1e5))):
        exact = end(modulus)
        errors = [
            abs(end(1.0, maxwell=[{"modulus": k, "time": time} for k in branches]) - exact) for time in times
        ]
        orders = np.diff(np.log(errors)) / np.diff(np.log(times))
        assert np.abs(orders) == pytest.approx(1.0, abs=0.03)


def test_a_limit_point_is_that_of_the_film_as_stiff_as_it_is_at_once() -> None:
    """Inflated far too quickly for its branches, a film of 1 + 1.2 passes the peak of an elastic one."""
    slow = [{"modulus": 0.5, "time": 1e9}, {"modulus": 0.7, "time": 1e9}]
    step = {"inflate": 1.02 * 2.2 * NEO_HOOKEAN_PEAK, "over": 1e4}
    (event, _) = run(balloon(step, tau=1e-6, maxwell=slow)).events
    assert event.kind is EventKind.LIMIT_POINT
    assert event.pressure_before == pytest.approx(2.2 * NEO_HOOKEAN_PEAK, rel=1e-3)
    assert event.stretch_before[0] == pytest.approx(7.0 ** (1 / 6), rel=5e-3)


VHB = {
    "title": "VHB",
    "scales": {"shear_modulus": "15.62 kPa", "thickness": "0.5 mm", "radius": "20 mm", "permittivity": 4.8},
    "gas": {"ambient_pressure": "101.325 kPa"},
    "balloon": [
        {
            "name": "one",
            "electrodes": True,
            "elastomer": {"preset": "VHB-4910"},
            "maxwell": {"preset": "VHB-4910"},
        }
    ],
    "dynamics": {"relaxation_time": "1 ms"},
    "step": [
        {"inflate": "0.35 kPa", "over": "20 s"},
        {"triangle": {"low": "0 V", "high": "3 kV", "period": "20 s", "cycles": 2}, "valve": "open"},
    ],
    "output": {"points": 21},
}


def test_the_books_close_and_say_what_each_branch_has_lost(tmp_path: Path) -> None:
    history = run(load_scenario(VHB))
    balance = history.energy_balance
    assert balance.relative_imbalance < 1e-8
    assert list(balance.dissipated_in) == ["one_1", "one_2", "one_3"]
    assert all(lost > 0.0 for lost in balance.dissipated_in.values())
    assert sum(balance.dissipated_in.values()) == pytest.approx(balance.dissipated, rel=1e-2)
    assert sum(balance.dissipated_in.values()) < balance.dissipated  # friction has the rest
    history.to_csv(tmp_path)
    assert load_history(tmp_path) == history


def test_inner_stretches_are_columns_that_relax_to_the_stretch_of_the_film() -> None:
    rest = {"hold": 1e4, "valve": "open"}
    history = run(balloon({"inflate": 0.8, "over": 1.0}, rest, maxwell=THREE))
    assert list(history.inner_of) == [f"one_{n}{end}" for n in (1, 2, 3) for end in ("", "_thickness")]
    end = history.at(history.time[-1])
    for number in (1, 2, 3):
        assert end[f"inner_one_{number}"] == pytest.approx(end["stretch_one"], abs=1e-6)
        assert end[f"inner_one_{number}_thickness"] == pytest.approx(end["stretch_one"] ** -2, abs=1e-6)
    early = history.at(1.0)
    assert 1.0 < early["inner_one_3"] < early["inner_one_2"] < early["inner_one_1"] < early["stretch_one"]


def test_the_reference_plays_the_material_with_its_branches_too() -> None:
    history = run(load_scenario(VHB))
    found = play_real_time(VHB)
    assert not found.undecided
    assert found.end is not None
    assert history.stretch[-1] == pytest.approx(found.end.stretch, rel=1e-7)
    assert history.energy_balance.dissipated == pytest.approx(found.dissipated, rel=1e-7)


def test_one_table_keeps_its_flow_and_a_list_of_one_is_linear() -> None:
    one = {"modulus": 0.5, "time": 10.0}
    flows = [
        [branch.flow for branch in balloon({"hold": 1.0}, maxwell=named).balloons[0].branches]
        for named in (one, [one], {**one, "flow": "linear"}, [{**one, "flow": "newtonian"}, one])
    ]
    assert flows == [["newtonian"], ["linear"], ["linear"], ["newtonian", "linear"]]


def test_explain_writes_every_branch_out() -> None:
    text = explain(balloon({"inflate": 0.5}, maxwell=THREE[:2]))
    assert "+ 1(a1 λ − b1 λ⁻⁵) + 3(a2 λ − b2 λ⁻⁵)]" in text
    assert "Maxwell branch of one: da2/dt = (λ⁻² − a2) / 1, db2/dt = (λ⁴ − b2) / 1" in text


A_BRANCH = "a table such as { modulus = 0.5, time = 10 }, a list of such tables, or a preset"


@pytest.mark.parametrize(
    ("written", "message"),
    [
        (3, f"maxwell = 3: must be {A_BRANCH}"),
        ([], f"maxwell = []: must be {A_BRANCH}"),
        ([3], "maxwell.1 = 3: must be a table of modulus, time, flow"),
        ([{"modulus": 1}], "maxwell.1.time: is missing, must be a number > 0"),
        ([THREE[0], {"modulus": -1, "time": 1}], "maxwell.2.modulus = -1: must be a number > 0"),
        (
            {"modulus": 1, "time": 1, "flow": "quick"},
            'maxwell.flow = "quick": must be "linear" or "newtonian"',
        ),
        ({"modulus": 1, "times": 1}, "maxwell.times = 1: unknown key, allowed here: modulus, time, flow"),
        ({"preset": "Sylgard-186"}, 'maxwell.preset = "Sylgard-186": must be "VHB-4910"'),
        ({"preset": "VHB-4910", "time": 3}, "maxwell.time = 3: unknown key, allowed here: preset"),
        (
            [{"modulus": "1 kPa", "time": 1}],
            'maxwell.1.modulus = "1 kPa": must be a number > 0; a unit needs [scales]',
        ),
    ],
)
def test_what_makes_no_sense_is_said(written: Any, message: str) -> None:
    with pytest.raises(ScenarioError) as error:
        balloon({"inflate": 0.5}, maxwell=written)
    assert f"balloon.one.{message}" in str(error.value)


def test_a_number_of_one_branch_can_be_changed() -> None:
    changed = balloon({"inflate": 0.5}, maxwell=THREE).with_values({"balloon.one.maxwell.2.time": 4.0})
    assert [branch.time for branch in changed.balloons[0].branches] == [0.1, 4.0, 10.0]


def test_a_film_without_branches_does_not_load_them() -> None:
    code = (
        "import sys; from simulator import load_scenario, simulate;"
        "simulate(load_scenario('scenarios/fig5b_state_b.toml'));"
        "assert 'simulator.model.viscoelastic' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_two_equal_balloons_with_branches_stay_alike() -> None:
    document = balloon({"inflate": 1.0}, {"hold": 3.0}, maxwell=THREE).to_dict()
    document["balloon"] = [{**document["balloon"][0], "name": name} for name in ("a", "b")]
    history = simulate(load_scenario(document))
    assert np.array_equal(history.stretch[:, 0], history.stretch[:, 1])
    assert np.array_equal(history["inner_a_3_thickness"], history["inner_b_3_thickness"])


def test_the_summary_says_which_of_the_two_films_it_was() -> None:
    elastomer = {"preset": "VHB-4910"}
    alone = balloon({"inflate": 0.5}, elastomer=elastomer)
    with_own = balloon({"inflate": 0.5}, elastomer=elastomer, maxwell=THREE)
    said = [list(material_lines(scenario)) for scenario in (alone, load_scenario(VHB), with_own)]
    assert said == [
        ["one: VHB-4910 relaxed, its equilibrium alone; at once it is 5.1 times as stiff"],
        ["one: VHB-4910 with its 3 viscoelastic branches: at once 5.1 times as stiff as relaxed"],
        ["one: VHB-4910 with branches of the scenario's own"],
    ]


def test_a_snap_comes_late_and_is_told_when_it_comes() -> None:
    """The shipped scenario: the relaxed film has no equilibrium near by; the event is the snap itself."""
    history = run(load_scenario(Path(__file__).parent.parent / "scenarios" / "vhb_delayed_snap.toml"))
    (snap,) = history.snaps
    assert snap.step == 4
    assert 200.0 < snap.time - 621.0 < 260.0
    assert history.at(snap.time + 10.0)["stretch_active"] > 6.5
    assert history.stretch[-1, 0] > 6.0
    assert history.energy_balance.relative_imbalance < 1e-8


@pytest.mark.parametrize("kind", [LinearBranch, NewtonianBranch])
def test_a_branch_resists_shear_in_the_surface_as_its_energy_says(kind: type) -> None:
    """(w₁₁ − w₁₂ + w₁/λ)/2 of w = (k/2)[aλ₁² + aλ₂² + b/(λ₁λ₂)²]; of an inner stretch ξ a = ξ⁻², b = ξ⁴."""
    branch, stretch = kind(0.7, 2.0, 1.0), 1.6
    own = [0.6, 2.5] if kind is LinearBranch else [1.2]
    a, b = own if kind is LinearBranch else (own[0] ** -2, own[0] ** 4)

    def energy(x: float, y: float) -> float:
        return 0.35 * (a * x**2 + a * y**2 + b / (x * y) ** 2)

    h, at = 1e-4, stretch
    first = (energy(at + h, at) - energy(at - h, at)) / (2.0 * h)
    second = (energy(at + h, at) - 2.0 * energy(at, at) + energy(at - h, at)) / h**2
    mixed = sum(i * j * energy(at + i * h, at + j * h) for i in (1, -1) for j in (1, -1)) / (4.0 * h**2)
    found = branch.shear_stiffness(stretch, own)
    assert found == pytest.approx((second - mixed + first / at) / 2.0, rel=1e-6)
    material = Material.alike(1)
    material = replace(material, parts=((branch, branch),))
    assert material.roundness("shear", 0, stretch, own * 2) == pytest.approx(2.0 * found)
    assert material.roundness("pear", 0, stretch, own * 2) == pytest.approx(
        2.0 * branch.sphericity(stretch, own)
    )


def test_columns_and_events_see_the_same_film() -> None:
    """At a limit point `stability` is zero, at a lost sphere `sphericity`, both with the branches."""
    steps = {"inflate": 1.0, "over": 5.0}, {"ramp": 0.8, "over": 10.0, "valve": "open"}
    document = balloon(*steps, tau=1e-3, maxwell=THREE, radius=1.2, thickness=0.8).to_dict()
    history = simulate(load_scenario({**document, "shape": {"on_loss": "record"}}))
    kinds = {event.kind: event for event in history.events}
    for kind, column in (("limit_point", "stability"), ("loss_of_sphericity", "sphericity_one")):
        event = kinds[EventKind(kind)]
        assert history.at(event.time)[column] == pytest.approx(0.0, abs=1e-5), kind


def test_the_energy_is_that_of_the_branches_too() -> None:
    """Sealed and left alone, what the potential loses is what the books say was lost."""
    film: dict[str, Any] = {"tau": 0.1, "maxwell": THREE, "radius": 1.2, "thickness": 0.8}
    short, long = (run(balloon({"inflate": 1.0}, {"hold": lasts}, **film)) for lasts in (0.5, 3.0))
    lost = long.energy_balance.dissipated - short.energy_balance.dissipated
    assert lost > 1e-5
    assert short.energy[-1] - long.energy[-1] == pytest.approx(lost, rel=1e-6)
