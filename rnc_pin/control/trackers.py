"""Adaptive trackers without a model: of positions, paper (8)-(9), Lemma 2; and of velocities, paper (10), Lemma 3."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import (
    Command,
    DescribedMixin,
    KinematicController,
    State,
    check_size,
    check_target,
    command_towards,
    elapsed_time,
    goals_at,
)
from rnc_pin.control.feedback import apply_dead_zone, fed_back, leak, saturation_mask
from rnc_pin.control.gain_design import PositionGains, VelocityGains
from rnc_pin.errors import ConfigurationError
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.references.reference import Reference, ReferencePoint


class PositionState(NamedTuple):
    """State of a ``PositionTracker``, with leading batch axes."""

    time: float | None
    z: Float[Array, "*batch k"]
    """``w - gamma^2 e``, the state of the filter."""
    learnt: Float[Array, "*batch k n"]
    """Adaptive gains ``[f, A, B]`` of (9): a row for each output, of 1 + 2 k numbers."""
    by_error: Float[Array, "*batch k n"]
    """Their part ``beta e y^T`` at the last sample, which the error gives without integration."""


class PositionTracker(DescribedMixin):
    """``F = A x2d_ddot + B x2d_dot + f + k1 gamma^2 w + k2 gamma^2 e``, paper (8)-(9), without rates.

    The paper's laws contain ``edot``: the scan drops a dot from ``fdot = -sigma f + beta q_f`` with
    ``q_f = edot + k2 e / (k1 gamma) - w / gamma``. With ``L = [f, A, B]`` and ``y = [1, x2d_ddot, x2d_dot]`` all three
    are ``Ldot = -sigma L + beta q_f y^T``. Integrated by parts, they need positions only:

        w = z + gamma^2 e                      zdot  = -2 gamma w
        L = L' + beta e y^T                    L'dot = -sigma L + beta (q y^T - e ydot^T)

    with ``q = k2 e / (k1 gamma) - w / gamma``. Filter and leak are exact over a sample.

    For an output with saturated actuators, the learnt force does not grow in the saturated direction
    (``control.feedback``). For an output with an error within the dead zone, it does not change at all.

    Reads from the measurement: ``x2``, and ``force_deficit`` if available.

    Args:
        reference: reference of the tracked outputs.
        gains: k1, k2, gamma, beta, sigma, dead zone; the paper's by default.
        outputs: indices of the tracked outputs in x2; all by default. F has their length.
        angular: mask of the outputs that are angles, or the coordinates of the outputs.
        gravity_compensation: force at the start (k,): force on these outputs that holds the robot, as its actuators
            report at rest. The tracker learns f in addition. Zero by default.

    Raises:
        ConfigurationError: an output is an orientation: integration by parts needs errors that are plain differences.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> controller = rnc.control.PositionTracker(rnc.planning.Hold([0.1, 1.8, 0.0]))
        >>> measurement = reduced.at(robot.configuration({"joint_2": 1.8}), np.zeros(3)).measure()
        >>> command, state = controller.step(0.0, measurement, controller.initial_state(measurement))
        >>> command.F.round(6)  # only joint_1 has an error
        array([4., 0., 0.])
    """

    described = ("gains", "gravity_compensation")

    def __init__(
        self,
        reference: Reference,
        gains: PositionGains | None = None,
        outputs: np.ndarray | None = None,
        angular: np.ndarray | Coordinates | None = None,
        gravity_compensation: np.ndarray | None = None,
    ) -> None:
        if isinstance(angular, Coordinates):
            if angular.rotations:
                raise ConfigurationError(
                    "the position tracker (8)-(9) takes outputs on lines and circles, not orientations"
                )
            angular = angular.angular
        self.reference = reference
        self.gains = PositionGains() if gains is None else gains
        self.outputs = np.arange(reference.size) if outputs is None else np.asarray(outputs, dtype=int)
        self.angular = np.zeros(reference.size, dtype=bool) if angular is None else np.asarray(angular, dtype=bool)
        self._coordinates = Coordinates(self.angular)
        self.gravity_compensation = np.asarray(0.0 if gravity_compensation is None else gravity_compensation, float)
        check_size(reference, len(self.outputs), "tracked")

    def initial_state(self, measurement: Measurement) -> PositionState:
        """Return zero adaptive gains, and the filter at rest at the present error.

        Args:
            measurement: first measurement.
        """
        desired = self.reference.at(0.0)
        error = self._error(desired, measurement)
        by_error = (self.gains.beta * error)[..., None] * _regressor(desired)
        # w = z + gamma^2 e is zero: a filter at rest adds no force to the first sample.
        return PositionState(None, -(self.gains.gamma**2) * error, np.zeros(by_error.shape), by_error)

    def _error(self, desired: ReferencePoint, measurement: Measurement) -> np.ndarray:
        actual = measurement.x2[..., self.outputs]
        # The gain 1 refuses an output without a value, which would make all that is learnt NaN.
        return fed_back(1.0, self._coordinates.difference(desired.position, actual), actual)

    def step(self, t: float, measurement: Measurement, state: PositionState) -> tuple[Command, PositionState]:
        """Compute one sample; the sampling interval may vary.

        Args:
            t: time of the sample [s].
            measurement: measurement at that time.
            state: state of the last sample.

        Raises:
            InputError: time runs backwards.
        """
        elapsed = elapsed_time(t, state.time)
        g, desired = self.gains, self.reference.at(t)
        e = self._error(desired, measurement)
        # z' = -2 gamma (z + gamma^2 e) with constant e over the sample.
        fade = np.exp(-2.0 * g.gamma * elapsed)
        z = fade * state.z - (1.0 - fade) * g.gamma**2 * e
        w = z + g.gamma**2 * e
        q = (g.k2 / (g.k1 * g.gamma)) * e - w / g.gamma
        y, y_dot = _regressor(desired), np.concatenate([[0.0], desired.jerk, desired.acceleration])
        by_error = (g.beta * e)[..., None] * y
        decay, leak_time = leak(g.sigma, elapsed)
        # The leak acts on L = L' + beta e y^T, so L' has it of the second part as a source.
        source = (g.beta * q)[..., None] * y - (g.beta * e)[..., None] * y_dot - g.sigma * by_error
        learnt = decay * (state.learnt - state.by_error) + leak_time * source + by_error
        frozen = np.abs(e) < g.dead_zone
        if measurement.force_deficit is not None:
            # Not the sign of e, as in (10): here q decides how the learnt force changes.
            added = (learnt - state.learnt) @ y
            frozen = frozen | saturation_mask(measurement.force_deficit[..., self.outputs], added)
        # The whole L stays and not L', so that the force follows the reference with unchanged gains.
        learnt = np.where(frozen[..., None], state.learnt, learnt)
        F = learnt @ y + g.k1 * g.gamma**2 * w + g.k2 * g.gamma**2 * e + self.gravity_compensation
        size = measurement.x2.shape
        v2d, x2d = (goals_at(each, self.outputs, size) for each in (desired.velocity, desired.position))
        return Command(F=F, v2_desired=v2d, x2_desired=x2d), PositionState(t, z, learnt, by_error)


def _regressor(desired: ReferencePoint) -> np.ndarray:
    """Regressor y (1 + 2 k,) of the learnt force."""
    return np.concatenate([[1.0], desired.acceleration, desired.velocity])


class TrackerState(NamedTuple):
    """State of a ``VelocityTracker``, with leading batch axes."""

    time: float | None
    learnt: Float[Array, "*batch r w"]
    """Adaptive gains ``[g, C, D]``: a row for each reducing velocity, of 1 + r + r^2 numbers."""
    target: State
    """State of the kinematic controller."""

    @property
    def g(self) -> Float[Array, "*batch r"]:
        """Learnt force."""
        return self.learnt[..., 0]

    @property
    def C(self) -> Float[Array, "*batch r r"]:
        """Learnt gains of the desired acceleration."""
        return self.learnt[..., 1 : 1 + self.learnt.shape[-2]]

    @property
    def D(self) -> Float[Array, "*batch r r2"]:
        """Learnt gains of the products of velocities."""
        return self.learnt[..., 1 + self.learnt.shape[-2] :]


class VelocityTracker(DescribedMixin):
    """``F = C v2d_dot + D [v2 v2d] + g + k e_v`` with gains learnt from ``e_v = v2d - v2``, paper (10).

    The scan of the paper omits the third law, ``Ddot = -sigma D + beta e_v [v2 v2d]^T``. In discrete time the leak is
    exact over a sample. The step along the regressor w is bounded: one sample adds at most ``k e_v`` to F, however
    large ``beta |w|^2 dt`` is (explicit Euler diverges above 2). For small steps both are the paper's.

    With a dead zone z the laws use only the part of ``e_v`` beyond z. For an output within the zone, adaptation and
    leak stop. So velocity noise below z causes no drift (``control.feedback``); only the feedback k corrects errors
    below z. For an output with saturated actuators, the learnt force does not grow in the saturated direction
    (``control.feedback``).

    With modes S in the gains, all of this holds for the mode velocities ``S^T v2``, with ``F = S F'``: F' follows from
    the same law, and so do its learnt gains. The modes have the same power ``F^T v2``.

    Reads from the measurement: ``v2``, ``force_deficit`` if available, and the quantities that its kinematic
    controller reads.

    Args:
        target: kinematic controller that computes ``v2d`` and its rate.
        gains: k, beta, sigma, dead zone.
        gravity_compensation: force at the start (r,): reduced force that holds the robot, as its actuators report at
            rest. The tracker learns g in addition. Zero by default: a robot under gravity then drops until g has grown.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> target = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([1.0, 0.0]), k2=2.0)
        >>> controller = rnc.control.VelocityTracker(target)
        >>> measurement = reduced.at(robot.configuration(), np.zeros(2)).measure(np.zeros(2))
        >>> command, state = controller.step(0.0, measurement, controller.initial_state(measurement))
        >>> command.F  # k e_v: nothing is learnt at the first sample
        array([20.,  0.])
    """

    described = ("gains", "gravity_compensation", "target")

    def __init__(
        self,
        target: KinematicController,
        gains: VelocityGains | None = None,
        gravity_compensation: np.ndarray | None = None,
    ) -> None:
        check_target(target)
        self.target = target
        self.gains = VelocityGains() if gains is None else gains
        self.gravity_compensation = np.asarray(0.0 if gravity_compensation is None else gravity_compensation, float)
        self._dead_zone, self._offset = np.asarray(self.gains.dead_zone), self.gravity_compensation
        self._modes = S = self.gains.modes
        if S is not None:
            r = len(S)
            self._dead_zone = np.abs(S.T) @ np.broadcast_to(self._dead_zone, r)  # bound on the noise of a mode
            # Forces are F = S F': the offset of the outputs in the axes of the modes.
            self._offset = np.linalg.solve(S, np.broadcast_to(self._offset, r))
        self._has_dead_zone = bool(np.any(self._dead_zone))

    def initial_state(self, measurement: Measurement) -> TrackerState:
        """Return zero adaptive gains.

        Args:
            measurement: first measurement.
        """
        # Nothing is known of the robot: zero gains leave the feedback k e_v alone at the start.
        *batch, r = np.shape(measurement.v2)
        return TrackerState(None, np.zeros((*batch, r, 1 + r + r * r)), self.target.initial_state(measurement))

    def step(self, t: float, measurement: Measurement, state: TrackerState) -> tuple[Command, TrackerState]:
        """Compute one sample; the sampling interval may vary.

        Args:
            t: time of the sample [s].
            measurement: measurement at that time.
            state: state of the last sample.

        Raises:
            InputError: time runs backwards.
        """
        share, leak_time = leak(self.gains.sigma, elapsed_time(t, state.time))
        target, target_state = self.target.step(t, measurement, state.target)
        v2, v2d, v2d_dot, deficit = measurement.v2, target.v2, target.v2_dot, measurement.force_deficit
        if (S := self._modes) is not None:
            v2, v2d, v2d_dot = (apply(S.T, each) for each in (v2, v2d, v2d_dot))
            deficit = None if deficit is None else np.linalg.solve(S, deficit[..., None])[..., 0]
        *batch, r = v2.shape
        # The regressor w = [1, v2d_dot, v2 v2d]: all three laws are one, with one matrix of gains.
        w = np.empty((*batch, 1 + r + r * r))
        w[..., 0], w[..., 1 : 1 + r] = 1.0, v2d_dot
        w[..., 1 + r :] = (v2[..., :, None] * v2d[..., None, :]).reshape(*batch, r * r)
        error = seen = v2d - v2
        frozen: np.ndarray | None = None
        if self._has_dead_zone:
            seen = apply_dead_zone(error, self._dead_zone)
            frozen = seen == 0.0
        if deficit is not None:
            saturated = saturation_mask(deficit, error)
            frozen = saturated if frozen is None else frozen | saturated
        # |w|^2 bounds the step: one sample adds at most k e_v.
        gain = leak_time * self.gains.beta
        step = gain / (1.0 + gain * np.vecdot(w, w)[..., None] / self.gains.k) * seen
        learnt = share * state.learnt + step[..., None] * w[..., None, :]
        if frozen is not None:
            learnt = np.where(frozen[..., None], state.learnt, learnt)
        # With the gains after the step, as its bound assumes.
        F = apply(learnt, w) + self.gains.k * error + self._offset
        return command_towards(target, F if S is None else apply(S, F)), TrackerState(t, learnt, target_state)
