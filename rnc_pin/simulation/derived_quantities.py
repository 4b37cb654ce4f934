"""Derivation of a run from its record: names, continuous outputs, goals, forces, energy and residuals.

Top views show bodies that move on the ground: those with wheels, runners or balls, and all planar bases.
"""

from __future__ import annotations

import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.analysis import NormalForces
from rnc_pin.array_shapes import Array, Float
from rnc_pin.math.linear_algebra import apply, apply_transposed
from rnc_pin.model.cached_property import once_per_model
from rnc_pin.model.evaluator import evaluator_for
from rnc_pin.model.kinematics import Kinematics, PositionKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.reduction_data import best_entries
from rnc_pin.model.rows import GroundContact, OutputStack
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import run_info
from rnc_pin.simulation.run_data import GOALS, Grounds, Record, Trajectory, blocks
from rnc_pin.simulation.run_info import Columns
from rnc_pin.version import __version__

_MATRICES = 8  # temporary (n, n) matrices for each sample


def derive(record: Record, info: run_info.RunInfo) -> Trajectory:
    """Run with everything that follows from its record.

    Args:
        record: samples of the run.
        info: origin and outcome of the run, without names of columns and goals.
    """
    reduced, signals = record.reduced, record.signals
    x1, x2 = reduced.vertical.coordinates, reduced.reducing.coordinates
    integrals, time = signals.pop("integrals"), signals["time"]
    # An angle of a coordinate forgets full turns; the integral of its rate tells which turn it is in.
    signals["x1"] = x1.unwrap(signals["x1"], _integrated(signals["x1"], signals["v1"], time))
    about = _integrated(signals["x2"], signals["v2"], time)
    # The loop integrated these while the plant moved: its sums know more than the samples.
    about[:, record.carries] = (signals["x2"][:1] + integrals)[:, record.carries]
    signals["x2"] = x2.unwrap(signals["x2"], about)
    goals = _goals(reduced, signals)
    # Controllers of velocities give no goal of x2: it is the integral of the desired rate.
    rates = signals["v2_desired"]
    filled = np.isnan(signals["x2_desired"]).all(axis=0) & ~np.isnan(rates).any(axis=0)
    signals["x2_desired"][:, filled] = _integrated(signals["x2"][:, filled], rates[:, filled], time)
    forces = _Forces.of(record, switching=bool(info.phases))
    # Forces that the plant states itself replace those of its model; without units it has stated nothing.
    stated = {kind: signals.pop(kind) for kind in record.own_forces}
    quantities = _quantities(record, forces, signals)
    quantities |= {kind: stated[kind] for kind, units in record.own_forces.items() if units}
    info = replace(info, outputs=forces.outputs, goals=goals)
    return Trajectory(**signals, **quantities, info=info, grounds=Grounds(reduced))


# ---------------------------------------------------------------------- names, goals and outputs


@once_per_model
def output_names(reduced: ReducedModel) -> run_info.OutputNames:
    """Names, units and coordinate types of the columns in runs of a model.

    Args:
        reduced: the model.
    """
    robot = reduced.robot
    multipliers, contact_forces = (
        Columns(tuple(rows.names), tuple(run_info.FORCE_UNITS.get(unit, "") for unit in rows.units))
        for rows in (reduced.constraints, reduced.all_constraints)
    )
    return run_info.OutputNames(
        x1=_columns_of(reduced.vertical),
        x2=_columns_of(reduced.reducing),
        T=Columns(tuple(reduced.actuation.names), tuple(reduced.actuation.units)),
        multipliers=multipliers,
        contact_forces=contact_forces,
        q=_columns(dict(robot.configuration_entries)),
        v=Columns(tuple(robot.velocity_names), tuple(robot.velocity_units)),
        ground_poses=Columns(tuple(body.name for body in ground_bodies(reduced))),
    )


def _columns_of(outputs: OutputStack) -> Columns:
    """Names, units and coordinate types of outputs."""
    # Units of outputs that are rates: a run has the integrals of quasi-velocities.
    units = tuple(unit.removesuffix("/s") for unit in outputs.units)
    angular, quasi = (tuple(each.tolist()) for each in (outputs.angular, outputs.quasi))
    return Columns(tuple(outputs.names), units, angular, tuple(outputs.coordinates.rotations), quasi)


def _columns(units: Mapping[str, str]) -> Columns:
    """Columns with their units by name."""
    return Columns(tuple(units), tuple(units.values()))


def versions() -> dict[str, str]:
    """Versions of the software that a result depends on."""
    packages = {"rnc_pin": __version__, "pin": pin.__version__, "numpy": np.__version__}
    return {**packages, "python": platform.python_version()}


