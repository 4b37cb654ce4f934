"""Wheels on the ground, as MuJoCo's geometry and contact pairs. Nothing else of a robot touches anything."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from rnc_pin.plants.mujoco.engine import mujoco
from rnc_pin.plants.mujoco.settings import MuJoCoSettings
from rnc_pin.plants.mujoco.tree import Tree
from rnc_pin.plants.mujoco.wheels import Contact

_GROUND = "ground"
_NO_GRIP = 1e-5  # the least that MuJoCo takes
_THIN = {"ellipsoid": 0.01, "cylinder": 0.1}  # half a wheel's width, in radii
_SHORT = 1e-6  # half the length [m] of a blade, and of a wheel that holds on along one direction: its ends both grip
_BLADE = 0.005  # radius of a blade's edge [m]
_SPRUNG = 10.0  # how much slower a support without friction pushes back: wheels beside it carry the most
_LIGHT = 1e-6  # of the robot: a wheel that is only drawn has the mass of the body that it is drawn on


def add_ground(spec: mujoco.MjSpec, tree: Tree, contacts: Sequence[Contact], settings: MuJoCoSettings) -> None:
    """The plane z = 0, and everything round on it."""
    if not contacts:
        return
    shape = mujoco.mjtGeom
    spec.worldbody.add_geom(name=_GROUND, type=shape.mjGEOM_PLANE, size=[0, 0, 1], contype=0, conaffinity=0)
    weight = sum(inertia.mass for inertia in list(tree.robot.model.inertias)[1:])
    for contact in contacts:
        body = tree.bodies[contact.joint]
        center = contact.center
        if contact.spins:
            body = _hung(body, contact, _LIGHT * weight)
            center = np.zeros(3)
        kind, size, axis = _shape(contact, settings)
        body.add_geom(
            name=contact.name,
            type=kind,
            size=size,
            pos=center - (0 if not contact.blade else (contact.radius - _BLADE) * np.array([0.0, 0.0, 1.0])),
            quat=turned_to(axis),
            contype=0,
            conaffinity=0,
            mass=0,
        )
        _pair(spec, contact, settings)


def share_load(model: mujoco.MjModel, tree: Tree, contacts: Sequence[Contact]) -> None:
    """Make the ground equally hard under all wheels: by itself MuJoCo makes it softer under what is light or turns."""
    weight = sum(inertia.mass for inertia in list(tree.robot.model.inertias)[1:])
    for contact in contacts:
        model.body_invweight0[model.geom(contact.name).bodyid[0], 0] = 1.0 / weight


def hinge_of(contact: Contact) -> str:
    """MuJoCo's name of the joint, and of the body, of a wheel that is only drawn."""
    return f"wheel {contact.name}"


def _hung(body: Any, contact: Contact, mass: float) -> Any:
    """A wheel of next to no mass on a hinge."""
    spin = mass * contact.radius**2
    wheel = body.add_body(
        name=hinge_of(contact),
        pos=contact.center,
        mass=mass,
        inertia=[spin] * 3,
        explicitinertial=True,
    )
    wheel.add_joint(name=hinge_of(contact), type=mujoco.mjtJoint.mjJNT_HINGE, axis=contact.axle)
    return wheel


def _shape(contact: Contact, settings: MuJoCoSettings) -> tuple[Any, list[float], np.ndarray]:
    """Kind, size and direction of the axis."""
    shape, radius = mujoco.mjtGeom, contact.radius
    if contact.blade:  # MuJoCo lays the first direction of friction along a capsule
        return shape.mjGEOM_CAPSULE, [_BLADE, _SHORT, 0.0], np.cross(contact.axle, [0.0, 0.0, 1.0])
    if contact.grip == "forward":
        return shape.mjGEOM_CAPSULE, [radius, _SHORT, 0.0], contact.axle
    if contact.round or settings.wheel_shape == "sphere":
        return shape.mjGEOM_SPHERE, [radius, 0.0, 0.0], contact.axle
    half = _THIN[settings.wheel_shape] * radius
    if settings.wheel_shape == "cylinder":
        return shape.mjGEOM_CYLINDER, [radius, half, 0.0], contact.axle
    return shape.mjGEOM_ELLIPSOID, [radius, radius, half], contact.axle


def _pair(spec: mujoco.MjSpec, contact: Contact, settings: MuJoCoSettings) -> None:
    sliding, torsional, rolling = settings.friction
    condim, first, second = 6 if rolling else 4 if torsional else 3, sliding, sliding
    if contact.grip == "none":
        condim = 1
    elif contact.grip == "forward":
        first = _NO_GRIP
    elif contact.grip == "across":
        first, second = _NO_GRIP, sliding
    spec.add_pair(
        name=contact.name,
        geomname1=_GROUND,
        geomname2=contact.name,
        condim=condim,
        friction=[max(each, _NO_GRIP) for each in (first, second, torsional, rolling, rolling)],
        solref=[settings.firmness * (_SPRUNG if contact.grip == "none" else 1.0), 1.0],
        solimp=[settings.contact_impedance, settings.contact_impedance, 0.001, 0.5, 2.0],
    )


def turned_to(axis: np.ndarray) -> np.ndarray:
    """A quaternion (w, x, y, z) that turns z to an axis."""
    unit = axis / np.linalg.norm(axis)
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), unit)
    return turn.coeffs()[[3, 0, 1, 2]]


class Grips:
    """How hard wheels hold on to the ground.

    Args:
        model: compiled.
        contacts: what can hold on.
        friction: the coefficient of sliding friction.
    """

    def __init__(self, model: mujoco.MjModel, contacts: Sequence[Contact], friction: float) -> None:
        holding = [each for each in contacts if each.grip != "none"]
        self.names = tuple(each.name for each in holding)
        self._friction = friction
        self._where = {model.geom(name).id: place for place, name in enumerate(self.names)}

    def forces(self, model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
        """Normal force and size of the tangential one of each wheel, (w, 2) [N]."""
        total = np.zeros((len(self.names), 3))
        force = np.zeros(6)
        for number in range(data.ncon):
            contact = data.contact[number]
            place = self._where.get(int(contact.geom[1]), self._where.get(int(contact.geom[0])))
            if place is not None:
                mujoco.mj_contactForce(model, data, number, force)
                total[place] += force[:3]
        return np.column_stack([total[:, 0], np.hypot(total[:, 1], total[:, 2])])

    def used(self, model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
        """Tangential force over what the grip allows, (w,); zero for a wheel off the ground."""
        normal, tangential = self.forces(model, data).T
        allowed = self._friction * normal
        return np.divide(tangential, allowed, out=np.zeros_like(normal), where=allowed > 0)
