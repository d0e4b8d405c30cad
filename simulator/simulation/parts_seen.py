"""What a history shows of the parts that balloons have besides their walls: all states at once, in arrays.

What a voltage does the device knows by itself, from the voltage of the film.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from simulator.model.device import Device
    from simulator.solver.passage import Material

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class PartsSeen:
    """Parts in n states.

    Attributes
    ----------
    energy : (n,) array or 0
        Stored in them.
    stiffening : (n, n_balloons) array or None
        What they add to the diagonal of the Hessian of Π, r²h ∂S/∂λ.
    roundness : (n, n_balloons) array or 0
        What they add to the margin of sphericity.
    columns : mapping of str to (n,) array
        Inner stretches, by the balloon and the number of the branch.
    """

    energy: FloatArray | float = 0.0
    stiffening: FloatArray | None = None
    roundness: FloatArray | float = 0.0
    columns: Mapping[str, FloatArray] = field(default_factory=dict)

    @classmethod
    def of(cls, material: Material, device: Device, stretch: FloatArray, own: FloatArray) -> PartsSeen:
        """The parts of a device in n states: stretches (n, n_balloons) and own unknowns (n, n_own)."""
        stiffer, rounder, energy = np.zeros_like(stretch), np.zeros_like(stretch), np.zeros(len(stretch))
        columns: dict[str, FloatArray] = {}
        for slot in (slot for slot in material.slots if not slot.part.electrical):
            i, x, mine = slot.balloon, stretch[:, slot.balloon], own[:, slot.own]
            stiffer[:, i] += device.radius[i] ** 2 * device.thickness[i] * slot.part.stiffness(x, mine.T)
            rounder[:, i] += slot.part.sphericity(x, mine.T)
            energy += slot.part.energy(x, mine.T)
            for ends, values in slot.part.columns(mine).items():
                columns["_".join(filter(None, (device.names[i], f"{slot.number + 1}", ends)))] = values
        return cls(energy, stiffer, rounder, columns)
