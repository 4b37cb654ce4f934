"""Heading reference that keeps a trailer's axle on the path that the tractor has driven: paper section 4.3."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, hypot, sin, sqrt
from typing import NamedTuple

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import ConfigurationError, SingularityError, place_of
from rnc_pin.model.coordinates import wrapped
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.input_validation import check_positive_settings
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import Task
from rnc_pin.printing import ReprMixin
from rnc_pin.references.reference import ReferencePoint

_KEPT = 2.0  # least length of the recorded path, in lengths of the trailer
_UNKNOWN = np.full(1, np.nan)
_UNKNOWN.flags.writeable = False


class DrivenPath(NamedTuple):
    """State of the reference: recorded path and last heading."""

    path: Float[Array, "n 4"]
    """Tractor's x, y, heading and distance driven, at places one spacing apart, oldest first; straight before them."""
    heading: float
    """Desired heading at the last sample, for continuity [rad]."""


class SlitheringReference(ReprMixin):
    """Heading of a trailer whose axle is on the tractor's driven path, one chord L behind the kingpin.

    The kingpin is at p, the axle at s on the path, whose direction there is t and curvature c. From ``L e = p - s``
    with e = (cos theta, sin theta), and ``e . e = 1``,

        sdot    = e . pdot / e . t                         theta_dot  = n . w / L
        sddot   = (e . b + w . w / L) / e . t              theta_ddot = n . (b - sddot t) / L
        w = pdot - sdot t,      b = pddot - sdot^2 c m,    m across t and n across e, to the left.

    For a kingpin on the tractor's axle that is ``sdot = u cos(theta1 - theta) / cos(psi - theta)``. Place, direction
    and curvature come from a quintic fitted to the positions and headings of the places around. So sensor noise is not
    differentiated. No quantity is differentiated in time, so the reference rests while the tractor rests. A tractor
    that backs up a little stays on the recorded path. If it backs up farther, the part of the path ahead of it is
    deleted. Before the start the path is straight.

    Reads from the measurement: ``x1, v1, v2, A_star, A_star_dot``, and ``q`` for messages.

    Args:
        reduced: model whose vertical outputs include the tractor's position and yaw and the trailer's yaw.
        task: its only vertical output is the trailer's yaw, or the yaw of any frame on the trailer.
        tractor: frame that drives the path, in the middle of an axle that does not steer, x forward.
        axle: frame in the middle of the trailer's axle.
        kingpin: frame at the kingpin, on either body; the tractor frame by default. The position of another frame has
            to be a vertical output too.
        spacing: distance between recorded places [m]; a fiftieth of the trailer's length by default.
        window: length of path on each side of the axle for the fit [m]; five spacings by default. A longer window
            gives a smoother path, but less accurate bends.

    Raises:
        ConfigurationError: an output is missing, the task has another shape, or kingpin and axle are not on one body
            with that yaw.
        SingularityError: the path bends so tightly that the trailer would stand across it or across the tractor.

    Example:
        >>> robot = rnc.Robot.from_urdf("fire_truck.urdf", base="planar")
        >>> axles, joints = ("front_axle", "tractor_axle", "rear_axle"), ["front_steering", "rear_steering"]
        >>> constraints, actuators = [rnc.NoSideSlip(axle) for axle in axles], [rnc.FrameForce("tractor", "x"), *joints]
        >>> inputs = [rnc.FrameSpeed("tractor"), *(rnc.JointPosition(joint) for joint in joints)]
        >>> reduced = rnc.NonholonomicSystem(robot, constraints, actuators).reduce(
        ...     inputs, [rnc.FramePosition("tractor"), rnc.FrameYaw("tractor"), rnc.FrameYaw("trailer")])
        >>> task = rnc.Task.of(reduced, ["tractor_speed_x", "front_steering"], ["rear_steering"], ["trailer_yaw"])
        >>> reference = rnc.control.SlitheringReference(reduced, task, "tractor", "rear_axle")
        >>> measurement = reduced.at(robot.configuration(), [1.0, 0.0, 0.0]).measure()
        >>> point, state = reference.step(measurement, np.zeros(3), reference.initial_state(measurement))
        >>> point.position.round(6) + 0.0, point.velocity.round(6) + 0.0  # the path is straight
        (array([0.]), array([0.]))
    """

    size = 1

    def __init__(
        self,
        reduced: ReducedModel,
        task: Task,
        tractor: str,
        axle: str,
        kingpin: str | None = None,
        spacing: float | None = None,
        window: float | None = None,
    ) -> None:
        if len(task.vertical) != 1 or not task.vertical_coordinates.angular[0]:
            raise ConfigurationError(
                "a trailer slithers by one vertical output, its yaw; the task has "
                f"{', '.join(task.vertical_names) or 'none'}"
            )
        names = reduced.vertical.names
        self._output = int(task.vertical[0])
        self._tractor = _places(names, [f"{tractor}_x", f"{tractor}_y", f"{tractor}_yaw"])
        self._kingpin = self._tractor[:2] if kingpin is None else _places(names, [f"{kingpin}_x", f"{kingpin}_y"])
        self.length, self._offset = _drawbar(reduced, self._output, tractor, kingpin or tractor, axle)
        self.spacing = self.length / 50 if spacing is None else spacing
        places = 5  # recorded ones on each side for the fit of the path
        self.window = places * self.spacing if window is None else window
        check_positive_settings(spacing=self.spacing, window=self.window)
        self._names = (*task.vertical_names, names[self._tractor[2]])

    def initial_state(self, measurement: Measurement) -> DrivenPath:
        """Return a straight path behind the tractor, along its heading.

        Args:
            measurement: first measurement.
        """
        x, y, heading = (float(measurement.x1[i]) for i in self._tractor)
        back = _KEPT * self.length
        behind = [x - back * cos(heading), y - back * sin(heading), heading, -back]
        yaw = float(measurement.x1[self._output])
        straight = yaw + wrapped(heading + self._offset - yaw)
        return DrivenPath(np.array([behind, [x, y, heading, 0.0]]), straight)

    def step(
        self, measurement: Measurement, v2_dot: Float[Array, " r"], state: DrivenPath
    ) -> tuple[ReferencePoint, DrivenPath]:
        """Compute the reference and the new state, once per sample.

        Args:
            measurement: of outputs and kinematics.
            v2_dot: accelerations of the reducing outputs; zero if unknown.
            state: the recorded path.

        Returns:
            The trailer's heading with two derivatives (its jerk is NaN: unknown), and the path with the present place.
        """
        x1, rates, last = measurement.x1, measurement.v1, state.heading
        x, y, heading = (float(x1[i]) for i in self._tractor)
        path = self._recorded(state.path, x, y, heading)
        k0, k1 = self._kingpin
        px, py = float(x1[k0]), float(x1[k1])
        older, (sx, sy, psi, curvature) = self._behind(path, px, py, x, y, heading)
        theta = atan2(py - sy, px - sx)
        rows = measurement.A_star[self._kingpin] @ v2_dot + measurement.A_star_dot[self._kingpin] @ measurement.v2
        vx, vy, ax, ay = float(rates[k0]), float(rates[k1]), float(rows[0]), float(rows[1])
        ex, ey, tx, ty = cos(theta), sin(theta), cos(psi), sin(psi)
        along, L = ex * tx + ey * ty, self.length
        turn = wrapped(theta + self._offset - last)
        largest_turn = 0.7  # of the desired heading in a sample without a jump [rad]
        least_cosine = 0.2  # between trailer and path, or trailer and tractor, at which slithering is possible
        if min(along, cos(heading - theta)) < least_cosine or abs(turn) > largest_turn:
            raise SingularityError(
                "the driven path bends too tightly for the trailer to slither: it would stand across it or the tractor",
                q=np.zeros(0) if measurement.q is None else np.array(measurement.q),
                condition=1 / max(abs(along), 1e-300),
                rows=self._names,
            )
        s_dot = (ex * vx + ey * vy) / along
        wx, wy = vx - s_dot * tx, vy - s_dot * ty
        # Acceleration difference of the chord's ends without s'' t: centripetal at the path.
        bx, by = ax + s_dot**2 * curvature * ty, ay - s_dot**2 * curvature * tx
        s_ddot = (ex * bx + ey * by + (wx * wx + wy * wy) / L) / along
        rate = (ex * wy - ey * wx) / L
        acceleration = (ex * (by - s_ddot * ty) - ey * (bx - s_ddot * tx)) / L
        desired = last + turn
        point = ReferencePoint(np.array([desired]), np.array([rate]), np.array([acceleration]), _UNKNOWN)
        # Delete places far behind the axle: they are not needed, not even for backing up.
        oldest = path[-1, 3] - _KEPT * L
        if older > 1 and path[1, 3] < oldest:
            first = int(np.searchsorted(path[:, 3], min(path[older, 3] - self.window, oldest)))
            path = path[max(first - 1, 0) :]
        return point, DrivenPath(path, desired)

    def _recorded(self, path: Array, x: float, y: float, heading: float) -> Array:
        """Path with the present place, if it is one spacing beyond the last one, and without places ahead of it."""
        while True:
            lx, ly, psi, driven = path[-1].tolist()
            ahead = (x - lx) * cos(psi) + (y - ly) * sin(psi)
            if ahead >= self.spacing:
                return np.vstack([path, (x, y, heading, driven + hypot(x - lx, y - ly))])
            # A tractor that backs up by less than a spacing keeps its path: noise does not delete places.
            if ahead > -self.spacing or len(path) == 1:
                return path
            path = path[:-1]

    def _behind(self, path: Array, px: float, py: float, x: float, y: float, heading: float) -> tuple[int, PathPoint]:
        """Point one chord length behind the kingpin, and the index of the recorded place before it."""
        L = self.length
        dx, dy = path[:, 0] - px, path[:, 1] - py
        far = np.flatnonzero(dx * dx + dy * dy >= L * L)
        if not len(far):
            # Straight extension behind the oldest place: |p - o + tau t| = L.
            ox, oy, psi, _ = path[0].tolist()
            along = (px - ox) * cos(psi) + (py - oy) * sin(psi)
            tau = sqrt(along**2 + L * L - (px - ox) ** 2 - (py - oy) ** 2) - along
            return 0, PathPoint(ox - tau * cos(psi), oy - tau * sin(psi), psi, 0.0)
        older = int(far[-1])
        begin = path[older].tolist()
        end = path[older + 1].tolist() if older + 1 < len(path) else (x, y, heading)
        near = chord_end_between(begin, end, px, py, L)
        return older, chord_end_fitted(path, older, near, px, py, L, self.window)


