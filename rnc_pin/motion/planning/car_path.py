"""Path of a vehicle with front steering, from pose to pose, one leg each: paper (22) and section 4.3; its steering."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Annotated, NamedTuple, NoReturn

import numpy as np
import scipy
from annotated_types import Gt, Lt
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import ConfigurationError, ConstraintError, InfeasibleError, SingularityError
from rnc_pin.model.coordinates import wrapped
from rnc_pin.model.frame_rows import FrameVelocityRows
from rnc_pin.model.input_validation import Positive
from rnc_pin.model.kinematics import OWN_AXES
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.motion.planning.action_models import KinematicFlow
from rnc_pin.references.reference import InTurn, Reference, ViaPoints

_STEEPEST = np.deg2rad(75.0)
FINE = 201  # points of a leg at which its curvature is checked
# Angles of charts from the mean heading, as parts of the angle that the limit of 75 degrees leaves.
_OFFSETS = np.array([0.0, -0.25, 0.25, -0.5, 0.5, -0.8, 0.8])

# Quintics on s in [0, 1]: one each with unit final value, initial slope and final slope; all other end data are zero.
_SHAPES = [Polynomial([0, 0, 0, 10, -15, 6]), Polynomial([0, 1, 0, -6, 8, -3]), Polynomial([0, 0, 0, -4, 7, -3])]
_VALUES, _SLOPES, _BENDS = ([shape.deriv(order) if order else shape for shape in _SHAPES] for order in range(3))
_SAMPLES = 401  # of a leg


@cache
def _sampled(samples: int) -> tuple[Array, Array, Array]:
    """Samples s (samples,), and first and second derivatives (3, samples) of the shapes at them."""
    s = np.linspace(0.0, 1.0, samples)
    return s, np.array([shape(s) for shape in _SLOPES]), np.array([shape(s) for shape in _BENDS])


@dataclass(frozen=True)
class Leg:
    """Path of one piece between two poses; the car rests with straight wheels at both.

    (x, y) of the rear axle is a flat output of a car (Fliess, Levine, Martin and Rouchon 1995): heading, steering angle
    and speed follow from it by differentiation. In the chained form (22) ``x1 = tan theta = y'`` and ``x0 = tan phi /
    (L cos^3 theta) = y''`` are functions of x. So a leg from pose to pose with straight wheels is the quintic y(x) with
    given y, y' and y'' = 0 at both ends. The form holds in any rotated axes. Each leg has its own axes (a chart), and
    its headings stay within 75 degrees of them. If x decreases along the leg, the car backs up.

    Attributes:
        start: (x, y, heading) of the rear axle's middle [m, m, rad].
        goal: (x, y, heading) of the same point at the end.
        chart: direction of the x axis in which the leg is y(x) [rad].
    """

    start: Float[Array, " 3"]
    goal: Float[Array, " 3"]
    chart: float

    @property
    def length(self) -> float:
        """Length along the path [m]."""
        dx, factors = self._coefficients()
        s, slopes, _ = _sampled(FINE)
        return float(abs(dx) * np.trapezoid(np.sqrt(1 + (factors @ slopes / dx) ** 2), s))

    def _coefficients(self) -> tuple[float, Array]:
        """Extent in x, and factors (3,) of the shapes."""
        dx, dy, slopes = _in_chart(self.start, self.goal, np.array(self.chart))
        return float(dx), np.array([dy, dx * slopes[0], dx * slopes[1]])

    def drive(self, duration: float, wheelbase: float, samples: int) -> tuple[Array, Array, Array, Array]:
        """Return the motion along the leg; the chart's x is a minimum-jerk function of time.

        Args:
            duration: [s].
            wheelbase: rear to front axle [m].
            samples: number of equally spaced times.

        Returns:
            Times (N,) from zero, poses (N, 3), signed speeds (N,) and steering angles (N,).
        """
        times = np.linspace(0.0, duration, samples)
        # A minimum-jerk motion from 0 to 1 is the first of the shapes.
        s, s_dot = _SHAPES[0](times / duration), _SLOPES[0](times / duration) / duration
        dx, factors = self._coefficients()
        # Flatness: heading and curvature of the quintic y(x), whose axes are those of the chart.
        y, slope, bend = (
            factors @ [shape(s) for shape in shapes] / dx**order
            for order, shapes in enumerate((_VALUES, _SLOPES, _BENDS))
        )
        c, n = np.cos(self.chart), np.sin(self.chart)
        x = dx * s
        # Keep the start heading as given, not modulo a full turn.
        heading = self.start[2] + np.arctan(slope) - np.arctan(slope[0])
        poses = np.column_stack([self.start[0] + c * x - n * y, self.start[1] + n * x + c * y, heading])
        speeds = dx * s_dot * np.sqrt(1 + slope**2)
        return times, poses, speeds, np.arctan(wheelbase * bend / (1 + slope**2) ** 1.5)


def best_leg(start: Float[Array, " 3"], goal: Float[Array, " 3"], radius: float, forward_only: bool = False) -> Leg:
    """Return the cheapest leg between two poses.

    The cost is ``integral of 1 + (radius curvature)^2 along the leg``: its length plus a penalty on curvature. Without
    the penalty the best leg would turn as sharply as possible at both ends.

    Args:
        start: (x, y, heading) of the rear axle's middle [m, m, rad].
        goal: (x, y, heading) of the same point at the end.
        radius: smallest turning radius of the car [m].
        forward_only: True forbids backing up.

    Raises:
        InfeasibleError: no leg is drivable.
    """
    s, slopes, bends = _sampled(FINE)
    turn = wrapped(goal[2] - start[2])
    room = _STEEPEST - np.abs(turn) / 2
    charts = start[2] + turn / 2 + _OFFSETS * room
    dx, dy, (first, last) = (np.asarray(each) for each in _in_chart(start, goal, charts))
    # Otherwise the end headings are outside the chart, or the leg has no extent.
    able = np.flatnonzero((room > 0) & ((dx if forward_only else np.abs(dx)) > 1e-6 * radius))
    charts, dx, dy, first, last = (each[able, None] for each in (charts, dx, dy, first, last))
    slope = dy / dx * slopes[0] + first * slopes[1] + last * slopes[2]
    square = 1 + slope**2
    bend = (dy / dx * bends[0] + first * bends[1] + last * bends[2]) / dx
    tightness = (bend * radius) ** 2 / square**3  # (radius curvature)^2
    margin = 0.99  # factor on the largest curvature: between samples the curvature may be slightly larger
    drivable = ((tightness <= margin**2) & (square <= 1 + np.tan(_STEEPEST) ** 2)).all(axis=1)
    if not drivable.any():
        raise InfeasibleError(
            f"no {'forward ' if forward_only else ''}leg from {_words(start)} to {_words(goal)} with turns of at least "
            f"{radius:.3g} m: allow more steering, give poses to go by (via), or plan the motion (rnc.optimal.plan)"
        )
    cost = np.abs(dx[:, 0]) * np.trapezoid(np.sqrt(square) * (1 + tightness), s, axis=1)
    return Leg(start, goal, float(charts[np.argmin(np.where(drivable, cost, np.inf)), 0]))


def _in_chart(start: Array, goal: Array, chart: Array) -> tuple[Array, Array, tuple[Array, Array]]:
    """Displacement along and across a chart's axis, and slopes at both ends; batch axes lead."""
    d = goal - start
    c, n = np.cos(chart), np.sin(chart)
    slopes = np.tan(start[..., 2] - chart), np.tan(goal[..., 2] - chart)
    return c * d[..., 0] + n * d[..., 1], c * d[..., 1] - n * d[..., 0], slopes


