"""Equal balloons: they part as balloons do whose radii differ by a millionth, the first being the largest."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simulator import Event, EventKind, History, Outcome, load_scenario, simulate

PEAK, VALLEY = 1.2536545513298676, 0.7028725314932649
GENT = {"model": "gent", "J_lim": 100.0}


def device(count: int, steps: list[dict[str, Any]], *, apart: float = 0.0, **gas: float) -> dict[str, Any]:
    """So many equal balloons, or with radii that differ by so much, the largest first."""
    return {
        "title": "equal",
        "gas": {"ambient_pressure": 0.0, **gas},
        "balloon": [
            {
                "name": f"b{i}",
                "electrodes": True,
                "radius": 1.0 + apart * (count - 1 - i) / max(count - 1, 1),
                "elastomer": GENT,
            }
            for i in range(count)
        ],
        "step": steps,
        "shape": {"on_loss": "ignore"},
    }


def played(count: int, steps: list[dict[str, Any]], **more: Any) -> History:
    return simulate(load_scenario(device(count, steps, **more)))


def happened(history: History) -> list[Event]:
    """What happened after the inflation: an equal set passes its peak at once, others one after the other."""
    return [event for event in history.events if event.step > 1]


def gent(x: float) -> tuple[float, float]:
    """f and f′ of a Gent balloon with J = 100."""
    rest = 100.0 - (2.0 * x**2 + x**-4 - 3.0)
    top, slope = x - x**-5, 1.0 + 5.0 * x**-6
    return 200.0 * top / rest, 200.0 * (slope / rest + top * (4.0 * x - 4.0 * x**-5) / rest**2)


@pytest.mark.parametrize("count", [2, 5])
@pytest.mark.parametrize(
    "steps",
    [
        [{"inflate": 0.3}, {"jump": 2.732}, {"ramp": -0.1532}],  # one after the other shrinks
        [
            {"inflate": 0.03},
            {"ramp": 0.8},
        ],  # one after the other grows, in a gas so thin that they hardly feel it
    ],
    ids=["falling", "thin gas"],
)
def test_they_part_like_balloons_that_are_nearly_equal(count: int, steps: list[dict[str, Any]]) -> None:
    equal, nearly = happened(played(count, steps)), happened(played(count, steps, apart=1e-5))
    assert len(equal) == len(nearly) >= count
    for one, other in zip(equal, nearly, strict=True):
        assert one.voltage[0] == pytest.approx(other.voltage[0], abs=3e-6)
        assert one.stretch_after == pytest.approx(other.stretch_after, abs=2e-4)
        assert one.kind in (other.kind, EventKind.BRANCH_POINT)


def test_a_branch_point_is_where_a_balloon_is_soft_at_its_pressure() -> None:
    """f′ − 2f/λ = 2φ²λ² there, with λ²p = f − 2φ²λ³."""
    history = played(5, [{"inflate": 0.3}, {"jump": 2.732}, {"ramp": -0.1532}])
    parting = [event for event in history.events if event.kind is EventKind.BRANCH_POINT]
    assert len(parting) == 4
    for event in parting:
        x, voltage = float(event.stretch_before[0]), float(event.voltage[0])
        force, slope = gent(x)
        pressure = (force - 2.0 * voltage**2 * x**3) / x**2
        assert event.pressure_before == pytest.approx(pressure, abs=1e-12)
        # Of those that are still large each is as soft as a single one at its pressure.
        assert slope - 2.0 * force / x == pytest.approx(2.0 * voltage**2 * x**2, abs=1e-10)


@pytest.mark.parametrize(
    ("driven", "kind", "last"),
    [
        (0.2, EventKind.BRANCH_POINT, [4.71184, 4.71184, 1.08686]),
        ({"b2": 0.2}, EventKind.LIMIT_POINT, [4.71184, 1.08686, 4.71184]),
    ],
)
def test_three_sealed_exactly_at_their_valley_part_as_soon_as_a_voltage_comes(
    driven: Any, kind: EventKind, last: list[float]
) -> None:
    """One of them shrinks, the last that the voltage does not help; as with radii a billionth apart.

    A voltage on one of them pushes them apart: a limit point. One on all of them leaves it to chance.
    """
    steps = [{"inflate": 1.4}, {"inflate": VALLEY}, {"ramp": driven}]
    history = played(3, steps, ambient_pressure=1.0)
    event = happened(history)[0]
    assert event.kind is kind
    assert event.time == 2.0
    assert event.stretch_after == pytest.approx(last, abs=1e-5)
    assert history.energy_balance.relative_imbalance < 1e-12


def test_of_a_pair_sealed_at_its_valley_the_one_with_the_voltage_grows() -> None:
    ramp = {"ramp": {"b1": 0.2}, "until": {"stretch": {"b0": 1.2}}}
    history = played(2, [{"inflate": 1.4}, {"inflate": VALLEY}, ramp])
    (event,) = happened(history)
    assert (event.kind, event.time) == (EventKind.LIMIT_POINT, 2.0)
    assert event.stretch_after == pytest.approx([1.09413055, 5.06019526], abs=1e-8)
    assert [stop.reached for stop in history.stops] == ["stretch_b0 = 1.2"]


def test_a_charge_grows_a_balloon_that_a_supply_holds_at_its_valley() -> None:
    """At a given pressure f(λ) = pλ² + 2q²/λ⁵: there λ rises at once, with |q|."""
    charge = {"charge": 5.0, "valve": "open"}
    history = played(1, [{"inflate": 1.4}, {"inflate": VALLEY}, charge])
    assert not happened(history)
    x = float(history.stretch[-1, 0])
    assert x > 4.3
    assert gent(x)[0] == pytest.approx(VALLEY * x**2 + 2.0 * 25.0 / x**5, rel=1e-12)


def test_equal_balloons_that_jump_together_leave_one_behind() -> None:
    steps = [{"inflate": 1.4}, {"inflate": VALLEY}, {"jump": 0.1118}]
    equal, nearly = (
        played(6, steps, ambient_pressure=0.281, chamber=2.072, apart=apart) for apart in (0.0, 1e-9)
    )
    assert equal.outcome is Outcome.COMPLETED
    assert equal.stretch[-1] == pytest.approx(nearly.stretch[-1], abs=2e-4)


def test_three_that_part_and_come_together_again_and_again() -> None:
    elastomer = {"model": "yeoh", "C1": 1.189, "C2": -0.01519, "C3": 0.01013}
    wave = {"low": 0.0, "high": 0.33, "period": 1.0, "cycles": 2}
    document = device(3, [{"inflate": PEAK}, {"triangle": wave}], ambient_pressure=3.608)
    document["balloon"] = [b | {"elastomer": elastomer} for b in document["balloon"]]
    history = simulate(load_scenario(document))
    assert [event.kind.value for event in history.events] == 2 * ["branch_point", "limit_point"]
    for event in history.events[::2]:
        assert event.stretch_after == pytest.approx([1.55495, 1.55495, 1.44404], abs=1e-5)
    assert np.ptp(history.stretch[-1]) < 1e-12
    assert history.energy_balance.relative_imbalance < 1e-12


def test_no_branch_leads_from_a_branch_point_to_somewhere_else() -> None:
    """Newton's method, from a state beside it, finds one far below; so the flow decides."""
    history = simulate(load_scenario(Path(__file__).parent / "cases" / "equal-pair-lands-elsewhere.toml"))
    event = next(event for event in history.events if 5.0 < event.stretch_before[0] < 5.8)
    assert event.stretch_after == pytest.approx([5.77188, 5.71908, 1.01072], abs=1e-5)
    assert history.energy_balance.relative_imbalance < 1e-12


