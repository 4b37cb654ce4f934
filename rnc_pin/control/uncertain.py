"""Any controller where constraints are not known: kinematics and allocation of the estimates. Paper (14)-(21)."""

from __future__ import annotations

from typing import NamedTuple

from rnc_pin.control.estimator import Estimator, EstimatorState, believed
from rnc_pin.control.protocol import Command, Controller, Description, State, describe
from rnc_pin.model.measurement import Measurement
from rnc_pin.printing import ReprMixin


class UncertainState(NamedTuple):
    """What has been learnt, and what the controller under it remembers."""

    estimator: EstimatorState
    controller: State


class UncertainController(ReprMixin):
    """Certainty equivalence: a controller sees the kinematics of the estimates, which also allocate what it asks for.

    Once a sample the estimates are improved by (20); then the controller is shown ``A_star`` and its rate as the
    estimated constraints have them; then the reduced force F that it asks for is allocated by the estimated
    ``R^T B``. Under a momentum constraint that matrix depends on the unknown masses through R: who allocates by the
    true one knows them. With (12) this is (16), and any other controller of this package will do: for class 2 the
    same law, for class 2s ``SteeringController``, for class 3 a ``SplitController``.

    Nothing that decides an input reads true values of what is unknown, as long as whatever needs a model under the
    controller, and gains that are scaled to an inertia, are made from ``estimator.model``.

    Reads from the measurement: ``q, v, v2``, and what its controller reads. One state at a time.

    Args:
        estimator: what is unknown, and how it is learnt.
        controller: what decides the reduced force.

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
        """Gain, first estimates and bounds of the estimation, and the controller under it."""
        return {
            "type": type(self).__name__,
            **self.estimator.describe(),
            "controller": describe(self.controller),
        }

    def initial_state(self, measurement: Measurement) -> UncertainState:
        """The first estimates, and what the controller starts with where they hold."""
        state = self.estimator.initial_state()
        seen = believed(measurement, self.estimator.model.at(measurement.q, measurement.v2))
        return UncertainState(state, self.controller.initial_state(seen))

    def step(self, t: float, measurement: Measurement, state: UncertainState) -> tuple[Command, UncertainState]:
        learnt, error = self.estimator.step(t, measurement, state.estimator)
        guess = self.estimator.model.at(measurement.q, measurement.v2)
        command, inner = self.controller.step(t, believed(measurement, guess), state.controller)
        if command.F is not None:
            command = command._replace(F=None, T=guess.allocate(command.F))
        return command._replace(estimates=learnt.p, prediction_error=error), UncertainState(learnt, inner)
