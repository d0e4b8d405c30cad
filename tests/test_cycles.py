"""Cycles and what they amount to; largest and smallest values on the path, whatever the samples are."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from simulator import simulate
from simulator.results.columns import cycle_columns
from simulator.results.tables import write_run
from simulator.scenario import load_scenario
from simulator.scenario.cycles import counted
from tests.oracle.closed_form import SealedPair, reference_history
from tests.pairs import gent_force, pair, run, single
from tests.test_until import actuators
from tests.test_waves import apart, sine

STRONG = {"breakdown": {"field": 25.0}}


def wave(cycles: float, mean: float = 0.2, amplitude: float = 0.2) -> dict[str, object]:
    return {"sine": {"mean": mean, "amplitude": amplitude, "period": 1.0, "cycles": cycles}}


def test_cycles_are_counted_through_nested_steps():
    steps = [
        {"inflate": 1.2},
        wave(2.5),
        {"cycle": 2, "steps": [{"ramp": 0.1}, {"ramp": 0.0}]},
        {"cycle": 2, "steps": [{"hold": 1}, wave(3.0)]},
        {"cycle": 3, "steps": [wave(1.0), {"hold": 1}]},
    ]
    found = [(count.first, count.periods, count.closes) for _, count in counted(pair(1.2, *steps[1:]).steps)]
    assert found == [
        (0, 0, False), (1, 2.5, False),
        (4, 0, False), (4, 0, True), (5, 0, False), (5, 0, True),
        (0, 0, False), (6, 3.0, False), (0, 0, False), (9, 3.0, False),
        (12, 0, False), (12, 0, True), (13, 0, False), (13, 0, True), (14, 0, False), (14, 0, True),
    ]  # fmt: skip


def test_samples_and_events_know_their_cycle():
    history = run(pair(1.2, {"ramp": 0.2}, wave(2.5), {"hold": 1.0}, ambient=0.015))
    inside = history.step == 3
    turns = history.time[inside] - 2.0
    assert set(history.cycle[~inside]) == {0}
    np.testing.assert_array_equal(history.cycle[inside], np.maximum(np.ceil(turns - 1e-9), 1))
    for event in history.events:
        assert event.cycle == (np.ceil(event.time - 2.0) if event.step == 3 else 0)
    assert [(c.number, c.complete) for c in history.cycles] == [(1, True), (2, True), (3, False)]
    assert [c.start for c in history.cycles] == pytest.approx([2.0, 3.0, 4.0])
    assert history.cycles[-1].end == pytest.approx(4.5)


@pytest.mark.parametrize(
    "steps",
    [
        ({"triangle": {"low": 0.0, "high": 0.4, "period": 2, "cycles": 3}},),
        ({"cycle": 3, "steps": [{"ramp": 0.4}, {"hold": 1}, {"ramp": 0.0}]},),
        ({"ramp": 0.2}, wave(3.0)),
        ({"ramp": 0.2}, {"sine": {"period": 1.0, "cycles": 3, "active": {"mean": 0.2, "amplitude": 0.2}}}),
    ],
)
def test_loop_work_is_what_the_closed_form_says_is_lost(steps):
    # Two snaps in each loop, at voltages and between states that are known in closed form.
    scenario = pair(1.2, *steps, ambient=0.015)
    history = run(scenario)
    closed = SealedPair.from_scenario(scenario)
    reference = reference_history(closed, [0.4, 0.0])
    lost = sum(
        closed.potential(event.before, event.voltage) - closed.potential(event.after, event.voltage)
        for event in reference.events
    )
    assert len(reference.events) == 2
    assert len(history.cycles) == 3
    for cycle in history.cycles:
        first = cycle.number == 1 and len(steps) == 2  # that begins at 0.2 on the way up, once
        assert cycle.loop_work == pytest.approx([lost], rel=1e-8), first
        assert cycle.total_work == pytest.approx(cycle.dissipated, rel=1e-8)
        assert cycle.losses == {"limit_point": pytest.approx(lost, rel=1e-8)}


def test_each_source_has_its_own_loop_work():
    # The works of all, over closed loops, are what is lost; each one is that of a quadrature of the samples.
    scenario = actuators(
        {"inflate": 1.2}, {"ramp": {"a": 0.25, "b": 0.25}},
        sine(period=1.0, cycles=2, **apart({"mean": 0.25, "amplitude": 0.2}, 0.0, 0.5)),
        ambient=0.015, output={"points": 4001},
    )  # fmt: skip
    history = run(scenario)
    assert history.events
    for cycle in history.cycles:
        assert cycle.loop_work.sum() == pytest.approx(cycle.dissipated, rel=1e-8)
        rows = np.flatnonzero(history.cycle == cycle.number)
        rows = np.append(rows[0] - 1, rows)
        voltage, charge = history.voltage[rows], history.charge[rows]
        loops = (0.5 * (voltage[1:] + voltage[:-1]) * np.diff(charge, axis=0)).sum(axis=0)
        assert cycle.loop_work == pytest.approx(loops, rel=1e-4)
    # Half a period apart they do the same.
    second = history.cycles[1].loop_work
    assert second[0] == pytest.approx(second[1], rel=1e-8)


def test_in_real_time_what_is_lost_is_viscous():
    scenario = pair(1.2, {"ramp": 0.2, "over": 20}, wave(3.0, amplitude=0.05), ambient=0.5,
                    dynamics={"relaxation_time": 0.02})  # fmt: skip
    history = run(scenario)
    assert [c.number for c in history.cycles] == [1, 2, 3]
    last = history.cycles[-1]
    assert last.losses == {"viscous": pytest.approx(last.dissipated)}
    # The loop has closed by then.
    assert last.total_work == pytest.approx(last.dissipated, rel=1e-6)
    balance = history.energy_balance
    assert sum(c.dissipated for c in history.cycles) < balance.dissipated


def test_a_cycle_that_ends_the_history_is_not_complete():
    history = run(pair(0.6, {"cycle": 3, "steps": [{"ramp": 0.75}, {"ramp": 0.0}]}))
    assert history.outcome.value == "loss_of_tension"
    assert [(c.number, c.complete) for c in history.cycles] == [(1, False)]
    assert history.cycles[0].end == history.time[-1]


def _dense(history, values):
    """The largest of samples, between them that of a parabola through the three largest."""
    k = int(np.argmax(values))
    if k in (0, values.size - 1):
        return values[k]
    below, at, above = values[k - 1], values[k], values[k + 1]
    if at in (below, above):
        return at
    t = history.time[k - 1 : k + 2] - history.time[k]
    a, b = np.linalg.solve([[t[0], t[0] ** 2], [t[2], t[2] ** 2]], [below - at, above - at])
    return at - 0.25 * a * a / b if b < 0.0 else at


@pytest.mark.parametrize(
    ("elastomer", "inflate", "ambient"),
    [
        ({"model": "gent", "J_lim": 100.0}, 0.9, 0.5),
        ({"model": "ogden", "mu": [1.0, 0.003], "alpha": [1.3, 5.0]}, 0.8, 1.0),
    ],
)
@pytest.mark.parametrize("valve", ["closed", "open"])
def test_extremes_lie_between_samples(elastomer, inflate, ambient, valve):
    # Out of step, a balloon is largest when neither voltage is.
    waves = sine(period=1.0, cycles=2, **apart({"mean": 0.15, "amplitude": 0.1}, 0.0, 0.3))
    steps = ({"inflate": inflate}, {"ramp": {"a": 0.15, "b": 0.15 + 0.1 * np.sin(0.6 * np.pi)}})

    def played(points):
        written = actuators(*steps, {**waves, "valve": valve}, ambient=ambient, output={"points": points})
        balloons = [{**b, "elastomer": elastomer, **STRONG} for b in written.to_dict()["balloon"]]
        return run(load_scenario({**written.to_dict(), "balloon": balloons}))

    few, many = played(3), played(4001)
    for name in ("largest_stretch", "smallest_stretch", "largest_field", "smallest_field"):
        assert getattr(few.extremes, name) == pytest.approx(getattr(many.extremes, name), abs=1e-12), name
    for one, other in zip(few.verdicts, many.verdicts, strict=True):
        assert one.margin == pytest.approx(other.margin, abs=1e-12)
        assert one.time == pytest.approx(other.time, abs=1e-6)
    for i in range(2):
        assert few.extremes.largest_stretch[i] == pytest.approx(_dense(many, many.stretch[:, i]), abs=1e-9)
        assert few.extremes.largest_field[i] == pytest.approx(_dense(many, many.field[:, i]), abs=1e-9)
        assert few.verdicts[i].margin == pytest.approx(-_dense(many, -many.margin[:, i]), abs=1e-9)
    if valve == "closed":
        assert few.extremes.largest_stretch.max() > few.stretch.max() + 1e-5  # not among the samples


def test_extremes_do_not_depend_on_the_samples_of_a_long_wave():
    few, many = (
        run(pair(1.2, wave(200.0, 0.0, 0.4), ambient=0.015, active=STRONG, output={"points": n}))
        for n in (2, 101)
    )
    assert len(few) < 2500 < 20_000 < len(many)
    assert np.abs(few.voltage).max() == 0.4  # extremes are samples
    for name in ("largest_stretch", "smallest_stretch", "largest_field", "smallest_field"):
        assert getattr(few.extremes, name) == pytest.approx(getattr(many.extremes, name), abs=1e-12)
    assert few.verdicts[0].margin == pytest.approx(many.verdicts[0].margin, abs=1e-12)
    odd = run(pair(1.2, wave(199.0, 0.0, 0.4), ambient=0.015, active=STRONG))
    assert odd.extremes.largest_field == pytest.approx(few.extremes.largest_field, abs=1e-12)


def test_a_largest_stretch_just_before_a_sharp_limit_point():
    # Two balloons, both driven, that are almost alike: the stiffer one is pulled back as the other lets go.
    balloons = [
        {"name": "stiff", "radius": 1.085, "elastomer": {"model": "gent", "J_lim": 30.26}},
        {"name": "soft", "radius": 1.032, "modulus": 0.8258924658881064,
         "elastomer": {"model": "mooney-rivlin", "C1": 1.805, "C2": 0.01057}},
    ]  # fmt: skip

    def played(points, *ramps):
        return run(
            load_scenario(
                {
                    "title": "almost alike",
                    "gas": {"ambient_pressure": 0.42865880909274895},
                    "balloon": [{**balloon, "electrodes": True} for balloon in balloons],
                    "step": [{"inflate": 0.5008}, *({"ramp": v} for v in ramps)],
                    "output": {"points": points},
                }
            )
        )

    few, many = played(3, 1.0), played(1001, 0.54, 0.56)
    assert few.events[0].voltage[0] == pytest.approx(0.5658250886)
    assert few.stretch[:, 0].max() < 1.12  # not among the samples
    assert few.extremes.largest_stretch[0] == pytest.approx(_dense(many, many.stretch[:, 0]), abs=1e-9)


def test_a_table_is_sampled_at_its_rows_if_asked_for(tmp_path):
    times = np.linspace(0.0, 5.0, 301)
    voltages = 0.1 * np.abs(np.sin(7.0 * times**2))
    path = tmp_path / "rec.csv"
    rows = "\n".join(f"{t!r},{v!r}" for t, v in zip(times.tolist(), voltages.tolist(), strict=True))
    path.write_text(f"time,voltage\n{rows}\n")
    all_rows = run(pair(0.6, {"table": str(path)}, output={"rows": True}))
    np.testing.assert_allclose(all_rows.time[all_rows.step == 2], 1.0 + times[times > 0], atol=1e-12)
    some = run(pair(0.6, {"table": str(path)}, output={"points": 11}))
    assert some.voltage.max() == voltages.max()
    assert np.count_nonzero(some.step == 2) <= 12
    assert some.extremes.largest_stretch == pytest.approx(all_rows.extremes.largest_stretch, abs=1e-12)


def test_cycles_have_a_table(tmp_path):
    history = run(pair(1.2, {"ramp": 0.2}, wave(2.0), ambient=0.015))
    columns = cycle_columns(history)
    assert list(columns) == [
        "cycle", "start", "end", "complete", "loop_work_active", "loop_work", "supply_work", "dissipated",
        "dissipated_limit_point", "largest_stretch_active", "largest_stretch_passive", "largest_field_active",
        "smallest_stretch_active", "smallest_stretch_passive", "smallest_field_active",
    ]  # fmt: skip
    assert "cycles.csv" in [path.name for path in write_run(history, tmp_path)]
    assert history.cycles_to_dataframe()["cycle"].tolist() == [1, 2]
    without = write_run(run(single({"inflate": 0.5})), tmp_path / "other")
    assert "cycles.csv" not in [path.name for path in without]


def test_largest_values_are_found_on_a_branch_that_ends_as_soon_as_it_begins() -> None:
    """A balloon held at the peak of its inflation curve snaps at next to no charge."""
    balloons = [
        {"name": "b0", "radius": 0.8648, "elastomer": {"model": "gent", "J_lim": 182.0}},
        {"name": "b1", "electrodes": True, "elastomer": {"model": "gent", "J_lim": 100.0}},
    ]
    history = simulate(
        {
            "title": "charged at its peak",
            "gas": {"ambient_pressure": 0.0},
            "balloon": balloons,
            "step": [{"inflate": 1.2536545499043248}, {"charge": {"b1": 3.8}, "valve": "open"}],
        }
    )
    snap = history.events[0]
    assert (snap.kind.value, snap.step) == ("limit_point", 2)
    assert snap.stretch_before[1] == pytest.approx(1.39722655, abs=1e-6)
    assert history.extremes.largest_stretch[1] == pytest.approx(history.stretch[:, 1].max(), abs=1e-9)


# -- in real time -------------------------------------------------------------------------------------


def extremes_of(history):
    wholes = [history.extremes, *(cycle.extremes for cycle in history.cycles)]
    names = ("largest_stretch", "smallest_stretch", "largest_field", "smallest_field")
    return [getattr(one, name) for one in wholes for name in names]


WAVES = [
    {"triangle": {"low": 0.0, "high": 0.35, "period": 1.5, "cycles": 2}},
    {"sine": {"mean": 0.15, "amplitude": 0.15, "period": 1.5, "cycles": 2.3}},
]


@pytest.mark.parametrize("wave", WAVES)
def test_in_motion_extremes_do_not_depend_on_samples(wave):
    """A balloon that lags behind its voltage is largest after the peak, between samples."""
    more = {"ambient": 0.015, "dynamics": {"relaxation_time": 0.3}, "active": {"breakdown": {"field": 5.0}}}
    few, many = (run(pair(0.9, wave, **more, output={"points": n})) for n in (2, 201))
    for one, other in zip(extremes_of(few), extremes_of(many), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)
    assert few.closest[0].margin == pytest.approx(many.closest[0].margin, abs=1e-9)
    assert few.extremes.largest_stretch[0] > few.stretch[:, 0].max() + 1e-5  # not among the samples
    assert few.cycles_to_dataframe().shape == many.cycles_to_dataframe().shape


def test_in_motion_extremes_are_those_of_another_integrator():
    tau, ambient, inflation = 0.3, 0.015, 0.9
    wave = {"sine": {"mean": 0.15, "amplitude": 0.15, "period": 1.5, "cycles": 1}}
    slow = {"dynamics": {"relaxation_time": tau}, "output": {"points": 2}}
    history = run(pair(inflation, wave, ambient=ambient, **slow))
    sealed = history.stretch[history.step == 1][-1]
    gas = (history.pressure[history.step == 1][-1] + ambient) * (sealed**3).sum()

    def voltage(t):
        return 0.15 + 0.15 * np.sin(2.0 * np.pi * t / 1.5)

    def rates(t, x):
        pressure = gas / (x**3).sum() - ambient
        loads = pressure * x**2 + np.array([2.0 * voltage(t) ** 2 * x[0] ** 3, 0.0])
        return -(gent_force(x) - loads) / tau

    again = solve_ivp(rates, (0.0, 1.5), sealed, method="DOP853", rtol=1e-12, atol=1e-13, dense_output=True)
    times = np.linspace(0.0, 1.5, 200_001)
    stretch = again.sol(times)
    (cycle,) = history.cycles
    np.testing.assert_allclose(cycle.extremes.largest_stretch, stretch.max(axis=1), rtol=3e-9)
    np.testing.assert_allclose(cycle.extremes.smallest_stretch, stretch.min(axis=1), rtol=3e-9)
    field = voltage(times) * stretch[0] ** 2
    assert cycle.extremes.largest_field[0] == pytest.approx(field.max(), rel=3e-9)
