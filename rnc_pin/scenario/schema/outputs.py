"""Outputs in a scenario file, and how a task divides them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, Tag

from rnc_pin.model.rows import OutputKind
from rnc_pin.outputs import (
    Distance,
    FrameOrientation,
    FramePosition,
    FrameSpeed,
    FrameSpin,
    FrameTilt,
    FrameYaw,
    JointPosition,
)
from rnc_pin.scenario.schema.base import BY_KIND, Axis, Strict


class Joint(Strict):
    """A joint's coordinate."""

    joint: str

    def build(self) -> OutputKind:
        return JointPosition(self.joint)


class _PositionArguments(Strict):
    frame: str
    axes: str = "xyz"


class Position(Strict):
    """World coordinates of a frame."""

    frame_position: _PositionArguments

    def build(self) -> OutputKind:
        return FramePosition(self.frame_position.frame, self.frame_position.axes)


class Orientation(Strict):
    """Attitude of a frame."""

    frame_orientation: str

    def build(self) -> OutputKind:
        return FrameOrientation(self.frame_orientation)


class Yaw(Strict):
    """Heading of a frame."""

    frame_yaw: str

    def build(self) -> OutputKind:
        return FrameYaw(self.frame_yaw)


class _DistanceArguments(Strict):
    frame_a: str
    frame_b: str


class DistanceBetween(Strict):
    """Distance between two frames."""

    distance: _DistanceArguments

    def build(self) -> OutputKind:
        return Distance(self.distance.frame_a, self.distance.frame_b)


class _SpeedArguments(Strict):
    frame: str
    axis: Axis = "x"


class Speed(Strict):
    """A frame's speed along its own axis."""

    frame_speed: _SpeedArguments

    def build(self) -> OutputKind:
        return FrameSpeed(self.frame_speed.frame, self.frame_speed.axis)


class _AxisArguments(Strict):
    frame: str
    axis: Axis


class Spin(Strict):
    """A frame's angular velocity about its own axis."""

    frame_spin: _AxisArguments

    def build(self) -> OutputKind:
        return FrameSpin(self.frame_spin.frame, self.frame_spin.axis)


class Tilt(Strict):
    """How far a frame's own axis points up."""

    frame_tilt: _AxisArguments

    def build(self) -> OutputKind:
        return FrameTilt(self.frame_tilt.frame, self.frame_tilt.axis)


OutputItem = Annotated[
    Annotated[Joint, Tag("joint")]
    | Annotated[Position, Tag("frame_position")]
    | Annotated[Orientation, Tag("frame_orientation")]
    | Annotated[Yaw, Tag("frame_yaw")]
    | Annotated[DistanceBetween, Tag("distance")]
    | Annotated[Speed, Tag("frame_speed")]
    | Annotated[Spin, Tag("frame_spin")]
    | Annotated[Tilt, Tag("frame_tilt")],
    BY_KIND,
]


class Outputs(Strict):
    """Reducing outputs x2 and vertical outputs x1."""

    reducing: Annotated[list[OutputItem], Field(min_length=1)]
    vertical: list[OutputItem] = []


class TaskNames(Strict):
    """How the reducing outputs are divided, by the names of their rows (``tip_x``)."""

    primary: list[str] = []
    """Outputs that the task is about; all where nothing is said."""
    redundant: list[str] = []
    """Outputs that are free to serve the vertical ones."""
    vertical: list[str] | None = None
    """Vertical outputs that matter; all by default."""
