"""A film with three viscoelastic branches in real time, beside SciPy's Radau at the same error: `make bench`.

Ten triangles of voltage on a balloon of VHB 4910 at a constant pressure, quick enough that it does not snap.
Both errors are the largest of the stretch at twenty times of each cycle, against Radau at 1e-12.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import Radau

from simulator import load_scenario, simulate
from simulator.model.elastomers import as_written
from simulator.scenario import Preset

FloatArray = NDArray[np.float64]

TAU, PRESSURE, HIGHEST, PERIOD, CYCLES = 1e-3, 0.4, 0.2, 20.0, 10
POINTS = 11  # of each rise and fall
FILM = {"preset": "VHB-4910"}
SCENARIO = load_scenario(
    {
        "title": "ten triangles",
        "gas": {"ambient_pressure": 1.0},
        "balloon": [{"name": "film", "electrodes": True, "elastomer": FILM, "maxwell": FILM}],
        "dynamics": {"relaxation_time": TAU},
        "step": [
            {"inflate": PRESSURE, "over": 10.0},
            {
                "triangle": {"low": 0.0, "high": HIGHEST, "period": PERIOD, "cycles": CYCLES},
                "valve": "open",
            },
        ],
        "output": {"every": 0.5 * PERIOD / (POINTS - 1)},
        "shape": {"on_loss": "ignore"},
    }
)
BRANCHES = np.array([[b.modulus, b.time] for b in SCENARIO.balloons[0].branches]).T


def by_radau(rtol: float) -> FloatArray:
    """The stretch at all samples, by what a user would write: corners are stopped at."""
    elastomer = SCENARIO.balloons[0].elastomer
    assert isinstance(elastomer, Preset)
    wall, (k, t) = as_written(elastomer), BRANCHES

    def rates(
        time: float, y: FloatArray, pressure: float, swell: float, low: float, rise: float
    ) -> FloatArray:
        x, a, b = y[0], y[1:4], y[4:]
        numerator, denominator = wall.pole_form(float(x))
        phi = low + rise * time
        force = numerator / denominator - (pressure + swell * time) * x * x - 2.0 * phi * phi * x**3
        force += 2.0 * float(k @ (a * x - b * x**-5))
        return np.array([-force / TAU, *((x**-2 - a) / t), *((x**4 - b) / t)])

    state = np.ones(7)
    found: list[float] = []
    marks = np.linspace(0.0, PERIOD / 2.0, POINTS)[1:]
    half, speed = PERIOD / 2.0, 2.0 * HIGHEST / PERIOD
    legs = [(10.0, (0.0, PRESSURE / 10.0, 0.0, 0.0))]
    legs += [(half, (PRESSURE, 0.0, *side)) for side in ((0.0, speed), (HIGHEST, -speed))] * CYCLES
    for number, (lasts, drive) in enumerate(legs):
        solver = Radau(lambda s, y, d=drive: rates(s, y, *d), 0.0, state, lasts, rtol=rtol, atol=0.01 * rtol)
        while solver.status == "running":
            solver.step()
            if number:
                here = marks[(marks > solver.t_old) & (marks <= solver.t)]
                found += solver.dense_output()(here)[0].tolist() if here.size else []
        state = solver.y
    return np.array(found)


def by_simulator() -> FloatArray:
    history = simulate(SCENARIO)
    return np.asarray(history.stretch[history.step == 2, 0])


def test_a_film_in_real_time_beside_radau_at_equal_error() -> None:
    """Prints both times, medians of three in one run, and what they are to each other.

    Radau is of order five and starts again at each corner with few steps; IDA has to climb from order one.
    """
    exact = by_radau(1e-12)
    error = float(np.max(np.abs(by_simulator() - exact)))
    rtol = next(10.0**-n for n in range(5, 12) if float(np.max(np.abs(by_radau(10.0**-n) - exact))) <= error)
    times: dict[str, list[float]] = {"simulator": [], "radau": []}
    for _ in range(3):
        for name in times:
            begun = time.perf_counter()
            by_simulator() if name == "simulator" else by_radau(rtol)
            times[name].append(time.perf_counter() - begun)
    mine, theirs = (float(np.median(found)) for found in times.values())
    print(f"error {error:.1e}: {mine:.2f} s, Radau at rtol {rtol:.0e} {theirs:.2f} s, {mine / theirs:.2f}")
    assert error < 1e-9
