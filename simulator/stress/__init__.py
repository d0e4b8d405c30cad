"""Stiff and extreme scenarios, each held against an exact reference or an invariant."""
