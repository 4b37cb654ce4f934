"""Hand of a robot on wheels, followed by this package, pink and mink.

TIAGo draws the same path with its hand, with the same limits, weights, solver and sample period. Wheel slip is the
velocity of a wheel's lowest point, three times in each sample, in the motion that the library commands. A wheel that
rolls has none. Times are processor times of a sample, with what the library needs from the configuration, in turn.

A library that is not installed is left out, in one line.
"""

from __future__ import annotations

import argparse
import importlib.util
import time
from importlib.metadata import version

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from benchmarks.ik_peers.hand_path import DT, DURATION, Case, Follower, case, followed

LIBRARIES = {
    "program_follower": ("rnc_pin", "rnc_pin"),
    "pink_follower": ("pink", "pin-pink"),
    "mink_follower": ("mink", "mink"),
}
"""Library and package of each module."""


def available(given: Case, console: Console) -> list[Follower]:
    """Followers of the libraries that are installed; a line for each of the others."""
    found: list[Follower] = []
    for module, (library, package) in LIBRARIES.items():
        try:
            found += importlib.import_module(f"benchmarks.ik_peers.{module}").followers(given)
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] not in (library, "mujoco"):
                raise
            console.print(f"{error.name} is not installed: python -m pip install {package}")
    return found


def timed(followers: list[Follower]) -> np.ndarray:
    """Medians of the processor time of a sample [s], (followers,), taken in turn along the path."""
    used = np.zeros((round(DURATION / DT), len(followers)))
    for sample, row in enumerate(used):
        for k, follower in enumerate(followers):
            begin = time.process_time()
            follower.command(sample * DT)
            row[k] = time.process_time() - begin
            follower.advance()
    return np.median(used, axis=0)


def main() -> None:
    """Print the table."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    console, given = Console(width=200), case()
    table = Table(
        "library",
        "rolling",
        "hand, rms [mm]",
        "hand, largest [mm]",
        "slip aside [mm/s]",
        "slip along [mm/s]",
        "beyond positions [mrad]",
        "beyond velocities [%]",
        "acceleration [rad/s2]",
        "time [us]",
        box=box.SIMPLE,
    )
    times = timed(available(given, console))
    for follower, used in zip(available(given, Console(quiet=True)), times, strict=True):
        result = followed(given, follower)
        figures = [1e3 * each for each in result[:5]] + [100 * result.beyond_velocity, result.acceleration]
        table.add_row(follower.name, follower.rolling, *(f"{each:.2g}" for each in figures), f"{1e6 * used:.0f}")
    packages = [
        name
        for name in ("pin", "daqp", "qpsolvers", "mujoco")
        if importlib.util.find_spec({"pin": "pinocchio"}.get(name, name))
    ]
    console.print(table, ", ".join(f"{name} {version(name)}" for name in packages))


if __name__ == "__main__":
    main()
