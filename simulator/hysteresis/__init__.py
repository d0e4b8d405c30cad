"""Hysteresis as an object: stable states with what leads from one to another, and unloading from peaks."""
