"""What a summary says of a run: its events, what it amounts to, and hints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from simulator import units
from simulator.cli.summary import of_column, print_table, say, short

if TYPE_CHECKING:
    from rich.table import Table

    from simulator.results.event import Event
    from simulator.results.history import FloatArray, History, Verdict
    from simulator.units import Dimension, Scales

EVENTS_SHOWN = 20
_CLOSE = 1e-9  # stretches are found to some digits more: what differs by less is the same


def print_events(history: History) -> None:
    """A table of the first events, and how many there are."""
    count = len(history.events)
    say("events", f"{count or 'none'}")
    if count:
        print_table(_event_table(history))
    if count > EVENTS_SHOWN:
        say(" ", f"… and {count - EVENTS_SHOWN} more, in events.csv")


def run_lines(history: History) -> Iterator[tuple[str, str]]:
    """The lines of a summary below its events, each with its label."""
    from simulator.cli.hints import hint_lines
    from simulator.cli.summary_material import material_lines
    from simulator.cli.summary_shape import shape_lines  # loads what reads scenarios
    from simulator.cli.summary_units import bare_lines

    scales = history.scenario.scales
    second = " s" if scales else ""
    yield from _largest(history)
    for stop in history.stops[:EVENTS_SHOWN]:
        how = f"ended at time {stop.time:.10g}{second} by {stop.reached}" if stop.reached else "not reached"
        yield "until", f"step {stop.step}: {how}"
    if len(history.stops) > EVENTS_SHOWN:
        yield " ", f"… and {len(history.stops) - EVENTS_SHOWN} more, in run.json"
    for verdict in history.verdicts:
        yield "film", _fate(verdict, scales)
    yield from (("shape", line) for line in shape_lines(history))
    yield from (("material", line) for line in material_lines(history.scenario))
    yield from (("units", line) for line in bare_lines(history.scenario))
    yield from (("hint", line) for line in hint_lines(history))
    balance, statistics = history.energy_balance, history.statistics
    yield "energy", f"closes to {balance.relative_imbalance:.1e} of the work exchanged"
    yield "cost", f"{statistics.seconds:.3f} s, {statistics.ida_steps} IDA steps, {len(history)} samples"


def _largest(history: History) -> Iterator[tuple[str, str]]:
    """Largest values, what cycles cost, what is left at the end, and what was not played."""
    from simulator.results.summary import loop_works, not_played, residual

    scales = history.scenario.scales
    if (rest := not_played(history)) is not None:
        first, last = rest
        which = f"step {first}" if first == last else f"steps {first} to {last}"
        yield "unplayed", f"{which} of {last}"
    if not len(history):
        return
    extremes = history.extremes
    yield "stretch", f"largest {_each(history.balloons, extremes.largest_stretch)}"
    if history.electroded:
        yield "field", f"largest {_each(history.electroded, extremes.largest_field, units.FIELD, scales)}"
    if works := [_said(units.ENERGY, scales, work) for work in loop_works(history)]:
        complete = sum(cycle.complete for cycle in history.cycles)
        loops = f"{works[0]} in the first, {works[1]} in the last" if len(works) > 1 else works[0]
        each = " in each" if complete > 1 and len(works) == 1 else ""
        yield "cycles", f"{complete} complete, loop work {loops}{each}"
    if (left := residual(history)) is not None:
        moved = np.abs(left.after - left.before) > _CLOSE * left.before
        before = f"; before it {_each(history.balloons, left.before)}" if moved.any() else ", as before it"
        yield "residual", f"stretch after the voltage {_each(history.balloons, left.after)}{before}"


def _each(
    names: Iterable[str],
    values: FloatArray,
    dimension: Dimension | None = None,
    scales: Scales | None = None,
) -> str:
    """Values with the balloons they are of: "active 1.2 MV/m, passive 3 kV/m"."""
    return ", ".join(
        f"{name} {short(value) if dimension is None else _said(dimension, scales, value)}"
        for name, value in zip(names, values.tolist(), strict=True)
    )


def _said(dimension: Dimension, scales: Scales | None, value: float) -> str:
    return short(value) if scales is None else units.said(dimension, scales, value)


def _fate(verdict: Verdict, scales: Scales | None) -> str:
    """How a film fared, in words."""
    where = f"at time {verdict.time:.7g}{' s' if scales else ''}, step {verdict.step}"
    field, strength = (_said(units.FIELD, scales, value) for value in (verdict.field, verdict.strength))
    field = f"field {field}, strength {strength}"
    if verdict.broke:
        during = {"path": "on the path", "snap": "in the snap", "jump": "at the jump"}[verdict.broke]
        return f"{verdict.balloon}: broke {during} {where}: {field}"
    return f"{verdict.balloon}: survived; closest {where}: {field}, margin {verdict.margin:.3g}"


def _event_table(history: History) -> Table:
    """The first events: voltages, and under them the stretches and the pressure before and after."""
    from rich import box
    from rich.table import Table

    events, scales = history.events[:EVENTS_SHOWN], history.scenario.scales
    volts, volt = of_column(scales, units.VOLTAGE, [float(v) for event in events for v in event.voltage])
    pressures = [p for event in events for p in (event.pressure_before, event.pressure_after)]
    pascals, pascal = of_column(scales, units.PRESSURE, pressures)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 0, 0))
    table.add_column("time, step\nevent", no_wrap=True)
    table.add_column("", no_wrap=True)
    for heading in (*history.balloons, f"pressure{pascal}"):
        table.add_column(heading, justify="right", no_wrap=True)
    drive = f"φ{volt.strip()}" if not volt else f"φ {volt.strip()}"
    for event in events:
        voltages = dict(zip(history.electroded, event.voltage.tolist(), strict=True))
        sides = [(event.stretch_before, event.pressure_before)]
        if event.stretch_after is not None and event.pressure_after is not None and _moves(event):
            sides.append((event.stretch_after, event.pressure_after))
        lost = [_said(units.ENERGY, scales, event.dissipated)] if event.dissipated else []
        columns = [
            [short(voltages[name], volts) if name in voltages else "", *(short(side[0][i]) for side in sides)]
            for i, name in enumerate(history.balloons)
        ]
        what = [f"{event.time:.7g}, {event.step}", event.kind.value, *(f"lost {energy}" for energy in lost)]
        labels = [drive, "λ", "to"][: len(sides) + 1]
        pressed = ["", *(short(side[1], pascals) for side in sides)]
        table.add_row(*("\n".join(lines) for lines in (what, labels, *columns, pressed)))
    return table


def _moves(event: Event) -> bool:
    """Whether the state after an event is another one."""
    return bool(np.any(np.abs(np.asarray(event.stretch_after) - event.stretch_before) > _CLOSE))
