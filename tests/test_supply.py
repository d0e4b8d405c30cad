"""Films behind resistances: charging, current limits and leaks in closed form, limits, energy, messages."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import exp1

from simulator import EventKind, Outcome, ScenarioError, explain, load_history, load_scenario, simulate
from simulator.model.drive import AffineDrive
from simulator.model.supply import Leak, SuppliedFilm
from tests.pairs import pair, run

SCENARIOS = Path(__file__).parent.parent / "scenarios"


def clamped(*steps: dict[str, Any], supply: dict[str, Any], **more: Any) -> Any:
    """One film that is too stiff to move, of capacitance 1."""
    one = {"name": "one", "electrodes": True, "modulus": 1e9, "elastomer": {"model": "neo-hookean"}, **more}
    return load_scenario(
        {
            "title": "a clamped film",
            "gas": {"ambient_pressure": 1.0},
            "balloon": [one],
            "step": [{**step, "valve": "open"} for step in steps],
            "dynamics": {"relaxation_time": 1.0},
            "supply": supply,
        }
    )


def test_a_clamped_film_is_charged_and_discharged_exponentially() -> None:
    history = run(
        clamped({"jump": 0.3}, {"hold": 5.0}, {"jump": 0.0}, {"hold": 3.0}, supply={"resistance": 2.0})
    )
    up, down = (history.step == step for step in (2, 4))
    reached = 0.3 * (1.0 - np.exp(-5.0 / 2.0))
    assert history.voltage[up, 0] == pytest.approx(0.3 * (1.0 - np.exp(-history.time[up] / 2.0)), abs=1e-8)
    assert history.voltage[down, 0] == pytest.approx(
        reached * np.exp(-(history.time[down] - 5.0) / 2.0), abs=1e-8
    )
    assert set(history["supply_one"][up]) == {0.3}
    assert np.all(history["supply_one"][down] == 0.0)
    # The source gave φ_s q; what is not ½q² at the end of the first step became heat in the resistance.
    assert history.energy_balance.electrical_work == pytest.approx(0.3 * reached, rel=1e-8)
    assert history.energy_balance.relative_imbalance < 1e-7


def test_a_source_gives_no_more_than_its_current() -> None:
    """At first q = i t, and where ρ i is left of the voltage it goes on exponentially."""
    supply = {"resistance": 2.0, "current_limit": 0.05}
    history = run(clamped({"jump": 0.3}, {"hold": 10.0}, supply=supply))
    t, q = history.time[2:], history.charge[2:, 0]
    turn = (0.3 - 0.1) / 0.05
    exact = np.where(t < turn, 0.05 * t, 0.3 - 0.1 * np.exp(-(t - turn) / 2.0))
    assert q == pytest.approx(exact, abs=1e-8)


def test_a_film_that_leaks_divides_the_voltage() -> None:
    leak = {"conductivity": 0.25}
    history = run(clamped({"jump": 0.3}, {"hold": 100.0}, supply={"resistance": 2.0}, leak=leak))
    assert history.voltage[-1, 0] == pytest.approx(0.3 * 4.0 / (4.0 + 2.0), rel=1e-8)
    lost = history.energy_balance.dissipated_in
    assert set(lost) == {"one_resistance", "one_leak"}
    assert history.energy_balance.relative_imbalance < 1e-7


def test_a_leak_that_grows_with_the_field() -> None:
    """dE/dt = −(σ/e)E exp(E/F): (σ/e)t = E₁(E/F) − E₁(E₀/F), with E₁ the exponential integral."""
    leak, far = {"conductivity": 0.05, "field": 0.2}, 1e7
    steps = {"jump": 0.5 * far}, {"hold": 1.0}, {"jump": 0.0}, {"hold": 30.0}
    history = run(clamped(*steps, supply={"resistance": far}, leak=leak, permittivity=2.0))
    left = history.step == 4
    fields, start = history.field[left, 0], history.field[np.flatnonzero(left)[0] - 1, 0]
    expected = (exp1(fields / 0.2) - exp1(start / 0.2)) / (0.05 / 2.0)
    assert history.time[left] - 1.0 == pytest.approx(expected, rel=1e-5, abs=1e-5)


def test_a_small_resistance_is_a_given_voltage() -> None:
    """Away from the snaps the distance falls in proportion to the resistance."""
    steps = {"ramp": 0.3, "over": 1.0}, {"hold": 0.5}
    written = pair(1.2, *steps, ambient=0.015).to_dict() | {"dynamics": {"relaxation_time": 1e-3}}
    ideal = run(load_scenario(written))
    errors = []
    for resistance in (1e-4, 1e-5, 1e-6):
        history = run(load_scenario({**written, "supply": {"resistance": resistance}}))
        ramped = (history.time > 1.5) & (history.time < 1.99)
        at = np.isin(ideal.time, history.time[ramped])
        errors.append(np.abs(history.stretch[ramped][: at.sum(), 0] - ideal.stretch[at, 0]).max())
    assert np.diff(np.log10(errors)) == pytest.approx(-1.0, abs=0.03)


def test_a_large_resistance_is_a_given_charge() -> None:
    """A source of ρi behind ρ gives i: the pair goes through what given charges lead it through."""
    steps = {"charge": 2.0, "over": 1.0}, {"hold": 1.0}
    charged = run(pair(1.2, *steps, ambient=0.015))
    gaps = []
    for resistance in (1e3, 1e4):
        wave = {"jump": 2.0 * resistance}, {"hold": 1.0}
        written = pair(1.2, *wave, ambient=0.015).to_dict()
        written |= {"dynamics": {"relaxation_time": 1e-6}, "supply": {"resistance": resistance}}
        history = run(load_scenario(written))
        end = np.flatnonzero(charged.step == 2)[-1]
        gaps.append(abs(history.charge[-1, 0] - 2.0))
        assert history.stretch[-1] == pytest.approx(charged.stretch[end], abs=20.0 / resistance)
    assert gaps[0] / gaps[1] == pytest.approx(10.0, rel=0.05)


def test_units_of_a_supply() -> None:
    """RC of the film of vhb_snap.toml behind 10 MΩ: 4.2 ms, and what 0.1 mA charges it to in 1 ms."""
    scenario = load_scenario(SCENARIOS / "vhb_behind_resistance.toml")
    supply, scales = scenario.supply, scenario.scales
    assert supply is not None
    assert scales is not None
    farad = 4.7 * 8.8541878128e-12 * 4.0 * np.pi * 0.02**2 / 0.5e-3
    assert supply.resistance_of("active") == pytest.approx(10e6 * farad, rel=1e-12)
    assert supply.current_limit_of("active") * scales.charge == pytest.approx(1e-4, rel=1e-12)
    leak = scenario.balloons[0].leak
    assert leak is not None
    assert leak.conductivity == pytest.approx(3.23e-14 / (4.7 * 8.8541878128e-12), rel=1e-12)


def test_the_voltage_sags_in_a_snap(tmp_path: Path) -> None:
    """The shipped scenario, on samples a second apart."""
    written = load_scenario(SCENARIOS / "vhb_behind_resistance.toml").to_dict() | {"output": {"every": "1 s"}}
    history = simulate(load_scenario(written))
    first = history.events[0]
    assert first.kind is EventKind.LIMIT_POINT
    assert history.at(first.time)["voltage_active [V]"] == pytest.approx(4416.3, abs=0.2)
    assert history.voltage[history.step == 2].min() < history.supply[history.step == 2].max()
    (lost,) = [event for event in history.events if event.kind is EventKind.LOSS_OF_SPHERICITY]
    assert lost.voltage[0] < 0.8 * first.voltage[0]  # in the snap, 0.3 s later
    assert history.energy_balance.relative_imbalance < 1e-8
    history.to_csv(tmp_path)
    assert load_history(tmp_path) == history


def test_a_film_behind_a_resistance_breaks_where_its_own_field_is_its_strength() -> None:
    scenario = clamped(
        {"jump": 0.3}, {"hold": 10.0}, supply={"resistance": 2.0}, breakdown={"field": 0.2}, thickness=1.0
    )
    history = run(scenario)
    assert history.outcome is Outcome.BREAKDOWN
    assert history.time[-1] == pytest.approx(2.0 * np.log(3.0), rel=1e-7)


def test_a_film_is_the_derivative_of_its_energy_and_slopes_are_right() -> None:
    r, h, e = 1.3, 0.7, 1.9
    film = SuppliedFilm(
        capacitance=r * r * e / h,
        thickness=h,
        permittivity=e,
        pull=2.0 / (r**4 * e),
        resistance=0.8,
        limit=np.inf,
        leak=Leak(0.3, 0.9),
        drive=AffineDrive(0.0, 1.0),
        strength=None,
    )
    for part in (film, replace(film, limit=0.05)):
        for stretch, charge, v in ((1.2, 0.4, 0.7), (2.5, -0.3, 0.2), (1.7, 5.0, -0.4)):

            def along(place: int, function: Any, at: tuple[float, float] = (stretch, charge)) -> Any:
                step = 1e-6 * np.eye(2)[place] * at[place]
                up, down = (np.asarray(function(*(np.array(at) + s))) for s in (step, -step))
                return (up - down) / (2.0 * step[place])

            def moves(k: int, part: SuppliedFilm = part, v: float = v) -> Any:
                return lambda x, q: part.moves(x, [q], v)[k]

            share = part.moves(stretch, [charge], v)[0]
            stored = along(0, lambda x, q, part=part: part.energy(x, [q]))
            assert r * r * h * share == pytest.approx(stored, rel=1e-7)
            phi = part.voltage(stretch, [charge])
            assert share == pytest.approx(-2.0 * e / h**2 * phi**2 * stretch**3, rel=1e-12)
            assert part.stiffness(stretch, [charge]) == pytest.approx(-6.0 * e / h**2 * phi**2 * stretch**2)
            assert part.sphericity(stretch, [charge]) == pytest.approx(-4.0 * e / h**2 * phi**2 * stretch**2)
            tangent = part.tangent(stretch, [charge], v)
            assert tangent.share_per_stretch == pytest.approx(along(0, moves(0)), rel=1e-6)
            assert tangent.share_per_own[0] == pytest.approx(along(1, moves(0)), rel=1e-6)
            assert tangent.rates_per_stretch == pytest.approx(along(0, moves(1)), rel=1e-6)
            assert tangent.rates_per_own == pytest.approx(along(1, moves(1)), rel=1e-6)
            assert tangent.books_per_stretch == pytest.approx(along(0, moves(2)), rel=1e-6, abs=1e-9)
            across = [row[0] for row in tangent.books_per_own]
            assert across == pytest.approx(along(1, moves(2)), rel=1e-6, abs=1e-9)


def test_explain_writes_the_charging_out() -> None:
    leak = {"conductivity": 0.05, "field": 0.2}
    text = explain(
        clamped({"ramp": 0.3}, supply={"resistance": 2.0, "current_limit": 3.0}, leak=leak, permittivity=2.0)
    )
    charging = "dq/dt = (φ_s − φ) / 2 within ±3 − 0.025 exp(|E| / 0.2) q, φ = q / (2 λ⁴)"
    assert f"charge of one: {charging}" in text


def made(**changes: Any) -> dict[str, Any]:
    written: dict[str, Any] = pair(1.0, {"ramp": 0.1}).to_dict()
    written |= {"dynamics": {"relaxation_time": 1.0}, "supply": {"resistance": 1.0}}
    for name, value in changes.items():
        if name in ("active", "passive"):
            (balloon,) = (one for one in written["balloon"] if one["name"] == name)
            balloon.update(value)
        elif value is None:
            del written[name]
        else:
            written[name] = value
    return written


NO_ELECTRODES = "needs electrodes = true on this balloon"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"supply": {}}, "supply.resistance: is missing, must be a number > 0, or a table with one"),
        ({"supply": {"resistance": 0}}, "supply.resistance = 0: must be a number > 0, or a table with one"),
        (
            {"supply": {"resistance": "10 MΩ"}},
            'supply.resistance = "10 MΩ": must be a number > 0, or a table with one for every balloon with '
            "electrodes by name; a unit needs [scales]",
        ),
        (
            {"supply": {"resistance": {"passive": 1.0}}},
            "supply.resistance.passive = 1.0: has no electrodes, must be one of active",
        ),
        (
            {"supply": {"resistance": {"passive": 1.0}}},
            "supply.resistance.active: is missing, must be a number > 0",
        ),
        (
            {"supply": {"resistance": 1.0, "current_limit": {"actve": 1.0}}},
            "supply.current_limit.actve = 1.0: no such balloon, must be one of active",
        ),
        (
            {"supply": {"resistance": 1.0, "current": 1.0}},
            "supply.current = 1.0: unknown key, allowed here: resistance, current_limit",
        ),
        ({"dynamics": None}, 'supply = {"resistance": 1.0}: needs [dynamics] with a relaxation_time'),
        ({"active": {"leak": {"conductivity": -1}}}, "leak.conductivity = -1: must be a number > 0"),
        ({"active": {"leak": 3}}, "leak = 3: must be a table of conductivity, field"),
        ({"passive": {"leak": {"conductivity": 1.0}}}, f"balloon.passive.leak = {{…}}: {NO_ELECTRODES}"),
        (
            {"active": {"leak": {"conductivity": 1.0}}, "supply": None},
            'balloon.active.leak = {"conductivity": 1.0}: needs [supply] with a resistance',
        ),
    ],
)
def test_what_makes_no_sense_is_said(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError) as error:
        load_scenario(made(**changes))
    assert message.replace("{…}", '{"conductivity": 1.0}') in str(error.value)


def test_equal_films_stay_alike_though_one_has_a_strength() -> None:
    written = made()
    films = [{**written["balloon"][0], "name": name, "electrodes": True} for name in ("a", "b")]
    films[0]["breakdown"] = {"field": 100.0}
    history = run(load_scenario({**written, "balloon": films, "step": [{"inflate": 1.0}, {"ramp": 0.3}]}))
    assert np.array_equal(history.stretch[:, 0], history.stretch[:, 1])


def test_a_film_of_any_size_is_charged_against_either_sign() -> None:
    """c = r²e/h, and a current limit holds for both directions."""
    supply = {"resistance": 2.0, "current_limit": 0.1}
    film = {"radius": 1.3, "thickness": 0.7, "permittivity": 1.9}
    history = run(clamped({"jump": -0.5}, {"hold": 20.0}, supply=supply, **film))
    capacitance = 1.3**2 * 1.9 / 0.7
    turn = capacitance * (0.5 - 0.2) / 0.1
    t = history.time[2:]
    exact = np.where(t < turn, -0.1 * t / capacitance, -0.5 + 0.2 * np.exp(-(t - turn) / (2.0 * capacitance)))
    assert history.voltage[2:, 0] == pytest.approx(exact, abs=1e-8)


def test_a_film_of_any_size_moves_as_under_its_voltage() -> None:
    """At rest behind a resistance it is where the voltage alone holds it; the books close on the way."""
    film = {"radius": 1.3, "thickness": 0.7, "permittivity": 1.9, "modulus": 1.4}
    steps: dict[str, Any] = {
        "step": [{"inflate": 1.0}, {"ramp": 0.3, "over": 1.0}, {"hold": 30.0}],
        "dynamics": {"relaxation_time": 0.05},
    }
    behind = run(load_scenario(made(active=film, supply={"resistance": 0.01}, **steps)))
    given = run(load_scenario(made(active=film, supply=None, **steps)))
    assert behind.stretch[-1] == pytest.approx(given.stretch[-1], abs=1e-7)
    assert behind.energy_balance.relative_imbalance < 1e-8
