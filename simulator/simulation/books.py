"""The energy books of a run: what supplies delivered, what is stored, and what was lost."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from simulator.model.device import Device
from simulator.model.equations import Equations, OpenBalloon
from simulator.model.groups import Group
from simulator.results.history import EnergyBalance
from simulator.solver.branch import Branch

FloatArray = NDArray[np.float64]

_WORK = 1e-8  # how well the work along a branch must agree with what is stored, relatively


@dataclass
class Books:
    """Energies so far, in units of 4πR²Hμ; what each one is, `EnergyBalance` says.

    Attributes
    ----------
    electroded : tuple of int
        The balloons with electrodes.
    works : (n_electroded,) array
        ∫φ dq of the source of each; their sum is `electrical_work`.
    dissipated_in : dict of str to float
        What of `dissipated` was lost in which viscoelastic branch, resistance or leak.
    """

    electroded: tuple[int, ...] = ()
    works: FloatArray = field(init=False)
    electrical_work: float = 0.0
    gas_work: float = 0.0
    stored: float = 0.0
    dissipated: float = 0.0
    dissipated_in: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Nothing has been done yet."""
        self.works = np.zeros(len(self.electroded))

    def change_voltages(
        self, device: Device, stretch: FloatArray, before: FloatArray, after: FloatArray
    ) -> None:
        """Book a change of the voltages at frozen stretches: all work of the supplies, ∫φ dq, is stored."""
        unit = device.charge(stretch[None], np.ones((1, after.size)))[0]
        self.works += 0.5 * unit * (after**2 - before**2)
        work = 0.5 * float(unit @ (after**2 - before**2))
        self.electrical_work += work
        self.stored += work

    def source_works(self, place: int, work: float) -> None:
        """Book what one source has done, that of a place among the balloons with electrodes."""
        self.works[place] += work
        self.electrical_work += work

    def lose(self, name: str, lost: float) -> None:
        """Book what was lost in one place."""
        self.dissipated += lost
        self.dissipated_in[name] = self.dissipated_in.get(name, 0.0) + lost

    def along_branch(self, group: Group, branch: Branch | None, start: float, end: float) -> None:
        """Book the way of a group along a branch from one v to another: work by quadrature, storage by
        difference.

        Raises
        ------
        ArithmeticError
            If the two do not agree: the one is found along the path and the other at its ends, so a path
            that is wrong shows here.
        """
        if branch is None or start == end:
            return
        equations = branch.equations
        work = branch.work_between(start, end)
        before, after = branch.state_at(start), branch.state_at(end)
        first, last = (float(equations.potential(y.tolist())) for y in (before, after))
        passed = float(np.abs(branch.work).sum()) + 1e-4 * max(abs(first), abs(last))
        if abs(last - first + work) > _WORK * passed + np.finfo(float).tiny:
            raise ArithmeticError(
                f"the work along a branch, {work:.12g}, is not what the potential lost, {first - last:.12g}"
            )
        done = self.change(equations, before, after, work)
        mine = self._places(group)
        if len(mine) > 1:
            self._share(group, before, after, branch.shares_between(start, end))
        else:
            self.works[mine] += done

    def at_once(self, group: Group, before: FloatArray, after: FloatArray, dissipated: float) -> None:
        """Book a snap or the flow after a jump: the drive is frozen, the loss is what the potential lost."""
        self.dissipated += dissipated
        done = self.change(group.equations, before, after, 0.0)
        mine = self._places(group)
        if len(mine) > 1:
            self._share(group, before, after, np.zeros(len(group.members)))
        else:
            self.works[mine] += done

    def _places(self, group: Group) -> list[int]:
        """The places, among the balloons with electrodes, of those of a group."""
        return [place for place, i in enumerate(self.electroded) if i in group.members]

    def _share(self, group: Group, before: FloatArray, after: FloatArray, shares: FloatArray) -> None:
        """Book the work of each of several sources; of each wall, −∂Π/∂v dv adds up to its share."""
        for place, (i, membrane) in enumerate(zip(group.members, group.equations.membranes, strict=True)):
            if i in self.electroded:
                electric = membrane.supplied(after[place], after[-1]) - membrane.supplied(
                    before[place], before[-1]
                )
                self.works[self.electroded.index(i)] += float(electric - shares[place])

    def change(self, equations: Equations, before: FloatArray, after: FloatArray, work: float) -> float:
        """Book a change of a group's state y, along which −∂Π/∂v dv adds up to `work`.

        Returns the work of the electric sources.
        """
        inflates = isinstance(equations, OpenBalloon) and equations.pressure_rate != 0.0
        gas = work if inflates else 0.0
        a, b = before.tolist(), after.tolist()
        electric = equations.electric_supply(b) - equations.electric_supply(a)
        supplied = equations.gas_supply(b) - equations.gas_supply(a)
        # ∫φ dq = [φq] − ∫q dφ, and ∫p dV = [pV] − ∫V dp.
        done = float(electric - (work - gas))
        self.electrical_work += done
        self.gas_work += supplied - gas
        self.stored += float(equations.potential(b)) - float(equations.potential(a)) + electric + supplied
        return done

    def balance(
        self,
        voltage: FloatArray,
        charge: FloatArray,
        pressure: FloatArray,
        volume: FloatArray,
        is_open: NDArray[np.bool_],
    ) -> EnergyBalance:
        """The balance, judged against ∫|φ dq| + ∫|p dV| as far as n samples show it.

        Parameters
        ----------
        voltage, charge : (n, n_electroded) arrays
        pressure, volume : (n,) arrays
        is_open : (n,) array of bool
        """
        electrical = 0.5 * np.abs((voltage[1:] + voltage[:-1]) * np.diff(charge, axis=0)).sum()
        supplied = 0.5 * np.abs((pressure[1:] + pressure[:-1]) * np.diff(volume))[is_open[1:]].sum()
        # Few samples show little of it; what was booked is a bound from below.
        booked = abs(self.electrical_work) + abs(self.gas_work) + self.dissipated
        return EnergyBalance(
            self.electrical_work,
            self.gas_work,
            self.stored,
            self.dissipated,
            self.electrical_work + self.gas_work - self.stored - self.dissipated,
            float(max(electrical + supplied, booked)),
            dict(self.dissipated_in),
        )