def _goals(reduced: ReducedModel, signals: dict[str, Array]) -> tuple[str, ...]:
    """Names of the outputs with a goal at every sample, from the first one with a valid measurement on."""
    given = np.concatenate([signals[name] for name in GOALS], axis=1)
    # A loop has no goals before its first valid measurement; gaps after it do count.
    first = int(np.argmax(~np.isnan(given).all(axis=1))) if len(given) else 0
    stacks = ("x1_desired", reduced.vertical), ("x2_desired", reduced.reducing)
    columns = [pair for desired, outputs in stacks for pair in zip(outputs.names, signals[desired].T, strict=True)]
    return tuple(name for name, column in columns if not np.isnan(column[first:]).any())


def _integrated(values: Array, rates: Array, time: Array) -> Array:
    """First values plus the integral of the rates (N, k), by the trapezoidal rule."""
    whole = np.empty_like(values)
    whole[:1] = 0.0
    # In blocks: the temporary arrays of a long run would take as much memory as the run.
    for block in blocks(len(values) - 1, 4 * values.shape[1]):
        after = slice(block.start + 1, block.stop + 1)
        steps = 0.5 * np.diff(time[block.start : block.stop + 1])[:, None] * (rates[after] + rates[block])
        steps[0] += whole[block.start]
        np.cumsum(steps, axis=0, out=whole[after])
    whole += values[:1]
    return whole


# ---------------------------------------------------------------------- forces, energy and residuals


class _Forces(NamedTuple):
    """Columns of a run, and the models of its plant.

    Attributes:
        outputs: names and units of the columns of all arrays.
        normal: normal forces of the models of the plant; empty if no model of the plant is known.
        switching: True if rows appear and vanish: they have zeros while they do not act.
    """

    outputs: run_info.OutputNames
    normal: dict[ReducedModel, NormalForces]
    switching: bool

    @classmethod
    def of(cls, record: Record, switching: bool) -> _Forces:
        """Columns of the controller's model, or of all models of a plant whose contacts switch."""
        every = list(dict.fromkeys([record.reduced, *record.plant_models]))
        # Contacts that switch have a model each: a run has the columns of all of them.
        models = every if switching else every[:1]
        # Only of a known plant: the forces that hold the controller's model may not be those of the robot.
        normal = {model: NormalForces(model) for model in every} if record.plant_models else {}
        own = [output_names(model) for model in models]
        contacts = [name for model in models if model in normal for name in normal[model].names]
        found = {
            "multipliers": _union(each.multipliers for each in own),
            "contact_forces": _union(each.contact_forces for each in own),
            "normal_forces": _columns(dict.fromkeys(contacts, "N")),
            "friction_used": _columns(dict.fromkeys(record.contacts, "-")),
        }
        found |= {kind: _columns(units) for kind, units in record.own_forces.items() if units}
        return cls(replace(own[0], **found), normal, switching)


def _union(columns: Iterable[Columns]) -> Columns:
    """All columns once, in the order of their first."""
    return _columns({name: unit for each in columns for name, unit in zip(each.names, each.units, strict=True)})


def _quantities(record: Record, forces: _Forces, signals: dict[str, Array]) -> dict[str, Array]:
    """Forces, energy and residuals along a run, (N, ...) each, in blocks of samples."""
    reduced, outputs, bodies = record.reduced, forces.outputs, ground_bodies(record.reduced)
    kept = outputs.multipliers.names
    sizes = {
        "F": (reduced.r,), "multipliers": (len(kept),), "contact_forces": (len(outputs.contact_forces.names),),
        "normal_forces": (len(outputs.normal_forces.names),), "slip": (len(kept),), "energy": (),
        "constraint_residual": (), "position_residual": (), "singular_value": (), "ground_poses": (3 * len(bodies),),
    }  # fmt: skip
    derived = {name: np.empty((len(signals["time"]), *size)) for name, size in sizes.items()}
    forces_of_plant = record.external
    for start, end, plant in record.stretches():
        for inner in blocks(end - start, _MATRICES * reduced.n**2):
            block = slice(start + inner.start, start + inner.stop)
            t, q, v, T = (signals[name][block] for name in ("time", "q", "v", "T"))
            external = None if forces_of_plant is None else forces_of_plant[block]
            seen = StateEvaluation.at(reduced.evaluator, q, v=v, t=t)
            derived["F"][block] = _reduced_forces(reduced, seen, t, T)
            derived["singular_value"][block] = seen.smallest_singular_value
            for k, body in enumerate(bodies):
                derived["ground_poses"][block, 3 * k : 3 * k + 3] = body.poses(seen.position)
            # Energy and forces of contacts belong to what moves, F and the margin to the controller's model.
            own = seen if plant is reduced else StateEvaluation.at(plant.evaluator, q, v=v, t=t)
            derived["energy"][block] = own.energy
            for name, values in _contact_quantities(forces, plant, own, T, external).items():
                derived[name][block] = values
            # Residuals are those of the controller's rows. Where the plant's rows come and go, those of its own.
            at, rows = (own, plant) if forces.switching else (seen, reduced)
            residual = at.residual
            derived["slip"][block] = _by_name(kept, rows.constraints.names, residual, 0.0)
            derived["constraint_residual"][block] = np.abs(residual).max(axis=-1, initial=0.0)
            derived["position_residual"][block] = np.abs(rows.assembly.residual(q, t)).max(axis=-1, initial=0.0)
    return derived


