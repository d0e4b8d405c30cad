"""A release as it would be published: built, looked at, and tried from the wheel alone. `make release`.

    python -m tests.release [--out dist]

The wheel goes into an empty environment with an empty home folder. There a scenario of the wheel is run,
traced and swept; then the extra `live` is installed, and its page is asked for. Nothing is uploaded.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import time
import urllib.error
import urllib.request
import venv
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parent.parent
PORT = 5317
LONGEST = 60  # s for the page to answer

SWEEP = """scenario = "device.toml"

[vary]
"gas.ambient_pressure" = { from = 0.05, to = 1.0, points = 40 }
"""


def build(out: Path) -> Path:
    """Source distribution and wheel, in an empty folder; the wheel."""
    if out.exists():
        shutil.rmtree(out)
    tools = ("-m", "build", "--outdir", str(out), str(ROOT))
    subprocess.run([sys.executable, *tools], check=True, stdout=subprocess.DEVNULL)
    (wheel,) = out.glob("*.whl")
    return wheel


def look_at(out: Path, wheel: Path) -> None:
    """What PyPI would refuse, and what should not be in a wheel."""
    files = [str(file) for file in sorted(out.iterdir())]
    subprocess.run([sys.executable, "-m", "twine", "check", "--strict", *files], check=True)
    subprocess.run([Path(sys.executable).parent / "check-wheel-contents", str(wheel)], check=True)


class Empty:
    """An environment with nothing but pip, used from an empty folder with an empty home."""

    def __init__(self, folder: Path) -> None:
        self.work, self.home = folder / "work", folder / "home"
        self.work.mkdir()
        self.home.mkdir()
        self.bin = folder / "env" / "bin"
        venv.create(folder / "env", with_pip=True)

    @property
    def variables(self) -> Mapping[str, str]:
        """Those of this process that say where packages come from, and no others."""
        kept = {name: value for name, value in os.environ.items() if name.startswith("PIP_")}
        return {**kept, "HOME": str(self.home), "PATH": f"{self.bin}:/usr/bin:/bin", "LC_ALL": "C.UTF-8"}

    def run(self, *command: str) -> str:
        """Run a command of the environment; what it prints. Raises CalledProcessError."""
        program = [str(self.bin / command[0]), *command[1:]]
        return subprocess.run(
            program, cwd=self.work, env=self.variables, check=True, capture_output=True, text=True
        ).stdout

    def install(self, wheel: str) -> None:
        """Install the wheel with what it requires."""
        self.run("python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wheel)


def try_commands(empty: Empty) -> None:
    """Run, trace and sweep, on a scenario of the wheel."""
    where = "import simulator, pathlib; print(pathlib.Path(simulator.__file__).parent / 'scenarios')"
    shipped = Path(empty.run("python", "-c", where).strip())
    shutil.copy(shipped / "fig5b_state_b.toml", empty.work / "device.toml")
    (empty.work / "sweep.toml").write_text(SWEEP, "utf-8")
    for command in (
        ("run", "device.toml", "--plot"),
        ("trace", "device.toml", "--plot"),
        ("sweep", "sweep.toml"),
    ):
        empty.run("balloons", *command)
        print(f"balloons {' '.join(command)}: done")
    results = empty.work / "results"
    for file in ("device/history.png", "device-trace/curve.png", "sweep-sweep/sweep.csv"):
        assert (results / file).stat().st_size > 1000, file


def try_page(empty: Empty) -> None:
    """Ask for the page of `balloons live`."""
    command = [str(empty.bin / "balloons"), "live", "device.toml", "--no-show", "--port", str(PORT)]
    with subprocess.Popen(command, cwd=empty.work, env=empty.variables) as server:
        try:
            assert "<html" in _page()
        finally:
            server.terminate()
    print("balloons live device.toml: the page answers")


def _page() -> str:
    start = time.monotonic()
    while True:
        try:
            with urllib.request.urlopen(f"http://localhost:{PORT}/", timeout=LONGEST) as answer:
                text: str = answer.read().decode("utf-8")
                return text
        except urllib.error.URLError:
            if time.monotonic() - start > LONGEST:
                raise
            time.sleep(0.5)


def main() -> int:
    """Build, look, try."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, metavar="DIR", default=ROOT / "dist", help="where the files go")
    out = parser.parse_args().out
    wheel = build(out)
    look_at(out, wheel)
    with TemporaryDirectory() as folder:
        empty = Empty(Path(folder))
        empty.install(str(wheel))
        try_commands(empty)
        empty.install(f"{wheel}[live]")
        try_page(empty)
    print(f"ready to publish: {', '.join(file.name for file in sorted(out.iterdir()))} in {out}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
