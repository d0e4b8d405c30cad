"""The best run of a scenario over some of its numbers, under conditions, found by SciPy.

The grammar is that of a sweep, with intervals to search, a column to make large or small, and conditions
on columns. Runs snap, so what is optimised jumps; differential evolution does not mind. Each point is
played once, though the conditions and the objective both ask for it; those of a generation together.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, ValidationInfo

from simulator.results.files import write_files
from simulator.results.shapes import SHAPES
from simulator.scenario import Problem, ScenarioError
from simulator.scenario.fields import Chosen, Float, Frozen, Int, problems_of, refused
from simulator.scenario.mapping import near, number_and_unit
from simulator.scenario.reading import check_kind, read_toml
from simulator.sweep.evaluations import Evaluations
from simulator.sweep.measures import quantity, scale_sizes, titled
from simulator.sweep.plan import Job, Sweep
from simulator.sweep.reading import read_sweep
from simulator.sweep.rows import BEHAVIOURS, OUTCOMES, as_text, columns
from simulator.units import Dimension, read_si

FloatArray = NDArray[np.float64]

OPTIMUM_FILES = ("optimum.csv", "evaluations.csv")


def _limit(value: Any, _: ValidationInfo) -> float | str:
    found = number_and_unit(value)
    if found is None or not math.isfinite(found[0]):
        raise refused('must be a number, or with [scales] a text such as "218 MV/m"', value)
    return value if isinstance(value, str) else found[0]


Limit = Annotated[float | str | None, Chosen(_limit), Field(description="a number")]


class Bounds(Frozen):
    """A number's limits, both allowed; texts with a unit until they are read in the unit of their column."""

    below: Limit = None
    above: Limit = None


def _condition(value: Any, _: ValidationInfo) -> Bounds | tuple[str, ...]:
    if isinstance(value, Mapping):
        found = Bounds.model_validate(value)
        if found.below is None and found.above is None:
            raise refused("must have below or above", dict(value))
        return found
    words = [value] if isinstance(value, str) else value
    if not isinstance(words, list | tuple) or not words or not all(isinstance(word, str) for word in words):
        raise refused("must be { below = … }, { above = … }, or one or more words", value)
    return tuple(words)


Condition = Annotated[Bounds | tuple[str, ...], Chosen(_condition), Field(description="a condition")]


class SearchTable(Frozen):
    """How long is searched: `population` points for each key and generation, at most `generations`."""

    population: Annotated[Int, Field(ge=2, le=1000, description="a whole number from 2 to 1000")] = 15
    generations: Annotated[Int, Field(ge=1, le=100_000, description="a whole number from 1 to 100000")] = 100
    tolerance: Annotated[Float, Field(gt=0, description="a number > 0")] = 1e-6
    seed: Annotated[Int, Field(ge=0, description="a whole number >= 0")] = 0


class OptimumTable(Frozen):
    """What the file says beyond a sweep."""

    maximize: Annotated[str | None, Field(strict=True, description="a column of numbers")] = None
    minimize: Annotated[str | None, Field(strict=True, description="a column of numbers")] = None
    where: Annotated[
        dict[str, Condition], Field(default_factory=dict, description="a table of conditions by column")
    ]
    search: Annotated[
        SearchTable, Field(description="a table of population, generations, tolerance, seed")
    ] = SearchTable()


@dataclass(frozen=True)
class Question:
    """What is to be optimised, as returned by `read_question`: a sweep over intervals, and what to look for.

    `sense` is −1 to make `column` large, +1 to make it small. Bounds in `where` are numbers in the units of
    their columns. What these are divided by to be of order one is in `sizes`: the scale of their unit.
    """

    sweep: Sweep
    column: str
    sense: float
    where: Mapping[str, Bounds | tuple[str, ...]]
    search: SearchTable
    sizes: Mapping[str, float] = field(default_factory=dict)

    @property
    def units(self) -> Mapping[str, str]:
        """The units of the columns that have one."""
        return self.sweep.job.units


