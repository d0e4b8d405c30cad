"""Units of measurement: reading texts such as "8 kV", and writing SI columns and numbers with a prefix.

In between, everything is dimensionless, made so with the `Scales` of a reference balloon. pint reads the
units and is imported when the first of them is read: a scenario that has none does without.
"""

from __future__ import annotations

import math
import re
from dataclasses import asdict, dataclass
from decimal import Context, Decimal, localcontext
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import numpy as np
    from numpy.typing import NDArray

VACUUM_PERMITTIVITY = 8.8541878128e-12  # F/m, CODATA 2018


@dataclass(frozen=True)
class Dimension:
    """What a number measures.

    Attributes
    ----------
    name, example : str
        As in "must be a voltage such as "8 kV"".
    unit : str
        Its SI unit.
    scale : str
        The attribute of `Scales` that is its unit in the dimensionless model.
    symbol : str
        That unit as a formula.
    """

    name: str
    example: str
    unit: str
    scale: str
    symbol: str


TIME = Dimension("a time", "30 s", "s", "time", "s")
RADIUS = Dimension("a length", "20 mm", "m", "radius", "R")
THICKNESS = Dimension("a length", "0.5 mm", "m", "thickness", "H")
MODULUS = Dimension("a modulus", "45 kPa", "Pa", "shear_modulus", "μ")
PERMITTIVITY = Dimension("a permittivity", "41.6 pF/m", "F/m", "absolute_permittivity", "ε")
PRESSURE = Dimension("a pressure", "2 kPa", "Pa", "pressure", "μH/R")
VOLTAGE = Dimension("a voltage", "8 kV", "V", "voltage", "H√(μ/ε)")
FIELD = Dimension("an electric field", "250 MV/m", "V/m", "field", "√(μ/ε)")
CHARGE = Dimension("a charge", "1 µC", "C", "charge", "4πR²√(εμ)")
VOLUME = Dimension("a volume", "0.5 l", "m^3", "volume", "4πR³")
ENERGY = Dimension("an energy", "1 mJ", "J", "energy", "4πR²Hμ")
RESISTANCE = Dimension("a resistance", "10 MΩ", "ohm", "resistance", "H/(4πR²ε)·s")
CURRENT = Dimension("a current", "0.1 mA", "A", "current", "4πR²√(εμ)/s")
VISCOSITY = Dimension("a viscosity", "2 kPa*s", "Pa*s", "viscosity", "μ·s")
CONDUCTIVITY = Dimension("a conductivity", "3.2e-14 S/m", "S/m", "conductivity", "ε/s")

_RATIOS = (RADIUS, THICKNESS, MODULUS, PERMITTIVITY)  # those of a balloon to the reference balloon

DIMENSIONS = (
    TIME,
    RADIUS,
    THICKNESS,
    MODULUS,
    PERMITTIVITY,
    PRESSURE,
    VOLTAGE,
    FIELD,
    CHARGE,
    VOLUME,
    ENERGY,
    RESISTANCE,
    CURRENT,
    CONDUCTIVITY,
    VISCOSITY,
)

# Of the quantities in results; a stretch becomes a radius, which depends on the balloon.
QUANTITIES = {
    "time": TIME,
    "voltage": VOLTAGE,
    "supply": VOLTAGE,
    "pressure": PRESSURE,
    "volume": VOLUME,
    "gas": ENERGY,
    "field": FIELD,
    "strength": FIELD,
    "charge": CHARGE,
    "energy": ENERGY,
    "dissipated": ENERGY,
}


