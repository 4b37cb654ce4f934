"""Bodies that move on the ground, in top view: bodies with wheels, runners or balls, and all planar bases."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.model.cached_property import once_per_model
from rnc_pin.model.kinematics import Kinematics, PositionKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import GroundContact
from rnc_pin.robots.robot import Robot

_UPRIGHT = 0.7  # smallest vertical component of a unit vector that counts as vertical
_BESIDE = 0.02  # largest distance between a runner's contact and its steering axis; beyond, it is a trailer [m]
_SAME = 1e-6  # tolerance of equal points [m] and unit vectors


class _Contact(NamedTuple):
    """Ground contact of a body at one configuration."""

    joint: int
    point: np.ndarray
    """Contact point (3,) in the world [m]."""
    lateral: np.ndarray | None
    """Horizontal unit vector (3,) of the direction without slip; None for a ball."""
    beside: float
    """Largest distance to the steering axis [m]."""


class GroundBody(NamedTuple):
    """Body with a reference point and a heading, for drawing.

    Attributes:
        name: name of the body.
        joint: index of its joint.
        point: reference point (3,) in the joint frame [m].
        left: unit vector (3,) to the left in the joint frame; NaN for a ball, which has no heading.
    """

    name: str
    joint: int
    point: np.ndarray
    left: np.ndarray

    def poses(self, at: PositionKinematics) -> Float[Array, "*batch 3"]:
        """Position x, y [m] and heading [rad] at configurations, (..., 3).

        Args:
            at: kinematics at the configurations (..., nq).
        """
        rotation, translation = at.joint_placement(self.joint)
        place, left = translation + rotation @ self.point, rotation @ self.left
        return np.stack([place[..., 0], place[..., 1], np.arctan2(-left[..., 0], left[..., 1])], axis=-1)


@once_per_model
def ground_bodies(reduced: ReducedModel) -> tuple[GroundBody, ...]:
    """Bodies of a system that move on the ground, ordered from the base.

    Chassis and trailers are such bodies; wheels, steering and forks are not.

    Args:
        reduced: the model.
    """
    robot = reduced.robot
    model, data, neutral = robot.model, robot.model.createData(), robot.configuration()
    pin.computeJointJacobians(model, data, neutral)
    here = Kinematics(robot).position(neutral)
    turned = pin.integrate(model, neutral, np.random.default_rng(0).uniform(-0.4, 0.4, robot.nv))
    there = Kinematics(robot).position(turned)
    found: dict[int, list[tuple[_Contact, _Contact]]] = {
        joint: [] for joint in range(1, model.njoints) if "Planar" in model.joints[joint].shortname()
    }
    mechanisms = [each for place in reduced.all_constraints.places for each in place.block.mechanisms()]
    for mechanism in mechanisms:
        if not isinstance(mechanism, GroundContact) or mechanism.friction == "none":
            continue
        contacts = [_contact(mechanism, robot, position) for position in (here, there)]
        if contacts[0] is not None and contacts[1] is not None:
            joint = _carrier(model, data, contacts[0])
            found.setdefault(joint, []).append((contacts[0], contacts[1]))
    return tuple(_body(robot, joint, found[joint], here, there) for joint in sorted(found))


def ground_poses(bodies: Iterable[GroundBody], at: PositionKinematics) -> Float[Array, "*batch g"]:
    """Positions x, y and headings of all bodies at configurations, (..., 3 k) for k bodies.

    Args:
        bodies: the bodies (k,).
        at: kinematics at the configurations (..., nq).
    """
    poses = [body.poses(at) for body in bodies]
    return np.concatenate(poses, axis=-1) if poses else np.empty((*at.q.shape[:-1], 0))


def _contact(contact: GroundContact, robot: Robot, at: PositionKinematics) -> _Contact | None:
    """Contact at one configuration; None for a wheel or runner that lies flat."""
    frame = robot.frame_id(contact.frame)
    joint, (rotation, translation) = robot.model.frames[frame].parentJoint, at.placement(frame)
    point = translation + rotation @ contact.center
    if contact.axle is None:
        return _Contact(joint, point, None, 0.0)
    lateral = rotation @ contact.axle
    beside = _BESIDE if contact.radius is None else contact.radius
    return _Contact(joint, point, lateral, beside) if abs(lateral[2]) < _UPRIGHT else None


def _carrier(model: pin.Model, data: pin.Data, contact: _Contact) -> int:
    """Joint of the vehicle body above a wheel, its fork and its steering."""
    joint = contact.joint
    while _is_wheel_or_steering(model, data, joint, contact) and _turns(model, data, model.parents[joint]):
        joint = model.parents[joint]
    return joint


def _is_wheel_or_steering(model: pin.Model, data: pin.Data, joint: int, contact: _Contact) -> bool:
    kind = model.joints[joint]
    if kind.nv != 1:
        return "Spherical" in kind.shortname()
    column = _jacobian(model, data, joint)[:, kind.idx_v]
    axis = column[3:]
    if np.linalg.norm(axis) < _UPRIGHT:  # prismatic
        return False
    away = (contact.point - data.oMi[joint].translation)[:2]
    return abs(axis[2]) < _UPRIGHT or float(np.linalg.norm(away)) <= contact.beside


def _turns(model: pin.Model, data: pin.Data, joint: int) -> bool:
    """True if a body can rotate about the vertical."""
    return joint > 0 and float(np.abs(_jacobian(model, data, joint)[5]).max()) > _UPRIGHT


def _jacobian(model: pin.Model, data: pin.Data, joint: int) -> np.ndarray:
    """Joint Jacobian (6, nv). Pinocchio returns (6,) for one degree of freedom."""
    jacobian = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    return np.asarray(jacobian).reshape(6, model.nv)


def _body(
    robot: Robot,
    joint: int,
    contacts: Sequence[tuple[_Contact, _Contact]],
    here: PositionKinematics,
    there: PositionKinematics,
) -> GroundBody:
    (rotation, translation), (turned, moved) = here.joint_placement(joint), there.joint_placement(joint)
    points, fixed = [], []  # in the joint frame: contact points, and axles without steering
    for one, other in contacts:
        point = rotation.T @ (one.point - translation)
        if np.linalg.norm(point - turned.T @ (other.point - moved)) < _SAME:
            points.append(point)
        if one.lateral is not None and other.lateral is not None:
            lateral = rotation.T @ one.lateral
            if np.linalg.norm(lateral - turned.T @ other.lateral) < _SAME:
                fixed.append((point, lateral))
    left = _own_left(rotation)
    if fixed and all(np.linalg.norm(np.cross(fixed[0][1], lateral)) < _SAME for _, lateral in fixed):
        points, left = [point for point, _ in fixed], _toward(fixed[0][1], rotation)
    elif contacts and all(one.lateral is None and one.joint == joint for one, _ in contacts):
        left = np.full(3, np.nan)
    name = next(iter(robot.links_of(joint)), str(robot.model.names[joint]))
    return GroundBody(name, joint, np.mean(points, axis=0) if points else np.zeros(3), left)


def _own_left(rotation: np.ndarray) -> np.ndarray:
    """Left unit vector of a body that faces along its own x axis, or along y if x is vertical."""
    ahead = rotation[:, 0] if abs(rotation[2, 0]) < _UPRIGHT else rotation[:, 1]
    left = np.cross([0.0, 0.0, 1.0], ahead)
    return rotation.T @ (left / np.linalg.norm(left))


def _toward(left: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Return the vector (3,) or its opposite, so that forward points along positive x or y of the body."""
    ahead = rotation.T @ np.cross(rotation @ left, [0.0, 0.0, 1.0])
    return left if ahead[int(np.argmax(np.abs(ahead)))] >= 0 else -left
