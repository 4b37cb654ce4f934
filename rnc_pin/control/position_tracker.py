"""Adaptive position tracker: no rates, no model. Paper (8)-(9), Lemma 2."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import Command, DescribedMixin, check_size, elapsed_time, goals_at
from rnc_pin.control.feedback import fed_back, leak, saturation_mask
from rnc_pin.control.gain_design import PositionGains
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.coordinates import Coordinates, angle_difference
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.references.reference import Reference, ReferencePoint


class PositionState(NamedTuple):
    """State of the tracker, with leading batch axes."""

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
        return fed_back(1.0, angle_difference(desired.position, actual, self.angular), actual)

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
