"""Normal forces of contacts. A force below zero means lift-off: the constraint pulls, but the ground cannot."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Array, Float, Int
from rnc_pin.errors import ConfigurationError, SingularityError
from rnc_pin.math.convex_programs import nonnegative
from rnc_pin.math.linear_algebra import null_space
from rnc_pin.model.cached_property import once_per_model
from rnc_pin.model.generalized_forces import PassiveForce
from rnc_pin.model.kinematics import Kinematics, PositionKinematics, VelocityKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.printing import printed
from rnc_pin.robots.joint_values import NamedModel
from rnc_pin.robots.robot import attached_model

_SMALL = 1e-9  # entry of a row, or relative singular value, that is rounding
CHANGES = 4
"""Changes of a load from sample to sample that are not a part of it, and number of samples that tell no change."""


class Contact(NamedTuple):
    """Contact of a system with the ground.

    Attributes:
        name: of the frame, or of the first row if there is no frame.
        along: indices of the rows along the ground, among all constraint rows.
        up: index of the row that carries, if any.
        point: a row whose line of action goes through the contact.
    """

    name: str
    along: tuple[int, ...]
    up: int | None
    point: int


@printed(force="N", lowest="N")
@dataclass(frozen=True)
class LiftOff:
    """Lift-off of a contact: its normal force is below zero.

    Attributes:
        contact: name of the contact.
        time: first time of lift-off [s].
        force: normal force at that time [N].
        lowest: smallest normal force of this contact from that time on [N].
    """

    contact: str
    time: float
    force: float
    lowest: float

    def __str__(self) -> str:
        """Return a text of one line."""
        return (
            f"contact '{self.contact}' would lift off at t = {self.time:.2f} s: the model pulls it down with up to "
            f"{-self.lowest:.3g} N"
        )


class ContactLines(NamedTuple):
    """Lines of action of the contacts: points, and directions of the row that a contact's point is of."""

    points: Float[Array, "N c 3"]
    directions: Float[Array, "N c 3"]


def contacts_of(reduced: ReducedModel) -> list[Contact]:
    """Return the contacts of a system with the ground: contacts without slip, and gliding contacts.

    Args:
        reduced: the model.
    """
    acting = np.zeros(reduced.all_constraints.size, dtype=bool)
    for position in _defined(reduced):
        acting |= np.isfinite(reduced.all_constraints.lines_of_action(position)[0]).all(axis=1)
    found: list[Contact] = []
    for block, where, _ in reduced.all_constraints.places:
        holonomic, frame = block.holonomic or (False,) * len(block.names), getattr(block.kind, "frame", None)
        rows = list(enumerate(holonomic, where.start))
        along = tuple(row for row, fixed in rows if not fixed and acting[row])
        # The row that carries, if any, keeps the height.
        ups = [row for row, fixed in rows if fixed and block.on_ground]
        if along or ups:
            point = (*along, *ups)[0]
            name = frame if isinstance(frame, str) else block.names[point - where.start]
            found.append(Contact(name, along, ups[0] if ups else None, point))
    return found


def _defined(reduced: ReducedModel) -> Iterator[PositionKinematics]:
    """Neutral and a few random configurations, without those at which a row is undefined."""
    kinematics, generator = Kinematics(reduced.robot), np.random.default_rng(0)
    samples = 3  # beside the neutral configuration: they decide which rows carry
    drawn = (reduced.robot.random_configuration(generator) for _ in range(samples))
    for q in (reduced.robot.configuration(), *drawn):
        position = kinematics.position(q)
        with suppress(SingularityError):
            reduced.all_constraints.jacobian(position)
            reduced.all_constraints.lines_of_action(position)
            yield position


@once_per_model
def _carriers(reduced: ReducedModel) -> tuple[tuple[Contact, ...], Array]:
    """Contacts that carry, and a mask: True where a constraint row keeps the height."""
    robot, model, found = reduced.robot, reduced.robot.model, contacts_of(reduced)
    random = Kinematics(robot).position(robot.random_configuration(np.random.default_rng(0)))
    sizes = np.zeros(reduced.all_constraints.size)
    for position in _defined(reduced):
        # Over some configurations: the height row of a wheel may vanish at one by chance.
        sizes = np.fmax(sizes, np.abs(reduced.all_constraints.jacobian(position)).max(axis=1, initial=0.0))
    carrying = [each.up is not None and bool(sizes[each.up] > _SMALL) for each in found]
    down = bool(found) and float(model.gravity.linear[2]) < 0
    heavy = [joint for joint in range(1, model.njoints) if model.inertias[joint].mass > 0]
    # A base that can rise has rows that keep the heights: only a planar base leaves the forces to the balances.
    planar = down and [_moves_along(random, heavy, axis) for axis in range(3)] == [True, True, False]
    kept = [(each, carries) for each, carries in zip(found, carrying, strict=True) if down and (carries or planar)]
    carried_by_row = np.array([carries for _, carries in kept], dtype=bool)
    carried_by_row.setflags(write=False)
    return tuple(each for each, _ in kept), carried_by_row


