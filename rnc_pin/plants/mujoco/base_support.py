"""Support of a vehicle whose model is planar: on its wheels, on added casters, or kept level."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.constraints import GroundPlane
from rnc_pin.errors import ConfigurationError, argument
from rnc_pin.plants.mujoco.body_tree import Root
from rnc_pin.plants.mujoco.contact_bodies import ContactBody
from rnc_pin.plants.mujoco.settings import MuJoCoSettings
from rnc_pin.robots.robot import Robot

_MARGIN = 0.1  # smallest distance of the center of mass to the edge of the support polygon, over the polygon size
_LEVEL = 1e-6
_CASTER = 0.02  # radius of added casters [m]


class BaseSupport(NamedTuple):
    """Base type and added supports of a robot.

    Attributes:
        root: type of its base in MuJoCo.
        casters: frictionless supports that are added to its base.
        lift: height above its position in the robot model [m].
    """

    root: Root
    casters: tuple[ContactBody, ...] = ()
    lift: float = 0.0


def choose_support(
    robot: Robot,
    contacts: Sequence[ContactBody],
    ground: float,
    q: np.ndarray,
    settings: MuJoCoSettings,
    plane: GroundPlane,
) -> BaseSupport:
    """Choose base type and casters for a robot at configuration q, with the ground at height ``ground`` [m].

    Raises:
        ConfigurationError: no weight presses its wheels on the ground.
    """
    if not contacts:
        return BaseSupport("as it is")
    down, base = robot.model.gravity.linear, robot.model.joints[1].shortname()
    along, across = np.linalg.norm(plane.axes[:2] @ down), float(plane.axes[2] @ down)
    level = along < _LEVEL * abs(across)
    if across >= 0 or not (level or base == "JointModelFreeFlyer"):
        raise ConfigurationError(
            f"MuJoCo: friction of wheel '{contacts[0].name}' needs weight, and gravity is "
            f"{np.round(down, 6).tolist()}: expected one that points down onto level ground, such as (0, 0, -9.81), or "
            f"{argument('base', 'free')}"
        )
    if base == "JointModelFreeFlyer":
        return BaseSupport("as it is")
    if base != "JointModelPlanar" or any(each.joint == 0 for each in contacts):
        raise ConfigurationError(
            f"MuJoCo: nothing presses wheel '{contacts[0].name}' on the ground: load the robot with "
            f"{argument('base', 'planar')}, or 'free'"
        )
    if settings.stance == "level":
        return BaseSupport("level", lift=-ground)
    data = robot.model.createData()
    columns = pin.computeJointJacobians(robot.model, data, q).reshape(6, robot.nv)
    points = np.array([each.at(data.oMi[each.joint])[1][:2] for each in contacts])
    weight = np.asarray(pin.centerOfMass(robot.model, data, q))[:2]
    upright = all(_stays_upright(robot, data, columns, each) for each in contacts)
    if upright and _carries(points, weight) and settings.casters is not True:
        return BaseSupport("free", lift=-ground)
    added = _outriggers(points) if settings.casters is not False else None
    fits = added is not None and _carries(np.vstack([points, added]), weight)
    if settings.stance == "auto" and not (upright and fits):
        return BaseSupport("level", lift=-ground)
    casters = () if added is None else tuple(_support(data.oMi[1], k, at, ground) for k, at in enumerate(added))
    return BaseSupport("free", casters, -ground)


def _stays_upright(robot: Robot, data: pin.Data, columns: np.ndarray, contact: ContactBody) -> bool:
    """Return True if only joints with vertical axes lie between the base and the body that carries a wheel."""
    model, joint = robot.model, contact.joint
    axle = None if contact.axle is None else data.oMi[joint].rotation @ contact.axle
    while joint > 1:
        index = model.joints[joint].idx_v
        axis = columns[3:, index]
        own = joint == contact.joint and axle is not None and not contact.drawn and abs(axis @ axle) > 1 - _LEVEL
        if model.joints[joint].nv != 1 or not (own or abs(axis[2]) > 1 - _LEVEL):
            return False
        joint = model.parents[joint]
    return bool(model.inertias[1].mass > 0)


def _carries(points: np.ndarray, weight: np.ndarray) -> bool:
    """Return True if a center of mass lies well inside the convex hull of points (k, 2)."""
    size = float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
    if len(points) < 3 or np.linalg.matrix_rank(points - points[0], tol=1e-3 * size) < 2:
        return False
    sides = scipy.spatial.ConvexHull(points).equations  # a x + b <= 0 inside, a of unit length
    return bool((sides[:, :2] @ weight + sides[:, 2] < -_MARGIN * size).all())


def _outriggers(points: np.ndarray) -> np.ndarray | None:
    """Return two points in front of and behind collinear wheels, as far from their center as they are; else None."""
    middle = points.mean(axis=0)
    size = float(np.linalg.norm(points - middle, axis=1).max())
    _, spread, directions = np.linalg.svd(points - middle)
    if size < _LEVEL or spread[1] > 1e-3 * size:
        return None
    return middle + size * np.array([directions[1], -directions[1]])


def _support(base: pin.SE3, number: int, at: np.ndarray, ground: float) -> ContactBody:
    center = base.actInv(np.array([*at, ground + _CASTER]))
    return ContactBody(f"caster[{number}]", 1, center, None, _CASTER, "none")
