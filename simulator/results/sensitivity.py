"""How a limit point, or a loss of sphericity, moves with one number of the scenario, as a record."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Sensitivity:
    """The derivative of an event's voltage or pressure in one number of the scenario.

    Attributes
    ----------
    time, step
        Of the event.
    of : str
        What moves: `voltage_<name>`, or `pressure` for a limit point of inflation.
    value : float
        The voltage or pressure of the event.
    key : str
        The number, in the unit it is written in.
    parameter : float
        Its value.
    derivative : float
    kind : str
        Of the event: "limit_point", "loss_of_sphericity" or "sphericity_regained".
    """

    time: float
    step: int
    of: str
    value: float
    key: str
    parameter: float
    derivative: float
    kind: str = "limit_point"
