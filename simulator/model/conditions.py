"""What can end a branch: conditions on the state, as data.

A condition is a pure function of the state y, positive while all is well and falling through zero at the
event. IDA evaluates it between residual calls, so it must compute from its arguments alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.events import EventKind
from simulator.model.elastomers import Number, largest_stretch
from simulator.model.equations import Equations, State
from simulator.model.membranes import AnyMembrane, sphericity
from simulator.model.strength import Strength

FloatArray = NDArray[np.float64]

ENDLESS = 1e3  # stretch that counts as without end


@dataclass(frozen=True)
class Condition:
    """One condition: `margin(y)` falls through zero at the event `kind`, an `EventKind` or another word.

    `margin` takes floats, complex numbers or rows of arrays; `slope(y)` is its gradient at one state.
    """

    kind: str
    margin: Callable[[State], Number]
    slope: Callable[[FloatArray], FloatArray]


def conditions(equations: Equations, strengths: Sequence[Strength | None]) -> tuple[Condition, ...]:
    """The conditions that apply to a set of equations, stability first.

    `strengths` are those of its balloons' films, None where there is none.
    """
    found = [stability(equations)]
    if equations.can_go_slack:
        found.append(tension(len(equations.membranes)))
    for place, (membrane, strength) in enumerate(zip(equations.membranes, strengths, strict=True)):
        if strength is not None and membrane.drive is not None:
            found.append(intactness(membrane, place, strength))
    for place, wall in enumerate(equations.walls):
        if (largest := largest_stretch(wall.elastomer)) < math.inf:
            found.append(validity(place, largest))
        elif math.isinf(wall.elastomer.stretch_limit):
            found.append(boundedness(place))
    return tuple(found)


def stability(equations: Equations) -> Condition:
    """Smallest eigenvalue of the scaled Hessian S; zero at limit points and branch points."""
    return singularity(equations, 0, 1.0)


def stability_in_motion(equations: Equations) -> Callable[..., Number]:
    """Smallest eigenvalue of the scaled Hessian S in a state in which the forces R do not vanish.

    There ∂R/∂λ is not all of it: of R = D g/k, S has D g′/k = ∂R/∂λ − R D′/D on its diagonal. A second
    argument is what other parts of the balloons add to g′, (n_balloons).
    """

    def margin(y: State, added: Sequence[float] = ()) -> Number:
        slopes, squares = equations.stiffness(y)
        denominators = [wall.elastomer.pole_form(x)[1] for wall, x in zip(equations.walls, y, strict=False)]
        walls = zip(slopes, equations.residual(y), equations.walls, y, denominators, strict=False)
        diagonal = [
            slope - force * wall.elastomer.pole_form_slope(x)[1] / denominator
            for slope, force, wall, x, denominator in walls
        ]
        for i, (more, wall) in enumerate(zip(added, equations.walls, strict=False)):
            diagonal[i] += denominators[i] / wall.modulus * more
        return equations.spectrum.eigenvalue(diagonal, squares, 0)

    return margin


def singularity(equations: Equations, place: int, sign: float) -> Condition:
    """±1 times the eigenvalue of S at a place in ascending order; zero where S is singular."""
    stiffness, eigenvalue = equations.stiffness, equations.spectrum.eigenvalue

    def margin(y: State) -> Number:
        return sign * eigenvalue(*stiffness(y), place)

    def slope(y: FloatArray) -> FloatArray:
        # By complex steps in all unknowns at once.
        diagonal, squares = (
            np.array(np.broadcast_arrays(*part, y)[:-1], dtype=complex)
            for part in stiffness(_complex_steps(y))
        )
        slopes = equations.spectrum.slopes(
            softest_mode(equations, y, place),
            diagonal.real[:, 0],
            squares.real[:, 0],
            diagonal.imag,
            squares.imag,
        )
        return np.asarray(sign * slopes / COMPLEX_STEP)

    return Condition(EventKind.LIMIT_POINT, margin, slope)


def tension(place: int) -> Condition:
    """The pressure, the unknown at a place; at zero the membranes go slack."""

    def slope(y: FloatArray) -> FloatArray:
        out = np.zeros(y.size)
        out[place] = 1.0
        return out

    return Condition(EventKind.LOSS_OF_TENSION, lambda y: y[place], slope)


def intactness(membrane: AnyMembrane, place: int, strength: Strength) -> Condition:
    """1 − (E/E_b)² of one electroded balloon; at zero its film breaks down."""

    def margin(y: State) -> Number:
        share = membrane.field(y[place], y[-1]) / strength.at(y[place])
        return 1.0 - share * share

    return Condition(EventKind.BREAKDOWN, margin, lambda y: gradient(margin, y))


def validity(place: int, largest: float) -> Condition:
    """How far a stretch is from the largest that its elastomer is known at."""

    def slope(y: FloatArray) -> FloatArray:
        out = np.zeros(y.size)
        out[place] = -1.0
        return out

    return Condition(EventKind.OUT_OF_RANGE, lambda y: largest - y[place], slope)


def boundedness(place: int) -> Condition:
    """How far a stretch is from 1000: a wall that never stiffens may grow without end at a finite drive."""
    reached = validity(place, ENDLESS)
    return Condition(EventKind.RUNAWAY, reached.margin, reached.slope)


@dataclass(frozen=True)
class ShapeCondition:
    """What keeps one balloon a sphere.

    Attributes
    ----------
    place : int
        Of the balloon, among those of its equations.
    mode : {"pear", "shear"}
        What it would turn into: a pear, or, where its elastomer does not resist shear in its surface, a
        sphere that shears.
    condition : Condition
        Positive while it is a sphere, zero where it is lost.
    """

    place: int
    mode: str
    condition: Condition


def shape_conditions(equations: Equations, charged: Collection[int] = ()) -> tuple[ShapeCondition, ...]:
    """What keeps the balloons of a set of equations spheres; none where nothing can be lost.

    `charged` are the places of balloons that have a charge which is not in the equations.
    """
    found: list[ShapeCondition] = []
    for place, membrane in enumerate(equations.membranes):
        elastomer = membrane.wall.elastomer
        driven = membrane.drive is not None or place in charged
        if driven or not getattr(elastomer, "stays_spherical", False):
            found.append(ShapeCondition(place, "pear", _pear(membrane, place)))
        if (stiffness := getattr(elastomer, "shear_stiffness", None)) is not None:
            found.append(ShapeCondition(place, "shear", _shear(stiffness, place)))
    return tuple(found)


def _pear(membrane: AnyMembrane, place: int) -> Condition:
    def margin(y: State) -> Number:
        return sphericity(membrane, y[place], y[-1])

    def slope(y: FloatArray) -> FloatArray:
        stretch, v = float(y[place]), float(y[-1])
        out = np.zeros(y.size)
        out[place] = sphericity(membrane, complex(stretch, COMPLEX_STEP), v).imag / COMPLEX_STEP
        if membrane.drive is not None:
            out[-1] = sphericity(membrane, stretch, complex(v, COMPLEX_STEP)).imag / COMPLEX_STEP
        return out

    return Condition(EventKind.LOSS_OF_SPHERICITY, margin, slope)


def _shear(stiffness: Callable[[Number], Number], place: int) -> Condition:
    def margin(y: State) -> Number:
        return stiffness(y[place])

    return Condition(EventKind.LOSS_OF_SPHERICITY, margin, lambda y: gradient(margin, y))


COMPLEX_STEP = 1e-30  # so small that its square is nothing: slopes have all digits


def gradient(margin: Callable[[State], Number], y: FloatArray) -> FloatArray:
    """Gradient of a smooth function of the state by complex steps, (n_unknowns,)."""
    return np.asarray(np.imag(margin(_complex_steps(y))) / COMPLEX_STEP)


def _complex_steps(y: FloatArray) -> NDArray[np.complex128]:
    """One state with a complex step in each unknown, columns (n_unknowns, n_unknowns)."""
    return np.asarray(y[:, None] + 1j * COMPLEX_STEP * np.eye(y.size))


def eigenvalues(equations: Equations, y: FloatArray) -> FloatArray:
    """Eigenvalues of S at one state, ascending: one for each balloon, with a liquid one fewer."""
    return modes(equations, y)[0]


def modes(equations: Equations, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues of S at one state, ascending, (n_modes,), and unit eigenvectors, (n_balloons, n_modes)."""
    return equations.spectrum.modes(*equations.stiffness(y.tolist()))


def softest_mode(equations: Equations, y: FloatArray, place: int = 0) -> FloatArray:
    """Unit eigenvector of S at one state for its smallest eigenvalue (or that at `place`), (n_balloons,)."""
    vectors = modes(equations, y)[1]
    # One balloon on a liquid cannot move.
    return np.asarray(vectors[:, place]) if vectors.size else np.zeros(len(vectors))
