"""A history as a moving picture: the balloons to scale, beside the voltage in time and the loop."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from PIL import Image

from simulator.results.files import OutputError, check_writable, write_files
from simulator.results.plot.axes import shown_history
from simulator.results.plot.in_time import plot_pressure, plot_voltage
from simulator.results.plot.loop import plot_loop
from simulator.results.plot.style import BLACK, COLOURS

if TYPE_CHECKING:
    from os import PathLike

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from simulator.results.history import History

_GAS = "#dbe9f4"
_DOTS = 80  # an inch
_SHADES = 64  # of a GIF
_MOST_PAUSES = 20  # snaps; where there are more, none has a pause


def frames(history: History, count: int, pause: int) -> list[int]:
    """The sample of each frame of a playback: even in time, with a pause on both sides of every snap.

    Snaps take no time; without pauses nobody would see them.

    Parameters
    ----------
    history : History
    count : int
        Frames without pauses.
    pause : int
        Frames of the state before, and of the state after, each snap.
    """
    if not len(history):
        return [0]
    times = np.linspace(history.time[0], history.time[-1], count)
    places = np.clip(np.searchsorted(history.time, times, side="right") - 1, 0, None)
    snaps = np.flatnonzero(np.diff(history.branch)) + 1
    if snaps.size > _MOST_PAUSES:
        snaps = snaps[:0]
    pauses = [place for snap in snaps for place in [snap - 1] * pause + [snap] * pause]
    return sorted(int(place) for place in [*places, *pauses])


def animation(
    history: History,
    kind: str,
    *,
    seconds: float = 8.0,
    rate: int = 20,
    width: float = 8.0,
    progress: Callable[[float], None] | None = None,
) -> bytes:
    """A history as a moving picture.

    Parameters
    ----------
    history : History
    kind : str
        "gif" or "mp4".
    seconds : float
        How long it takes, without the pauses at snaps, of half a second before and after each.
    rate : int
        Frames in a second.
    width : float
        Of the picture, in inches of 80 dots.
    progress : callable, optional
        Called with the fraction of frames drawn.

    Returns
    -------
    bytes
        The content of a file.

    Raises
    ------
    OutputError
        If it is of another kind, the history has no samples, or there is no ffmpeg for an MP4.
    """
    if kind not in ("gif", "mp4"):
        raise OutputError(f"an animation is a .gif or a .mp4, not a .{kind}")
    if not len(history):
        raise OutputError("a history without samples cannot be animated")
    shown = frames(history, max(round(seconds * rate), 2), rate // 2)
    pictures = _pictures(history, shown, width, progress)
    return _gif(pictures, rate) if kind == "gif" else _mp4(pictures, rate)


def write_animation(
    history: History,
    path: str | PathLike[str],
    *,
    progress: Callable[[float], None] | None = None,
    **options: Any,
) -> Path:
    """Write a history as a moving picture; `options` as for `animation`, which also says what is raised."""
    target = Path(path)
    check_writable(target.parent, (target.name,))
    content = animation(history, target.suffix[1:], progress=progress, **options)
    (written,) = write_files(target.parent, {target.name: content})
    return written


def _gif(pictures: Iterator[NDArray[np.uint8]], rate: int) -> bytes:
    images = [Image.fromarray(picture).convert("RGB") for picture in pictures]
    palette = images[len(images) // 2].quantize(_SHADES)
    first, *others = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    stream = BytesIO()
    # Delays of a GIF are whole hundredths of a second.
    delay = 10 * max(round(100 / rate), 2)
    first.save(
        stream, "GIF", save_all=True, append_images=others, duration=delay, loop=0, optimize=True, disposal=1
    )
    return stream.getvalue()


def _mp4(pictures: Iterator[NDArray[np.uint8]], rate: int) -> bytes:
    program = shutil.which("ffmpeg")
    if program is None:
        raise OutputError("an MP4 needs ffmpeg, which is not on this machine; a .gif needs nothing more")
    all_of_them = list(pictures)
    height, width, _ = all_of_them[0].shape
    command = [
        program, "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgba", "-s", f"{width}x{height}",
        "-r", str(rate), "-i", "-", "-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2", "-pix_fmt", "yuv420p",
        "-movflags", "frag_keyframe+empty_moov", "-f", "mp4", "-",
    ]  # fmt: skip
    done = subprocess.run(command, input=b"".join(p.tobytes() for p in all_of_them), capture_output=True)
    if done.returncode:
        raise OutputError(f"ffmpeg failed: {done.stderr.decode(errors='replace').strip()}")
    return done.stdout


def _pictures(
    history: History, samples: list[int], width: float, progress: Callable[[float], None] | None
) -> Iterator[NDArray[np.uint8]]:
    """One picture for each frame; what does not move is drawn once."""
    figure = Figure(figsize=(width, 0.5 * width), dpi=_DOTS, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, height_ratios=[1.6, 1.0])
    balloons, drive = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0])
    loop = figure.add_subplot(grid[:, 1])
    figure.suptitle(fill(history.scenario.title, 80), parse_math=False, fontsize=11, fontweight="bold")
    (plot_voltage if history.electroded else plot_pressure)(history, drive)
    plot_loop(history, loop)
    move, moving = _moving(history, balloons, drive, loop)
    canvas.draw()  # type: ignore[no-untyped-call]
    figure.set_layout_engine("none")
    background = canvas.copy_from_bbox(figure.bbox)  # type: ignore[no-untyped-call]
    for number, sample in enumerate(samples, start=1):
        canvas.restore_region(background)  # type: ignore[no-untyped-call]
        move(sample)
        for artist in moving:
            figure.draw_artist(artist)
        yield np.array(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        if progress:
            progress(number / len(samples))


def _moving(
    history: History, balloons: Axes, drive: Axes, loop: Axes
) -> tuple[Callable[[int], None], list[Artist]]:
    """What moves, and the function that moves it to a sample."""
    shown, _ = shown_history(history)
    radii = history.stretch * [balloon.radius for balloon in history.scenario.balloons]
    largest = radii.max(axis=0)
    gap = 0.3 * float(largest.max())
    centres = np.cumsum(2 * largest + gap) - largest - gap
    balloons.plot(centres, 0 * centres, color=_GAS, linewidth=6, zorder=0)
    circles = []
    for i, (x, name) in enumerate(zip(centres, history.balloons, strict=True)):
        thick = 3.0 if name in history.electroded else 1.2
        colour = COLOURS[i % len(COLOURS)]
        circles.append(Circle((x, 0), 1.0, facecolor=_GAS, edgecolor=colour, linewidth=thick, animated=True))
        balloons.add_patch(circles[-1])
        balloons.text(x, -1.3 * largest.max(), name, ha="center", va="center", parse_math=False)
    balloons.set_xlim(-0.03 * largest.sum(), centres[-1] + 1.05 * largest[-1])
    balloons.set_ylim(-1.45 * largest.max(), 1.1 * largest.max())
    balloons.set_aspect("equal")
    balloons.set_axis_off()
    first = history.balloons.index(history.electroded[0]) if history.electroded else 0
    driven = shown.voltage[:, 0] if history.electroded else shown.pressure
    style: dict[str, Any] = {"color": COLOURS[first % len(COLOURS)], "markeredgecolor": BLACK}
    (now,) = drive.plot([], [], "o", markersize=7, animated=True, **style)
    (here,) = loop.plot([], [], "o", markersize=9, animated=True, zorder=9, **style)

    def move(sample: int) -> None:
        for circle, radius in zip(circles, radii[sample], strict=True):
            circle.set_radius(radius)
        now.set_data([shown.time[sample]], [driven[sample]])
        here.set_data([driven[sample]], [shown.stretch[sample, first]])

    return move, [*circles, now, here]
