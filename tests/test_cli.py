"""The command `balloons`: exit codes, what is printed where, and what is left on disk."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import textwrap
import time
from importlib import import_module
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from simulator.cli import app, summary, summary_run
from simulator.results.history import Outcome
from tests.histories import cycled_pair, slack_pair

ROOT = Path(__file__).parent.parent
FIG3C = ROOT / "scenarios/fig3c_state_b.toml"

SCENARIO = """
title = "A made-up pair"
[gas]
ambient_pressure = 0.015
[[balloon]]
name = "active"
electrodes = true
elastomer = { model = "gent", J_lim = 100 }
[[balloon]]
name = "passive"
elastomer = { model = "gent", J_lim = 100 }
[[step]]
inflate = 1.2
[[step]]
ramp = 0.4
over = 1
[[step]]
ramp = 0.0
over = 1
"""


@pytest.fixture
def scenario(tmp_path, monkeypatch):
    """A scenario file in an otherwise empty current directory."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "pair.toml"
    path.write_text(SCENARIO, "utf-8")
    return path


@pytest.fixture
def simulate(monkeypatch):
    """Put something in the place of the physics, where physics is not the point."""
    room = import_module("simulator.simulation.run")

    def put(result: object) -> None:
        def played(scenario: object, *, progress: object = None) -> object:
            if isinstance(result, BaseException):
                raise result
            return result

        monkeypatch.setattr(room, "simulate", played)

    return put


def balloons(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def subprocess_environment(**more: str) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT), **more}


def process(*arguments: object, **more: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "simulator", *map(str, arguments)],
        capture_output=True,
        text=True,
        encoding="utf-8",
        env=subprocess_environment(**more),
        check=False,
    )


def files(directory: Path) -> list[str]:
    return sorted(str(path.relative_to(directory)) for path in directory.rglob("*") if path.is_file())


# --- a run that ends well ---


def test_run_writes_under_results_by_default(scenario, simulate):
    simulate(cycled_pair())
    result = balloons("run", scenario)
    assert result.exit_code == 0
    assert files(scenario.parent) == [
        "pair.toml", "results/pair/events.csv", "results/pair/history.csv", "results/pair/run.json",
    ]  # fmt: skip


def test_run_writes_where_it_is_told_and_draws_when_asked(scenario, simulate, tmp_path):
    simulate(cycled_pair())
    assert balloons("run", scenario, "--out", tmp_path / "here" / "there", "--plot").exit_code == 0
    assert files(tmp_path / "here") == [
        "there/events.csv", "there/history.csv", "there/history.png", "there/run.json",
    ]  # fmt: skip
    assert (tmp_path / "here/there/history.png").read_bytes().startswith(b"\x89PNG")


def test_summary_tells_outcome_events_energy_and_files(scenario, simulate):
    simulate(cycled_pair())
    result = balloons("run", scenario)
    assert result.stderr == ""
    for told in (
        "Fig. 3c, state B",
        "outcome  completed at time 2",
        "events   2",
        "limit_point",
        "2.06",
        "0.482572",
        "0.00262142",
        "3.44752",
        "4.9e-15 of the work exchanged",
        f"files    {Path('results/pair')}: history.csv, events.csv, run.json",
    ):
        assert told in result.stdout


def test_physical_endings_are_results(scenario, simulate):
    simulate(slack_pair())
    result = balloons("run", scenario)
    assert result.exit_code == 0
    assert "outcome  loss_of_tension at time 0.7" in result.stdout


def test_quiet_prints_nothing(scenario, simulate):
    simulate(cycled_pair())
    result = balloons("run", scenario, "--quiet")
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")
    assert (scenario.parent / "results/pair/run.json").exists()


def test_only_the_first_events_are_listed(scenario, simulate):
    simulate(cycled_pair(cycles=20))
    output = balloons("run", scenario).stdout
    assert output.count("limit_point") == summary_run.EVENTS_SHOWN
    assert f"… and {40 - summary_run.EVENTS_SHOWN} more" in output


