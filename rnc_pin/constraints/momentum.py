"""Momentum conservation of an unactuated base: paper (4)-(6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin._kernel.kernel_rows import Form, KernelRow, placement_numbers
from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.input_validation import Numbers
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics, over_states
from rnc_pin.model.rows import Rows
from rnc_pin.robots.robot import Robot

# Components of the spatial velocity that a joint allows, for joints whose velocity is in the moving body's axes.
_VELOCITY_AXES = {
    "JointModelPlanar": [0, 1, 5],
    "JointModelFreeFlyer": [0, 1, 2, 3, 4, 5],
    "JointModelSpherical": [3, 4, 5],
}


@dataclass(frozen=True)
class MomentumConservation:
    """Conservation of the momentum of an unactuated, cyclic joint; zero if the system starts at rest.

    A revolute platform gives one row, a planar base three, a free-flying base six. No row counts as holonomic: angular
    momentum is not integrable in general, and the center of mass that linear momentum fixes depends on the start.

    A momentum of zero is the momentum conjugate to the joint's velocity. A nonzero momentum is constant in the world
    frame, not in the axes of a rotating body. For a planar, free-flying or spherical joint, it is the linear momentum,
    and the angular momentum about the world's origin, in the world's axes (more exactly, in the axes of the joint's
    fixed frame). Then the constraint is affine, ``A v = mu``.

    Momentum rows have no reaction force, because conservation follows from the dynamics. Therefore
    ``NonholonomicSystem`` raises an error for actuators and other constraints that act on the joint, e.g. a wheel of
    this base on the ground or a hand on a wall. Constraints within the subtree of the joint, such as loops and gears,
    do not change the momentum.

    Args:
        joint: name of the joint, ``"root_joint"`` for a planar or free base.
        momentum: value of the momentum, zero by default: a number for a joint with one degree of freedom [N m s or
            kg m/s]; (p_x, p_y, L_z) for a planar base; (p, L), six numbers, for a free-flying base.

    Raises:
        ModelError: unknown joint.
        ConstraintError: the inertia depends on the joint's position (it is not cyclic), gravity acts along it, so
            that its momentum is not conserved, or the value does not fit the joint.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> spinning = rnc.MomentumConservation("platform", momentum=6.0)  # [N m s]
        >>> reduced = rnc.NonholonomicSystem(robot, [spinning], ["joint_1", "joint_2", "joint_3"]).reduce()
        >>> reduced.affine, reduced.constraints.names
        (True, ('momentum(platform)',))
    """

    joint: str
    momentum: float | Numbers | np.ndarray = 0.0

    def bind(self, robot: Robot) -> Rows:
        rows = robot.velocity_indices(self.joint)
        _check_symmetry(robot, self.joint, rows)
        joint = robot.joint_id(self.joint)
        kind = robot.model.joints[joint].shortname()
        along = _VELOCITY_AXES.get(kind, [])
        slides = kind.startswith(("JointModelP", "JointModelTranslation"))
        of_axes = tuple("kg m/s" if axis < 3 else "N m s" for axis in along)
        units = of_axes or ("kg m/s" if slides else "N m s",) * robot.model.joints[joint].nv
        # A momentum of zero is zero in all axes: those of the body need no transformation.
        if not np.any(self.momentum):
            return _MomentumRows(self.joint, rows, units, along)
        # A copy: the rows keep it, and the caller may go on with his array.
        value = np.atleast_1d(np.array(self.momentum, dtype=float))
        size = rows.stop - rows.start
        if value.shape != (size,) or not np.isfinite(value).all():
            raise ConstraintError(
                f"momentum of joint '{self.joint}' takes {size} finite number{'s' * (size > 1)}, found {self.momentum}"
            )
        # These axes do not turn with the joint: the conserved momentum is its generalized one. Else it is one in the
        # world.
        if size == 1 or kind == "JointModelTranslation":
            return _MomentumRows(self.joint, rows, units, [], value)
        parent = robot.model.parents[joint]
        if kind not in _VELOCITY_AXES or parent != 0:
            raise ConstraintError(
                f"momentum of joint '{self.joint}' has to be zero, found {self.momentum}: a nonzero value needs a "
                f"planar, free-flying or spherical joint on the world, found {kind} on '{robot.model.names[parent]}'"
            )
        return _WorldMomentumRows(self.joint, rows, units, along, value, robot)


class _MomentumRows(Rows):
    """Momentum rows in the axes of the body.

    Args:
        joint: name of the joint.
        rows: its entries of v.
        units: unit of each row.
        along: components of a spatial velocity that the joint allows, if its velocity is in the axes of the body;
            empty for a joint that does not turn its own axes.
        value: value of the momentum, zero by default.
    """

    _bits = 0  # set for the world's axes: the kernel finds the axes from the bits, and its formula from their being set

    def __init__(
        self, joint: str, rows: slice, units: tuple[str, ...], along: Sequence[int], value: np.ndarray | None = None
    ) -> None:
        size = rows.stop - rows.start
        self.names = tuple(f"momentum({joint})" + (f"[{k}]" if size > 1 else "") for k in range(size))
        self.units = units
        self._along = list(along)
        self.conserved = self._rows = rows
        self.affine = value is not None
        self._value = np.zeros(size) if value is None else value

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return at.M[..., self._rows, :]

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        # Mdot = C + C^T of the Coriolis matrix that Pinocchio computes.
        return at.C[..., self._rows, :] + at.C.mT[..., self._rows, :]

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        # d/dt (M v) = bias + coadjoint action of v on M v. The latter is zero if M v is zero, or if the joint has one
        # degree of freedom. Gravity has no component along a cyclic joint.
        return at.bias[..., self._rows]

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        # The Jacobian is in the body's axes: Jdot v = bias - coadjoint action of v on M v. See ``bias_acceleration``.
        gradient = at.bias_gradient()[self._rows]
        return gradient - self._coadjoint(at.v) @ at.momentum_gradient()[self._rows] if self._along else gradient

    def _coadjoint(self, v: np.ndarray) -> np.ndarray:
        velocity = np.zeros(6)
        velocity[self._along] = v[self._rows]
        return pin.Motion(velocity).dualAction[np.ix_(self._along, self._along)]

    def rate(self, at: PositionKinematics) -> np.ndarray:
        return np.broadcast_to(self._value, (*at.q.shape[:-1], len(self._value)))

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        first, bits, size = self._rows.start, self._bits, len(self._value)
        values = enumerate(self._value.tolist())
        return [KernelRow(Form.MOMENTUM, (), (first, k, bits, size), (), mu) for k, mu in values]


class _WorldMomentumRows(_MomentumRows):
    """Momentum rows, transformed from the body's axes to the axes of the joint's fixed frame."""

    def __init__(
        self, joint: str, rows: slice, units: tuple[str, ...], along: Sequence[int], value: np.ndarray, robot: Robot
    ) -> None:
        super().__init__(joint, rows, units, along, value)
        self._joint = robot.joint_id(joint)
        self._fixed = robot.model.jointPlacements[self._joint].inverse()
        self._block = np.ix_(along, along)
        self._bits = sum(1 << each for each in along)

    def _to_world(self, at: PositionKinematics) -> np.ndarray:
        place = at.joint_placement(self._joint)

        def action(translation: np.ndarray, rotation: np.ndarray) -> np.ndarray:
            # Momenta are dual vectors: the dual action carries them from the body to the fixed axes.
            return (self._fixed * pin.SE3(rotation, translation)).toDualActionMatrix()[self._block]

        return over_states(action, (len(self._along),) * 2, place.translation, place.rotation)

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return self._to_world(at) @ super().jacobian(at)

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        coadjoint = over_states(self._coadjoint, (len(self._along),) * 2, at.v)
        return self._to_world(at) @ (coadjoint @ super().jacobian(at) + super().jacobian_dot(at))

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        # In fixed axes, the rate of the momentum at zero vdot equals the force on the base for this motion.
        return apply(self._to_world(at), super().bias_acceleration(at))

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        force, units = super().bias_acceleration(at), np.eye(at.v.size)[self._rows]
        gradient = at.bias_gradient()[self._rows]
        # Moving the joint turns the axes to the world: the force on the base turns with them.
        gradient[:, self._rows] += np.stack([self._coadjoint(each) @ force for each in units], axis=-1)
        return self._to_world(at) @ gradient

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        numbers = placement_numbers(self._fixed)
        return [row._replace(numbers=numbers, joint=self._joint) for row in super().kernel_rows(model)]


def _check_symmetry(robot: Robot, joint: str, rows: slice) -> None:
    """Raise an error if a motion of the joint alone changes the inertia matrix, or if gravity acts along the joint."""
    data = robot.model.createData()
    generator = np.random.default_rng(0)
    samples = 4  # random states decide: a dependence that is not identically zero shows at almost every one
    tolerance = 1e-9  # relative; rounding of the inertia matrix is near 1e-15, and a dependence of order one
    for _ in range(samples):
        q = robot.random_configuration(generator)
        shift = np.zeros(robot.nv)
        # A step of order one: a smooth dependence shows far above rounding.
        shift[rows] = generator.uniform(-1.0, 1.0, rows.stop - rows.start)
        # A cyclic coordinate: the inertia matrix does not change when the joint alone moves.
        moved = pin.integrate(robot.model, q, shift)
        inertia = pin.crba(robot.model, data, q)
        change = np.abs(pin.crba(robot.model, data, moved) - inertia).max() / np.abs(inertia).max()
        if change > tolerance:
            raise ConstraintError(
                f"momentum of joint '{joint}' is not conserved: the inertia matrix depends on its position "
                "(only a base joint, which turns the robot as a whole, is cyclic)"
            )
        weight = pin.computeGeneralizedGravity(robot.model, data, q)
        scale = pin.computeTotalMass(robot.model) * np.linalg.norm(robot.model.gravity.linear)
        if np.abs(weight[rows]).max() > tolerance * scale:
            raise ConstraintError(
                f"momentum of joint '{joint}' is not conserved: gravity acts along it "
                "(load the robot with gravity=(0, 0, 0), or turn the joint's axis along gravity)"
            )
