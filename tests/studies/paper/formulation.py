"""Section 2 and its equations."""

from __future__ import annotations

import numpy as np

from simulator.model.device import Device
from simulator.model.elastomers import Gent
from tests.studies.paper.case import Case, Misprint, Statement, falls, rises
from tests.studies.paper.real import rising

_STRETCHES = np.linspace(1.0, 7.1, 200)
_STEP = 1e-30


def statements(cases: dict[str, Case]) -> list[Statement]:
    """Equations 1 to 8, and Fig. 1."""
    gent = Gent(100.0)
    slope = np.imag(gent.energy(_STRETCHES + _STEP * 1j)) / _STEP
    printed = _printed_force(_STRETCHES)
    error = float(np.max(np.abs(slope - printed) / np.maximum(printed, 1.0)))
    worst = max(max(_residuals(case)) for case in cases.values())
    parts = [
        (case.curve.stretch[: case.rising], case.curve.pressure[: case.rising]) for case in cases.values()
    ]
    as_drawn = [rises(s[:, 0]) and falls(s[:, 1]) and falls(p) for s, p in parts]
    charged = all(rises(case.curve.charge[: case.rising, 0]) for case in cases.values())
    return [
        Statement(
            "Eqs. 1–3",
            "f(λ) = 2J(λ − λ⁻⁵)/(J − (2λ² + λ⁻⁴ − 3)) follows from W, and p = f/λ² from σ = (λ/2) ∂W/∂λ",
            f"∂W/∂λ and μf differ by at most {_power(error)} of f",
            error < 1e-12,
        ),
        Statement(
            "Eqs. 5, 6, 8",
            "the active and the passive balloon in balance, the gas ideal",
            f"hold to {_power(worst)} of their terms at all points of {len(cases)} paths",
            worst < 1e-12,
        ),
        Statement(
            "Fig. 1c",
            "under the voltage the active balloon grows, the passive one shrinks, and the pressure drops",
            f"so on {sum(as_drawn)} of {len(as_drawn)} paths, up to their first limit point or end",
            all(as_drawn),
            real=rising(cases),
        ),
        Statement(
            "Section 2",
            "an amount of charge is accumulated on the active balloon",
            "the charge rises with the voltage on all of them"
            if charged
            else "the charge does not always rise",
            charged,
            real=rising(cases),
        ),
    ]


def misprints() -> list[Misprint]:
    """Eq. 4 prints λ₁⁴ for λ₁⁻⁴."""
    as_printed = float(np.imag(_energy_of_eq_4(np.array([1.0 + _STEP * 1j])))[0] / _STEP)
    mended = float(np.imag(Gent(100.0).energy(np.array([1.0 + _STEP * 1j])))[0] / _STEP)
    at_two = [
        float(np.imag(function(np.array([2.0 + _STEP * 1j])))[0] / _STEP)
        for function in (_energy_of_eq_4, Gent(100.0).energy)
    ]
    force = float(_printed_force(np.array([2.0]))[0])
    return [
        Misprint(
            "Eq. 4",
            "log(1 − (2λ₁² + λ₁⁴ − 3)/J_lim)",
            "λ₁⁻⁴, as in Eq. 1",
            f"as printed, the unstretched balloon would carry a force f(1) = {as_printed:.3g}, not {abs(mended):.0f}; and "
            f"at λ = 2 its derivative is {at_two[0]:.4f}, while the f of Eqs. 3 and 5 is {force:.4f} "
            f"(λ₁⁻⁴ gives {at_two[1]:.4f})",
            abs(as_printed) > 1.0 and abs(mended) < 1e-12 and abs(at_two[1] - force) < 1e-12,
        )
    ]


def _residuals(case: Case) -> list[float]:
    """Largest relative residuals of Eqs. 5, 6 and 8 along a case's path."""
    device, curve = Device.from_scenario(case.scenario), case.curve
    m = float(device.radius[0])
    (x, y), p, phi = curve.stretch.T, curve.pressure, curve.voltage[:, 0]
    gas = (p + device.ambient) * (m**3 * x**3 + y**3)
    balances = []
    loads = (m * p * x**2 + 2.0 * phi**2 * x**3, p * y**2)
    for elastomer, stretch, load in zip(device.elastomers, (x, y), loads, strict=True):
        # Multiplied by the denominator J − I of f, over J: it vanishes at the stretch limit, as do f's digits. f's own terms there are 2λ and 2λ⁻⁵.
        n, d = elastomer.pole_form(stretch)
        balances.append(
            float(np.max(np.abs(n - load + (1.0 - d) * load) / (2.0 * stretch + load + (1.0 - d) * load)))
        )
    return [
        *balances,
        float(np.max(np.abs(gas / gas[0] - 1.0))),
    ]


def _printed_force(stretch: np.ndarray) -> np.ndarray:
    return np.asarray(200.0 * (stretch - stretch**-5) / (100.0 - (2.0 * stretch**2 + stretch**-4 - 3.0)))


def _energy_of_eq_4(stretch: np.ndarray) -> np.ndarray:
    return np.asarray(-50.0 * np.log(1.0 - (2.0 * stretch**2 + stretch**4 - 3.0) / 100.0))


def _power(error: float) -> str:
    """An upper bound of an error: the next power of ten, at least the accuracy of rounding."""
    return f"1e{max(int(np.ceil(np.log10(error))) if error > 0.0 else -15, -12)}"
