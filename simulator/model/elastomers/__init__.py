"""Strain energies of elastomers under equal-biaxial stretching, and their derivatives.

A balloon's wall is stretched by λ in both directions of its surface and by λ⁻² through its thickness
(incompressible). ŵ(λ) is the strain energy per unit volume over the shear modulus μ, f = ŵ′. The principal
invariants are I₁ = 2λ² + λ⁻⁴ and I₂ = λ⁴ + 2λ⁻².

Where an elastomer stiffens without bound, f has a pole at the limiting stretch, and Newton steps taken
on f itself jump across it. So each elastomer gives f as a fraction N/D of two smooth functions: the
equations of `model` are multiplied through by D and stay smooth at any load.

Every function takes a float, a complex number or an array of either, and returns the like. That is what
makes derivatives by complex step exact.

- `law` is what the equations need to know of a material, and what follows from it;
- `models` and `stiffening` are the formulas, `chain` the eight-chain network, `tabulated` a measured curve;
- `checks` holds an object made elsewhere against what is asked of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from simulator.model.elastomers.chain import ArrudaBoyce
from simulator.model.elastomers.law import (
    Elastomer,
    Number,
    largest_stretch,
    tension_force,
    tension_stiffness,
)
from simulator.model.elastomers.models import Gent, MooneyRivlin, NeoHookean, Ogden
from simulator.model.elastomers.stiffening import Fung, GentGent, Yeoh

if TYPE_CHECKING:
    from simulator.model.elastomers.tabulated import Tabulated

__all__ = [
    "ArrudaBoyce",
    "Elastomer",
    "Fung",
    "Gent",
    "GentGent",
    "MooneyRivlin",
    "NeoHookean",
    "Number",
    "Ogden",
    "Tabulated",
    "Yeoh",
    "as_written",
    "largest_stretch",
    "tension_force",
    "tension_stiffness",
]


def as_written(written: Any) -> Elastomer:
    """The elastomer that a scenario's `elastomer` table names.

    Parameters
    ----------
    written : one of the tables of `simulator.scenario.elastomer`
        A preset stands for the model that it is made of.

    Returns
    -------
    Elastomer
        An object passed from Python is returned as it is, not yet checked.
    """
    law = written.law
    match law.model:
        case "gent":
            return Gent(law.J_lim)
        case "neo-hookean":
            return NeoHookean()
        case "mooney-rivlin":
            return MooneyRivlin(law.C1, law.C2)
        case "ogden":
            return Ogden(law.mu, law.alpha)
        case "arruda-boyce":
            return ArrudaBoyce(law.lambda_L)
        case "yeoh":
            return Yeoh(law.C1, law.C2, law.C3)
        case "gent-gent":
            return GentGent(law.C1, law.C2, law.J_lim)
        case "fung":
            return Fung(law.b)
        case "tabulated":
            from simulator.model.elastomers.tabulated import Tabulated

            return Tabulated.through(law.stretches, law.forces)
        case "python":
            found: Elastomer = law.elastomer
            return found
    raise NotImplementedError(f"no elastomer for the model {law.model!r}")


def __getattr__(name: str) -> Any:
    # Its spline needs SciPy, which no other elastomer does.
    if name == "Tabulated":
        from simulator.model.elastomers.tabulated import Tabulated

        return Tabulated
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
