"""Whether the balloons stay spheres: where the margin of sphericity vanishes, on the path and in snaps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simulator import Event, EventKind, History, Outcome, ScenarioError, load_scenario, simulate
from simulator.cli.summary_shape import shape_lines
from simulator.model.conditions import shape_conditions
from simulator.model.drive import AffineDrive
from simulator.model.elastomers import ArrudaBoyce, Fung, Gent, MooneyRivlin, NeoHookean, Ogden
from simulator.model.equations import OpenBalloon
from simulator.model.membranes import ElectrodedMembrane, Membrane, sphericity
from simulator.results.record import run_record
from simulator.results.shapes import lost_rows
from simulator.sweep.loading import load_table
from simulator.sweep.optimum import optimize
from simulator.sweep.rows import facts
from simulator.sweep.running import run_sweep
from tests.fuzz.shapes import problems_of
from tests.oracle.shape import closed_form
from tests.pairs import pair, run, single

LOST, REGAINED = EventKind.LOSS_OF_SPHERICITY, EventKind.SPHERICITY_REGAINED


def shapes(history: History) -> list[Event]:
    return [event for event in history.events if event.kind in (LOST, REGAINED)]


def on_the_path(history: History) -> list[Event]:
    return [event for event in shapes(history) if event.stretch_after is event.stretch_before]


# φ, λ₁ and p where the active balloon of a shipped scenario stops being a sphere, by Newton's method in 40
# digits on the pair's closed form (tests/oracle/shape/pair.py); with the voltage rising or falling.
LOST_AT = {
    "fig3a_state_a": [(0.628545608066, 1.294792588245, 0.202453926591)],
    "fig3a_state_b": [(0.361083312913, 1.509940865903, 0.840683089165)],
    "fig3b_state_a": [(0.575169299828, 1.325610046402, 0.364020070286)],
    "fig3b_state_b": [(0.326498432516, 1.557131577584, 0.886937991401)],
    "fig3c_state_a": [(0.559024218846, 1.335731408648, 0.409806662295)],
    "fig3c_state_b": [
        (0.314060834937, 1.576385226125, 0.900912095618),
        (0.270440045026, 5.035058848981, 0.023015306605),
    ],
    "fig5c_state_a": [(0.264089520888, 4.972203411780, 0.114995005037)],
    "fig3a_state_c": [],
    "fig3b_state_c": [],
    "fig3c_state_c": [],
    "fig5b_state_a": [],
    "fig5b_state_b": [],
    "fig5b_state_c": [],
    "fig5c_state_b": [],
    "fig5c_state_c": [],
}


@pytest.mark.parametrize("name", LOST_AT)
def test_where_the_paper_s_balloons_stop_being_spheres(name: str) -> None:
    history = simulate(load_scenario(f"scenarios/{name}.toml"))
    found = [event for event in on_the_path(history) if event.kind is LOST]
    assert len(found) == len(LOST_AT[name])
    for event, (voltage, stretch, pressure) in zip(found, LOST_AT[name], strict=True):
        assert (event.balloon, event.mode) == ("active", "pear")
        assert event.voltage[0] == pytest.approx(voltage, abs=1e-11)
        assert event.stretch_before[0] == pytest.approx(stretch, abs=1e-9)
        assert event.pressure_before == pytest.approx(pressure, abs=1e-10)
        # The row of its state is a sample whose margin is zero.
        row = int(np.flatnonzero(history.time == event.time)[0])
        assert history.sphericity[row, 0] == pytest.approx(0.0, abs=1e-9)
    # Two in a row of one balloon are a loss and its end.
    sequence = [event.kind for event in shapes(history)]
    assert sequence == [LOST, REGAINED] * (len(sequence) // 2) + [LOST] * (len(sequence) % 2)


def test_margins_at_the_landings_of_the_paper() -> None:
    snapped = simulate(load_scenario("scenarios/fig3c_state_b.toml"))
    limit = next(event for event in snapped.events if event.kind is EventKind.LIMIT_POINT)
    before, after = np.flatnonzero(snapped.time == limit.time)[[0, -1]]
    assert snapped.sphericity[before, 0] == pytest.approx(-1.657, abs=5e-4)
    assert snapped.sphericity[after, 0] == pytest.approx(81.5, abs=0.05)
    kept = simulate(load_scenario("scenarios/fig5b_state_b.toml"))
    assert kept.sphericity[-1, 0] == pytest.approx(31.5, abs=0.05)
    assert shapes(kept) == []


def test_a_landing_may_be_no_sphere() -> None:
    history = simulate(load_scenario("scenarios/vhb_snap.toml"))
    snap, lost = history.events[:2]
    assert (snap.kind, lost.kind, lost.balloon) == (EventKind.LIMIT_POINT, LOST, "active")
    assert lost.time == snap.time
    assert lost.stretch_after is not None
    assert snap.stretch_after is not None
    assert lost.stretch_after[0] == snap.stretch_after[0] == pytest.approx(2.4665, abs=5e-5)
    row = int(np.flatnonzero(history.time == snap.time)[-1])
    assert history.sphericity[row, 0] == pytest.approx(-1.51, abs=5e-3)


def test_a_snap_through_shapes_that_are_none_says_so() -> None:
    history = simulate(load_scenario("scenarios/fig5c_state_a.toml"))
    snap, lost, regained = history.events[:3]
    assert [snap.kind, lost.kind, regained.kind] == [EventKind.LIMIT_POINT, LOST, REGAINED]
    for event in (lost, regained):
        assert event.time == snap.time
        assert np.array_equal(event.stretch_before, snap.stretch_before)
        assert event.stretch_after is snap.stretch_after or np.array_equal(
            np.asarray(event.stretch_after), np.asarray(snap.stretch_after)
        )


def test_a_neo_hookean_balloon_stops_where_its_field_says() -> None:
    scenario = single({"inflate": 1.2}, {"ramp": 0.4}, ambient=0.0, elastomer={"model": "neo-hookean"})
    (lost,) = on_the_path(simulate(scenario))[:1]
    assert lost.voltage[0] ** 2 == pytest.approx(3.0 * lost.stretch_before[0] ** -8, rel=1e-12)


def rubber_pair(**sections: Any) -> History:
    """A liquid: switched off, the active balloon gives the rubber one what lets it grow past its peak."""
    return simulate(
        pair(
            0.3,
            {"ramp": 0.7, "valve": "open"},
            {"inflate": 0.8},
            {"ramp": 0.0},
            J_lim=60.0,
            passive={"elastomer": {"preset": "natural-rubber"}},
            gas={"ambient_pressure": 1.0, "law": "liquid"},
            **sections,
        )
    )


def test_rubber_without_a_voltage_stops_within_its_falling_branch() -> None:
    # Haughton & Ogden's range of Ogden's rubber, in which its tension falls as it grows.
    found = [event for event in on_the_path(rubber_pair()) if event.balloon == "passive"]
    assert [event.kind for event in found] == [LOST, REGAINED]
    assert [event.stretch_before[1] for event in found] == pytest.approx([1.771879, 2.545318], abs=1e-6)


@pytest.mark.parametrize("points", [2, 7, 300])
def test_events_do_not_depend_on_samples(points: int) -> None:
    few = shapes(rubber_pair(output={"points": points}))
    many = shapes(rubber_pair())
    assert [event.time for event in few] == pytest.approx([event.time for event in many], rel=1e-13)


def test_what_is_lost_going_up_is_regained_going_back() -> None:
    history = simulate(pair(1.2, {"ramp": 0.33}, {"ramp": 0.0}, {"ramp": 0.33}, ambient=0.015))
    found = shapes(history)
    assert [event.kind for event in found] == [LOST, REGAINED, LOST]
    assert [event.step for event in found] == [2, 3, 4]
    for event in found:
        assert event.voltage[0] == pytest.approx(0.314060834937, abs=1e-11)
    assert history.outcome is Outcome.COMPLETED
    assert np.all(np.diff(history.time) >= 0.0)
    assert history.energy_balance.relative_imbalance < 1e-12


def test_the_history_beside_is_that_of_spheres() -> None:
    written = pair(1.2, {"ramp": 0.4}, {"ramp": 0.0}, ambient=0.015).to_dict()
    watched, ignored = (
        simulate(load_scenario(written | {"shape": {"on_loss": how}})) for how in ("record", "ignore")
    )
    assert ignored.sphericity.size == 0
    assert shapes(ignored) == []
    extra = np.array([event.time for event in on_the_path(watched)])
    kept = ~np.isin(watched.time, extra)
    assert np.array_equal(watched.stretch[kept], ignored.stretch)
    assert np.array_equal(watched.branch[kept], ignored.branch)
    assert [e.time for e in watched.events if e not in shapes(watched)] == [e.time for e in ignored.events]
    assert watched.energy_balance.imbalance == ignored.energy_balance.imbalance


def test_a_history_may_stop_there() -> None:
    history = simulate(
        pair(1.2, {"ramp": 0.4, "over": 10}, {"ramp": 0.0}, ambient=0.015, shape={"on_loss": "stop"})
    )
    assert history.outcome is Outcome.LOSS_OF_SPHERICITY
    (lost,) = history.events
    assert lost.kind is LOST
    assert history.time[-1] == lost.time == pytest.approx(1.0 + 10 * 0.314060834937 / 0.4, abs=1e-9)
    assert history.stretch[-1, 0] == pytest.approx(1.576385226125, abs=1e-9)
    assert history.energy_balance.relative_imbalance < 1e-12


def test_a_history_may_stop_at_a_landing() -> None:
    written = load_scenario("scenarios/vhb_snap.toml").to_dict()
    history = simulate(load_scenario(written | {"shape": {"on_loss": "stop"}}))
    assert history.outcome is Outcome.LOSS_OF_SPHERICITY
    assert [event.kind for event in history.events] == [EventKind.LIMIT_POINT, LOST]
    assert history.time[-1] == history.events[-1].time


def test_a_jump_is_judged_by_where_it_comes_to_rest() -> None:
    history = simulate(pair(1.2, {"jump": 0.33}, {"hold": 1}, {"jump": 0.0}, ambient=0.015))
    assert [event.kind for event in history.events] == [EventKind.JUMP, LOST, EventKind.JUMP, REGAINED]


def test_a_given_charge_does_not_help() -> None:
    history = simulate(load_scenario("scenarios/charge_control.toml"))
    (lost,) = [event for event in on_the_path(history) if event.kind is LOST][:1]
    assert lost.voltage[0] == pytest.approx(0.314060834937, abs=1e-11)


def test_the_order_of_the_balloons_does_not_matter() -> None:
    written = load_scenario("scenarios/ring.toml").to_dict()
    turned = written | {"balloon": written["balloon"][::-1]}
    there, back = (shapes(simulate(load_scenario(one))) for one in (written, turned))
    assert [(e.kind, e.balloon) for e in there] == [(e.kind, e.balloon) for e in back]
    assert [e.time for e in there] == pytest.approx([e.time for e in back], rel=1e-10)


@pytest.mark.parametrize(
    "elastomer",
    [Gent(5.0), Gent(1e4), NeoHookean(), MooneyRivlin(1.0, 0.2), ArrudaBoyce(3.0), Fung(0.05)],
    ids=str,
)
def test_elastomers_that_stay_spheres_without_a_voltage(elastomer: Gent) -> None:
    assert elastomer.stays_spherical
    wall = Membrane.of(elastomer, 1.0, 1.0, 1.0)
    stretch = np.linspace(1.0, min(0.999 * elastomer.stretch_limit, 20.0), 2001)
    assert np.all(sphericity(wall, stretch, 0.0) > 0.0)
    assert shape_conditions(OpenBalloon(wall, 0.0, 1.0)) == ()


@pytest.mark.parametrize("voltage", [0.0, 0.3])
def test_the_margin_is_that_of_the_second_variation(voltage: float) -> None:
    wall = Membrane.of(Gent(60.0), 1.3, 0.7, 2.0)
    membrane = ElectrodedMembrane.of(wall, 1.3, 0.7, 2.0, 1.5, AffineDrive(0.0, 1.0, "voltage"))
    for stretch in (1.1, 2.0, 4.5):
        elastic = closed_form.Gent(60.0).coefficients(stretch).margin
        s = 2.0 * elastic - 4.0 * 1.5 / 0.7**2 * voltage**2 * stretch**2
        denominator = Gent(60.0).pole_form(stretch)[1]
        found = sphericity(membrane, stretch, voltage) * 2.0 / denominator**2
        assert found == pytest.approx(s, rel=1e-12)


def test_an_ogden_film_that_shears() -> None:
    # Where ½Σ mᵢαᵢλ^(αᵢ−2) is negative a film shears in its own surface, whatever holds the balloon.
    film = Ogden((0.2, -1.2, -1.4), (2.0, 1.0, -2.0))
    assert film.shear_stiffness is not None
    for stretch in (1.0, 1.5, 2.0, 3.0):
        expected = closed_form.Ogden(film.mu, film.alpha).coefficients(stretch).baker_ericksen
        assert film.shear_stiffness(stretch) == pytest.approx(expected, rel=1e-13)
    assert film.shear_stiffness(2.0) < 0.0 < film.shear_stiffness(1.0)
    assert Ogden((6.3, 0.012, -0.1), (1.3, 5.0, -2.0)).shear_stiffness is None
    elastomer = {"model": "ogden", "mu": list(film.mu), "alpha": list(film.alpha)}
    found = shapes(simulate(single({"inflate": 7.5}, elastomer=elastomer)))
    assert [(event.kind, event.mode) for event in found] == [(LOST, "shear"), (REGAINED, "shear")]
    for event, stretch in zip(found, (1.800274390265163, 2.6031936535037), strict=True):
        assert event.stretch_before[0] == pytest.approx(stretch, abs=1e-4)
        assert film.shear_stiffness(float(event.stretch_before[0])) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("how", ["record", "stop"])
def test_in_real_time_it_is_lost_where_the_margin_vanishes(how: str) -> None:
    written = load_scenario("scenarios/fig3c_state_b.toml").to_dict() | {"shape": {"on_loss": how}}
    late = []
    for time in (1e-3, 1e-4):
        history = simulate(load_scenario(written | {"dynamics": {"relaxation_time": time}}))
        found = shapes(history)
        late.append(found[0].voltage[0] - 0.314060834937)
        row = int(np.flatnonzero(history.time == found[0].time)[0])
        assert history.sphericity[row, 0] == pytest.approx(0.0, abs=1e-6)
        assert [event.kind for event in found] == ([LOST, REGAINED] * 2 if how == "record" else [LOST])
        assert (history.outcome is Outcome.LOSS_OF_SPHERICITY) == (how == "stop")
        assert history.energy_balance.relative_imbalance < 1e-8
    # On a branch the balloons lag behind the drive by a time in proportion to their own.
    assert late[0] / late[1] == pytest.approx(10.0, rel=0.02)


def test_in_real_time_a_jump_of_the_voltage_is_judged_at_once() -> None:
    scenario = pair(
        1.2,
        {"jump": 1.0},
        {"hold": 1e-3},
        {"jump": 0.0},
        {"hold": 1},
        ambient=0.015,
        dynamics={"relaxation_time": 0.1},
    )
    found = shapes(simulate(scenario))
    assert [(event.kind, event.time) for event in found] == [
        (LOST, 1.0),
        (REGAINED, pytest.approx(1.001)),
    ]


def test_a_sphere_may_be_lost_and_regained_at_one_instant() -> None:
    """The rows of its events are told by their order: before and after the voltage is the same."""
    written = pair(
        1.2, {"jump": 1.0}, {"jump": 0.0}, {"hold": 1}, dynamics={"relaxation_time": 0.1}
    ).to_dict()
    history = simulate(load_scenario(written | {"output": {"points": 301}}))
    assert [event.kind for event in shapes(history)] == [LOST, REGAINED]
    assert len({event.time for event in shapes(history)}) == 1
    assert np.array_equal(lost_rows(history), history.sphericity.min(axis=1) < 0.0)
    assert problems_of(history) == []


def ends(**until: object) -> dict[str, object]:
    return {"until": {"event": "loss_of_sphericity", **until}}


def test_a_step_may_end_where_a_sphere_is_lost() -> None:
    steps = ({"ramp": 0.4, **ends()}, {"ramp": 0.0}, {"ramp": 0.4, **ends()}, {"ramp": 0.0, **ends()})
    history = simulate(pair(1.2, *steps, ambient=0.015))
    assert [stop.reached for stop in history.stops] == ["loss_of_sphericity"] * 2 + [None]
    for stop in history.stops[:2]:
        at = history.step == stop.step
        assert history.voltage[at][-1, 0] == pytest.approx(0.314060834937, abs=1e-11)
        assert history.time[at][-1] == stop.time
    assert [event.kind for event in shapes(history)] == [LOST, REGAINED, LOST, REGAINED]


def test_a_step_may_end_where_a_snap_lands_as_no_sphere() -> None:
    written = load_scenario("scenarios/vhb_snap.toml").to_dict()
    written["step"][1] |= ends()
    history = simulate(load_scenario(written))
    (stop,) = history.stops
    snap, lost = history.events[:2]
    assert stop.reached == lost.kind == LOST
    assert stop.time == snap.time == lost.time
    assert history.events[2].step == 3


def test_what_comes_first_ends_a_step() -> None:
    for limit, reached in ((0.3, "field_active = 0.3"), (3.0, "loss_of_sphericity")):
        history = simulate(pair(1.2, {"ramp": 0.4, **ends(field=limit)}, ambient=0.015))
        assert [stop.reached for stop in history.stops] == [reached]


@pytest.mark.parametrize("how", ["stop", "ignore"])
def test_no_step_ends_there_where_shapes_are_not_recorded(how: str) -> None:
    with pytest.raises(ScenarioError, match="on_loss"):
        pair(1.2, {"ramp": 0.4, **ends()}, shape={"on_loss": how})


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("fig3c_state_b", "pear_before_snap"),
        ("fig5b_state_b", "snap_of_a_sphere"),
        ("fig3a_state_c", "sphere"),
        ("fig3a_state_a", "pear_without_snap"),
        ("vhb_snap", "pear_at_landing"),
        ("fig5c_state_a", "pear_after_snap"),
    ],
)
def test_what_becomes_of_the_shape_in_one_word(name: str, word: str) -> None:
    history = simulate(load_scenario(f"scenarios/{name}.toml"))
    row = facts(history, 4)
    assert row["shape"] == word
    assert row["least_sphericity_active"] == history.sphericity[:, 0].min()
    lost = shapes(history)
    assert row.get("sphericity_voltage_active") == (lost[0].voltage[0] if lost else None)
    ignored = facts(run(load_scenario(f"scenarios/{name}.toml")), 4)
    # The work exchanged is a size only, summed between samples, of which events are some.
    same = ignored.keys() - {"shape", "outcome", "behaviour", "exchanged"}
    assert {key: row[key] for key in same} == pytest.approx({key: ignored[key] for key in same})
    assert row["behaviour"] == ignored["behaviour"]
    assert ignored["shape"] is None


SHEARING = {"model": "ogden", "mu": [0.2, -1.2, -1.4], "alpha": [2, 1, -2]}


def with_a_third(inflate: float, ambient: float, **third: float) -> History:
    """Fig. 5b, state B with a small third balloon that may shear."""
    written = load_scenario("scenarios/fig5b_state_b.toml").to_dict()
    balloons = [*written["balloon"], {"name": "third", "elastomer": SHEARING, **third}]
    steps = [{"inflate": inflate}, {"ramp": 0.5}]
    gas = {"ambient_pressure": ambient}
    return simulate(load_scenario(written | {"gas": gas, "balloon": balloons, "step": steps}))


@pytest.mark.parametrize(
    ("inflate", "ambient", "radius", "modulus", "word"),
    [
        (1.6, 0.05, 0.1, 0.02, "shear_before_snap"),
        (1.2, 0.5, 0.2, 0.02, "shear_without_snap"),
        (2.0, 0.2, 0.05, 0.5, "pear_in_snap"),
    ],
)
def test_words_of_losses_by_shear_and_on_the_way(
    inflate: float, ambient: float, radius: float, modulus: float, word: str
) -> None:
    history = with_a_third(inflate, ambient, radius=radius, modulus=modulus)
    assert facts(history, 4)["shape"] == word
    lost = [event for event in shapes(history) if event.kind is LOST]
    assert lost[0].mode == word.partition("_")[0]
    if lost[0].mode == "shear":
        assert lost[0].balloon == "third"
        # The lower zero of ½Σ mᵢαᵢλ^(αᵢ−2), passed by the inflation.
        assert lost[0].stretch_before[2] == pytest.approx(1.800274390265163, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        (
            "fig3c_state_b",
            [
                "active would stop being a sphere at 0.31406 (λ 1.5764, rising), before its limit point; "
                "and once more, see events.csv",
                "passive stays a sphere",
            ],
        ),
        ("fig5b_state_b", ["all balloons stay spheres"]),
        (
            "vhb_snap",
            ["active would come to rest as no sphere at 4.41467 kV (λ 2.4665)", "passive stays a sphere"],
        ),
    ],
)
def test_the_summary_says_it_in_a_sentence(name: str, lines: list[str]) -> None:
    assert list(shape_lines(simulate(load_scenario(f"scenarios/{name}.toml")))) == lines
    assert list(shape_lines(run(load_scenario(f"scenarios/{name}.toml")))) == []


def test_the_summary_names_what_it_assumes() -> None:
    lines = list(shape_lines(simulate(load_scenario("tests/cases/trace-tabulated-sealed.toml"))))
    assert any("known about equal stretches only" in line for line in lines)


def test_which_samples_no_sphere_is_in() -> None:
    for name in ("fig3c_state_b", "vhb_snap", "fig5c_state_a", "fig5b_state_b"):
        history = simulate(load_scenario(f"scenarios/{name}.toml"))
        below = history.sphericity.min(axis=1) < 0.0
        at_zero = np.abs(history.sphericity).min(axis=1) < 1e-9
        assert np.array_equal(lost_rows(history)[~at_zero], below[~at_zero])


def test_the_record_of_a_run_says_what_becomes_of_the_shapes() -> None:
    record = run_record(simulate(load_scenario("scenarios/fig3c_state_b.toml")))
    active, passive = record["shapes"]
    assert [loss["place"] for loss in active["losses"]] == ["path", "path"]
    assert not active["sphere"]
    assert passive["sphere"]
    assert "shapes" not in run_record(run(load_scenario("scenarios/fig3c_state_b.toml")))


def test_a_sweep_has_words_and_numbers_of_shapes_where_they_are_asked_for(tmp_path: Path) -> None:
    asked = {"scenario": "scenarios/fig3c_state_b.toml", "vary": {"step.1.inflate": [0.6, 1.2, 1.3]}}
    run_sweep(asked, tmp_path / "plain")
    assert "shape" not in load_table(tmp_path / "plain")
    run_sweep(asked | {"record": {"shapes": True}}, tmp_path / "shapes")
    table = load_table(tmp_path / "shapes")
    assert table["shape"].tolist() == ["sphere", "pear_before_snap", "sphere"]
    voltages = table["sphericity_voltage_active"].to_numpy()
    assert voltages[1] == pytest.approx(0.314060834937, abs=1e-11)
    assert np.isnan(voltages[[0, 2]]).all()
    assert (table["least_sphericity_active"].to_numpy() < 0.0).tolist() == [False, True, False]


def test_an_optimum_may_be_asked_to_stay_a_sphere() -> None:
    found = optimize(
        {
            "scenario": "scenarios/fig3c_state_b.toml",
            "maximize": "largest_stretch_active",
            "where": {"shape": ["sphere"]},
            "vary": {"step.2.ramp": {"from": 0.1, "to": 0.4}},
            "search": {"population": 5, "generations": 3},
        }
    )
    assert found.row is not None
    assert found.row["step.2.ramp"] <= 0.314060834937


def test_where_an_outline_has_the_other_sign_the_state_is_found() -> None:
    history = simulate(load_scenario("tests/cases/shape-outline.toml"))
    (lost,) = [event for event in on_the_path(history) if event.kind is LOST]
    row = int(np.flatnonzero(history.time == lost.time)[0])
    assert history.sphericity[row, 1] == pytest.approx(0.0, abs=1e-9)


def test_where_an_outline_is_far_off_the_points_of_the_branch_tell() -> None:
    """The outline has its change of sign elsewhere between the two points that have unlike signs."""
    written = load_scenario("tests/cases/shape-far.toml").to_dict() | {"output": {"points": 301}}
    history = simulate(load_scenario(written))
    assert len(shapes(history)) == 9
    assert problems_of(history) == []