@dataclass(frozen=True)
class Optimum:
    """The best run found.

    Attributes
    ----------
    row : mapping
        By column, as in a sweep, in the units of `question.units`; None where no run met the conditions.
    value : float
        Of the column that was optimised, in its unit.
    runs : tuple of mapping
        All runs played, in order.
    converged : bool
        Whether the population had contracted to the tolerance before the generations were used up.
    """

    question: Question
    row: Mapping[str, Any] | None
    value: float
    runs: tuple[Mapping[str, Any], ...]
    converged: bool

    def to_csv(self, directory: str | os.PathLike[str]) -> list[Path]:
        """Write `optimum.csv`, the best run, and `evaluations.csv`, all; return their paths."""
        names = list(columns(self.question.sweep.job))
        titles = titled(names, self.question.units)

        def write(rows: list[Mapping[str, Any]], stream: Any) -> None:
            stream.write(
                (",".join(titles) + "\n" + as_text([r.get(n) for n in names] for r in rows)).encode()
            )

        tables: list[list[Mapping[str, Any]]] = [[] if self.row is None else [self.row], list(self.runs)]
        return write_files(
            directory, {n: partial(write, t) for n, t in zip(OPTIMUM_FILES, tables, strict=True)}
        )


QuestionLike = Question | str | os.PathLike[str] | Mapping[str, Any]
"""A question, or what `read_question` makes one of."""


def read_question(source: QuestionLike) -> Question:
    """Read and check what is to be optimised.

    Parameters
    ----------
    source : path, mapping or Question
        A TOML file, or its content as a mapping; paths in it as for `read_sweep`. A question is returned as
        it is.

    Returns
    -------
    Question

    Raises
    ------
    ScenarioError
        With every problem found: file, key, value and what is allowed.
    """
    if isinstance(source, Question):
        return source
    if isinstance(source, Mapping):
        file, data = "<dict>", dict(source)
        check_kind(file, data, "an optimum")
    else:
        file = os.fspath(source)
        data = read_toml(file, "an optimum")
    own = {key: data.pop(key) for key in OptimumTable.model_fields if key in data}
    try:
        read = OptimumTable.model_validate(own)
    except ValidationError as error:
        raise ScenarioError(file, *problems_of(error)) from None
    if "sample" in data:
        raise ScenarioError(
            file, Problem("sample", data["sample"], "does not go with an optimum; see search")
        )
    if any(_is_of_shapes(name) for name in (read.maximize, read.minimize, *read.where) if name):
        data["record"] = {**data.get("record", {}), "shapes": True}
    if any(name.startswith("least_margin_") for name in (read.maximize, read.minimize, *read.where) if name):
        data["record"] = {**data.get("record", {}), "margins": True}
    # Intervals, as for a sample; of a sweep's own words nothing else changes.
    sweep = read_sweep({**data, "sample": {"method": "random", "size": 1}}, file=file)
    spread = [axis.key for axis in sweep.axes if axis.spread is not None]
    if spread:
        said = "must be an interval such as { from = 0.1, to = 1 }: searched through"
        raise ScenarioError(file, *(Problem(f'vary."{key}"', None, said) for key in spread))
    kinds = columns(sweep.job)
    numbers = {name: 0.0 for name, kind in kinds.items() if kind in ("number", "whole")}
    asked = {"maximize": read.maximize, "minimize": read.minimize}
    found = {word: name for word, name in asked.items() if name is not None}
    wrong = [
        Problem(word, name, f"must be a column of numbers; {near(name, numbers)}")
        for word, name in found.items()
        if name not in numbers
    ]
    if len(found) != 1:
        wrong.append(Problem("maximize", None, "must be given, or minimize, and not both"))
    where: dict[str, Bounds | tuple[str, ...]] = {}
    for name, condition in read.where.items():
        problems = list(_wrong_condition(name, condition, kinds))
        where[name] = condition
        if isinstance(condition, Bounds) and not problems:
            where[name], problems = _in_its_unit(name, condition, sweep.job)
        wrong += problems
    if wrong:
        raise ScenarioError(file, *wrong)
    ((word, column),) = found.items()
    sizes = scale_sizes(sweep.job, where)
    return Question(sweep, column, -1.0 if word == "maximize" else 1.0, where, read.search, sizes)


_WORDS = {"outcome": OUTCOMES, "behaviour": BEHAVIOURS, "shape": SHAPES}


def _is_of_shapes(column: str) -> bool:
    """Whether a column is there only where shapes are recorded."""
    return column == "shape" or column.startswith(("sphericity_voltage_", "least_sphericity_"))