def _moves_along(position: PositionKinematics, heavy: Sequence[int], axis: int) -> bool:
    """True if all bodies with a mass can translate together along a world axis, constraints ignored."""
    if not heavy:
        return False
    stack, wanted = np.vstack([position.joint_jacobian(joint) for joint in heavy]), np.tile(np.eye(6)[axis], len(heavy))
    left = wanted - stack @ np.linalg.lstsq(stack, wanted, rcond=_SMALL)[0]
    return bool(np.abs(left).max() < _SMALL)


class _ExternalWrenches:
    """Wrenches on the whole robot of what acts on it beside gravity, the actuators' frames and its ground contacts.

    The robot is carried by a free joint at the origin of the world, at rest. The first six entries of a generalized
    force are then its wrench on the robot: what acts between two bodies of it has none.

    Args:
        reduced: the model.

    Attributes:
        unknown: names of what acts on the robot with a wrench that is not known: user-defined generalized forces,
            and constraints to the world whose vertical force a planar base leaves open.
    """

    def __init__(self, reduced: ReducedModel) -> None:
        robot, carrier = reduced.robot, pin.Model()
        carrier_name = "joint that carries the robot"
        carrier.addJointFrame(carrier.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), carrier_name))
        free = copy(robot)
        NamedModel.__init__(free, attached_model(carrier, robot.model, carrier.getFrameId(carrier_name))[0])
        self._kinematics = Kinematics(free)
        self._forces: list[PassiveForce] = []
        q = robot.random_configuration(np.random.default_rng(0))
        at = Kinematics(robot).position(q).with_velocity(np.ones(robot.nv))
        # The same robot on a free base: a force that acts alike there is known, and its reaction counts.
        moved = self._at(q, at.v)
        unknown: list[str] = []
        forces = reduced.reduction_data.forces
        for kind, force in zip(forces.kinds, forces, strict=True):
            with suppress(Exception):  # a kind of a user need not be one for any robot
                found = None if force.generalized else kind.bind(free)
                if found is not None and np.allclose(found.force(moved)[6:], force.force(at)):
                    self._forces.append(found)
                    continue
            unknown.append(force.name)
        contacts = {row for each in contacts_of(reduced) for row in (*each.along, each.up)}
        for place in reduced.all_constraints.places:
            block, rows = place.block, range(place.where.start, place.where.stop)
            if block.kind is not None and block.conserved is None and contacts.isdisjoint(rows):
                with suppress(Exception):  # rows of a user act along the ground
                    if np.abs(block.kind.bind(free).jacobian(moved)[:, :5]).max(initial=0.0) > _SMALL:
                        unknown.append(block.names[0])
        names, B = reduced.actuation.names, reduced.actuation.matrix(at)
        for joint in list(robot.model.joints)[1:]:
            if joint.nv > 1 and robot.model.parents[joint.id] == 0:
                driven = np.abs(B[joint.idx_v : joint.idx_v + joint.nv]).max(axis=0, initial=0.0) > _SMALL
                unknown += [names[k] for k in np.flatnonzero(driven) if k not in reduced.actuation.configured]
        self.unknown = tuple(unknown)

    def _at(self, q: Array, v: Array) -> VelocityKinematics:
        """Kinematics of the carried robot at states (..., nq) and (..., nv)."""
        still = np.broadcast_to(np.r_[np.zeros(6), 1.0], (*q.shape[:-1], 7))
        position = self._kinematics.position(np.concatenate([still, q], axis=-1))
        return position.with_velocity(np.concatenate([np.zeros((*v.shape[:-1], 6)), v], axis=-1))

    def at(self, q: Array, v: Array) -> Float[Array, "N 6"]:
        """Sum of the wrenches about the world's origin at states (N,); NaN if one is unknown.

        Args:
            q: configurations (N, nq).
            v: velocities (N, nv).
        """
        if self.unknown:
            return np.full((len(q), 6), np.nan)
        if not self._forces:
            return np.zeros((len(q), 6))
        at = self._at(q, v)
        return np.sum([np.zeros((len(q), 6)), *(each.force(at)[:, :6] for each in self._forces)], axis=0)


