"""Exact steering that constraint rows allow, told by the velocities at random configurations."""

from __future__ import annotations

from typing import NoReturn

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.array_shapes import Bool, Float
from rnc_pin.errors import ConfigurationError, SingularityError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.planning.exact_steering import CarSteering, DifferentialDrive, FreeSteering, Steering
from rnc_pin.robots.joint_values import NO_LIMIT

_SAMPLES = 6  # random configurations at which the rows are compared
_EXACT = 1e-9  # largest difference of unit vectors that counts as rounding


def find_steering(
    reduced: ReducedModel, q0: Float[Array, " nq"], seed: int = 0, *, reverse: bool = True, room: float = 0.0
) -> Steering:
    """Find the exact steering that the constraint rows of a reduced system allow.

    Random configurations decide, so that a property that holds there holds everywhere.

    Args:
        reduced: the model.
        q0: a configuration (nq,).
        seed: seed of the random configurations.
        reverse: False if a car or a differential drive does not drive backwards. Forwards is the direction of the
            base's x axis, or of its y axis if it cannot drive along x.
        room: part of the range of a car's steering joint that stays free at each end, e.g. for feedback.

    Raises:
        ConfigurationError: no exact steering is known: trailers, momentum rows, or closed loops. Or a base that moves
            in all directions has no reverse.

    Example:
        >>> robot = rnc.Robot.from_urdf("car.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("front_axle"), rnc.NoSideSlip("rear_axle")])
        >>> steering = rnc.planning.find_steering(system.reduce(), robot.configuration())
        >>> steering.kind
        'car'
    """
    if reduced.assembly.size:
        _refuse(reduced, f"row '{reduced.assembly.names[0]}' couples joints")
    samples = _Samples(reduced, q0, seed)
    planned = ~samples.followers()
    places = np.flatnonzero(planned)
    if reduced.r == len(places):
        if not reverse:
            raise ConfigurationError("reverse: only cars and differential drives have a direction that is forwards")
        return FreeSteering(reduced, planned)
    base = reduced.robot.model.joints[1]
    if base.shortname() != "JointModelPlanar":
        _refuse(reduced, "the rows restrict joints other than a planar base")
    first = base.idx_v
    rows = [_annihilators(R[places]) for R in samples.bases]
    on_base = np.isin(places, np.arange(first, first + 3))
    if any(np.abs(each[:, ~on_base]).max(initial=0.0) > _EXACT for each in rows):
        _refuse(reduced, "the rows couple the base with other joints")
    count = len(places) - reduced.r
    if count == 1:
        directions = np.array([each[0, on_base] for each in rows])
        if np.abs(directions * np.sign(directions @ directions[0])[:, None] - directions[0]).max() > _EXACT:
            _refuse(reduced, "the direction of the row without side slip changes")
        return DifferentialDrive(reduced, planned, _axle(reduced, directions[0]), reverse)
    twists = np.array([np.linalg.svd(each[:, on_base])[2][-1] for each in rows])
    _, sizes, axes = np.linalg.svd(twists)
    steering = samples.steering_joints(slice(first, first + 3), planned)
    if count != 2 or sizes[2] > _EXACT * sizes[0] or len(steering) != 1:
        _refuse(reduced, "the motion of the base is not that of a car with one steering joint")
    return CarSteering(reduced, planned, _axle(reduced, axes[2]), reverse, steering[0], q0, room)


def _axle(reduced: ReducedModel, row: Array) -> Array:
    if np.hypot(row[0], row[1]) < 1e-6:
        _refuse(reduced, "the base cannot turn")
    return row


def _refuse(reduced: ReducedModel, why: str) -> NoReturn:
    raise ConfigurationError(
        f"no exact steering is known for '{reduced.robot.name}': {why}. Known are arms, free bodies, differential "
        "drives, cars with one steering joint and Mecanum bases, each with arms"
    )


def _annihilators(R: Float[Array, "n r"]) -> Float[Array, "k n"]:
    """Orthonormal rows (n - r, n) that all velocities satisfy."""
    return np.linalg.svd(R)[0][:, R.shape[1] :].T


def planned_velocities(reduced: ReducedModel, q0: Float[Array, " nq"], seed: int = 0) -> Bool[Array, " nv"]:
    """Mask of the velocities that are planned; wheels without limits, on which no row depends, follow.

    Args:
        reduced: the model.
        q0: a configuration (nq,).
        seed: seed of the random configurations.
    """
    return ~_Samples(reduced, q0, seed).followers()


class _Samples:
    """Random configurations within the limits, and bases R (nv, r) of the velocities that the rows allow there."""

    def __init__(self, reduced: ReducedModel, q0: Array, seed: int) -> None:
        self._reduced, self._model = reduced, reduced.robot.model
        self._generator = np.random.default_rng(seed)
        lower, upper = self._model.lowerPositionLimit.copy(), self._model.upperPositionLimit.copy()
        wide = ~((lower > -NO_LIMIT) & (upper < NO_LIMIT) & (lower < upper))
        lower[wide], upper[wide] = -1.0, 1.0
        pin.seed(seed)
        self._q, self.bases = [np.array(q0)], [np.array(reduced.at(q0).R)]
        for _ in range(20 * _SAMPLES):
            if len(self._q) == _SAMPLES:
                break
            q = pin.randomConfiguration(self._model, lower, upper)
            try:
                self.bases.append(np.array(reduced.at(q).R))
            except SingularityError:
                continue
            self._q.append(q)

    def followers(self) -> Bool[Array, " nv"]:
        """Mask of joints that follow: without limits, no row depends on them, and others determine their motion."""
        found = np.zeros(self._model.nv, dtype=bool)
        for joint in list(self._model.joints)[1:]:
            if joint.nv != 1 or not self._unlimited(joint):
                continue
            rest = ~found
            rest[joint.idx_v] = False
            if all(np.linalg.matrix_rank(R[rest], tol=_EXACT) == R.shape[1] for R in self.bases):
                found[joint.idx_v] = not self._matters(int(joint.idx_v), slice(None))
        return found

    def _unlimited(self, joint: pin.JointModel) -> bool:
        entry = slice(joint.idx_q, joint.idx_q + joint.nq)
        low, high = self._model.lowerPositionLimit[entry], self._model.upperPositionLimit[entry]
        return joint.nq == 2 or bool(not (low < high).all() or ((low < -NO_LIMIT).all() and (high > NO_LIMIT).all()))

    def steering_joints(self, rows: slice, planned: Bool[Array, " nv"]) -> list[int]:
        """Velocities of planned joints with one degree of freedom on which the motion of the base depends."""
        single = [int(each.idx_v) for each in list(self._model.joints)[1:] if each.nv == 1]
        return [index for index in single if planned[index] and self._matters(index, rows)]

    def _matters(self, index: int, rows: slice) -> bool:
        """True if the velocities that the rows allow depend on a joint."""
        for q, R in zip(self._q, self.bases, strict=True):
            step = np.zeros(self._model.nv)
            step[index] = self._generator.uniform(0.05, 0.5)
            try:
                other = self._reduced.at(pin.integrate(self._model, q, step)).R
            except SingularityError:
                return True
            if np.abs(_projector(other[rows]) - _projector(R[rows])).max() > _EXACT:
                return True
        return False


def _projector(R: Array) -> Array:
    """Projector on the space of the columns, which are dependent if only some rows are taken."""
    U, sizes, _ = np.linalg.svd(R, full_matrices=False)
    span = U[:, sizes > 1e-9 * max(float(sizes[0]), 1e-300)]
    return np.asarray(span @ span.T)
