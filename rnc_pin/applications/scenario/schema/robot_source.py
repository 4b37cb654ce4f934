"""Source of the robot in a scenario file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from rnc_pin.applications.scenario.schema.base import Strict
from rnc_pin.robots import Robot, find_mjcf, find_urdf


class Attachment(Strict):
    """Robot with a fixed base, mounted on a frame of another robot."""

    robot: RobotSource
    """The mounted robot."""
    frame: str
    """Frame of the carrying robot."""
    xyz: Annotated[list[float], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]
    """Position of the base of the mounted robot in that frame [m]."""
    rpy: Annotated[list[float], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]
    """Roll, pitch and yaw of the base of the mounted robot in that frame [rad]."""


class RobotSource(Strict):
    """Source of the robot: one of ``urdf``, ``mjcf`` and ``example``."""

    urdf: str | None = None
    """URDF or xacro file, relative to the scenario file, or the name of a file that rnc_pin contains."""
    mjcf: str | None = None
    """MJCF file, relative to the scenario file."""
    example: str | None = None
    """Name of a robot of example-robot-data."""
    base: Literal["fixed", "planar", "free"] = "fixed"
    """Joint between the root link and the world. For an MJCF file the default is the base in the file."""
    package_dirs: list[str] = []
    """Further folders of files and packages that the robot's file may use, relative to the scenario file."""
    xacro_arguments: dict[str, str | float | bool] = {}
    """Arguments of a xacro file: name to value."""
    lock: dict[str, float | list[float]] = {}
    """Joints to lock: name to position [rad or m]."""
    masses: dict[str, float] = {}
    """Masses of links without a valid inertia: name to mass [kg], distributed over the geometry of the link."""
    snap: bool = True
    """True to correct rounded angles and axes of joints in the file to their exact values."""
    gravity: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None
    """Gravity vector in the world frame [m/s^2]."""

    attach: list[Attachment] = []
    """Robots mounted on this one."""

    @model_validator(mode="after")
    def _one_source(self) -> RobotSource:
        if [self.urdf, self.mjcf, self.example].count(None) != 2:
            raise ValueError("expected one of 'urdf', 'mjcf' and 'example'")
        if self.xacro_arguments and self.urdf is None:
            raise ValueError("'xacro_arguments' belongs to 'urdf'")
        if self.package_dirs and self.example is not None:
            raise ValueError("'package_dirs' belongs to 'urdf' and 'mjcf'")
        if self.masses and self.mjcf is not None:
            raise ValueError("'masses' belongs to 'urdf' and 'example'")
        return self

    def build(self, folder: Path) -> Robot:
        robot = self._alone(folder)
        for each in self.attach:
            turn = pin.rpy.rpyToMatrix(np.array(each.rpy))
            robot = robot.attach(each.robot.build(folder), each.frame, pin.SE3(turn, np.array(each.xyz)))
        return robot

    def _alone(self, folder: Path) -> Robot:
        lock, snap, masses = self.lock or None, self.snap, self.masses
        packages = [folder / each for each in self.package_dirs]
        if self.example is not None:
            return Robot.from_example(self.example, self.base, lock, self.gravity, snap=snap, masses=masses)
        if self.mjcf is not None:
            base = self.base if "base" in self.model_fields_set else None
            path = find_mjcf(self.mjcf, folder)
            return Robot.from_mjcf(path, base, lock, self.gravity, package_dirs=packages, snap=snap)
        assert self.urdf is not None
        arguments = self.xacro_arguments or None
        path = find_urdf(self.urdf, folder)
        return Robot.from_urdf(path, self.base, packages, lock, self.gravity, arguments, snap=snap, masses=masses)
