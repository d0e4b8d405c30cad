"""Fig. 4: the snap of Fig. 3c, state B."""

from __future__ import annotations

import numpy as np

from simulator.model.device import Device
from simulator.model.elastomers import tension_force
from tests.studies.paper.case import Case, Statement, falls
from tests.studies.paper.real import rising, snapping, whole

_STEP = 1e-30
_BELOW = 0.3  # a voltage between the two limit points


def statements(cases: dict[str, Case]) -> list[Statement]:
    """The critical voltage, the tangent lines, O and O′."""
    case = cases["3c B"]
    snap, curve = case.snaps[0], case.curve
    after, pressure_after = snap.stretch_after, snap.pressure_after
    if after is None or pressure_after is None or case.peak is None:
        raise ArithmeticError("Fig. 4: there is no snap")
    critical = float(snap.voltage[0])
    slopes = _membrane_slope(case, float(snap.stretch_before[0]), critical), _gas_slope(case)
    crossings = int(np.count_nonzero(np.diff(curve.voltage[:, 0] > _BELOW)))
    stretch = np.linspace(1.1, 7.0, 100)
    lowered = falls(
        np.array([_membrane_pressure(case, stretch, v).max() for v in np.linspace(0.0, critical, 20)])
    )
    stability = float(curve.stability[case.rising - 1])
    landed = case.history.branch == case.history.branch[case.history.time > snap.time][0]
    rests = float(case.history.stability[landed][0])
    before = snap.stretch_before
    upwards, there, everywhere = (of({"": case}) for of in (rising, snapping, whole))
    return [
        Statement(
            "Fig. 4a",
            "the critical voltage is 0.36",
            f"{critical:.8f}",
            round(critical, 2) == 0.36,
            real=upwards,
        ),
        Statement(
            "Fig. 4a",
            "as the voltage ramps up the balloon expands, the pressure drops, and its pressure–stretch curve lowers",
            f"λ₁ from {curve.stretch[0, 0]:.4f} to {before[0]:.4f}, p from {curve.pressure[0]:.4f} to "
            f"{snap.pressure_before:.4f}; the membrane's curve is lower at each of 20 voltages",
            lowered and falls(curve.pressure[: case.rising]),
            real=upwards,
        ),
        Statement(
            "Fig. 4a",
            "the gas's line intersects the membrane's curve in different equilibrium states",
            f"{crossings} at φ = {_BELOW}",
            crossings > 1,
            real=everywhere,
        ),
        Statement(
            "Fig. 4a",
            "at the critical voltage the two lines are tangent",
            f"slopes dp/dλ₁ at O: {slopes[0]:.8f} (membrane), {slopes[1]:.8f} (gas)",
            abs(slopes[0] - slopes[1]) < 1e-7,
            real=upwards,
        ),
        Statement(
            "Fig. 4a",
            "O and O′ are two stable states",
            f"O = ({before[0]:.8f}, {before[1]:.8f}, p = {snap.pressure_before:.8f}), "
            f"O′ = ({after[0]:.8f}, {after[1]:.8f}, p = {pressure_after:.8f}); smallest eigenvalue of the Hessian "
            f"{abs(round(stability, 9)):g} and {rests:.3f}",
            stability > 1e-6 and rests > 1e-6,
            "O, where the lines touch, is the last of the stable states, and itself neither stable nor unstable",
            abs(stability) < 1e-6 < rests and bool((curve.stability[: case.rising - 1] > 0.0).all()),
            there,
        ),
        Statement(
            "Fig. 4b",
            "the active balloon snaps from O to O′ and expands suddenly",
            f"λ₁ from {before[0]:.8f} to {after[0]:.8f} at φ = {critical:.8f}",
            bool(after[0] > 2.0 * before[0]),
            real=there,
        ),
        Statement(
            "Fig. 4c",
            "the passive balloon deflates rapidly, a deep pressure drop",
            f"λ₂ from {before[1]:.8f} to {after[1]:.8f}, p from {snap.pressure_before:.8f} to {pressure_after:.8f}",
            bool(after[1] < before[1] and pressure_after < 0.1 * snap.pressure_before),
            real=there,
        ),
    ]


def _membrane_pressure(case: Case, stretch: np.ndarray, voltage: float) -> np.ndarray:
    """(f − 2φ²λ³)/(mλ²), Eq. 5."""
    device = Device.from_scenario(case.scenario)
    force = tension_force(device.elastomers[0], stretch)
    return np.asarray((force - 2.0 * voltage**2 * stretch**3) / (device.radius[0] * stretch**2))


def _membrane_slope(case: Case, stretch: float, voltage: float) -> float:
    at = np.array([stretch + _STEP * 1j])
    return float(_membrane_pressure(case, at, voltage)[0].imag / _STEP)


def _gas_slope(case: Case) -> float:
    """dp/dλ₁ at the limit point of the gas with the passive balloon, Eqs. 6 and 8, over the stretch λ₂."""
    device, peak = Device.from_scenario(case.scenario), case.peak
    if peak is None:
        raise ArithmeticError("there is no limit point")
    active, passive = peak.stretch + 0j
    passive = passive + _STEP * 1j
    pressure = tension_force(device.elastomers[1], passive) / passive**2
    m = float(device.radius[0])
    amount = (peak.pressure + device.ambient) * (m**3 * active.real**3 + passive.real**3)
    cube = (amount / (pressure + device.ambient) - passive**3) / m**3
    return float(pressure.imag / (cube ** (1.0 / 3.0)).imag)