@dataclass(frozen=True)
class Scales:
    """The reference balloon in SI units, and the units of the dimensionless model that follow from it.

    Attributes
    ----------
    shear_modulus : float
        μ, in Pa.
    thickness, radius : float
        H and R of the unstretched wall, in m.
    permittivity : float
        ε of the film over that of the vacuum.
    """

    shear_modulus: float
    thickness: float
    radius: float
    permittivity: float

    @property
    def absolute_permittivity(self) -> float:
        """ε, in F/m."""
        return self.permittivity * VACUUM_PERMITTIVITY

    @property
    def time(self) -> float:
        """One second: the quasi-static model has no time of its own, so times are in s."""
        return 1.0

    @property
    def pressure(self) -> float:
        """μH/R, in Pa."""
        return self.shear_modulus * self.thickness / self.radius

    @property
    def field(self) -> float:
        """√(μ/ε), in V/m."""
        return math.sqrt(self.shear_modulus / self.absolute_permittivity)

    @property
    def voltage(self) -> float:
        """H√(μ/ε), in V."""
        return self.thickness * self.field

    @property
    def charge(self) -> float:
        """4πR²√(εμ), in C."""
        return 4.0 * math.pi * self.radius**2 * math.sqrt(self.absolute_permittivity * self.shear_modulus)

    @property
    def volume(self) -> float:
        """4πR³, in m³."""
        return 4.0 * math.pi * self.radius**3

    @property
    def energy(self) -> float:
        """4πR²Hμ, in J."""
        return 4.0 * math.pi * self.radius**2 * self.thickness * self.shear_modulus

    @property
    def resistance(self) -> float:
        """H/(4πR²ε) times 1 s, in Ω."""
        return self.voltage / self.charge * self.time

    @property
    def current(self) -> float:
        """4πR²√(εμ) in 1 s, in A."""
        return self.charge / self.time

    @property
    def viscosity(self) -> float:
        """μ times 1 s, in Pa s."""
        return self.shear_modulus * self.time

    @property
    def conductivity(self) -> float:
        """ε over 1 s, in S/m."""
        return self.absolute_permittivity / self.time

    def of(self, dimension: Dimension) -> float:
        """The SI value that is 1 in the dimensionless model."""
        return float(getattr(self, dimension.scale))

    def record(self) -> dict[str, float]:
        """The reference balloon and the scales, by name with their units."""
        units = {"shear_modulus": " [Pa]", "thickness": " [m]", "radius": " [m]"}
        given = {f"{name}{units.get(name, '')}": value for name, value in asdict(self).items()}
        derived = (PRESSURE, VOLTAGE, FIELD, CHARGE, VOLUME, ENERGY, TIME)
        return given | {f"{d.scale} [{d.unit}]": self.of(d) for d in derived}


SI = Scales(1.0, 1.0, 1.0, 1.0)  # in which lengths and moduli are themselves, and permittivities relative


class Written(float):
    """A dimensionless number that was written with a unit, and remembers the text."""

    __slots__ = ("text",)

    text: str

    def __new__(cls, number: float, text: str) -> Written:
        """A number and what was written for it."""
        made = super().__new__(cls, number)
        made.text = text
        return made

    def __getnewargs__(self) -> tuple[float, str]:  # type: ignore[override]
        return float(self), self.text


def as_written(value: Any) -> Any:
    """A value, or a table of values, with texts where the scenario has texts."""
    if isinstance(value, Written):
        return value.text
    if isinstance(value, dict):
        return {key: as_written(item) for key, item in value.items()}
    return value


# A number, then names of units with small powers. pint would also work out "9**9**9 V", at length.
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
_POWER = r"(?:(?:\^|\*\*)[+-]?\d)?"
_NAME = r"(?![eE]\d)[^\W\d]\w*"
_UNIT = rf"{_NAME}{_POWER}(?:\s*[*/]\s*{_NAME}{_POWER}){{0,5}}"
_QUANTITY = re.compile(rf"\s*(?P<number>{_NUMBER})\s*(?P<unit>{_UNIT})\s*")


def has_unit(text: str) -> bool:
    """Whether a text looks like a number with a unit."""
    return len(text) <= 80 and _QUANTITY.fullmatch(text) is not None


def read(text: str, dimension: Dimension, scales: Scales) -> float:
    """A text with a unit as a dimensionless number.

    Prefixes and powers of ten are exact: "8 kV" and "8000 V" are one number. A size of a balloon over that of
    the reference balloon is rounded to 15 digits, so that "0.336 mm" of 0.448 mm is 0.75: balloons that are
    written alike in different ways are alike, and move together.

    Raises
    ------
    ValueError
        If the unit is unknown (then it says so), or the text is none of the dimension.
    """
    value = read_si(text, dimension) / scales.of(dimension)
    if not math.isfinite(value):
        raise ValueError("it is too large")
    return float(f"{value:.15g}") if dimension in _RATIOS else value


def read_si(text: str, dimension: Dimension) -> float:
    """A text with a unit as a number in the SI unit of its dimension. Raises as `read`."""
    found = _QUANTITY.fullmatch(text) if has_unit(text) else None
    if found is None:
        raise ValueError("")
    with localcontext(Context(prec=34)):
        return float(Decimal(found["number"]) * _factor(found["unit"], dimension))


