"""The closed form against the paper's numbers, against 40-digit arithmetic, and against itself."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import mpmath
import numpy as np
import pytest

from simulator import load_scenario
from simulator.model.elastomers import Gent, NeoHookean
from tests.oracle.closed_form import (
    Balloon,
    Curve,
    Jump,
    Point,
    SealedPair,
    State,
    balloon_pressure,
    equilibria,
    equilibrium_curve,
    inflated_stretch,
    inflation_extrema,
    inflation_history,
    overdamped_flow,
    reference_history,
    states_on,
    stretches_at,
)

GENT = Gent(100.0)

# The paper's states: radius of the active balloon, ambient pressure, inflation pressure.
ROWS = {
    "3a A": (1.0, 1.0, 0.6),
    "3a B": (1.0, 1.0, 1.2),
    "3a C": (1.0, 1.0, 1.3),
    "3b A": (1.0, 0.2, 0.6),
    "3b B": (1.0, 0.2, 1.2),
    "3c A": (1.0, 0.015, 0.6),
    "3c B": (1.0, 0.015, 1.2),
    "5b A": (0.5, 1.0, 1.2),
    "5b B": (0.5, 1.0, 2.4),
    "5b C": (0.5, 1.0, 2.6),
    "5c A": (0.5, 0.05, 1.2),
    "5c B": (0.5, 0.05, 2.4),
}


def paper(row: str) -> SealedPair:
    radius, ambient, pressure = ROWS[row]
    return SealedPair.inflated(Balloon(GENT, radius=radius), Balloon(GENT), ambient, pressure)


def random_pair(seed: int) -> SealedPair:
    """A pair from the range of `tests/fuzz`."""
    rng = np.random.default_rng(seed)

    def ratio(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    def balloon(radius: float) -> Balloon:
        return Balloon(Gent(float(rng.uniform(20.0, 500.0))), radius, *(ratio(0.3, 3.0) for _ in range(3)))

    ambient, pressure = float(rng.uniform(0.0, 5.0)) ** 3 / 25.0, float(rng.uniform(0.05, 3.0))
    return SealedPair.inflated(balloon(ratio(0.1, 5.0)), balloon(1.0), ambient, pressure)


# -- one balloon ---------------------------------------------------------------------------------------


def test_inflation_curve_of_the_paper() -> None:
    peak, valley = inflation_extrema(Balloon(GENT))
    assert (peak.kind, valley.kind) == ("peak", "valley")
    assert peak[1:] == pytest.approx((1.3972265514868307, 1.2536545513298676), rel=1e-15)
    assert valley[1:] == pytest.approx((4.1418301854817181, 0.7028725315), abs=1e-10)
    assert valley.stretch == pytest.approx(4.1418301854817181, rel=1e-15)


@pytest.mark.parametrize(
    ("load", "stretch"),
    [
        (0.6, 1.0663209767),
        (1.2, 1.2625778856),
        (1.3, 6.2622961110),
        (2.4, 6.7312545747),
        (2.6, 6.7688780931),
    ],
)
def test_inflated_states_of_the_paper(load: float, stretch: float) -> None:
    assert inflated_stretch(Balloon(GENT, radius=0.5), load / 0.5) == pytest.approx(stretch, abs=1e-6)
    thick = Balloon(GENT, thickness=2.0, modulus=3.0)
    assert balloon_pressure(thick, inflated_stretch(thick, 6.0 * load)) == pytest.approx(
        6.0 * load, rel=1e-13
    )


def test_neo_hookean_balloon_has_a_peak_and_runs_away() -> None:
    (peak,) = inflation_extrema(Balloon(NeoHookean()))
    assert peak[1:] == pytest.approx((7 ** (1 / 6), 2 * (7 ** (-1 / 6) - 7 ** (-7 / 6))), rel=1e-15)
    assert len(stretches_at(Balloon(NeoHookean()), 1.0)) == 2
    with pytest.raises(ValueError, match="no equilibrium"):
        inflated_stretch(Balloon(NeoHookean()), 1.3)
    (snap,) = inflation_history(Balloon(NeoHookean()), [1.3])[1]
    assert snap.after is None


@pytest.mark.parametrize(("J_lim", "count"), [(17.6, 0), (17.63, 0), (17.64, 2), (17.7, 2)])
def test_peak_and_valley_merge(J_lim: float, count: int) -> None:
    assert len(inflation_extrema(Balloon(Gent(J_lim)))) == count


def test_inflation_and_deflation_snap_at_peak_and_valley() -> None:
    peak, valley = inflation_extrema(Balloon(GENT))
    end, snaps = inflation_history(Balloon(GENT), [1.3, 0.9, 0.5, 1.2])
    assert [(s.leg, s.pressure, s.before) for s in snaps] == [
        (0, peak.pressure, peak.stretch),
        (2, valley.pressure, valley.stretch),
    ]
    assert end == pytest.approx(1.2625778856, abs=1e-10)
    for snap in snaps:
        assert snap.after is not None
        assert balloon_pressure(Balloon(GENT), snap.after) == pytest.approx(snap.pressure, rel=1e-13)
    # Exactly up to the peak: no snap yet. Back below the valley is needed to return.
    assert inflation_history(Balloon(GENT), [peak.pressure]) == (peak.stretch, ())
    assert inflation_history(Balloon(GENT), [1.3, 0.71])[0] == pytest.approx(
        stretches_at(Balloon(GENT), 0.71)[2]
    )


# -- the paper's table ---------------------------------------------------------------------------------

LIMIT_POINTS = {
    "3a A": [],
    "3a B": [],
    "3a C": [],
    "3b A": [(0.58183674, 1.41147571)],
    "3b B": [(0.39531863, 2.12041303)],
    "3c A": [(0.56141475, 1.38524402)],
    "3c B": [(0.36044087, 2.05451214), (0.27029133, 4.94359252)],
    "5b A": [(0.49689270, 1.32056430), (0.35148240, 2.66087942), (0.35168963, 2.91696383)],
    "5b B": [(0.1392539713850276, 1.3886327743259)],
    "5b C": [],
    "5c A": [(0.49619765, 1.31914474), (0.26332926, 4.73611228)],
    "5c B": [(0.13914986, 1.38848331)],
}


@pytest.mark.parametrize("row", ROWS)
def test_limit_points_of_the_paper(row: str) -> None:
    found = [(p.voltage, p.state.active) for p in equilibrium_curve(paper(row)).limit_points]
    assert len(found) == len(LIMIT_POINTS[row])
    for point, (voltage, stretch) in zip(found, LIMIT_POINTS[row], strict=True):
        assert point[0] == pytest.approx(voltage, abs=6e-9)
        assert point[1] == pytest.approx(stretch, abs=1e-6)  # the table's places are good to that


@pytest.mark.parametrize(
    ("row", "voltage", "stretch"),
    [
        ("3a A", 0.66343884, 1.42273100),
        ("3a B", 0.51182337, 1.98790939),
        ("3b A", 0.49689606, 2.05667863),
        ("3b B", 0.36071083, 3.00655999),
        ("3c A", 0.27875742, 4.61702739),
        ("3c B", 0.50037230, 6.87572519),
        ("5b A", 0.35135102, 3.11035532),
    ],
)
def test_loss_of_tension_on_the_whole_curve(row: str, voltage: float, stretch: float) -> None:
    lost = equilibrium_curve(paper(row)).loss_of_tension
    assert lost is not None
    assert lost.voltage == pytest.approx(voltage, abs=6e-9)
    assert lost.state == pytest.approx((stretch, 1.0, 0.0), abs=6e-9)


@pytest.mark.parametrize("row", ["3a C", "5b B", "5b C", "5c A", "5c B"])
def test_where_no_tension_is_lost(row: str) -> None:
    assert equilibrium_curve(paper(row)).loss_of_tension is None


def test_switched_off_after_the_snap_of_5b_B() -> None:
    found = equilibria(equilibrium_curve(paper("5b B")), 0.0)
    assert [e.unstable for e in found] == [0, 1, 0]
    assert found[0].state == pytest.approx((1.2625778856, 6.7312545747, 2.4), abs=1e-6)
    assert found[2].state == pytest.approx((6.02643177, 6.68235866, 2.18594438), abs=6e-9)


def test_three_equilibria_beside_the_touching_folds_of_5b_A() -> None:
    curve = equilibrium_curve(paper("5b A"))
    counts = [len(equilibria(curve, v)) for v in (0.3513, 0.3514, 0.3515, 0.3516, 0.3517)]
    assert counts == [1, 2, 4, 4, 2]
    assert [e.unstable for e in equilibria(curve, 0.3516)] == [0, 1, 0, 1]


# -- 40 digits -----------------------------------------------------------------------------------------


class Digits:
    """The closed form as physics has it, over λ₂, in 40 digits."""

    def __init__(self, pair: SealedPair, pressure: float) -> None:
        mp = mpmath.mpf
        self.one, self.two = (
            {key: mp(getattr(b, key)) for key in ("radius", "thickness", "modulus", "permittivity")}
            | {"J": mp(b.elastomer.J_lim)}  # type: ignore[attr-defined]
            for b in (pair.active, pair.passive)
        )
        self.ambient = mp(pair.ambient)
        inflated = [
            mpmath.findroot(lambda x, b=b: self.pressure(b, x) - mp(pressure), mp(guess))
            for b, guess in ((self.one, pair.sealed.active), (self.two, pair.sealed.passive))
        ]
        cubes = self.one["radius"] ** 3 * inflated[0] ** 3 + self.two["radius"] ** 3 * inflated[1] ** 3
        self.gas = (mp(pressure) + self.ambient) * cubes

    @staticmethod
    def force(b: dict[str, Any], x: Any) -> Any:
        return 2 * b["J"] * (x - x**-5) / (b["J"] - (2 * x**2 + x**-4 - 3))

    def pressure(self, b: dict[str, Any], x: Any) -> Any:
        return b["modulus"] * b["thickness"] * self.force(b, x) / (b["radius"] * x * x)

    def active(self, passive: Any) -> Any:
        rest = (
            self.gas / (self.pressure(self.two, passive) + self.ambient)
            - self.two["radius"] ** 3 * passive**3
        )
        return mpmath.cbrt(rest / self.one["radius"] ** 3)

    def square(self, passive: Any) -> Any:
        b, x, p = self.one, self.active(passive), self.pressure(self.two, passive)
        force = b["modulus"] * self.force(b, x) - b["radius"] / b["thickness"] * p * x * x
        return force * b["thickness"] ** 2 / (2 * b["permittivity"] * x**3)

    def limit_point(self, near: Point) -> tuple[Any, ...]:
        z = mpmath.mpf(near.state.passive)
        for offset in (1e-17, 1e-20):
            start = (z, z * (1 + mpmath.mpf(offset)))
            z = mpmath.findroot(lambda z: mpmath.diff(self.square, z), start, tol=1e-30, verify=False)
        return self.active(z), z, self.pressure(self.two, z), mpmath.sqrt(self.square(z))


def distance(point: Point, digits: tuple[Any, ...]) -> float:
    return float(max(abs(a - b) for a, b in zip((*point.state, point.voltage), digits, strict=True)))


@pytest.fixture(autouse=True)
def _many_digits() -> Any:
    with mpmath.workdps(50):
        yield


@pytest.mark.parametrize("row", ["3b A", "3c B", "5b A", "5b B", "5c A", "5c B"])
def test_limit_points_to_rounding(row: str) -> None:
    digits = Digits(paper(row), ROWS[row][2])
    for point in equilibrium_curve(paper(row)).limit_points:
        assert distance(point, digits.limit_point(point)) < 4e-15


def test_limit_points_of_random_pairs_to_rounding() -> None:
    found = 0
    for seed in range(25):
        pair = random_pair(seed)
        digits = Digits(pair, pair.sealed.pressure)
        for point in equilibrium_curve(pair).limit_points:
            assert distance(point, digits.limit_point(point)) < 1e-13, seed
            found += 1
    assert found > 10


@pytest.mark.parametrize("row", ["3c B", "5b B"])
def test_states_to_rounding(row: str) -> None:
    pair = paper(row)
    digits = Digits(pair, ROWS[row][2])
    for segment in equilibrium_curve(pair).segments:
        low, high = segment.voltages
        voltages = np.linspace(low, min(high, 1.0), 7)[1:-1]
        for voltage, state in zip(voltages, states_on(pair, segment, voltages).T, strict=True):
            square = mpmath.mpf(float(voltage)) ** 2
            z = mpmath.mpf(float(state[1]))
            z = mpmath.findroot(lambda z, q=square: digits.square(z) - q, (z, z * (1 + mpmath.mpf("1e-17"))))
            exact = (digits.active(z), z, digits.pressure(digits.two, z))
            assert float(max(abs(a - b) for a, b in zip(state.tolist(), exact, strict=True))) < 2e-14


@pytest.mark.parametrize("ambient", [1e6, 1e-9, 0.0023])
def test_loss_of_tension_to_rounding(ambient: float) -> None:
    """Few digits are left of p in (p + pₑ)V at high ambient pressure, and of V − V₀ at a low one."""
    active = Balloon(Gent(1e4), radius=1.7)
    pair = SealedPair.inflated(active, Balloon(GENT), ambient, 0.32)
    lost = equilibrium_curve(pair).loss_of_tension
    digits = Digits(pair, 0.32)
    stretch = digits.active(mpmath.mpf(1))
    if stretch > active.elastomer.stretch_limit:
        assert lost is None
    else:
        assert lost is not None
        assert distance(lost, (stretch, 1, 0, mpmath.sqrt(digits.square(mpmath.mpf(1))))) < 1e-14


def test_stretch_limit_at_huge_voltage() -> None:
    pair = paper("3a C")
    (found,) = equilibria(equilibrium_curve(pair), 1e4)
    gap = GENT.stretch_limit - found.state.active
    # D = f D/(2φ²λ³) with D ≈ |D′| (λ_lim − λ): the balloon is 1e-9 below its limit.
    n, _ = GENT.pole_form(found.state.active)
    assert gap == pytest.approx(
        n / (2e8 * found.state.active**3 * -GENT.pole_form_slope(7.1763)[1]), rel=1e-3
    )


# -- consistency ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_forces_are_derivatives_of_the_potential(seed: int) -> None:
    pair = random_pair(seed)
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(1.1, 3.0, 2)
    voltage = 0.3
    forces = pair.forces(a, b, pair.pressure(a, b), voltage)
    for i, (balloon, force) in enumerate(zip((pair.active, pair.passive), forces, strict=True)):
        x = [complex(a), complex(b)]
        x[i] += 1e-30j
        slope = pair.potential(State(x[0], x[1], 0.0), voltage).imag / 1e-30  # type: ignore[arg-type]
        scale = balloon.radius**2 * balloon.thickness
        assert slope == pytest.approx(scale * force, rel=1e-12, abs=1e-13 * scale)


def check_curve(curve: Curve) -> None:
    """What must hold of every curve."""
    pair = curve.pair
    for point in curve.limit_points:
        values = np.abs(np.linalg.eigvalsh(pair.hessian(point.state, point.voltage)))
        assert values[0] < 1e-12 * values[1] * max(1.0, point.state.active)
    for segment in curve.segments:
        assert np.all(np.diff(segment.squares[np.isfinite(segment.squares)]) >= 0.0)
        turns = np.diff(segment.nodes[1])
        assert np.all(turns >= 0.0) or np.all(turns <= 0.0)  # λ₂ orders the curve
        low, high = segment.voltages
        high = min(high, low + 3.0)
        for voltage in (0.7 * low + 0.3 * high, 0.4 * low + 0.6 * high):
            state = State(*states_on(pair, segment, [voltage])[:, 0].tolist())
            assert np.sum(np.linalg.eigvalsh(pair.hessian(state, voltage)) < 0.0) == segment.unstable
            for balloon, force, x in zip(
                (pair.active, pair.passive), pair.forces(*state, voltage), state[:2], strict=True
            ):
                n, d = balloon.elastomer.pole_form(x)
                assert abs(force * d) < 1e-12 * balloon.modulus * max(1.0, n / d, state.pressure * x)
            assert pair.pressure(*state[:2]) == pytest.approx(state.pressure, rel=1e-12, abs=1e-13)
    for one, other in pairwise(curve.segments):
        if {one.end(0), one.end(-1)} & {other.end(0), other.end(-1)}:
            assert abs(one.unstable - other.unstable) == 1  # stability is exchanged in a limit point


@pytest.mark.parametrize("row", ROWS)
def test_curves_of_the_paper_are_consistent(row: str) -> None:
    check_curve(equilibrium_curve(paper(row)))


def test_curves_of_random_pairs_are_consistent() -> None:
    for seed in range(40):
        check_curve(equilibrium_curve(random_pair(seed)))


def test_no_limit_point_is_missed() -> None:
    """φ² over λ₂ as physics has it, sixty points between each two nodes, has no other extrema."""
    found = 0
    for seed in range(40):
        pair = random_pair(seed)
        curve = equilibrium_curve(pair)
        nodes = np.unique(np.concatenate([segment.nodes[1] for segment in curve.segments]))
        z = np.unique((nodes[:-1, None] + np.diff(nodes)[:, None] * np.linspace(0.0, 1.0, 61)).ravel())
        p = np.asarray(balloon_pressure(pair.passive, z))
        x = np.cbrt((3.0 * pair.amount / (p + pair.ambient) - pair.passive.cube * z**3) / pair.active.cube)
        inside = (x > 1.0) & (x < pair.active.elastomer.stretch_limit)
        x[~inside] = np.nan
        n, d = pair.active.elastomer.pole_form(x)
        q = (n / d - pair.active.pressure_load * p * x * x) / (pair.active.electric_load * x**3)
        q[q < 0.0] = np.nan
        if pair.active.radius < 0.5:  # λ₂ alone loses too many digits there
            continue
        step = np.sign(np.diff(q))
        extrema = np.flatnonzero(step[1:] * step[:-1] < 0.0) + 1
        assert extrema.size == sum(point.voltage > 0.0 for point in curve.limit_points), seed
        found += extrema.size
    assert found > 5


def test_gas_given_by_amount_or_by_scenario() -> None:
    pair = paper("3c B")
    same = SealedPair.with_gas(pair.active, pair.passive, pair.ambient, pair.amount)
    for one, other in zip(
        equilibrium_curve(pair).limit_points, equilibrium_curve(same).limit_points, strict=True
    ):
        assert one.state == pytest.approx(other.state, abs=1e-13)
    gent = {"model": "gent", "J_lim": 100}
    written: dict[str, Any] = {
        "title": "3c B, the passive balloon first",
        "gas": {"ambient_pressure": 0.015},
        "balloon": [
            {"name": "passive", "elastomer": gent},
            {"name": "active", "electrodes": True, "elastomer": gent, "breakdown": {"field": 12.0}},
        ],
        "step": [{"inflate": 0.4}, {"inflate": 1.2}, {"ramp": 0.1}],
    }
    scenario = SealedPair.from_scenario(load_scenario(written))
    assert scenario.sealed == pair.sealed
    assert scenario.active.breakdown == 12.0
    written["balloon"][0]["electrodes"] = True
    with pytest.raises(ValueError, match="one of them with electrodes"):
        SealedPair.from_scenario(load_scenario(written))


def test_what_makes_no_sense() -> None:
    with pytest.raises(ValueError, match="runs away"):
        SealedPair.inflated(Balloon(NeoHookean()), Balloon(GENT), 1.0, 1.3)
    with pytest.raises(ValueError, match="without gas"):
        equilibrium_curve(SealedPair.inflated(Balloon(GENT), Balloon(GENT), 0.0, 0.0))


# -- histories -----------------------------------------------------------------------------------------


LIMIT, SLACK = "limit_point", "loss_of_tension"
HISTORIES: list[tuple[str, list[float], list[tuple[str, float, float, float | None]]]] = [
    ("3a A", [0.8], [(SLACK, 0.66343884, 1.42273100, None)]),
    ("3a B", [0.8], [(SLACK, 0.51182337, 1.98790939, None)]),
    ("3a C", [0.2, 0.0], []),
    ("3b A", [0.7], [(LIMIT, 0.58183674, 1.41147571, 2.0560809), (SLACK, 0.58183674, 2.0560809, None)]),
    ("3b B", [0.7], [(LIMIT, 0.39531863, 2.12041303, 3.0063684), (SLACK, 0.39531863, 3.0063684, None)]),
    ("3c A", [0.7], [(LIMIT, 0.56141475, 1.38524402, 4.6168567), (SLACK, 0.56141475, 4.6168567, None)]),
    (
        "3c B",
        [0.4, 0.0],
        [(LIMIT, 0.36044087, 2.05451214, 6.51514013), (LIMIT, 0.27029133, 4.94359252, 1.45301845)],
    ),
    ("5b A", [0.6], [(LIMIT, 0.49689270, 1.32056430, 3.0697351), (SLACK, 0.49689270, 3.0697351, None)]),
    ("5b B", [0.2, 0.0], [(LIMIT, 0.13925397, 1.38863277, 6.28273905)]),
    ("5b C", [0.2, 0.0], []),
    (
        "5c A",
        [0.6, 0.0],
        [(LIMIT, 0.49619765, 1.31914474, 6.87078010), (LIMIT, 0.26332926, 4.73611228, 1.09171969)],
    ),
    ("5c B", [0.2, 0.0], [(LIMIT, 0.13914986, 1.38848331, 6.30501350)]),
]


@pytest.mark.parametrize(("row", "turns", "events"), HISTORIES)
def test_histories_of_the_paper(
    row: str, turns: list[float], events: list[tuple[str, float, float, float | None]]
) -> None:
    history = reference_history(paper(row), turns)
    assert [event.kind for event in history.events] == [event[0] for event in events]
    for event, (_, voltage, before, after) in zip(history.events, events, strict=True):
        assert event.voltage == pytest.approx(voltage, abs=6e-9)
        assert event.before.active == pytest.approx(before, abs=1e-6)
        assert (event.after.active if event.after else None) == pytest.approx(after, abs=1e-6)
    assert history.outcome == ("loss_of_tension" if "loss_of_tension" in str(events) else "completed")
    mirrored = reference_history(paper(row), [-v for v in turns])
    assert mirrored.state == history.state
    assert [event.voltage for event in mirrored.events] == [-event.voltage for event in history.events]


def test_loop_of_3c_B_dissipates_the_work_done_on_it() -> None:
    pair = paper("3c B")
    history = reference_history(pair, [0.4, 0.0])
    lost = [event.dissipated for event in history.events]
    assert lost == pytest.approx([37.383002, 3.447524], abs=6e-7)
    # ∮ φ dq = −∮ q dφ over the three stays.
    work = 0.0
    up, down = (event.voltage for event in history.events)
    stops = [(0.0, up), (up, 0.4), (0.4, down), (down, 0.0)]
    points, weights = np.polynomial.legendre.leggauss(40)
    for segment, (start, end) in zip((0, 1, 1, 2), stops, strict=True):
        # Squares crowd towards a limit point, where the state moves like a square root.
        t = 0.5 + 0.5 * points
        share = 1.0 - (1.0 - t * t) ** 2 if start > end else (1.0 - (1.0 - t) ** 2)
        rate = 4.0 * t * (1.0 - t * t) if start > end else 2.0 * (1.0 - t)
        voltages = start + (end - start) * share
        stretch = states_on(pair, history.segments[segment], voltages)[0]
        work -= float(np.sum(0.5 * weights * rate * (end - start) * voltages * stretch**4))
    assert work == pytest.approx(40.830526, abs=6e-7)
    assert history.state == pytest.approx(pair.sealed, abs=1e-12)


def test_voltage_through_zero_stays_on_its_branch() -> None:
    history = reference_history(paper("3c B"), [0.4, -0.1, 0.1])
    assert [(e.kind, e.leg, round(e.voltage, 8)) for e in history.events] == [
        ("limit_point", 0, 0.36044087),
        ("limit_point", 1, 0.27029133),
    ]
    negative = reference_history(paper("3c B"), [-0.4, 0.1])
    assert [round(e.voltage, 8) for e in negative.events] == [-0.36044087, -0.27029133]
    assert history.state == negative.state


def test_turning_round_at_a_limit_point_is_no_event() -> None:
    pair = paper("3c B")
    fold = equilibrium_curve(pair).limit_points[0].voltage
    history = reference_history(pair, [fold, 0.0])
    assert history.events == ()
    assert min(margin.size for margin in history.margins) == 0.0
    beyond = reference_history(pair, [fold * (1.0 + 1e-12), 0.0])
    assert [e.kind for e in beyond.events] == ["limit_point", "limit_point"]


def test_jumps() -> None:
    pair = paper("5b B")
    history = reference_history(pair, [0.2, Jump(0.0)])
    assert [event.kind for event in history.events] == ["limit_point", "jump"]
    assert history.state == reference_history(pair, [0.2, 0.0]).state
    (jump,) = reference_history(pair, [Jump(0.2)]).events
    assert jump.before == pytest.approx(pair.sealed, abs=1e-13)
    assert jump.after == reference_history(pair, [0.2]).state
    assert reference_history(pair, [Jump(0.0)]).events == ()


@pytest.mark.parametrize("ambient", [0.0, 1.0])
def test_sealed_without_pressure(ambient: float) -> None:
    pair = SealedPair.inflated(Balloon(GENT), Balloon(GENT), ambient, 0.0)
    history = reference_history(pair, [0.0, 0.3])
    assert [(e.kind, e.leg, e.voltage) for e in history.events] == [("loss_of_tension", 1, 0.0)]
    assert reference_history(pair, [0.0]).outcome == "completed"


def breaking(row: str, field: float) -> SealedPair:
    radius, ambient, pressure = ROWS[row]
    active = Balloon(GENT, radius=radius, breakdown=field)
    return SealedPair.inflated(active, Balloon(GENT), ambient, pressure)


def test_breakdown_on_a_branch() -> None:
    history = reference_history(breaking("3a C", 10.0), [0.2, 0.5])
    assert history.outcome == "breakdown"
    (event,) = history.events
    assert event.voltage * event.before.active**2 == pytest.approx(10.0, rel=1e-14)


def test_breakdown_in_a_snap() -> None:
    history = reference_history(breaking("3c B", 6.0), [0.4])
    assert [event.kind for event in history.events] == ["limit_point", "breakdown"]
    assert history.events[1].voltage * history.events[1].before.active ** 2 == pytest.approx(6.0, rel=1e-8)
    landing = reference_history(paper("3c B"), [0.4]).events[0]
    assert landing.after is not None
    strength = landing.voltage * landing.after.active**2
    # Just beyond what the landing takes, the snap is survived, and the film breaks a little later.
    assert len(reference_history(breaking("3c B", strength * (1.0 + 1e-7)), [0.4]).segments) == 2
    assert len(reference_history(breaking("3c B", strength * (1.0 - 1e-7)), [0.4]).segments) == 1


def test_flow_against_the_same_flow_in_time() -> None:
    """Where a snap loses its tension depends on the whole way; two methods agree on it."""
    from scipy.integrate import solve_ivp

    pair = paper("3b A")
    fold = equilibrium_curve(pair).limit_points[0]
    history = reference_history(pair, [0.7])
    lost = history.events[0].after
    assert lost is not None

    def rates(t: float, x: Any) -> list[float]:
        return [-g for g in pair.forces(x[0], x[1], pair.pressure(x[0], x[1]), fold.voltage)]

    def tension(t: float, x: Any) -> float:
        return float(pair.pressure(x[0], x[1]))

    tension.terminal = True  # type: ignore[attr-defined]
    values, vectors = np.linalg.eigh(pair.hessian(fold.state, fold.voltage))
    mode = vectors[:, np.argmin(np.abs(values))]
    start = np.array(fold.state[:2]) + 1e-3 * np.sign(mode[0]) * mode
    result = solve_ivp(rates, (0.0, 1e6), start, method="LSODA", rtol=1e-11, atol=1e-13, events=tension)
    assert result.y_events[0][0] == pytest.approx(lost[:2], abs=1e-7)


def test_flow_passes_by_where_there_is_no_rest() -> None:
    pair = paper("3c B")
    curve = equilibrium_curve(pair)
    found = [e.state for e in equilibria(curve, 0.1)]
    rests = [e.state for e in equilibria(curve, 0.1) if not e.unstable]
    flow = overdamped_flow(pair, 0.1, np.array([6.0, 1.01]), rests, found)
    assert flow.end is None
    assert flow.state == rests[0]


def test_two_snaps_in_a_row_with_soft_modes_in_both_balloons() -> None:
    """The second limit point belongs to the passive balloon: its mode hardly moves the active one."""
    active = Balloon(
        Gent(417.6239004228776),
        radius=0.9221241288315883,
        thickness=0.32814042669053173,
        modulus=2.216571141823128,
        permittivity=0.6289174587592145,
    )
    passive = Balloon(Gent(161.69764985355843), 1.0, 0.43314103843413604, 0.5342740699337578)
    pair = SealedPair.inflated(active, passive, 2.3105696449672015, 0.9763430617336897)
    history = reference_history(pair, [0.3854820990610529])
    assert [(event.kind, round(event.voltage, 9)) for event in history.events] == [
        ("limit_point", 0.028424137),
        ("limit_point", 0.063737972),
        ("loss_of_tension", 0.085122656),
    ]
    assert history.events[1].after is not None
    assert history.events[1].before.passive - history.events[1].after.passive > 3.9
