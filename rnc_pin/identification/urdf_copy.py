"""Copies of a URDF with other places of joints."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, SubElement, tostring

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError
from rnc_pin.io.json import atomic_file
from rnc_pin.io.safe_read import parse_tree, read_bytes
from rnc_pin.robots.robot import Robot

_SAME = 1e-9  # difference of placements below which an origin is not written again


def write_places(source: Path, path: Path, robot: Robot, sensor: str | None) -> None:
    """Write a URDF whose movable joints, and the fixed joint of a sensor, have the places of a robot.

    Args:
        source: the URDF.
        path: file to write.
        robot: robot with the same joints.
        sensor: link that is fixed to a body, if its place is new.

    Raises:
        ConfigurationError: the source cannot be read, has other joints, or no fixed joint of the sensor.
    """
    root, joints = _read(source)
    model = robot.model
    for index in range(1, model.njoints):
        name = model.names[index]
        if name == "root_joint":
            continue
        if name not in joints or joints[name].get("type") == "fixed":
            raise ConfigurationError(f"{source}: no joint '{name}' that moves")
        _place(joints[name], robot, model.jointPlacements[index])
    if sensor is not None:
        mounts = [each for each in joints.values() if (_link(each, "child"), each.get("type")) == (sensor, "fixed")]
        if not mounts:
            raise ConfigurationError(f"{source}: no fixed joint carries '{sensor}': its place cannot be written")
        _place(mounts[0], robot, model.frames[robot.frame_id(sensor)].placement)
    _write(root, path)


def _link(joint: Element, role: str) -> str:
    found = joint.find(role)
    return "" if found is None else str(found.get("link"))


def _place(joint: Element, robot: Robot, place: pin.SE3) -> None:
    """Write the origin of a joint whose placement in the axes of the carrying body is ``place``."""
    parent = robot.model.frames[robot.frame_id(_link(joint, "parent"))].placement
    here = parent.inverse() * place
    origin = joint.find("origin")
    if origin is None:
        origin = SubElement(joint, "origin")
    xyz = np.array((origin.get("xyz") or "0 0 0").split(), dtype=float)
    rpy = np.array((origin.get("rpy") or "0 0 0").split(), dtype=float)
    if np.abs(here.translation - xyz).max() > _SAME:
        origin.set("xyz", " ".join(f"{each:.12g}" for each in here.translation))
    if np.abs(here.rotation - pin.rpy.rpyToMatrix(rpy)).max() > _SAME:
        origin.set("rpy", " ".join(f"{each:.12g}" for each in pin.rpy.matrixToRpy(here.rotation)))


def _read(source: Path) -> tuple[Element, dict[str, Element]]:
    """Root of a URDF, and its joints by name.

    Raises:
        ConfigurationError: the source cannot be read.
    """
    try:
        root = parse_tree(read_bytes(source))
    except OSError as error:
        raise ConfigurationError(f"{source}: {error.strerror or 'cannot be read'}") from None
    except ParseError as error:
        raise ConfigurationError(f"{source}: not a URDF: {error}") from None
    return root, {str(each.get("name")): each for each in root.iter("joint") if each.find("child") is not None}


def _write(root: Element, path: Path) -> None:
    """Write a URDF; a failure leaves no partial file."""
    with atomic_file(path) as partial:
        partial.write_bytes(tostring(root, encoding="utf-8", xml_declaration=True))