def _wrong_condition(
    name: str, condition: Bounds | tuple[str, ...], kinds: Mapping[str, str]
) -> Iterator[Problem]:
    """What a condition asks that no run can fulfil: a column that is not there, or a word that none has."""
    numbers = isinstance(condition, Bounds)
    there = {n: 0.0 for n, kind in kinds.items() if kind in (("number", "whole") if numbers else ("text",))}
    if name not in there:
        what = "numbers" if numbers else "words"
        yield Problem(f"where.{name}", None, f"must be a column of {what}; {near(name, there)}")
    elif not isinstance(condition, Bounds) and name in _WORDS:
        for word in (word for word in condition if word not in _WORDS[name]):
            yield Problem(f"where.{name}", word, f"must be one of {', '.join(_WORDS[name])}")


def _in_its_unit(column: str, bounds: Bounds, job: Job) -> tuple[Bounds, list[Problem]]:
    """Bounds as numbers in the unit of their column, and what is wrong with them."""
    unit, dimension = job.units.get(column, ""), quantity(column)
    read: dict[str, float] = {}
    wrong = []
    for word, limit in (("below", bounds.below), ("above", bounds.above)):
        if limit is None:
            continue
        try:
            read[word] = _read_limit(limit, unit, dimension)
        except ValueError as error:
            wrong.append(Problem(f"where.{column}.{word}", limit, str(error)))
    return bounds.model_copy(update=read), wrong


def _read_limit(limit: float | str, unit: str, dimension: Dimension | None) -> float:
    """A limit in the unit of its column. Raises ValueError, which says what is allowed."""
    found = number_and_unit(limit)
    assert found is not None
    number, written = found[0], found[1].strip()
    if written == unit or (number == 0.0 and not written):
        return number
    if not unit:
        raise ValueError("must be a number without a unit: the column has none")
    if dimension is None:
        raise ValueError(f"must be in the unit that is varied, {unit}")
    allowed = f'must be {dimension.name} such as "{dimension.example}"'
    if not written:
        raise ValueError(f"{allowed}: with [scales] the column has a unit")
    try:
        return read_si(str(limit), dimension)
    except ValueError as error:
        raise ValueError(f"{allowed}{str(error) and f'; {error}'}") from None


def optimize(question: QuestionLike, *, progress: Callable[[int], None] | None = None) -> Optimum:
    """Find the run that makes a column largest or smallest under the conditions.

    By ``scipy.optimize.differential_evolution`` over the intervals: a search of the whole box that needs no
    derivatives. The same seed gives the same answer. It does not prove that there is no better one. The runs
    of a generation are played in lockstep where they can be, one of them by `simulate`, too; so is the best.

    Parameters
    ----------
    question : Question, path or mapping
        From `read_question`, or what that takes.
    progress : callable, optional
        Called with the number of runs played, after each generation.

    Returns
    -------
    Optimum

    Raises
    ------
    ScenarioError
        If the question makes no sense.
    DisagreementError
        If a run played both ways comes out differently.

    Examples
    --------
    >>> found = optimize({
    ...     "scenario": "scenarios/fig3c_state_b.toml",
    ...     "maximize": "dissipated",
    ...     "where": {"outcome": "completed"},
    ...     "vary": {"gas.ambient_pressure": {"from": 0.0, "to": 0.03}},
    ...     "search": {"population": 4, "generations": 2},
    ... })
    >>> found.row["outcome"], len(found.runs) > 4
    ('completed', True)
    """
    question = read_question(question)
    from scipy.optimize import NonlinearConstraint, differential_evolution

    runs = Evaluations(question, progress)
    search = question.search
    answer = differential_evolution(
        runs.objective,
        [(0.0, 1.0)] * len(question.sweep.axes),
        constraints=NonlinearConstraint(runs.margins, 0.0, np.inf),
        popsize=search.population,
        maxiter=search.generations,
        tol=search.tolerance,
        atol=0.0,
        seed=np.random.default_rng(search.seed),
        polish=False,
        init="sobol",
        updating="deferred",
        vectorized=True,
    )
    best = runs.best()
    value = math.nan if best is None else float(best[question.column])
    return Optimum(question, best, value, tuple(runs.rows.values()), bool(answer.success))
