"""The device: its gas and its balloons."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from simulator.scenario.elastomer import Elastomer
from simulator.scenario.fields import Frozen, NonNegative, Positive


class Gas(Frozen):
    """The gas the balloons share; `ambient_pressure` in units of μH/R."""

    ambient_pressure: NonNegative


class Breakdown(Frozen):
    """Dielectric breakdown at the true field `field`, in units of √(μ/ε)."""

    field: Positive


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
    radius: Positive = 1.0
    thickness: Positive = 1.0
    modulus: Positive = 1.0
    permittivity: Positive = 1.0
    electrodes: Annotated[bool, Field(strict=True, description="true or false")] = False
    breakdown: Annotated[Breakdown | None, Field(description="a table such as { field = 12 }")] = None
    elastomer: Elastomer
