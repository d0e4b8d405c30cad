"""`python -m simulator` is the command `balloons`."""

from simulator.cli import app

if __name__ == "__main__":
    app(prog_name="balloons")
