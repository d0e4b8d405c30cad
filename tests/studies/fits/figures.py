"""The figures of the pages on fits, uncertainty and safe landings: `python -m tests.studies.fits.figures`."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from simulator import History, fit, load_scenario, simulate
from simulator.results.plot.bands import plot_bands
from simulator.results.plot.style import COLOURS, GREY, dress, own_style, png
from simulator.sweep.bands import FILM, bands

FIGURES = Path("docs/figures")
ABRUPT = {"step.2.ramp": 0.2, "step.3.hold": 3.0, "step.4.ramp": 0.2}


def landings(abrupt: History, safe: History) -> Figure:
    """Voltage, stretch and margin of a snap that is left to itself, and of one that lands softly."""
    with own_style():
        figure = Figure(figsize=(7.4, 6.6), layout="constrained")
        axes = figure.subplots(3, 1, sharex=True)
        for history, colour, label in ((abrupt, COLOURS[1], "held at 0.2"), (safe, COLOURS[0], "dropped")):
            shown = history.time > 48.0
            columns = (history.voltage[:, 0], history.stretch[:, 0], history.margin[:, 0])
            for ax, column in zip(axes, columns, strict=True):
                ax.plot(history.time[shown], column[shown], color=colour, linewidth=1.8, label=label)
        axes[1].axhline(6.15, color=GREY, linewidth=0.9, linestyle=":")
        for ax, label in zip(axes, ("voltage", "stretch λ", "margin 1 − |E|/E_b"), strict=True):
            ax.set_ylabel(f"{label} of active")
            dress(ax)
        axes[2].axhline(0.0, color=GREY, linewidth=0.9)
        axes[2].set_xlabel("t")
        axes[2].set_xlim(48.0, 90.0)
        axes[0].legend(frameon=False)
    return figure


def main() -> None:
    safe = load_scenario("scenarios/safe_landing.toml")
    drawn = landings(simulate(safe.with_values(ABRUPT)), simulate(safe))
    (FIGURES / "safe_landing.png").write_bytes(png(drawn))
    (FIGURES / "fit.png").write_bytes(png(fit("scenarios/fits/vhb_snap.toml").plot(), 110.0))
    keys = [f"balloon.{name}.{word}" for name in ("active", "passive") for word in FILM]
    found = bands("scenarios/vhb_snap.toml", {k: 0.01 for k in keys if k != "balloon.passive.permittivity"})
    of_loop = (found.step, found.snaps, found.runs, found.voltage, found.stretch)
    (FIGURES / "bands.png").write_bytes(png(plot_bands(simulate("scenarios/vhb_snap.toml"), *of_loop)))


if __name__ == "__main__":
    main()
