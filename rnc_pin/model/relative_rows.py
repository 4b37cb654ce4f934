"""Rows between two bodies: components of the velocity of a frame relative to another, and couplings of two joints."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin._kernel.kernel_rows import Form, KernelRow, Value, attached
from rnc_pin.math.linear_algebra import apply, apply_transposed, complex_step, vector_product
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.kinematics import ALL, WORLD_AXES, Components, Placement, PositionKinematics, VelocityKinematics
from rnc_pin.model.rows import ConstantRows, JointCoupler, Rows
from rnc_pin.robots.robot import Robot
from rnc_pin.robots.sources.description import Mimic


class RelativeKinematics(VelocityKinematics):
    """Kinematics of frames relative to a carrier: its origin and its axes stand for those of the world.

    Rows that are written for the world hold on a body that moves if they read the kinematics through this class. With
    the carrier's velocity (v_c, w_c), a frame at d from its origin has the velocity ``v - v_c - w_c x d`` and the
    angular velocity ``w - w_c``, along the axes of the carrier.

    Args:
        original: kinematics in the world; without a velocity, only methods of ``PositionKinematics`` work.
        carrier: index of the carrier's frame.
    """

    def __init__(self, original: PositionKinematics, carrier: int) -> None:
        self._original, self._carrier, self.q, self.t = original, carrier, original.q, original.t

    @property
    def _in_motion(self) -> VelocityKinematics:
        assert isinstance(self._original, VelocityKinematics)
        return self._original

    @cached_property
    def _place(self) -> Placement:
        return self._original.placement(self._carrier)

    def _offset(self, frame: int) -> Array:
        """Vector d (..., 3) from the carrier's origin to that of a frame, in world axes."""
        return np.asarray(self._original.placement(frame).translation - self._place.translation)

    def placement(self, frame: int) -> Placement:
        turned = self._place.rotation.mT @ self._original.placement(frame).rotation
        return Placement(turned, apply_transposed(self._place.rotation, self._offset(frame)))

    def jacobian(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> Array:
        _check_axes(axes)
        return _relative_motion(*self._at_unit_velocities(frame)).mT[..., rows, :]

    def jacobian_dot(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES) -> Array:
        _check_axes(axes)
        at, both = self._in_motion, (frame, self._carrier)
        rates = [at.jacobian_dot(each).mT for each in both]
        velocities = [at.velocity(each)[..., None, :] for each in both]
        return _relative_rate(*self._at_unit_velocities(frame), rates, velocities).mT

    def _at_unit_velocities(self, frame: int) -> tuple[Array, Array, list[Array]]:
        """Arguments of formulas of relative motions, for the motions (..., nv, 6) at unit velocities."""
        motions = [self._original.jacobian(each).mT for each in (frame, self._carrier)]
        return self._place.rotation[..., None, :, :], self._offset(frame)[..., None, :], motions

    def velocity(self, frame: int) -> Array:
        motions = [self._in_motion.velocity(each) for each in (frame, self._carrier)]
        return _relative_motion(self._place.rotation, self._offset(frame), motions)

    def acceleration(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> Array:
        _check_axes(axes)
        at, both = self._in_motion, (frame, self._carrier)
        velocities, accelerations = [at.velocity(each) for each in both], [at.acceleration(each) for each in both]
        place = self._place.rotation, self._offset(frame)
        return _relative_rate(*place, velocities, accelerations, velocities)[..., rows]

    def frame_gradients(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES) -> Array:
        _check_axes(axes)
        at, carrier, rotation = self._in_motion, self._carrier, self._place.rotation
        # The relative motion is a formula of both motions: the complex step joins their exact derivatives.
        J, J_carrier = at.jacobian(frame), at.jacobian(carrier)
        turned = np.cross(J_carrier[3:, None, :], rotation[:, :, None], axis=0)  # (3, 3, nv)
        motions = [(at.velocity(each), at.frame_gradients(each)[0]) for each in (frame, carrier)]
        motions += [(at.acceleration(each), at.frame_gradients(each)[1]) for each in (frame, carrier)]

        def relative(flat: Array, d: Array, *motions: Array) -> Array:
            turn, velocities = flat.reshape(-1, 3, 3), motions[:2]
            rate = _relative_rate(turn, d, velocities, motions[2:], velocities)
            return np.concatenate([_relative_motion(turn, d, velocities), rate], axis=-1)

        offset = self._offset(frame), (J - J_carrier)[:3]
        gradient = complex_step(relative, (rotation.ravel(), turned.reshape(9, -1)), offset, *motions)
        return gradient.reshape(2, 6, -1)


def _check_axes(axes: pin.ReferenceFrame) -> None:
    if axes != WORLD_AXES:
        raise NotImplementedError("relative kinematics have components along the axes of the carrier only")


# Formulas take complex numbers. Motions (linear, angular) of the frame and of the carrier are along the axes of the
# world, results along those of the carrier, ``turn`` (..., 3, 3); d points from the carrier to the frame.


def _relative_motion(turn: Array, d: Array, motions: Sequence[Array]) -> Array:
    """Motion (..., 6) of a frame relative to a carrier."""
    motion, carried = motions
    relative = motion - carried
    # Coriolis: v_rel = v - (v_c + omega_c x d).
    linear = relative[..., :3] - vector_product(carried[..., 3:], d)
    return np.concatenate([apply_transposed(turn, linear), apply_transposed(turn, relative[..., 3:])], axis=-1)


def _relative_rate(
    turn: Array, d: Array, motions: Sequence[Array], rates: Sequence[Array], velocities: Sequence[Array]
) -> Array:
    """Rate (..., 6) of a relative motion, from the rates of both motions and the velocities of both bodies."""
    (motion, carried), (velocity, carrier_velocity), spin = motions, velocities, velocities[1][..., 3:]
    apart, d_dot = motion - carried, (velocity - carrier_velocity)[..., :3]
    # Product rule: d changes by d_dot, and components along axes that turn lose the turning of the axes.
    linear = vector_product(carried[..., 3:], d_dot) + vector_product(spin, apart[..., :3])
    linear -= vector_product(spin, vector_product(carried[..., 3:], d))
    lost = np.concatenate([linear, vector_product(spin, apart[..., 3:])], axis=-1)
    return _relative_motion(turn, d, [rates[0] - lost, rates[1]])


class RelativeRows(Rows):
    """Rows for the motion relative to a carrier. Reactions act on both bodies.

    Args:
        rows: rows for the motion in the world.
        carrier: index of the carrier's frame.
    """

    def __init__(self, rows: Rows, carrier: int) -> None:
        self._rows, self._carrier = rows, carrier
        self.names, self.units, self.holonomic = rows.names, rows.units, rows.holonomic
        self.affine, self.on_ground = rows.affine, rows.on_ground

    def _seen(self, at: PositionKinematics) -> VelocityKinematics:
        return RelativeKinematics(at, self._carrier)

    def jacobian(self, at: PositionKinematics) -> Array:
        return self._rows.jacobian(self._seen(at))

    def jacobian_dot(self, at: VelocityKinematics) -> Array:
        return self._rows.jacobian_dot(self._seen(at))

    def bias_acceleration(self, at: VelocityKinematics) -> Array:
        return self._rows.bias_acceleration(self._seen(at))

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> Array | None:
        return self._rows.bias_acceleration_gradient(self._seen(at))

    def rate(self, at: PositionKinematics) -> Array:
        return self._rows.rate(self._seen(at))

    def rate_dot(self, at: VelocityKinematics) -> Array:
        return self._rows.rate_dot(self._seen(at))

    def residual(self, at: PositionKinematics) -> Array:
        return self._rows.residual(self._seen(at))

    def kernel_rows(self, model: pin.Model) -> list[KernelRow] | None:
        """Rows of the kernel with the carrier as second frame; None for other rows than wrenches on ground at rest."""
        rows = self._rows.kernel_rows(model)
        if rows is None or any(row.form < Form.WORLD or len(row.frames) > 1 or any(row.integers[1:2]) for row in rows):
            return None
        # A value would be in the world, not relative to the carrier: Python evaluates it.
        carrier = attached(model, self._carrier)
        return [row._replace(frames=(*row.frames, carrier), value=(Value.NONE, 0)) for row in rows]

    def lines_of_action(self, at: PositionKinematics) -> tuple[Array, Array] | None:
        found = self._rows.lines_of_action(self._seen(at))
        if found is None:
            return None
        turn, origin = at.placement(self._carrier)
        points, directions = (apply(turn[..., None, :, :], each) for each in found)
        return points + origin[..., None, :], directions


# ------------------------------------------------------------------ couplings of joints


class CouplingRow(ConstantRows):
    """Row ``v_joint - ratio * v_driver = 0``; holonomic if ``q_joint = ratio * q_driver + offset`` is well defined.

    Args:
        robot: the robot that has the joints.
        joint: the joint that follows.
        driver: the joint that leads; None if it does not move, so that the joint stays at the offset.
        ratio: motion of the joint for unit motion of the driver.
        offset: position of the joint if the driver is at zero [rad or m].
        name: name of the row; made from the names of the joints by default.

    Raises:
        ModelError: unknown joint, or a joint with several degrees of freedom.
    """

    def __init__(
        self, robot: Robot, joint: str, driver: str | None, ratio: float, offset: float, name: str | None = None
    ) -> None:
        self.pair = frozenset({joint, driver})
        """The coupled joints."""
        self.joint, self.driver = joint, driver
        remedy = "only joints with one can be coupled"
        self._joint = robot.single_joint(joint, remedy)
        self._driver = None if driver is None else robot.single_joint(driver, remedy)
        self.ratio, self.offset = ratio, offset
        self.names = (name or f"coupling({joint}, {driver})",)
        self.units = (self._joint.unit,)
        self.matrix = np.zeros((1, robot.nv))
        self.matrix[0, self._joint.idx_v] = 1.0
        if self._driver is not None:
            self.matrix[0, self._driver.idx_v] = -ratio
        period = _period(self._joint.continuous, self._driver is not None and self._driver.continuous, ratio)
        self.holonomic = (period is not None,)
        self._period = period or 0.0

    def residual(self, at: PositionKinematics) -> Array:
        if not self.holonomic[0]:
            return super().residual(at)
        gap = self._joint.position(at.q) - self.offset
        if self._driver is not None:
            gap = gap - self.ratio * self._driver.position(at.q)
        if self._period:
            # Whole turns of continuous joints are unknown: the nearest ones count.
            gap = gap - self._period * np.round(gap / self._period)
        return gap[..., None]

    def mechanisms(self) -> tuple[JointCoupler]:
        return (JointCoupler(self.joint, self.driver, 0.0 if self.driver is None else self.ratio),)


def mimic_rows(robot: Robot, blocks: Sequence[Rows]) -> list[CouplingRow]:
    """Rows for the mimic joints of the robot's file, except those that ``blocks`` already couple.

    If one of the two joints is locked, the row holds the other at the position that follows from the coupling.

    Args:
        robot: the robot with its ``mimics``.
        blocks: bound rows of the given constraints.
    """
    given = [block for block in blocks if isinstance(block, CouplingRow)]
    rows: dict[str, CouplingRow] = {}
    for mimic in robot.mimics:
        row = mimic_row(robot, mimic)
        if row and not any(row.joint == other.joint or row.pair == other.pair for other in given):
            # A file may list a mimic joint twice.
            rows.setdefault(row.names[0], row)
    return list(rows.values())


def mimic_row(robot: Robot, mimic: Mimic) -> CouplingRow | None:
    """Row of one mimic joint; None if it constrains nothing, e.g. for a joint that the file fixes.

    Args:
        robot: the robot.
        mimic: joint, leading joint, multiplier and offset.
    """
    # A joint that the file fixes still prescribes the other one: its row is a lock at the matching value.
    joint, of, multiplier, offset = mimic
    moving = {name for name in robot.joint_names if robot.model.joints[robot.joint_id(name)].nv == 1}
    name = f"coupling({joint}, {of})"
    if joint in moving and (of not in robot.joint_names or multiplier == 0):
        return CouplingRow(robot, joint, None, 1.0, multiplier * robot.locked.get(of, 0.0) + offset, name)
    if joint in moving and of in moving:
        return CouplingRow(robot, joint, of, multiplier, offset, name)
    if of in moving and joint in robot.locked and multiplier != 0:
        return CouplingRow(robot, of, None, 1.0, (robot.locked[joint] - offset) / multiplier, name)
    return None


def is_loose(row: Array, samples: Array) -> bool:
    """Return True if a row (nv,) is independent of the rows (samples, m, nv) at some configuration.

    Args:
        row: the row (nv,).
        samples: constraint rows (samples, m, nv).
    """
    # What the other rows leave of it is a motion that they allow.
    rests = (row - np.linalg.lstsq(matrix.T, row, rcond=None)[0] @ matrix for matrix in samples)
    return any(np.linalg.norm(rest) > 1e-6 * np.linalg.norm(row) for rest in rests)


def _period(joint_turns: bool, driver_turns: bool, ratio: float) -> float | None:
    """Period of the residual due to unknown full turns of continuous joints; 0 if none, None if it takes any value."""
    if not driver_turns:
        return 2 * np.pi if joint_turns else 0.0
    if not joint_turns:
        return 2 * np.pi * abs(ratio)
    largest_denominator = 1000  # of the ratio of gears; other ratios have no period that matters
    # A driver's full turn moves the joint by 2 pi ratio: the values it may take repeat after the denominator.
    fraction = Fraction(ratio).limit_denominator(largest_denominator)
    if abs(float(fraction) - ratio) > 1e-12 * abs(ratio):
        return None
    return 2 * np.pi / fraction.denominator
