"""Cost over the size of systems.

* joints: chains of 4 to 60 revolute joints on a rolling base, which is a planar joint with a knife edge;
* rows: 16 bodies behind each other, of which 1 to 16 roll on an axle without side slip;
* batch: ``forward_dynamics`` of 1 to 4096 states of the mobile manipulator in one call, and the memory it needs;
* cores: blocks of 256 states in one process and in two at the same time.

Costs of single states are processor times in microseconds, of ``terms``, ``forward_dynamics`` and
``state_derivatives``, beside the Pinocchio calls ``computeJointJacobians``, ``crba``, ``forwardKinematics`` and
``nonLinearEffects``. All sizes are measured in turn; figures are medians. Memory is the largest allocated amount during
a call, by ``tracemalloc``. ``--markdown`` prints Markdown. ``--pictures FOLDER`` also writes ``scaling_size.png``
and ``scaling_batch.png`` there.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import time
import tracemalloc
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import pinocchio as pin
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich import box
from rich.console import Console
from rich.table import Table

import rnc_pin as rnc
from benchmarks.reduction import bare_calls, derivatives, one_state, terms
from benchmarks.states import States, regular_states
from benchmarks.timing import in_turn, used_by
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.figures.style import STYLE, PrintFigure, line, save

JOINTS, ROWS = (4, 8, 15, 30, 60), (1, 2, 4, 8, 12, 16)
BATCHES, PROCESSES, BLOCK = (1, 4, 16, 64, 256, 1024, 4096), (1, 2), 256
STATES, ROUNDS = 16, 7
FUNCTIONS = {
    "Pinocchio calls": bare_calls,
    "forward_dynamics": one_state,
    "terms": terms,
    "state_derivatives": derivatives,
}
_LINK, _BODY = 0.3, 1.0  # length of links [m], and distance of bodies that roll [m]


class Costs(NamedTuple):
    """Costs over a size.

    Attributes:
        sizes: the sizes (s,).
        us: processor times (s, functions) of one state [us].
    """

    sizes: Sequence[int]
    us: np.ndarray


class BatchCosts(NamedTuple):
    """Costs over the number of states in a call.

    Attributes:
        sizes: numbers of states (s,).
        us: processor times (s,) of one state [us].
        kib: largest allocated amounts (s,) during a call [KiB].
    """

    sizes: Sequence[int]
    us: np.ndarray
    kib: np.ndarray


def chain_on_base(joints: int) -> rnc.ReducedModel:
    """Chain of revolute joints, about z and y in turn, on a base with a knife edge."""
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(base, pin.Inertia.FromBox(20.0, 0.6, 0.4, 0.2), pin.SE3.Identity())
    model.addBodyFrame("base", base, pin.SE3.Identity(), 0)
    parent, place = base, pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.2]))
    link = pin.Inertia.FromCylinder(2.0, 0.04, _LINK)
    middle, end = (pin.SE3(np.eye(3), np.array([0.0, 0.0, share * _LINK])) for share in (0.5, 1.0))
    for number in range(joints):
        kind = pin.JointModelRZ() if number % 2 == 0 else pin.JointModelRY()
        parent = model.addJoint(parent, kind, place, f"joint_{number}")
        model.appendBodyToJoint(parent, link, middle)
        place = end
    names = [f"joint_{number}" for number in range(joints)]
    actuators = [rnc.FrameForce("base", "x"), rnc.FrameTorque("base", "z"), *names]
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("base")], actuators)
    return system.reduce([rnc.FrameSpeed("base"), rnc.FrameYaw("base"), *map(rnc.JointPosition, names)])


def train(rows: int, bodies: int = max(ROWS)) -> rnc.ReducedModel:
    """Bodies behind each other on hitches, of which the first ``rows`` have an axle that does not slip sideways."""
    model = pin.Model()
    parent = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "root_joint")
    place = pin.SE3(np.eye(3), np.array([-_BODY, 0.0, 0.0]))
    for number in range(bodies):
        if number:
            parent = model.addJoint(parent, pin.JointModelRZ(), place, f"hitch_{number}")
        model.appendBodyToJoint(parent, pin.Inertia.FromBox(5.0, 0.6, 0.4, 0.2), pin.SE3.Identity())
        model.addBodyFrame(f"axle_{number}", parent, pin.SE3(np.eye(3), np.array([-0.4, 0.0, 0.0])), 0)
    axles = [rnc.NoSideSlip(f"axle_{number}") for number in range(rows)]
    actuators = [rnc.FrameForce("axle_0", "x"), rnc.FrameTorque("axle_0", "z")]
    actuators += [f"hitch_{number}" for number in range(1, bodies)]
    robot = rnc.Robot(model)
    bent = robot.configuration({f"hitch_{number}": 0.2 + 0.02 * number for number in range(1, bodies)})
    return rnc.NonholonomicSystem(robot, axles, actuators).reduce().with_basis_at(bent)


def costs(make: Callable[[int], rnc.ReducedModel], sizes: Sequence[int], rounds: int) -> Costs:
    """Costs of one state of systems of several sizes."""
    measurements = []
    for size in sizes:
        reduced = make(size)
        q0 = reduced.robot.configuration(dict.fromkeys(reduced.robot.joint_names[1:], 0.3))
        states = regular_states(reduced, q0, STATES)
        measurements += [measured(reduced, states) for measured in FUNCTIONS.values()]
    found = np.array(in_turn(measurements, rounds))[:, 0]
    return Costs(sizes, 1e6 * found.reshape(len(sizes), len(FUNCTIONS)))


def batch_costs(sizes: Sequence[int], rounds: int) -> BatchCosts:
    """Costs of a state and memory of a call, over the number of states in it."""
    reduced, states = _many_states(max(sizes))
    some = [(states.q[:size].copy(), states.v2[:size].copy(), states.T[:size].copy()) for size in sizes]
    repeats = [max(1, BLOCK // size) for size in sizes]

    def call(block: tuple[np.ndarray, ...], repeat: int) -> Callable[[], object]:
        return lambda: [reduced.forward_dynamics(*block) for _ in range(repeat)]

    measurements = [
        used_by(call(block, repeat), size * repeat) for block, repeat, size in zip(some, repeats, sizes, strict=True)
    ]
    found = np.array(in_turn(measurements, rounds))[:, 0]
    return BatchCosts(
        sizes, 1e6 * found, np.array([_peak(lambda block=block: reduced.terms(*block[:2])) for block in some])
    )


def _peak(call: Callable[[], object]) -> float:
    """Largest allocated amount during a call [KiB]."""
    call()
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1] / 1024
    finally:
        tracemalloc.stop()


def _many_states(count: int) -> tuple[rnc.ReducedModel, States]:
    experiment = Scenario.load("mobile-manipulator", {"comparisons": {}}).experiment
    some = regular_states(experiment.reduced, experiment.q0, min(count, 64))
    repeats = -(-count // len(some.q))
    return experiment.reduced, States(*(np.tile(each, (repeats, 1))[:count] for each in some))


def throughput(processes: int, blocks: int) -> float:
    """States per second of wall time in blocks of 256, in several processes at the same time."""
    context = multiprocessing.get_context("spawn")
    barrier = context.Barrier(processes)
    queue = context.Queue()
    workers = [context.Process(target=_work, args=(barrier, queue, blocks)) for _ in range(processes)]
    for worker in workers:
        worker.start()
    times = [queue.get() for _ in workers]
    for worker in workers:
        worker.join()
    begin, end = min(each[0] for each in times), max(each[1] for each in times)
    return processes * blocks * BLOCK / (end - begin)


def _work(barrier: object, queue: object, blocks: int) -> None:
    reduced, states = _many_states(BLOCK)
    reduced.forward_dynamics(states.q, states.v2, states.T)
    barrier.wait()  # type: ignore[attr-defined]
    begin = time.monotonic()
    for _ in range(blocks):
        reduced.forward_dynamics(states.q, states.v2, states.T)
    queue.put((begin, time.monotonic()))  # type: ignore[attr-defined]


@mpl.rc_context(STYLE)
def size_figure(joints: Costs, rows: Costs) -> Figure:
    """Costs over the number of joints and of constraint rows."""
    figure = PrintFigure((8.4, 3.6))
    panels = figure.subplots(1, 2, sharey=True)
    for axes, found, label in zip(panels, (joints, rows), ("joints on the base", "constraint rows"), strict=True):
        sizes = np.array(found.sizes, dtype=float)
        for k, name in enumerate(FUNCTIONS):
            line(axes, k, len(FUNCTIONS), sizes, found.us[:, k]).set(label=name, markevery=None)
        _mark(axes, found.sizes)
        axes.set(xlabel=label, yscale="log")
    panels[0].set_ylabel("processor time of one state [us]")
    panels[0].set_title("Chains on a rolling base", loc="left")
    panels[1].set_title(f"{max(ROWS)} bodies, some on axles", loc="left")
    panels[0].legend(loc="upper left")
    return figure


@mpl.rc_context(STYLE)
def batch_figure(batches: BatchCosts) -> Figure:
    """Costs and memory over the number of states in a call."""
    figure = PrintFigure((8.4, 3.2))
    panels = figure.subplots(1, 2)
    sizes = np.array(batches.sizes, dtype=float)
    line(panels[0], 0, 1, sizes, batches.us).set(markevery=None)
    line(panels[1], 1, 2, sizes, batches.kib / sizes).set(markevery=None)
    for axes in panels:
        _mark(axes, batches.sizes)
        axes.set(xlabel="states in one call", ylim=(0, None))
    panels[0].set_ylabel("processor time of one state [us]")
    panels[1].set_ylabel("memory of one state [KiB]")
    panels[0].set_title("forward_dynamics, mobile manipulator", loc="left")
    panels[1].set_title("terms, all matrices", loc="left")
    return figure


def _mark(axes: Axes, sizes: Sequence[int]) -> None:
    """Show the sizes on a logarithmic axis."""
    axes.set_xscale("log", base=2)
    axes.set_xticks(sizes, [str(size) for size in sizes])
    axes.minorticks_off()


def _print(title: str, names: Sequence[str], rows: Sequence[Sequence[float]], markdown: bool) -> None:
    table = Table(*names, title=title, box=box.MARKDOWN if markdown else box.HEAVY_HEAD)
    for row in rows:
        table.add_row(f"{row[0]:g}", *(f"{figure:.1f}" for figure in row[1:]))
    Console(width=120).print(table)


def main() -> None:
    """Print the tables and draw the pictures."""
    parser = argparse.ArgumentParser(description="Cost over the size of systems.")
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--pictures", type=Path, help="folder for the pictures")
    parser.add_argument("--markdown", action="store_true")
    given = parser.parse_args()
    joints, rows = costs(chain_on_base, JOINTS, given.rounds), costs(train, ROWS, given.rounds)
    batches = batch_costs(BATCHES, given.rounds)
    for found, label in ((joints, "joints"), (rows, "rows")):
        _print(
            f"one state in us, {label}",
            (label, *FUNCTIONS),
            np.column_stack([found.sizes, found.us]).tolist(),
            given.markdown,
        )
    columns = np.column_stack([batches.sizes, batches.us, batches.kib / np.array(batches.sizes), batches.kib])
    _print("batch", ("states", "us per state", "KiB per state, terms", "KiB, terms"), columns.tolist(), given.markdown)
    rates = [throughput(processes, 200) for processes in PROCESSES]
    shares = [(processes, rate / 1e3, rate / rates[0]) for processes, rate in zip(PROCESSES, rates, strict=True)]
    _print("cores", ("processes", "1000 states per second", "ratio to one"), shares, given.markdown)
    if given.pictures is not None:
        save(size_figure(joints, rows), given.pictures / "scaling_size.png")
        save(batch_figure(batches), given.pictures / "scaling_batch.png")
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
