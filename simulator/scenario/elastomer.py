"""Elastomers as a scenario names them: by a model and its numbers, a table, a preset, or as an object."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, PrivateAttr, ValidationInfo, model_serializer

from simulator.scenario.fields import (
    Chosen,
    Float,
    Frozen,
    NonNegative,
    Number,
    Positive,
    absolute,
    not_empty,
    refused,
)
from simulator.scenario.presets import PRESETS, Material
from simulator.scenario.reading import read_curve


class _Law(Frozen):
    """What stands for itself; a preset stands for one of these."""

    @property
    def law(self) -> Self:
        """The model that this is, itself."""
        return self


class Gent(_Law):
    """Gent elastomer with the stretch limit `J_lim`."""

    model: Literal["gent"]
    J_lim: Positive

    @property
    def words(self) -> str:
        """The elastomer in plain words."""
        return f"Gent, J_lim = {self.J_lim:g}"


class NeoHookean(_Law):
    """Neo-Hookean elastomer."""

    model: Literal["neo-hookean"]

    @property
    def words(self) -> str:
        """The elastomer in plain words."""
        return "neo-Hookean"


class MooneyRivlin(_Law):
    """Mooney–Rivlin elastomer; only the ratio of `C1` and `C2` counts."""

    model: Literal["mooney-rivlin"]
    C1: NonNegative
    C2: NonNegative

    def model_post_init(self, context: Any, /) -> None:
        """Refuse what has no stiffness."""
        if self.C1 + self.C2 <= 0.0:
            raise refused("must be > 0 where C2 is 0", self.C1, "C1")

    @property
    def words(self) -> str:
        """The elastomer in plain words."""
        return f"Mooney–Rivlin, C1 : C2 = {self.C1:g} : {self.C2:g}"


class Ogden(_Law):
    """Ogden elastomer with the moduli `mu` and the exponents `alpha`, term by term."""

    model: Literal["ogden"]
    mu: Annotated[tuple[Number, ...], AfterValidator(not_empty)] = Field(
        description="a list of one or more numbers"
    )
    alpha: Annotated[tuple[Number, ...], AfterValidator(not_empty)] = Field(
        description="a list of one or more numbers other than 0"
    )

    def model_post_init(self, context: Any, /) -> None:
        """Refuse what is no material: lists of different lengths, no stiffness."""
        if len(self.mu) != len(self.alpha):
            text = f"must have as many numbers as mu, {len(self.mu)}, has {len(self.alpha)}"
            raise refused(text, list(self.alpha), "alpha")
        if 0.0 in self.alpha:
            raise refused("must be a list of one or more numbers other than 0", list(self.alpha), "alpha")
        if (modulus := sum(m * a for m, a in zip(self.mu, self.alpha, strict=True))) <= 0.0:
            text = f"must give a shear modulus Σ mu alpha / 2 > 0, gives {modulus / 2.0:g}"
            raise refused(text, list(self.mu), "mu")

    @property
    def words(self) -> str:
        """The elastomer in plain words."""
        mu, alpha = (", ".join(f"{x:g}" for x in values) for values in (self.mu, self.alpha))
        return f"Ogden, mu = {mu}, alpha = {alpha}"


class ArrudaBoyce(_Law):
    """Arruda–Boyce elastomer with the limiting chain stretch `lambda_L`."""

    model: Literal["arruda-boyce"]
    lambda_L: Annotated[Float, Field(gt=1, description="a number > 1")]

    @property
    def words(self) -> str:
        """The elastomer in plain words."""
        return f"Arruda–Boyce, lambda_L = {self.lambda_L:g}"


class Yeoh(_Law):
    """Yeoh elastomer; only the ratios of `C1`, `C2` and `C3` count."""

    model: Literal["yeoh"]
    C1: Positive
    C2: Number
    C3: Number = 0.0

    @property
    def words(self) -> str:
        """The elastomer in plain words."""
        return f"Yeoh, C1 : C2 : C3 = {self.C1:g} : {self.C2:g} : {self.C3:g}"


class GentGent(_Law):
    """Gent–Gent elastomer; only the ratio of `C1` and `C2` counts."""

    model: Literal["gent-gent"]
    C1: Positive
    C2: NonNegative
    J_lim: Positive

    @property
    def words(self) -> str:
        """The elastomer in plain words."""
        return f"Gent–Gent, C1 : C2 = {self.C1:g} : {self.C2:g}, J_lim = {self.J_lim:g}"


class Fung(_Law):
    """Fung elastomer with the stiffening `b`."""

    model: Literal["fung"]
    b: Positive

    @property
    def words(self) -> str:
        """The elastomer in plain words."""
        return f"Fung, b = {self.b:g}"


class Tabulated(_Law):
    """Elastomer measured as a curve, in a CSV file.

    The file is read once, when the scenario is loaded; `table` is its absolute path from then on.
    """

    model: Literal["tabulated"]
    table: Annotated[str, AfterValidator(absolute)] = Field(
        strict=True,
        min_length=1,
        description="the path of a CSV file with columns stretch,pressure or stretch,stress",
    )
    _samples: bytes = PrivateAttr(default=b"")

    def model_post_init(self, context: Any, /) -> None:
        """Read the file."""
        try:
            self._samples = read_curve(self.table)
        except ValueError as error:
            raise refused(str(error), self.table, "table") from None

    @property
    def stretches(self) -> NDArray[np.float64]:
        """Stretches of the rows, (n,) read-only; the first is 1."""
        stretches: NDArray[np.float64] = np.frombuffer(self._samples).reshape(2, -1)[0]
        return stretches

    @property
    def forces(self) -> NDArray[np.float64]:
        """f(λ) of the rows, (n,) read-only: λ² times the pressure, or twice the nominal stress."""
        forces: NDArray[np.float64] = np.frombuffer(self._samples).reshape(2, -1)[1]
        return forces

    @property
    def words(self) -> str:
        """The elastomer in plain words."""
        rows, last = self.stretches.size, self.stretches[-1]
        return f"tabulated in {os.path.basename(self.table)}, {rows} rows up to stretch {last:g}"


class Python(_Law):
    """An object made in Python that has the functions of an elastomer; a file cannot name it."""

    model: Literal["python"] = "python"
    elastomer: Any = Field(description="an object with the functions of an elastomer")

    @model_serializer
    def _named(self) -> dict[str, str]:
        return {"model": "python", "elastomer": repr(self.elastomer)}

    @property
    def words(self) -> str:
        """The elastomer in plain words."""
        return f"from Python, {self.elastomer!r}"


class Preset(Frozen):
    """An elastomer by the name of a material, with constants from the literature."""

    preset: str = Field(description="the name of a preset")

    @property
    def law(self) -> AnyFormula:
        """The model that the preset stands for."""
        written = self.material.elastomer
        found = _MODELS[written["model"]].model_validate(written)
        assert not isinstance(found, Tabulated)
        return found

    @property
    def material(self) -> Material:
        """Where the constants are from, and the material's modulus and permittivity."""
        return PRESETS[self.preset]

    @property
    def model(self) -> str:
        """The name of that model."""
        return self.law.model

    @property
    def words(self) -> str:
        """The elastomer in plain words."""
        return f"{self.preset} ({self.law.words}; {self.material.citation})"


