"""Ground contacts as MuJoCo geometry and contact pairs. No other part of the robot collides.

MuJoCo's contacts are soft, and it solves friction and load together. Slip lifts a contact by friction times the
tangential deceleration that the contact demands, so stiff contacts hop. A wheel should slide at its friction limit with
unchanged load. So contacts are soft in the normal direction (low impedance) and stiff in the tangential one (high
``impratio``). They never demand much more deceleration than friction can give; see ``Ground.prepare``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rnc_pin.constraints import GroundPlane
from rnc_pin.lab.mujoco.body_tree import BodyTree, mujoco, scalar_first
from rnc_pin.lab.mujoco.contact_bodies import ContactBody, MuJoCoSettings

_GROUND = "ground"
_FRICTIONLESS = 1e-5  # smallest friction coefficient in MuJoCo
_BLADE_RADIUS = 0.005  # radius of the edge of a blade [m]
_IMPEDANCE = 0.02  # low: contacts are soft along the normal
_UP = np.array([0.0, 0.0, 1.0])


def add_ground(
    spec: mujoco.MjSpec, tree: BodyTree, contacts: Sequence[ContactBody], settings: MuJoCoSettings, ground: GroundPlane
) -> None:
    """Add the plane and the geometry of all contacts.

    Args:
        spec: specification that receives them.
        tree: bodies of the robot.
        contacts: all contacts.
        settings: friction and contact time.
        ground: the plane.
    """
    if not contacts:
        return
    stiffness = 1e5  # tangential over normal contact impedance
    spec.option.impratio = stiffness
    plane, half = mujoco.mjtGeom.mjGEOM_PLANE, _penetration(settings, spec.option.gravity) / 2
    place, turn = np.asarray(ground.point) + half * ground.axes[2], _turned_to(ground.axes[2])
    spec.worldbody.add_geom(name=_GROUND, type=plane, size=[0, 0, 1], pos=place, quat=turn, contype=0, conaffinity=0)
    for contact in contacts:
        kind, size, axis = _shape(contact, contact.radius + half)
        raised = contact.radius + half - _BLADE_RADIUS if contact.friction == "lateral" else 0.0
        tree.bodies[contact.joint].add_geom(
            name=contact.name,
            type=kind,
            size=size,
            pos=contact.center - raised * contact.up,
            quat=_turned_to(axis),
            contype=0,
            conaffinity=0,
            mass=0,
        )
        # Only pairs collide: contype and conaffinity are zero.
        _pair(spec, contact, settings)


def _penetration(settings: MuJoCoSettings, gravity: np.ndarray) -> float:
    """Penetration depth of wheels [m]. Forces act at half of it, so that they act one radius below the center."""
    return float((1 - _IMPEDANCE) * np.linalg.norm(gravity) * settings.contact_time_constant**2)


def _shape(contact: ContactBody, radius: float) -> tuple[mujoco.mjtGeom, list[float], np.ndarray]:
    """Return type, size and axis of a geometry. In MuJoCo the first friction direction is along a capsule."""
    shape = mujoco.mjtGeom
    if contact.axle is None:
        return shape.mjGEOM_SPHERE, [radius, 0.0, 0.0], _UP
    half_length = 1e-6  # of capsules with friction in one direction [m]; both ends touch the ground
    if contact.friction == "lateral":
        return shape.mjGEOM_CAPSULE, [_BLADE_RADIUS, half_length, 0.0], np.cross(contact.axle, contact.up)
    if contact.friction == "longitudinal":
        return shape.mjGEOM_CAPSULE, [radius, half_length, 0.0], contact.axle
    half_width = 0.01  # of a wheel, in radii: thin, so that it touches at one point below its center
    return shape.mjGEOM_ELLIPSOID, [radius, radius, half_width * radius], contact.axle


def _pair(spec: mujoco.MjSpec, contact: ContactBody, settings: MuJoCoSettings) -> None:
    sliding, torsional, rolling = settings.friction
    # As few directions as the coefficients need: each is a row of MuJoCo's problem.
    condim, first, second = 6 if rolling else 4 if torsional else 3, sliding, sliding
    if contact.friction == "none":
        condim = 1
    elif contact.friction != "all":  # the capsule is along the axle if friction is longitudinal, else along the heading
        first = _FRICTIONLESS
    softness = 3.0  # time constant of frictionless supports over the wheels' own, which carry most of the load
    slower = softness if contact.friction == "none" else 1.0
    spec.add_pair(
        name=contact.name,
        geomname1=_GROUND,
        geomname2=contact.name,
        condim=condim,
        friction=[max(each, _FRICTIONLESS) for each in (first, second, torsional, rolling, rolling)],
        solref=[slower * settings.contact_time_constant, 1.0],
        solimp=[_IMPEDANCE, _IMPEDANCE, 0.001, 0.5, 2.0],
    )


def _turned_to(axis: np.ndarray) -> np.ndarray:
    """Return the quaternion (w, x, y, z) that rotates z to an axis."""
    return scalar_first(pin.Quaternion.FromTwoVectors(_UP, axis / np.linalg.norm(axis)).coeffs())


class Ground:
    """Ground contacts of a compiled model during a run.

    Args:
        model, data: compiled MuJoCo model and its data.
        contacts: all contacts.
        settings: friction and solver settings.
        plane: the ground.

    Attributes:
        names: contacts with friction, (w,).
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        contacts: Sequence[ContactBody],
        settings: MuJoCoSettings,
        plane: GroundPlane,
    ) -> None:
        self._model, self._data = model, data
        self._axes, self._origin = plane.axes, np.asarray(plane.point)
        self._with_friction = [each for each in contacts if each.friction != "none"]
        self.names = tuple(each.name for each in self._with_friction)
        self._friction = settings.friction[0]
        self._geoms = np.array([model.geom(name).id for name in self.names], dtype=int)
        self._pairs = np.array([model.pair(name).id for name in self.names], dtype=int)
        self._softness = np.full((len(self.names), 2), -1.0)
        self._frictions = model.pair_friction[self._pairs].copy()
        self._edges = np.flatnonzero([each.friction == "lateral" for each in self._with_friction])
        # One entry more: a contact without a geometry has the index -1, which reads the last one.
        self._place = np.full(model.ngeom + 1, -1)
        self._place[self._geoms] = np.arange(len(self.names))
        self._first_direction = np.array([each.friction == "all" for each in self._with_friction], dtype=float)
        """1 if the first friction direction has friction, else 0."""
        self._along = np.zeros(len(self.names))
        """Drive forces of wheels without a joint, along their headings [N]."""
        self.slid = np.zeros(len(self.names))
        """Largest speeds at the friction limit since they were zeroed [m/s]; inf where a drive force was cut."""
        mass = float(model.body_mass.sum())
        for each in contacts:  # MuJoCo's default makes contacts softer for light or rotating bodies
            model.body_invweight0[model.geom(each.name).bodyid[0], 0] = len(contacts) / mass

    def reset(self) -> None:
        """Restart at the positions and velocities in ``data``."""
        self._along[:], self.slid[:] = 0.0, 0.0
        model, data = self._model, self._data
        model.pair_solreffriction[self._pairs] = 0.0
        model.pair_friction[self._pairs] = self._frictions
        mujoco.mj_forward(model, data)
        self._mobility = np.zeros(len(self.names))
        """Largest acceleration of each contact point per unit tangential force [1/kg]."""
        jacobian, moved = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        for place, geom in enumerate(self._geoms):
            mujoco.mj_jac(model, data, jacobian, None, self._below(geom), model.geom_bodyid[geom])
            mujoco.mj_solveM(model, data, moved, jacobian)
            along = self._axes[:2]
            # The largest over all directions along the ground: slip has no direction known beforehand.
            self._mobility[place] = np.linalg.eigvalsh(along @ (jacobian @ moved.T) @ along.T)[-1]

    def _below(self, geom: int) -> np.ndarray:
        """Point (3,) of the ground below a geometry."""
        center, normal = self._data.geom_xpos[geom], self._axes[2]
        return np.asarray(center - normal * (normal @ (center - self._origin)))

    def prepare(self, drive_forces: np.ndarray) -> None:
        """Before a step: set the slip damping of contacts, and apply drive forces within the friction limit.

        Slip is removed in one step, or more slowly if friction cannot give that deceleration.

        Args:
            drive_forces: drive forces along headings, (w,) [N]; added to the applied forces.
        """
        if not len(self.names):
            return
        model = self._model
        normal, tangential, slip = self.watch()
        share = 2.0  # demanded deceleration of a slipping wheel over the largest that friction can give
        most = share * self._friction * normal * self._mobility
        least = 1e-6  # slip treated as zero [m/s]
        # Not above one step, in which all slip is gone; nor so slow that a wheel creeps.
        rate = np.clip(most / np.maximum(slip, least), 1.0, 1.0 / model.opt.timestep)
        # Negative: MuJoCo reads a damping, and no time constant.
        self._softness[:, 1] = -_IMPEDANCE * rate
        model.pair_solreffriction[self._pairs] = self._softness
        if drive_forces.any() or self._along.any():
            self._drive(drive_forces, normal, tangential[:, 1])

    def _drive(self, drive_forces: np.ndarray, normal: np.ndarray, across: np.ndarray) -> None:
        """Apply drive forces along headings; they reduce the lateral friction limit (friction circle)."""
        model, data, limit = self._model, self._data, self._friction * normal
        most = np.sqrt(limit**2 - np.minimum(across, limit) ** 2)
        self._along = np.clip(drive_forces, -most, most)
        self.slid[(np.abs(drive_forces) > most) & (normal > 0)] = np.inf  # a wheel with a joint would spin
        # Friction circle: what drives a wheel is not there to hold it sideways.
        left = np.sqrt(np.maximum(limit**2 - self._along**2, 0.0))[self._edges]
        load = normal[self._edges]
        lateral = np.divide(left, load, out=np.full_like(load, self._friction), where=load > 0)
        model.pair_friction[self._pairs[self._edges], 1] = np.maximum(lateral, _FRICTIONLESS)
        # After a step, positions of bodies are those at its start.
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for place in np.flatnonzero(self._along):
            geom = self._geoms[place]
            axis, normal = data.geom_xmat[geom].reshape(3, 3)[:, 2], self._axes[2]
            heading = axis - normal * (normal @ axis)
            force, point = self._along[place] / np.linalg.norm(heading) * heading, self._below(geom)
            mujoco.mj_applyFT(model, data, force, np.zeros(3), point, model.geom_bodyid[geom], data.qfrc_applied)

    def used(self) -> np.ndarray:
        """Return tangential force over friction limit, (w,); zero for a wheel off the ground."""
        normal, tangential, _ = self._measured()
        # MuJoCo's own friction, and the drive force that acts beside it.
        force = np.hypot(np.linalg.norm(tangential, axis=1), self._along)
        allowed = self._friction * normal
        return np.divide(force, allowed, out=np.zeros_like(normal), where=allowed > 0)

    def watch(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return what ``_measured`` does, and note the speeds of contacts that slide."""
        normal, tangential, slip = self._measured()
        used = 0.99  # of the friction of a contact that slides; MuJoCo gives it to 1e-3
        at_limit = np.hypot(tangential[:, 0], tangential[:, 1]) > used * self._friction * normal
        np.maximum(self.slid, slip * at_limit, out=self.slid)
        return normal, tangential, slip

    def _measured(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return loads (w,) [N], magnitudes of both friction forces (w, 2) [N], and slip speeds (w,) [m/s]."""
        data, size = self._data, len(self.names)
        total, slip = np.zeros((size, 3)), np.zeros(size)
        touching = data.contact
        places, rows = self._place[touching.geom].max(axis=1, initial=-1), touching.efc_address
        numbers = np.flatnonzero((places >= 0) & (rows >= 0))
        if len(numbers):
            # The normal row of a contact comes first, then both tangential ones.
            # Each wheel sums up its contacts.
            sums = (places[numbers] == np.arange(size)[:, None]).astype(float)
            entries = rows[numbers, None] + np.arange(3)
            total = sums @ data.efc_force[entries]
            moving = data.efc_vel[entries[:, 1:]]
            moving[:, 0] *= self._first_direction @ sums  # zero if that direction has no friction
            slip = (sums @ np.hypot(moving[:, 0], moving[:, 1])) / np.maximum(sums.sum(axis=1), 1.0)
        return total[:, 0], np.abs(total[:, 1:]), slip
