"""Outputs in a scenario file, and how a task divides them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

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
from rnc_pin.scenario.schema.base import Strict
from rnc_pin.scenario.schema.derived import Entry, one_of

OutputItem = Annotated[
    OutputKind,
    one_of(
        joint=Entry(JointPosition, only="joint"),
        frame_position=FramePosition,
        frame_orientation=Entry(FrameOrientation, only="frame"),
        frame_yaw=Entry(FrameYaw, only="frame"),
        distance=Distance,
        frame_speed=FrameSpeed,
        frame_spin=Entry(FrameSpin, required=("axis",)),
        frame_tilt=Entry(FrameTilt, required=("axis",)),
    ),
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
