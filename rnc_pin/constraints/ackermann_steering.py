"""Ackermann steering: both front wheels of a car turn about one centre."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConstraintError
from rnc_pin.math.components import Component, Entry, components, packed, packed_vector
from rnc_pin.model.kernel_rows import Form, KernelRow
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.parameter_types import Axis
from rnc_pin.model.relative_rows import COUPLED
from rnc_pin.model.rows import JointCoupler, Phrases, Rows
from rnc_pin.robots.joint_values import SingleJoint
from rnc_pin.robots.robot import Robot

_UPRIGHT = 0.3  # horizontal part of a unit axis above which it is not vertical: kingpins lean by up to 17 degrees
_APART = 1e-6  # smallest wheelbase and track [m]
_LEVEL = 0.9  # smallest horizontal part of a unit axis along an axle


@dataclass(frozen=True)
class AckermannSteering:
    """Steering linkage of a car: the axles of both steered wheels and the fixed axle meet in one centre of rotation.

    A URDF cannot describe this linkage. Without it, the wheels slip or the car only drives straight ahead. With
    steering angles l and r to the left, wheelbase L and distance w of the pivots, the row is the rate of
    ``sin(l - r) - w / L sin(l) sin(r)``, which is zero if ``cot(r) - cot(l) = w / L``. It is holonomic, and regular
    at every angle, zero included. With ``axis``, the pivots may have different distances L_l and L_r from the fixed
    axle, such as a front wheel and a rear wheel on both sides of it: the row is then the rate of
    ``sin(l) cos(r) - L_l / L_r cos(l) sin(r) - w / L_r sin(l) sin(r)``.

    Distances are measured at the robot's neutral configuration. There, the wheels have to point straight ahead.
    Wheels may be offset from their pivots along their own axles.

    Args:
        left, right: the steering joints, in either order. Their axes are vertical, up or down; a lean of up to 17
            degrees is allowed, and the row ignores it.
        axle: a frame on the fixed axle, e.g. of a rear wheel.
        axis: the frame's own axis along the fixed axle, "x", "y" or "z". By default the fixed axle is parallel to the
            line between the pivots.

    Raises:
        ModelError: unknown joint or frame.
        ConstraintError: joints that do not turn about vertical axes, or pivots whose line is on the fixed axle.

    Example:
        >>> import pinocchio as pin
        >>> model, mass = pin.Model(), pin.Inertia(1.0, np.zeros(3), np.eye(3))
        >>> for name, pivot in {"left": (1.5, 0.5, 0.0), "right": (1.5, -0.5, 0.0)}.items():
        ...     joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array(pivot)), name)
        ...     model.appendBodyToJoint(joint, mass, pin.SE3.Identity())
        >>> linkage = rnc.AckermannSteering("left", "right", axle="universe")
        >>> system = rnc.NonholonomicSystem(rnc.Robot(model), [linkage])
        >>> q = system.assembled(np.array([0.5, 0.0]), hold=["left"])
        >>> np.diff(1.5 / np.tan(q)).round(6)  # the centre is nearer to the left wheel by the distance of the pivots
        array([1.])
    """

    left: str
    right: str
    axle: str
    axis: Axis | None = None

    def bind(self, robot: Robot) -> Rows:
        pivots = [_pivot(self.left, robot), _pivot(self.right, robot)]
        return _AckermannRow(self, pivots, *_ratios(self, pivots, robot))


class _Pivot(NamedTuple):
    joint: SingleJoint
    where: np.ndarray
    """Position in the horizontal plane (2,) [m], at the neutral configuration."""
    sign: float
    """1 for an axis that points up, -1 for one that points down."""


def linkage(left: Sequence[Entry], right: Sequence[Entry], p: Entry, k: Entry) -> tuple[Entry, Entry, Entry, Entry]:
    """Function f of the steering angles l and r, and its derivatives f_l, f_r and f_lr; ``f_ll = f_rr = -f``.

    ``f(l, r) = sin(l) cos(r) - p cos(l) sin(r) - k sin(l) sin(r)``.

    Args:
        left: cosine and sine of l.
        right: those of r.
        p: ratio of the wheelbases, 1 for a pair.
        k: track over the wheelbase of ``right``; negative if the joint ``left`` is on the right.
    """
    (cl, sl), (cr, sr) = left, right
    return (
        sl * cr - p * cl * sr - k * sl * sr,
        cl * cr + p * sl * sr - k * cl * sr,
        -(p * cl * cr + sl * sr) - k * sl * cr,
        p * sl * cr - cl * sr - k * cl * cr,
    )


class _AckermannRow(Rows):
    """Rate of the function f of a ``linkage``."""

    holonomic = (True,)
    units = ("rad/s",)

    def __init__(self, kind: AckermannSteering, pivots: list[_Pivot], reach: float, ratio: float) -> None:
        self.names = (f"ackermann({kind.left}, {kind.right})",)
        self._steering, self._pivots, self._reach, self._ratio = kind, pivots, reach, ratio

    def _shape(self, at: PositionKinematics) -> list[Component]:
        """f, f_l, f_r and f_lr."""
        q = components(at.q)
        left, right = (_direction(pivot, q) for pivot in self._pivots)
        return cast("list[Component]", linkage(left, right, self._reach, self._ratio))

    def _row(self, at: PositionKinematics, l_entry: Component, r_entry: Component) -> np.ndarray:
        """Row (..., 1, nv) from its entries for unit steering rates to the left."""
        size = at.M.shape[-1]
        row: list[Component] = [0.0] * size
        for pivot, entry in zip(self._pivots, (l_entry, r_entry), strict=True):
            row[pivot.joint.idx_v] = pivot.sign * entry
        return packed([row], l_entry)

    def _rates(self, at: VelocityKinematics) -> tuple[Component, Component]:
        """Steering rates of both joints to the left."""
        v = components(at.v)
        left, right = (pivot.sign * v[pivot.joint.idx_v] for pivot in self._pivots)
        return left, right

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        _, f_l, f_r, _ = self._shape(at)
        return self._row(at, f_l, f_r)

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        f, _, _, f_lr = self._shape(at)
        left, right = self._rates(at)
        return self._row(at, f_lr * right - f * left, f_lr * left - f * right)

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        f, _, _, f_lr = self._shape(at)
        left, right = self._rates(at)
        return packed_vector([2 * f_lr * left * right - f * (left * left + right * right)], f)

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        _, f_l, f_r, _ = self._shape(at)
        left, right = self._rates(at)
        squares, both = left * left + right * right, 2 * left * right
        return self._row(at, -f_l * squares - f_r * both, -f_r * squares - f_l * both)

    def residual(self, at: PositionKinematics) -> np.ndarray:
        f = self._shape(at)[0]
        return packed_vector([f], f)

    def mechanisms(self) -> tuple[JointCoupler]:
        return (JointCoupler(self._steering.left, self._steering.right, function=self._left_angle, period=np.pi),)

    def _left_angle(self, position: float) -> tuple[float, float]:
        """Position of the left joint up to half turns, from that of the right joint, and its slope."""
        left, right = (pivot.sign for pivot in self._pivots)
        r, p, k = right * position, self._reach, self._ratio
        sine, cosine = p * np.sin(r), np.cos(r) - k * np.sin(r)  # tan(l) = p sin r / (cos r - k sin r)
        return left * float(np.arctan2(sine, cosine)), left * float(p / (sine * sine + cosine * cosine)) * right

    def phrases(self) -> Phrases:
        return COUPLED

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        left, right = (pivot.joint for pivot in self._pivots)
        continuous = left.continuous + 2 * right.continuous
        integers = (left.idx_q, left.idx_v, right.idx_q, right.idx_v, continuous)
        return [
            KernelRow(Form.ACKERMANN, (), integers, [self._ratio, *(pivot.sign for pivot in self._pivots), self._reach])
        ]


def _direction(pivot: _Pivot, q: Sequence[Component]) -> tuple[Component, Component]:
    """Cosine and sine of a steering angle, positive to the left."""
    entry = q[pivot.joint.idx_q]
    if pivot.joint.continuous:
        return entry, pivot.sign * q[pivot.joint.idx_q + 1]
    return np.cos(entry), pivot.sign * np.sin(entry)


def _pivot(name: str, robot: Robot) -> _Pivot:
    index = robot.joint_id(name)
    joint, data = robot.model.joints[index], robot.model.createData()
    if joint.nv != 1:
        raise ConstraintError(f"steering joint '{name}' has {joint.nv} degrees of freedom, expected one")
    columns = pin.computeJointJacobians(robot.model, data, robot.configuration()).reshape(6, robot.nv)
    x, y, z = columns[3:, joint.idx_v]
    if not (abs(z) > 0.5 and np.hypot(x, y) < _UPRIGHT):
        found = "slides" if not columns[3:, joint.idx_v].any() else f"turns about ({x:.4g}, {y:.4g}, {z:.4g})"
        raise ConstraintError(f"steering joint '{name}' {found}, expected a vertical axis, (0, 0, 1) or (0, 0, -1)")
    return _Pivot(SingleJoint.of(joint), data.oMi[index].translation[:2].copy(), float(np.sign(z)))


def _ratios(kind: AckermannSteering, pivots: list[_Pivot], robot: Robot) -> tuple[float, float]:
    """Wheelbase of the first pivot, and track, over the wheelbase of the second pivot."""
    frame, data = robot.frame_id(kind.axle), robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.configuration())
    placement = data.oMf[frame]
    left, right = (pivot.where - placement.translation[:2] for pivot in pivots)
    track = left - right
    across = track if kind.axis is None else placement.rotation[:2, "xyz".index(kind.axis)]
    length = float(np.linalg.norm(across))
    if kind.axis is not None and length < _LEVEL:
        raise ConstraintError(f"axis {kind.axis} of frame '{kind.axle}' is vertical, expected the axis along its axle")
    x, y = across / length if length > _APART else (1.0, 0.0)
    # Distances in front of the fixed axle and to its side; a turn of the axle's direction by pi changes no ratio.
    fore_l, fore_r = (float(each[0] * y - each[1] * x) for each in (left, right))
    beside_l, beside_r = (float(each[0] * x + each[1] * y) for each in (left, right))
    least = min(abs(fore_l), abs(fore_r)) if length > _APART else 0.0
    if least < _APART:
        raise ConstraintError(
            f"track and wheelbase of steering joints '{kind.left}' and '{kind.right}' with frame '{kind.axle}' have to "
            f"be above {_APART:g} m, found {np.linalg.norm(track):.3g} m and {least:.3g} m"
        )
    return fore_l / fore_r, (beside_l - beside_r) / fore_r
