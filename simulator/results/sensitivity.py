"""How a limit point, or a loss of sphericity, moves with one number of the scenario, as a record."""

from __future__ import annotations

from dataclasses import dataclass

from simulator.units import per


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
        The number.
    parameter : float
        Its value, in the unit it is written in.
    derivative : float
    kind : str
        Of the event: "limit_point", "loss_of_sphericity" or "sphericity_regained".
    unit, parameter_unit, derivative_unit : str
        Of a scenario with [scales]: "V" or "Pa"; what the number is written in, or where it has no unit what
        it is a multiple of, such as "R"; and "V/mm". Empty where there is none.
    """

    time: float
    step: int
    of: str
    value: float
    key: str
    parameter: float
    derivative: float
    kind: str = "limit_point"
    unit: str = ""
    parameter_unit: str = ""

    @property
    def derivative_unit(self) -> str:
        return per(self.unit, self.parameter_unit)
