"""The scenarios of the stress cases, in one line each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

Written = dict[str, Any]

SNAP_PRESSURE = 1.2536545513298676  # of a Gent balloon with J_lim = 100, nearest double to the 40-digit value


def pair(
    inflate: float | Sequence[float],
    *steps: Mapping[str, Any],
    ambient: float = 1.0,
    J_lim: float = 100.0,
    active: Mapping[str, Any] | None = None,
    passive: Mapping[str, Any] | None = None,
    **sections: Any,
) -> Written:
    """An electroded balloon and a passive one, inflated through the given pressures, then driven."""
    gent = {"model": "gent", "J_lim": J_lim}
    return device(
        [
            {"name": "active", "electrodes": True, "elastomer": gent, **(active or {})},
            {"name": "passive", "elastomer": gent, **(passive or {})},
        ],
        [*({"inflate": p} for p in ([inflate] if isinstance(inflate, float) else inflate)), *steps],
        ambient,
        **sections,
    )


def device(
    balloons: Sequence[Mapping[str, Any]], steps: Sequence[Mapping[str, Any]], ambient: float, **sections: Any
) -> Written:
    """Any balloons on one gas; Gent with J_lim = 100 unless they say otherwise."""
    gent = {"elastomer": {"model": "gent", "J_lim": 100.0}}
    return {
        "title": "stress",
        "gas": {"ambient_pressure": ambient},
        "balloon": [{**gent, **balloon} for balloon in balloons],
        "step": list(steps),
        **sections,
    }


def ramps(*voltages: float) -> list[Written]:
    """Ramps from voltage to voltage."""
    return [{"ramp": voltage} for voltage in voltages]