def _places(names: tuple[str, ...], wanted: list[str]) -> Array:
    return np.array([place_of(name, names, "a slithering trailer needs the vertical output") for name in wanted])


def _drawbar(reduced: ReducedModel, output: int, tractor: str, kingpin: str, axle: str) -> tuple[float, float]:
    """Distance from kingpin to axle [m], and trailer's yaw minus the direction from axle to kingpin [rad]."""
    robot, generator = reduced.robot, np.random.default_rng(0)
    frames, found = [robot.frame_id(frame) for frame in (tractor, kingpin, axle)], []
    # Three configurations: a length that changes with the joints is no drawbar.
    for q in (robot.configuration(), *(robot.random_configuration(generator, spread=0.5) for _ in range(2))):
        here = reduced.at(q)
        (turned, origin), (_, front), (_, rear) = (here.position.placement(frame) for frame in frames)
        bar = (front - rear)[:2]
        yaw = here.outputs()[0][output] - atan2(*bar[::-1])
        found.append((hypot(*bar), wrapped(yaw), *turned.T @ (front - origin)))
    (length, offset, *place), change = found[0], np.ptp(found, axis=0)
    if change[:2].max() > 1e-9 or length < 1e-6:
        raise ConfigurationError(
            f"'{kingpin}' and '{axle}' are not two fixed places on a body with {reduced.vertical.names[output]}: "
            "name the kingpin and the middle of the trailer's axle"
        )
    if change[2:].max() > 1e-9 or hypot(*place[:2]) >= length:
        raise ConfigurationError(
            f"the kingpin '{kingpin}' has to be a fixed place on the tractor, nearer to '{tractor}' than to '{axle}'"
        )
    return length, offset


