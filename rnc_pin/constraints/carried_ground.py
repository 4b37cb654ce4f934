"""Rows of bodies that roll on ground which another body carries: a tilting table, a moving deck, another ball.

They are rows on a ground at rest, in the kinematics as seen from the frame that carries the ground.
"""

from __future__ import annotations

from rnc_pin.errors import ConstraintError
from rnc_pin.model.mechanisms import GroundSurface, Phrases, carrier_of
from rnc_pin.model.relative_rows import RelativeRows
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


class CarriedRows(RelativeRows):
    """Rows on a ground, for the motion relative to the frame that carries it.

    Args:
        rows: rows for ground in the world.
        carrier: index of the frame that carries the ground.
        ground: the ground, in the axes of this frame.
    """

    def __init__(self, rows: Rows, carrier: int, ground: GroundSurface) -> None:
        super().__init__(rows, carrier)
        self.ground = ground

    def phrases(self) -> Phrases:
        return self._rows.phrases()._replace(support="", robot="a mechanism whose bodies roll on each other")
