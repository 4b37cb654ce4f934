"""Environments that users may have: each extra alone, the lowest versions, and other Pythons.

``python .ci/environments.py UV`` makes each in a temporary folder with ``uv``, installs a wheel of the checkout there,
and runs what the documentation says about it. A new extra in ``pyproject.toml`` needs a line in ``EXTRAS``.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
SMOKE = ("rnc-pin run space-robot --set simulation.duration=0.5", "PAGE README.md")
"""Commands that hold in every environment; PAGE runs the Python blocks of a page."""
BARE = (
    *SMOKE,
    "PAGE docs/sweeps.md",
    "PAGE docs/logs.md",
    "rnc-pin inspect space-robot",
    "rnc-pin replay runs/space-robot --html again.html",
    "rnc-pin sweep space-robot --runs 4 --jobs 2 --out s --set simulation.duration=0.2",
)
EXTRAS = {
    "control": ("PAGE docs/answers.md",),
    "dask": ("PAGE docs/sweeps.md",),
    "meshes": (
        """python -c 'import trimesh, rnc_pin as rnc; trimesh.creation.box().export("x.glb"); """
        """rnc.collision.load_mesh_shape("x.glb")'""",
    ),
    "mujoco": ("PAGE docs/mujoco.md", "rnc-pin run space-robot --set plant=mujoco --set simulation.duration=0.5"),
    "ompl": ("PAGE docs/ways.md",),
    "robots": ("python -c 'import rtbdata'",),
    "video": ("rnc-pin run space-robot --set simulation.duration=0.2", "rnc-pin replay runs/space-robot --video v.gif"),
    "all": ("python -c 'import control, dask, mujoco, ompl, trimesh'",),
    "dev": ("ruff --version", "mypy --version", "lint-imports --help"),
}
"""Commands that the documentation of an extra promises. ``.ci/run`` itself runs those of ``test`` and ``docs``."""
ELSEWHERE = {"test", "docs"}
MISSING = {
    "control": (
        """python -c 'import rnc_pin as rnc; robot = rnc.Robot.from_urdf("space_robot.urdf", gravity=(0, 0, 0)); """
        """rnc.linearize(rnc.NonholonomicSystem(robot).reduce(), robot.configuration()).to_control()'"""
    ),
    "dask": "rnc-pin sweep space-robot --runs 2 --out s --scheduler tcp://127.0.0.1:1",
    "meshes": """touch x.ply && python -c 'import rnc_pin as rnc; rnc.collision.load_mesh_shape("x.ply")'""",
    "mujoco": "rnc-pin run space-robot --set plant=mujoco",
    "ompl": (
        """python -c 'import rnc_pin as rnc; robot = rnc.Robot.from_urdf("unicycle.urdf", base="planar"); """
        """system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]); start = robot.configuration(); """
        """rnc.planning.find_way(system.reduce(), start, robot.configuration({"root_joint": [1, 0, 0]}), [])'"""
    ),
    "video": "rnc-pin replay runs/space-robot --video v.gif",
}
"""Commands that name the extra in their last line where it is not installed."""
PYTHONS = ("3.12", "3.13", "3.14")
PAGE = """
import pathlib, re, sys
text, names = pathlib.Path(sys.argv[1]).read_text(), {"__name__": "__main__"}
for block in re.finditer(r"^```python\\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE):
    lines = text.count("\\n", 0, block.start(1))
    exec(compile("\\n" * lines + block[1], sys.argv[1], "exec"), names)
"""


class Environment:
    """Virtual environment with the checkout, and an empty folder in which commands run."""

    def __init__(
        self, uv: str, wheel: Path, folder: Path, extra: str = "", python: str = sys.executable, *options: str
    ) -> None:
        self.bin, self.folder = folder / "env" / "bin", folder / "work"
        self.folder.mkdir(parents=True)
        call([uv, "venv", "-q", "-p", python, folder / "env"])
        what = f"{wheel}[{extra}]" if extra else str(wheel)
        call([uv, "pip", "install", "-q", "-p", self.bin / "python", *options, what])

    def run(self, command: str, fails: bool = False) -> str:
        """Run a command and return what it prints."""
        if command.startswith("PAGE "):
            command = f'python -c "$PAGE" {ROOT / command.removeprefix("PAGE ")}'
        found = os.environ | {"PATH": f"{self.bin}:{os.environ['PATH']}", "PAGE": PAGE}
        done = subprocess.run(
            command, shell=True, cwd=self.folder, env=found, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        if (done.returncode != 0) != fails:
            raise SystemExit(f"{done.stdout}\n{self.bin.parent}: status {done.returncode} of: {command}")
        return done.stdout


def call(command: list[str | Path]) -> None:
    """Run a command that has to succeed, and show what it prints only if it does not."""
    done = subprocess.run(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    if done.returncode:
        raise SystemExit(f"{done.stdout}\nstatus {done.returncode} of: {' '.join(map(str, command))}")


def python_of(version: str) -> str | None:
    """Interpreter of a version on this machine; None if there is none."""
    others = Path.home().glob(f".pyenv/versions/{version}*/bin/python{version}")
    candidates = [shutil.which(f"python{version}"), *others]
    for each in filter(None, candidates):
        try:
            said = subprocess.run([each, "--version"], capture_output=True, text=True)
        except OSError:
            continue
        if said.returncode == 0 and f" {version}." in said.stdout:
            return str(each)
    return None


def without_extras(environment: Environment) -> None:
    """The bare installation works, and names the extra that a command needs, in one line."""
    for command in BARE:
        environment.run(command)
    for extra, command in MISSING.items():
        last = environment.run(command, fails=True).strip().splitlines()[-1]
        if f"'.[{extra}]'" not in last:
            raise SystemExit(f"{command}: does not name the extra {extra}: {last}")


def main(uv: str) -> None:
    """Make all environments, and run in each what is promised."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    if unknown := set(extras) - set(EXTRAS) - ELSEWHERE:
        raise SystemExit(f"{__file__}: what do the extras {sorted(unknown)} promise?")
    with tempfile.TemporaryDirectory() as scratch:
        start = time.monotonic()

        def done(what: str) -> None:
            nonlocal start
            print(f"{what}: {time.monotonic() - start:.0f} s", flush=True)
            start = time.monotonic()

        call([uv, "build", "-q", "--wheel", "-o", Path(scratch) / "wheel", ROOT])
        (wheel,) = Path(scratch, "wheel").glob("*.whl")
        without_extras(Environment(uv, wheel, Path(scratch) / "bare"))
        done("without extras")
        for extra in sorted(EXTRAS):
            environment = Environment(uv, wheel, Path(scratch) / extra, extra)
            for command in EXTRAS[extra]:
                environment.run(command)
            done(f"extra {extra} alone")
        lowest = Environment(uv, wheel, Path(scratch) / "lowest", "", sys.executable, "--resolution", "lowest-direct")
        for command in BARE:
            lowest.run(command)
        done("lowest versions")
        for version in PYTHONS:
            python = python_of(version)
            if python is None:
                print(f"Python {version}: not on this machine", flush=True)
                continue
            other = Environment(uv, wheel, Path(scratch) / version, "", python)
            for command in SMOKE:
                other.run(command)
            done(f"Python {version}")


if __name__ == "__main__":
    main(sys.argv[1])
