"""Strain energies w(λ₁, λ₂) of incompressible films in plane stress, per volume, over the shear modulus.

λ₁ and λ₂ are the principal stretches in the plane of the film, λ₃ = 1/(λ₁λ₂) the one across it. They are
general: with λ₁ = λ₂ = λ each is the ŵ(λ) of docs/physics.md.
"""

from __future__ import annotations

from tests.oracle.shape.jets import Energy, Jet, log


def gent(limit: float) -> Energy:
    """−(J/2) ln(1 − (I₁ − 3)/J)."""
    return lambda a, b: log(1.0 - (first_invariant(a, b) - 3.0) / limit) * (-0.5 * limit)


def neo_hookean() -> Energy:
    """(I₁ − 3)/2."""
    return lambda a, b: (first_invariant(a, b) - 3.0) * 0.5


def mooney_rivlin(first: float) -> Energy:
    """C₁(I₁ − 3)/2 + C₂(I₂ − 3)/2 with C₁ + C₂ = 1."""

    def energy(a: Jet, b: Jet) -> Jet:
        second_invariant = a**-2 + b**-2 + (a * b) ** 2
        return (first_invariant(a, b) - 3.0) * (0.5 * first) + (second_invariant - 3.0) * (
            0.5 * (1.0 - first)
        )

    return energy


def ogden(moduli: tuple[float, ...], exponents: tuple[float, ...]) -> Energy:
    """Σ (mᵢ/αᵢ)(λ₁^αᵢ + λ₂^αᵢ + λ₃^αᵢ − 3), scaled so that ½Σmᵢαᵢ = 1."""
    unit = 0.5 * sum(m * x for m, x in zip(moduli, exponents, strict=True))

    def energy(a: Jet, b: Jet) -> Jet:
        terms = [
            (a**x + b**x + (a * b) ** -x - 3.0) * (m / (unit * x))
            for m, x in zip(moduli, exponents, strict=True)
        ]
        return sum(terms[1:], start=terms[0])

    return energy


def under_voltage(energy: Energy, voltage: float) -> Energy:
    """w − ½φ²λ₁²λ₂²: an ideal dielectric at a given voltage is a hyperelastic film of this energy."""
    return lambda a, b: energy(a, b) - (a * b) ** 2 * (0.5 * voltage**2)


def first_invariant(a: Jet, b: Jet) -> Jet:
    """λ₁² + λ₂² + λ₃²."""
    return a**2 + b**2 + (a * b) ** -2
