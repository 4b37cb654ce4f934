"""Rows of bodies that roll on ground which another body carries: a tilting table, a moving deck, another ball."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rnc_pin.constraints.relative_kinematics import RelativeKinematics
from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.kernel_rows import CARRIED, Form, KernelRow, attached
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.mechanisms import GroundSurface, Phrases, carrier_of
from rnc_pin.model.rows import Rows
from rnc_pin.robots.robot import Robot


def on_carrier(rows: Rows, body: str, ground: GroundSurface | None, robot: Robot) -> Rows:
    """Return rows on a ground; if a frame carries the ground, the same rows for the motion relative to this frame.

    Args:
        rows: rows for the ground in the world.
        body: name of the frame of the body.
        ground: the ground; None for z = 0 at rest.
        robot: the robot.

    Raises:
        ModelError: the robot has no such frame.
        ConstraintError: the body carries the ground itself.
    """
    carrier = carrier_of(ground)
    if ground is None or carrier is None:
        return rows
    frame = robot.frame_id(carrier)
    frames = robot.model.frames
    if frames[frame].parentJoint == frames[robot.frame_id(body)].parentJoint:
        raise ConstraintError(f"'{body}' carries its own ground: frame '{carrier}' of the ground is on the same body")
    return CarriedRows(rows, frame, ground)


class CarriedRows(Rows):
    """Rows for the motion relative to the frame that carries the ground. Reactions act on both bodies.

    Args:
        rows: rows for ground in the world.
        carrier: index of the frame that carries the ground.
        ground: the ground, in the axes of this frame.
    """

    def __init__(self, rows: Rows, carrier: int, ground: GroundSurface) -> None:
        self._rows, self._carrier, self.ground = rows, carrier, ground
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
        """Rows of the kernel with the carrier as second frame; None for ground whose material turns."""
        rows = self._rows.kernel_rows(model)
        if rows is None or not all(row.form in CARRIED for row in rows):
            return None
        if any(row.form != Form.WORLD and any(row.integers[1:2]) for row in rows):
            return None
        carrier = attached(model, self._carrier)
        return [row._replace(frames=(*row.frames, carrier)) for row in rows]

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray] | None:
        found = self._rows.lines_of_action(self._seen(at))
        if found is None:
            return None
        turn, origin = at.placement(self._carrier)
        points, directions = (apply(turn[..., None, :, :], each) for each in found)
        return points + origin[..., None, :], directions

    def phrases(self) -> Phrases:
        return self._rows.phrases()._replace(support="", robot="a mechanism whose bodies roll on each other")
