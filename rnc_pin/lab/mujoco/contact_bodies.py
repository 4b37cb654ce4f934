"""Settings of the MuJoCo plant, bodies of its ground contacts, and the support of a vehicle whose model is planar.

Bodies are wheels, balls and casters, and drawn wheels without joints. A vehicle stands on its wheels, on added casters,
or is kept level. This module does not import MuJoCo: scenario files have settings without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import coal
import numpy as np
import pinocchio as pin
import scipy
from numpy import ndarray as Array

from rnc_pin.constraints import GroundPlane
from rnc_pin.errors import ConfigurationError, argument, check_known
from rnc_pin.model.input_validation import NotNegative, Positive, check_settings, is_number
from rnc_pin.model.rows import Friction, GroundContact, Rows, carrier_of
from rnc_pin.robots.robot import Robot

_UP = np.array([0.0, 0.0, 1.0])

Integrator = Literal["implicitfast", "implicit", "Euler", "RK4"]
Stance = Literal["auto", "free", "level"]
Root = Literal["as it is", "free", "level"]
"""Type of a planar base in MuJoCo: planar as it is, six degrees of freedom, or planar with vertical motion."""


@dataclass(frozen=True)
class MuJoCoSettings:
    """Settings of ``MuJoCoPlant``.

    Args:
        step: time step of MuJoCo [s]; reduced slightly so that the sampling period is a multiple of it.
        integrator: "RK4" for motion without contacts, where it agrees with the reduced model to many digits;
            "implicitfast", "implicit" and "Euler" are of first order and cheaper.
        friction: friction coefficients of wheels and blades: sliding [1], torsional [m], rolling [m].
        contact_time: time constant of contacts [s]; at least four steps, which is the default. The penetration under
            the weight is 10 m/s^2 times its square.
        stance: support of a vehicle whose model is planar. "free": six degrees of freedom; it can lean and tip.
            "level": it moves vertically but cannot lean, so its wheels share the weight evenly. "auto": free if its
            wheels carry it, level if it would tip.
        casters: add frictionless supports to a vehicle of stance "free"; "auto" adds them if its wheels alone do not
            carry it.
        settling: time before a run in which the vehicle comes to rest on the ground with fixed joints [s].
        joint_limits: enforce the position limits of the robot file.
        joint_damping: apply the viscous joint damping of the robot file.
        effort_limits: clip inputs to the limits of the actuators.

    Raises:
        ConfigurationError: a value is not a listed choice or not a valid number.

    Example:
        >>> from rnc_pin.lab.mujoco import MuJoCoSettings
        >>> MuJoCoSettings(friction=(0.4, 0.0, 0.0)).friction[0]
        0.4
        >>> try:
        ...     MuJoCoSettings(integrator="euler")
        ... except rnc.ConfigurationError as error:
        ...     print(error)
        MuJoCo: integrator 'euler' is not known; did you mean 'Euler'?
    """

    step: Positive = 0.0005
    integrator: Integrator = "RK4"
    friction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    contact_time: NotNegative = 0.0
    stance: Stance = "auto"
    casters: Literal["auto"] | bool = "auto"
    settling: NotNegative = 0.2
    joint_limits: bool = False
    joint_damping: bool = False
    effort_limits: bool = False

    @property
    def contact_time_constant(self) -> float:
        """Time constant of contacts [s]."""
        return max(self.contact_time, 4 * self.step)

    def __post_init__(self) -> None:
        # Words of each setting.
        listed = {"integrator": get_args(Integrator), "stance": get_args(Stance), "casters": ("auto", True, False)}
        for name, choices in listed.items():
            check_known(getattr(self, name), choices, f"MuJoCo: {name}")
        check_settings(self)
        friction = self.friction if isinstance(self.friction, Sequence | np.ndarray) else ()
        if len(friction) != 3 or not all(is_number(each) and each >= 0 for each in friction):
            raise ConfigurationError(
                "MuJoCo: friction: expected three numbers of at least 0 (sliding, torsional, rolling), found "
                f"{self.friction!r}"
            )


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
    center: Array
    axle: Array | None
    radius: float
    friction: Friction = "all"
    drawn: bool = False
    blade: bool = False
    up: Array = field(default_factory=_UP.copy)

    def at(self, placement: pin.SE3, up: Array = _UP) -> tuple[Array, Array]:
        """Return its center and its lowest point (3,) in the world.

        Args:
            placement: placement of its joint.
            up: normal of the ground (3,).
        """
        center = placement.act(self.center)
        if self.axle is None or self.blade:
            return center, center - self.radius * up
        axle = placement.rotation @ self.axle
        down = (axle @ up) * axle - up
        # A wheel that lies flat has no lowest point: any finite one will do.
        return center, center + self.radius / max(down.dot(down) ** 0.5, 1e-9) * down


def common_plane(blocks: Sequence[Rows]) -> GroundPlane:
    """Return the plane at rest on which all bodies roll.

    Args:
        blocks: bound constraints.

    Raises:
        ConfigurationError: a ground that is curved, moves or is carried by a frame, or several planes.
    """
    first: tuple[str, GroundPlane] | None = None
    tolerance = 1e-9  # distance [m] and difference of normals up to which planes are the same
    for block in blocks:
        ground = block.ground
        if ground is None and not block.on_ground:
            continue
        plane = GroundPlane() if ground is None else ground
        if not isinstance(plane, GroundPlane) or plane.moves or plane.frame is not None:
            what = f"that frame '{carrier_of(ground)}' carries" if carrier_of(ground) else "that is curved or moves"
            raise ConfigurationError(
                f"MuJoCo: {block.names[0]} rolls on a {type(ground).__name__} {what}; the plant has only a plane at "
                "rest, use the plant 'reduced'"
            )
        first = first or (block.names[0], plane)
        name, other = first
        off = max(abs(plane.height(each)) for each in other.axes[:2] + other.point)
        if off > tolerance or plane.axes[2] @ other.axes[2] < 1.0 - tolerance:
            raise ConfigurationError(
                f"MuJoCo: {name} and {block.names[0]} roll on different planes; the plant has only one, use the plant "
                "'reduced'"
            )
    return first[1] if first else GroundPlane()


def contact_bodies(robot: Robot, blocks: Sequence[Rows]) -> list[ContactBody]:
    """Return the bodies of all ground contacts, in the order of the constraints.

    Args:
        robot: the robot.
        blocks: bound constraints.

    Raises:
        ConfigurationError: a wheel has oblique rollers, for which the robot has no bodies.
    """
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


def _drawn(robot: Robot, joint: int, middle: Array, axle: Array) -> list[tuple[Array, float]]:
    """Return centers and radii of the cylinders on an axle, sorted along it, without hubs and shafts."""
    largest: dict[float, float] = {}
    tolerance = 1e-3  # of the distance from a drawn wheel to its axle, in radii
    # Drawn shapes first: collision shapes may be simplified.
    for geometry in (robot.visual_model, robot.collision_model):
        for shape in [] if geometry is None else geometry.geometryObjects:
            if shape.parentJoint != joint or not isinstance(shape.geometry, coal.Cylinder):
                continue
            offset = shape.placement.translation - middle
            along, radius = float(offset @ axle), float(shape.geometry.radius)
            if abs(shape.placement.rotation[:, 2] @ axle) < 0.9999:
                continue
            if np.linalg.norm(offset - along * axle) < tolerance * radius:
                # A rim and a tire are at one place: the larger one touches the ground.
                place = round(along, 6)
                largest[place] = max(radius, largest.get(place, 0.0))
        if largest:
            break
    least = 0.5  # fraction of the largest cylinder radius on an axle; smaller cylinders are shafts or hubs
    enough = least * max(largest.values(), default=0.0)
    return [(middle + along * axle, radius) for along, radius in sorted(largest.items()) if radius >= enough]


# ------------------------------------------------------------------ common plane


def on_one_plane(
    robot: Robot, contacts: Sequence[ContactBody], q: Array, plane: GroundPlane
) -> tuple[list[ContactBody], float]:
    """Return contacts with their lowest points at one height above the ground, and this height in the robot model [m].

    Radii change by small gaps, since rounding in the robot file would otherwise decide which wheels carry the load.

    Args:
        robot: the robot.
        contacts: its contacts.
        q: configuration (nq,).
        plane: the ground.

    Raises:
        ConfigurationError: a wheel is above the ground.
    """
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    up = plane.axes[2]
    low = {each.name: plane.height(each.at(data.oMi[each.joint], up)[1]) for each in contacts}
    ground = min([low[each.name] for each in contacts if not each.blade] or low.values())
    found = []
    point_radius = 1e-3  # of the ball that models a contact point [m]
    for each in contacts:
        each = replace(each, up=data.oMi[each.joint].rotation.T @ up)
        if not each.radius and not each.blade:  # the ball is above its contact point for any orientation of the frame
            each = replace(each, radius=point_radius, center=each.center + point_radius * each.up)
        gap = low[each.name] - ground
        # More than rounding of a file: the wheel does not touch, and may not be made larger. A blade reaches down.
        if gap > 0.01 * each.radius and not each.blade:
            raise ConfigurationError(
                f"MuJoCo: wheel '{each.name}' is {gap:.3g} m above the ground plane of the other wheels"
            )
        found.append(replace(each, radius=each.radius + gap))
    return found, ground


# ---------------------------------------------------------------------- support of a vehicle


# Smallest distance of the center of mass to the edge of the support polygon, over the polygon size.
_SUPPORT_MARGIN = 0.1
_LEVEL_TOLERANCE = 1e-6


def choose_support(
    robot: Robot, contacts: Sequence[ContactBody], ground: float, q: Array, settings: MuJoCoSettings, plane: GroundPlane
) -> tuple[Root, tuple[ContactBody, ...]]:
    """Return the base type in MuJoCo, and the frictionless casters that are added to the base.

    Args:
        robot: the robot.
        contacts: contacts on one plane.
        ground: height of the ground in the robot model [m].
        q: configuration (nq,).
        settings: stance and casters that are asked for.
        plane: the ground.

    Raises:
        ConfigurationError: no weight presses its wheels on the ground.
    """
    if not contacts:
        return "as it is", ()
    down, base = robot.model.gravity.linear, robot.model.joints[1].shortname()
    along, across = np.linalg.norm(plane.axes[:2] @ down), float(plane.axes[2] @ down)
    level = along < _LEVEL_TOLERANCE * abs(across)
    if across >= 0 or not (level or base == "JointModelFreeFlyer"):
        raise ConfigurationError(
            f"MuJoCo: friction of wheel '{contacts[0].name}' needs weight, and gravity is "
            f"{np.round(down, 6).tolist()}: expected one that points down onto level ground, such as (0, 0, -9.81), or "
            f"{argument('base', 'free')}"
        )
    if base == "JointModelFreeFlyer":
        return "as it is", ()
    if base != "JointModelPlanar" or any(each.joint == 0 for each in contacts):
        raise ConfigurationError(
            f"MuJoCo: nothing presses wheel '{contacts[0].name}' on the ground: load the robot with "
            f"{argument('base', 'planar')}, or 'free'"
        )
    if settings.stance == "level":
        return "level", ()
    data = robot.model.createData()
    columns = pin.computeJointJacobians(robot.model, data, q).reshape(6, robot.nv)
    points = np.array([each.at(data.oMi[each.joint])[1][:2] for each in contacts])
    weight = np.asarray(pin.centerOfMass(robot.model, data, q))[:2]
    upright = all(_stays_upright(robot, data, columns, each) for each in contacts)
    if upright and _carries(points, weight) and settings.casters is not True:
        return "free", ()
    # Casters carry nothing sideways: they only keep wheels on one line from tipping.
    added = _outriggers(points) if settings.casters is not False else None
    fits = added is not None and _carries(np.vstack([points, added]), weight)
    # A vehicle that would tip is kept level, or its run would be one of falling.
    if settings.stance == "auto" and not (upright and fits):
        return "level", ()
    casters = () if added is None else tuple(_support(data.oMi[1], k, at, ground) for k, at in enumerate(added))
    return "free", casters


def _stays_upright(robot: Robot, data: pin.Data, columns: Array, contact: ContactBody) -> bool:
    """Return True if only joints with vertical axes lie between the base and the body that carries a wheel."""
    model, joint = robot.model, contact.joint
    axle = None if contact.axle is None or contact.drawn else data.oMi[joint].rotation @ contact.axle
    while joint > 1:
        axis = columns[3:, model.joints[joint].idx_v]
        own = joint == contact.joint and axle is not None and abs(axis @ axle) > 1 - _LEVEL_TOLERANCE
        if model.joints[joint].nv != 1 or not (own or abs(axis[2]) > 1 - _LEVEL_TOLERANCE):
            return False
        joint = model.parents[joint]
    # MuJoCo's free base needs a mass.
    return bool(model.inertias[1].mass > 0)


def _carries(points: Array, weight: Array) -> bool:
    """Return True if a center of mass lies well inside the convex hull of points (k, 2)."""
    size = float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
    if len(points) < 3 or np.linalg.matrix_rank(points - points[0], tol=1e-3 * size) < 2:
        return False
    sides = scipy.spatial.ConvexHull(points).equations  # a x + b <= 0 inside, a of unit length
    return bool((sides[:, :2] @ weight + sides[:, 2] < -_SUPPORT_MARGIN * size).all())


def _outriggers(points: Array) -> Array | None:
    """Return two points in front of and behind collinear wheels, as far from their center as they are; else None."""
    middle = points.mean(axis=0)
    size = float(np.linalg.norm(points - middle, axis=1).max())
    _, spread, directions = np.linalg.svd(points - middle)
    if size < _LEVEL_TOLERANCE or spread[1] > 1e-3 * size:
        return None
    return middle + size * np.array([directions[1], -directions[1]])


def _support(base: pin.SE3, number: int, at: Array, ground: float) -> ContactBody:
    radius = 0.02  # of added casters [m]
    return ContactBody(f"caster[{number}]", 1, base.actInv(np.array([*at, ground + radius])), None, radius, "none")
