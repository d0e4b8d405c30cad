"""What a reader sees in the terminal: summaries, tables and the progress bar."""

from __future__ import annotations

import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from simulator import units

if TYPE_CHECKING:
    from rich.table import Table

    from simulator.results.curve import Curve, FoldCurve
    from simulator.results.history import History
    from simulator.scenario.presets import Material
    from simulator.units import Dimension, Scales

_PATIENCE = 1.0  # seconds a run may take before it shows a progress bar
_REFRESH = 0.1  # seconds between two updates of the bar


@contextmanager
def progress_bar(*, quiet: bool) -> Iterator[Callable[[float], None] | None]:
    """A function to report progress to; a bar appears once it has been at work for a second."""
    if quiet or not sys.stderr.isatty():
        yield None
        return

    started = time.monotonic()
    due = started + _PATIENCE
    bar = None

    def report(fraction: float) -> None:
        nonlocal due, bar
        now = time.monotonic()
        if now < due:
            return
        due = now + _REFRESH
        if bar is None:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TaskProgressColumn, TimeRemainingColumn

            # No refresh thread: it would compete with the solver for the interpreter.
            bar = Progress(
                BarColumn(),
                TaskProgressColumn(),
                TimeRemainingColumn(),
                console=Console(stderr=True),
                transient=True,
                auto_refresh=False,
            )
            bar.add_task("playing", total=1.0)
            bar.start()
        bar.update(bar.task_ids[0], completed=fraction, refresh=True)

    try:
        yield report
    finally:
        if bar is not None:
            bar.stop()


def summarise_run(history: History, paths: list[Path]) -> None:
    """Say how a history ended, what happened in it and what it cost."""
    from simulator.cli.summary_run import print_events, run_lines

    say("", printable(history.scenario.title))
    second = " s" if history.scenario.scales else ""
    end = f" at time {history.time[-1]:.10g}{second}" if len(history) else ""
    print()
    say("outcome", f"{history.outcome.value}{end}")
    print_events(history)
    for label, line in run_lines(history):
        say(label, line)
    print_files(paths)


def summarise_trace(curves: Sequence[Curve], paths: list[Path], *, asked: bool) -> None:
    """Say which special points equilibrium paths have and how they end.

    Parameters
    ----------
    curves : sequence of Curve
    paths : list of Path
        Files written.
    asked : bool
        Whether the path was to stop at a voltage, pressure or stretch.
    """
    print(printable(curves[0].title))
    print(f"\npoints   {sum(len(curve.points) for curve in curves)}")
    print_table(_point_table(curves))
    for i, curve in enumerate(curves, start=1):
        which = f"curve {i}: " if len(curves) > 1 else ""
        stable = f"{(curve.unstable == 0).mean():.0%}"
        print(f"end      {which}{_ending(curve, asked=asked)}; {stable} of its points are stable")
    print(f"cost     {sum(c.ida_steps for c in curves)} IDA steps, {sum(len(c) for c in curves)} points")
    print_files(paths)


def summarise_fold(curve: FoldCurve, to: str, paths: list[Path]) -> None:
    """Say where the curve of a limit point begins and ends, and why.

    Parameters
    ----------
    curve : FoldCurve
    to : str
        The value that was asked for, as it was.
    paths : list of Path
        Files written.
    """
    drive = "voltage" if curve.voltage.any() else "pressure"
    values = curve.voltage if curve.voltage.any() else curve.pressure
    print(printable(curve.title))
    if curve.balloon is not None:
        print(f"what     {curve.of.replace('_', ' ')} of {curve.balloon}")
    for place, name in ((0, "from"), (-1, "to")):
        value = _with_unit(curve.scales, curve.dimension, float(curve.value[place]))
        limit = _with_unit(curve.scales, units.QUANTITIES[drive], float(values[place]))
        print(f"{name:8} {curve.parameter} = {value}: {drive} {limit}")
    reached = "reached" if curve.end == "reached" else f"{to} not reached: {curve.end.replace('_', ' ')}"
    print(f"end      {reached}")
    print(f"cost     {curve.ida_steps} IDA steps, {len(curve)} points")
    print_files(paths)


