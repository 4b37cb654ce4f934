"""Kinematic roll-out: motion that follows a velocity target exactly, without dynamics."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rnc_pin.control import KinematicController, RedundancyController
from rnc_pin.control.gain_design import OUTER_GAINS
from rnc_pin.integrators import LieRungeKutta4
from rnc_pin.model.input_validation import vector
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.model.task import Task
from rnc_pin.planning import TaskReference
from rnc_pin.simulation.ending import run_error


class Rollout(NamedTuple):
    """Sampled motion of a kinematic roll-out."""

    time: np.ndarray
    """(N,) [s]"""
    q: np.ndarray
    """(N, nq)"""


def kinematic_rollout(
    reduced: ReducedModel, target: KinematicController, q0: np.ndarray, duration: float, dt: float = 0.02
) -> Rollout:
    """Integrate the kinematics under ``v2 = v2d``, without dynamics. Return times (N,) and configurations (N, nq).

    Args:
        reduced: reduced model.
        target: kinematic controller.
        q0: initial configuration (nq,).
        duration: duration [s].
        dt: step [s]; it can be large, because there are no dynamics.

    Raises:
        SingularityError, DivergenceError: the reference reaches a singular configuration, or its rates grow without
            bound near one. The error has the time, and the roll-out so far in ``error.trajectory``.
        SimulationError: the target raises an error, which becomes the cause; ``error.trajectory`` as above.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> swing = rnc.planning.MinimumJerk(np.zeros(3), [0.5, 0.0, 0.0], duration=1.0)
        >>> target = rnc.control.ReducingOutputController(reduced, swing)
        >>> times, path = rnc.kinematic_rollout(reduced, target, robot.configuration(), duration=1.0)
        >>> path[-1, :2].round(2)  # the platform reacts to the arm
        array([-0.47,  0.5 ])
    """
    integrator, r = LieRungeKutta4(reduced.robot), reduced.r
    q, y, v2, t = np.array(q0, dtype=float), np.zeros(r), np.zeros(r), 0.0
    state = target.initial_state(reduced.at(q, v2, t=t).measure(y))
    times, path = [0.0], [q]

    def velocity(here: StateEvaluation, integrals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        desired = target.step(t, here.measure(integrals), state)[0].v2
        return here.velocity(desired), desired

    def rate(p: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        v, desired = velocity(reduced.at(p, v2, t=float(x[r])), x[:r])
        return v, np.append(desired, 1.0)

    try:
        for sample in range(1, round(duration / dt) + 1):
            # Targets use v2 only for their rates, so the last known v2 is sufficient.
            here = reduced.at(q, v2, t=t)
            command, next_state = target.step(t, here.measure(y), state)
            v2 = vector(command.v2, r, "v2")
            v, desired = velocity(StateEvaluation(here, v2=v2), y)
            q, x = integrator.step(rate, q, np.append(y, t), dt, (v, np.append(desired, 1.0)))
            state, t, y = next_state, sample * dt, x[:r]
            q = reduced.assembly.project(q, t=t)
            times.append(t)
            path.append(q)
    except Exception as error:
        failure = run_error(error, "the target", t)
        failure.trajectory = Rollout(np.array(times), np.stack(path))
        raise failure  # noqa: B904 (run_error sets the cause)
    return Rollout(np.array(times), np.stack(path))


def class_1_controller(task: Task, reference: TaskReference) -> RedundancyController:
    """Return the kinematic controller that follows a reference by default."""
    gains = OUTER_GAINS["scaled"]
    return RedundancyController(task, reference.primary, reference.vertical, k3=gains.k3, k21=gains.k21)
