"""Where the robot of a scenario comes from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from rnc_pin.robot import Robot
from rnc_pin.scenario.schema.base import Strict
from rnc_pin.urdf_files import find_urdf


class Attachment(Strict):
    """A robot of fixed base, mounted on a frame of another."""

    robot: RobotSource
    frame: str
    xyz: Annotated[list[float], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]
    """Of its base in that frame [m]."""
    rpy: Annotated[list[float], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]
    """Roll, pitch and yaw of its base in that frame [rad]."""


class RobotSource(Strict):
    """Where the robot comes from: one of ``urdf`` and ``example``."""

    urdf: str | None = None
    """A file, relative to the scenario's, or the name of one shipped with rnc_pin."""
    example: str | None = None
    """A robot of example-robot-data."""
    base: Literal["fixed", "planar", "free"] = "fixed"
    package_dirs: list[str] = []
    lock: dict[str, float | list[float]] = {}
    gravity: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None

    attach: list[Attachment] = []
    """Robots mounted on this one."""

    @model_validator(mode="after")
    def _one_source(self) -> RobotSource:
        if (self.urdf is None) == (self.example is None):
            raise ValueError("expected one of 'urdf' and 'example'")
        return self

    def build(self, folder: Path) -> Robot:
        robot = self._alone(folder)
        for each in self.attach:
            turn = pin.rpy.rpyToMatrix(np.array(each.rpy))
            robot = robot.attach(each.robot.build(folder), each.frame, pin.SE3(turn, np.array(each.xyz)))
        return robot

    def _alone(self, folder: Path) -> Robot:
        if self.example is not None:
            return Robot.from_example(self.example, self.base, self.lock or None, self.gravity)
        assert self.urdf is not None
        packages = [folder / each for each in self.package_dirs]
        return Robot.from_urdf(find_urdf(self.urdf, folder), self.base, packages, self.lock or None, self.gravity)
