"""Whole equilibrium paths, limit points in a second number, and sensitivities."""
