"""The energy balance of a run, and what the run cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class EnergyBalance:
    """The energy balance of a history, in units of 4πR²Hμ; see `docs/physics.md`.

    `electrical_work` is ∫Σφ dq, `gas_work` is ∫p dV of the supply while the valve is open,
    `stored` the change of Π + Σφq, `dissipated` what the jumps lost. `imbalance` is what is left
    over, `exchanged` the work that went to and fro (``∫|·|``), against which it is to be judged.
    `dissipated_in` says what of that each viscoelastic branch lost, by its balloon and number, as "active_1",
    and what the resistance before a film, "active_resistance", and its leak, "active_leak".
    """

    electrical_work: float
    gas_work: float
    stored: float
    dissipated: float
    imbalance: float
    exchanged: float
    dissipated_in: Mapping[str, float] = field(default_factory=dict)

    @property
    def relative_imbalance(self) -> float:
        """The size of `imbalance` over the work exchanged; 0 where nothing was exchanged."""
        return abs(self.imbalance) / self.exchanged if self.exchanged else 0.0


@dataclass(frozen=True)
class SolverStatistics:
    """What the run cost."""

    ida_solves: int
    ida_steps: int
    residual_calls: int
    jacobian_calls: int
    branches: int
    snaps: int
    seconds: float
