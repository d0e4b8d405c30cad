"""A whole scenario, and how it is read."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from html import escape
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, Field, PrivateAttr, TypeAdapter, ValidationError

from simulator.scenario.checks import disagreements
from simulator.scenario.device import Balloon, Gas
from simulator.scenario.elastomer import Elastomer, Python
from simulator.scenario.errors import Problem, ScenarioError
from simulator.scenario.fields import Frozen, Text, not_empty, problems_of
from simulator.scenario.mapping import all_values, near, with_values
from simulator.scenario.reading import check_kind, read_toml
from simulator.scenario.scales import Scaled, scales_of
from simulator.scenario.settings import Dynamics, Output, Shape, Solver, Supply
from simulator.scenario.steps import PlayedStep, Step, unrolled
from simulator.units import Scales, as_written

if TYPE_CHECKING:
    from simulator import Explorer

_ELASTOMER: TypeAdapter[Any] = TypeAdapter(Elastomer)


class Scenario(Frozen):
    """A whole scenario, as returned by `load_scenario`.

    Two scenarios are equal when they ask for the same run, whatever `file` they came from.
    """

    title: Text
    source: Annotated[Text | None, Field(description="a non-empty text")] = None
    reference: Annotated[
        Scaled | None, Field(description="a table of shear_modulus, thickness, radius, permittivity")
    ] = Field(default=None, alias="scales")
    gas: Annotated[Gas, Field(description="a table with ambient_pressure")]
    balloons: Annotated[tuple[Balloon, ...], AfterValidator(not_empty)] = Field(
        alias="balloon", description="one or more [[balloon]] tables"
    )
    steps: Annotated[tuple[Step, ...], AfterValidator(not_empty)] = Field(
        alias="step", description="one or more [[step]] tables"
    )
    dynamics: Annotated[Dynamics | None, Field(description="a table with relaxation_time or viscosity")] = (
        None
    )
    supply: Annotated[Supply | None, Field(description="a table with resistance")] = None
    shape: Annotated[Shape, Field(description="a table with on_loss")] = Shape()
    output: Annotated[Output, Field(description="a table with points or every")] = Output()
    solver: Annotated[Solver, Field(description="a table with rtol")] = Solver()
    _file: str = PrivateAttr(default="<dict>")

    def model_post_init(self, context: Any, /) -> None:
        """Remember where the scenario came from."""
        self._file = (context or {}).get("file", "<dict>")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scenario) and dict(self) == dict(other)

    def __repr__(self) -> str:
        names = ", ".join(balloon.name for balloon in self.balloons)
        count = len(self.steps)
        return f"<Scenario {self.title!r}: balloons {names}; {count} step{'' if count == 1 else 's'}>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        return scenario_html(self)

    @property
    def file(self) -> str:
        """Where the scenario came from, for messages; "<dict>" for a dict."""
        return self._file

    @property
    def scales(self) -> Scales | None:
        """What is 1 in SI units; None for a scenario without units."""
        return self.reference.scales if self.reference else None

    @property
    def electroded(self) -> tuple[str, ...]:
        """Names of the balloons with electrodes, in the order of the file."""
        return tuple(balloon.name for balloon in self.balloons if balloon.electrodes)

    def with_elastomers(self, elastomers: Mapping[str, Any]) -> Scenario:
        """The scenario with other elastomers in some balloons.

        Parameters
        ----------
        elastomers : mapping of str to elastomer
            By balloon name: a table as in a file, or any object that fulfils
            `simulator.model.elastomers.Elastomer`,
            such as one of that package or one of your own. An object is checked when it is first used: its
            functions are held against each other by complex steps.

        Raises
        ------
        ScenarioError
            If there is no balloon of a name, or something is no elastomer.

        Examples
        --------
        >>> from simulator.model.elastomers import Ogden
        >>> softer = scenario.with_elastomers({"active": Ogden((1.0, -0.1), (2.0, -2.0))})
        """
        names = [balloon.name for balloon in self.balloons]
        problems: list[Problem] = []
        made: dict[str, Any] = {}
        for name, elastomer in elastomers.items():
            if name not in names:
                problems.append(Problem("balloon", name, f"must be one of {', '.join(names)}"))
                continue
            try:
                made[name] = _ELASTOMER.validate_python(elastomer, context={"folder": ""})
            except ValidationError as error:
                key = f"balloon.{name}.elastomer"
                problems += [p._replace(key=f"{key}.{p.key}".rstrip(".")) for p in problems_of(error)]
        if problems:
            raise ScenarioError(self.file, *problems)
        balloons = tuple(
            b.model_copy(update={"elastomer": made[b.name]}) if b.name in made else b for b in self.balloons
        )
        return self.model_copy(update={"balloons": balloons})

    def with_values(self, values: Mapping[str, Any]) -> Scenario:
        """The scenario with other values of some of its keys.

        Parameters
        ----------
        values : mapping of str to value
            By dotted key, as in messages: `gas.ambient_pressure`, `step.2.ramp`, `balloon.*.radius` (all
            of them) or `balloon.active.radius`. With [scales] a text such as "20 kPa" is allowed too. The
            path of a table starts at the folder of the scenario's file.

        Raises
        ------
        ScenarioError
            If there is no such key, or a value is not allowed there.

        Examples
        --------
        >>> higher = scenario.with_values({"gas.ambient_pressure": 0.2, "step.2.ramp": 0.5})
        """
        written = self.to_dict()
        for table, balloon in zip(written["balloon"], self.balloons, strict=True):
            if isinstance(balloon.elastomer, Python):  # a file could only name it
                table["elastomer"] = balloon.elastomer.elastomer
        try:
            changed = with_values(written, values)
        except KeyError as error:
            key = str(error.args[0])
            allowed = f"no such key, {near(key, all_values(written))}"
            raise ScenarioError(self.file, Problem(key, None, allowed)) from None
        return _validated(changed, self.file, os.path.dirname(self.file))

    def played_steps(self) -> Iterator[PlayedStep]:
        """Steps in the order they are played, cycles unrolled, one at a time."""
        return unrolled(self.steps)

    def live(self) -> Explorer:
        """The page of `balloons live` as an object, which a notebook shows and answers to.

        Elsewhere, and in an exported notebook, it is the history. What it shows at the moment are its
        ``scenario`` and ``history``. Raises MissingExtra without the extra ``live``.
        """
        from simulator import explore

        return explore(self)

    def to_dict(self) -> dict[str, Any]:
        """The scenario in the grammar of the file, units as written, defaults left out; tables by their
        absolute path.

        `load_scenario(scenario.to_dict()) == scenario`, but for elastomers made in Python, only named there.
        """
        return self.model_dump(mode="json", by_alias=True, exclude_unset=True)


def scenario_html(scenario: Scenario) -> str:
    """A scenario as a notebook shows it: its balloons and its steps."""
    walls = "".join(
        f"<tr><td>{escape(b.name)}</td><td>{escape(b.elastomer.words)}</td>"
        f"<td>{'electrodes' if b.electrodes else ''}</td></tr>"
        for b in scenario.balloons
    )
    steps = [dict(step.model_dump(mode="json", by_alias=True, exclude_unset=True)) for step in scenario.steps]
    lines = "".join(f"<li>{escape(_words(step))}</li>" for step in steps)
    return f"<h4>{escape(scenario.title)}</h4><table>{walls}</table><ol>{lines}</ol>"


def _words(step: Mapping[str, Any]) -> str:
    """A step in one line, cut where it is long."""
    text = ", ".join(f"{key} = {value}" for key, value in step.items())
    return text if len(text) <= 100 else f"{text[:99]}…"


# A scenario, or what `load_scenario` makes one of.
ScenarioLike = Scenario | str | os.PathLike[str] | Mapping[str, Any]


def load_scenario(source: ScenarioLike) -> Scenario:
    """Read and check a scenario.

    Parameters
    ----------
    source : path, mapping or Scenario
        A TOML file, or its content as a mapping. Paths of tables are relative to the folder of the
        file, for a mapping to the current directory. In a mapping a balloon's elastomer may also be an
        object, see `Scenario.with_elastomers`. A scenario is returned as it is.

    Raises
    ------
    ScenarioError
        With every problem found: file, key, value and what is allowed.

    Examples
    --------
    >>> scenario = load_scenario({
    ...     "title": "One balloon",
    ...     "gas": {"ambient_pressure": 1},
    ...     "balloon": [{"name": "a", "elastomer": {"model": "neo-hookean"}}],
    ...     "step": [{"inflate": 0.5}],
    ... })
    >>> scenario.balloons[0].radius
    1.0
    """
    if isinstance(source, Scenario):
        return source
    data: Mapping[str, Any]
    if isinstance(source, Mapping):
        file, folder, data = "<dict>", "", source
        check_kind(file, data, "a scenario")
    else:
        file = os.fspath(source)
        folder, data = os.path.dirname(file), read_toml(file, "a scenario")
    return _validated(data, file, folder)


def _validated(data: Mapping[str, Any], file: str, folder: str) -> Scenario:
    """The scenario of a mapping; tables are sought from a folder."""
    try:
        scales = scales_of(data["scales"]) if data.get("scales") is not None else None
        scenario = Scenario.model_validate(data, context={"file": file, "folder": folder, "scales": scales})
    except ValidationError as error:
        problems = problems_of(error, lambda loc: _dotted(loc, data))
    except RecursionError:
        problems = [Problem("step", None, "is nested too deeply")]
    else:
        problems = [found._replace(value=as_written(found.value)) for found in disagreements(scenario)]
        if not problems:
            return scenario
    raise ScenarioError(file, *problems)


def _dotted(loc: tuple[int | str, ...], data: Mapping[str, Any]) -> str:
    parts = [str(part + 1) if isinstance(part, int) else part for part in loc]
    if len(loc) > 2 and loc[0] == "balloon" and isinstance(data["balloon"], list | tuple):
        names = [balloon.get("name") if isinstance(balloon, Mapping) else None for balloon in data["balloon"]]
        name = names[int(loc[1])]
        if isinstance(name, str) and name.isidentifier() and names.count(name) == 1:
            parts[1] = name
    return ".".join(parts)
