"""Evaluations of a model along a roll-out, each computed once; the checks of a reference read them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.analysis import LiftOff, NormalForces, first_lift_off
from rnc_pin.array_shapes import Float
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.configuration_evaluation import ConfigurationEvaluation
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.model.task import Task


@dataclass(frozen=True)
class Margin:
    """Smallest singular value along a reference.

    Attributes:
        value: smallest singular value of the stack E with unit rows, or of A4.
        time: time of the minimum [s].
        q: configuration (nq,) of the minimum.
    """

    value: float
    time: float
    q: np.ndarray


class RolloutEvaluation:
    """Model along a sampled motion, such as a ``Rollout``. Each quantity is computed once, on first use.

    Velocities and accelerations are central differences. They exist at the inner samples, all but the first and last.

    Args:
        reduced: reduced model.
        times: evenly spaced times (N,) [s]; velocities need at least five.
        path: configurations (N, nq).

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> times = np.linspace(0.0, 1.0, 11)
        >>> path = np.array([robot.configuration({"root_joint": [0.5 * t**2, 0.0, 0.0]}) for t in times])
        >>> evaluation = rnc.simulation.RolloutEvaluation(reduced, times, path)
        >>> evaluation.states.v2[-1].round(6), evaluation.v2_dot[4].round(6)  # speed t at 0.9 s, acceleration 1 m/s^2
        (array([0.9, 0. ]), array([1., 0.]))
        >>> evaluation.inputs[4].round(6)  # the force is the mass of the sleigh
        array([2., 0.])
    """

    def __init__(self, reduced: ReducedModel, times: np.ndarray, path: np.ndarray) -> None:
        self._reduced, self._times, self._path = reduced, times, path

    @cached_property
    def configurations(self) -> ConfigurationEvaluation:
        """Model at all samples (N,)."""
        return self._reduced.at(self._path, t=self._times)

    @property
    def inner_times(self) -> Float[Array, " N-2"]:
        """Times of the inner samples [s]."""
        return self._times[1:-1]

    @cached_property
    def states(self) -> StateEvaluation:
        """Model at the inner samples (N - 2,), with velocities that satisfy the constraints."""
        model, path = self._reduced.robot.model, self._path
        change = np.array([pin.difference(model, before, after) for before, after in zip(path, path[2:], strict=False)])
        by_differences = self._reduced.at(path[1:-1], v=change / (2 * self._dt), t=self.inner_times)
        return StateEvaluation(by_differences, v2=by_differences.v2)

    @cached_property
    def v2_dot(self) -> Float[Array, "N-2 r"]:
        """Reduced accelerations at the inner samples."""
        return np.gradient(self.states.v2, self._dt, axis=0)

    @cached_property
    def inputs(self) -> Float[Array, "N-2 p"]:
        """Actuator inputs at the inner samples.

        Raises:
            ConstraintError: the actuators cannot produce these accelerations.
        """
        return self.states.allocate(self.states.inverse_dynamics(self.v2_dot))

    @property
    def _dt(self) -> float:
        return float(self._times[1] - self._times[0])

    def slowed(self, time_scale: float) -> tuple[StateEvaluation, Float[Array, "N-2 p"]]:
        """Return states and inputs of the inner samples for a motion that takes ``time_scale`` times as long.

        Raises:
            ConstraintError: the actuators cannot produce these accelerations.
        """
        states = StateEvaluation(self.states, v2=self.states.v2 / time_scale)
        return states, states.allocate(states.inverse_dynamics(self.v2_dot / time_scale**2))

    def stack_margin(self) -> Margin:
        """Return the smallest singular value of ``E = [A; J2]`` with scaled rows."""
        return self._margin(np.asarray(self.configurations.smallest_singular_value))

    def A4_margin(self, task: Task) -> Margin:
        """Return the smallest singular value of a task's A4."""
        A4 = self.configurations.A_star[:, task.vertical][:, :, task.redundant]
        return self._margin(np.linalg.svd(A4, compute_uv=False)[:, -1])

    def lift_off(self, normal: NormalForces) -> LiftOff | None:
        """Return the first contact that lifts off the ground; None if none does.

        Raises:
            ConstraintError: the actuators cannot produce these accelerations.
        """
        if not normal.contacts:
            return None
        return first_lift_off(self.inner_times, normal.at(self.states, self.inputs), normal.names)

    def _margin(self, values: np.ndarray) -> Margin:
        index = int(np.argmin(values))
        return Margin(float(values[index]), float(self._times[index]), self._path[index])
