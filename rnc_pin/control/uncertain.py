"""Any controller under unknown constraints: kinematics and allocation use the estimates. Paper (14)-(21)."""

from __future__ import annotations

from typing import NamedTuple

from rnc_pin.control.controller import Command, Controller, Description, State, describe
from rnc_pin.control.estimator import Estimator, EstimatorState, with_estimated_kinematics
from rnc_pin.model.measurement import Measurement
from rnc_pin.printing import ReprMixin


class UncertainState(NamedTuple):
    """States of the estimator and of the inner controller."""

    estimator: EstimatorState
    controller: State


class UncertainController(ReprMixin):
    """Certainty equivalence: the inner controller and the allocation use the estimated kinematics.

    Each sample has three steps. The estimator updates the estimates by (20). The controller receives ``A_star`` and its
    rate from the estimated constraints. The estimated ``R^T B`` allocates its reduced force F to the actuators. Under a
    momentum constraint ``R^T B`` depends on the unknown masses through R. So an allocation by the true matrix would use
    the unknown masses. With (12) this is (16). Any other controller of this package works too: for class 2 the same
    law, for class 2s ``SteeringController``, for class 3 a ``SplitController``.

    No input depends on the true values of unknown parameters, under one condition: models for the inner controller, and
    gains that are scaled to an inertia, come from ``estimator.model``.

    Reads from the measurement: ``q, v, v2``, and the quantities that its controller reads. One state at a time.

    Args:
        estimator: estimator of the unknown parameters.
        controller: controller that computes the reduced force.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> unknown = rnc.control.MomentumRegressor(robot, "platform", [rnc.control.UnknownMass("joint_3")])
        >>> estimator = rnc.control.Estimator(reduced, unknown, initial=[14.0])
        >>> swing = rnc.planning.MinimumJerk(np.zeros(3), [0.5, 0.0, 0.0], duration=1.0)
        >>> target = rnc.control.ReducingOutputController(estimator.model, swing)
        >>> controller = rnc.control.UncertainController(estimator, rnc.control.VelocityTracker(target))
        >>> rnc.simulate(reduced, controller, robot.configuration(), duration=0.1, dt=0.01).estimates.shape
        (11, 1)
    """

    def __init__(self, estimator: Estimator, controller: Controller) -> None:
        self.estimator, self.controller = estimator, controller

    def describe(self) -> Description:
        """Return gain, first estimates and bounds of the estimator, and the inner controller."""
        return {
            "type": type(self).__name__,
            **self.estimator.describe(),
            "controller": describe(self.controller),
        }

    def initial_state(self, measurement: Measurement) -> UncertainState:
        """Return the first estimates, and the initial state of the controller under them."""
        state = self.estimator.initial_state()
        seen = with_estimated_kinematics(measurement, self.estimator.model.at(measurement.q, measurement.v2))
        return UncertainState(state, self.controller.initial_state(seen))

    def step(self, t: float, measurement: Measurement, state: UncertainState) -> tuple[Command, UncertainState]:
        learnt, error = self.estimator.step(t, measurement, state.estimator)
        estimate = self.estimator.model.at(measurement.q, measurement.v2)
        command, inner = self.controller.step(t, with_estimated_kinematics(measurement, estimate), state.controller)
        if command.F is not None:
            command = command._replace(F=None, T=estimate.allocate(command.F))
        return command._replace(estimates=learnt.p, prediction_error=error), UncertainState(learnt, inner)
