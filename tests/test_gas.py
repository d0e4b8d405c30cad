"""Gases, chambers and liquids: limits between them, closed forms, conservation, and how they are told."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import null_space
from scipy.optimize import brentq

from simulator import load_scenario
from simulator.analysis.trace import rests, sealed_state, trace, trace_all
from simulator.model.conditions import eigenvalues, softest_mode, stability
from simulator.model.contents import Contents, SealedGas
from simulator.model.coupling import CONSTRAINED, COUPLED
from simulator.model.drive import VoltageLine
from simulator.model.expansion import Adiabat, Isotherm
from simulator.model.liquid import Liquid
from tests.pairs import kinds, pair, run, single
from tests.test_model import device, gradient

UP_AND_DOWN = [{"ramp": 0.4, "over": 10}, {"ramp": 0.0, "over": 10}]
LAWS = {
    "isothermal": {},
    "chamber": {"chamber": 1.0},
    "adiabatic": {"law": "adiabatic"},
    "adiabatic, chamber": {"law": "adiabatic", "chamber": 3.0, "exponent": 1.67},
    "liquid": {"law": "liquid"},
}


def gas(ambient: float = 1.0, **more):
    return {"gas": {"ambient_pressure": ambient, **more}}


# -- equations ------------------------------------------------------------------------------------------

THREE = device()
CONTENTS: dict[str, Contents] = {
    "chamber": SealedGas(0.9, 2.3, 0.3, 0.7, Isotherm()),
    "adiabatic": SealedGas(0.9, 3.0, 0.3, 0.0, Adiabat(1.4)),
    "adiabatic, chamber": SealedGas(0.9, 2.3, 0.3, 0.7, Adiabat(1.67)),
    "liquid": Liquid(1.7),
}
LINES = {
    "three": (THREE, VoltageLine((0.1, 0.0), (0.5, 1.0))),
    "pair": (device(2, (0,)), VoltageLine.common(1)),
}
SYSTEMS = {
    f"{name}, {count}": made.sealed(contents, line)
    for name, contents in CONTENTS.items()
    for count, (made, line) in {**LINES, "one": (device(1, (0,)), VoltageLine.common(1))}.items()
}
stretches = st.lists(st.floats(1.05, 4.5), min_size=3, max_size=3)


@pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS)
@given(stretch=stretches, pressure=st.floats(0.0, 2.0), v=st.floats(-0.5, 0.5))
def test_derivatives(system, stretch, pressure, v):
    """The Jacobian, the force as the slope of Π − pV, and the pressure of a flow with its slopes."""
    count = len(system.walls)
    y = [*stretch[:count], pressure, v]
    residual, rows = system.linearised(y)
    assert residual == pytest.approx(system.residual(y), rel=1e-12, abs=1e-12)
    for i, row in enumerate(rows):
        exact = gradient(lambda z, i=i: system.residual(z)[i], y)
        assert row == pytest.approx(exact, rel=1e-10, abs=1e-10)

    y[-2] = system.gas_pressure(y[:count], v)
    residual, rows = system.linearised(y)
    value, slopes = system.flow_law(y, residual, rows)
    assert value == pytest.approx(0.0, abs=1e-11 * max(1.0, abs(slopes[count] * y[-2])))
    moved = gradient(lambda z: system.gas_pressure(z[:count], v), y)[:count]
    assert [-slope / slopes[count] for slope in slopes[:count]] == pytest.approx(moved, rel=1e-8, abs=1e-9)

    if system.spectrum is COUPLED:
        slope = gradient(system.potential, y)
        for i, wall in enumerate(system.walls):
            force = residual[i] / wall.elastomer.pole_form(y[i])[1]
            assert slope[i] == pytest.approx(wall.weight * force, rel=1e-9, abs=1e-8)


@pytest.mark.parametrize("count", ["three", "pair"])
@given(stretch=stretches, v=st.floats(-0.5, 0.5))
def test_stability_on_constant_volume(count, stretch, v):
    """S projected by an independent basis; the limit of ever stiffer gases; its slope by differences."""
    system = SYSTEMS[f"liquid, {count}"]
    y = np.array([*stretch[: len(system.walls)], 0.7, v])
    diagonal, squares = (np.array(part) for part in system.stiffness(y.tolist()))
    basis = null_space(np.sqrt(squares)[None, :])
    exact = np.linalg.eigvalsh(basis.T @ np.diag(diagonal) @ basis)
    assert eigenvalues(system, y) == pytest.approx(exact, rel=1e-11, abs=1e-11)
    stiff = np.linalg.eigvalsh(np.diag(diagonal) + 1e8 * np.outer(np.sqrt(squares), np.sqrt(squares)))
    assert exact == pytest.approx(stiff[:-1], rel=1e-3, abs=1e-3)
    for place, value in enumerate(exact):
        assert CONSTRAINED.eigenvalue(list(diagonal), list(squares), place) == pytest.approx(value, abs=1e-11)
        mode = softest_mode(system, y, place)
        assert mode @ np.sqrt(squares) == pytest.approx(0.0, abs=1e-12)
        assert mode @ (diagonal * mode) == pytest.approx(value, abs=1e-11)
    positive = CONSTRAINED.determinant(list(diagonal), list(squares)) / np.prod(exact)
    assert positive == pytest.approx(squares.sum(), rel=1e-7)
    slope, h = stability(system).slope(y), 1e-6
    if len(exact) == 1 or exact[1] - exact[0] > 1e-2:
        for j, step in enumerate(h * np.eye(y.size)):
            ends = [float(stability(system).margin((y + s * step).tolist())) for s in (1, -1)]
            assert slope[j] == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-4, abs=1e-4)


def test_one_balloon_on_a_liquid_has_no_freedom():
    system = SYSTEMS["liquid, one"]
    assert eigenvalues(system, np.array([2.0, 0.5, 0.1])).size == 0
    assert stability(system).margin([2.0, 0.5, 0.1]) == 1.0
    assert not stability(system).slope(np.array([2.0, 0.5, 0.1])).any()
    steps = [{"inflate": 1.2}, {"ramp": 0.2}, {"hold": 1}, {"jump": 0.3}, {"ramp": 0.8}]
    history = run(single(*steps, **gas(law="liquid")))
    assert kinds(history) == ["jump", "loss_of_tension"]
    after = history.step > 1
    assert np.ptp(history.stretch[after]) < 1e-15
    assert np.isnan(history.stability[after]).all()
    # p = f/λ² − 2φ²λ at a stretch that stays
    stretch = history.stretch[-1, 0]
    lost = np.sqrt(1.2 / (2 * stretch))
    assert history.voltage[-1, 0] == pytest.approx(lost, rel=1e-12)
    assert history.pressure[after] == pytest.approx(
        1.2 - 2 * history.voltage[after, 0] ** 2 * stretch, abs=1e-12
    )


# -- closed forms ---------------------------------------------------------------------------------------


class ClosedForm:
    """All equilibria of a Gent pair, the stretch y of the passive balloon given, whatever is sealed in."""

    def __init__(self, scenario):
        filled, history = scenario.gas, run(scenario)
        sealed = int(np.flatnonzero(history.step == 1)[-1])
        self.radius = scenario.balloons[0].radius
        self.chamber, self.law, self.exponent = filled.chamber, filled.law, filled.exponent
        self.ambient = filled.ambient_pressure
        self.p0 = history.pressure[sealed]
        self.v0 = (self.radius**3 * history.stretch[sealed, 0] ** 3 + history.stretch[sealed, 1] ** 3) / 3

    @staticmethod
    def force(x, limit=100.0):
        return 2 * (x - x**-5) / (1 - (2 * x * x + x**-4 - 3) / limit)

    def volume(self, p):
        if self.law == "liquid":
            return self.v0
        exponent = self.exponent if self.law == "adiabatic" else 1.0
        ratio = (self.p0 + self.ambient) / (p + self.ambient)
        return (self.chamber + self.v0) * ratio ** (1 / exponent) - self.chamber

    def state(self, y):
        p = self.force(y) / y**2
        x = (3 * self.volume(p) - y**3) ** (1 / 3) / self.radius
        return x, p, (self.force(x) - self.radius * p * x * x) / (2 * x**3)

    def slope(self, y):
        """Of the squared voltage, by a complex step."""
        return (self.state(y + 1e-30j)[2]).imag * 1e30


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@pytest.mark.parametrize(("radius", "inflate"), [(0.5, 2.4), (1.0, 1.2)])
def test_limit_points_of_the_path(law, radius, inflate):
    """The path lies on the closed form; its limit points are where that turns in the voltage."""
    scenario = pair(inflate, {"ramp": 0.1}, radius=radius, **gas(0.1, **law))
    form, curve = ClosedForm(scenario), trace(scenario)
    x, p, square = form.state(curve.stretch[:, 1])
    assert curve.stretch[:, 0] == pytest.approx(x, rel=2e-9)
    assert curve.pressure == pytest.approx(p, abs=1e-11)
    assert curve.voltage[:, 0] ** 2 == pytest.approx(square, abs=2e-9)
    turns = [point for point in curve.points if point.kind == "limit_point"]
    assert turns or law.get("law") == "liquid"
    for point in turns:
        y = point.stretch[1]
        # Where the passive balloon hardly moves its stretch says little: brackets by the active one's.
        width = 1e-6 * max(1e-3, abs(y - 1))
        found = brentq(form.slope, y - width, y + width, xtol=1e-15)
        assert point.voltage[0] == pytest.approx(np.sqrt(form.state(found)[2]), rel=1e-9)


def test_two_equal_balloons_on_a_liquid_part():
    """Both stretches stand still until φ² = (f′ − 2f/λ)/(2λ²); there they part, at one pressure."""
    both = {"electrodes": True}
    history = run(pair(1.25, *UP_AND_DOWN, passive=both, **gas(law="liquid")))
    assert kinds(history)[0] == "branch_point"
    event = history.events[0]
    start = history.stretch[history.step == 1][-1, 0]
    slope = ClosedForm.force(start + 1e-30j).imag * 1e30
    critical = np.sqrt((slope - 2 * ClosedForm.force(start) / start) / (2 * start**2))
    assert event.voltage == pytest.approx([critical, critical], rel=1e-10)
    parted = history.stretch[history.voltage[:, 0] == 0.4][0]
    assert parted[0] > 1.05 * parted[1]
    loads = [ClosedForm.force(x) / x**2 - 2 * 0.4**2 * x for x in parted]
    assert loads[0] == pytest.approx(loads[1], abs=1e-12)
    closed = history.volume[history.step > 1]
    assert np.ptp(closed) <= 8e-16 * closed[0]


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_rests_at_zero_voltage(law):
    scenario = pair(2.4, {"ramp": 0.1}, radius=0.5, **gas(1.0, **law))
    made, group, start = sealed_state(scenario)
    found = rests(made, group.equations.gas)
    assert min(np.abs(rest - start).max() for rest in found) < 1e-9
    for rest in found:
        assert np.abs(group.equations.residual(rest.tolist())).max() < 1e-9
    assert len(trace_all(scenario)) >= 1


# -- limits ---------------------------------------------------------------------------------------------


def last(history):
    return np.array([*history.stretch[-1], history.pressure[-1]])


def test_adiabatic_with_exponent_one_is_isothermal():
    steps = [{"ramp": 0.38, "over": 10}]
    exact = run(pair(1.2, *steps, **gas(0.015)))
    for small in (1e-6, 1e-8):
        near = run(pair(1.2, *steps, **gas(0.015, law="adiabatic", exponent=1 + small)))
        assert kinds(near) == kinds(exact) == ["limit_point"]
        assert last(near) == pytest.approx(last(exact), abs=10 * small)
        assert near.events[0].voltage == pytest.approx(exact.events[0].voltage, abs=small)
        assert near.events[0].dissipated == pytest.approx(exact.events[0].dissipated, rel=20 * small)


def test_a_liquid_is_the_limit_of_a_gas_under_high_ambient_pressure():
    """Event, states before and after its snap: to first order in 1/pₑ."""
    step = {"ramp": 0.16, "over": 10}

    def numbers(**filled):
        history = run(pair(2.4, step, radius=0.5, **gas(**filled)))
        event = history.events[-1]
        return np.array([*event.voltage, *event.stretch_after, *last(history)])

    exact = numbers(law="liquid")
    errors = np.array([numbers(ambient=10.0**k) - exact for k in (4, 5, 6)])
    assert errors[:-1] / errors[1:] == pytest.approx(10.0, rel=0.02)


def test_a_large_chamber_is_the_limit_to_an_open_valve():
    """The larger the chamber, the closer to constant pressure, with an error ∝ 1/V_c."""
    steps = [{"inflate": 1.2}, {"ramp": 0.16, "over": 10}]

    def numbers(history):
        (event,) = history.events
        return np.array([*event.voltage, *event.stretch_after, *history.stretch[-1], history.pressure[-1]])

    opened = run(single(*[{**s, "valve": "open"} if "ramp" in s else s for s in steps]))
    exact = numbers(opened)
    for law in ({}, {"law": "adiabatic"}):
        errors = np.array(
            [numbers(run(single(*steps, **gas(chamber=10.0**k, **law)))) - exact for k in (4, 5, 6)]
        )
        assert errors[:-1] / errors[1:] == pytest.approx(10.0, rel=0.03)


def test_a_chamber_decides_whether_a_balloon_snaps_and_stays():
    """No chamber: smooth. A large one: the balloon snaps, and does not come back with the voltage."""
    steps = [{"inflate": 1.2}, {"ramp": 0.2, "over": 10}, {"ramp": 0.0, "over": 10}]
    none, large = (run(single(*steps, **gas(chamber=c))) for c in (0.0, 1000.0))
    assert kinds(none) == []
    assert none.stretch[-1] == pytest.approx(none.stretch[none.step == 1][-1], rel=1e-12)
    assert kinds(large) == ["limit_point"]
    assert large.stretch[-1, 0] > 5.0


@pytest.mark.parametrize("share", [1e-8, 1e-5, 0.4, 0.6, 1.7])
def test_an_adiabat_has_all_digits_however_little_is_left_of_its_volume(share):
    """p V^γ = p₀ V₀^γ in thirty digits; 1 + u has few where u = V/V₀ − 1 is near −1."""
    import mpmath as mp

    sealed = SealedGas(1e-6, 2e4, 0.0, 0.0, Adiabat(1.061))
    with mp.workdps(30):
        volume = mp.mpf(2e4) * mp.mpf(share)
        exact = mp.mpf(1e-6) * (volume / mp.mpf(2e4)) ** -mp.mpf(1.061)
        work = mp.mpf(1e-6) * mp.mpf(2e4) * ((volume / 2e4) ** -mp.mpf(0.061) - 1) / mp.mpf(0.061)
    pressure = -sealed.defect(0.0, 3.0 * float(volume))
    assert pressure == pytest.approx(float(exact), rel=1e-14, abs=1e-20)
    assert sealed.energy(float(volume)) == pytest.approx(float(work), rel=1e-14)


def test_a_snap_back_from_a_hundred_thousand_times_the_volume():
    """The gas is sealed after a giant snap; back at a stretch near 1 its pressure still has all digits."""
    soft = {"model": "ogden", "mu": [630000.0, 1200.0, -10000.0], "alpha": [1.3, 5.0, -2.0]}
    scenario = load_scenario(
        {
            "title": "back from far out",
            "gas": {"ambient_pressure": 0.0, "law": "adiabatic", "exponent": 1.061},
            "balloon": [{"name": "b0", "electrodes": True, "elastomer": soft}],
            "step": [
                {"inflate": 0.1668},
                {"ramp": 0.7977},
                {"hold": 1.0, "valve": "open"},
                {"jump": 0.0},
                {"ramp": 0.2964},
            ],
        }
    )
    history = run(scenario)
    assert (history.outcome, kinds(history)) == ("completed", ["limit_point", "jump"])
    assert history.stretch.max() > 20.0
