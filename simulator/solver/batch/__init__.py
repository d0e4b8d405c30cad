"""Many sets of equations of one form at once, their numbers arrays: path, events and flows in lockstep.

States are arrays (n_unknowns, …, n_runs). It shares the equations, the conditions and what counts as an
event with the rest of `solver`; how it steps is its own. What it is not certain of it gives up, run by run.
"""