# ---------------------------------------------------------------------- point of the driven path


_CLOSE = 1e-13  # last Newton step, relative to a spacing or to the window


class PathPoint(NamedTuple):
    """Place on a path."""

    x: float
    y: float
    heading: float
    """Direction of the path [rad]."""
    curvature: float
    """[1/m], to the left."""


def chord_end_between(
    begin: list[float], end: list[float] | tuple[float, float, float], px: float, py: float, L: float
) -> PathPoint:
    """Return the point of a cubic Hermite curve between two places (x, y, heading) at distance L from (px, py).

    Args:
        begin: first place [m, m, rad].
        end: second place [m, m, rad].
        px: x of the other end of the chord [m].
        py: y of the other end of the chord [m].
        L: length of the chord [m].
    """
    x0, y0, dx, dy = begin[0], begin[1], end[0] - begin[0], end[1] - begin[1]
    h = hypot(dx, dy)
    ux, uy, vx, vy = h * cos(begin[2]), h * sin(begin[2]), h * cos(end[2]), h * sin(end[2])
    x, y = [x0, ux, 3 * dx - 2 * ux - vx, ux + vx - 2 * dx], [y0, uy, 3 * dy - 2 * uy - vy, uy + vy - 2 * dy]
    # The point is between both places: beyond them the cubic is of no use.
    return _chord_end(x, y, px, py, L, 0.0)[0]