@pytest.mark.parametrize("maxwell", [None, {"modulus": 0.5, "time": 3.0}])
def test_in_motion_equal_balloons_stay_alike_also_where_that_is_unstable(maxwell: Any) -> None:
    """Each is then as one alone on its share of the gas."""
    steps = [{"inflate": 1.0, "over": 10.0}, {"ramp": 0.5, "over": 20.0}, {"hold": 200.0}]

    def moved(count: int) -> History:
        document = device(count, steps, ambient_pressure=0.05)
        document["dynamics"] = {"relaxation_time": 0.1}
        if maxwell:
            document["balloon"] = [b | {"maxwell": maxwell} for b in document["balloon"]]
        return simulate(load_scenario(document))

    together, alone = moved(3), moved(1)
    # At once, with its branch, the film is stiff enough to hold them together.
    assert [event.kind for event in together.events] == ([] if maxwell else [EventKind.LIMIT_POINT])
    assert np.all(together.stretch == together.stretch[:, :1])
    both, here, there = np.intersect1d(together.time, alone.time, return_indices=True)
    assert both.size > 290
    assert together.stretch[here, 0] == pytest.approx(alone.stretch[there, 0], abs=1e-7)


def test_in_motion_slow_equal_balloons_take_no_more_steps_than_one_alone() -> None:
    """Slow against the relaxation time, what parts equal balloons is stiff, although it is not there."""
    steps: list[dict[str, Any]] = [
        {"inflate": 3.2, "over": 1e4},
        {"sine": {"mean": 0.0, "amplitude": 0.54, "period": 1e4, "cycles": 2}},
    ]

    def steps_of(count: int) -> int:
        document = device(count, steps, ambient_pressure=0.007)
        document["balloon"] = [b | {"radius": 0.24} for b in document["balloon"]]
        document["dynamics"] = {"relaxation_time": 12.0}
        return simulate(load_scenario(document)).statistics.ida_steps

    assert steps_of(2) < 1.2 * steps_of(1)


@pytest.mark.parametrize("count", [2, 3])
def test_full_of_liquid_they_part_at_the_same_voltage_each_time(count: int) -> None:
    """On stretches that no voltage changes, until they part; and from exactly where they parted before."""
    wave = {"low": 0.0, "high": 0.3885, "period": 1.0, "cycles": 1.65}
    steps: list[dict[str, Any]] = [{"inflate": 1.254}, {"ramp": 0.3591}, {"triangle": wave}]
    steps.insert(0, {"ramp": 0.1494, "valve": "open"})
    document = device(count, steps, ambient_pressure=21.53)
    document["gas"]["law"] = "liquid"
    rubber = {"model": "ogden", "mu": [2.004, 0.004088], "alpha": [2.961, 6.632]}
    document["balloon"] = [b | {"elastomer": rubber} for b in document["balloon"]]
    history = simulate(load_scenario(document))
    assert history.outcome is Outcome.COMPLETED
    partings = [e.voltage[0] for e in history.events if e.kind is EventKind.BRANCH_POINT]
    again = [v for v in partings if v == pytest.approx(partings[0], rel=1e-13)]
    assert len(again) == 3  # as the voltage rises for the first, the second and the third time
    volumes = (history.stretch[history.step == 4] ** 3).sum(axis=1)
    assert volumes == pytest.approx(np.full(volumes.size, volumes[0]), rel=1e-12)