def continued_back(poses: Float[Array, "n 3"], length: float) -> Float[Array, "m 2"]:
    """Return the points of a path, extended straight back from its first pose (x, y, heading) [m], equally fine."""
    x, y, heading = poses[0]
    steps = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1)
    back = np.linspace(length, 0.0, 2 + int(length / max(float(steps.max(initial=0.0)), 1e-3 * length)))[:-1, None]
    return np.concatenate([[x, y] - back * [np.cos(heading), np.sin(heading)], poses[:, :2]])


def path_distances(points: Float[Array, "n 2"], path: Float[Array, "m 2"]) -> Float[Array, " n"]:
    """Return the distances (n,) of points from a polyline whose segments are much shorter than its bend radii."""
    _, nearest = scipy.spatial.cKDTree(path).query(points)
    # Of each point, the segments before and after its nearest corner: (2, n).
    index = np.clip(nearest + np.array([[-1], [0]]), 0, len(path) - 2)
    begin, along = path[index], path[index + 1] - path[index]
    square = np.maximum(np.vecdot(along, along), 1e-300)
    s = np.clip(np.vecdot(points - begin, along) / square, 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - begin - s[..., None] * along, axis=-1).min(axis=0))


# ------------------------------------------------------------------ steering of a vehicle

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
        of_rates = np.array([-curvature, 0.0, 1.0]) / driven[0]  # effects of rates on the curvature
        if abs(of_rates @ along) > _ROUNDED / length**2:
            self._refuse(f"turns by more than '{self._name}': the curvature of its path changes while it is driven")
        slope = float(of_rates @ rates)
        if not abs(slope) > _ROUNDED * self._largest:
            raise ConfigurationError(f"'{self._name}' does not steer frame '{self._frame}'")
        output = float(here.outputs()[1][self._steering])
        return _Row(output, float(curvature), slope, float(driven[0]), float(rates[0]))

    def _rates(self, state: StateEvaluation) -> Array:
        """Time derivative of forward, sideways and turning speed (3,) per unit rate of the speed output."""
        rates = state.motion
        W_dot = self._rows.jacobian_dot(rates) @ state.R + self._rows.jacobian(rates) @ state.R_dot
        return W_dot[:, self._speed]

    def _refuse(self, why: str) -> NoReturn:
        raise ConfigurationError(f"frame '{self._frame}' cannot drive a path: it {why}")