@pytest.mark.parametrize("columns", ["30", "80", "400"])
def test_numbers_are_whole_however_narrow_the_window(scenario, simulate, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", columns)
    history = cycled_pair()
    simulate(history)
    output = balloons("run", scenario).stdout
    assert "…" not in output
    for event in history.events:
        for value in (*event.stretch_before, *event.stretch_after, event.pressure_after, event.dissipated):
            assert f" {value:.6g} " in output.replace("\n", "  ")


def test_titles_are_printed_as_they_are_and_do_nothing_to_the_terminal(scenario, simulate, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    history = cycled_pair()
    history.scenario.title = "[bold red]λ[/bold red] [/] \x1b[2J\r:smile: $x$"
    simulate(history)
    assert balloons("run", scenario).stdout.startswith("[bold red]λ[/bold red] [/]  [2J :smile: $x$\n")


def test_piped_output_has_no_colours(scenario, simulate):
    simulate(cycled_pair())
    assert "\x1b" not in balloons("run", scenario).stdout


# --- a run that does not ---


def assert_refused(result: Result, directory: Path, *words: str) -> None:
    assert result.exit_code == 2
    for word in words:
        assert word in result.stderr
    assert result.stdout == ""
    assert "Traceback" not in result.stderr
    assert files(directory) == ["pair.toml"]


def test_missing_scenario(scenario):
    assert_refused(balloons("run", "nowhere.toml"), scenario.parent, "nowhere.toml")
    assert_refused(balloons("explain", "nowhere.toml"), scenario.parent, "nowhere.toml")


def test_senseless_scenario(scenario):
    scenario.write_text(SCENARIO.replace("ambient_pressure = 0.015", "ambient_pressure = -1"), "utf-8")
    for command in ("run", "explain"):
        assert_refused(balloons(command, scenario), scenario.parent, "pair.toml", "ambient_pressure", "-1")


@pytest.mark.parametrize("place", ["pair.toml", "pair.toml/deeper/down"])
def test_output_directory_that_cannot_be(scenario, simulate, place):
    simulate(AssertionError("played before looking where to write"))
    assert_refused(
        balloons("run", scenario, "--out", place), scenario.parent, "cannot write", "Not a directory"
    )


def test_usage(scenario):
    assert_refused(balloons("run"), scenario.parent, "SCENARIO")
    assert_refused(balloons("fly", scenario), scenario.parent, "fly")
    assert_refused(balloons("run", scenario, "--loud"), scenario.parent, "--loud")


def test_solver_failure_keeps_what_was_reached(scenario, simulate):
    from simulator.simulation.run import SolverError

    simulate(SolverError("step 1, time 0.7: the corrector does not converge", slack_pair(Outcome.FAILED)))
    result = balloons("run", scenario, "--plot")
    assert result.exit_code == 3
    assert result.stdout == ""
    for word in ("step 1, time 0.7", "does not converge", "partial history", str(Path("results/pair"))):
        assert word in result.stderr
    record = json.loads((scenario.parent / "results/pair/run.json").read_text("utf-8"))
    assert record["partial"] is True
    assert record["outcome"] == "failed"
    assert "does not converge" in record["failure"]
    assert (scenario.parent / "results/pair/history.csv").exists()
    assert (scenario.parent / "results/pair/history.png").exists()


def test_solver_failure_before_the_first_sample(scenario, simulate):
    from simulator.simulation.run import SolverError

    simulate(SolverError("step 1, time 0: nothing converges", None))
    result = balloons("run", scenario)
    assert result.exit_code == 3
    assert "nothing written" in result.stderr
    assert files(scenario.parent) == ["pair.toml"]


def test_interrupt_writes_nothing(scenario, simulate):
    simulate(KeyboardInterrupt())
    result = balloons("run", scenario)
    assert result.exit_code == 130
    assert "nothing written" in result.stderr
    assert files(scenario.parent) == ["pair.toml"]


def interrupt(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


def test_interrupt_while_writing_writes_nothing(scenario, simulate, monkeypatch):
    simulate(cycled_pair())
    monkeypatch.setattr("simulator.results.tables.write_run", interrupt)
    assert balloons("run", scenario, "--plot").exit_code == 130
    assert files(scenario.parent) == ["pair.toml"]


def test_interrupt_while_drawing_leaves_the_tables_and_says_so(scenario, simulate, monkeypatch):
    simulate(cycled_pair())
    monkeypatch.setattr("simulator.results.plot.style.rendered", interrupt)
    stopped = balloons("run", scenario, "--plot")
    assert stopped.exit_code == 130
    assert "interrupted; history.csv, events.csv, run.json are in" in stopped.stderr
    assert (scenario.parent / "results/pair/history.csv").exists()
    assert not (scenario.parent / "results/pair/history.png").exists()


@pytest.mark.parametrize(
    "words", [("run",), ("trace",), ("fold", "--vary", "gas.ambient_pressure", "--to", "0.02")]
)
def test_a_picture_that_cannot_be_drawn_is_a_warning(words, tmp_path, monkeypatch):
    def fail(*_: object) -> None:
        raise RuntimeError("no\nfonts")

    monkeypatch.setattr("simulator.results.plot.style.rendered", fail)
    command, *options = words
    done = balloons(command, FIG3C, *options, "--plot", "--out", tmp_path)
    assert done.exit_code == 0
    assert "png could not be drawn: no fonts" in done.stderr
    assert any(tmp_path.glob("*.csv"))
    assert not any(tmp_path.glob("*.png"))


def test_formats(scenario, simulate):
    simulate(cycled_pair())
    folder = scenario.parent / "results/pair"
    for form, begins in (("svg", b"<?xml"), ("pdf", b"%PDF"), ("png", b"\x89PNG")):
        assert balloons("run", scenario, "--format", form).exit_code == 0
        picture = folder / f"history.{form}"
        first = picture.read_bytes()
        assert first.startswith(begins)
        assert balloons("run", scenario, "--format", form).exit_code == 0
        assert picture.read_bytes() == first  # of the same history the same bytes
        assert files(folder) == ["events.csv", "history.csv", picture.name, "run.json"]
    assert balloons("run", scenario, "--format", "gif").exit_code == 2


def test_what_an_earlier_run_left_beside_new_tables_goes(scenario, simulate):
    simulate(cycled_pair())
    folder = scenario.parent / "results/pair"
    assert balloons("run", scenario, "--plot").exit_code == 0
    for name in ("sensitivities.csv", "cycles.csv", "loops.csv"):
        (folder / name).write_text("old")
    (folder / "notes.txt").write_text("mine")
    again = balloons("run", scenario)
    said = "removed  sensitivities.csv, cycles.csv, loops.csv, history.png of an earlier run"
    assert said in again.stdout
    assert sorted(path.name for path in folder.iterdir()) == [
        "events.csv",
        "history.csv",
        "notes.txt",
        "run.json",
    ]


def test_pictures_care_for_nothing_that_a_user_has_set(tmp_path):
    """A backend that is not there, LaTeX that is not there, and a style of one's own."""
    plain, other = tmp_path / "plain", tmp_path / "other"
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\naxes.facecolor: black\nfont.size: 30\n")
    own = {**os.environ, "MPLBACKEND": "not-a-backend", "MATPLOTLIBRC": str(tmp_path)}
    for folder, environment in ((plain, dict(os.environ)), (other, own)):
        words = [
            sys.executable,
            "-m",
            "simulator",
            "run",
            str(FIG3C),
            "--plot",
            "--quiet",
            "--out",
            str(folder),
        ]
        done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")
    assert (plain / "history.png").read_bytes() == (other / "history.png").read_bytes()


# --- the progress bar ---


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def on_a_terminal(monkeypatch) -> Terminal:
    monkeypatch.setenv("TERM", "xterm-256color")
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    return terminal


def test_a_short_run_shows_no_bar(monkeypatch):
    screen = on_a_terminal(monkeypatch)
    with summary.progress_bar(quiet=False) as report:
        for i in range(1000):
            report(i / 1000)
    assert screen.getvalue() == ""


def test_a_long_run_shows_a_bar_and_takes_it_away(monkeypatch):
    screen = on_a_terminal(monkeypatch)
    clock = time.monotonic
    with summary.progress_bar(quiet=False) as report:
        monkeypatch.setattr(time, "monotonic", lambda: clock() + 10.0)  # at work for ten seconds
        report(0.5)
        shown = screen.getvalue()
        started = time.monotonic()
        for _ in range(20_000):
            report(0.75)
        assert time.monotonic() - started < 1.0
    assert "50%" in shown
    assert screen.getvalue().count("%") < 20
    assert "\x1b[2K" in screen.getvalue()[len(shown) :]


def test_no_bar_when_quiet_or_piped(monkeypatch):
    on_a_terminal(monkeypatch)
    with summary.progress_bar(quiet=True) as report:
        assert report is None
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with summary.progress_bar(quiet=False) as report:
        assert report is None


# --- for real ---


def test_version_is_printed():
    done = process("--version")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"balloons {import_module('simulator').__version__}\n"


def test_help_names_the_options():
    done = process("run", "--help", NO_COLOR="1", COLUMNS="120")
    assert done.returncode == 0
    for option in ("--out", "--plot", "--quiet", "SCENARIO"):
        assert option in done.stdout


def test_real_run_in_a_process_of_its_own(scenario):
    done = process("run", scenario)
    assert (done.returncode, done.stderr) == (0, "")
    assert "limit_point" in done.stdout
    record = json.loads((scenario.parent / "results/pair/run.json").read_text("utf-8"))
    assert record["outcome"] == "completed"
    assert record["counts"]["events_by_kind"] == {
        "loss_of_sphericity": 2,
        "limit_point": 2,
        "sphericity_regained": 2,
    }
    assert record["energy_balance"]["relative_imbalance"] < 1e-8
    assert record["scenario"]["gas"] == {"ambient_pressure": 0.015}


def test_real_explanation(scenario):
    done = process("explain", scenario)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.strip()
    assert files(scenario.parent) == ["pair.toml"]


def test_a_terminal_without_greek_letters_is_no_reason_to_stop(scenario):
    scenario.write_text(SCENARIO.replace("A made-up pair", "λ → Φ"), "utf-8")
    done = process("run", scenario, PYTHONIOENCODING="ascii", PYTHONUTF8="0")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("? ? ?\n")


@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX")
def test_real_interrupt(scenario):
    program = f"""
        import os, signal, time
        from importlib import import_module
        from simulator.cli import app
        signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where tests run in the background
        def played(scenario, *, progress=None):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(10)
        import_module("simulator.simulation.run").simulate = played
        app(["run", {str(scenario)!r}])
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        capture_output=True,
        text=True,
        env=subprocess_environment(),
        check=False,
    )
    assert done.returncode == 130
    assert "Traceback" not in done.stderr
    assert files(scenario.parent) == ["pair.toml"]


def test_a_run_without_a_picture_loads_neither_matplotlib_nor_pandas(scenario):
    program = f"""
        import sys
        from simulator.cli import app
        app(["run", {str(scenario)!r}], standalone_mode=False)
        print(*sys.modules)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        capture_output=True,
        text=True,
        env=subprocess_environment(),
        check=False,
    )
    assert done.returncode == 0, done.stderr
    loaded = done.stdout.splitlines()[-1].split()
    assert "simulator.results.tables" in loaded
    assert not {"matplotlib", "pandas"} & set(loaded)


def test_help_and_a_mistyped_file_load_no_solver():
    program = "import sys; import simulator.cli.app; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        env=subprocess_environment(),
        check=True,
    )
    assert not {"numpy", "sksundae", "pandas", "matplotlib", "pydantic", "rich.console"} & set(
        done.stdout.split()
    )
