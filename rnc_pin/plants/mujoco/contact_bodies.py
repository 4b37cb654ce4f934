"""Bodies of the ground contacts of a robot: wheels, balls and casters, and drawn wheels without joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError
from rnc_pin.model.mechanisms import Friction, GroundContact, carrier_of
from rnc_pin.model.rows import Rows
from rnc_pin.robots.robot import Robot

_ALONG = 1e-3  # tolerance of the distance from a drawn wheel to its axle, in radii
_LARGE = 0.5  # fraction of the largest cylinder radius on an axle; smaller cylinders are shafts or hubs
_UP = np.array([0.0, 0.0, 1.0])
_POINT = 1e-3  # radius of the ball that models a contact point [m]


@dataclass(frozen=True)
class ContactBody:
    """Round body in contact with the ground.

    Attributes:
        name: name of its frame; with a number if a frame has several.
        joint: index of the joint whose body carries it.
        center: center (3,) in the joint frame [m].
        axle: axle direction (3,) in the joint frame; None for a ball.
        radius: radius [m].
        friction: directions with friction.
        drawn: True for a drawn wheel without a joint.
        blade: True for a point that glides along its heading, without a drawn wheel.
        up: vertical direction (3,) in the joint frame.
    """

    name: str
    joint: int
    center: np.ndarray
    axle: np.ndarray | None
    radius: float
    friction: Friction = "all"
    drawn: bool = False
    blade: bool = False
    up: np.ndarray = field(default_factory=_UP.copy)

    def at(self, placement: pin.SE3) -> tuple[np.ndarray, np.ndarray]:
        """Return its center and its lowest point (3,) in the world, for a placement of its joint."""
        center = placement.act(self.center)
        if self.axle is None or self.blade:
            return center, center - self.radius * _UP
        axle = placement.rotation @ self.axle
        down = axle[2] * axle - _UP
        return center, center + self.radius / max(down.dot(down) ** 0.5, 1e-9) * down


def contact_bodies(robot: Robot, blocks: Sequence[Rows]) -> list[ContactBody]:
    """Return the bodies of all ground contacts, in the order of the constraints.

    Raises:
        ConfigurationError: a wheel has oblique rollers, for which the robot has no bodies, or a body rolls on another
            ground than z = 0 at rest.
    """
    for block in blocks:
        if block.ground is not None:
            carrier = carrier_of(block.ground)
            of_frame = f" that frame '{carrier}' carries" if carrier else ""
            raise ConfigurationError(
                f"MuJoCo: {block.names[0]} rolls on a {type(block.ground).__name__}{of_frame}; the plant has only "
                "the plane z = 0 at rest, use the plant 'reduced'"
            )
    mechanisms = (each for block in blocks for each in block.mechanisms() if isinstance(each, GroundContact))
    return [body for contact in mechanisms for body in _bodies(robot, contact)]


def _bodies(robot: Robot, contact: GroundContact) -> list[ContactBody]:
    """Return the body of a contact; of a runner the wheels that are drawn on its axle, or a blade if there are none."""
    if contact.friction == "oblique":
        raise ConfigurationError(
            f"MuJoCo: wheel '{contact.frame}' has oblique rollers, for which the robot has no bodies; expected a "
            "wheel, an omni wheel (roller=0), a wheel that skids (lateral=False), a ball or a caster"
        )
    frame = robot.model.frames[robot.frame_id(contact.frame)]
    joint, center = frame.parentJoint, frame.placement.act(contact.center)
    axle = None if contact.axle is None else frame.placement.rotation @ contact.axle
    if contact.radius is not None:
        return [ContactBody(contact.frame, joint, center, axle, contact.radius, contact.friction)]
    assert axle is not None
    wheels = _drawn(robot, joint, center, axle)
    if not wheels:
        return [ContactBody(contact.frame, joint, center, axle, 0.0, contact.friction, blade=True)]
    names = [contact.frame] if len(wheels) == 1 else [f"{contact.frame}[{number}]" for number in range(len(wheels))]
    return [
        ContactBody(name, joint, middle, axle, radius, contact.friction, drawn=True)
        for name, (middle, radius) in zip(names, wheels, strict=True)
    ]


def _drawn(robot: Robot, joint: int, middle: np.ndarray, axle: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Return centers and radii of the cylinders on an axle, sorted along it, without hubs and shafts."""
    largest: dict[float, float] = {}
    for geometry in (robot.visual_model, robot.collision_model):
        for shape in [] if geometry is None else geometry.geometryObjects:
            if shape.parentJoint != joint or not _is_cylinder(shape.geometry):
                continue
            offset = shape.placement.translation - middle
            along, radius = float(offset @ axle), float(shape.geometry.radius)
            if abs(shape.placement.rotation[:, 2] @ axle) < 0.9999:
                continue
            if np.linalg.norm(offset - along * axle) < _ALONG * radius:
                place = round(along, 6)
                largest[place] = max(radius, largest.get(place, 0.0))
        if largest:
            break
    enough = _LARGE * max(largest.values(), default=0.0)
    return [(middle + along * axle, radius) for along, radius in sorted(largest.items()) if radius >= enough]


def _is_cylinder(geometry: object) -> bool:
    return hasattr(geometry, "halfLength") and type(geometry).__name__ == "Cylinder"


# ------------------------------------------------------------------ level ground


def on_one_plane(robot: Robot, contacts: Sequence[ContactBody], q: np.ndarray) -> tuple[list[ContactBody], float]:
    """Return contacts with their lowest points in one plane, and the height of that plane in the robot model [m].

    Radii change by small gaps, since rounding in the robot file would otherwise decide which wheels carry the load.

    Raises:
        ConfigurationError: a wheel is above the ground.
    """
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    low = {each.name: float(each.at(data.oMi[each.joint])[1][2]) for each in contacts if not each.blade}
    wheels = list(low.values()) or [float(each.at(data.oMi[each.joint])[0][2]) for each in contacts if each.blade]
    ground = min(wheels)
    found = []
    for each in contacts:
        placement = data.oMi[each.joint]
        each = replace(each, up=placement.rotation.T @ _UP)
        if each.blade:
            center, _ = each.at(placement)
            found.append(replace(each, radius=float(center[2]) - ground))
            continue
        if not each.radius:  # the ball is above its contact point for any orientation of the frame
            each = replace(each, radius=_POINT, center=each.center + _POINT * each.up)
        gap = low[each.name] - ground
        if gap > 0.01 * each.radius:
            raise ConfigurationError(
                f"MuJoCo: wheel '{each.name}' is {gap:.3g} m above the ground plane of the other wheels"
            )
        found.append(replace(each, radius=each.radius + gap))
    return found, ground
