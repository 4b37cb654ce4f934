"""Regressors of unknown parameters in constraints: radii and tracks of wheels, masses in a momentum.

Paper (14)-(21), Lemma 4.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.constraints import MomentumConservation
from rnc_pin.constraints.wheels_and_blades import RollingRows
from rnc_pin.control.estimation import EstimatedModel, ParametrizedCopy
from rnc_pin.errors import ConfigurationError, ModelError, SingularityError, place_of
from rnc_pin.math.linear_algebra import cross, dot
from rnc_pin.model.input_validation import Positive
from rnc_pin.model.kinematics import WORLD_AXES, Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import RowStack
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class UnknownRadius:
    """Unknown common radius of several wheels.

    Args:
        wheels: frames of ``RollingWheel`` constraints.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.2), rnc.RollingWheel("right_wheel", 0.2)]
        >>> reduced = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"]).reduce()
        >>> unknown = rnc.control.UnknownRadius(["left_wheel", "right_wheel"])
        >>> regressor = rnc.control.WheelRegressor(reduced, [unknown])
        >>> regressor.names, regressor.units
        (('radius of left_wheel, right_wheel',), ('m',))
    """

    wheels: Sequence[str]


@dataclass(frozen=True)
class UnknownTrack:
    """Unknown distance of the two wheels of one axle; the middle and direction of the axle are known.

    Args:
        wheels: frames of two ``RollingWheel`` constraints on wheels that turn on one body.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.2), rnc.RollingWheel("right_wheel", 0.2)]
        >>> reduced = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"]).reduce()
        >>> unknown = rnc.control.UnknownTrack(["left_wheel", "right_wheel"])
        >>> regressor = rnc.control.WheelRegressor(reduced, [unknown])
        >>> regressor.names, regressor.units
        (('track of left_wheel, right_wheel',), ('m',))
    """

    wheels: Sequence[str]


class _Wheel(NamedTuple):
    rows: RollingRows
    """A copy; with radius 1 if the radius is unknown."""
    kept: list[int]
    """Indices of the rows in use: rolling, lateral and vertical, or the rows that the wheel has instead."""
    radius: int | None
    """Column of the radius, if it is unknown."""
    axle: _Axle | None
    """Known data of the axle, if its track is unknown."""


class _Axle(NamedTuple):
    column: int
    """Column of the track in Y."""
    joint: int
    """Joint of the wheel."""
    carrier: int
    """Joint of the body that carries the wheel."""
    middle: np.ndarray
    """Middle of the axle, in the carrier's axes (3,) [m]."""
    side: np.ndarray
    """Half the unit vector to this wheel from the other, in the carrier's axes (3,)."""
    centre: np.ndarray
    """From the joint's origin to the wheel's centre, in the carrier's axes (3,) [m]."""


