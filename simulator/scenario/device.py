"""The device: its gas and its balloons."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from simulator.scenario.elastomer import Elastomer
from simulator.scenario.fields import (
    ElectricField,
    Float,
    Frozen,
    Modulus,
    Permittivity,
    Pressure,
    Radius,
    Thickness,
    Time,
    Volume,
)


class Gas(Frozen):
    """The gas, or liquid, that the balloons share.

    `ambient_pressure` in units of μH/R; `chamber`, a rigid volume on the same gas, of 4πR³; `exponent` of an
    adiabatic gas.
    """

    ambient_pressure: Pressure
    chamber: Volume = 0.0
    law: Annotated[
        Literal["isothermal", "adiabatic", "liquid"],
        Field(description='"isothermal", "adiabatic" or "liquid"'),
    ] = "isothermal"
    exponent: Annotated[Float, Field(gt=1, description="a number > 1")] = 1.4


class Breakdown(Frozen):
    """Dielectric breakdown at the true field `field`, in units of √(μ/ε)."""

    field: ElectricField


class Maxwell(Frozen):
    """A spring (`modulus`) in series with a dashpot, beside the elastomer: relaxes in the time `time`."""

    modulus: Modulus
    time: Time


class Balloon(Frozen):
    """One balloon; its numbers are ratios to the reference balloon."""

    name: Annotated[
        str,
        # Names end up in column titles and dotted keys.
        Field(
            strict=True,
            pattern=r"^[^\W\d]\w*$",
            description="a name of letters, digits and _, no digit first",
        ),
    ]
    radius: Radius = 1.0
    thickness: Thickness = 1.0
    modulus: Modulus = 1.0
    permittivity: Permittivity = 1.0
    electrodes: Annotated[bool, Field(strict=True, description="true or false")] = False
    breakdown: Annotated[Breakdown | None, Field(description="a table such as { field = 12 }")] = None
    maxwell: Annotated[Maxwell | None, Field(description="a table such as { modulus = 0.5, time = 10 }")] = (
        None
    )
    elastomer: Elastomer
