"""Success rate and time of inverse kinematics.

Targets are poses (position and rotation) of the hand at random configurations within the joint limits, so all of them
can be reached. The start is the neutral configuration. Times are processor times of ``rnc.solve_ik``.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import pinocchio as pin
from rich.console import Console
from rich.table import Table

import rnc_pin as rnc

HANDS = {
    "tiago_no_hand": ("planar", "arm_tool_link"),
    "ur5_robot": ("fixed", "tool0"),
    "panda": ("fixed", "panda_hand"),
}


def random_pose(robot: rnc.Robot, frame: str, generator: np.random.Generator) -> pin.SE3:
    """Pose of a frame at a random configuration within the limits; joints without limits within one metre or radian."""
    model = robot.model
    lower = np.where(np.abs(model.lowerPositionLimit) < 1e3, model.lowerPositionLimit, -1.0)
    upper = np.where(np.abs(model.upperPositionLimit) < 1e3, model.upperPositionLimit, 1.0)
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.normalize(model, generator.uniform(lower, upper)))
    return data.oMf[robot.frame_id(frame)].copy()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help=", ".join(HANDS))
    parser.add_argument("--targets", type=int, default=1000)
    arguments = parser.parse_args()
    if unknown := [name for name in arguments.robots if name not in HANDS]:
        parser.error(f"no robot '{unknown[0]}'; expected some of: {', '.join(HANDS)}")
    table = Table(
        "robot", "joints", "targets", "reached", "median [ms]", "95 % [ms]", "descents, mean", "steps, median"
    )
    for name in arguments.robots or HANDS:
        base, frame = HANDS[name]
        robot = rnc.Robot.from_example(name, base=base)
        reduced, generator = rnc.NonholonomicSystem(robot).reduce(), np.random.default_rng(1)
        position, rotation = rnc.FramePosition(frame), rnc.FrameOrientation(frame)
        results, times = [], []
        for seed in range(arguments.targets):
            goal = random_pose(robot, frame, generator)
            start = time.process_time()
            targets = {position: goal.translation, rotation: goal.rotation}
            results.append(rnc.solve_ik(reduced, robot.configuration(), targets, search=rnc.IkSearch(seed=seed)))
            times.append(1e3 * (time.process_time() - start))
        reached = sum(result.converged for result in results)
        starts, steps = ([getattr(result, key) for result in results] for key in ("starts", "steps"))
        numbers = [np.median(times), np.quantile(times, 0.95), np.mean(starts), np.median(steps)]
        table.add_row(name, str(robot.nv), str(len(results)), str(reached), *(f"{number:.3g}" for number in numbers))
    Console().print(table)


if __name__ == "__main__":
    main()
