"""Which joints a file says are driven: by transmissions, ros2_control and plugins of simulators."""

from __future__ import annotations

import re
from collections.abc import Iterator
from xml.etree import ElementTree

_ONLY_READS = re.compile("state_?publisher|p3d|odometry_?publisher", re.IGNORECASE)


def driven_joints(robot: ElementTree.Element) -> frozenset[str]:
    """Names of the joints of a URDF that something drives; none where the file does not say."""
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
    """Texts of elements such as ``<left_joint>`` or ``<joint_name>``, several of them with blanks or commas between."""
    for plugin in robot.iterfind("gazebo/plugin"):
        if _ONLY_READS.search(f"{plugin.get('name')} {plugin.get('filename')}"):
            continue
        for element in plugin.iter():
            if "joint" in element.tag.lower() and element.text:
                yield from re.split(r"[\s,]+", element.text.strip())
