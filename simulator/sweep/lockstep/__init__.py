"""Runs of a sweep played in lockstep: all at once on the same equations, their numbers arrays.

What it covers and is certain of, it plays; everything else goes to `simulate`, run by run.
"""
