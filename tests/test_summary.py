"""What a run says at the end: numbers, hints, and no line longer than a window of 80 columns."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simulator import History, load_scenario, simulate, trace
from simulator.cli.hints import elastomer_hints, hint_lines, inflation_turns
from simulator.cli.summary import summarise_run, summarise_trace
from simulator.results.record import run_record
from simulator.results.summary import loop_works, not_played, residual
from simulator.scenario.elastomer import Tabulated

GENT = {"model": "gent", "J_lim": 100}
SHIPPED = sorted(Path("scenarios").glob("*.toml"))
VACUUM = 8.8541878128e-12


@pytest.fixture(scope="module")
def shipped() -> dict[str, History]:
    """The histories of the shipped scenarios of up to three balloons."""
    scenarios = {path.stem: load_scenario(path) for path in SHIPPED}
    return {name: simulate(s) for name, s in scenarios.items() if len(s.balloons) <= 3}


def made(*steps: dict[str, Any], **more: Any) -> dict[str, Any]:
    balloons = [
        {"name": "active", "elastomer": more.pop("elastomer", GENT), "electrodes": True},
        {"name": "passive", "elastomer": GENT},
    ]
    return {
        "title": "Two", "gas": {"ambient_pressure": 0.015}, "balloon": balloons, "step": list(steps), **more,
    }  # fmt: skip


def told(history: History, capsys: pytest.CaptureFixture[str]) -> str:
    summarise_run(history, [Path("results/run/history.csv")])
    return capsys.readouterr().out


def words(text: str) -> str:
    """A text without the ends of its lines."""
    return " ".join(text.split())


def test_80_columns_are_enough_for_the_paths_of_three_balloons(capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    for name in ("ring", "push_pull", "vhb_snap", "fig3c_state_b"):
        curve = trace(f"scenarios/{name}.toml")
        summarise_trace([curve], [Path("results/trace/curve.csv")], asked=False)
        text = capsys.readouterr().out
        assert max(map(len, text.splitlines())) <= 80, name
        for point in curve.points:
            for stretch in point.stretch:
                assert f" {stretch:.6g} " in text.replace("\n", " "), name


def test_80_columns_are_enough_up_to_three_balloons(shipped, capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert {"push_pull", "ring", "vhb_snap"} <= shipped.keys()
    for name, history in shipped.items():
        text = told(history, capsys)
        assert max(map(len, text.splitlines())) <= 80, name
        for event in history.events[:20]:
            for value in (*event.stretch_before, *(event.stretch_after if event.dissipated else ())):
                assert f" {value:.6g} " in text.replace("\n", " "), name
        assert "…" not in text.replace("… and", "")


def test_every_summary_says_the_largest_values(shipped, capsys) -> None:
    history = shipped["vhb_snap"]
    text = told(history, capsys)
    active, passive = history.extremes.largest_stretch
    assert f"\nstretch  largest active {active:.6g}, passive {passive:.6g}\n" in text
    given = json.loads(json.dumps(history.scenario.scales.record()))
    unit = math.sqrt(given["shear_modulus [Pa]"] / (given["permittivity"] * VACUUM))
    field = history.extremes.largest_field[0]
    assert f"\nfield    largest active {field * unit / 1e6:.6g} MV/m\n" in text
    # The largest field is that of φλ² over the film's thickness in its place, at the top of the ramp.
    assert field == pytest.approx(np.abs(history.field).max(), rel=1e-3)
    summary = run_record(history)["summary"]
    assert summary["largest_stretch"] == {"active": active, "passive": passive}
    assert summary["largest_field"] == {"active": field}
    assert summary["largest_field [V/m]"]["active"] == pytest.approx(field * unit, rel=1e-14)
    assert "steps_not_played" not in summary
    assert "loop_work" not in summary


def test_the_work_of_loops_is_what_events_lose(shipped, capsys) -> None:
    history = shipped["push_pull"]
    lost = sum(event.dissipated or 0.0 for event in history.events) / 3.0
    (work,) = loop_works(history)
    assert work == pytest.approx(lost, rel=1e-9)
    assert f"\ncycles   3 complete, loop work {work:.6g} in each\n" in told(history, capsys)
    assert run_record(history)["summary"]["loop_work"] == [work]
    assert run_record(history)["summary"]["complete_cycles"] == 3


def test_loops_that_differ_are_told_by_the_first_and_the_last(capsys) -> None:
    wave = {"triangle": {"low": 0.0, "high": 0.3, "period": 2.0, "cycles": 2.5}}
    history = simulate(made({"inflate": 1.2}, wave, dynamics={"relaxation_time": 0.5}))
    works = [cycle.total_work for cycle in history.cycles]
    assert len(works) == 3
    assert loop_works(history) == (works[0], works[1])
    text = told(history, capsys)
    assert f"cycles   2 complete, loop work {works[0]:.6g} in the first, {works[1]:.6g} in the last\n" in text
    assert residual(history) is None  # the voltage is on at the end
    assert "residual" not in text


def test_what_a_voltage_leaves_behind(shipped, capsys) -> None:
    history = shipped["fig3c_state_b"]
    left = residual(history)
    assert left is not None
    # Both are the spheres of the inflation: the gas is the same, and so is the branch.
    np.testing.assert_allclose(left.after, left.before, rtol=1e-9)
    assert "\nresidual stretch after the voltage active 1.26258, passive 1.26258, as before it\n" in told(
        history, capsys
    )
    history = shipped["keplinger_chamber"]
    at_end, start = history.at(float(history.time[-1])), history.at(1.0)
    text = words(told(history, capsys))
    after, before = at_end["stretch_membrane"], run_record(history)["summary"]["stretch_before_voltage"]
    assert at_end["voltage_membrane"] == 0.0 == start["voltage_membrane"]
    assert f"residual stretch after the voltage membrane {after:.6g}; before it membrane" in text
    assert run_record(history)["summary"]["residual_stretch"] == {"membrane": after}
    assert before["membrane"] < 0.5 * after


def test_steps_that_an_end_leaves_are_told(shipped, capsys) -> None:
    history = shipped["fig3a_state_a"]
    assert history.outcome == "loss_of_tension"
    assert (int(history.step[-1]), not_played(history)) == (2, (3, 4))
    assert "\nunplayed steps 3 to 4 of 4\n" in told(history, capsys)
    assert run_record(history)["summary"]["steps_not_played"] == [3, 4]
    assert not_played(shipped["fig3c_state_b"]) is None
    up, down = {"ramp": 0.9, "over": 1.0}, {"ramp": 0.0, "over": 1.0}
    nested = {"cycle": 1000, "steps": [{"cycle": 4, "steps": [up, down]}]}
    lost = simulate(made({"inflate": 0.9}, nested, {"hold": 1.0}))
    assert not_played(lost) == (3, 8002)
    assert "unplayed steps 3 to 8002 of 8002\n" in told(lost, capsys)


def test_a_forgotten_inflation_is_hinted_at(capsys) -> None:
    history = simulate(made({"ramp": 0.2, "over": 1.0}))
    assert (history.outcome, float(history.time[-1])) == ("loss_of_tension", 0.0)
    assert "no step up to step 1 inflates the balloons" in words(told(history, capsys))
    assert not list(hint_lines(simulate(made({"inflate": 0.9}, {"ramp": 0.9, "over": 1.0}))))


def test_a_field_that_no_film_withstands_is_hinted_at(shipped) -> None:
    written = shipped["vhb_snap"].scenario.to_dict()
    assert not list(hint_lines(shipped["vhb_snap"]))
    stiff = load_scenario(written).with_values(
        {"scales.shear_modulus": "2 GPa", "step.1.inflate": 0.5, "step.2.ramp": 0.3}
    )
    assert stiff.scales is not None
    largest = simulate(stiff).extremes.largest_field[0] * stiff.scales.field
    hints = list(hint_lines(simulate(stiff)))
    assert largest > 1e9
    assert len(hints) == 1
    assert f"the field of active reaches {largest / 1e9:.4g} GV/m" in hints[0]
    assert "balloon.active.breakdown names a strength" in hints[0]


def test_an_ogden_term_of_the_wrong_sign_is_hinted_at() -> None:
    (hint,) = elastomer_hints(load_scenario("tests/cases/ogden-negative-term.toml"))
    assert hint.startswith("balloon.a.elastomer: term 2 has mu alpha < 0 (4e+07, -2)")
    right = made({"inflate": 1.0}, elastomer={"model": "ogden", "mu": [1.0, -0.1], "alpha": [2, -2]})
    assert not list(elastomer_hints(load_scenario(right)))


def test_limit_points_that_no_measured_row_shows_are_hinted_at(tmp_path) -> None:
    (hint,) = elastomer_hints(load_scenario("scenarios/treloar_pair.toml"))
    assert hint.startswith("balloon.active.elastomer, balloon.passive.elastomer: the curve through the rows")
    assert "no row shows, at stretch 4.385:" in hint

    def rows(digits: int) -> Tabulated:
        stretch = np.linspace(1.0, 4.0, 200)
        pressure = 2.0 * (1.0 / stretch - stretch**-7) * (1.0 + 0.1 * stretch**2)
        lines = [
            f"{x!r},{round(float(p), digits)!r}" for x, p in zip(stretch.tolist(), pressure, strict=True)
        ]
        file = tmp_path / f"rows{digits}.csv"
        file.write_text("\n".join(["stretch,pressure", *lines]))
        return Tabulated(model="tabulated", table=str(file))

    # Of 2(λ⁻¹ − λ⁻⁷)(1 + λ²/10), Mooney–Rivlin, times λ⁸ its slope is 0 at λ⁸ − 10 λ⁶ + 5 λ² + 70 = 0.
    zeros = np.roots([1.0, 0.0, -10.0, 0.0, 0.0, 0.0, 5.0, 0.0, 70.0])
    exact = sorted(float(z.real) for z in zeros if abs(z.imag) < 1e-12 and z.real > 1.0)
    assert [place for place, _ in inflation_turns(rows(15))] == pytest.approx(exact, rel=1e-7)
    assert len(exact) == 2
    for digits, count in ((15, 0), (2, 1)):
        law = {"model": "tabulated", "table": rows(digits).table}
        hints = list(elastomer_hints(load_scenario(made({"inflate": 0.5}, elastomer=law))))
        assert sum("should the rows be smoothed?" in hint for hint in hints) == count
        assert bool(hints) == bool(count)