def list_presets(presets: Mapping[str, tuple[str, Material]]) -> None:
    """Print elastomers by the name of a material.

    Parameters
    ----------
    presets : mapping of str to (str, Material)
        The elastomer in plain words, and its data.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 1, 0))
    table.add_column("preset", no_wrap=True)
    table.add_column("elastomer")
    table.add_column("μ / Pa", justify="right", no_wrap=True)
    table.add_column("ε / ε₀", justify="right", no_wrap=True)
    table.add_column("source", ratio=1)
    for name, (words, material) in presets.items():
        numbers = [
            f"{x:.4g}" if x is not None else "" for x in (material.shear_modulus, material.permittivity)
        ]
        table.add_row(name, words, *numbers, f"{material.source}. Fitted to {material.fitted_to}.")
    Console().print(table)


def _ending(curve: Curve, *, asked: bool) -> str:
    end = curve.end.kind.replace("_", " ")
    if asked and curve.end.kind != "reached":
        return f"not reached: the path ended by {end}"
    return end


def _point_table(curves: Sequence[Curve]) -> Table:
    """The special points, one line each."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 0, 0))
    if len(curves) > 1:
        table.add_column("curve", justify="right", no_wrap=True)
    table.add_column("point", no_wrap=True)
    points = [point for curve in curves for point in curve.points]
    scales = curves[0].scales
    # One voltage is on all electrodes.
    volts, volt = of_column(scales, units.VOLTAGE, [float(v) for point in points for v in point.voltage[:1]])
    pascals, pascal = of_column(scales, units.PRESSURE, [point.pressure for point in points])
    headings = [
        *(f"voltage{whose}{volt}" for whose in _whose(curves[0].electroded)),
        *(f"stretch\n{name}" for name in curves[0].balloons),
        f"pressure{pascal}",
    ]
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for i, curve in enumerate(curves, start=1):
        for point in curve.points:
            values = (
                *(short(voltage, volts) for voltage in point.voltage[:1]),
                *(short(stretch) for stretch in point.stretch),
                short(point.pressure, pascals),
            )
            number = [f"{i}"] if len(curves) > 1 else []
            what = f"{point.kind}\n  {point.balloon}" if point.balloon else point.kind
            table.add_row(*number, what, *values)
    return table


def _whose(electroded: Sequence[str]) -> list[str]:
    """The second line above the voltages of a path, if there are any."""
    if not electroded:
        return []
    return [f"\n{electroded[0]}" if len(electroded) == 1 else "\nall"]


def of_column(
    scales: Scales | None, dimension: Dimension, values: Sequence[float | None]
) -> tuple[float, str]:
    """What the dimensionless values of a column are to be multiplied by, and the end of its heading."""
    if scales is None:
        return 1.0, ""
    factor, unit = units.of_column(dimension, scales, [value for value in values if value is not None])
    return factor, f"\n\\[{unit}]"  # escaped: rich takes brackets for markup


def _with_unit(scales: Scales | None, dimension: Dimension | None, value: float) -> str:
    """A dimensionless value as such, or with its unit."""
    if scales is None or dimension is None:
        return f"{value:.10g}"
    return units.said(dimension, scales, value, 10)


def print_files(paths: Sequence[Path]) -> None:
    """Say where files of one directory are."""
    say("files", f"{paths[0].parent}: {', '.join(path.name for path in paths)}")


def say(label: str, text: str) -> None:
    """Print a line of a summary, on as many lines as the window needs (80 columns, if it is narrower).

    What has no space in it, such as a path, is never broken.
    """
    width = max(shutil.get_terminal_size().columns, 80)
    indent, hang = (f"{label:9}", " " * 9) if label else ("", "")
    lines = textwrap.wrap(
        text, width, initial_indent=indent, subsequent_indent=hang,
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip
    print("\n".join(lines))


def printable(title: str) -> str:
    """A title as one line: no control characters of a file reach the terminal."""
    return "".join(letter if letter.isprintable() else " " for letter in title)


def short(value: float, factor: float = 1.0) -> str:
    """A dimensionless value in the unit of its column."""
    # Rounding errors about zero are noise to a reader; the files keep every digit.
    return f"{value * factor:.6g}" if abs(value) > 1e-11 else "0"


def print_table(table: Table) -> None:
    """Print a table, indented, with every digit."""
    from rich.console import Console
    from rich.padding import Padding

    console = Console()
    shown = Padding(table, (0, 0, 1, 2), expand=False)
    # A window too narrow, or a pipe, must not turn digits into an ellipsis: lines may rather run over.
    needed = console.measure(shown, options=console.options.update(max_width=100_000)).maximum
    Console(width=max(console.width, needed)).print(shown)
