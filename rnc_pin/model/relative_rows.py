"""Rows for the motion relative to a frame of the robot, which stands for the world."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rnc_pin.math.linear_algebra import apply, apply_transposed, cross_columns, rotated_motions, vector_product
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.kernel_rows import Form, KernelRow, Value, attached
from rnc_pin.model.kinematics import (
    ALL,
    OWN_AXES,
    WORLD_AXES,
    Components,
    FrameDerivatives,
    Placement,
    PositionKinematics,
    VelocityKinematics,
)
from rnc_pin.model.rows import OutputRows, Rows


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

    def _offset(self, frame: int) -> np.ndarray:
        """Vector d (..., 3) from the carrier's origin to that of a frame, in world axes."""
        return np.asarray(self._original.placement(frame).translation - self._place.translation)

    def placement(self, frame: int) -> Placement:
        turned = self._place.rotation.mT @ self._original.rotation(frame)
        return Placement(turned, apply_transposed(self._place.rotation, self._offset(frame)))

    # ------------------------------------------------------------------ Jacobians

    def jacobian(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        found = self._along(self._relative(frame, self._original.jacobian(frame)))
        return (self._own(frame, found) if axes == OWN_AXES else found)[..., rows, :]

    def jacobian_dot(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES) -> np.ndarray:
        at, carrier = self._in_motion, self._carrier
        velocity, carried = at.velocity(frame), at.velocity(carrier)
        rate = self._relative(frame, at.jacobian_dot(frame), at.jacobian_dot(carrier))
        rate[..., :3, :] += cross_columns(velocity[..., :3] - carried[..., :3], at.jacobian(carrier)[..., 3:, :])
        rate -= _turned(carried[..., 3:], self._relative(frame, at.jacobian(frame)))
        found = self._along(rate)
        if axes == OWN_AXES:
            found = self._own(frame, found - _turned(self.velocity(frame)[..., 3:], self.jacobian(frame)))
        return found

    def _relative(self, frame: int, columns: np.ndarray, of_carrier: np.ndarray | None = None) -> np.ndarray:
        """Columns (..., 6, k) of a frame less those of the carrier at the frame's origin, in world axes."""
        carried = self._original.jacobian(self._carrier) if of_carrier is None else of_carrier
        found = columns - carried
        found[..., :3, :] += cross_columns(self._offset(frame), carried[..., 3:, :])
        return np.asarray(found)

    def _along(self, columns: np.ndarray) -> np.ndarray:
        """Columns (..., 6, k) of linear and angular components, along the axes of the carrier."""
        return rotated_motions(self._place.rotation.mT, columns)

    def _own(self, frame: int, columns: np.ndarray) -> np.ndarray:
        """Columns (..., 6, k) along the frame's own axes, from those along the carrier's."""
        return rotated_motions(self.rotation(frame).mT, columns)

    # ------------------------------------------------------------------ motion

    def velocity(self, frame: int) -> np.ndarray:
        linear, angular = self._relative_velocity(frame)
        turn = self._place.rotation
        return np.concatenate([apply_transposed(turn, linear), apply_transposed(turn, angular)], axis=-1)

    def _relative_velocity(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Velocity and angular velocity (..., 3) of a frame relative to the carrier, in world axes."""
        moved, carried = self._in_motion.velocity(frame), self._in_motion.velocity(self._carrier)
        spin = carried[..., 3:]
        linear = moved[..., :3] - carried[..., :3] - vector_product(spin, self._offset(frame))
        return np.asarray(linear), np.asarray(moved[..., 3:] - spin)

    def acceleration(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        at, turn = self._in_motion, self._place.rotation
        velocity, carried = at.velocity(frame), at.velocity(self._carrier)
        relative = at.acceleration(frame) - at.acceleration(self._carrier)
        linear, angular = self._relative_velocity(frame)
        spin, turning = carried[..., 3:], at.acceleration(self._carrier)[..., 3:]
        moved = relative[..., :3] - vector_product(turning, self._offset(frame))
        moved = moved - vector_product(spin, velocity[..., :3] - carried[..., :3] + linear)
        turned = relative[..., 3:] - vector_product(spin, angular)
        if axes == OWN_AXES:
            turn = at.rotation(frame)
            moved = moved - vector_product(angular, linear)
        return np.concatenate([apply_transposed(turn, moved), apply_transposed(turn, turned)], axis=-1)[..., rows]

    # ------------------------------------------------------------------ derivatives at one state

    def frame_gradients(self, frame: int) -> FrameDerivatives:
        at, carrier = self._in_motion, self._carrier
        of_frame, of_carrier = at.frame_gradients(frame), at.frame_gradients(carrier)
        velocity, carried = at.velocity(frame), at.velocity(carrier)
        relative, d = at.acceleration(frame) - at.acceleration(carrier), self._offset(frame)
        d_q = at.jacobian(frame)[:3] - at.jacobian(carrier)[:3]
        spin, turning = carried[3:], at.acceleration(carrier)[3:]
        spin_q, turning_q = of_carrier.angular_velocity, of_carrier.angular_acceleration
        apart, apart_q = velocity[:3] - carried[:3], of_frame.velocity - of_carrier.velocity
        linear, angular = self._relative_velocity(frame)
        linear_q = apart_q - _product_gradient(spin, spin_q, d, d_q)
        angular_q = of_frame.angular_velocity - spin_q
        moved = relative[:3] - np.cross(turning, d) - np.cross(spin, apart + linear)
        moved_q = of_frame.acceleration - of_carrier.acceleration - _product_gradient(turning, turning_q, d, d_q)
        moved_q = moved_q - _product_gradient(spin, spin_q, apart + linear, apart_q + linear_q)
        turned = relative[3:] - np.cross(spin, angular)
        turned_q = of_frame.angular_acceleration - turning_q - _product_gradient(spin, spin_q, angular, angular_q)
        turn, twist = self._place.rotation.T, at.jacobian(carrier)[3:]
        pairs = (linear, linear_q), (angular, angular_q), (moved, moved_q), (turned, turned_q)
        return FrameDerivatives(*(turn @ (gradient + cross_columns(vector, twist)) for vector, gradient in pairs))

    def own_acceleration_gradient(self, frame: int) -> np.ndarray:
        found, velocity, J = self.frame_gradients(frame), self.velocity(frame), self.jacobian(frame)
        v, w = velocity[:3], velocity[3:]
        acceleration = self.acceleration(frame)
        moved = acceleration[:3] - np.cross(w, v)
        moved_q = found.acceleration - _product_gradient(w, found.angular_velocity, v, found.velocity)
        pairs = (moved, moved_q), (acceleration[3:], found.angular_acceleration)
        turn, twist = self.rotation(frame).T, J[3:]
        return np.vstack([turn @ (gradient + cross_columns(vector, twist)) for vector, gradient in pairs])


def _turned(spin: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Rates (..., 6, k) of linear and angular columns that turn at an angular velocity (..., 3)."""
    return np.concatenate([cross_columns(spin, columns[..., :3, :]), cross_columns(spin, columns[..., 3:, :])], axis=-2)


def _product_gradient(a: np.ndarray, a_q: np.ndarray, b: np.ndarray, b_q: np.ndarray) -> np.ndarray:
    """Derivative (3, n) of the vector product of a and b."""
    return np.asarray(cross_columns(a, b_q) - cross_columns(b, a_q))


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

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return self._rows.jacobian(self._seen(at))

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        return self._rows.jacobian_dot(self._seen(at))

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        return self._rows.bias_acceleration(self._seen(at))

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray | None:
        return self._rows.bias_acceleration_gradient(self._seen(at))

    def rate(self, at: PositionKinematics) -> np.ndarray:
        return self._rows.rate(self._seen(at))

    def rate_dot(self, at: VelocityKinematics) -> np.ndarray:
        return self._rows.rate_dot(self._seen(at))

    def residual(self, at: PositionKinematics) -> np.ndarray:
        return self._rows.residual(self._seen(at))

    def kernel_rows(self, model: pin.Model) -> list[KernelRow] | None:
        """Rows of the kernel with the carrier as second frame; None for other rows than wrenches on ground at rest."""
        rows = self._rows.kernel_rows(model)
        if rows is None or any(row.form < Form.WORLD or len(row.frames) > 1 or any(row.integers[1:2]) for row in rows):
            return None
        carrier = attached(model, self._carrier)
        return [row._replace(frames=(*row.frames, carrier), value=(Value.NONE, 0)) for row in rows]

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray] | None:
        found = self._rows.lines_of_action(self._seen(at))
        if found is None:
            return None
        turn, origin = at.placement(self._carrier)
        points, directions = (apply(turn[..., None, :, :], each) for each in found)
        return points + origin[..., None, :], directions


class RelativeOutputRows(RelativeRows, OutputRows):
    """The same for outputs.

    Args:
        rows: rows for the motion in the world.
        carrier: index of the carrier's frame.
    """

    _rows: OutputRows

    def __init__(self, rows: OutputRows, carrier: int) -> None:
        super().__init__(rows, carrier)
        self.angular, self.quasi, self.rotation = rows.angular, rows.quasi, rows.rotation

    def value(self, at: PositionKinematics) -> np.ndarray:
        return self._rows.value(self._seen(at))
