"""Elastomers by the name of a material: published constants, and where they are from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple


class ViscousBranch(NamedTuple):
    """A viscoelastic branch of a material: its shear modulus in Pa, and the time in s in which it relaxes."""

    shear_modulus: float
    time: float


@dataclass(frozen=True)
class Material:
    """Published constants of a material.

    Attributes
    ----------
    elastomer : mapping
        The model and its numbers, as in a scenario's `elastomer`.
    citation : str
        Author, journal and year, short.
    source : str
        The whole reference.
    fitted_to : str
        What the constants were found from, and how far they hold.
    shear_modulus : float or None
        Small-strain shear modulus in Pa, None where the source gives none.
    permittivity : float or None
        Permittivity over that of the vacuum, None where the source gives none.
    branches : tuple of ViscousBranch
        What the source gives of how it relaxes; their flow is the linear one.
    """

    elastomer: Mapping[str, Any]
    citation: str
    source: str
    fitted_to: str
    shear_modulus: float | None = None
    permittivity: float | None = None
    branches: tuple[ViscousBranch, ...] = ()

    @property
    def at_once(self) -> float:
        """How many times as stiff as relaxed it is at once; 1 where it has no branches."""
        if not self.branches or self.shear_modulus is None:
            return 1.0
        return 1.0 + sum(branch.shear_modulus for branch in self.branches) / self.shear_modulus


PRESETS: Mapping[str, Material] = MappingProxyType(
    {
        "VHB-4910": Material(
            elastomer={"model": "arruda-boyce", "lambda_L": 5.99},
            citation="Wang et al. 2016",
            source="S. Wang, M. Decker, D. L. Henann and S. A. Chester, J. Mech. Phys. Solids 95 (2016) "
            "213–229; permittivity as E. M. Stewart and L. Anand (2023) take it",
            fitted_to="3M VHB 4910, slowly loaded: its equilibrium network, without the viscous ones",
            # nkT λ_L β₀/3 with the source's nkT = 15.36 kPa.
            shear_modulus=1.5624e4,
            permittivity=4.8,
            branches=(
                ViscousBranch(2.606e4, 0.607),
                ViscousBranch(2.653e4, 6.56),
                ViscousBranch(1.083e4, 61.25),
            ),
        ),
        "Sylgard-186": Material(
            elastomer={"model": "gent", "J_lim": 30.04},
            citation="Akbari et al. 2013",
            source="S. Akbari, S. Rosset and H. R. Shea, Appl. Phys. Lett. 102 (2013) 071906",
            fitted_to="Dow Corning Sylgard 186, a castable silicone",
            shear_modulus=5.9e5,
        ),
        "natural-rubber": Material(
            elastomer={"model": "ogden", "mu": [6.3e5, 1.2e3, -1.0e4], "alpha": [1.3, 5.0, -2.0]},
            citation="Ogden 1972",
            source="R. W. Ogden, Proc. R. Soc. A 326 (1972) 565–584, in SI units",
            fitted_to="L. R. G. Treloar's tests (1944) of vulcanised natural rubber in tension, shear and "
            "equal-biaxial tension",
            shear_modulus=4.225e5,
        ),
    }
)
