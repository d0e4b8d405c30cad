"""Many runs of one scenario from Python, with arrays for some of its numbers and without files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator import __version__
from simulator.scenario import Problem, ScenarioError, ScenarioLike, load_scenario
from simulator.scenario.keys import all_keys
from simulator.scenario.mapping import near
from simulator.sweep.lockstep import chunk
from simulator.sweep.measures import in_units, titled, units_of
from simulator.sweep.plan import Axis, Job, Recorded, as_recorded
from simulator.sweep.rows import columns, play

if TYPE_CHECKING:
    import pandas as pd

_AUDITED, _MOST_AUDITED = 100, 200  # one run in so many is played both ways, and no more than so many


@dataclass(frozen=True)
class ManyRuns:
    """What became of many runs: the columns of a sweep's table, each an array (n_runs,).

    `runs["limit_point_1_voltage_active"]` is one of them; what they mean is in `docs/sweep.md`.

    Attributes
    ----------
    columns : mapping of str to (n_runs,) array
        Where the scenario has [scales], results are in SI units.
    units : mapping of str to str
        Of the columns that have one: "V", "Pa", "J"; of what was varied, which is without units, what it is a
        multiple of, such as "μH/R". Empty without [scales].
    """

    columns: Mapping[str, NDArray[Any]]
    units: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.columns["run"])

    def to_dataframe(self) -> pd.DataFrame:
        """All columns as a table, one row for each run, each with its unit in its title."""
        import pandas as pd

        return pd.DataFrame(dict(zip(titled(self.columns, self.units), self.columns.values(), strict=True)))


def simulate_many(
    scenario: ScenarioLike, values: Mapping[str, ArrayLike], *, limit_points: int = 2
) -> ManyRuns:
    """Play a scenario many times, in lockstep where that is possible, in this process.

    Parameters
    ----------
    scenario : Scenario, path or mapping
        From `load_scenario`, or what that takes.
    values : mapping of str to array_like
        For each key of the scenario that varies, such as "gas.ambient_pressure", a number without units for
        each run, all arrays of one length, or one number for all.
    limit_points : int
        Of how many of them the voltages are recorded.

    Returns
    -------
    ManyRuns
        In SI units, where the scenario has [scales].

    Raises
    ------
    ScenarioError
        If the scenario makes no sense, or a key is not there. Values that make no scenario are runs with the
        outcome "refused".
    ValueError
        If the arrays are not of one length.
    DisagreementError
        If one of the runs that are played both ways, one in a hundred, does not come out the same.

    Examples
    --------
    >>> import numpy as np
    >>> runs = simulate_many(scenario, {"gas.ambient_pressure": np.geomspace(0.01, 0.2, 300)})
    >>> round(float(runs["limit_point_1_voltage_active"].max()), 6)
    0.395319
    """
    scenario = load_scenario(scenario)
    known = all_keys(scenario)
    for key in values:
        if key not in known and ".*." not in key:
            raise ScenarioError(scenario.file, Problem(key, None, f"no such key, {near(key, known)}"))
    arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, dtype=np.float64)) for v in values.values()))
    if any(array.ndim != 1 for array in arrays):
        raise ValueError("values must be numbers or arrays (n,)")
    runs = list(zip(*(array.tolist() for array in arrays), strict=True))
    job = Job(
        scenario=as_recorded(scenario, shapes=False),
        axes=tuple(
            Axis(key, (float(array.min()), float(array.max())))
            for key, array in zip(values, arrays, strict=True)
        ),
        past=None,
        recorded=Recorded(limit_points),
        balloons=tuple(balloon.name for balloon in scenario.balloons),
        electroded=scenario.electroded,
        version=__version__,
    )
    kinds = columns(job)
    job = replace(job, units=units_of(scenario, job, kinds))
    audited = np.arange(_AUDITED // 2, len(runs), max(_AUDITED, len(runs) // _MOST_AUDITED)).tolist()
    rows = chunk.rows(job, 0, runs, audited, list(kinds), play)
    converted = in_units(job, list(kinds))
    table = zip(*(converted(values, row) for values, row in zip(runs, rows, strict=True)), strict=True)
    found = {name: _column(kinds[name], cells) for name, cells in zip(kinds, table, strict=True)}
    return ManyRuns(found, job.units)


def _column(kind: str, cells: tuple[Any, ...]) -> NDArray[Any]:
    if kind == "text":
        return np.array(["" if cell is None else str(cell) for cell in cells])
    if kind == "whole" and None not in cells:
        return np.array(cells, dtype=np.int64)
    return np.array([np.nan if cell is None else cell for cell in cells], dtype=np.float64)