class WheelRegressor:
    """``A_known(q) v + Y(q, v) p = 0``: rolling rows are affine in radii and tracks.

    u is the vector from the centre to the contact of a wheel of radius 1, and D has the directions of the three rows.
    With the centre at ``c = middle +- track/2 e`` of the body that carries the wheel,

        D (v_middle +- track/2 omega_body x e + radius omega_wheel x u) = 0,

    for upright or leaning wheels. The residual needs a measured velocity of the body in addition to the wheel rates
    (``Measurement.v``): wheel rates alone do not determine the size of wheels. Rows without unknown parameters are left
    out. One state at a time.

    Args:
        reduced: a system with ``RollingWheel`` constraints; its true radii and tracks are never read.
        unknown: unknown radii and tracks, all in metres.

    Raises:
        ConfigurationError: a wheel has no constraint or is named twice, or a pair has no track.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.2), rnc.RollingWheel("right_wheel", 0.2)]
        >>> reduced = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"]).reduce()
        >>> regressor = rnc.control.WheelRegressor(reduced, [rnc.control.UnknownRadius(["left_wheel", "right_wheel"])])
        >>> state = reduced.at(robot.configuration(), [1.0, 2.0])
        >>> y, Y = regressor.regress(state.q, state.v)
        >>> np.linalg.lstsq(Y, y)[0].round(6)  # the radius
        array([0.2])
    """

    def __init__(self, reduced: ReducedModel, unknown: Sequence[UnknownRadius | UnknownTrack]) -> None:
        if not unknown:
            raise ConfigurationError("name at least one unknown radius or track")
        self.names = tuple(f"{_kind(each)} of {', '.join(each.wheels)}" for each in unknown)
        self.units = ("m",) * len(self.names)
        robot = reduced.robot
        found = {
            place.block.wheel: (place.block, place.of(np.arange(len(place.block.names))).tolist())
            for place in reduced.constraints.places
            if isinstance(place.block, RollingRows)
        }
        for wheel, (rows, _) in found.items():
            if rows.affine:
                raise ConfigurationError(
                    f"radii and tracks are estimated on ground at rest; wheel '{wheel}' is on ground that moves"
                )
        radii: dict[str, int] = {}
        tracks: dict[str, _Axle] = {}
        for column, each in enumerate(unknown):
            self._check(each, found, radii if isinstance(each, UnknownRadius) else tracks)
            if isinstance(each, UnknownRadius):
                radii |= dict.fromkeys(each.wheels, column)
            else:
                tracks |= _axles(robot, column, *each.wheels)
        self._model, self._data = robot.model, robot.model.createData()
        self._unknown = [
            _Wheel(copy(rows), kept, radii.get(wheel), tracks.get(wheel))
            for wheel, (rows, kept) in found.items()
            if wheel in radii or wheel in tracks
        ]
        # Copies with radius 1: rows are affine in the radius, so that they are their own coefficients.
        for entry in self._unknown:
            if entry.radius is not None:
                entry.rows.radius = 1.0
        # All rows at first: their values tell which of them depend on a parameter.
        self._wheels = self._unknown
        self._wheels = self._informative_wheels(robot)
        self.predicted = tuple(wheel.rows.names[row] for wheel in self._wheels for row in wheel.kept)
        self.predicted_units = ("m/s",) * len(self.predicted)

    def _check(self, each: UnknownRadius | UnknownTrack, found: Collection[str], taken: Collection[str]) -> None:
        what, pair = _kind(each), isinstance(each, UnknownTrack)
        if isinstance(each.wheels, str) or not each.wheels or (pair and len(each.wheels) != 2):
            expected = "two wheels" if pair else "a list of wheels"
            raise ConfigurationError(f"unknown {what}: expected {expected}, found {each.wheels!r}")
        for wheel in each.wheels:
            place_of(wheel, found, f"unknown {what}: no rolling wheel")
            if wheel in taken or list(each.wheels).count(wheel) > 1:
                raise ConfigurationError(f"unknown {what}: wheel '{wheel}' is named twice")

    def _informative_wheels(self, robot: Robot) -> list[_Wheel]:
        """Wheels with the rows that depend on a parameter; raise an error if a parameter enters no row."""
        generator = np.random.default_rng(0)
        samples: list[np.ndarray] = []
        count = 6  # random states: a parameter that enters a row enters it at almost every one
        for _ in range(count):
            with suppress(SingularityError):  # a wheel that lies flat
                samples.append(self.regress(robot.random_configuration(generator), generator.normal(size=robot.nv))[1])
        silent = 1e-9  # entries of Y below which a parameter does not enter a row
        told = np.abs(samples).max(axis=0) > silent
        for name, heard in zip(self.names, told.any(axis=0), strict=True):
            # Its estimate would never change, and nothing would tell.
            if not heard:
                raise ConfigurationError(f"no independent constraint row depends on the {name}")
        # One entry for each row of ``regress``, in its order.
        rows = iter(told.any(axis=1))
        chosen = [wheel._replace(kept=[row for row in wheel.kept if next(rows)]) for wheel in self._wheels]
        return [wheel for wheel in chosen if wheel.kept]

    def regress(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return ``y = -A_known v`` (e,) [m/s] and Y (e, s) at the measured q (nq,) and v (nv,).

        Args:
            q: measured configuration.
            v: measured velocity.

        Raises:
            SingularityError: a wheel lies flat.
        """
        model, data = self._model, self._data
        pin.forwardKinematics(model, data, q, v)
        size = sum(len(wheel.kept) for wheel in self._wheels)
        y, Y = np.empty(size), np.zeros((size, len(self.names)))
        row = 0
        # Numbers of Python in place of arrays with three entries: this is most of the time of a sample.
        for rows, kept, radius, axle in self._wheels:
            contact = rows.wrenches_at(q, pin.updateFramePlacement(model, data, rows.frame).rotation)
            wheel = pin.getFrameVelocity(model, data, rows.frame, WORLD_AXES).vector.tolist()
            centre, side, turning = wheel[:3], (0.0, 0.0, 0.0), wheel[3:]
            # A centre at an unknown track: the motion of the axle's middle is known, the rest is a column of Y.
            if axle is not None:
                rotation, body = data.oMi[axle.carrier].rotation, data.v[axle.carrier].vector.tolist()
                middle = cross(body[3:], axle.middle.tolist())
                centre = rotation.dot([a + b for a, b in zip(body, middle, strict=False)]).tolist()
                side = rotation.dot(cross(body[3:], axle.side.tolist())).tolist()
            for direction in (contact[each] for each in kept):
                known, rolling = dot(direction, centre), dot(direction[3:], turning)
                if axle is not None:
                    Y[row, axle.column] = dot(direction, side)
                if radius is None:
                    known += rolling
                else:
                    Y[row, radius] = rolling
                y[row] = -known
                row += 1
        return y, Y

    def values_of(self, system: NonholonomicSystem) -> np.ndarray:
        """Return the radii and tracks (s,) of a system [m], e.g. of a calibrated one: first estimates of an estimator.

        Args:
            system: a system with the same wheels. A common radius is the mean of its wheels' radii.
        """
        rolling = (place.block for place in system.rows.places if isinstance(place.block, RollingRows))
        radii = {rows.wheel: rows.radius for rows in rolling}
        values: list[list[float]] = [[] for _ in self.names]
        for wheel in self._unknown:
            if wheel.radius is not None:
                values[wheel.radius].append(float(radii[wheel.rows.wheel]))
            if wheel.axle is not None:
                here = system.robot.model.jointPlacements[wheel.axle.joint].translation + wheel.axle.centre
                # Twice the distance from the middle along the axle, whose unit vector is 2 side.
                values[wheel.axle.column].append(float(2 * (2 * wheel.axle.side) @ (here - wheel.axle.middle)))
        # One parameter of several wheels has the mean of their values.
        return np.array([np.mean(each) for each in values])

    def estimated(self, reduced: ReducedModel) -> EstimatedModel:
        """Return models with the estimated radii and tracks.

        Args:
            reduced: the model with the true radii and tracks.
        """
        return EstimatedModel(reduced, partial(self._copy, reduced))

    def _copy(self, reduced: ReducedModel) -> ParametrizedCopy:
        """Copies of the model and of the rolling rows, with unit radii and tracks."""
        model = reduced.robot.model.copy()
        # Shallow copies are enough: only the radius of a row changes.
        blocks = [copy(rows) if isinstance(rows, RollingRows) else rows for rows, *_ in reduced.all_constraints.places]
        copies = {block.wheel: block for block in blocks if isinstance(block, RollingRows)}
        wheels = [(copies[wheel.rows.wheel], wheel.radius, wheel.axle) for wheel in self._unknown]
        _set_parameters(model, wheels, np.ones(len(self.names)))
        return ParametrizedCopy(model, RowStack(blocks), partial(_set_parameters, model, wheels))


def _set_parameters(
    model: pin.Model, wheels: Sequence[tuple[RollingRows, int | None, _Axle | None]], p: np.ndarray
) -> None:
    """Write estimated radii and tracks p into a model."""
    for rows, radius, axle in wheels:
        if radius is not None:
            rows.radius = float(p[radius])
        if axle is not None:
            place = model.jointPlacements[axle.joint]
            origin = axle.middle + p[axle.column] * axle.side - axle.centre
            model.jointPlacements[axle.joint] = pin.SE3(place.rotation, origin)


def _kind(each: UnknownRadius | UnknownTrack) -> str:
    return "radius" if isinstance(each, UnknownRadius) else "track"


def _axles(robot: Robot, column: int, first: str, second: str) -> dict[str, _Axle]:
    """Axle data of two wheels on the body that carries them: the middle and the direction, not the distance."""
    model = robot.model
    frames = [model.frames[robot.frame_id(wheel)] for wheel in (first, second)]
    joints = [frame.parentJoint for frame in frames]
    carriers = [model.parents[joint] for joint in joints]
    pair = f"unknown track: wheels '{first}' and '{second}'"
    if joints[0] == joints[1] or carriers[0] != carriers[1]:
        raise ConfigurationError(f"{pair} do not turn on joints of their own on one body: they have no fixed track")
    centres, offsets, position = [], [], Kinematics(robot).position(robot.configuration())
    for wheel, frame, joint in zip((first, second), frames, joints, strict=True):
        offset = model.jointPlacements[joint].rotation @ frame.placement.translation
        # A centre beside the axis of its joint moves as the wheel turns: the axle has no fixed length.
        moved = position.jacobian(robot.frame_id(wheel))[:3, model.joints[joint].idx_v]
        if model.joints[joint].nv != 1 or np.linalg.norm(moved) >= 1e-9:
            raise ConfigurationError(f"{pair} have no fixed track: frame '{wheel}' is not on the axis of its joint")
        centres.append(model.jointPlacements[joint].translation + offset)
        offsets.append(offset)
    apart = centres[0] - centres[1]
    length = float(np.linalg.norm(apart))
    if length < 1e-9:
        raise ConfigurationError(f"{pair} have the same position: the direction of their axle is undefined")
    middle, half = (centres[0] + centres[1]) / 2, apart / length / 2
    return {
        wheel: _Axle(column, joint, carriers[0], middle, sign * half, offset)
        for wheel, joint, sign, offset in zip((first, second), joints, (1.0, -1.0), offsets, strict=True)
    }


@dataclass(frozen=True)
class UnknownMass:
    """Body of unknown mass but known mass distribution.

    Args:
        joint: the joint that carries the body.
        unit: mass that counts as 1 [kg]. The paper's parameters are ``m_k / J``: unit J.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> unknown = rnc.control.UnknownMass("joint_3", unit=10.0)
        >>> regressor = rnc.control.MomentumRegressor(robot, "platform", [unknown])
        >>> regressor.names, regressor.units
        (('mass behind joint_3',), ('10 kg',))
    """

    joint: str
    unit: Positive = 1.0


class MomentumRegressor:
    """``A_known(q) v + Y(q, v) p = 0``: momentum is linear in the unknown masses.

    With the base columns of ``A_known`` nonsingular, the base moves as ``x1dot = W0 + W p``.

    Args:
        robot: the robot; the masses of its unknown bodies are never read.
        base: the joint whose momentum is conserved.
        unknown: the bodies.

    Raises:
        ModelError: unknown joint, or a body without mass.
        ConfigurationError: no body of known mass turns with the base.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> regressor = rnc.control.MomentumRegressor(robot, "platform", [rnc.control.UnknownMass("joint_3")])
        >>> state = reduced.at(robot.configuration({"joint_2": 1.8}), [0.1, 0.2, 0.3])
        >>> y, Y = regressor.regress(state.q, state.v)
        >>> (y / Y[:, 0]).round(6), robot.model.inertias[robot.joint_id("joint_3")].mass  # estimated and true mass
        (array([10.]), 10.0)
    """

    def __init__(self, robot: Robot, base: str, unknown: Sequence[UnknownMass]) -> None:
        if not unknown:
            raise ConfigurationError("name at least one body of unknown mass")
        momentum = MomentumConservation(base).bind(robot)  # raises an error if the joint is not cyclic
        self.names = tuple(f"mass behind {each.joint}" for each in unknown)
        self.units = tuple("kg" if each.unit == 1.0 else f"{each.unit:g} kg" for each in unknown)
        self.rows = robot.velocity_indices(base)
        self.predicted = robot.velocity_names[self.rows]
        self.predicted_units = tuple("rad/s" if unit == "N m s" else "m/s" for unit in momentum.units)
        self.joints = [robot.joint_id(each.joint) for each in unknown]
        self._known = robot.model.copy()
        self._unit = []
        for each, joint in zip(unknown, self.joints, strict=True):
            inertia = robot.model.inertias[joint]
            if not inertia.mass > 0:
                raise ModelError(f"body behind joint '{each.joint}' has no mass to estimate")
            # Inertia of the body at unit mass.
            shape = inertia.toDynamicParameters() / inertia.mass
            self._unit.append(each.unit * shape)
            # The true mass is divided out above and removed here: no prediction depends on it.
            self._known.inertias[joint] = pin.Inertia.Zero()
        self._unit_inertias = [pin.Inertia.FromDynamicParameters(unit) for unit in self._unit]
        base_joint = robot.joint_id(base)
        # Bodies that the base does not carry add nothing to its momentum.
        self._moved = [base_joint in list(robot.model.supports[joint]) for joint in self.joints]
        self._data = self._known.createData()
        known = pin.crba(self._known, self._data, robot.configuration())[self.rows, self.rows]
        # W0 and W need the inverse of the known base inertia, which must not consist of rounding.
        if np.linalg.cond(known) > 1e10:
            raise ConfigurationError(f"no body of known mass turns with joint '{base}'")

    def regress(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return ``x1dot - W0`` (k,) and W (k, s), the paper's form of y and Y.

        Args:
            q: measured configuration.
            v: measured velocity.
        """
        model, data, rows = self._known, self._data, self.rows
        A = pin.crba(model, data, q, pin.Convention.WORLD)[rows]  # Jacobians in world axes too
        pin.forwardKinematics(model, data, q, v)
        columns = np.empty((1 + len(self.joints), A.shape[0]))
        for column, joint, unit, moved in zip(columns[1:], self.joints, self._unit_inertias, self._moved, strict=True):
            # Momentum of the body at unit parameter, about the origin of the world.
            momentum = data.oMi[joint].act(unit * data.v[joint]).vector
            column[:] = momentum.dot(data.J[:, rows]) if moved else 0.0
        others = v.copy()
        # Momentum of the known bodies by the other joints alone: the rates of the base are solved for.
        others[rows] = 0.0
        columns[0] = A.dot(others)
        solved = np.linalg.solve(A[:, rows], columns.T)
        return v[rows] + solved[:, 0], -solved[:, 1:]

    def estimated(self, reduced: ReducedModel) -> EstimatedModel:
        """Return models whose unknown bodies have the estimated masses.

        Args:
            reduced: the model with the true masses.
        """
        return EstimatedModel(reduced, partial(self._copy, reduced))

    def _copy(self, reduced: ReducedModel) -> ParametrizedCopy:
        """Copy of the model with unit masses. No row holds a mass."""
        model = reduced.robot.model.copy()
        self._set_parameters(model, np.ones(len(self.names)))
        return ParametrizedCopy(model, reduced.all_constraints, partial(self._set_parameters, model))

    def _set_parameters(self, model: pin.Model, p: np.ndarray) -> None:
        for joint, value, unit in zip(self.joints, p, self._unit, strict=True):
            model.inertias[joint] = pin.Inertia.FromDynamicParameters(float(value) * unit)
