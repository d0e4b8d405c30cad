"""Long, noisy and oddly timed drives."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simulator.scenario import Table
from tests.studies.stress.case import Case, Finding
from tests.studies.stress.closed_form import closed_form
from tests.studies.stress.devices import Written, pair

if TYPE_CHECKING:
    from collections.abc import Mapping

    from simulator.results.history import History

FloatArray = NDArray[np.float64]


def cases(rows: int, cycles: int) -> list[Case]:
    """With so many rows in the table, and cycles of the sine."""
    return [
        Case(
            f"noisy table of {rows} rows",
            "a turn at every row; it crosses both limit points many times by noise alone",
            _snapping({"table": "noise.csv"}, output={"points": 2001}),
            _timed,
            tables={"noise.csv": partial(_noise, rows)},
        ),
        Case(
            f"sine of {cycles} cycles",
            f"{2 * cycles} snaps, no drift allowed",
            _snapping(
                {"ramp": 0.2},
                {"sine": {"mean": 0.2, "amplitude": 0.2, "period": 1.0, "cycles": float(cycles)}},
                output={"points": 20 * cycles + 1},
            ),
            closed_form,
        ),
        Case(
            "steps of 1e-12 and 1e12",
            "short ones before, between and after long ones, where time has no digits left for them",
            _snapping(
                {"ramp": 0.2, "over": 1e-12},
                {"ramp": 0.4, "over": 1e12},
                {"ramp": 0.2, "over": 1e-12},
                {"hold": 1e12},
                {"ramp": 0.4, "over": 1e-12},
            ),
            closed_form,
        ),
    ]


def _snapping(*steps: Mapping[str, Any], **sections: Any) -> Written:
    return pair(1.2, *steps, ambient=0.015, **sections)


def _noise(rows: int) -> str:
    """Up and down once, with noise from row to row of a tenth of the highest voltage."""
    time = np.arange(rows)
    slow = 0.4 * (1.0 - np.abs(2.0 * time / (rows - 1) - 1.0))
    voltage = np.abs(slow + 0.02 * np.random.default_rng(1).standard_normal(rows))
    voltage[0] = 0.0
    return "time,voltage\n" + "".join(f"{t},{v!r}\n" for t, v in zip(time, voltage.tolist(), strict=True))


def _timed(history: History) -> Finding:
    """The closed form; and every event where the table has its voltage."""
    found = closed_form(history)
    (table,) = (step for step in history.scenario.played_steps() if isinstance(step, Table))
    start = next(e for e in np.unique(history.time[history.step == 1])[::-1])
    error = 0.0
    for event in history.events:
        at = event.time - start
        row = int(np.clip(np.searchsorted(table.times, at) - 1, 0, table.times.size - 2))
        slope = np.diff(table.voltages[row : row + 2])[0] / np.diff(table.times[row : row + 2])[0]
        late = abs(float(np.interp(at, table.times, table.voltages)) - event.voltage[0])
        # Time itself has only so many digits.
        error = max(error, late - abs(float(slope)) * math.ulp(event.time))
    return Finding(max(found.error, error), found.bound, found.against, found.remark)
