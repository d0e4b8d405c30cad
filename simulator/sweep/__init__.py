"""Many runs of one scenario with some numbers varied: on a grid, at sample points, in search of the best.

`read_sweep` reads what is varied, `run_sweep` plays all runs on the cores of this machine or on any
executor, `load_sweep` gives the results as arrays or a table. `optimize` looks for the run that makes one
column largest or smallest. See `docs/sweep.md`.
"""

from simulator.results.extras import MissingExtra
from simulator.sweep.loading import load_sweep, load_table
from simulator.sweep.lockstep.chunk import DisagreementError
from simulator.sweep.lockstep.many import ManyRuns, simulate_many
from simulator.sweep.optimum import Optimum, Question, optimize, read_question
from simulator.sweep.plan import Sweep
from simulator.sweep.quantiles import Uncertainty, uncertainty
from simulator.sweep.reading import read_sweep
from simulator.sweep.running import ExecutorError, SweepResult, run_sweep

__all__ = [
    "DisagreementError",
    "ExecutorError",
    "ManyRuns",
    "MissingExtra",
    "Optimum",
    "Question",
    "Sweep",
    "SweepResult",
    "Uncertainty",
    "load_sweep",
    "load_table",
    "optimize",
    "read_question",
    "read_sweep",
    "run_sweep",
    "simulate_many",
    "uncertainty",
]
