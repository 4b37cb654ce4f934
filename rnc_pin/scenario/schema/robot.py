"""Where the robot of a scenario comes from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from rnc_pin.robots.robot import Robot
from rnc_pin.robots.urdf_files import find_mjcf, find_urdf
from rnc_pin.scenario.schema.base import Strict


class Attachment(Strict):
    """A robot of fixed base, mounted on a frame of another."""

    robot: RobotSource
    frame: str
    """Of the robot that carries it."""
    xyz: Annotated[list[float], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]
    """Of its base in that frame [m]."""
    rpy: Annotated[list[float], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]
    """Roll, pitch and yaw of its base in that frame [rad]."""


class RobotSource(Strict):
    """Where the robot comes from: one of ``urdf``, ``mjcf`` and ``example``."""

    urdf: str | None = None
    """A URDF or xacro file, relative to the scenario's, or the name of one shipped with rnc_pin."""
    mjcf: str | None = None
    """An MJCF file, relative to the scenario's."""
    example: str | None = None
    """A robot of example-robot-data."""
    base: Literal["fixed", "planar", "free"] = "fixed"
    """How the root link meets the world. For an MJCF the default is what the file says."""
    package_dirs: list[str] = []
    """Folders whose files the robot's file may name besides its own, and their packages; relative to the scenario's."""
    xacro_arguments: dict[str, str | float | bool] = {}
    """Values for the arguments of a xacro file."""
    lock: dict[str, float | list[float]] = {}
    """Joints to freeze, and the values to freeze them at [rad or m]."""
    masses: dict[str, float] = {}
    """Links whose inertia is not there or useless, and the masses they get [kg], spread over their geometry."""
    snap: bool = True
    """Make angles and axes of joints exact that the file holds rounded."""
    gravity: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None
    """Acceleration of gravity in the world frame [m/s^2]."""

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
