"""Time of whole commands.

For ``rnc-pin run`` of each scenario, by default ``space-robot``, ``tiago`` and ``wheels-uncertain``:

* first output: wall time until the command prints its first line;
* pictures: wall time and processor time until all files are written.

``--parts`` prints the processor time of the parts of each run in place of that, in one process: imports, reading and
building of the scenario, simulation with comparisons and verdict, data files, plots, and the animation.

Then the processor time of a cold start: the import, a robot, its system and one ``forward_dynamics``; and of the
imports of NumPy and Pinocchio alone. All modules are compiled to bytecode before, as pip does.
Wall time depends on what else the machine does; the load is printed. Processor time counts all threads and children.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

from rich import box
from rich.console import Console
from rich.table import Table

from benchmarks.timing import processor_time_of_children, used_by_command
from rnc_pin.applications.scenario.files import built_in_names

SCENARIOS = ("space-robot", "tiago", "wheels-uncertain")
LAUNCHES = 5
COLD_START = """
from pathlib import Path
import numpy as np
import rnc_pin as rnc
from rnc_pin.robots.robot_files import find_urdf
robot = rnc.Robot.from_urdf(find_urdf("space_robot.urdf", Path()))
system = rnc.NonholonomicSystem(
    robot, [rnc.MomentumConservation("platform")], actuators=["joint_1", "joint_2", "joint_3"]
)
reduced = system.reduce([rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")])
reduced.forward_dynamics(np.array([0.0, -0.4, 1.8, -1.1]), np.zeros(3), np.zeros(3))
"""


WITHOUT_US = "import numpy, pinocchio"
_ROOF = "rnc_pin.applications"
MODULES = f"import {_ROOF}.command_line.commands.run, {_ROOF}.scenario.plot_files, {_ROOF}.scenario.saved_run"


PARTS = ("imports", "build", "simulate", "write", "plots", "animation")
_PARTS = """
import time
marks = [0.0]
import rnc_pin.applications.command_line.commands.run, rnc_pin.applications.scenario.plot_files
import rnc_pin.applications.scenario.saved_run as animation
from pathlib import Path
from sys import argv
from rnc_pin.applications.scenario.execution import execute, write
from rnc_pin.applications.scenario.pictures import ANIMATION, picture_names
from rnc_pin.applications.scenario.scenario import Scenario
marks.append(time.process_time())
scenario, folder = Scenario.load(argv[1]).build(remedies=True), Path(argv[2])
marks.append(time.process_time())
result = execute(scenario)
marks.append(time.process_time())
write(scenario, result, folder)
marks.append(time.process_time())
for name in picture_names(scenario):
    if name != ANIMATION:
        rnc_pin.applications.scenario.plot_files.write_plot(scenario, result, folder / name)
marks.append(time.process_time())
animation.write_animation(scenario, result, folder / ANIMATION)
marks.append(time.process_time())
print(*(end - start for start, end in zip(marks, marks[1:])))
"""


def parts(scenario: str) -> list[float]:
    """Processor time of the parts of a run [s].

    Raises:
        subprocess.CalledProcessError: the run failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        command = (sys.executable, "-c", _PARTS, scenario, folder)
        done = subprocess.run(command, check=True, text=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    return [float(each) for each in done.stdout.split("\n")[-2].split()]


class RunTime(NamedTuple):
    """Times of one ``rnc-pin run`` [s]."""

    first_output: float
    pictures: float
    processor: float


def run_time(scenario: str) -> RunTime:
    """Run a scenario in a new folder.

    Raises:
        subprocess.CalledProcessError: the run failed.
    """
    before, start = processor_time_of_children(), time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        command = (sys.executable, "-m", "rnc_pin", "run", scenario, "--out", f"{folder}/run")
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
            assert process.stdout is not None
            process.stdout.readline()
            first = time.perf_counter() - start
            process.stdout.read()
        if process.returncode:
            raise subprocess.CalledProcessError(process.returncode, command)
        whole = time.perf_counter() - start
    return RunTime(first, whole, processor_time_of_children() - before)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.commands", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", help=", ".join(built_in_names()))
    parser.add_argument("--parts", action="store_true", help="the parts of each run, by default of all scenarios")
    given = parser.parse_args()
    with compiled_modules():
        if given.parts:
            _measure_parts(given.scenarios or built_in_names())
        else:
            _measure(given.scenarios or SCENARIOS)


@contextmanager
def compiled_modules() -> Iterator[None]:
    """Keep bytecode in a temporary folder, also where the environment switches it off."""
    with tempfile.TemporaryDirectory() as folder:
        before = dict(os.environ)
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        os.environ["PYTHONPYCACHEPREFIX"] = folder
        try:
            for code in (MODULES, COLD_START):
                subprocess.run((sys.executable, "-c", code), check=True)
            yield
        finally:
            os.environ.clear()
            os.environ.update(before)


def _measure_parts(scenarios: Sequence[str]) -> None:
    print("| rnc-pin run | " + " | ".join(PARTS) + " | sum |\n|" + "---|" * (len(PARTS) + 2))
    for scenario in scenarios:
        found = parts(scenario)
        print(f"| {scenario} | " + " | ".join(f"{each:.2f}" for each in (*found, sum(found))) + " |", flush=True)


def _measure(scenarios: Sequence[str]) -> None:
    shown = Table(box=box.SIMPLE_HEAD)
    for heading in ("rnc-pin run", "first output [s]", "pictures [s]", "processor time [s]"):
        shown.add_column(heading, justify="left" if heading == "rnc-pin run" else "right")
    for scenario in scenarios:
        shown.add_row(scenario, *(f"{seconds:.2f}" for seconds in run_time(scenario)))
    console = Console()
    console.print(shown)
    cold = used_by_command((sys.executable, "-c", COLD_START), LAUNCHES)
    bare = used_by_command((sys.executable, "-c", WITHOUT_US), LAUNCHES)
    console.print(f"first evaluation from a cold start: {cold:.2f} s of processor time")
    console.print(f"imports of NumPy and Pinocchio alone: {bare:.2f} s")
    console.print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")


if __name__ == "__main__":
    main()
