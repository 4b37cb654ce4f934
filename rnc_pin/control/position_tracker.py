"""Adaptive position tracker: no rates, no model. Paper (8)-(9), Lemma 2."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import Command, DescribedMixin, check_size, elapsed_time, goals_at
from rnc_pin.control.feedback import fed_back, leak, saturation_mask
from rnc_pin.control.gain_design import PositionGains
from rnc_pin.errors import ConfigurationError
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.coordinates import Coordinates, angle_difference
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.references.reference import Reference, ReferencePoint


class PositionState(NamedTuple):
    """State of the tracker, with leading batch axes. f, A and B are the primed parts from the integration by parts."""

    time: float | None
    z: Float[Array, "*batch k"]
    """``w - gamma^2 e``, the state of the filter."""
    f: Float[Array, "*batch k"]
    """``f - beta e``."""
    A: Float[Array, "*batch k k"]
    """``A - beta e x2d_ddot^T``."""
    B: Float[Array, "*batch k k"]
    """``B - beta e x2d_dot^T``."""
    e: Float[Array, "*batch k"]
    """Error at the last sample."""


class PositionTracker(DescribedMixin):
    """``F = A x2d_ddot + B x2d_dot + f + k1 gamma^2 w + k2 gamma^2 e``, paper (8)-(9), without rates.

    The paper's laws contain ``edot``: the scan drops a dot from ``fdot = -sigma f + beta q_f`` with
    ``q_f = edot + k2 e / (k1 gamma) - w / gamma``. Integrated by parts they need positions only:

        w = z + gamma^2 e                      zdot  = -2 gamma w
        f = f' + beta e                        f'dot = -sigma f + beta q
        A = A' + beta e x2d_ddot^T             A'dot = -sigma A + beta (q x2d_ddot^T - e x2d_dddot^T)
        B = B' + beta e x2d_dot^T              B'dot = -sigma B + beta (q x2d_dot^T - e x2d_ddot^T)

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
        self._has_dead_zone = bool(np.any(self.gains.dead_zone))
        self.outputs = np.arange(reference.size) if outputs is None else np.asarray(outputs, dtype=int)
        self.angular = np.zeros(reference.size, dtype=bool) if angular is None else np.asarray(angular, dtype=bool)
        self.gravity_compensation = np.asarray(0.0 if gravity_compensation is None else gravity_compensation, float)
        check_size(reference, len(self.outputs), "tracked")

    def initial_state(self, measurement: Measurement) -> PositionState:
        """Return zero adaptive gains, and the filter at rest at the present error.

        Args:
            measurement: first measurement.
        """
        error = self._error(0.0, measurement)
        k, gamma = error.shape[-1], self.gains.gamma
        nothing, point = np.zeros((*error.shape, k)), self.reference.at(0.0)
        # f, A and B are zero here; their primed parts are not.
        step = np.broadcast_to(self.gains.beta * error, error.shape)
        return PositionState(
            time=None,
            # So that w is zero: a filter at rest adds no force to the first sample.
            z=-(gamma**2) * error,
            f=-step,
            A=nothing - step[..., :, None] * point.acceleration,
            B=nothing - step[..., :, None] * point.velocity,
            e=error,
        )

    def _error(self, t: float, measurement: Measurement) -> np.ndarray:
        actual = measurement.x2[..., self.outputs]
        return fed_back(1.0, angle_difference(self.reference.at(t).position, actual, self.angular), actual)

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
        desired = self.reference.at(t)
        g = self.gains
        xd, xdd, xddd = desired.velocity, desired.acceleration, desired.jerk
        e = self._error(t, measurement)
        # z' = -2 gamma (z + gamma^2 e) with constant e over the sample.
        fade = np.exp(-2.0 * g.gamma * elapsed)
        z = fade * state.z - (1.0 - fade) * g.gamma**2 * e
        w = z + g.gamma**2 * e
        q = (g.k2 / (g.k1 * g.gamma)) * e - w / g.gamma
        decay, leak_time = leak(g.sigma, elapsed)
        step = g.beta * e
        drive = g.beta * q

        def adapt(primed: np.ndarray, regressor: np.ndarray, rate: np.ndarray) -> np.ndarray:
            gain = drive[..., :, None] * regressor - step[..., :, None] * (rate + g.sigma * regressor)
            return decay * primed + leak_time * gain

        f = decay * state.f + leak_time * (drive - g.sigma * step)
        A, B = adapt(state.A, xdd, xddd), adapt(state.B, xd, xdd)
        if measurement.force_deficit is not None or self._has_dead_zone:
            deficit = measurement.force_deficit
            deficit = np.zeros(e.shape) if deficit is None else deficit[..., self.outputs]
            f, A, B = self._freeze(deficit, np.abs(e) < g.dead_zone, state, desired, step, f, A, B)
        F = (
            apply(A + step[..., :, None] * xdd, np.broadcast_to(xdd, e.shape))
            + apply(B + step[..., :, None] * xd, np.broadcast_to(xd, e.shape))
            + (f + step)
            + g.k1 * g.gamma**2 * w
            + g.k2 * g.gamma**2 * e
            + self.gravity_compensation
        )
        size = measurement.x2.shape
        command = Command(
            F=F, v2_desired=goals_at(xd, self.outputs, size), x2_desired=goals_at(desired.position, self.outputs, size)
        )
        return command, PositionState(t, z, f, A, B, e)

    def _freeze(
        self,
        deficit: np.ndarray,
        in_dead_zone: np.ndarray,
        state: PositionState,
        desired: ReferencePoint,
        step: np.ndarray,
        f: np.ndarray,
        A: np.ndarray,
        B: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Primed f, A and B (8), frozen in the dead zone and where adaptation increases a saturated force."""
        # Primed parts contain the reference of the last sample: a force stays as it is only if they follow the new one.
        before = desired if state.time is None else self.reference.at(state.time)
        w, w_before = _regressor(desired), _regressor(before)
        # Primed values for an unchanged learnt force.
        unchanged = _stacked(state.f, state.A, state.B)
        unchanged = unchanged + (self.gains.beta * state.e)[..., None] * w_before - step[..., None] * w
        new = _stacked(f, A, B)
        frozen = in_dead_zone | saturation_mask(
            deficit, apply(new - unchanged, np.broadcast_to(w, (*step.shape[:-1], len(w))))
        )
        kept = np.where(frozen[..., None], unchanged, new)
        k = step.shape[-1]
        return kept[..., 0], kept[..., 1 : k + 1], kept[..., k + 1 :]


def _stacked(f: np.ndarray, A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Learnt f, A and B as one matrix (..., k, 1 + 2 k), whose product with the regressor is a force."""
    return np.concatenate([f[..., None], A, B], axis=-1)


def _regressor(desired: ReferencePoint) -> np.ndarray:
    return np.concatenate([[1.0], desired.acceleration, desired.velocity])