class NormalForces:
    """Upward forces of the ground on each contact; below zero if the model pulls the contact down.

    The model keeps every contact on the ground. If a row keeps the height of a contact, the force is the multiplier of
    that row. On a base that moves in the plane, the forces follow from the motion. They balance the weight and the rate
    of the robot's momentum, upwards and about the axes along the ground. Forces of actuators, springs, dampers and
    wrenches act at their frames; forces along the ground act in its plane. The result is the solution of least norm,
    without forces below zero if possible.
    An axle of ``NoSideSlip`` has no width here: its two wheels take any couple about its heading. Moments that the
    supports cannot balance, such as the pitch of two wheels without casters, are left out.

    Args:
        reduced: the model.

    Attributes:
        contacts: contacts that carry, (c,).
        names: their names, (c,).
        rows: names of all constraint rows, (m,).
        carried_by_row: True for each contact whose height a constraint row keeps, (c,).
        unknown: names of what acts on a base that moves in the plane with an unknown wrench, such as a
            ``ForceFunction``: forces of contacts without such a row are then NaN.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"])
        >>> reduced = system.reduce()
        >>> normal = rnc.analysis.NormalForces(reduced)
        >>> state = reduced.at(robot.configuration(), np.zeros(2))
        >>> forces = normal.at(state, np.zeros(2))
        >>> normal.names, bool(forces[0].round(6) == forces[1].round(6) > 0)
        (('left_wheel', 'right_wheel'), True)
    """

    def __init__(self, reduced: ReducedModel) -> None:
        self._reduced, self._model = reduced, reduced.robot.model
        self._kinematics, self._data = Kinematics(reduced.robot), self._model.createData()
        self._roots = [joint for joint in range(1, self._model.njoints) if self._model.parents[joint] == 0]
        self.contacts, self.carried_by_row = _carriers(reduced)
        self.names, self.rows = tuple(each.name for each in self.contacts), reduced.all_constraints.names
        self._points = [each.point for each in self.contacts]
        self._wrenches = None if self.carried_by_row.all() else _ExternalWrenches(reduced)
        self.unknown = () if self._wrenches is None else self._wrenches.unknown

    def require(self, who: str) -> None:
        """Raise an error if a force on the robot leaves the normal forces unknown.

        Args:
            who: what needs them, for the message.

        Raises:
            ConfigurationError: names the force.
        """
        if self.unknown:
            raise ConfigurationError(
                f"{who}: the loads of the contacts are unknown, because the vertical force and the moments of "
                f"'{self.unknown[0]}' on a planar base are: use base 'free', or a Wrench, Spring or Damper on a frame"
            )

    def remedy(self, contact: str) -> str:
        """Proposal for a contact that lifts off, as of ``Assembly.remedy``.

        Args:
            contact: name of the contact.
        """
        up = self.contacts[self.names.index(contact)].up
        return "" if up is None else self._reduced.assembly.remedy(self.rows[up])

    def at(self, state: StateEvaluation, T: Array, external: Array | None = None) -> Float[Array, "*batch c"]:
        """Return the normal forces [N].

        Args:
            state: states (...,) of the model.
            T: inputs of the actuators (..., p).
            external: additional generalized forces (..., nv), such as damping and friction.
        """
        batch = state.q.shape[:-1]
        forces = np.zeros((*batch, len(self.contacts)))
        if self.carried_by_row.any():
            forces[..., self.carried_by_row] = self._of_rows(state.contact_forces(T, external), state.all_rows)
        if not self.carried_by_row.all():
            v_dot, T = state.acceleration(T, external), np.broadcast_to(T, (*batch, self._reduced.p))
            count = int(np.prod(batch))
            arrays = state.q, state.v, v_dot, T, forces
            q, v, v_dot, T, known = (each.reshape(count, each.shape[-1]) for each in arrays)
            lines, others = self.lines(q), ~self.carried_by_row
            gives, couples = self.plane_effects(lines)
            # Forces that rows carry are known by now: the balance of motion gives the others beside them.
            needed = self.plane_needs(lines, q, v, v_dot, T) - np.matvec(gives, known)
            known[:, others] = balanced(gives[..., others], couples, needed)
            forces = known.reshape(forces.shape)
        return forces

    def between(
        self,
        time: Float[Array, " N"],
        states: tuple[Float[Array, "N nq"], Float[Array, "N nv"], Float[Array, "N p"]],
        contact_forces: Float[Array, "N m"],
        normal_forces: Float[Array, "N c"],
        intervals: Int[Array, " M"] | None = None,
    ) -> Iterator[tuple[Float[Array, " M"], Float[Array, "M nq"], Float[Array, "M m"], Float[Array, "M c"]]]:
        """Yield times, configurations, contact and normal forces inside sampling intervals, and at their ends.

        Inputs are constant in an interval, so that forces at its end differ from the next sample's. Velocities have
        the change of the model's acceleration there. What the known forces have beside the model's, e.g. by
        joint damping, is linear.

        Args:
            time: times of the samples [s].
            states: their configurations and full velocities, and the inputs from there on.
            contact_forces, normal_forces: forces at the samples, of all constraint rows and of the contacts.
            intervals: samples at which the intervals begin; all by default.
        """
        (q, v, T), model = states, self._model
        k = np.arange(len(time) - 1) if intervals is None else intervals
        both = np.stack([k, k + 1])
        ends = self._reduced.at(q[both], v=v[both], t=time[both])
        more = contact_forces[both] - ends.contact_forces(T[both]), normal_forces[both] - self.at(ends, T[both])
        (turn,), (change,) = np.diff(ends.acceleration(T[[k, k]]), axis=0), np.diff(v[both], axis=0)
        parts = (0.25, 0.5, 0.75, 1.0)  # of a sampling interval, at which it is judged
        for part in parts:
            t, w, *others = (start + part * (end - start) for start, end in (time[both], v[both], *more))
            # Constant acceleration in the interval bends the path beside the geodesic by a t (T - t) / 2.
            bend = 0.5 * part * (1.0 - part) * np.diff(time[both], axis=0).T
            w, steps = w - bend * turn, zip(k, -bend * change, strict=True)
            p = np.array([pin.integrate(model, pin.interpolate(model, q[i], q[i + 1], part), by) for i, by in steps])
            inside = self._reduced.at(p, v=w, t=t)
            yield t, p, inside.contact_forces(T[k]) + others[0], self.at(inside, T[k]) + others[1]

    def _of_rows(self, contact_forces: Array, rows: Array) -> Array:
        """Forces of the contacts whose height a row keeps."""
        carried = zip(self.contacts, self.carried_by_row, strict=True)
        up = [each.up for each, carries in carried if carries and each.up is not None]
        pushing = contact_forces[..., up]
        for i in np.argwhere((pushing < 0).any(axis=-1)):
            index = tuple(i)
            pushing[index] = nonnegative(pushing[index], null_space(rows[index].T, _SMALL)[up])
        return pushing

    def plane_effects(self, lines: ContactLines) -> tuple[Float[Array, "N 3 c"], Float[Array, "N 3 u"]]:
        """Return what unit upward forces and unit couples of axles give: upwards, and about axes along the ground.

        Args:
            lines: lines of action of the contacts.
        """
        points, across = lines
        ones = np.ones(points.shape[:2])
        # Effects of upward forces: their sum, and their moments about the axes along the ground.
        gives = np.stack([ones, points[..., 1], -points[..., 0]], axis=1)
        axles = [column for column, contact in enumerate(self.contacts) if contact.up is None]
        if not axles:
            return gives, np.zeros((len(points), 3, 0))
        # Couples count like forces at the distance of the contacts: a least norm of N and N m would depend on units.
        spread = np.sqrt(points[..., :2].var(axis=1).sum(axis=-1))
        spread = np.where(spread > 0, spread, 1.0)[:, None, None]
        headings = np.stack([np.zeros_like(ones), across[..., 1], -across[..., 0]], axis=1)
        return gives, spread * headings[..., axles]

    def plane_needs(self, lines: ContactLines, q: Array, v: Array, v_dot: Array, T: Array) -> Float[Array, "N 3"]:
        """Return what the upward forces and couples have to balance.

        Args:
            lines: lines of action at the configurations, or at the one configuration of all.
            q, v: configurations (N, nq) and velocities (N, nv); or those (1, ...) of one state for all accelerations.
            v_dot, T: accelerations (N, nv) and inputs (N, p).
        """
        parts = [slice(None)] if len(q) == 1 else [slice(k, k + 1) for k in range(len(q))]
        found = [self._needed(q[k], v[k], v_dot[part], T[part]) for k, part in enumerate(parts)]
        wrenches = np.concatenate([np.zeros((0, 6)), *found])
        if self._wrenches is not None:
            wrenches -= self._wrenches.at(q, v)
        ground = lines.points[..., 2].min(axis=1)
        force, moment = wrenches[:, :3], wrenches[:, 3:]
        return np.stack([force[:, 2], moment[:, 0] + ground * force[:, 1], moment[:, 1] - ground * force[:, 0]], axis=1)

    def lines(self, at: Float[Array, "N nq"] | StateEvaluation) -> ContactLines:
        """Return the points of the contacts and the directions of their forces.

        Args:
            at: configurations, or one state of the model, whose kinematics are used.
        """
        position = self._kinematics.position(at) if isinstance(at, np.ndarray) else at.position
        lines = self._reduced.all_constraints.lines_of_action(position)
        points, across = (each[..., self._points, :] for each in lines)
        return ContactLines(points, across) if points.ndim == 3 else ContactLines(points[None], across[None])

    def _needed(self, q: Array, v: Array, v_dot: Array, T: Array) -> Array:
        """Forces and moments (N, 6) about the origin that gravity and actuators on frames leave to the others.

        At one state, they are affine in accelerations (N, nv) and inputs (N, p).
        """
        model, data = self._model, self._data
        pin.rnea(model, data, q, v, np.zeros(model.nv))
        without = pin.Force.Zero()  # acceleration
        for joint in self._roots:
            without += data.liMi[joint].act(data.f[joint])  # their parent is the world
        pin.computeCentroidalMap(model, data, q)
        found = v_dot @ data.Ag.T
        found[:, 3:] -= found[:, :3] @ pin.skew(data.com[0])  # moments about the origin
        for column, frame, row in self._reduced.actuation.frames:
            placement = pin.updateFramePlacement(model, data, frame)
            found -= np.outer(T[:, column], placement.act(pin.Force(np.eye(6)[row])).vector)
        return np.asarray(without.vector + found)


