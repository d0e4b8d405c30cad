"""The command `balloons`."""

from simulator.cli.app import app

__all__ = ["app"]
