"""Exact steering that constraint rows allow, and path curvature of a vehicle as a function of its steering output."""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple, NoReturn

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.array_shapes import Array, Bool, Float
from rnc_pin.constraints.wheeled_base import WheeledBase
from rnc_pin.constraints.wheels_and_blades import RollingRows
from rnc_pin.errors import ConfigurationError, ConstraintError, InfeasibleError, SingularityError
from rnc_pin.model.frame_rows import FrameVelocityRows
from rnc_pin.model.kinematics import OWN_AXES
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.motion.planning.action_models import KinematicFlow
from rnc_pin.motion.planning.exact_steering import (
    AimedSteering,
    CarSteering,
    DifferentialDrive,
    FreeSteering,
    JointCouplings,
    Steering,
)
from rnc_pin.robots.joint_values import limited_positions

_ROUNDED = 1e-3  # side slip, or motion while the vehicle only steers, that rounding in a file may cause


class _Row(NamedTuple):
    """Table row of one configuration; slopes are derivatives by the steering output."""

    output: float
    curvature: float
    curvature_slope: float
    speed: float
    speed_slope: float


class SteeringGeometry:
    """Steering output and speed output for each path curvature of a frame.

    At unit rate of the speed output the frame moves at u along its x axis and turns at w. Both are entries of ``J R``;
    J has the rows of the frame's velocity. The curvature is ``w / u``. Its derivative by the steering output follows
    from ``d(J R)/dt`` while only that output moves, at unit rate. Cubic Hermite interpolation inverts a table of both.
    The class supports one steered wheel, the left wheel of an Ackermann linkage, and any other geometry of the rows.

    Args:
        reduced: the vehicle.
        q: initial configuration of the table (nq,).
        frame: frame that follows the path, x forward, in the middle of an axle that does not steer.
        speed: index of the speed in x2.
        steering: index of the steering output in x2.
        largest: largest curvature of the table [1/m].

    Raises:
        ConfigurationError: the frame slips sideways, moves while the vehicle only steers, or the curvature depends on
            more than the steering output.

    Example:
        >>> robot = rnc.Robot.from_urdf("car.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("front_axle"), rnc.NoSideSlip("rear_axle")])
        >>> reduced = system.reduce([rnc.FrameSpeed("rear_axle"), rnc.JointPosition("front_steering")])
        >>> q = robot.configuration()
        >>> geometry = rnc.planning.SteeringGeometry(reduced, q, "rear_axle", speed=0, steering=1, largest=0.8)
        >>> angles, _ = geometry.outputs(np.array([0.0, 0.5]))
        >>> np.tan(angles).round(6)  # of one wheel in the middle, a metre ahead: the curvature itself
        array([0. , 0.5])
    """

    def __init__(
        self, reduced: ReducedModel, q: Float[Array, " nq"], frame: str, *, speed: int, steering: int, largest: float
    ) -> None:
        self._reduced, self._frame, self._speed, self._steering = reduced, frame, speed, steering
        self._largest = largest
        self._name = reduced.reducing.names[steering]
        self._rows = FrameVelocityRows(reduced.robot, frame, [0, 1, 5], OWN_AXES)
        first = self._row(q)
        table = [*reversed(self._march(q, first, -1.0)), first, *self._march(q, first, 1.0)]
        output, curvature, curvature_slope, ratio, speed_slope = np.array(table).T
        if len(table) < 2:
            raise ConfigurationError(f"'{self._name}' does not steer frame '{frame}'")
        self.range: tuple[float, float] = float(curvature[0]), float(curvature[-1])
        """Smallest and largest curvature that the output reaches [1/m]."""
        # The table inverts the curvature: its slopes are the inverses, and need no differences.
        self._outputs = scipy.interpolate.CubicHermiteSpline(curvature, output, 1.0 / curvature_slope)
        self._ratios = scipy.interpolate.CubicHermiteSpline(curvature, ratio, speed_slope / curvature_slope)

    def outputs(self, curvatures: Float[Array, " n"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """Return steering outputs (n,) for curvatures (n,) [1/m], and speed outputs (n,) per unit speed of the frame.

        Raises:
            InfeasibleError: a curvature is outside the range of the output.
        """
        low, high = self.range
        slack = 1e-9 * self._largest
        worst = float(curvatures[np.argmax(np.maximum(low - curvatures, curvatures - high))])
        if not low - slack <= worst <= high + slack:
            raise InfeasibleError(
                f"the path has a curvature of {worst:.3g} 1/m, but within its range output '{self._name}' steers frame "
                f"'{self._frame}' from {low:.3g} to {high:.3g} 1/m only: give a smaller max_steering"
            )
        return self._outputs(curvatures), 1.0 / self._ratios(curvatures)

    def _march(self, q: Array, first: _Row, sign: float) -> list[_Row]:
        """Table rows in one direction of curvature, up to the largest curvature or the end of the output's range."""
        found: list[_Row] = []
        steps = 100  # table steps from curvature zero to the largest; interpolated outputs are exact to 1e-9
        row, step = first, sign * self._largest / steps
        while sign * row.curvature < self._largest:
            try:
                q = self._steered(q, step / row.curvature_slope)
                row = self._row(q)
            except (SingularityError, ConstraintError):
                break
            turned = sign * (row.curvature - (found[-1] if found else first).curvature) <= 0
            flat = 1e-3  # slope of the curvature, relative to the first slope, below which the table ends
            # Beyond the turning point of the curvature, the inverse would have two values.
            if turned or row.curvature_slope / first.curvature_slope < flat or self._is_outside(q):
                break
            found.append(row)
        return found

    def _steered(self, q: Array, by: float) -> Array:
        """Assembled configuration after a motion of the steering output alone."""
        end = KinematicFlow(self._reduced).step(q[None], by * np.eye(self._reduced.r)[[self._steering]])[0]
        return self._reduced.assembled(end) if self._reduced.assembly.size else end

    def _is_outside(self, q: Array) -> bool:
        model = self._reduced.robot.model
        low, high = model.lowerPositionLimit, model.upperPositionLimit
        return bool(((low < high) & ((q < low - 1e-12) | (q > high + 1e-12))).any())

    def _row(self, q: Array) -> _Row:
        here = self._reduced.at(q)
        steering = StateEvaluation(here, v=here.R[:, self._steering])
        W, rates = self._rows.jacobian(here.position) @ here.R, self._rates(steering)
        driven, steered = W[:, self._speed], W[:, self._steering]
        length = 1.0 / self._largest  # turns and displacements are compared over the smallest radius
        if not abs(driven[0]) > _ROUNDED:
            self._refuse("does not move along its x axis")
        if abs(driven[1]) > _ROUNDED * abs(driven[0]):
            self._refuse("slips sideways: expected one in the middle of an axle that does not steer, x forward")
        if np.abs(steered * [1.0, 1.0, length]).max() > _ROUNDED * length:
            self._refuse(f"moves while '{self._name}' turns and the vehicle stands")
        curvature = driven[2] / driven[0]
        along = self._rates(StateEvaluation(here, v=here.R[:, self._speed] / driven[0]))
        if abs(self._slope(along, driven, curvature)) > _ROUNDED / length**2:
            self._refuse(f"turns by more than '{self._name}': the curvature of its path changes while it is driven")
        slope = self._slope(rates, driven, curvature)
        if not abs(slope) > _ROUNDED * self._largest:
            raise ConfigurationError(f"'{self._name}' does not steer frame '{self._frame}'")
        output = float(here.outputs()[1][self._steering])
        return _Row(output, float(curvature), float(slope), float(driven[0]), float(rates[0]))

    def _rates(self, state: StateEvaluation) -> Array:
        """Time derivative of forward, sideways and turning speed (3,) per unit rate of the speed output."""
        rates = state.motion
        W_dot = self._rows.jacobian_dot(rates) @ state.R + self._rows.jacobian(rates) @ state.R_dot
        return W_dot[:, self._speed]

    @staticmethod
    def _slope(rates: Array, driven: Array, curvature: float) -> float:
        return float((rates[2] - curvature * rates[0]) / driven[0])

    def _refuse(self, why: str) -> NoReturn:
        raise ConfigurationError(f"frame '{self._frame}' cannot drive a path: it {why}")


_SAMPLES = 6  # random configurations at which the rows are compared
_EXACT = 1e-9  # largest difference of unit vectors that counts as rounding


def find_steering(reduced: ReducedModel, q0: Float[Array, " nq"], *, room: float = 0.0) -> Steering:
    """Find the exact steering that the constraint rows of a reduced system allow.

    Random configurations decide, so that a property that holds there holds everywhere.

    Args:
        reduced: the model.
        q0: a configuration (nq,).
        room: part of the range of a car's steering joint that stays free at each end, e.g. for feedback.

    Raises:
        ConfigurationError: no exact steering is known: trailers, momentum rows, closed loops, or rows that prescribe a
            motion.

    Example:
        >>> robot = rnc.Robot.from_urdf("car.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("front_axle"), rnc.NoSideSlip("rear_axle")])
        >>> steering = rnc.planning.find_steering(system.reduce(), robot.configuration())
        >>> steering.kind
        'car'
    """
    if reduced.affine:
        _refuse(reduced, "its rows prescribe a motion")
    samples = SampledBases(reduced, q0)
    if samples.couplings.unknown:
        _refuse(reduced, f"row '{samples.couplings.unknown[0]}' couples joints")
    planned = ~samples.followers()
    places = np.flatnonzero(planned)
    if reduced.r == len(places):
        return FreeSteering(reduced, planned)  # as many free directions as planned velocities
    if reduced.robot.model.joints[1].shortname() != "JointModelPlanar":
        _refuse(reduced, "the rows restrict joints other than a planar base")
    base = WheeledBase(reduced, next(each.name for each in reduced.robot.model.frames if each.parentJoint == 1))
    rows = [np.linalg.svd(R[places])[0][:, reduced.r :] for R in samples.bases]  # that all velocities satisfy
    if any(np.abs(each[~np.isin(places, [0, 1, 2, *base.resting])]).max(initial=0.0) > _EXACT for each in rows):
        _refuse(reduced, "the rows couple the base with other joints")
    motion, count = base.at(q0), len(places) - reduced.r
    steering = [joint for joint in base.steering if planned[joint]]
    if motion.free.shape[1] == 2 and count - 1 == len(steering) <= 1:
        row = np.linalg.svd(motion.moving[base.base] @ motion.free)[0][:, 2]  # of the axle without pivots
        if np.hypot(row[0], row[1]) < 1e-6:
            _refuse(reduced, "the base cannot turn")
        if count == 1:
            return DifferentialDrive(reduced, planned, row)
        return CarSteering(reduced, planned, row, steering[0], q0, room)
    one_by_one = len(motion.guides) <= len(base.pivots) and {*steering} <= {*base.pivots}
    ranges = (base.upper - base.lower)[base.pivots]
    if motion.free.shape[1] < 3 or not one_by_one or ranges.min() < np.pi:
        _refuse(reduced, "the motion of the base is not that of a car with one steering joint, or of steered drives")
    return AimedSteering(reduced, planned, base, q0)


def _refuse(reduced: ReducedModel, why: str) -> NoReturn:
    raise ConfigurationError(
        f"no exact steering is known for '{reduced.robot.name}': {why}. Known are arms, free bodies, differential "
        "drives, cars with one steering joint, steered drives and Mecanum bases, each with arms"
    )


class SampledBases:
    """Random configurations within the limits, and bases R (nv, r) of the velocities that the rows allow there."""

    def __init__(self, reduced: ReducedModel, q0: Array) -> None:
        self._reduced, self._model, self.couplings = reduced, reduced.robot.model, JointCouplings(reduced)
        self._limited = limited_positions(reduced.robot, None).v
        self._generator = np.random.default_rng(0)  # the kind of a robot's steering does not depend on a seed
        self._q, self.bases = [np.array(q0)], [np.array(reduced.at(q0).R)]
        for _ in range(_SAMPLES - 1):
            with suppress(SingularityError):  # fewer samples decide then: the rows are rarely singular
                q = reduced.random_configuration(self._generator)
                self.bases.append(np.array(reduced.at(q).R))
                self._q.append(q)

    def followers(self) -> Bool[Array, " nv"]:
        """Mask of joints that follow: those of couplings, and those without limits whose motion others determine.

        Among these are wheels, on whose angles no row depends, and casters, whose angles matter for themselves alone.
        """
        found = np.isin(np.arange(self._model.nv), self.couplings.velocities)
        size = -1
        # A wheel below a caster follows only when the caster does: repeat until no joint is added.
        while size < found.sum():
            size = int(found.sum())
            for joint in list(self._model.joints)[1:]:
                if joint.nv != 1 or found[joint.idx_v] or joint.idx_v in self._limited:
                    continue
                # Its motion has to follow from the others: without it, the rest still spans all motions.
                rest = ~found
                rest[joint.idx_v] = False
                if all(np.linalg.matrix_rank(R[rest], tol=_EXACT) == R.shape[1] for R in self.bases):
                    rows = rest if self._is_caster(joint) else slice(None)
                    found[joint.idx_v] = not self.matters(int(joint.idx_v), rows)
        return found

    def _is_caster(self, joint: pin.JointModel) -> bool:
        """True if a wheel that a joint carries trails it by less than its diameter: it turns round below the base."""
        position = self._reduced.at(self._q[0]).position
        wheels = [block for block, *_ in self._reduced.all_constraints.places if isinstance(block, RollingRows)]
        levers = [np.linalg.norm(position.jacobian(each.frame)[:3, joint.idx_v]) / each.radius for each in wheels]
        return bool(min(levers, default=np.inf) < 2.0)

    def matters(self, index: int, rows: slice | Bool[Array, " nv"]) -> bool:
        """True if the velocities that the rows allow depend on a joint.

        Args:
            index: velocity of the joint.
            rows: velocities that count.
        """
        for q, R in zip(self._q, self.bases, strict=True):
            step = np.zeros(self._model.nv)
            step[index] = self._generator.uniform(0.05, 0.5)
            try:
                other = self._reduced.at(self.couplings.applied(pin.integrate(self._model, q, step))).R
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
