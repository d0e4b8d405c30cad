"""The device: its gas and its balloons."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, TypeAdapter, ValidationInfo

from simulator.scenario.elastomer import Elastomer
from simulator.scenario.fields import (
    Chosen,
    Conductivity,
    ElectricField,
    Float,
    Frozen,
    Modulus,
    Number,
    Permittivity,
    Pressure,
    Radius,
    Thickness,
    Time,
    Volume,
    not_empty,
    refused,
)
from simulator.scenario.presets import PRESETS


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


class ConstantBreakdown(Frozen):
    """Dielectric breakdown at the true field `field`, in units of √(μ/ε)."""

    law: Annotated[Literal["constant"], Field(description='"constant" or "power"')] = "constant"
    field: ElectricField


class PowerBreakdown(Frozen):
    """Dielectric breakdown at the true field `field`·λ^`stretch_exponent`·(h/H)^`thickness_exponent`.

    λ is the stretch, h the present thickness of the film and H the reference balloon's unstretched one.
    """

    law: Annotated[Literal["power"], Field(description='"constant" or "power"')]
    field: ElectricField
    stretch_exponent: Number
    thickness_exponent: Number


def _breakdown(value: Any, info: ValidationInfo) -> ConstantBreakdown | PowerBreakdown | None:
    match value:
        case None:
            return None
        case {"law": "power"}:
            return PowerBreakdown.model_validate(value, context=info.context)
        case {"field": _} | {"law": _}:
            return ConstantBreakdown.model_validate(value, context=info.context)
    raise refused("must be a table such as { field = 12 }", value)


Breakdown = Annotated[
    ConstantBreakdown | PowerBreakdown | None,
    Chosen(_breakdown),
    Field(description="a table such as { field = 12 }"),
]


class Leak(Frozen):
    """A film that conducts: `conductivity`, in units of ε per time, at small fields.

    It is multiplied by e for every `field`, in units of √(μ/ε); None: it is the same at all fields.
    """

    conductivity: Conductivity
    field: Annotated[ElectricField | None, Field(description="a number > 0")] = None


class Maxwell(Frozen):
    """A spring (`modulus`) in series with a dashpot, beside the elastomer: relaxes in the time `time`.

    `flow` is how: "linear" or "newtonian", see `simulator.model.viscoelastic`; None is the one that a single
    branch, "newtonian", or a list of them, "linear", has by itself.
    """

    modulus: Modulus
    time: Time
    flow: Annotated[Literal["linear", "newtonian"] | None, Field(description='"linear" or "newtonian"')] = (
        None
    )


class MaxwellPreset(Frozen):
    """The branches of a material by its name, in proportion to the modulus of the balloon; times in s."""

    preset: str = Field(description="the name of a preset with branches")


_A_BRANCH = "a table such as { modulus = 0.5, time = 10 }, a list of such tables, or a preset"
_BRANCHES: TypeAdapter[tuple[Maxwell, ...]] = TypeAdapter(
    Annotated[tuple[Maxwell, ...], AfterValidator(not_empty)]
)


def _maxwell(value: Any, info: ValidationInfo) -> Maxwell | tuple[Maxwell, ...] | MaxwellPreset | None:
    match value:
        case None | Maxwell() | MaxwellPreset():
            return value
        case {"preset": preset}:
            known = [name for name, material in PRESETS.items() if material.branches]
            if preset not in known:
                allowed = " or ".join(f'"{name}"' for name in known)
                raise refused(f"must be {allowed}", preset, "preset")
            return MaxwellPreset.model_validate(value, context=info.context)
        case list() | tuple():
            return _BRANCHES.validate_python(tuple(value), context=info.context)
        case Mapping():
            return Maxwell.model_validate(value, context=info.context)
    raise refused(f"must be {_A_BRANCH}", value)


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
    breakdown: Breakdown = None
    maxwell: Annotated[
        Maxwell | tuple[Maxwell, ...] | MaxwellPreset | None,
        Chosen(_maxwell),
        Field(description=_A_BRANCH),
    ] = None
    leak: Annotated[Leak | None, Field(description="a table such as { conductivity = 1e-3 }")] = None
    elastomer: Elastomer

    @property
    def branches(self) -> tuple[Maxwell, ...]:
        """All viscoelastic branches, with the flow that each has."""
        match self.maxwell:
            case None:
                return ()
            case Maxwell() as one:
                return (one.model_copy(update={"flow": one.flow or "newtonian"}),)
            case MaxwellPreset(preset=name):
                material = PRESETS[name]
                assert material.shear_modulus is not None
                unit = self.modulus / material.shear_modulus
                return tuple(
                    Maxwell(modulus=unit * branch.shear_modulus, time=branch.time, flow="linear")
                    for branch in material.branches
                )
            case several:
                return tuple(one.model_copy(update={"flow": one.flow or "linear"}) for one in several)
