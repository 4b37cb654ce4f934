"""Cost of our model beside others.

* By hand: ``forward_dynamics`` of one state, and of a state in a batch of 256, beside the same question answered in
  Python on Pinocchio (``hand_written.py``): v2 in, v2_dot out.
* Motion: ``free_motion`` at a relative tolerance of 1e-10, beside DOP853 of SciPy over the solution by hand at equal
  error.
* Engines: ``forward_dynamics`` beside single calls of other libraries for the same system. These start from a full
  velocity that keeps the constraints, and from rows where they need some. Their accelerations are compared with ours.

Times are processor times, taken in turn, and medians. A library that is not installed is left out, in one line.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from benchmarks.peers.cases import CASES, Case
from benchmarks.peers.motion import Motion
from benchmarks.peers.peer import Peer
from benchmarks.reduction import machine
from benchmarks.states import States, regular_states
from benchmarks.timing import in_turn, one_by_one, used_by

ROUNDS, BATCH, MOTIONS = 15, 256, 5
LIBRARIES = {
    "pinocchio_calls": ("pinocchio", "pin"),
    "mujoco_engine": ("mujoco", "mujoco"),
    "drake_engine": ("pydrake", "drake"),
    "sympy_equations": ("sympy", "sympy"),
}
"""Library and package of each peer's module."""
_AGREEMENT = 1e-9


def available(console: Console) -> list[Any]:
    """Modules of the peers whose libraries are installed; a line for each of the others."""
    found = []
    for module, (library, package) in LIBRARIES.items():
        try:
            found.append(importlib.import_module(f"benchmarks.peers.{module}"))
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] != library:
                raise
            console.print(f"{library} is not installed: python -m pip install {package}")
    return found


def hand_difference(case: Case, states: States) -> float:
    """Largest difference of a reduced acceleration by hand, relative to the largest acceleration."""
    found = np.array([case.by_hand(*state)[0] for state in zip(states.q, states.v2, states.T, strict=True)])
    expected = case.reduced.forward_dynamics(states.q, states.v2, states.T)
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def evaluations(case: Case, modules: Sequence[Any], rounds: int) -> Iterator[dict[str, Any]]:
    """Costs of one evaluation: ours, by hand, and by each peer."""
    states = regular_states(case.reduced, case.q0, BATCH)
    peers: list[Peer] = [peer for module in modules for peer in module.peers(case, states)]
    given, ours = (states.q, states.v2, states.T), case.reduced.forward_dynamics
    measured = [one_by_one(ours, *given), used_by(lambda: ours(*given), BATCH), one_by_one(case.by_hand, *given)]
    measured += [used_by(peer.run, BATCH) for peer in peers]
    one, of_batch, hand, *times = (float(figure[0]) for figure in in_turn(measured, rounds))
    found = {"ours_us": one * 1e6, "batch_us": of_batch * 1e6}
    differences = [hand_difference(case, states), *(peer.difference(case, states) for peer in peers)]
    names = ["KKT in Python", *(peer.name for peer in peers)]
    for name, taken, difference in zip(names, [hand, *times], differences, strict=True):
        ratios = {"ratio": one / taken, "batch_ratio": of_batch / taken}
        yield {"system": case.name, "peer": name, "us": taken * 1e6, **found, **ratios, "difference": difference}


def table(rows: Sequence[dict[str, Any]], columns: dict[str, str]) -> Table:
    """Rows with a heading and a format for each column."""
    shown = Table(*(heading.rpartition(":")[0] for heading in columns), box=box.SIMPLE_HEAD)
    for row in rows:
        cells = [
            row[key] if isinstance(row[key], str) else format(row[key], heading.rpartition(":")[2])
            for heading, key in columns.items()
        ]
        shown.add_row(*cells)
    return shown


def main(given: Sequence[str] | None = None) -> int:
    """Measure and print; status 1 if a peer disagrees."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--systems", nargs="+", choices=CASES, default=list(CASES), metavar="NAME")
    parser.add_argument("--rounds", type=int, default=ROUNDS, metavar="N", help="default: %(default)s")
    parser.add_argument("--motions", type=int, default=MOTIONS, metavar="N", help="rounds of motions, 0 for none")
    options = parser.parse_args(given)
    console = Console(highlight=False, width=140)
    modules = available(console)
    cases = [CASES[name]() for name in options.systems]
    costs = [row for case in cases for row in evaluations(case, modules, options.rounds)]
    moving = [case for case in cases if options.motions and case.regular]
    motions = [{"system": case.name, **Motion(case).cost(options.motions)} for case in moving]
    headings = {"system:": "system", "peer:": "peer", "peer [us]:.1f": "us", "ours [us]:.1f": "ours_us"}
    headings |= {"ours / peer:.2f": "ratio", f"of {BATCH} / peer:.2f": "batch_ratio", "difference:.0e": "difference"}
    console.print(table(costs, headings))
    headings = {"system:": "system", "ours [ms]:.1f": "ours_ms", "DOP853 over KKT [ms]:.1f": "theirs_ms"}
    headings |= {"ours / theirs:.2f": "ratio", "error:.0e": "error", "agreement:.0e": "agreement"}
    console.print(table(motions, headings))
    console.print(", ".join(f"{name} {value}" for name, value in machine().items()))
    return 0 if all(row["difference"] < _AGREEMENT for row in costs) else 1


if __name__ == "__main__":
    sys.exit(main())
