"""Actuated joints of an MJCF."""

from __future__ import annotations

from xml.etree import ElementTree

import pinocchio as pin

_ON_JOINTS = ("joint", "jointinparent")


def mark_passive_joints(model: pin.Model, root: ElementTree.Element) -> None:
    """Set the effort limits of joints without an actuator to zero, as a URDF does for passive joints.

    The model does not change if the file has no actuators, or if an actuator acts along a spatial tendon.

    Args:
        model: model of the file.
        root: root element of the file, with named joints.
    """
    driven = _driven(root)
    if not driven:
        return
    for joint in model.joints[1:]:
        if str(model.names[joint.id]) not in driven:
            entries = slice(joint.idx_v, joint.idx_v + joint.nv)
            for limit in (model.effortLimit, model.upperEffortLimit, model.lowerEffortLimit):
                limit[entries] = 0.0


def _driven(root: ElementTree.Element) -> set[str]:
    """Names of joints driven directly or by fixed tendons; empty if they are unknown."""
    names = {str(joint.get("name")) for joint in root.findall("worldbody//joint")}
    tendons = {
        str(tendon.get("name")): {str(joint.get("joint")) for joint in tendon.findall("joint")}
        for tendon in root.findall("tendon/fixed")
    }
    driven: set[str] = set()
    for actuator in root.findall("actuator/*"):
        driven |= {actuator.get(key, "") for key in _ON_JOINTS if key in actuator.attrib}
        tendon = actuator.get("tendon")
        if tendon is not None:
            if tendon not in tendons:
                return set()  # spatial tendon
            driven |= tendons[tendon]
    return {name for name in names if name in driven or name.rstrip("0123456789") in driven - names}  # repeated bodies
