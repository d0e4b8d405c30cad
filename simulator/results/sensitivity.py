"""How a limit point moves with one number of the scenario, as a record."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Sensitivity:
    """The derivative of a limit point's voltage or pressure in one number of the scenario.

    Attributes
    ----------
    time, step
        Of the limit point.
    of : str
        What moves: `voltage_<name>`, or `pressure` for a limit point of inflation.
    value : float
        The voltage or pressure of the limit point.
    key : str
        The number, in the unit it is written in.
    parameter : float
        Its value.
    derivative : float
    """

    time: float
    step: int
    of: str
    value: float
    key: str
    parameter: float
    derivative: float