@cache
def _factor(unit: str, dimension: Dimension) -> Decimal:
    """A unit over the SI unit of its dimension. Raises as `read`."""
    import pint

    registry = _registry()
    try:
        given = registry.Quantity(Decimal(1), registry.parse_units(unit))
        return Decimal(given.to(registry.parse_units(dimension.unit)).magnitude)
    except pint.UndefinedUnitError:
        raise ValueError(f"the unit {unit} is not known") from None
    except Exception:  # units that do not multiply, such as °C and dB, fail in ways of their own
        raise ValueError("") from None


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(non_int_type=Decimal)


def in_si(
    columns: Mapping[str, NDArray[Any]],
    scales: Scales,
    radii: Mapping[str, float],
    others: Mapping[str, Dimension] | None = None,
) -> dict[str, NDArray[np.float64]]:
    """Columns of a result in SI units, named with their unit; those that have none are left out.

    Parameters
    ----------
    columns : mapping of str to array
        Dimensionless, named `voltage_<balloon>`, `pressure_before` and so on.
    scales : Scales
    radii : mapping of str to float
        Unstretched radii of the balloons over the reference one's: stretches times these are radii.
    others : mapping of str to Dimension, optional
        Quantities that are measured in something else than usual.

    Returns
    -------
    dict of str to array
        `voltage_<balloon> [V]`, `pressure_before [Pa]`, `radius_<balloon> [m]` and so on.
    """
    found = {}
    dimensions = {**QUANTITIES, **(others or {})}
    for name, values in columns.items():
        quantity, _, rest = name.partition("_")
        sides = (rest, rest.removesuffix("_before"), rest.removesuffix("_after"))
        balloon = next((side for side in sides if side in radii), None)
        if quantity == "stretch" and balloon is not None:
            found[f"radius_{rest} [m]"] = values * radii[balloon] * scales.radius
        elif quantity in dimensions:
            dimension = dimensions[quantity]
            found[f"{name} [{dimension.unit}]"] = values * scales.of(dimension)
    return found


def per(unit: str, other: str) -> str:
    """A unit over another one: "V/mm", "V/(μH/R)"; the first alone where the other has none."""
    other = f"({other})" if "/" in other else other
    return f"{unit}/{other}" if other else unit


NOISE = 1e-12  # of a dimensionless number: what is smaller is rounding, and no number to choose a prefix by

_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}


def prefixed(dimension: Dimension, largest: float) -> tuple[float, str]:
    """The unit in which values of a quantity read best.

    Parameters
    ----------
    dimension : Dimension
    largest : float
        The largest of them, in SI units.

    Returns
    -------
    (float, str)
        How many SI units it is, and its symbol: (1000.0, "kV").
    """
    exponent = 0
    if dimension.unit not in ("s", "m^3") and math.isfinite(largest) and largest > 0.0:
        # 1000 V are 1 kV, whatever their last digit.
        exponent = 3 * math.floor(math.log10(largest * (1.0 + 1e-9)) / 3.0)
        exponent = min(max(exponent, -12), 0 if dimension.unit == "m" else 12)
    return 10.0**exponent, _PREFIXES[exponent] + dimension.unit


def of_column(dimension: Dimension, scales: Scales, values: Iterable[float]) -> tuple[float, str]:
    """The unit in which a column of numbers reads best: that of the one in the middle.

    Parameters
    ----------
    dimension : Dimension
    scales : Scales
    values : iterable of float
        Dimensionless. What is rounding, below `NOISE`, has no say, and one enormous value has not either.

    Returns
    -------
    (float, str)
        What the dimensionless numbers are to be multiplied by, and the symbol of the unit.
    """
    sizes = sorted(abs(value) for value in values if abs(value) > NOISE)
    scale = scales.of(dimension)
    size, unit = prefixed(dimension, sizes[len(sizes) // 2] * scale if sizes else 0.0)
    return scale / size, unit


def said(dimension: Dimension, scales: Scales, value: float, digits: int = 6) -> str:
    """A dimensionless number as a text with a unit: "8.1 kV"; what is rounding is 0."""
    return with_prefix(dimension, value * scales.of(dimension) if abs(value) > NOISE else 0.0, digits)


def with_prefix(dimension: Dimension, value: float, digits: int = 6) -> str:
    """A value in SI units as a text with a prefix, for people: "8.1 kV"."""
    size, unit = prefixed(dimension, abs(value))
    return f"{value / size:.{digits}g} {unit}"