def _reduced_forces(reduced: ReducedModel, seen: StateEvaluation, t: Array, T: Array) -> Array:
    """Reduced forces ``R^T B T`` (N, r) of inputs (N, p); NaN where outputs are singular."""
    regular, F = seen.regular, np.full((len(T), reduced.r), np.nan)
    if regular.any():
        # One singular state would refuse its whole block, so it is left out first.
        good = seen if regular.all() else reduced.at(seen.q[regular], v=seen.v[regular], t=t[regular])
        F[regular] = apply_transposed(good.R, apply(good.B, T[regular]))
    return F


def _contact_quantities(
    forces: _Forces, plant: ReducedModel, own: StateEvaluation, T: Array, external: Array | None
) -> dict[str, Array]:
    """Forces of the rows and contacts of a plant, in the columns of the run; zero or NaN for rows that it has not."""
    # Contact forces do not depend on the choice of outputs, nor on their singularities.
    data = plant.reduction_data.in_entries(tuple(best_entries(own.A[0], plant.r)), free=True)
    moved = own.in_reduction(evaluator_for(data, plant.evaluator))
    found = {
        "multipliers": (plant.constraints.names, moved.multipliers(T, external)),
        "contact_forces": (plant.all_constraints.names, moved.contact_forces(T, external)),
        "normal_forces": ((), np.zeros((len(T), 0))),
    }
    if forces.outputs.normal_forces.names and plant in forces.normal:
        normal = forces.normal[plant]
        found["normal_forces"] = normal.names, normal.at(moved, T, external)
    missing = 0.0 if forces.switching else np.nan
    return {
        kind: _by_name(getattr(forces.outputs, kind).names, names, values, missing)
        for kind, (names, values) in found.items()
    }


def _by_name(wanted: Sequence[str], known: Sequence[str], values: Array, missing: float) -> Array:
    """Select columns of values (N, k) by name; those of unknown names have the value ``missing``."""
    columns = {name: column for column, name in enumerate(known)}
    found = np.full((len(values), len(wanted)), missing)
    for place, name in enumerate(wanted):
        if name in columns:
            found[:, place] = values[:, columns[name]]
    return found


# ---------------------------------------------------------------------- bodies on the ground


_UPRIGHT = 0.7  # smallest vertical component of a unit vector that counts as vertical
_BESIDE = 0.02  # largest distance between a runner's contact and its steering axis; beyond, it is a trailer [m]
_SAME = 1e-6  # tolerance of equal points [m] and unit vectors


class _Contact(NamedTuple):
    """Ground contact of a body at one configuration."""

    joint: int
    point: np.ndarray
    """Contact point (3,) in the world [m]."""
    lateral: np.ndarray
    """Horizontal unit vector (3,) of the direction without slip; NaN for a ball."""
    beside: float
    """Largest distance to the steering axis [m]."""

    def in_body(self, at: PositionKinematics, joint: int) -> tuple[np.ndarray, np.ndarray]:
        """Point and direction in the frame of a joint."""
        rotation, translation = at.joint_placement(joint)
        return rotation.T @ (self.point - translation), rotation.T @ self.lateral


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
    model, neutral = robot.model, robot.configuration()
    here = Kinematics(robot).position(neutral)
    # Two configurations tell what is fixed in a body: the points and axles that both of them show.
    turned = pin.integrate(model, neutral, np.random.default_rng(0).uniform(-0.4, 0.4, robot.nv))
    there = Kinematics(robot).position(turned)
    # A planar base moves on the ground even if the model has no wheels under it.
    found: dict[int, list[tuple[_Contact, _Contact]]] = {
        joint: [] for joint in range(1, model.njoints) if "Planar" in model.joints[joint].shortname()
    }
    for mechanism in reduced.all_constraints.mechanisms():
        if not isinstance(mechanism, GroundContact) or mechanism.friction == "none":
            continue
        # Both or none: a wheel that lies flat at one of them has no point to compare.
        contacts = [_contact(mechanism, robot, position) for position in (here, there)]
        if contacts[0] is not None and contacts[1] is not None:
            found.setdefault(_carrier(model, here, contacts[0]), []).append((contacts[0], contacts[1]))
    return tuple(_body(robot, joint, found[joint], here, there) for joint in sorted(found))


