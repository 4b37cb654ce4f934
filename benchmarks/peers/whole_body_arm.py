"""The arm of ``python -m benchmarks whole_body peers`` by placo or TSID, in an environment of its own.

Reads a problem as JSON from its input and writes a run as JSON. It imports nothing of this project.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin

problem = json.load(sys.stdin)
robot = pin.buildModelFromUrdf(problem["urdf"])
data = robot.createData()
dt, hand = problem["dt"], problem["hand"]
stiffness, damping = problem["stiffness"], problem["damping"]
center = np.array(problem["q"])
Controller = Callable[[np.ndarray, np.ndarray, list[np.ndarray]], np.ndarray]


def placo() -> Controller:
    """Tasks with soft weights; limits of positions, velocities and torques are hard."""
    module = importlib.import_module("placo")
    arm = module.RobotWrapper(str(Path(problem["urdf"]).parent), module.Flags.ignore_collisions)
    solver = module.DynamicsSolver(arm)
    solver.mask_fbase(True)
    solver.dt = dt
    for name, limit in zip(problem["joints"], problem["efforts"], strict=True):
        solver.set_torque_limit(name, limit)
    solver.enable_joint_limits(True)
    solver.enable_velocity_limits(True)
    solver.enable_torque_limits(True)
    point = solver.add_position_task(hand, np.zeros(3))
    point.configure("hand", "soft", problem["weights"][0])
    posture = solver.add_joints_task()
    posture.set_joints(dict(zip(problem["joints"], center, strict=True)))
    posture.configure("posture", "soft", problem["weights"][1])
    for each in (point, posture):
        each.kp, each.kd = stiffness, damping

    def step(q: np.ndarray, v: np.ndarray, wanted: list[np.ndarray]) -> np.ndarray:
        arm.state.q[7:], arm.state.qd[6:] = q, v
        arm.update_kinematics()
        point.target_world, point.dtarget_world, point.ddtarget_world = wanted
        found = solver.solve()
        assert found.success
        return np.array(found.tau[6:])

    return step


def tsid() -> Controller:
    """Tasks of one level with weights; limits of velocities and torques are hard. Positions have none here."""
    module = importlib.import_module("tsid.tsid_pywrap")  # the package of the wheel has no contents of its own
    arm = module.RobotWrapper(problem["urdf"], pin.StdVec_StdString(), False)
    form = module.InverseDynamicsFormulationAccForce("program", arm, False)
    form.computeProblemData(0.0, center, np.zeros(arm.nv))
    point = module.TaskSE3Equality("hand", arm, hand)
    point.useLocalFrame(False)
    point.setMask(np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]))
    posture = module.TaskJointPosture("posture", arm)
    for each, size in ((point, 6), (posture, arm.nv)):
        each.setKp(stiffness * np.ones(size))
        each.setKd(damping * np.ones(size))
    held = module.TrajectorySample(arm.nv)
    held.value(center)
    posture.setReference(held)
    for each, weight in zip((point, posture), problem["weights"], strict=True):
        form.addMotionTask(each, weight, 1, 0.0)
    efforts = module.TaskActuationBounds("efforts", arm)
    efforts.setBounds(*(sign * np.array(problem["efforts"]) for sign in (-1, 1)))
    form.addActuationTask(efforts, 1.0, 0, 0.0)
    bounds = module.TaskJointBounds("velocities", arm, dt)
    bounds.setVelocityBounds(*(sign * np.array(problem["velocities"]) for sign in (-1, 1)))
    form.addMotionTask(bounds, 1.0, 0, 0.0)
    solver = module.SolverHQuadProgFast("solver")
    solver.resize(form.nVar, form.nEq, form.nIn)
    sample = module.TrajectorySample(12, 6)
    alive = arm, point, posture, efforts, bounds  # the program itself does not keep them

    def step(q: np.ndarray, v: np.ndarray, wanted: list[np.ndarray]) -> np.ndarray:
        sample.value(np.concatenate([wanted[0], np.eye(3).ravel()]))
        sample.derivative(np.concatenate([wanted[1], np.zeros(3)]))
        sample.second_derivative(np.concatenate([wanted[2], np.zeros(3)]))
        alive[1].setReference(sample)
        found = solver.solve(form.computeProblemData(0.0, q, v))
        assert found.status == 0
        return np.array(form.getActuatorForces(found))

    return step


def stepped(q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """State after a sample under constant torques, by one Runge-Kutta step."""

    def rate(y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[robot.nq :], pin.aba(robot, data, y[: robot.nq], y[robot.nq :], tau)])

    y = np.concatenate([q, v])
    k1 = rate(y)
    k2 = rate(y + dt / 2 * k1)
    k3 = rate(y + dt / 2 * k2)
    y = y + dt / 6 * (k1 + 2 * k2 + 2 * k3 + rate(y + dt * k3))
    return y[: robot.nq], y[robot.nq :]


def run(controller: Controller) -> tuple[float, list[list[float]]]:
    """Processor time of a sample [s], and the torques of all samples (samples, nv)."""
    q, v, used, efforts = center, np.zeros(robot.nv), 0.0, []
    for wanted in problem["reference"]:
        arrays = [np.array(each) for each in wanted]
        begin = time.process_time()
        efforts.append(controller(q, v, arrays))
        used += time.process_time() - begin
        q, v = stepped(q, v, efforts[-1])
    return used / len(efforts), np.array(efforts).tolist()


peer = sys.argv[1]
used, torques = min(run({"placo": placo, "tsid": tsid}[peer]()) for _ in range(problem["rounds"]))
print(json.dumps({"time": used, "efforts": torques, "version": importlib.metadata.version(peer)}))
