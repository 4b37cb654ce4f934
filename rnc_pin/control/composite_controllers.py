"""Controllers around others: on some of the actuators, side by side, or under unknown constraints.

Paper 4.1, and (14)-(21) with Lemma 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rnc_pin.control.controller import Command, Controller, DescribedMixin, Description, State, describe
from rnc_pin.control.estimation import Estimator, EstimatorState, with_estimated_kinematics
from rnc_pin.control.trackers import PositionState, PositionTracker
from rnc_pin.errors import ConfigurationError, place_of
from rnc_pin.math.linear_algebra import apply_transposed
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import ReprMixin


def effective_inertia(reduced: ReducedModel, q: np.ndarray, outputs: np.ndarray, active: Sequence[str]) -> np.ndarray:
    """Return the inertia M that F21 moves while some actuators are off: ``x21ddot = M^-1 F21`` at rest.

    M serves to choose gains beforehand. It is not symmetric, because the joints that are off move along.

    Args:
        reduced: the model.
        q: configurations (..., nq).
        outputs: indices of x21 in x2, (k,).
        active: names of the actuators that are on; at least k.

    Returns:
        M, (..., k, k).

    Raises:
        ConfigurationError: unknown actuator, or fewer of them than outputs.
    """
    outputs = np.asarray(outputs, dtype=int)
    on = _places(reduced, active, outputs)
    here = reduced.at(q)
    drive = (here.J2 @ here.B)[..., outputs, :][..., on]
    forces = here.input_matrix[..., on] @ drive.mT
    # Accelerations of x21 by unit forces F21 through the active inputs: its inverse is the inertia that they move.
    response = np.linalg.solve(here.H, forces)[..., outputs, :]
    return np.linalg.inv(response)


class JacobianTransposeController(DescribedMixin):
    """``T = (J21 B)^T F21`` on the active actuators, zero on the others.

    F21 comes from (8)-(9), so the controller reads neither rates nor inertia. J21 is the Jacobian of the tracked
    outputs. If the first joint of the space robot is off, no force acts on the platform, and it stays at rest.

    Reads from the measurement: ``q, x2``.

    Args:
        reduced: model that provides the kinematics.
        tracker: position tracker of the outputs x21.
        active: actuators that are on, by name; at least as many as outputs.

    Raises:
        ConfigurationError: unknown actuator, or fewer of them than outputs.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")])
        >>> tracker = rnc.control.PositionTracker(rnc.planning.Hold([1.0, 1.0]), outputs=np.array([0, 1]))
        >>> controller = rnc.control.JacobianTransposeController(reduced, tracker, ["joint_2", "joint_3"])
        >>> measurement = reduced.at(robot.configuration({"joint_2": 1.8}), np.zeros(3)).measure()
        >>> command, state = controller.step(0.0, measurement, controller.initial_state(measurement))
        >>> command.T.shape, float(command.T[0])  # joint_1 is off
        ((3,), 0.0)
    """

    described = ("active", "tracker")

    def __init__(self, reduced: ReducedModel, tracker: PositionTracker, active: Sequence[str]) -> None:
        self.tracker, self.active = tracker, tuple(active)
        self._reduced, self._active = reduced, _places(reduced, active, tracker.outputs)

    def initial_state(self, measurement: Measurement) -> PositionState:
        """Return the initial state of the tracker.

        Args:
            measurement: first measurement.
        """
        return self.tracker.initial_state(measurement)

    def step(self, t: float, measurement: Measurement, state: PositionState) -> tuple[Command, PositionState]:
        command, state = self.tracker.step(t, measurement, state)
        assert command.F is not None
        here = self._reduced.at(measurement.q)
        # Inputs (J21 B)^T F21 do the work of F21 on x21, whatever the passive joints do.
        drive = (here.J2 @ here.B)[..., self.tracker.outputs, :][..., self._active]
        T = np.zeros((*command.F.shape[:-1], self._reduced.p))
        T[..., self._active] = apply_transposed(drive, command.F)
        # As T: an allocation of F would use the actuators that are off.
        return command._replace(F=None, T=T), state


def _places(reduced: ReducedModel, active: Sequence[str], outputs: np.ndarray) -> np.ndarray:
    places = [place_of(name, reduced.actuation.names, "no actuator") for name in active]
    twice = [name for name in dict.fromkeys(active) if list(active).count(name) > 1]
    # It would count as two actuators below.
    if twice:
        raise ConfigurationError(f"active actuator '{twice[0]}' is named twice")
    # k forces F21 need k inputs at least, or J21 B has no full rank.
    if len(active) < len(outputs):
        raise ConfigurationError(f"{len(active)} active actuators cannot drive {len(outputs)} outputs")
    return np.array(places, dtype=int)


class SplitController(ReprMixin):
    """Controller of several parts; each measures and commands its own reducing outputs.

    The coupling forces between the parts are disturbances. The measurement of a part has ``x2`` and ``v2`` of its own
    outputs only; all other fields are complete.

    Args:
        parts: controllers and the indices of their outputs in x2.
        r: number of reducing outputs; each has to belong to one part.

    Raises:
        ConfigurationError: an output belongs to no part, or to two.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> arm = rnc.control.PositionTracker(rnc.planning.Hold([0.1, 1.8]))
        >>> hand = rnc.control.PositionTracker(rnc.planning.Hold([0.2]))
        >>> controller = rnc.control.SplitController([(arm, [0, 1]), (hand, [2])], r=3)
        >>> measurement = reduced.at(robot.configuration({"joint_2": 1.8}), np.zeros(3)).measure()
        >>> command, state = controller.step(0.0, measurement, controller.initial_state(measurement))
        >>> command.F.round(6)  # the error of joint_3 is twice that of joint_1
        array([4., 0., 8.])
    """

    def __init__(self, parts: Sequence[tuple[Controller, np.ndarray]], r: int) -> None:
        self._parts = [(controller, np.asarray(outputs, dtype=int)) for controller, outputs in parts]
        self._r = r
        places = np.concatenate([outputs for _, outputs in self._parts])
        # An output of no part would get no force, and one of two parts that of the last part.
        if sorted(places.tolist()) != list(range(r)):
            raise ConfigurationError(
                f"the parts command outputs {sorted(places.tolist())}, expected each of 0 to {r - 1} once"
            )

    def describe(self) -> Description:
        """Return the descriptions of the parts, and the indices of their outputs in x2."""
        parts = [{**describe(part), "outputs": outputs.tolist()} for part, outputs in self._parts]
        return {"type": type(self).__name__, "parts": parts}

    def initial_state(self, measurement: Measurement) -> tuple[State, ...]:
        """Return the initial states of the parts.

        Args:
            measurement: first measurement.
        """
        return tuple(controller.initial_state(_part(measurement, outputs)) for controller, outputs in self._parts)

    def step(self, t: float, measurement: Measurement, state: tuple[State, ...]) -> tuple[Command, tuple[State, ...]]:
        shape = measurement.x2.shape
        # NaN where no part tells its target: plots leave it out.
        F, v2, x2 = np.empty(shape), np.full(shape, np.nan), np.full(shape, np.nan)
        x1: np.ndarray | None = None
        states = []
        for (controller, outputs), own in zip(self._parts, state, strict=True):
            command, own = controller.step(t, _part(measurement, outputs), own)
            states.append(own)
            F[..., outputs] = command.F
            for goals, known in ((v2, command.v2_desired), (x2, command.x2_desired)):
                if known is not None:
                    goals[..., outputs] = known
            # Every part sees all vertical outputs: the first one with goals tells them.
            x1 = command.x1_desired if x1 is None else x1
        return Command(F=F, v2_desired=v2, x1_desired=x1, x2_desired=x2), tuple(states)

    def _settings(self) -> dict[str, object]:
        return {"parts": [controller for controller, _ in self._parts]}


def _part(measurement: Measurement, outputs: np.ndarray) -> Measurement:
    # A part whose actuators are saturated stops learning; the others go on.
    deficit = measurement.force_deficit
    return measurement._replace(
        x2=measurement.x2.take(outputs, axis=-1),
        v2=measurement.v2.take(outputs, axis=-1),
        force_deficit=None if deficit is None else deficit.take(outputs, axis=-1),
    )


class UncertainState(NamedTuple):
    """States of the estimator and of the inner controller."""

    estimator: EstimatorState
    target: State


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
        self.estimator, self.target = estimator, controller  # findings and goals are those of the target

    def describe(self) -> Description:
        """Return gain, first estimates and bounds of the estimator, and the inner controller."""
        return {"type": type(self).__name__, **self.estimator.describe(), "controller": describe(self.target)}

    def initial_state(self, measurement: Measurement) -> UncertainState:
        """Return the first estimates, and the initial state of the controller under them.

        Args:
            measurement: first measurement.
        """
        state = self.estimator.initial_state()
        # The controller must not see the true kinematics, not even in its first state.
        seen = with_estimated_kinematics(measurement, self.estimator.model.at(measurement.q, measurement.v2))
        return UncertainState(state, self.target.initial_state(seen))

    def step(self, t: float, measurement: Measurement, state: UncertainState) -> tuple[Command, UncertainState]:
        # The estimates first, so that the law (16) of this sample has them.
        learnt, error = self.estimator.step(t, measurement, state.estimator)
        estimate = self.estimator.model.at(measurement.q, measurement.v2)
        command, inner = self.target.step(t, with_estimated_kinematics(measurement, estimate), state.target)
        # Allocated here: the loop would allocate by the true R^T B, which depends on the unknown parameters.
        if command.F is not None:
            command = command._replace(F=None, T=estimate.allocate(command.F))
        return command._replace(estimates=learnt.p, prediction_error=error), UncertainState(learnt, inner)
