"""Ackermann steering: both front wheels of a car turn about one centre."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConstraintError
from rnc_pin.math.components import Component, components, packed, packed_vector
from rnc_pin.model.coupling import COUPLED
from rnc_pin.model.kernel_rows import Form, KernelRow
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.mechanisms import JointCoupler, Phrases
from rnc_pin.model.rows import Rows
from rnc_pin.robots.robot import Robot
from rnc_pin.robots.single_joint import SingleJoint

_UPRIGHT = 1e-3  # horizontal part of a unit axis above which it is not vertical
_APART = 1e-6  # smallest wheelbase and track [m]


@dataclass(frozen=True)
class AckermannSteering:
    """Steering linkage of a car: the axles of both steered wheels and the fixed axle meet in one centre of rotation.

    A URDF cannot describe this linkage. Without it, the wheels slip or the car only drives straight ahead. With
    steering angles l and r to the left, wheelbase L and distance w of the pivots, the row is the rate of
    ``sin(l - r) - w / L sin(l) sin(r)``, which is zero if ``cot(r) - cot(l) = w / L``. It is holonomic, and regular
    at every angle, zero included.

    L and w are measured at the robot's neutral configuration. There, the wheels have to point straight ahead,
    perpendicular to the line between the pivots. Wheels may be offset from their pivots along their own axles.

    Args:
        left, right: the steering joints, in either order. Their axes are vertical, up or down.
        axle: a frame on the fixed axle, e.g. of a rear wheel.

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

    def bind(self, robot: Robot) -> Rows:
        pivots = [_pivot(self.left, robot), _pivot(self.right, robot)]
        return _AckermannRow(self, pivots, _track_over_wheelbase(self, pivots, robot))


class _Pivot(NamedTuple):
    joint: SingleJoint
    where: np.ndarray
    """Position in the horizontal plane (2,) [m], at the neutral configuration."""
    sign: float
    """1 for an axis that points up, -1 for one that points down."""


class _Shape(NamedTuple):
    """Function f of the steering angles, and its derivatives; ``f_ll = f_rr = -f``."""

    f: Component
    f_l: Component
    f_r: Component
    f_lr: Component


class _AckermannRow(Rows):
    """Row with ``f(l, r) = sin(l - r) - k sin(l) sin(r)``, where k is the track over the wheelbase.

    k is negative if the joint ``left`` is on the right.
    """

    holonomic = (True,)
    units = ("rad/s",)

    def __init__(self, kind: AckermannSteering, pivots: list[_Pivot], ratio: float) -> None:
        self.names = (f"ackermann({kind.left}, {kind.right})",)
        self._steering, self._pivots, self._ratio = kind, pivots, ratio

    def _shape(self, at: PositionKinematics) -> _Shape:
        q = components(at.q)
        (cl, sl), (cr, sr) = (_direction(pivot, q) for pivot in self._pivots)
        k = self._ratio
        cosine, sine = cl * cr + sl * sr, sl * cr - cl * sr  # of l - r
        return _Shape(sine - k * sl * sr, cosine - k * cl * sr, -cosine - k * sl * cr, sine - k * cl * cr)

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
        shape = self._shape(at)
        return self._row(at, shape.f_l, shape.f_r)

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
        f = self._shape(at).f
        return packed_vector([f], f)

    def mechanisms(self) -> tuple[JointCoupler]:
        return (JointCoupler(self._steering.left, self._steering.right, function=self._left_angle, period=np.pi),)

    def _left_angle(self, position: float) -> tuple[float, float]:
        """Position of the left joint up to half turns, from that of the right joint, and its slope."""
        left, right = (pivot.sign for pivot in self._pivots)
        r, k = right * position, self._ratio
        sine, cosine = np.sin(r), np.cos(r) - k * np.sin(r)  # tan(l) = sin r / (cos r - k sin r)
        return left * float(np.arctan2(sine, cosine)), left * float(1.0 / (sine * sine + cosine * cosine)) * right

    def phrases(self) -> Phrases:
        return COUPLED

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        left, right = (pivot.joint for pivot in self._pivots)
        continuous = left.continuous + 2 * right.continuous
        integers = (left.idx_q, left.idx_v, right.idx_q, right.idx_v, continuous)
        return [KernelRow(Form.ACKERMANN, (), integers, [self._ratio, *(pivot.sign for pivot in self._pivots)])]


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


def _track_over_wheelbase(kind: AckermannSteering, pivots: list[_Pivot], robot: Robot) -> float:
    frame, data = robot.frame_id(kind.axle), robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.configuration())
    left, right = (pivot.where for pivot in pivots)
    apart = left - right
    track = float(np.linalg.norm(apart))
    ahead = left - data.oMf[frame].translation[:2]
    # Distance of the pivots' line in front of the axle; negative if the first pivot is on the right.
    wheelbase = float(ahead[0] * apart[1] - ahead[1] * apart[0]) / track if track > _APART else 0.0
    if abs(wheelbase) < _APART:
        raise ConstraintError(
            f"track and wheelbase of steering joints '{kind.left}' and '{kind.right}' with frame '{kind.axle}' have to "
            f"be above {_APART:g} m, found {track:.3g} m and {abs(wheelbase):.3g} m"
        )
    return track / wheelbase
