"""Random scenarios drawn from the whole grammar of a scenario file; the same number, the same scenario.

Four out of five have the numbers of real devices: balloons of half to twice the reference balloon, loads
around the snap pressure, voltages around and beyond the limit points. The fifth is extreme: radii of 0.05
to 20, ambient pressures up to 300, elastomers that lock at once or never, and steps that last from a
microsecond to days.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz import devices
from tests.fuzz.chances import Rng, chance, log_uniform, rounded
from tests.fuzz.courses import Course
from tests.fuzz.si_units import with_units

Document = dict[str, Any]


def numbered(number: int, folder: Path) -> Document:
    """The scenario of a number; its tables are written into a folder."""
    return scenario(np.random.default_rng([number, 20150101]), folder)


def scenario(rng: Rng, folder: Path) -> Document:
    """A random scenario, valid by the rules of the grammar.

    Parameters
    ----------
    rng : numpy.random.Generator
    folder : Path
        Where the CSV files of tabulated elastomers and voltages go; the scenario has their absolute paths.
    """
    wild = chance(rng, 0.2)
    dynamic = chance(rng, 0.25)
    document: Document = {"title": "drawn from the grammar"}
    scales = devices.scales(rng) if chance(rng, 0.15) else None
    if scales:
        document["scales"] = scales
    document["gas"] = devices.gas(rng, wild)
    document["balloon"] = balloons = devices.balloons(rng, wild, folder)
    pace = rounded(rng, log_uniform(rng, 1e-6, 1e6) if wild else log_uniform(rng, 0.1, 30.0))
    document["step"] = Course(rng, balloons, document["gas"], pace, dynamic, folder).steps()
    if dynamic:
        document["dynamics"] = devices.dynamics(rng, balloons, pace)
        if supply := devices.supply(rng, balloons, pace):
            document["supply"] = supply
    if output := _output(rng, document["step"]):
        document["output"] = output
    if chance(rng, 0.1):
        document["solver"] = {"rtol": float(10.0 ** rng.uniform(-8.0, -2.0))}
    return with_units(rng, document) if scales else document


def _output(rng: Rng, steps: list[Document]) -> Document | None:
    if chance(rng, 0.1):
        return None
    if chance(rng, 0.15) and (longest := max(map(_length, steps))) > 0.0:
        return {"every": rounded(rng, longest / float(rng.uniform(2.0, 30.0)))}
    return {"points": int(rng.integers(2, 31))}


def _length(step: Document) -> float:
    """How long a step lasts; a table is taken as one that takes no time."""
    if "cycle" in step:
        return max(map(_length, step["steps"]))
    if "sine" in step or "triangle" in step:
        wave = step["sine"] if "sine" in step else step["triangle"]
        return float(wave["period"] * wave["cycles"])
    if "jump" in step or "table" in step:
        return 0.0
    return float(step["hold"] if "hold" in step else step.get("over", 1.0))