# ------------------------------------------------------------------ path from pose to pose


class CarPath:
    """Path from pose to pose. The vehicle rests with straight wheels at both ends and at stops in between.

    One leg leads from each pose to the next, forwards or backwards, in a time in proportion to its length.

    Args:
        start: (x, y, heading) of the rear axle's middle [m, m, rad].
        goal: (x, y, heading) of the same point at the end.
        duration: [s].
        wheelbase: distance between rear and front axle [m].
        via: intermediate poses where the vehicle stops, in this order.
        max_steering: largest steering angle of an equivalent front wheel in the middle [rad]. With the wheelbase it
            gives the smallest turning radius.
        forward_only: True forbids backing up.
        geometry: steering geometry, if the outputs are not speed and the angle of a front wheel in the middle.

    Attributes:
        legs: in the order of driving.
        length: distance driven on all legs [m].
        reference: of (signed distance driven, front steering angle), or of the outputs of ``geometry``.
        position: of (x, y) of the rear axle.
        times: (N,) [s]; ``poses``: (N, 3) on the path, headings without jumps.

    Raises:
        InfeasibleError: no leg leads from a pose to the next, or the vehicle cannot steer as tightly.
        ConfigurationError: an argument is out of its range.

    Example:
        >>> path = rnc.planning.CarPath([0.0, 0.0, 0.0], [4.0, 0.0, 0.0], duration=2.0, wheelbase=1.0)
        >>> round(path.length, 6), len(path.legs)  # straight ahead
        (4.0, 1)
        >>> path.reference.at(1.0).position.round(6) + 0.0  # distance and steering angle halfway
        array([2., 0.])
    """

    def __init__(
        self,
        start: ArrayLike,
        goal: ArrayLike,
        duration: Positive,
        wheelbase: Positive,
        *,
        via: Sequence[ArrayLike] = (),
        max_steering: Annotated[float, Gt(0), Lt(np.pi / 2)] = np.pi / 4,
        forward_only: bool = False,
        geometry: SteeringGeometry | None = None,
    ) -> None:
        if not (duration > 0 and wheelbase > 0 and 0 < max_steering < np.pi / 2):
            raise ConfigurationError(
                "a path needs a positive duration and wheelbase and a largest steering angle between 0 and pi/2, "
                f"found {duration:g}, {wheelbase:g} and {max_steering:g}"
            )
        stops = [_pose(start, "start"), *(_pose(each, "via pose") for each in via), _pose(goal, "goal")]
        radius = wheelbase / np.tan(max_steering)
        # Each leg by itself: the car stands between them, so that none depends on the others.
        self.legs = [best_leg(a, b, radius, forward_only) for a, b in pairwise(stops)]
        lengths = np.array([leg.length for leg in self.legs])
        self.length, self.duration = float(lengths.sum()), duration
        shares = np.concatenate([[0.0], np.cumsum(lengths) / self.length]) * duration
        parts: list[tuple[Reference, Reference]] = []
        times, poses = [], []
        driven, heading = 0.0, stops[0][2]
        for leg, (begin, end) in zip(self.legs, pairwise(shares), strict=True):
            local, along, speeds, steering = leg.drive(end - begin, wheelbase, _SAMPLES)
            if geometry is not None:
                steering, ratios = geometry.outputs(np.tan(steering) / wheelbase)
                speeds = speeds * ratios
            # The integral of a spline through the speeds: distance and speed of the reference belong to each other.
            distance = driven + scipy.interpolate.make_interp_spline(local, speeds, k=5).antiderivative()(local)
            along[:, 2] += heading - along[0, 2]  # a pose between legs may have its heading shifted by full turns
            at = begin + local
            parts.append((ViaPoints(at, np.column_stack([distance, steering])), ViaPoints(at, along[:, :2])))
            times.append(at)
            poses.append(along)
            driven, heading = distance[-1], along[-1, 2]
        self.reference: Reference = InTurn([primary for primary, _ in parts])
        self.position: Reference = InTurn([position for _, position in parts])
        self.times, self.poses = np.concatenate(times), np.concatenate(poses)

    def distance(self, points: Float[Array, "n 2"]) -> Float[Array, " n"]:
        """Return the distances (N,) of points (N, 2) from the path and its straight extension behind the start [m]."""
        return path_distances(points, continued_back(self.poses, 3.0))


def _pose(value: ArrayLike, what: str) -> Array:
    pose = np.asarray(value, dtype=float)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise ConfigurationError(f"{what} of a path: expected x, y and heading, found {pose.tolist()}")
    return pose


def _words(pose: Array) -> str:
    return f"({pose[0]:.3g}, {pose[1]:.3g}, {np.rad2deg(pose[2]):.0f} deg)"