AnyFormula = Gent | NeoHookean | MooneyRivlin | Ogden | ArrudaBoyce | Yeoh | GentGent | Fung
AnyLaw = AnyFormula | Tabulated

_MODELS: dict[str, type[AnyLaw]] = {
    kind.model_fields["model"].annotation.__args__[0]: kind  # type: ignore[union-attr]
    for kind in (Gent, NeoHookean, MooneyRivlin, Ogden, ArrudaBoyce, Yeoh, GentGent, Fung, Tabulated)
}

_A_TABLE = 'must be a table such as { model = "gent", J_lim = 100 } or { preset = "VHB-4910" }'
_OF_AN_OBJECT = ("energy", "pole_form", "pole_form_slope", "stretch_limit")
_WRITTEN = (str, bool, int, float, list, tuple, Mapping, type(None))  # what a file can hold


def _elastomer(value: Any, info: ValidationInfo) -> AnyLaw | Preset | Python:
    match value:
        case {"model": _, "preset": _}:
            raise refused("must have a model or a preset, not both", value)
        case {"model": model}:
            if not isinstance(model, str) or model not in _MODELS:
                raise refused(f"must be {_one_of(_MODELS)}", model, "model")
            return _MODELS[model].model_validate(value, context=info.context)
        case {"preset": preset}:
            if not isinstance(preset, str) or preset not in PRESETS:
                raise refused(f"must be {_one_of(PRESETS)}", preset, "preset")
            return Preset.model_validate(value)
    if isinstance(value, _WRITTEN):
        raise refused(_A_TABLE, value)
    missing = [name for name in _OF_AN_OBJECT if not hasattr(value, name)]
    if missing:
        lacks = "" if len(missing) == len(_OF_AN_OBJECT) else f", lacks {', '.join(missing)}"
        names = f"{', '.join(_OF_AN_OBJECT)} (see simulator.model.elastomers.Elastomer)"
        raise refused(f"{_A_TABLE}, or an object with {names}{lacks}", value)
    return Python(elastomer=value)


def _one_of(names: Mapping[str, object]) -> str:
    *first, last = (f'"{name}"' for name in names)
    return f"{', '.join(first)} or {last}"


Elastomer = Annotated[
    AnyLaw | Preset | Python, Chosen(_elastomer), Field(description="a table with the model or a preset")
]
