"""One plan of an arm here and by Crocoddyl: the same dynamics, costs, start, guess, and limits of the torques.

Updates of predictive control are also timed for a mobile manipulator and for TIAGo.

Crocoddyl lives in an environment of its own, because it needs another version of Pinocchio: ``crocoddyl==3.1.0``,
``pin==3.8.0``, ``cmeel-urdfdom<5`` and ``cmeel-tinyxml2<11``. The variable ``RNC_PIN_CROCODDYL`` names its interpreter.
Before times count, its accelerations and the optimal costs have to agree with those here.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from benchmarks.peers.environments import answer
from benchmarks.planned_models import mobile_manipulator
from benchmarks.whole_body import model as tiago
from rnc_pin.motion.optimal import (
    CostKind,
    EffortCost,
    InputBound,
    Nodes,
    OutputCost,
    PostureCost,
    PredictiveController,
    SolverSettings,
    VelocityCost,
    action_model,
)
from rnc_pin.motion.optimal.guesses import along
from rnc_pin.motion.optimal.planner import build_problem, initial_node
from rnc_pin.motion.optimal.sequential_quadratic import SequentialQuadratic
from rnc_pin.motion.planning.action_models import Form
from rnc_pin.robots.robot_files import find_example

_VARIABLE = "RNC_PIN_CROCODDYL"
_SCRIPT = Path(__file__).parent / "peers" / "crocoddyl_arm.py"
_NODES, _DURATION, _LIMIT, _ROUNDS = 40, 1.0, 25.0, 7
_START, _GOAL = [0.0, -0.6, 0.0, -2.0, 0.0, 1.5, 0.7], [0.6, 0.1, 0.2, -1.4, 0.1, 1.8, 0.9]
_RUNNING, _TERMINAL = (0.1, 0.01, 1e-4), (10.0, 1.0)  # weights of posture, velocities and efforts
_SAME = 2e-2  # relative difference of optimal costs by the midpoint rule here and by Euler's rule there

_Result = TypeVar("_Result")


def peers() -> None:
    """Print processor times of solutions, plans and updates here, and of solutions by Crocoddyl."""
    reduced, q0, goal, costs = _arm()
    model = action_model(reduced, "dynamic")
    guess = along(model, np.linspace(q0, goal, _NODES + 1), _DURATION)
    print(f"Panda, {_NODES} intervals, torques; processor time, least of {_ROUNDS} [ms]; costs")
    here = []
    for bounds in ((), (InputBound(-_LIMIT, _LIMIT),)):
        problem = build_problem(model, initial_node(model, q0), None, _DURATION, costs, bounds, _NODES)
        taken, found = _least(lambda each=problem: SequentialQuadratic(each, SolverSettings()).solve(guess))
        options = {"form": "dynamic", "costs": costs, "limits": None, "bounds": bounds}
        whole, plan = _least(lambda given=options: rnc.optimal.plan(reduced, q0, None, _DURATION, **given))
        here.append(found.cost)
        solved = f"solve {taken:.1f} in {found.iterations} iterations, {found.cost:.5f}"
        print(f"  here, {_words(bool(bounds))}: {solved}; plan() {whole:.1f}, {plan.info.cost:.5f}", flush=True)
    print(f"  here, update of predictive control, {_update(reduced, q0, costs, _LIMIT, _DURATION)}")
    beside(reduced.robot, goal, here)


def updates() -> None:
    """Print processor times of updates of predictive control within bounds of the inputs, one iteration each."""
    print(f"updates within bounds of the inputs, one iteration, {_NODES} intervals; processor time [ms]", flush=True)
    reduced, q0, _, costs = _arm()
    print(f"  Panda, torques: {_update(reduced, q0, costs, _LIMIT, _DURATION)}", flush=True)
    tip = rnc.FramePosition("tip", "xy")
    tips: dict[str, tuple[rnc.ReducedModel, Form, float, rnc.FramePosition, list[float]]] = {
        "mobile manipulator, forces": (mobile_manipulator(), "dynamic", 4.0, tip, [2.4, 0.3]),
        "TIAGo, accelerations": (tiago(), "acceleration", 1.0, rnc.FramePosition("arm_7_link"), [0.9, 0.3, 0.9]),
    }
    for name, (reduced, form, limit, tip, target) in tips.items():
        costs = [EffortCost(1e-3), VelocityCost(0.3, phase="both"), OutputCost(tip, target, 10.0, "both")]
        print(f"  {name}: {_update(reduced, reduced.robot.configuration(), costs, limit, 2.0, form)}", flush=True)


def _arm() -> tuple[rnc.ReducedModel, np.ndarray, np.ndarray, list[CostKind]]:
    """Model, start, goal and costs of the arm."""
    fingers = {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}
    robot = rnc.Robot.from_example("panda", lock=fingers)
    reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce()
    q0, goal = (robot.configuration(dict(zip(robot.joint_names, each, strict=True))) for each in (_START, _GOAL))
    posture, velocity, effort = _RUNNING
    costs: list[CostKind] = [
        EffortCost(effort),
        PostureCost(goal, posture),
        VelocityCost(velocity),
        PostureCost(goal, _TERMINAL[0], phase="terminal"),
        VelocityCost(_TERMINAL[1], phase="terminal"),
    ]
    return reduced, q0, goal, costs


def _words(bounded: bool) -> str:
    return "with bounds" if bounded else "without bounds"


def _least(call: Callable[[], _Result]) -> tuple[float, _Result]:
    """Least processor time of some calls [ms], and the last result."""
    taken = []
    for _ in range(_ROUNDS):
        begin = time.process_time()
        found = call()
        taken.append(1e3 * (time.process_time() - begin))
    return min(taken), found


def _update(
    reduced: rnc.ReducedModel,
    q: np.ndarray,
    costs: list[CostKind],
    limit: float,
    horizon: float,
    form: Form = "dynamic",
) -> str:
    """Processor time of the updates of a controller that drives a robot from rest, after the first three [ms]."""
    bounds = [InputBound(-limit, limit)]
    controller = PredictiveController(reduced, costs, horizon, form=form, bounds=bounds, nodes=_NODES)
    model, period = action_model(reduced, form), controller.updates.period
    now, state, taken, bounded = Nodes(q[None], np.zeros((1, reduced.r))), None, [], 0.0
    for k in range(20):
        measurement = reduced.at(now.q[0], now.w[0]).measure(np.zeros(reduced.r))
        state = controller.initial_state(measurement) if state is None else state
        begin = time.process_time()
        _, state = controller.step(k * period, measurement, state)
        taken.append(1e3 * (time.process_time() - begin))
        bounded = max(bounded, float(np.mean(np.abs(state.u) > limit - 1e-4)))
        now = model.step(now, state.u[:1], np.array([period]))  # the new motion starts at the measured state
    share = f"up to {bounded:.0%} of the inputs at a bound"
    return f"least {min(taken[3:]):.1f}, median {np.median(taken[3:]):.1f}; {share}, {state.missed} missed"


def beside(robot: rnc.Robot, goal: np.ndarray, here: list[float]) -> None:
    """Print what Crocoddyl finds, if it is there and computes the same accelerations."""
    generator, n = np.random.default_rng(0), robot.nv
    states = [(robot.random_configuration(generator), *generator.normal(size=(2, n))) for _ in range(5)]
    problem = {
        "urdf": str(find_example("panda")[0]),
        "joints": list(robot.joint_names),
        "states": [[each.tolist() for each in state] for state in states],
        "goal": goal.tolist(),
        "running": _RUNNING,
        "terminal": _TERMINAL,
        "h": _DURATION / _NODES,
        "limit": _LIMIT,
        "rounds": _ROUNDS,
        "start": _START,
        "nodes": _NODES,
    }
    found = answer("Crocoddyl", _VARIABLE, _SCRIPT, problem)
    if found is None:
        return
    data = robot.model.createData()
    exact = np.array([pin.aba(robot.model, data, *state) for state in states])
    error = float(np.abs(np.array(found["accelerations"]) - exact).max() / np.abs(exact).max())
    if error > 1e-8:
        print(f"  Crocoddyl {found['version']} computes other accelerations, relative error {error:.1e}: not timed")
        return
    for bounded, each in enumerate(found["solutions"]):
        apart = abs(each["cost"] / here[bounded] - 1)
        within = not bounded or each["effort"] <= _LIMIT * (1 + 1e-6)
        same = "" if apart < _SAME and each["feasible"] and within else ", NOT the same optimum"
        name, solved = f"Crocoddyl {found['version']}, {_words(bool(bounded))}", f"solve {1e3 * each['time']:.1f}"
        print(f"  {name}: {solved} in {each['iterations']} iterations, {each['cost']:.5f}{same}")