def _chord_end(
    x: Sequence[float], y: Sequence[float], px: float, py: float, L: float, first: float
) -> tuple[PathPoint, bool]:
    """Point at distance L from (px, py) on a curve of polynomials x(s) and y(s), by Newton's method from s = 0.

    Also return False if the method had to stop at the ends of ``first <= s <= 1``, or where the chord is across the
    path; the caller raises the error then.
    """
    s, inside = 0.0, True
    for _ in range(12):  # a bound only: Newton's method is quadratic near the solution
        (here_x, x_s, x_ss), (here_y, y_s, y_ss) = _derivatives(x, s), _derivatives(y, s)
        rx, ry = px - here_x, py - here_y
        slope = rx * x_s + ry * y_s
        if slope <= 0.0:
            inside = False
            break
        step = (rx * rx + ry * ry - L * L) / (2 * slope)
        moved = min(max(s + step, first), 1.0)
        inside = inside and moved == s + step
        if abs(moved - s) < _CLOSE:
            break
        s = moved
    return PathPoint(here_x, here_y, atan2(y_s, x_s), (x_s * y_ss - y_s * x_ss) / hypot(x_s, y_s) ** 3), inside


def chord_end_fitted(
    path: Float[Array, "n 4"], older: int, near: PathPoint, px: float, py: float, L: float, window: float
) -> PathPoint:
    """Return the point at distance L from (px, py) on the quintic fitted to the places around it.

    In axes at ``near`` the path is y(x). The places give values of y; their headings give values of its slope. The
    weights are ``(1 - u^2)^2``, with u the distance along the path over the window, so no place enters or leaves with a
    jump. A heading error counts like a position error at distance L. The fit averages the noise of the places. A curve
    through only two places would divide the noise by the square of their distance.

    Args:
        path: x, y, heading and distance driven, oldest first.
        older: index of the place before ``near``.
        near: point at distance L from (px, py) on a curve through the two places around it.
        px, py: the other end of the chord.
        L: length of the chord [m].
        window: distance along the path beyond which places do not count [m].

    Returns:
        The point on the fitted curve; ``near`` itself if too few places are around it, or if it is not between two of
        them.
    """
    x0, y0, axis, _ = near
    driven = path[:, 3]
    middle = driven[older] + hypot(x0 - path[older, 0], y0 - path[older, 1])
    first, last = np.searchsorted(driven, [middle - window, middle + window])
    # The window has to hold the places on both sides of the point.
    if first > older or last < older + 2:
        return near
    around = path[first:last]
    turned = wrapped(around[:, 2] - axis)
    steepest = 1.0  # heading against the middle of the window for which y(x) describes a path [rad]
    even = np.abs(turned) < steepest
    fewest = 4  # places, each with a heading, for a curve of this degree
    if np.count_nonzero(even) < fewest:
        return near
    around, turned = around[even], turned[even]
    c, s = cos(axis), sin(axis)
    dx, dy = around[:, 0] - x0, around[:, 1] - y0
    u, values = (c * dx + s * dy) / window, (c * dy - s * dx) / window
    weight = 1.0 - ((around[:, 3] - middle) / window) ** 2
    degree = 5  # of the polynomial y(x)
    powers = u[:, None] ** np.arange(degree + 1)
    slopes = np.zeros_like(powers)
    slopes[:, 1:] = powers[:, :-1] * np.arange(1, degree + 1)
    # d(heading) = cos^2(heading) d(slope).
    lever = weight * np.cos(turned) ** 2 * (L / window)
    rows = np.concatenate([weight[:, None] * powers, lever[:, None] * slopes])
    right = np.concatenate([weight * values, lever * np.tan(turned)])
    curve = np.linalg.lstsq(rows, right, rcond=None)[0]
    ahead, left = (c * (px - x0) + s * (py - y0)) / window, (c * (py - y0) - s * (px - x0)) / window
    (u_end, y_end, heading, curvature), inside = _chord_end([0.0, 1.0], curve.tolist(), ahead, left, L / window, -1.0)
    if not inside:
        return near
    x, y = u_end * window, y_end * window
    return PathPoint(x0 + c * x - s * y, y0 + s * x + c * y, axis + heading, curvature / window)


def _derivatives(curve: Sequence[float], u: float) -> tuple[float, float, float]:
    """Polynomial and its first two derivatives, by Horner's scheme."""
    y = slope = bend = 0.0
    for coefficient in reversed(curve):
        bend = bend * u + 2.0 * slope
        slope = slope * u + y
        y = y * u + coefficient
    return y, slope, bend
