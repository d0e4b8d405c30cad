"""Whether an object from elsewhere is the elastomer that it says it is."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from simulator.model.elastomers.law import largest_stretch, tension_force

_FUNCTIONS = ("energy", "pole_form", "pole_form_slope")
_STEP = 1e-30
_ACCURACY = 1e-8
_HIGHEST = 4.0  # stretch up to which an elastomer without a limit is looked at


def defect(elastomer: Any) -> str | None:
    """What keeps an object from being an elastomer; None where nothing does.

    Its functions are held against each other at 41 stretches from 1 on, by complex steps: f = ŵ′, N′ and D′,
    f(1) = 0, f′(1) > 0, D > 0, and the same from numbers as from arrays.

    Parameters
    ----------
    elastomer : object

    Returns
    -------
    str or None
        A sentence that begins with "must".
    """
    missing = [name for name in _FUNCTIONS if not callable(getattr(elastomer, name, None))]
    missing += ["stretch_limit"] if not hasattr(elastomer, "stretch_limit") else []
    if missing:
        return f"must have {', '.join(missing)}, see simulator.model.elastomers.Elastomer"
    limits = {}
    for name, value in (
        ("stretch_limit", elastomer.stretch_limit),
        ("largest_stretch", getattr(elastomer, "largest_stretch", math.inf)),
    ):
        if not isinstance(value, float | int) or not value > 1.0:
            return f"must have a {name} > 1 (inf for none), is {value!r}"
        limits[name] = float(value)
    try:
        hash(elastomer)
    except TypeError:
        return "must be hashable, as a frozen dataclass is"
    top = min(*limits.values(), _HIGHEST)
    stretches = 1.0 + (top - 1.0) * np.linspace(0.0, 0.98, 41)
    try:
        return _contradiction(elastomer, stretches)
    except Exception as error:  # whatever the object raises, it is no elastomer
        return f"must take floats, complex numbers and arrays of either: {type(error).__name__}: {error}"


def _contradiction(elastomer: Any, stretches: np.ndarray[Any, np.dtype[np.float64]]) -> str | None:
    ahead = stretches + 1j * _STEP

    def parts(pair: tuple[Any, Any]) -> tuple[Any, Any]:
        return tuple(np.broadcast_to(part, stretches.shape) for part in pair)  # type: ignore[return-value]

    numerator, denominator = parts(elastomer.pole_form(stretches))
    if not np.all(np.isfinite(numerator) & np.isfinite(denominator)):
        return "must have a finite pole_form from stretch 1 to its limit"
    if not np.all(np.real(denominator) > 0.0):
        return "must have D > 0 below its stretch_limit in pole_form = (N, D)"
    slopes = parts(elastomer.pole_form_slope(stretches))
    stepped = parts(elastomer.pole_form(ahead))
    if abs(numerator[0]) > 1e-14:
        return f"must have f(1) = 0, is {float(np.real(numerator[0] / denominator[0])):.3g}"
    if not slopes[0][0] > 0.0:
        return f"must stiffen from rest, f′(1) > 0, is {float(np.real(slopes[0][0] / denominator[0])):.3g}"
    force = np.real(tension_force(elastomer, stretches))
    pairs = [
        ("N/D = energy′ in pole_form = (N, D)", np.imag(elastomer.energy(ahead)) / _STEP, force),
        ("N′ in pole_form_slope = (N′, D′)", np.imag(stepped[0]) / _STEP, slopes[0]),
        ("D′ in pole_form_slope = (N′, D′)", np.imag(stepped[1]) / _STEP, slopes[1]),
    ]
    for name, exact, found in pairs:
        size = float(np.max(np.abs(exact))) or 1.0
        wrong = ~(np.abs(exact - found) <= _ACCURACY * np.maximum(np.abs(exact), 1e-3 * size))
        if wrong.any():
            i = int(np.argmax(wrong))
            return (
                f"must have {name}: it is {float(exact[i]):.9g} at stretch {stretches[i]:.6g} by a complex "
                f"step, the function gives {float(found[i]):.9g}"
            )
    for i in (0, 20, 40):
        alone = [part.real for part in elastomer.pole_form(float(stretches[i]))]
        if not np.allclose(alone, [numerator[i], denominator[i]], rtol=1e-12, atol=1e-14):
            return f"must give the same from a float as from an array, stretch {stretches[i]:.6g}"
    largest = largest_stretch(elastomer)
    if largest < math.inf and not np.all(np.isfinite(elastomer.pole_form(1.01 * largest))):
        return "must go on smoothly a little beyond its largest_stretch, where a solver looks"
    return None
