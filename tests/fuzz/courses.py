"""Random courses: the steps that a device is led through."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.chances import Rng, chance, log_uniform, rounded, table_file
from tests.fuzz.devices import part, voltage_unit

Document = dict[str, Any]

LEAST_PRESSURE = 1e-4  # below it the stretch is 1 + p/12 and has few digits left
SNAP_PRESSURE = 1.2536545513298676  # of a Gent balloon with J = 100, r = h = k = 1


class Course:
    """Draws the steps of one device."""

    def __init__(
        self, rng: Rng, balloons: list[Document], gas: Document, pace: float, dynamic: bool, folder: Path
    ) -> None:
        self.rng, self.pace, self.dynamic, self.folder = rng, pace, dynamic, folder
        self.names = [b["name"] for b in balloons]
        self.films = [b for b in balloons if b.get("electrodes")]
        self.liquid = gas.get("law") == "liquid"
        self.loads = [part(b, "modulus") * part(b, "thickness") / part(b, "radius") for b in balloons]
        self.units = {b["name"]: voltage_unit(b) for b in self.films}
        # Until the first voltages are given a charge needs none, and the first of all steps may be one.
        self.unit = min(self.units.values(), default=1.0)

    def steps(self) -> list[Document]:
        rng = self.rng
        steps = [{"inflate": p, **self.over()} for p in self.pressures()]
        if self.films and chance(rng, 0.05):  # voltage before the inflation
            steps.insert(0, {"ramp": self.voltages(0.4), **self.over(), "valve": "open"})
        for _ in range(int(rng.integers(1, 6))):
            steps.append(self.step())
            if chance(rng, 0.08):
                steps.append({"inflate": self.pressure(), **self.over()})
        if len(steps) > 2 and chance(rng, 0.1):
            first = int(rng.integers(1, len(steps) - 1))
            steps[first:] = [{"cycle": int(rng.integers(1, 4)), "steps": steps[first : first + 3]}]
        return steps

    def time(self, low: float = 0.1, high: float = 10.0) -> float:
        return rounded(self.rng, self.pace * log_uniform(self.rng, low, high))

    def over(self) -> Document:
        return {"over": self.time()} if chance(self.rng, 0.8) or self.dynamic else {}

    def pressures(self) -> list[float]:
        rng = self.rng
        if chance(rng, 0.03):
            return [0.0] if chance(rng, 0.5) else []
        return [self.pressure() for _ in range(1 + int(rng.integers(0, 6) == 0))]

    def pressure(self) -> float:
        """Around the snap of one of the balloons."""
        rng = self.rng
        load = self.loads[int(rng.integers(len(self.loads)))]
        if chance(rng, 0.15):
            share = 1.0 + float(rng.choice([-1.0, 1.0])) * 10.0 ** rng.uniform(-9.0, -2.0)
        else:
            share = float(rng.uniform(0.02, 1.25))
        value = SNAP_PRESSURE * load * share
        return max(LEAST_PRESSURE, value if chance(rng, 0.15) else rounded(rng, value))

    def step(self) -> Document:
        rng = self.rng
        if not self.films:
            return {"hold": self.time(), **self.valve(0.1)}
        kinds = {
            "ramp": 0.42,
            "jump": 0.1,
            "hold": 0.08,
            "charge": 0.12,
            "sine": 0.1,
            "triangle": 0.1,
            "table": 0.08,
        }
        if self.dynamic:
            kinds["ramp"] += kinds.pop("charge")
        kind = str(rng.choice(list(kinds), p=list(kinds.values())))
        step: Document = getattr(self, f"_{kind}")()
        step.update(self.valve(0.1))
        if kind in ("ramp", "charge", "sine", "triangle", "table") and not self.dynamic and chance(rng, 0.15):
            step["until"] = self.until(step)
        return step

    def valve(self, share: float) -> Document:
        if chance(self.rng, share):
            return {"valve": "open"}
        return {"valve": "closed"} if chance(self.rng, 0.05) else {}

    def voltage(self, unit: float, most: float = 1.0) -> float:
        """Limit points are at 0.1 to 0.7 of a film's unit."""
        rng = self.rng
        if chance(rng, 0.2):
            return 0.0
        if chance(rng, 0.05):
            return rounded(rng, unit * log_uniform(rng, 1.0, 10.0))
        sign = -1.0 if chance(rng, 0.1) else 1.0
        return rounded(rng, sign * unit * float(rng.uniform(0.0, most)))

    def chosen(self) -> list[str]:
        """One or more of the balloons with electrodes."""
        names = list(self.units)
        count = int(self.rng.integers(1, len(names) + 1))
        return [names[i] for i in sorted(self.rng.permutation(len(names))[:count])]

    def voltages(self, most: float = 1.0) -> Any:
        if chance(self.rng, 0.3):
            return {name: self.voltage(self.units[name], most) for name in self.chosen()}
        return self.voltage(self.unit, most)

    def _ramp(self) -> Document:
        return {"ramp": self.voltages(), **self.over()}

    def _jump(self) -> Document:
        return {"jump": self.voltages()}

    def _hold(self) -> Document:
        return {"hold": self.time()}

    def _charge(self) -> Document:
        rng = self.rng
        units = {
            b["name"]: part(b, "radius") ** 2 * np.sqrt(part(b, "modulus") * part(b, "permittivity"))
            for b in self.films
        }

        def charge(unit: float) -> float:
            if chance(rng, 0.15):
                return 0.0
            return rounded(rng, unit * log_uniform(rng, 0.05, 200.0) * (-1.0 if chance(rng, 0.1) else 1.0))

        if chance(rng, 0.4):
            return {"charge": {name: charge(units[name]) for name in self.chosen()}, **self.over()}
        return {"charge": charge(min(units.values())), **self.over()}

    def cycles(self) -> Document:
        rng = self.rng
        cycles = float(rng.integers(1, 4)) if chance(rng, 0.6) else rounded(rng, float(rng.uniform(0.1, 3.5)))
        return {"period": self.time(), "cycles": int(cycles) if cycles.is_integer() else cycles}

    def phase(self) -> Document:
        rng = self.rng
        if chance(rng, 0.3):
            return {}
        exact = float(rng.choice([0.0, 0.25, 0.5, 0.75, 1.0 / 3.0]))
        return {"phase": exact if chance(rng, 0.5) else rounded(rng, float(rng.uniform(-1.0, 1.0)))}

    def _sine(self) -> Document:
        def wave(unit: float) -> Document:
            mean = self.voltage(unit, 0.5)
            return {"mean": mean, "amplitude": rounded(self.rng, float(unit * self.rng.uniform(0.0, 0.6)))}

        if chance(self.rng, 0.4):
            waves = {name: {**wave(self.units[name]), **self.phase()} for name in self.chosen()}
            return {"sine": {**self.cycles(), **waves}}
        return {"sine": {**wave(self.unit), **self.cycles()}}

    def _triangle(self) -> Document:
        def wave(unit: float) -> Document:
            low = 0.0 if chance(self.rng, 0.5) else self.voltage(unit, 0.4)
            return {"low": low, "high": self.voltage(unit, 0.8)}

        if chance(self.rng, 0.4):
            waves = {name: {**wave(self.units[name]), **self.phase()} for name in self.chosen()}
            return {"triangle": {**self.cycles(), **waves}}
        return {"triangle": {**wave(self.unit), **self.cycles()}}

    def _table(self) -> Document:
        rng = self.rng
        rows = int(rng.integers(2, 9))
        lengths = [self.time(1e-3 if chance(rng, 0.1) else 0.1, 3.0) for _ in range(rows - 1)]
        times = np.concatenate([[0.0], np.cumsum(lengths)])
        voltages = [0.0 if chance(rng, 0.5) else self.voltage(self.unit)]
        for _ in range(rows - 1):
            voltages.append(voltages[-1] if chance(rng, 0.2) else self.voltage(self.unit))
        lines = [f"{t!r},{v!r}" for t, v in zip(times.tolist(), voltages, strict=True)]
        return {"table": table_file(self.folder, "\n".join(["time,voltage", *lines]) + "\n")}

    def until(self, step: Document) -> Document:
        rng = self.rng
        out: Document = {}
        kinds = ["event", "stretch", "field", *(["pressure"] if step.get("valve") != "open" else [])]
        for kind in rng.permutation(kinds)[: 1 + int(chance(rng, 0.3))]:
            match str(kind):
                case "event":
                    out["event"] = "limit_point"
                case "stretch":
                    one = rounded(rng, 1.0 + log_uniform(rng, 0.02, 5.0))
                    if len(self.films) == 1 and chance(rng, 0.5):
                        out["stretch"] = one
                    else:
                        out["stretch"] = {self.names[int(rng.integers(len(self.names)))]: one}
                case "field":
                    film = self.films[int(rng.integers(len(self.films)))]
                    unit = np.sqrt(part(film, "modulus") / part(film, "permittivity"))
                    one = rounded(rng, unit * log_uniform(rng, 0.05, 10.0))
                    plain = len(self.films) == 1 and chance(rng, 0.5)
                    out["field"] = one if plain else {film["name"]: one}
                case "pressure":
                    out["pressure"] = self.pressure()
        return out
