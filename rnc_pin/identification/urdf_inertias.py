"""Copy of a URDF with other inertias, damping and friction."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError
from rnc_pin.identification.urdf_tree import read_tree, write_tree
from rnc_pin.robots.robot import Robot


def write_inertias(source: Path, path: Path, robot: Robot, bodies: list[str], joints: list[str]) -> None:
    """Write a URDF whose bodies have the inertias of a robot, and whose joints its damping and friction.

    The link behind a joint gets the inertia of its whole body, and links that are fixed to it get none.

    Args:
        source: the URDF.
        path: file to write.
        robot: robot with the same joints.
        bodies: joints whose bodies get new inertias.
        joints: joints that get new damping and friction.

    Raises:
        ConfigurationError: the source cannot be read, or has other joints.
    """
    root, elements = read_tree(source)
    model = robot.model
    links = {str(each.get("name")): each for each in root.iter("link")}
    children = {str(_found(each, "child").get("link")) for each in elements.values()}
    top = next((name for name in links if name not in children), "")
    for name in bodies:
        index = robot.joint_id(name)
        if name != "root_joint" and name not in elements:
            raise ConfigurationError(f"{source}: no joint '{name}'")
        carrier = top if name == "root_joint" else str(_found(elements[name], "child").get("link"))
        for link in links:
            if link != carrier and model.existFrame(link) and model.frames[robot.frame_id(link)].parentJoint == index:
                for inertial in links[link].findall("inertial"):
                    links[link].remove(inertial)
        place = model.frames[robot.frame_id(carrier)].placement.inverse()
        _write(links[carrier], place.act(model.inertias[index]))
    for name in joints:
        entry = robot.velocity_indices(name).start
        dynamics = elements[name].find("dynamics")
        if dynamics is None:
            dynamics = SubElement(elements[name], "dynamics")
        dynamics.set("damping", f"{model.damping[entry]:.12g}")
        dynamics.set("friction", f"{model.upperDryFrictionLimit[entry]:.12g}")
    write_tree(root, path)


def _found(element: Element, role: str) -> Element:
    found = element.find(role)
    if found is None:
        raise ConfigurationError(f"joint '{element.get('name')}' has no <{role}>")
    return found


def _write(link: Element, inertia: pin.Inertia) -> None:
    for each in link.findall("inertial"):
        link.remove(each)
    inertial = SubElement(link, "inertial")
    numbers = " ".join(f"{each:.17g}" for each in inertia.lever)
    SubElement(inertial, "origin", {"xyz": numbers, "rpy": "0 0 0"})
    SubElement(inertial, "mass", {"value": f"{inertia.mass:.17g}"})
    moments = np.asarray(inertia.inertia)
    keys = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    SubElement(inertial, "inertia", {key: f"{moments[at]:.17g}" for key, at in keys.items()})
