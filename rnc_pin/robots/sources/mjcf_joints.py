"""Joints of MJCF: corrections where Pinocchio's parser differs from MuJoCo, and couplings between joints.

All functions take a file with explicit defaults (``make_plain``) and checked numbers.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelWarning
from rnc_pin.robots.sources.description import Mimic, read_numbers
from rnc_pin.robots.sources.mjcf_closures import KINDS


def complete(model: pin.Model, root: ElementTree.Element) -> None:
    """Set position limits, damping, armature and friction of all joints.

    Pinocchio reads limits of slides as degrees, and all limits relative to the joint's ``ref``. It does not damp ball
    joints. It misplaces free joints that are rotated in the file.
    """
    for joint in model.joints[1:]:
        if joint.shortname() == "JointModelFreeFlyer":
            model.jointPlacements[joint.id] = pin.SE3.Identity()
    compiler = root.find("compiler")
    automatic = compiler is None or compiler.get("autolimits", "true") == "true"
    axes = _axes(root)
    for element in root.findall("worldbody//joint"):
        name = str(element.get("name"))
        joint = model.joints[model.getJointId(name)]
        entries = slice(joint.idx_v, joint.idx_v + joint.nv)
        damping, armature, friction = (
            read_numbers(element.get(key, "0")) for key in ("damping", "armature", "frictionloss")
        )
        assert damping is not None  # checked before
        assert armature is not None
        assert friction is not None
        model.damping[entries], model.armature[entries] = damping[0], armature[0]
        model.lowerDryFrictionLimit[entries], model.upperDryFrictionLimit[entries] = -friction[0], friction[0]
        if name not in axes:
            continue
        low, high = _read(root, element, "range", "0 0")
        limited = element.get("limited", "auto")
        if limited == "false" or (limited == "auto" and not (automatic and low < high)):
            low, high = -np.inf, np.inf
        model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q] = low, high


def couplings(root: ElementTree.Element, path: Path) -> tuple[Mimic, ...]:
    """Return the joint equalities. A warning names tendons and other equalities, which are omitted."""
    mimics: list[Mimic] = []
    left_out: set[str] = set()
    rests = _rests(root)
    for element in root.findall("equality/*"):
        if element.get("active", "true") == "false":
            continue
        coefficients = read_numbers(element.get("polycoef", "0 1"))
        linear = coefficients is not None and 1 < coefficients.size <= 5 and not np.any(coefficients[2:])
        if element.tag == "joint" and element.get("joint1") and element.get("joint2") and linear:
            assert coefficients is not None
            offset, multiplier = map(float, coefficients[:2])
            joint, of = str(element.get("joint1")), str(element.get("joint2"))
            # The equality is between displacements from the configuration of the file.
            offset += rests.get(joint, 0.0) - multiplier * rests.get(of, 0.0)
            mimics.append(Mimic(joint, of, multiplier, offset))
        elif element.tag not in KINDS:
            left_out.add(f"<equality><{element.tag}>")
    if root.find("tendon/*") is not None:
        left_out.add("<tendon>")
    if left_out:
        text = f"{path}: {', '.join(sorted(left_out))} is left out of the model: add constraints for it"
        warnings.warn(text, ModelWarning, stacklevel=4)
    return tuple(mimics)


def in_radians(root: ElementTree.Element) -> bool:
    """True if the angles of the file are in radians; they are in degrees otherwise."""
    compiler = root.find("compiler")
    return compiler is not None and compiler.get("angle") == "radian"


def _rests(root: ElementTree.Element) -> dict[str, float]:
    """Position [rad or m] of each joint in the configuration of the file."""
    return {name: float(_read(root, joint, "ref", "0")[0]) for name, joint in _axes(root).items()}


def _axes(root: ElementTree.Element) -> dict[str, ElementTree.Element]:
    """Joint name to element of all hinges and slides."""
    joints = root.findall("worldbody//joint")
    return {str(each.get("name")): each for each in joints if each.get("type", "hinge") in ("hinge", "slide")}


def _read(root: ElementTree.Element, joint: ElementTree.Element, key: str, usual: str) -> np.ndarray:
    """Return the numbers of a hinge [rad] or a slide [m], which were checked before."""
    found = read_numbers(joint.get(key, usual))
    assert found is not None
    return np.deg2rad(found) if joint.get("type", "hinge") == "hinge" and not in_radians(root) else found
