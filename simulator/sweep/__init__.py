"""Many runs of one scenario with some of its numbers varied: on a grid or at sample points.

`read_sweep` reads what is varied, `run_sweep` plays all runs on the cores of this machine or on any
executor, `load_sweep` gives the results as arrays or a table. See `docs/sweep.md`.
"""

from simulator.sweep.loading import load_sweep, load_table
from simulator.sweep.lockstep.many import ManyRuns, simulate_many
from simulator.sweep.plan import Sweep
from simulator.sweep.reading import read_sweep
from simulator.sweep.running import ExecutorError, SweepResult, run_sweep

__all__ = [
    "ExecutorError",
    "ManyRuns",
    "Sweep",
    "SweepResult",
    "load_sweep",
    "load_table",
    "read_sweep",
    "run_sweep",
    "simulate_many",
]
