"""Following a path: its checks make silent errors loud, and its result does not depend on its tolerance."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.analysis.trace import sealed_state, trace
from simulator.model.conditions import Condition, gradient
from simulator.simulation.run import SolverError
from simulator.solver import flow, newton, segment, singular
from simulator.solver.branch import Branch
from simulator.solver.certify import Proposal, certified
from simulator.solver.corner import at_drive_between
from simulator.solver.follow import PathError, follow
from simulator.solver.ida import Effort
from tests.pairs import pair, run


def test_gauss_rules():
    for power in range(5):
        exact = segment.GAUSS_POINTS ** (power + 1) / (power + 1)
        assert segment.GAUSS_INTEGRALS @ segment.GAUSS_POINTS**power == pytest.approx(exact, abs=1e-13)
        assert segment.GAUSS_WEIGHTS @ segment.GAUSS_POINTS**power == pytest.approx(
            1 / (power + 1), abs=1e-14
        )


@pytest.mark.parametrize("rtol", [1e-1, 1e-2, 1e-3, 1e-6, 1e-9])
def test_any_tolerance_gives_the_same_states(rtol):
    """Loose or tight, IDA only says where to polish: event voltages and states agree to rounding."""
    steps = [{"ramp": 0.4}, {"ramp": 0.0}]
    reference = run(pair(1.2, *steps, ambient=0.015))
    history = run(pair(1.2, *steps, ambient=0.015, solver={"rtol": rtol}))
    assert [e.kind for e in history.events] == [e.kind for e in reference.events]
    for one, other in zip(history.events, reference.events, strict=True):
        assert one.voltage == pytest.approx(other.voltage, abs=1e-13)
        assert one.stretch_before == pytest.approx(other.stretch_before, abs=1e-8)
        assert one.stretch_after == pytest.approx(other.stretch_after, abs=1e-11)
    rows = np.ones(len(history), dtype=bool)
    for event in reference.events:
        rows &= history.time != event.time
    assert history.stretch[rows] == pytest.approx(reference.stretch[rows], abs=1e-10)
    assert history.energy_balance.relative_imbalance < 1e-6


def test_two_limit_points_close_together_are_not_stepped_over():
    """5b A has two limit points 2e-4 apart in voltage on its unstable part."""
    path = trace(pair(1.2, {"ramp": 0.1}, radius=0.5, shape={"on_loss": "ignore"}))
    kinds = [point.kind for point in path.points]
    assert kinds == ["limit_point", "limit_point", "limit_point", "loss_of_tension"]


def test_a_branch_knows_what_it_has_seen():
    history = run(pair(0.6, {"ramp": 0.3}, {"ramp": 0.1}, {"ramp": 0.25}, {"ramp": 0.0}))
    assert history.statistics.branches == 2  # the inflation's, one for both balloons, and the sealed pair's
    assert history.statistics.ida_solves == 1  # the inflation needs none


def test_letting_air_out_beyond_what_is_known_needs_no_integration():
    """As little as letting it in does: all that is integrated is the snap."""
    inflated, deflated = run(pair(3.0)), run(pair(3.0, {"inflate": 1.0}))
    assert inflated.stretch[-1, 0] > deflated.stretch[-1, 0] > 5.0
    assert deflated.statistics.ida_solves == inflated.statistics.ida_solves


def branch_up_to(v: float) -> Branch:
    """The first branch of 3c B, followed from no voltage."""
    _, group, start = sealed_state(pair(1.2, {"ramp": v}, ambient=0.015))
    branch = Branch.through(group.equations, group.conditions, start)
    branch.reach(v, 1e-3, Effort())
    return branch


def test_a_guess_that_leads_nowhere_is_replaced_by_a_search_along_the_part():
    """Beside limit points that turn within 1e-7 of a part, the cubic through it runs far off."""
    branch = branch_up_to(0.4)
    ends = branch.states[:, [0]], branch.states[:, [-1]]  # the limit point, v about 0.386, is the last
    for share in (0.3, 0.9, 0.9999):
        v = share * branch.states[-1, -1]
        lost = np.array([[np.nan], [np.nan], [np.nan], [v]])
        with pytest.raises(newton.NotConverged):
            newton.at_drive(branch.equations, lost)
        found = at_drive_between(branch.equations, lost, *ends)
        assert found[:, 0] == pytest.approx(branch.state_at(v), rel=1e-12)


def test_work_of_parts_adds_up():
    branch = branch_up_to(0.3)
    whole = branch.work_between(0.0, 0.3)
    for middle in (0.1234, 0.2999, float(branch.states[-1, 5])):
        parts = branch.work_between(0.0, middle) + branch.work_between(middle, 0.3)
        assert parts == pytest.approx(whole, rel=1e-9)
    assert branch.work_between(0.3, 0.0) == -whole
    # −∂Π/∂v integrates to the potential's change.
    first, last = branch.state_at(0.0).tolist(), branch.state_at(0.3).tolist()
    change = branch.equations.potential(first) - branch.equations.potential(last)
    assert whole == pytest.approx(change, rel=1e-9)


def test_a_segment_that_is_no_path_is_refused():
    """Points thrown about are not polished into something plausible."""
    branch = branch_up_to(0.3)
    points, directions = branch.states.copy(), branch.tangents.copy()
    points[:, 5] = points[:, 9]  # back and forth
    with pytest.raises(newton.NotConverged):
        certified(
            branch.equations,
            branch.conditions,
            Proposal(points, directions, len(branch.conditions)),
            0.3,
        )


def test_an_unstable_stretch_is_not_taken_for_a_branch():
    """Starting beyond the limit point, where S is not positive, every margin check fails."""
    scenario = pair(1.2, {"ramp": 0.1}, ambient=0.015)
    _, group, _ = sealed_state(scenario)
    curve = trace(scenario)
    place = int(np.flatnonzero(curve.unstable == 1)[40])
    state = np.array([*curve.stretch[place], curve.pressure[place], curve.voltage[place, 0]])
    with pytest.raises(PathError):
        follow(group.equations, group.conditions, state, state[-1] - 0.01, 1e-4, Effort())


def test_work_that_is_not_what_the_potential_lost_is_an_error(monkeypatch):
    """The one is an integral along the path, the other a difference of its ends."""
    right = Branch.work_between
    monkeypatch.setattr(Branch, "work_between", lambda self, a, b: right(self, a, b) * (1.0 + 1e-7))
    with pytest.raises(SolverError, match=r"the work along a branch, .*, is not what the potential lost"):
        run(pair(1.2, {"ramp": 0.3}, ambient=0.015))


@pytest.mark.parametrize("way", [1, -1], ids=["up", "down"])
@pytest.mark.parametrize("order", [1, -1])
def test_of_two_events_stepped_over_between_the_same_two_points_the_nearer_ends_the_path(way, order):
    branch = branch_up_to(0.3)
    points, directions = branch.states[:, 3:5][:, ::way], way * branch.tangents[:, 3:5][:, ::way]
    start, target = points[-1]

    def fallen_between(kind, first, last):
        """Negative from one share of the way to another, positive again at the target."""

        def margin(y):
            share = (y[-1] - start) / (target - start)
            return (share - first) * (share - last)

        return Condition(kind, margin, lambda y: gradient(margin, y))

    nearer, further = fallen_between("nearer", 0.2, 0.7), fallen_between("further", 0.4, 0.9)
    proposal = Proposal(points, directions, 2)
    found = certified(branch.equations, (nearer, further)[::order], proposal, target)
    assert found.end == "nearer"
    assert found.states[-1, -1] == pytest.approx(0.8 * start + 0.2 * target, abs=1e-14)


def test_a_snap_that_falls_back_to_its_limit_point_is_an_error(monkeypatch):
    """It is integrated tightly once more; what comes back all the same is not taken for a rest."""
    branch = branch_up_to(0.3)
    branch.reach(1.0, 1e-3, Effort())
    assert branch.upper is not None
    fold = branch.upper.state
    escape = singular.escape_direction(branch.equations, fold, 1.0)
    others, asked = branch.conditions[1:], []

    def nowhere(*arguments, tight, **more):
        asked.append(tight)
        return flow.Rest(fold.copy(), None)

    with monkeypatch.context() as patch:
        patch.setattr(flow, "relax", nowhere)
        with pytest.raises(flow.FlowError, match="fell back"):
            flow.snap(branch.equations, others, fold, escape, Effort())
    assert asked == [False, True]
    assert flow.snap(branch.equations, others, fold, escape, Effort()).state[0] > fold[0] + 0.1
