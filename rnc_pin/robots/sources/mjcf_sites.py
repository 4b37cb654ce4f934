"""Placement of MJCF sites. Pinocchio misplaces sites of a body that is fixed to another fixed body."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.robots.sources.description import read_numbers


def place_sites(model: pin.Model, root: ElementTree.Element, radians: float) -> None:
    """Set the frames of all named sites.

    Args:
        model: model that Pinocchio read from the file.
        root: root element of the file, with explicit defaults (``make_plain``) and checked numbers.
        radians: radians per unit of the file's angles.
    """
    compiler = root.find("compiler")
    sequence = "xyz" if compiler is None else compiler.get("eulerseq", "xyz")
    for body in root.iter("body"):
        carrier = model.frames[model.getFrameId(str(body.get("name")), pin.FrameType.BODY)]
        for site in body.findall("site"):
            name = site.get("name")
            if name and model.existFrame(name, pin.FrameType.OP_FRAME):
                frame = model.frames[model.getFrameId(name, pin.FrameType.OP_FRAME)]
                frame.placement = carrier.placement * placement(site, sequence, radians)


def placement(element: ElementTree.Element, sequence: str, radians: float) -> pin.SE3:
    """Placement of a site or body in its parent body.

    Args:
        element: element of the site or body.
        sequence: axes of its ``euler``, in lower case.
        radians: radians per unit of the file's angles.
    """
    ends = _numbers(element, "fromto")
    if ends is not None:
        return pin.SE3(_from_z(ends[:3] - ends[3:]), (ends[:3] + ends[3:]) / 2)
    place = _numbers(element, "pos")
    return pin.SE3(_turn(element, sequence, radians), np.zeros(3) if place is None else place)


def _turn(element: ElementTree.Element, sequence: str, radians: float) -> np.ndarray:
    said = {key: _numbers(element, key) for key in ("axisangle", "euler", "xyaxes", "zaxis", "quat")}
    key, numbers = next(((key, numbers) for key, numbers in said.items() if numbers is not None), ("", np.zeros(0)))
    if key == "axisangle":
        return pin.AngleAxis(radians * numbers[3], numbers[:3]).matrix()
    if key == "euler":
        turn = np.eye(3)
        for axis, angle in zip(sequence, numbers, strict=True):
            turn = turn @ pin.AngleAxis(radians * angle, np.eye(3)["xyz".index(axis)]).matrix()
        return turn
    if key == "xyaxes":
        x = numbers[:3] / np.linalg.norm(numbers[:3])
        y = numbers[3:] - x * x.dot(numbers[3:])
        y = y / np.linalg.norm(y)
        return np.column_stack([x, y, np.cross(x, y)])
    if key == "zaxis":
        return _from_z(numbers)
    if key == "quat":
        scalar, *rest = numbers / np.linalg.norm(numbers)
        return pin.Quaternion(scalar, *rest).matrix()
    return np.eye(3)


def _from_z(direction: np.ndarray) -> np.ndarray:
    """Shortest rotation (3, 3) of z to a direction; about x if the direction is opposite."""
    axis = np.cross([0.0, 0.0, 1.0], direction)
    sine = float(np.linalg.norm(axis))
    return pin.AngleAxis(
        np.arctan2(sine, direction[2]), axis / sine if sine > 0 else np.array([1.0, 0.0, 0.0])
    ).matrix()


def _numbers(element: ElementTree.Element, key: str) -> np.ndarray | None:
    return read_numbers(element.get(key, "")) if key in element.attrib else None
