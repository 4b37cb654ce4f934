"""Odometry of a base on wheels: motion of its joints to increments of its pose, by the constraint rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.control.actuator_velocity import driven_joints
from rnc_pin.control.wheeled_base import WheeledBase
from rnc_pin.errors import ConfigurationError, InputError
from rnc_pin.model.coordinates import arc_chord
from rnc_pin.model.input_validation import ArrayInput, ConfigurationValidator, vector
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import ReprMixin

_RANK = 1e-6  # smallest relative singular value of the columns of what is unknown
_UNKNOWN = 1e-6  # share of the base in a motion that the measured joints do not show


class OdometryStep(NamedTuple):
    """Pose after a motion of the joints."""

    pose: Float[Array, " 3"]
    """(x, y, heading) of the frame [m, m, rad]; the heading is not wrapped."""
    slip: float
    """Largest distance by which a row is not satisfied [m]: the joints' motion that no motion of the base explains."""


class OdometryIncrement(NamedTuple):
    """Motion of the frame between two configurations: a constant twist over unit time, in the axes of the frame."""

    motion: Float[Array, " 3"]
    """(forward, left, turn) [m, m, rad]."""
    slip: float
    """Largest distance by which a row is not satisfied [m]."""
    by_joints: Float[Array, "3 k"]
    """Derivatives by the motion of the measured joints."""
    by_rows: Float[Array, "3 m"]
    """Derivatives by the slip of the rows [m]."""


class WheelOdometry(ReprMixin):
    """Pose of a frame of the base from positions of joints alone.

    The rows hold for increments: ``A (base, joints) = 0`` at the configuration halfway, by least squares if there are
    more rows than unknowns. The increment is then integrated on SE(2). It is exact while the joints' rates and steering
    angles are constant, and of second order while the steering turns. Between two steps, joints without limits turn by
    less than half a turn.

    Args:
        reduced: the model; only its kinematics is used.
        frame: frame of the base, x forward and z up.
        measured: joints with encoders; by default those that the actuators drive. Other joints may have any position,
            except where the rows depend on it.

    Attributes:
        measured: names of the joints that are used.

    Raises:
        ModelError: unknown frame or joint.
        ConfigurationError: as for ``TwistController``, or the measured joints do not show the motion of the base.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"])
        >>> odometry = rnc.control.WheelOdometry(system.reduce(), "base")
        >>> before = robot.configuration()
        >>> after = robot.configuration({"left_wheel_joint": 2.0, "right_wheel_joint": 2.0})
        >>> odometry.step([1.0, 0.0, np.pi / 2], before, after).pose.round(6)
        array([1.      , 0.2     , 1.570796])
    """

    def __init__(self, reduced: ReducedModel, frame: str, measured: Sequence[str] | None = None) -> None:
        self.base, self._reduced = WheeledBase(reduced, frame), reduced
        self.frame, self.measured = frame, driven_joints(reduced) if measured is None else tuple(measured)
        robot = reduced.robot
        slices = [robot.velocity_indices(name) for name in self.measured]
        self._known = np.array([index for each in slices for index in range(each.start, each.stop)], dtype=int)
        self._hidden = np.setdiff1d(np.arange(reduced.n), [*self.base.base, *self._known])
        self._validator = ConfigurationValidator(robot)
        generator = np.random.default_rng(0)
        if max(self._unknown(*self.base.rows(reduced.random_configuration(generator))) for _ in range(3)) > _UNKNOWN:
            raise ConfigurationError(
                f"positions of {', '.join(self.measured) or 'no joint'} do not show the motion of '{frame}': expected "
                "encoders of more joints in 'measured'"
            )

    def step(self, pose: ArrayInput, before: Float[Array, " nq"], after: Float[Array, " nq"]) -> OdometryStep:
        """Return the pose after the joints have moved.

        Args:
            pose: (x, y, heading) of the frame before [m, m, rad].
            before, after: configurations (nq,) with the positions of the joints; the place of the base does not matter.

        Raises:
            InputError: an array has another shape or is not finite.
        """
        found = self.increment(before, after)
        return OdometryStep(composed(vector(pose, 3, "pose"), found.motion), found.slip)

    def increment(self, before: Float[Array, " nq"], after: Float[Array, " nq"]) -> OdometryIncrement:
        """Return the motion of the frame in its own axes, with its derivatives.

        Args:
            before, after: configurations (nq,) with the positions of the joints; the place of the base does not matter.

        Raises:
            InputError: an array has another shape or is not finite.
        """
        first, last = self._validator.validate(before), self._validator.validate(after)
        if first.ndim != 1 or last.ndim != 1:
            raise InputError("odometry takes two configurations")
        model = self._reduced.robot.model
        moved = np.zeros(self._reduced.n)
        moved[self._known] = pin.difference(model, first, last)[self._known]
        rows, to_base = self.base.rows(pin.integrate(model, first, 0.5 * moved))
        right = -rows[:, self._known] @ moved[self._known]
        unknown = self._columns(rows, to_base)
        inverse = np.linalg.pinv(unknown, rcond=_RANK)
        found = inverse @ right
        slip = float(np.abs(unknown @ found - right).max(initial=0.0))
        return OdometryIncrement(found[:3], slip, -inverse[:3] @ rows[:, self._known], inverse[:3])

    def _columns(self, rows: Array, to_base: Array) -> Array:
        """Columns of the twist and of the joints that are not measured."""
        return np.hstack([rows[:, self.base.base] @ to_base, rows[:, self._hidden]])

    def _unknown(self, rows: Array, to_base: Array) -> float:
        """Largest part of the twist in a motion that the measured joints do not show."""
        columns = self._columns(rows, to_base)
        _, values, directions = np.linalg.svd(columns)
        rank = int((values > _RANK * values[0]).sum()) if len(values) else 0
        return float(np.abs(directions[rank:, :3]).max(initial=0.0))


def composed(pose: Array, increment: Array) -> Array:
    """Pose (x, y, heading) after the motion with a constant twist (3,), in the axes of the frame, over unit time."""
    x, y, turn = increment
    along, across = arc_chord(turn)
    forward, left = along * x - across * y, across * x + along * y
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray(pose + np.array([c * forward - s * left, s * forward + c * left, turn]))
