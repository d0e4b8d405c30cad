"""Rows of a file beside the branches of a history: on one side of a jump or the other, never in between."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.identification.branches import branches, compare

ONE = np.array([1.0])


def cut(*parts, steps=None, broken=False):
    """Branches of a history whose parts, each (x, y), follow one another with a jump in between."""
    x, y = (np.concatenate([np.asarray(part[i], dtype=float) for part in parts]) for i in (0, 1))
    branch = np.concatenate([np.full(len(part[0]), i) for i, part in enumerate(parts)])
    step = np.ones(x.size, dtype=int) if steps is None else np.asarray(steps)
    return branches(x, y[:, None], step, branch, broken=broken)


def test_beside_a_limit_point_the_branch_is_as_exact_as_elsewhere():
    s = np.linspace(0.0, 1.0, 81)
    (branch,) = cut((1.0 - (1.0 - s) ** 2, s))  # x(s) has its fold at s = 1
    x = np.array([0.3, 0.9, 0.99, 0.9999])
    values, beyond = branch.at(x, ONE)
    assert values[:, 0] == pytest.approx(1.0 - np.sqrt(1.0 - x), abs=1e-5)
    assert not beyond.any()


def up_and_away(jump):
    """y = x up to a jump, and x + 5 from there to 1."""
    first, second = np.linspace(0.0, jump, 30), np.linspace(jump, 1.0, 30)
    return cut((first, first), (second, second + 5.0))


X = np.linspace(0.025, 0.975, 20)
DEVICE = np.where(X < 0.6, X, X + 5.0)  # jumps between 0.575 and 0.625


def test_rows_are_compared_by_the_side_of_the_jump_that_they_are_on():
    found = compare(up_and_away(0.6), X, DEVICE[:, None], ONE)
    assert found.values[:, 0] == pytest.approx(DEVICE, abs=1e-12)
    assert found.branch.tolist() == [0] * 12 + [1] * 8
    assert not found.beyond.any()


@pytest.mark.parametrize(("jump", "beyond"), [(0.4, slice(8, 12)), (0.8, slice(12, 16))])
def test_rows_beyond_their_branch_lean_to_the_other_side_and_are_marked(jump, beyond):
    found = compare(up_and_away(jump), X, DEVICE[:, None], ONE)
    assert found.branch.tolist() == [0] * 12 + [1] * 8
    assert np.flatnonzero(found.beyond).tolist() == list(range(20))[beyond]
    off = found.values[:, 0] - DEVICE
    lean = 3.0 * np.ptp(DEVICE) / np.ptp(X)
    assert off[beyond] == pytest.approx((lean - 1.0) * (X[beyond] - jump), rel=1e-9)
    assert np.delete(off, np.arange(20)[beyond]) == pytest.approx(0.0, abs=1e-12)


def test_the_sum_of_squares_has_no_jump_where_the_model_has_one():
    jumps = np.linspace(0.3, 0.9, 601)
    sums = [
        ((compare(up_and_away(j), X, DEVICE[:, None], ONE).values[:, 0] - DEVICE) ** 2).sum() for j in jumps
    ]
    assert np.abs(np.diff(sums)).max() < 0.05 * max(sums)
    assert min(sums) == pytest.approx(0.0, abs=1e-9)
    assert sums[0] > sums[100] > sums[200]
    assert sums[-1] > sums[-101]


def test_of_a_loop_rows_go_up_on_one_branch_and_down_on_the_other():
    x = np.linspace(0.0, 1.0, 20)
    steps = [1] * 40 + [2] * 40
    loop = cut(
        (0.7 * x, x),
        (0.7 + 0.3 * x, 5.0 + x),
        (1.0 - 0.7 * x, 6.0 - x),
        (0.3 - 0.3 * x, 1.0 - x),
        steps=steps,
    )
    at = np.array([0.2, 0.5, 0.9, 0.95, 0.9, 0.5, 0.2])
    rows = np.array([0.29, 0.71, 5.7, 5.8, 5.9, 5.3, 0.7])
    found = compare(loop, at, rows[:, None], ONE)
    assert found.branch.tolist() == [0, 0, 1, 1, 2, 2, 3]
    assert not found.beyond.any()


def test_a_step_goes_on_where_the_last_one_ended():
    x = np.linspace(0.0, 1.0, 11)
    found = branches(
        np.concatenate([x, 1.0 - x[1:]]),
        np.zeros((21, 1)),
        np.array([1] * 11 + [2] * 10),
        np.zeros(21),
        broken=False,
    )
    assert [(one.step, one.x[0], one.x[-1]) for one in found] == [(1, 0.0, 1.0), (2, 1.0, 0.0)]


def test_what_does_not_move_is_no_branch():
    x = np.concatenate([np.linspace(0.0, 1.0, 5), np.ones(4)])
    (only,) = branches(x, x[:, None], np.array([1] * 5 + [2] * 4), np.zeros(9), broken=False)
    assert only.step == 1


def test_rows_may_stand_in_any_order_where_x_only_rises():
    order = np.random.default_rng(0).permutation(X.size)
    found = compare(up_and_away(0.6), X[order], DEVICE[order, None], ONE)
    assert found.values[:, 0] == pytest.approx(DEVICE[order], abs=1e-12)
