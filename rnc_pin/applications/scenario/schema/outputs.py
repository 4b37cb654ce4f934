"""Outputs and tasks in a scenario file."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from rnc_pin.applications.scenario.schema.base import Strict
from rnc_pin.applications.scenario.schema.derived import Entry, one_of
from rnc_pin.model import OutputKind
from rnc_pin.outputs import (
    CenterOfMass,
    Distance,
    FrameAngularVelocity,
    FrameOrientation,
    FramePosition,
    FrameSpeed,
    FrameTilt,
    FrameYaw,
    JointPosition,
    RelativeAngle,
    RelativeAngularVelocity,
)

OutputItem = Annotated[
    OutputKind,
    one_of(
        joint=Entry(JointPosition, only="joint"),
        frame_position=FramePosition,
        frame_orientation=Entry(FrameOrientation, only="frame"),
        frame_yaw=Entry(FrameYaw, only="frame"),
        distance=Distance,
        center_of_mass=CenterOfMass,
        frame_speed=FrameSpeed,
        frame_angular_velocity=Entry(FrameAngularVelocity, required=("axis",)),
        frame_tilt=Entry(FrameTilt, required=("axis",)),
        relative_angle=RelativeAngle,
        relative_angular_velocity=RelativeAngularVelocity,
    ),
]


class Outputs(Strict):
    """Reducing outputs x2 and vertical outputs x1."""

    reducing: Annotated[list[OutputItem], Field(min_length=1)]
    """Reducing outputs x2; their rates are the reduced velocity."""
    vertical: list[OutputItem] = []
    """Vertical outputs x1."""


class TaskOutputs(Strict):
    """Roles of the outputs in the task, by the names of their rows (``tip_x``)."""

    primary: list[str] = []
    """Reducing outputs that follow the primary reference; all if neither primary nor redundant outputs are given."""
    redundant: list[str] = []
    """Reducing outputs that the controller uses to move the vertical outputs."""
    vertical: list[str] | None = None
    """Vertical outputs of the task; all by default."""
