"""IDA is started in one place, fails in one way, and writes nothing to the terminal."""

from __future__ import annotations

import os

import numpy as np
import pytest

from simulator.solver.ida import Effort, IntegrationError, System, integrate


def decay(margin, terminal=True):
    """y′ = −y with one margin."""
    return System(
        lambda t, y, yp: [yp[0] + y[0]],
        lambda t, y, yp, c: [[1.0 + c]],
        lambda t, y, yp: [margin(t, y)],
        [terminal],
    )


def solved(system, times=(0.0, 1.0, 2.0), **options):
    effort = Effort()
    course = integrate(
        system,
        np.array(times),
        np.array([1.0]),
        np.array([-1.0]),
        effort,
        **{"rtol": 1e-8, "atol": 1e-10, "most_steps": 1000, **options},
    )
    return course, effort


def test_states_at_the_times_asked_for():
    course, effort = solved(decay(lambda t, y: 1.0))
    assert course.time.tolist() == [0.0, 1.0, 2.0]
    assert course.states[:, 0] == pytest.approx(np.exp(-course.time), abs=1e-7)
    assert course.events == ()
    assert effort.ida_solves == 1
    assert effort.residual_calls > 0


def test_its_own_steps_between_two_times():
    course, effort = solved(decay(lambda t, y: 1.0), times=(0.0, 2.0))
    assert course.time.size == effort.ida_steps + 1 > 10


@pytest.mark.parametrize("terminal", [True, False])
def test_a_margin_that_falls_through_zero(terminal):
    course, _ = solved(decay(lambda t, y: y[0] - 0.5, terminal))
    (event,) = course.events
    assert event.time == pytest.approx(np.log(2.0), abs=1e-7)
    assert event.state == pytest.approx([0.5], abs=1e-7)
    assert course.time[-1] == pytest.approx(event.time if terminal else 2.0)


def test_nothing_reaches_the_terminal(capfd):
    """A margin that is zero from the start is a warning of SUNDIALS, a step too small an error."""
    before = os.environ.get("SUNLOGGER_WARNING_FILENAME")
    solved(decay(lambda t, y: 0.0))
    blow_up = System(
        lambda t, y, yp: [yp[0] - y[0] * y[0] if y[0] < 1e3 else float("nan")],
        lambda t, y, yp, c: [[c - 2.0 * y[0]]],
        lambda t, y, yp: [1.0],
        [True],
    )
    one = np.array([1.0])
    options = {"rtol": 1e-6, "atol": 1e-9, "most_steps": 10_000, "min_step": 1e-7, "max_step": 1.0}
    with pytest.raises(IntegrationError, match="IDA") as failure:
        integrate(blow_up, [0.0, 2.0], one, one, Effort(), **options)
    assert 900.0 < failure.value.state[0] < 1e3
    assert capfd.readouterr() == ("", "")
    assert os.environ.get("SUNLOGGER_WARNING_FILENAME") == before


@pytest.mark.parametrize("times", [(0.0, 0.0), (0.0, 2.0, 1.0)])
def test_times_that_are_none_fail_in_the_same_way(times):
    with pytest.raises(IntegrationError, match="IDA: ValueError"):
        solved(decay(lambda t, y: 1.0), times=times)


def test_too_many_steps():
    with pytest.raises(IntegrationError, match="no end within 20 steps"):
        solved(decay(lambda t, y: 1.0), times=(0.0, 2.0), most_steps=20)
