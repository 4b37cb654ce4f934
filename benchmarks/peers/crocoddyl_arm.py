"""The arm of ``python -m benchmarks optimal peers`` by Crocoddyl, in an environment of its own.

Reads a problem as JSON from its input and writes results as JSON. It imports nothing of this project.
"""

from __future__ import annotations

import json
import sys
import time

import crocoddyl
import numpy as np
import pinocchio as pin

problem = json.load(sys.stdin)
whole = pin.buildModelFromUrdf(problem["urdf"])
locked = [whole.getJointId(name) for name in whole.names[1:] if name not in problem["joints"]]
robot = pin.buildReducedModel(whole, locked, pin.neutral(whole))
data = robot.createData()
found = [pin.aba(robot, data, *(np.array(each) for each in state)).tolist() for state in problem["states"]]
state = crocoddyl.StateMultibody(robot)
actuation = crocoddyl.ActuationModelFull(state)
goal = np.concatenate([problem["goal"], np.zeros(robot.nv)])


def costs(posture: float, velocity: float, effort: float) -> crocoddyl.CostModelSum:
    weights = np.repeat([posture, velocity], robot.nv)
    activation = crocoddyl.ActivationModelWeightedQuad(weights)
    total = crocoddyl.CostModelSum(state, robot.nv)
    residual = crocoddyl.ResidualModelState(state, goal, robot.nv)
    total.addCost("state", crocoddyl.CostModelResidual(state, activation, residual), 1.0)
    if effort:
        control = crocoddyl.ResidualModelControl(state, robot.nv)
        total.addCost("effort", crocoddyl.CostModelResidual(state, control), effort)
    return total


def solve(limit: float | None) -> dict[str, object]:
    """Solution by Euler's rule from a guess at rest, whose torques balance gravity."""

    def action(total: crocoddyl.CostModelSum, h: float) -> crocoddyl.ActionModelAbstract:
        continuous = crocoddyl.DifferentialActionModelFreeFwdDynamics(state, actuation, total)
        made = crocoddyl.IntegratedActionModelEuler(continuous, h)
        if limit is not None:
            made.u_lb, made.u_ub = np.full(robot.nv, -limit), np.full(robot.nv, limit)
        return made

    running, end = action(costs(*problem["running"]), problem["h"]), action(costs(*problem["terminal"], 0.0), 0.0)
    start, taken = np.concatenate([problem["start"], np.zeros(robot.nv)]), []
    for _ in range(problem["rounds"]):
        shooting = crocoddyl.ShootingProblem(start, [running] * problem["nodes"], end)
        solver = (crocoddyl.SolverFDDP if limit is None else crocoddyl.SolverBoxFDDP)(shooting)
        solver.th_stop = 1e-7
        begin = time.process_time()
        xs = [start] * (problem["nodes"] + 1)
        done = solver.solve(xs, shooting.quasiStatic(xs[:-1]), 300, False)
        taken.append(time.process_time() - begin)
    return {"time": min(taken), "cost": solver.cost, "iterations": solver.iter, "done": bool(done),
            "effort": float(np.abs(np.array(list(solver.us))).max()), "feasible": bool(solver.isFeasible)}  # fmt: skip


json.dump(
    {
        "version": crocoddyl.__version__,
        "accelerations": found,
        "solutions": [solve(limit) for limit in (None, problem["limit"])],
    },
    sys.stdout,
)
