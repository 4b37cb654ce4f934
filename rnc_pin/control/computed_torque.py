"""Computed torque: the model-based baseline for the adaptive trackers."""

from __future__ import annotations

import numpy as np

from rnc_pin.control.batches import accepts_batches
from rnc_pin.control.controller import Command, DescribedMixin, KinematicController, command_towards
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduced_model import ReducedModel


class ComputedTorque(DescribedMixin):
    """``F = H (v2d_dot + k (v2d - v2)) + V v2 + G``: the velocity error decays as exp(-k t).

    Unlike the adaptive trackers, it reads the model. Reads from the measurement: ``q, v2``, and the quantities that its
    kinematic controller reads.

    Args:
        reduced: the model.
        target: kinematic controller that computes ``v2d`` and its rate.
        k: [1/s]; a number or one for each output.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> target = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([1.0, 0.0]), k2=2.0)
        >>> controller = rnc.control.ComputedTorque(reduced, target, k=20.0)
        >>> state = reduced.at(robot.configuration(), np.zeros(2))
        >>> measurement = state.measure(np.zeros(2))
        >>> command, _ = controller.step(0.0, measurement, controller.initial_state(measurement))
        >>> np.linalg.solve(state.H, command.F).round(6)  # the acceleration k k2 e
        array([40.,  0.])
    """

    described = ("k", "target")

    def __init__(self, reduced: ReducedModel, target: KinematicController, k: float | np.ndarray = 20.0) -> None:
        self._reduced, self.target, self.k = reduced, target, k

    @property
    def accepts_batches(self) -> bool:
        """True if the kinematic controller accepts batches."""
        return accepts_batches(self.target)

    def initial_state(self, measurement: Measurement) -> object:
        """Return the initial state of the kinematic controller."""
        return self.target.initial_state(measurement)

    def step(self, t: float, measurement: Measurement, state: object) -> tuple[Command, object]:
        target, state = self.target.step(t, measurement, state)
        rate = target.v2_dot + self.k * (target.v2 - measurement.v2)
        q, v2 = measurement.q, measurement.v2
        evaluator = self._reduced.evaluator
        of_runs = v2.ndim == 2
        F = (evaluator.inverse_dynamics_of_runs if of_runs else evaluator.inverse_dynamics)(q, v2, rate, t)
        return command_towards(target, F), state