def balanced(
    gives: Float[Array, "N 3 n"], couples: Float[Array, "N 3 k"], needed: Float[Array, "N 3"]
) -> Float[Array, "N n"]:
    """Return forces with a given sum and least moment error, of least norm together with couples.

    No force is below zero if that is possible.

    Args:
        gives: sum (ones) and moments of unit forces.
        couples: zeros, and moments of unit couples.
        needed: sum and moments.
    """
    count, everything = gives.shape[-1], np.concatenate([gives, couples], axis=-1)
    found = np.zeros((len(gives), everything.shape[-1]))
    found[:, :count] = needed[:, :1] / count
    sums, moments = everything[0, 0], everything[:, 1:]
    free = np.eye(len(sums)) - np.outer(sums, sums) / count  # directions that keep the sum
    left = needed[:, 1:] - np.matvec(moments, found)
    found = found + np.matvec(free @ np.linalg.pinv(moments @ free, rcond=_SMALL), left)
    forces: Array = found[:, :count]
    for i in np.flatnonzero((forces < 0).any(axis=1)):
        forces[i] = nonnegative(forces[i], null_space(everything[i], _SMALL)[:count])
    return forces


def first_lift_off(
    times: Array, forces: Array, names: Sequence[str], inside: Iterable[tuple[Array, ...]] = ()
) -> LiftOff | None:
    """Return the first contact whose normal force is below zero by more than rounding; None if all contacts hold.

    Args:
        times: (N,) [s].
        forces: normal forces (N, c) [N]; NaN if unknown.
        names: of the contacts (c,).
        inside: times and, at the end of each tuple, forces inside the sampling intervals, as of ``between``.
    """
    if not forces.size:
        return None
    scale = max(float(np.abs(np.nan_to_num(forces)).sum(axis=1).max()), 1.0)
    rounding, inside_rounding = 1e-6, 1e-3  # shares of the weight: between samples, velocities are interpolated
    limits = np.full(len(times), -rounding * scale)
    for t, *_, loads in inside:
        times, forces = np.append(times, t), np.vstack([forces, loads])
        limits = np.append(limits, np.full(len(t), -inside_rounding * scale))
    order = np.argsort(times, kind="stable")
    times, known = times[order], np.nan_to_num(forces[order])
    below = known < limits[order, None]
    if not below.any():
        return None
    sample = int(np.argmax(below.any(axis=1)))
    which = int(np.argmin(np.where(below[sample], known[sample], np.inf)))
    return LiftOff(names[which], float(times[sample]), float(known[sample, which]), float(known[sample:, which].min()))


def near_lift_off(loads: Float[Array, "N c"]) -> Int[Array, " M"]:
    """Samples after which a load may be below zero before the next one: it changes there by a part of itself.

    Args:
        loads: normal forces at the samples.
    """
    change, least = np.abs(np.diff(loads[[0, *range(len(loads)), -1]], axis=0)), np.minimum(loads[1:], loads[:-1])
    near = change[:-2] + change[1:-1] + change[2:]
    return np.flatnonzero((least < CHANGES * near).any(axis=1) | (len(loads) <= CHANGES))
