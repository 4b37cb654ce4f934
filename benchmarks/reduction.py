"""Reduced forward dynamics against the bare Pinocchio calls that it makes, and a simulation against real time.

Run ``python -m benchmarks.reduction``. The two are timed in turn, so that both see the same machine; ratios
are of medians.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin
from rich.console import Console
from rich.table import Table

import rnc_pin as rnc
from rnc_pin.scenario.run import plan

ROUNDS, CALLS, BATCH = 31, 1000, 256


def main() -> None:
    reduced = space_robot()
    generator = np.random.default_rng(0)
    q = reduced.robot.configuration({"joint_1": -0.4, "joint_2": 1.8, "joint_3": -1.1})
    v2, T = generator.normal(size=(2, 3))
    Q = np.tile(q, (BATCH, 1)) + generator.uniform(-0.2, 0.2, (BATCH, 4))
    V2, inputs = generator.normal(size=(2, BATCH, 3))
    v = reduced.terms(q, v2).v
    bare = bare_calls(reduced)

    rows = [
        ("one state", *side_by_side(lambda: reduced.forward_dynamics(q, v2, T), lambda: bare(q, v), CALLS), 6.0),
        (
            f"a state of {BATCH}",
            *side_by_side(
                lambda: reduced.forward_dynamics(Q, V2, inputs), lambda: bare(q, v), CALLS // BATCH + 1, BATCH
            ),
            3.0,
        ),
    ]
    table = Table(title="forward_dynamics of the space robot", title_justify="left")
    for column in ("", "rnc_pin [us]", "Pinocchio calls [us]", "ratio", "limit"):
        table.add_column(column, justify="left" if not column else "right")
    for name, ours, theirs, limit in rows:
        table.add_row(name, f"{ours:.2f}", f"{theirs:.2f}", f"{ours / theirs:.2f}", f"{limit:.0f}")
    console = Console()
    console.print(table)

    experiment = plan("space-robot").experiment
    start = time.process_time()
    rnc.simulate(experiment.reduced, experiment.controller, experiment.q0, 10.0, 0.002)
    used = time.process_time() - start
    console.print(
        f"10 s of space-robot at 2 ms: {used:.2f} s of processor time, {used / 10:.3f} of real time (limit 0.2)",
        soft_wrap=True,
    )


def space_robot() -> rnc.ReducedModel:
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], ["joint_1", "joint_2", "joint_3"])
    return system.reduce([rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")])


def bare_calls(reduced: rnc.ReducedModel) -> Callable[[np.ndarray, np.ndarray], None]:
    """Every call into Pinocchio that one ``forward_dynamics`` makes, and nothing else."""
    model = reduced.robot.model
    data, tip, zero, axes = model.createData(), model.getFrameId("tip"), np.zeros(4), pin.LOCAL_WORLD_ALIGNED

    def calls(q: np.ndarray, v: np.ndarray) -> None:
        pin.computeJointJacobians(model, data, q)
        pin.crba(model, data, q)
        pin.getFrameJacobian(model, data, tip, axes)
        pin.forwardKinematics(model, data, q, v, zero)
        pin.nonLinearEffects(model, data, q, v)
        pin.getFrameClassicalAcceleration(model, data, tip, axes).linear  # noqa: B018

    return calls


def side_by_side(
    ours: Callable[[], object], theirs: Callable[[], object], calls: int, batch: int = 1
) -> tuple[float, float]:
    """Median microseconds a state of each, timed in turn."""
    figures: tuple[list[float], list[float]] = ([], [])
    for _ in range(ROUNDS):
        for function, count, samples, kept in (
            (ours, calls, batch, figures[0]),
            (theirs, calls * batch, 1, figures[1]),
        ):
            start = time.perf_counter()
            for _ in range(count):
                function()
            kept.append((time.perf_counter() - start) / (count * samples) * 1e6)
    return statistics.median(figures[0]), statistics.median(figures[1])


if __name__ == "__main__":
    main()
