"""Newton's method believes a state that rounding keeps from being any better, and no other."""

from __future__ import annotations

import numpy as np
import pytest
from mpmath import mp, mpf

from simulator import History, load_scenario
from simulator.analysis.trace import sealed_state
from simulator.solver import newton
from tests.pairs import pair, run

SOFT = {"model": "ogden", "mu": [1.49, 0.003, -0.024], "alpha": [1.3, 5.0, -2.0]}
GENT = {"model": "gent", "J_lim": 100.0}


def played(written: dict[str, object]) -> History:
    return run(load_scenario({"title": "far beyond the limit point", **written}))


def ogden_force(stretch: mpf) -> mpf:
    """f of `SOFT`, in forty digits."""
    mu, alpha = ([mpf(repr(x)) for x in SOFT[key]] for key in ("mu", "alpha"))
    modulus = sum(m * a for m, a in zip(mu, alpha, strict=True)) / 2
    terms = (m * (stretch ** (a - 1) - stretch ** (-2 * a - 1)) for m, a in zip(mu, alpha, strict=True))
    return 2 * sum(terms) / modulus


def test_a_sublinear_force_at_a_large_stretch():
    """Its terms are larger than what the unknowns' last digits make of it."""
    history = played(
        {
            "gas": {"ambient_pressure": 0.0},
            "output": {"points": 5},
            "balloon": [
                {"name": "b0", "electrodes": True, "elastomer": SOFT},
                {"name": "b1", "radius": 2.0, "electrodes": True, "elastomer": GENT},
                {"name": "b2", "radius": 2.0, "elastomer": GENT},
            ],
            "step": [{"inflate": 1.4}, {"ramp": {"b0": 0.32, "b1": 0.5}}, {"ramp": {"b1": 0.0}}],
        }
    )
    assert history.outcome.value == "completed"
    assert [event.kind for event in history.events] == ["limit_point", "limit_point"]
    stretches, pressure = history.stretch[-1], mpf(float(history.pressure[-1]))
    with mp.workdps(40):
        x = mpf(float(stretches[0]))
        load = pressure * x**2 + 2 * mpf("0.32") ** 2 * x**3
        assert float(ogden_force(x) / load - 1) == pytest.approx(0.0, abs=1e-12)
    sealed = history.stretch[history.step == 1][-1]
    weights = np.array([1.0, 8.0, 8.0])
    assert float(pressure) * (weights @ stretches**3) == pytest.approx(1.4 * (weights @ sealed**3), rel=1e-12)


@pytest.mark.parametrize(
    ("elastomer", "ambient", "load", "mean", "amplitude"),
    [
        ({"preset": "natural-rubber"}, 1.0, 1.5, 0.3, 0.3),
        ({"model": "ogden", "mu": [6.0, 0.01, -0.1], "alpha": [1.0, 5.0, -2.0]}, 0.0, 3.0, 0.2, 0.6),
    ],
)
def test_a_sine_by_name_is_that_sine(elastomer, ambient, load, mean, amplitude):
    """By name v is the time, and a voltage that passes zero takes the stretch beyond 100 at once."""
    valve = {"valve": "open"} if ambient else {}
    wave = {"mean": mean, "amplitude": amplitude}
    balloon = [{"name": "a", "electrodes": True, "elastomer": elastomer}]
    by_name, plain = (
        played(
            {
                "gas": {"ambient_pressure": ambient},
                "balloon": balloon,
                "step": [{"inflate": load}, {"sine": sine, **valve}],
            }
        )
        for sine in ({"a": wave, "period": 1.0, "cycles": 1}, {**wave, "period": 1.0, "cycles": 1})
    )
    assert by_name.outcome == plain.outcome
    assert by_name.events[-1].kind == plain.events[-1].kind
    assert by_name.stretch == pytest.approx(plain.stretch, rel=1e-9)
    assert by_name.pressure == pytest.approx(plain.pressure, rel=1e-9)


def test_a_charge_taken_off_a_balloon_full_of_liquid():
    """Reference: own arclength code and SciPy, see the values' digits."""
    history = played(
        {
            "gas": {"ambient_pressure": 0.3, "law": "liquid"},
            "output": {"points": 7},
            "balloon": [
                {
                    "name": "b0",
                    "radius": 1.16263,
                    "thickness": 0.5,
                    "permittivity": 0.941969,
                    "electrodes": True,
                    "elastomer": GENT,
                },
                {"name": "b1", "radius": 1.02, "elastomer": GENT},
                {
                    "name": "b2",
                    "radius": 0.5774186831912127,
                    "modulus": 0.869,
                    "electrodes": True,
                    "elastomer": GENT,
                },
            ],
            "step": [
                {"inflate": 0.525},
                {"jump": 0.466, "valve": "open"},
                {"charge": {"b0": 8.11, "b2": 82.1065}},
            ],
        }
    )
    assert history.events[-1].kind == "limit_point"
    assert history.events[-1].time == pytest.approx(1.72987, abs=5e-6)
    assert history.stretch[-1] == pytest.approx([6.47917, 4.50070, 5.90705], abs=5e-6)


def test_states_that_are_lost_are_named():
    """Of many states sought at once, those that do not exist are told apart from those that do."""
    _, group, start = sealed_state(pair(1.2, {"ramp": 0.1}, ambient=0.015))
    guesses = np.repeat(start[:, None], 3, axis=1)
    guesses[-1] = [0.1, 5.0, 0.2]  # at 5 there is none
    with pytest.raises(newton.NotConverged) as failure:
        newton.at_drive(group.equations, guesses)
    assert failure.value.failed is not None
    assert failure.value.failed.tolist() == [False, True, False]
