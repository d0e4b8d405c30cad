"""`balloons trace` and `balloons fold`: equilibrium paths, and a limit point as one number changes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from simulator.cli.endings import BAD_INPUT, errors_reported, fail, interrupted, solver_failures_reported
from simulator.cli.options import Quiet, ScenarioArgument, results_option
from simulator.cli.pictures import FormatOption, any_format, draw, remove_old, say_removed, wanted
from simulator.cli.summary import summarise_fold, summarise_trace
from simulator.cli.summary_units import print_bare

if TYPE_CHECKING:
    from simulator.results.curve import Curve
    from simulator.scenario import Scenario

CURVE_PICTURE = "curve"
FOLD_PICTURE = "fold"


def trace(
    scenario: ScenarioArgument,
    out: Annotated[Path | None, results_option("results/<SCENARIO's stem>-trace")] = None,
    plot: Annotated[bool, typer.Option("--plot", help=f"Also draw {CURVE_PICTURE}.png.")] = False,
    form: FormatOption = None,
    quiet: Quiet = False,
    every: Annotated[
        bool, typer.Option("--all", help="Also the paths detached from it at the same amount of gas.")
    ] = False,
    inflation: Annotated[
        bool, typer.Option("--inflation", help="Trace one balloon's inflation instead, in pressure.")
    ] = False,
    balloon: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="The balloon that --inflation inflates.", show_default="the last"),
    ] = None,
    to_voltage: Annotated[
        str | None, typer.Option(metavar="V", help="Stop at this voltage.", show_default=False)
    ] = None,
    to_pressure: Annotated[
        str | None,
        typer.Option(metavar="P", help="Stop at this pressure (with --inflation).", show_default=False),
    ] = None,
    to_stretch: Annotated[
        float | None,
        typer.Option(
            metavar="X", help="Stop at this stretch of the first electroded (or the inflated) balloon."
        ),
    ] = None,
) -> None:
    """Trace the equilibrium path in voltage, unstable parts too; write curve.csv and points.csv."""
    from simulator.results.files import check_writable
    from simulator.results.tables import TRACE_FILES, write_curves
    from simulator.scenario import load_scenario

    limits = _Wanted(every, inflation, balloon, to_voltage, to_pressure, to_stretch)
    _check(limits)
    directory = Path("results") / f"{scenario.stem}-trace" if out is None else out
    picture = wanted(CURVE_PICTURE, plot=plot, form=form)
    paths: list[Path] = []
    with errors_reported(lambda: interrupted(paths)):
        loaded = load_scenario(scenario)
        check_writable(directory, (*TRACE_FILES, *([picture] if picture else [])))
        curves = _traced(loaded, limits)
        paths += write_curves(curves, directory)
        removed = remove_old(directory, any_format(CURVE_PICTURE))
        paths += draw(directory, picture, lambda: _curves_drawn(curves))
    if not quiet:
        summarise_trace(curves, paths, asked=any(limit is not None for limit in limits.limits.values()))
        print_bare(loaded)
        say_removed([name for name in removed if name != picture])


def fold(
    scenario: ScenarioArgument,
    vary: Annotated[
        str, typer.Option(metavar="KEY", help="The number to change, such as gas.ambient_pressure.")
    ],
    to: Annotated[str, typer.Option(metavar="X", help="Its last value.")],
    out: Annotated[Path | None, results_option("results/<SCENARIO's stem>-fold")] = None,
    of: Annotated[
        str, typer.Option(metavar="KIND", help="What to follow: limit_point, loss_of_sphericity, …")
    ] = "limit_point",
    point: Annotated[int, typer.Option(metavar="N", help="Which one of the path, from 1.")] = 1,
    inflation: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="A limit point of this balloon's inflation.", show_default=False),
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help=f"Also draw {FOLD_PICTURE}.png.")] = False,
    form: FormatOption = None,
    quiet: Quiet = False,
) -> None:
    """Follow a limit point, or a loss of sphericity, while one number changes; write fold.csv."""
    from simulator.results.files import check_writable
    from simulator.results.tables import FOLD_FILE, write_fold
    from simulator.scenario import load_scenario

    directory = Path("results") / f"{scenario.stem}-fold" if out is None else out
    picture = wanted(FOLD_PICTURE, plot=plot, form=form)
    paths: list[Path] = []
    with errors_reported(lambda: interrupted(paths)):
        loaded = load_scenario(scenario)
        check_writable(directory, (FOLD_FILE, *([picture] if picture else [])))
        with solver_failures_reported():
            from simulator.analysis.fold import fold as follow

            curve = follow(loaded, vary, to, of=of, point=point, inflation=inflation)
        paths += write_fold(curve, directory)
        removed = remove_old(directory, any_format(FOLD_PICTURE))
        paths += draw(directory, picture, curve.plot)
    if not quiet:
        summarise_fold(curve, to, paths)
        print_bare(loaded)
        say_removed([name for name in removed if name != picture])


def _curves_drawn(curves: tuple[Curve, ...]) -> object:
    from simulator.results.plot import plot_curves

    return plot_curves(curves)


@dataclass(frozen=True)
class _Wanted:
    """Which paths `trace` is asked for, and where they are to stop."""

    every: bool
    inflation: bool
    balloon: str | None
    to_voltage: str | None
    to_pressure: str | None
    to_stretch: float | None

    @property
    def limits(self) -> dict[str, str | float | None]:
        """Where to stop, by the name of the option."""
        return {
            "--to-voltage": self.to_voltage,
            "--to-pressure": self.to_pressure,
            "--to-stretch": self.to_stretch,
        }


def _check(wanted: _Wanted) -> None:
    """Leave with exit code 2 where options contradict each other."""
    given = [name for name, value in wanted.limits.items() if value is not None]
    to_stretch = wanted.to_stretch
    if wanted.every and (given or wanted.inflation):
        other = (given or ["--inflation"])[0]
        fail(f"--all traces whole paths in voltage; it does not go with {other}", BAD_INPUT)
    if wanted.inflation and wanted.to_voltage is not None:
        fail("--to-voltage does not go with --inflation; use --to-pressure", BAD_INPUT)
    if not wanted.inflation and wanted.to_pressure is not None:
        fail("--to-pressure goes with --inflation; use --to-voltage", BAD_INPUT)
    if not wanted.inflation and wanted.balloon is not None:
        fail("--balloon goes with --inflation", BAD_INPUT)
    if to_stretch is not None and not (math.isfinite(to_stretch) and to_stretch >= 1.0):
        fail(f"--to-stretch {to_stretch}: must be a number >= 1", BAD_INPUT)


def _traced(scenario: Scenario, wanted: _Wanted) -> tuple[Curve, ...]:
    """The paths that are wanted; leaves with exit code 3 where one cannot be followed."""
    from simulator.scenario import dimensionless
    from simulator.units import PRESSURE, VOLTAGE

    to_drive = None
    if wanted.to_voltage is not None:
        to_drive = dimensionless(scenario, "--to-voltage", wanted.to_voltage, VOLTAGE, 0.0)
    elif wanted.to_pressure is not None:
        to_drive = dimensionless(scenario, "--to-pressure", wanted.to_pressure, PRESSURE, 0.0)
    with solver_failures_reported():
        from simulator.analysis.trace import trace, trace_all, trace_inflation

        if wanted.inflation:
            stretch = wanted.to_stretch
            return (trace_inflation(scenario, wanted.balloon, to_pressure=to_drive, to_stretch=stretch),)
        if wanted.every:
            return trace_all(scenario)
        return (trace(scenario, to_voltage=to_drive, to_stretch=wanted.to_stretch),)
