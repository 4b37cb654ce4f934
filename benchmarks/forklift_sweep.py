"""Planned runs of a forklift round a rack, and a dense replay of each.

Start, goal and height of the load are drawn. Plans keep 0.1 m from the rack; their feedback tracks them. Every run that
the sweep calls succeeded or degraded has to keep clearance and goal in a replay at 1 ms by Pinocchio and coal.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from benchmarks.verdicts import dense

URDF = """<robot name="forklift">
<link name="base"><inertial><origin xyz="0 0 0.5"/><mass value="300"/>
<inertia ixx="30" iyy="60" izz="60" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 0.5"/><geometry><box size="1.6 0.9 1.0"/></geometry></collision></link>
<link name="load"><inertial><mass value="80"/>
<inertia ixx="8" iyy="8" izz="8" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="0.9 0.8 0.6"/></geometry></collision></link>
<joint name="lift_joint" type="prismatic"><parent link="base"/><child link="load"/><origin xyz="1.3 0 0.35"/>
<axis xyz="0 0 1"/><limit lower="0" upper="1.4" effort="{effort}" velocity="0.5"/></joint></robot>"""
CLEARANCE, ACCURACY, GOAL = 0.1, 0.005, 0.02
RACK, SIZE = (0.0, 0.0, 1.0), (2.0, 0.6, 2.0)
SCENARIO = f"""
title: Forklift with a load round a rack
robot: {{urdf: forklift.urdf, base: planar}}
obstacles:
  - box: {{name: rack, size: {list(SIZE)}, position: {list(RACK)}}}
constraints:
  - no_side_slip: {{frame: base}}
actuators:
  - force: {{frame: base, axis: x}}
  - torque: {{frame: base, axis: z}}
  - lift_joint
outputs:
  reducing:
    - frame_speed: {{frame: base, axis: x}}
    - frame_yaw: base
    - joint: lift_joint
  vertical:
    - frame_position: {{frame: base, axes: xy}}
initial: {{q: {{root_joint: [0, -2.2, 0]}}}}
planner:
  type: optimal
  goal: {{base_x: 0, base_y: 2.2, base_yaw: 0, lift_joint: 0.5}}
  duration: 16
  bounds: {{velocity: {{base_speed_x: [-1, 1], base_yaw: [-1, 1]}}}}
  clearance: {CLEARANCE}
  accuracy: {ACCURACY}
controller: {{type: plan_feedback}}
simulation: {{duration: 17, dt: 0.01}}
goal_tolerance: {GOAL}
sweep:
  initial.q.root_joint.0: [-2.0, 2.0]
  initial.q.root_joint.2: [-0.6, 0.6]
  planner.goal.base_x: [-2.0, 2.0]
  planner.goal.base_y: [1.9, 2.5]
  planner.goal.base_yaw: [-0.6, 0.6]
  planner.goal.lift_joint: [0.0, 1.7]
"""


def write_scenario(folder: Path) -> Path:
    """Write the robot and its scenario into a folder; return the file of the scenario."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "forklift.urdf").write_text(URDF.format(effort=3000))
    path = folder / "forklift.yaml"
    path.write_text(SCENARIO)
    return path


def replayed(robot: rnc.Robot, run: rnc.Trajectory, goal: np.ndarray) -> tuple[float, float]:
    """Smallest distance from the rack [m] and largest error at the goal [m or rad], by Pinocchio and coal alone."""
    model, data = robot.model, robot.model.createData()
    bodies = [(coal.Box(1.6, 0.9, 1.0), 1, np.array([0.0, 0.0, 0.5])), (coal.Box(0.9, 0.8, 0.6), 2, np.zeros(3))]
    box, place = coal.Box(*SIZE), coal.Transform3s(np.eye(3), np.array(RACK))
    request, result, smallest = coal.DistanceRequest(), coal.DistanceResult(), np.inf
    for _, q in dense(run, model, 1e-3):
        pin.forwardKinematics(model, data, q)
        for body, joint, at in bodies:
            pose = data.oMi[joint]
            result.clear()
            here = coal.Transform3s(pose.rotation, pose.act(at))
            smallest = min(smallest, coal.distance(body, here, box, place, request, result))
    x, y, c, s, lift = run.q[-1]
    error = np.array([x, y, np.arctan2(s, c), lift]) - goal
    return smallest, float(np.abs(error).max())


def main() -> None:
    """Print the verdicts of the sweep, and the worst distance and error of the runs that are called succeeded."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("forklift-sweep"))
    given = parser.parse_args()
    start = time.perf_counter()
    scenario = write_scenario(given.out / "scenario")
    results = rnc.sweep(scenario, given.runs, out=given.out / "runs", jobs=given.jobs, trajectories=True)
    print(f"{given.runs} runs: {results.verdicts}")
    robot = rnc.Robot.from_urdf(scenario.parent / "forklift.urdf", base="planar")
    print(f"{sum(row['redrawn'] for row in results.rows())} draws were infeasible and drawn again")
    keys = [f"planner.goal.{name}" for name in ("base_x", "base_y", "base_yaw", "lift_joint")]
    counts, worst = Counter[str](), {"distance": np.inf, "error": 0.0}
    for row in results.rows():
        if row["verdict"] == "failed":
            continue
        distance, error = replayed(robot, results.trajectory(row["run"]), np.array([row[key] for key in keys]))
        worst = {"distance": min(worst["distance"], distance), "error": max(worst["error"], error)}
        kept = distance >= CLEARANCE - ACCURACY - 1e-4 and error <= GOAL
        counts[f"{row['verdict']}, {'kept' if kept else 'broken'} in the replay"] += 1
    for what, count in sorted(counts.items()):
        print(f"{what}: {count}")
    print(f"smallest distance {worst['distance']:.4f} m of {CLEARANCE:g} m, largest error {worst['error']:.4f}")
    print(f"{time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
