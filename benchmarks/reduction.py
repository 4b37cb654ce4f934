"""Cost over bare Pinocchio calls and in real time.

For the system of every built-in scenario, or of those named after ``--systems``:

* bare calls: ``computeJointJacobians``, ``crba``, ``forwardKinematics`` at zero acceleration and ``nonLinearEffects``
  at a state, on the same model with a workspace of its own;
* one state: ``forward_dynamics`` of single states, beside the bare calls;
* terms: all matrices of single states, rates of R and A_star included, beside the bare calls;
* derivatives: ``state_derivatives`` of single states, beside the bare calls; and of a state in a block of 64;
* of 256: a state in one ``forward_dynamics`` of a batch of 256, beside the bare calls;
* tick: measure, control, allocate and integrate over one sampling period, with the scenario's controller and
  settings, beside that period;
* threads: processor time of all threads over that of the one that simulates. More than 1 says that others, such as
  those of a linear algebra library, are kept awake.

Then ``state_derivatives`` of the space robot and of a free-flying Panda, beside the same blocks written by hand with
Pinocchio's derivatives (``benchmarks/peers/hand_derivatives.py``). Then the processor time of what is started again and
again: the import, and ``rnc-pin --help``.

Times are processor times, so that the machine may do other things besides; how fast it was in the meantime shows in the
bare calls and in ``python_loop_ms``, a million additions in Python. Everything of a system is measured in turn,
round by round; figures are medians and ratios are ratios of medians. What is beyond its limit is red in the table and
listed below it, and ``within`` is false in JSON. ``--json`` prints JSON in place of the table, ``--json FILE`` writes
it beside the table: of each system ``system``, ``nv``, ``r``, ``bare_us``, ``threads``, and costs with ``us``,
``ratio``, ``limit`` and ``within``; ``derivatives_by_hand``, ``commands`` [s] and ``machine``.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.progress import track
from rich.table import Table

import rnc_pin as rnc
from benchmarks.peers.hand_derivatives import BY_HAND, derivative_cost
from benchmarks.states import States, regular_states
from benchmarks.timing import Measurement, in_turn, one_by_one, used_by, used_by_command
from rnc_pin.applications.scenario.builder import Experiment
from rnc_pin.applications.scenario.files import built_in_names
from rnc_pin.applications.scenario.scenario import Scenario

ROUNDS, BATCH, BLOCK, TICKS, LAUNCHES = 15, 256, 64, 100, 5
WIDTH = 192  # of the table, wherever it goes [characters]
ONE_STATE, OF_BATCH, TERMS = 2.5, 1.6, 4.0  # limits: ratios to bare calls
TICK, COMMAND = 0.1, 0.3  # limits: share of the period; [s]
DERIVATIVES, OF_BLOCK, TO_HAND = 100.0, 50.0, 1.5  # limits: [us] for one state and in a block; ratio to those by hand
TIGHTER = {"space-robot": 0.05}  # TICK of single systems
_COSTS = ("one_state", "of_batch", "terms", "derivatives", "of_block", "tick")  # in this order
COMMANDS = {
    "import rnc_pin": (sys.executable, "-c", "import rnc_pin"),
    "rnc-pin --help": (sys.executable, "-m", "rnc_pin", "--help"),
}


@dataclass(frozen=True)
class Cost:
    """A time beside what it is measured by.

    Attributes:
        us: [us].
        ratio: to the bare calls or to the sampling period.
        limit: of the ratio.
        within: True if the ratio is within its limit.
    """

    us: float
    ratio: float
    limit: float
    within: bool

    @classmethod
    def of(cls, seconds: float, measure: float, limit: float) -> Cost:
        """A time beside another one, both in seconds."""
        ratio = float(seconds / measure)
        return cls(float(seconds * 1e6), ratio, limit, ratio <= limit)


@dataclass(frozen=True)
class SystemCosts:
    """Cost of the system of a scenario.

    Attributes:
        system: name of the scenario.
        nv, r: degrees of freedom, and of the reduced system.
        bare_us: the bare calls at a state [us].
        costs: of a state in ``forward_dynamics``, by itself and in a batch; of all matrices of a state; of a state in
            ``state_derivatives``, by itself and in a block; and of a sampling period of a run.
        threads: processor time of all threads over that of the one that simulates.
    """

    system: str
    nv: int
    r: int
    bare_us: float
    costs: dict[str, Cost]
    threads: float

    @property
    def within(self) -> bool:
        """True if all figures are within their limits."""
        return all(each.within for each in self.costs.values())

    def record(self) -> dict[str, Any]:
        """For JSON."""
        plain = asdict(self)
        return plain | plain.pop("costs") | {"within": self.within}


# ---------------------------------------------------------------------- measuring


def system_costs(name: str, rounds: int = ROUNDS) -> SystemCosts:
    """Costs of the system of a built-in scenario. States of rows over time are those of the start."""
    experiment = Scenario.load(name).experiment
    dt = experiment.simulation.dt
    reduced = experiment.reduced.frozen(0.0) if experiment.reduced.rheonomic else experiment.reduced
    states = regular_states(reduced, experiment.q0, BATCH)
    q, v2, T = states.q, states.v2, states.T
    block = [values[:BLOCK] for values in (q, v2, T)]
    derivatives = partial(rnc.state_derivatives, reduced)
    measurements = (
        bare_calls(reduced, states),
        one_by_one(reduced.forward_dynamics, q, v2, T),
        used_by(lambda: reduced.forward_dynamics(q, v2, T), BATCH),
        one_by_one(reduced.terms, q, v2),
        one_by_one(derivatives, *block),
        used_by(lambda: derivatives(*block), BLOCK),
        tick(experiment),
    )
    (bare,), *measured, (ticking, threads) = in_turn(measurements, rounds)
    bare_us = float(bare * 1e6)
    limits = ONE_STATE, OF_BATCH, TERMS, DERIVATIVES / bare_us, OF_BLOCK / bare_us
    costs = [Cost.of(float(each[0]), bare, limit) for each, limit in zip(measured, limits, strict=True)]
    costs.append(Cost.of(ticking, dt, TIGHTER.get(name, TICK)))
    return SystemCosts(name, reduced.n, reduced.r, bare_us, dict(zip(_COSTS, costs, strict=True)), float(threads))


def bare_calls(reduced: rnc.ReducedModel, states: States) -> Measurement:
    """Positions, velocities, accelerations and forces of a state as Pinocchio gives them, and nothing else."""
    model, zero = reduced.robot.model, np.zeros(reduced.robot.nv)
    data = model.createData()

    def calls(q: np.ndarray, v: np.ndarray) -> None:
        pin.computeJointJacobians(model, data, q)
        pin.crba(model, data, q)
        pin.forwardKinematics(model, data, q, v, zero)
        pin.nonLinearEffects(model, data, q, v)

    return one_by_one(calls, states.q, states.v)


def tick(experiment: Experiment, ticks: int = TICKS) -> Measurement:
    """A tick in the first stretch of a run [s], without its closing pass, and the share of all threads in it."""
    settings = experiment.simulation

    def measure() -> Sequence[float]:
        stamps: list[tuple[float, float]] = []
        rnc.simulate(
            experiment.reduced,
            experiment.controller,
            experiment.q0,
            ticks * settings.dt,
            settings.dt,
            plant=experiment.plant,
            options=rnc.SimulationOptions(
                stop=settings.stop, observer=lambda _: stamps.append((time.process_time(), time.thread_time()))
            ),
        )
        each, own = np.diff(stamps, axis=0).T
        return float(np.median(each)), float(each.sum() / own.sum())

    return measure


def command_costs(launches: int = LAUNCHES) -> list[dict[str, Any]]:
    """Processor time of everything in ``COMMANDS`` [s], beside its limit."""
    taken = {name: used_by_command(command, launches) for name, command in COMMANDS.items()}
    return [
        {"command": name, "seconds": used, "limit": COMMAND, "within": used <= COMMAND} for name, used in taken.items()
    ]


def machine() -> dict[str, Any]:
    """Computer of the measurement."""
    return {
        "cpus": os.cpu_count(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "pin": pin.__version__,
        "python_loop_ms": round(python_loop() * 1e3, 1),
        "load": round(os.getloadavg()[0], 1),
    }


def python_loop(steps: int = 1_000_000) -> float:
    """Present speed of the interpreter: median time of as many additions [s]."""

    def add() -> None:
        total = 0
        for step in range(steps):
            total += step

    return float(in_turn([used_by(add, 1)], LAUNCHES)[0][0])


# ---------------------------------------------------------------------- showing


def table(systems: Iterable[SystemCosts]) -> Table:
    """One row a system; what is beyond its limit is red."""
    shown = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 0, 0, 1))
    shown.add_column("system", no_wrap=True)
    timed = "one state", f"of {BATCH}", "terms", "derivatives", f"of {BLOCK}"
    costs = [heading for each in timed for heading in (f"{each} [us]", "/ bare")]
    for heading in ("nv", "r", "bare [us]", *costs, "tick [us]", "/ dt", "threads"):
        shown.add_column(escape(heading), justify="right", no_wrap=True)
    for each in systems:
        cells = [
            cell
            for kind, cost in each.costs.items()
            for cell in (f"{cost.us:.1f}", marked(f"{cost.ratio:.{3 if kind == 'tick' else 1}f}", cost.within))
        ]
        plain = marked(each.system, each.within), str(each.nv), str(each.r), f"{each.bare_us:.2f}"
        shown.add_row(*plain, *cells, f"{each.threads:.2f}")
    return shown


def marked(text: str, within: bool) -> str:
    """Bold and red where a limit is not kept."""
    return text if within else f"[bold red]{text}[/]"


def show(systems: Sequence[SystemCosts], found: dict[str, Any]) -> None:
    """The table, its limits, derivatives beside those by hand, the commands and the machine."""
    console = Console(highlight=False, soft_wrap=True)
    console.width = max(console.width, WIDTH)
    tighter = "".join(f", of {name} {limit:g} dt" for name, limit in TIGHTER.items())
    console.print(table(systems))
    ratios = f"one state {ONE_STATE:g} bare, of {BATCH} {OF_BATCH:g} bare, terms {TERMS:g} bare"
    times = f"derivatives {DERIVATIVES:g} us, of {BLOCK} {OF_BLOCK:g} us"
    console.print(f"limits: {ratios}, {times}, tick {TICK:g} dt{tighter}")
    for each in systems:
        for kind, cost in each.costs.items():
            if not cost.within:
                console.print(f"beyond its limit: {kind} of {each.system}, {cost.ratio:.2f}, limit {cost.limit:g}")
    for each in found["derivatives_by_hand"]:
        figures = f"{each['us']:.1f} us, of {BLOCK} {each['block_us']:.1f} us, by hand {each['hand_us']:.1f} us"
        ratio = marked(f"{each['ratio']:.2f}", each["within"])
        console.print(f"state_derivatives of {each['system']}: {figures}, ratio {ratio}, limit {TO_HAND:g}")
    for each in found["commands"]:
        figure = marked(f"{each['seconds']:.2f} s", each["within"])
        console.print(f"{each['command']}: {figure} of processor time, limit {each['limit']:g} s")
    console.print(", ".join(f"{name} {value}" for name, value in found["machine"].items()))


def arguments(given: Sequence[str] | None) -> argparse.Namespace:
    """Arguments of the command line."""
    names = built_in_names()
    parser = argparse.ArgumentParser(prog="python -m benchmarks.reduction", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--systems", nargs="+", choices=names, default=names, metavar="NAME", help=", ".join(names))
    parser.add_argument("--rounds", type=int, default=ROUNDS, metavar="N", help="default: %(default)s")
    parser.add_argument("--json", nargs="?", const="-", metavar="FILE", help="print JSON, or write it to FILE as well")
    options = parser.parse_args(given)
    if options.rounds < 1:
        parser.error("--rounds has to be at least 1")
    return options


def main(given: Sequence[str] | None = None) -> None:
    """Measure, and show or write what was found."""
    options = arguments(given)
    progress = Console(stderr=True)
    # No thread of the display's own while time is taken: it draws when a system is done.
    names = track(options.systems, "", auto_refresh=False, console=progress, disable=not progress.is_terminal)
    systems = [system_costs(name, options.rounds) for name in names]
    found = {
        "rounds": options.rounds,
        "systems": [each.record() for each in systems],
        "derivatives_by_hand": [
            {**found, "limit": TO_HAND, "within": found["ratio"] <= TO_HAND}
            for found in (derivative_cost(name, options.rounds) for name in BY_HAND)
        ],
        "commands": command_costs(min(LAUNCHES, options.rounds)),
        "machine": machine(),
    }
    if options.json is not None:
        text = json.dumps(found, indent=1) + "\n"
        if options.json == "-":
            sys.stdout.write(text)
            return
        Path(options.json).write_text(text)
    show(systems, found)


if __name__ == "__main__":
    main()