def _contact(contact: GroundContact, robot: Robot, at: PositionKinematics) -> _Contact | None:
    """Contact at one configuration; None for a wheel or runner that lies flat."""
    frame = robot.frame_id(contact.frame)
    joint, (rotation, translation) = robot.model.frames[frame].parentJoint, at.placement(frame)
    point = translation + rotation @ contact.center
    if contact.axle is None:
        return _Contact(joint, point, np.full(3, np.nan), 0.0)
    lateral = rotation @ contact.axle
    beside = _BESIDE if contact.radius is None else contact.radius
    return _Contact(joint, point, lateral, beside) if abs(lateral[2]) < _UPRIGHT else None


def _carrier(model: pin.Model, here: PositionKinematics, contact: _Contact) -> int:
    """Joint of the vehicle body above a wheel, its fork and its steering."""
    joint = contact.joint
    # Where the parent cannot turn, the wheel itself is the body: a disk that rolls alone.
    while _is_wheel_or_steering(model, here, joint, contact) and _turns(here, model.parents[joint]):
        joint = model.parents[joint]
    return joint


def _is_wheel_or_steering(model: pin.Model, here: PositionKinematics, joint: int, contact: _Contact) -> bool:
    kind = model.joints[joint]
    if kind.nv != 1:
        return "Spherical" in kind.shortname()
    axis = here.joint_jacobian(joint)[3:, kind.idx_v]
    # A sliding joint, such as that of a lift, neither rolls nor steers.
    if np.linalg.norm(axis) < _UPRIGHT:  # prismatic
        return False
    away = (contact.point - here.joint_placement(joint).translation)[:2]
    # A level axis is that of a wheel. An upright one near the contact steers; one farther away is the hitch of a
    # trailer.
    return abs(axis[2]) < _UPRIGHT or float(np.linalg.norm(away)) <= contact.beside


def _turns(here: PositionKinematics, joint: int) -> bool:
    """True if a body can rotate about the vertical."""
    return joint > 0 and float(np.abs(here.joint_jacobian(joint)[5]).max()) > _UPRIGHT


def _body(
    robot: Robot,
    joint: int,
    contacts: Sequence[tuple[_Contact, _Contact]],
    here: PositionKinematics,
    there: PositionKinematics,
) -> GroundBody:
    points, fixed = [], []  # in the joint frame: contact points, and axles without steering
    for one, other in contacts:
        (point, lateral), (point_there, lateral_there) = one.in_body(here, joint), other.in_body(there, joint)
        # A contact that moves in the body, such as one behind a steering axis, is no place to draw it at.
        if np.linalg.norm(point - point_there) < _SAME:
            points.append(point)
        if np.linalg.norm(lateral - lateral_there) < _SAME:
            fixed.append((point, lateral))
    rotation = here.joint_placement(joint).rotation
    left = _own_left(rotation)
    # All of them: axles that cross each other have no common direction ahead.
    if fixed and all(np.linalg.norm(np.cross(fixed[0][1], lateral)) < _SAME for _, lateral in fixed):
        # Parallel axles that do not steer: the body faces across them, and its point is between them.
        points, left = [point for point, _ in fixed], _toward(fixed[0][1], rotation)
    elif contacts and all(np.isnan(one.lateral).any() and one.joint == joint for one, _ in contacts):
        # A ball that rolls itself has no heading.
        # NaN goes through to the heading, and a top view draws no mark.
        left = np.full(3, np.nan)
    name = next(iter(robot.links_of(joint)), str(robot.model.names[joint]))
    return GroundBody(name, joint, np.mean(points, axis=0) if points else np.zeros(3), left)


def _own_left(rotation: np.ndarray) -> np.ndarray:
    """Left unit vector of a body that faces along its own x axis, or along y if x is vertical."""
    # A body whose x axis stands upright, such as a mast, would face nowhere.
    ahead = rotation[:, 0] if abs(rotation[2, 0]) < _UPRIGHT else rotation[:, 1]
    left = np.cross([0.0, 0.0, 1.0], ahead)
    return rotation.T @ (left / np.linalg.norm(left))


def _toward(left: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Return the vector (3,) or its opposite, so that forward points along positive x or y of the body."""
    ahead = rotation.T @ np.cross(rotation @ left, [0.0, 0.0, 1.0])
    # An axle has two directions, and a drawing needs one: forward along a positive axis of the body.
    return left if ahead[int(np.argmax(np.abs(ahead)))] >= 0 else -left
