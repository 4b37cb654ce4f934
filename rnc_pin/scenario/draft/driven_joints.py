"""Driven joints of a URDF: named by transmissions, ros2_control and simulator plugins."""

from __future__ import annotations

import re
from collections.abc import Iterator
from xml.etree import ElementTree

_ONLY_READS = re.compile("state_?publisher|p3d|odometry_?publisher", re.IGNORECASE)


def driven_joints(robot: ElementTree.Element) -> frozenset[str]:
    """Return the names of the driven joints of a URDF; empty if the file does not name any."""
    joints = {str(joint.get("name")) for joint in robot.findall("joint")}
    return frozenset(joints & {*_transmissions(robot), *_ros2_control(robot), *_plugins(robot)})


def _transmissions(robot: ElementTree.Element) -> Iterator[str]:
    for joint in robot.iterfind(".//transmission/joint"):
        yield str(joint.get("name"))


def _ros2_control(robot: ElementTree.Element) -> Iterator[str]:
    for joint in robot.iterfind(".//ros2_control/joint"):
        if joint.find("command_interface") is not None:
            yield str(joint.get("name"))


def _plugins(robot: ElementTree.Element) -> Iterator[str]:
    """Names in elements such as ``<left_joint>`` or ``<joint_name>``, separated by blanks or commas."""
    for plugin in robot.iterfind("gazebo/plugin"):
        if _ONLY_READS.search(f"{plugin.get('name')} {plugin.get('filename')}"):
            continue
        for element in plugin.iter():
            if "joint" in element.tag.lower() and element.text:
                yield from re.split(r"[\s,]+", element.text.strip())
