"""Lower bounds of the distances of pairs along segments of a motion.

The motion of a pair is seen from its first body, or from the obstacle. Only the joints between both bodies cause it.
``V`` bounds the path of any point of the other body: the sum of the translations and of the rotations times levers.
``A = 2 W V`` bounds the second derivative along the segment, with ``W`` the sum of the rotations: the derivative of the
velocity that joint j causes, by joint i, is the axis of the one nearer to the first body times the velocity of the
other. Two bounds follow:

* The distance changes at most by the path: ``(d0 + d1 - L) / 2``, where L is V, or the largest displacement between
  both ends plus ``A / 4``. With V it holds for joints that move at any rate.
* The gap along a fixed direction is at least the gap of points on straight lines, less ``A / 8``. So it is not smaller
  than its linear interpolation less ``A / 8``. The directions are the normals at both ends. Turns about such a
  direction do not change the gap: ``A``, and the part of ``V`` by rotations, count with the sine of the angle between
  the direction and the axes. So the height of a level arm over a base is certain, however the arm turns.

The segments of a sampled motion say how far joints and obstacles move along each, and how far from its straight line.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, cached_property
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Array, Bool, Float, Int
from rnc_pin.collision.collision_distances import CollisionDistances, PlacedBodies
from rnc_pin.collision.shapes import Obstacle, ObstacleMotion
from rnc_pin.errors import ModelError
from rnc_pin.model.coordinates import ConfigurationManifold

_HELICAL = ("JointModelH",)


_Part = tuple[int, slice, float, float]
"""Joint, its velocity components, and two factors: their norm times these is its rotation and its translation."""


class JointSteps:
    """Rotations and translations of the joints of a model along steps.

    A joint moves the bodies that it carries by a translation of its frame and a rotation about the origin of this
    frame. Both are bounded by the components of the step: exactly for joints with constant axes, and by the sum over
    the elementary rotations for universal, ZYX, ellipsoid and composite joints.

    Args:
        model: model of the robot.
        q: configurations (N, nq) of the motion; they bound the offsets within composite joints.

    Raises:
        ModelError: the model has a joint of an unknown kind.
    """

    def __init__(self, model: pin.Model, q: Float[Array, "N nq"]) -> None:
        self._count = model.njoints
        joints = enumerate(list(model.joints)[1:], start=1)
        self._parts = [part for index, joint in joints for part in _parts(index, joint, 0.0, np.abs(q))]

    def of(self, steps: Float[Array, "k nv"]) -> tuple[Float[Array, "k njoints"], Float[Array, "k njoints"]]:
        """Rotations [rad] and translations [m] of the joints along steps (k, nv); the universe has none.

        Args:
            steps: tangent vectors between configurations.
        """
        angular, linear = (np.zeros((len(steps), self._count)) for _ in range(2))
        for joint, columns, turning, moving in self._parts:
            size = np.linalg.norm(steps[:, columns], axis=1)
            angular[:, joint] += turning * size
            linear[:, joint] += moving * size
        return angular, linear


_TURNS, _SLIDES = (1.0, 0.0), (0.0, 1.0)
_GROUPS = {
    "JointModelFreeFlyer": ((3, *_SLIDES), (3, *_TURNS)),
    "JointModelPlanar": ((2, *_SLIDES), (1, *_TURNS)),
    "JointModelTranslation": ((3, *_SLIDES),),
    "JointModelSpherical": ((3, *_TURNS),),
    "JointModelSphericalZYX": ((1, *_TURNS),) * 3,
    "JointModelUniversal": ((1, *_TURNS),) * 2,
}
"""Components of a joint's velocity whose norms count: their number, and the rotation and translation by a unit norm."""


def _parts(index: int, joint: pin.JointModel, lever: float, largest: Float[Array, "N nq"]) -> list[_Part]:
    """Parts of a joint whose origin is at most a lever [m] away from the origin of joint ``index``."""
    kind, size, start = joint.shortname(), joint.nv, joint.idx_v
    prismatic, revolute = "JointModelP", "JointModelR"  # bounded and unbounded, along an axis of the frame or not
    if kind == "JointModelComposite":
        return _composite_parts(index, _extracted(joint), lever, largest)
    if kind in _GROUPS:
        groups = _GROUPS[kind]
    elif kind.startswith(prismatic):
        groups = ((size, *_SLIDES),)
    elif kind.startswith(_HELICAL):
        groups = ((size, 1.0, abs(float(_extracted(joint).pitch))),)
    elif kind.startswith(revolute) or kind == "JointModelEllipsoid":
        groups = ((1, 1.0, _reach(joint, largest)),) * size
    else:
        raise ModelError(f"joint {index} is a {kind}: its motion between two configurations is not known")
    ends = np.cumsum([count for count, *_ in groups]).tolist()
    return [
        (index, slice(start + end - count, start + end), angular, linear + angular * lever)
        for (count, angular, linear), end in zip(groups, ends, strict=True)
    ]


def _composite_parts(
    index: int, joint: pin.JointModelComposite, lever: float, largest: Float[Array, "N nq"]
) -> list[_Part]:
    """Parts of the joints in a composite joint; the origin of the last one is the origin of the whole joint."""
    found: list[_Part] = []
    for inner, placement in reversed(list(zip(joint.joints, joint.jointPlacements, strict=True))):
        found += _parts(index, inner, lever, largest)
        # Inner joints nearer to the root turn everything after them: their levers grow by each link that follows.
        lever += float(np.linalg.norm(placement.translation)) + _reach(inner, largest)
    return found


def _reach(joint: pin.JointModel, largest: Float[Array, "N nq"]) -> float:
    """Largest translation of a joint in a motion [m]."""
    kind, size = joint.shortname(), {"JointModelFreeFlyer": 3, "JointModelPlanar": 2}.get(joint.shortname(), joint.nq)
    if kind == "JointModelEllipsoid":
        return float(max(getattr(_extracted(joint), f"radius_{axis}") for axis in "xyz"))
    if kind.startswith(("JointModelR", "JointModelSpherical", "JointModelUniversal")):
        return 0.0
    moved = float(np.linalg.norm(largest[:, joint.idx_q : joint.idx_q + size], axis=1).max(initial=0.0))
    return moved * abs(float(_extracted(joint).pitch)) if kind.startswith(_HELICAL) else moved


def _extracted(joint: pin.JointModel) -> pin.JointModel:
    """Joint of its own type; a joint in a list of joints is of the general type."""
    return joint.extract() if hasattr(joint, "extract") else joint


class Segments(NamedTuple):
    """Displacements along k segments at constant rates, and largest deviations of the motion from them.

    Columns are the joints of the model, then the obstacles that move.
    """

    angular: Float[Array, "k j"]
    linear: Float[Array, "k j"]
    angular_deviation: Float[Array, "k j"]
    linear_deviation: Float[Array, "k j"]


class SampledMotion:
    """Motion between samples: each joint moves at constant rate from sample to sample, obstacles move as they do.

    Places in the motion are numbers: 3.25 is a quarter of the way from sample 3 to sample 4.

    Args:
        model: model of the robot.
        time: times (N,) [s], not decreasing.
        q: configurations (N, nq).
        obstacles: obstacles that move.
    """

    def __init__(
        self, model: pin.Model, time: Float[Array, " N"], q: Float[Array, "N nq"], obstacles: Sequence[Obstacle]
    ) -> None:
        self._time, self._q = time, q
        self._steps, self._manifold = JointSteps(model, q), ConfigurationManifold(model)
        self._tracks = [_Track(each.motion) for each in obstacles if each.motion is not None]

    def times(self, places: Float[Array, "*k"]) -> Float[Array, "*k"]:
        """Times [s] at places.

        Args:
            places: places in the motion.
        """
        return np.interp(places, np.arange(len(self._time)), self._time)

    def configurations(self, places: Float[Array, " k"]) -> Float[Array, "k nq"]:
        """Configurations at places, on the geodesics between samples.

        Args:
            places: places in the motion.
        """
        before = places.astype(int)
        found = self._q[before]
        between = np.flatnonzero(places > before)
        parts = (places - before)[between]
        found[between] = self._manifold.interpolate(found[between], self._q[before[between] + 1], parts)
        return found

    def halfway(self, places: Float[Array, "k 2"]) -> Float[Array, " k"]:
        """Places about halfway along segments, samples if there are some; NaN for a segment that is not halved.

        Args:
            places: begin and end of each segment.
        """
        length, middle = places[:, 1] - places[:, 0], places.mean(axis=1)
        shortest = 2.0**-20  # of the time between two samples: an obstacle jumps, or two bodies touch with equal speed
        return np.where(length > 1.0, np.floor(middle), np.where(length > shortest, middle, np.nan))

    def segments(self, places: Float[Array, "k 2"]) -> Segments:
        """Displacements and deviations of the segments between these places.

        Args:
            places: begin and end of each segment.
        """
        starts, ends = (self.configurations(each) for each in places.T)
        angular, linear = self._steps.of(self._manifold.difference(starts, ends))
        angular_deviation, linear_deviation = np.zeros(angular.shape), np.zeros(linear.shape)
        rows, errors = self._deviations(places, starts, ends)
        turned, moved = self._steps.of(errors)
        np.maximum.at(angular_deviation, rows, turned)
        np.maximum.at(linear_deviation, rows, moved)
        # Geodesics of SE(2) and SE(3) bend: between two samples they deviate more than at both, to second order.
        linear_deviation += angular * linear_deviation + linear * angular_deviation
        angular_deviation += angular * angular_deviation
        found = Segments(angular, linear, angular_deviation, linear_deviation)
        return self._with_tracks(found, self.times(places))

    def paths(self, places: Float[Array, "k 2"]) -> Segments:
        """Rotations and translations of the joints along segments, summed over all samples in them.

        They bound the paths of points, at whatever rates the joints move. Obstacles are as in ``segments``.

        Args:
            places: begin and end of each segment.
        """
        # The last place has no sample after it: it is the end of the step before.
        before = np.minimum(places.astype(int), max(len(self._time) - 2, 0))
        after, part = np.minimum(before + 1, len(self._time) - 1), (places - before)[:, :, None]
        at = [total[before] + part * (total[after] - total[before]) for total in self._travelled]
        # Sums of norms from the first sample: a difference gives the path of any segment at once.
        angular, linear = (each[:, 1] - each[:, 0] for each in at)
        found = Segments(angular, linear, np.zeros(angular.shape), np.zeros(linear.shape))
        return self._with_tracks(found, self.times(places))

    @cached_property
    def _travelled(self) -> tuple[Float[Array, "N j"], Float[Array, "N j"]]:
        """Rotations [rad] and translations [m] of the joints from the first sample to each one."""
        steps = self._manifold.difference(self._q[:-1], self._q[1:])
        angular, linear = self._steps.of(np.concatenate([np.zeros((1, self._manifold.nv)), steps]))
        return angular.cumsum(axis=0), linear.cumsum(axis=0)

    def _with_tracks(self, found: Segments, times: Float[Array, "k 2"]) -> Segments:
        """Add the columns of the obstacles that move."""
        for track in self._tracks:
            found = Segments(*map(np.column_stack, zip(found, track.segments(times), strict=True)))
        return found

    def _deviations(
        self, places: Float[Array, "k 2"], starts: Float[Array, "k nq"], ends: Float[Array, "k nq"]
    ) -> tuple[Int[Array, " n"], Float[Array, "n nv"]]:
        """Differences of the samples from constant rates, and the segment of each."""
        first = np.floor(places[:, 0]).astype(int) + 1
        counts = np.maximum(np.ceil(places[:, 1]).astype(int) - first, 0)
        rows = np.repeat(np.arange(len(places)), counts)
        samples = np.arange(len(rows)) + np.repeat(first - np.cumsum(counts) + counts, counts)
        begin, end = self.times(places)[rows].T
        moving = end > begin
        parts = np.where(moving, (self._time[samples] - begin) / np.where(moving, end - begin, 1.0), 0.5)
        # Where no time passes between both ends, the middle of the segment stands for every sample.
        steady = self._manifold.interpolate(starts[rows], ends[rows], parts)
        return rows, self._manifold.difference(steady, self._q[samples])


class _Track:
    """Motion of an obstacle, evaluated once at each time."""

    def __init__(self, motion: ObstacleMotion) -> None:
        @cache  # segments meet at their ends: a user's motion is asked once for each time
        def pose_and_rate(t: float) -> Float[Array, "2 4"]:
            point = motion.at(t)
            return np.array([point.position, point.velocity], dtype=float)

        self._at = pose_and_rate

    def segments(self, times: Float[Array, "k 2"]) -> tuple[Array, Array, Array, Array]:
        """Rotations, translations and their deviations, (k,) each, along segments of constant velocity and yaw rate."""
        longest = 0.05  # [s] over which an obstacle is judged from its poses and velocities at both ends
        counts = np.maximum(np.ceil((times[:, 1] - times[:, 0]) / longest), 1.0).astype(int)
        rows, first = np.repeat(np.arange(len(times)), counts), np.cumsum(counts) - counts
        number = np.arange(len(rows)) - first[rows]  # of each piece in its segment
        start, end = times[rows].T
        parts = number / counts[rows], (number + 1) / counts[rows]
        moments = [start + parts[0] * (end - start), np.where(parts[1] < 1.0, start + parts[1] * (end - start), end)]
        found = np.array([[self._at(t) for t in each.tolist()] for each in moments]).reshape(2, -1, 2, 4)
        (poses, rates), (next_poses, next_rates) = found.swapaxes(1, 2)
        step, slope = ((end - start) / counts[rows])[:, None], next_poses - poses
        cubic = 0.25  # a cubic deviates from its chord by 4/27 of the differences of its slopes times the duration
        bent = cubic * (np.abs(rates * step - slope) + np.abs(next_rates * step - slope))
        origin, last = poses[first], next_poses[first + counts - 1]
        away = np.abs(next_poses - origin[rows] - parts[1][:, None] * (last - origin)[rows])
        deviation = np.zeros((2, len(times), 4))
        np.maximum.at(deviation[0], rows, bent)
        np.maximum.at(deviation[1], rows, away)
        return (*_sizes(last - origin), *_sizes(deviation.sum(axis=0)))


def _sizes(steps: Float[Array, "k 4"]) -> tuple[Array, Array]:
    """Rotations [rad] and translations [m] of steps of x, y, z and yaw."""
    return np.abs(steps[:, 3]), np.linalg.norm(steps[:, :3], axis=1)


# ---------------------------------------------------------------------- pairs


_LARGEST = 50.0  # exponent; the bound is of no use far below


def support(shape: coal.CollisionGeometry, directions: Float[Array, "k 3"]) -> Float[Array, " k"]:
    """Largest value of ``direction . x`` over the points x of a convex shape [m].

    The gap of two convex bodies along any unit direction is a lower bound of their signed distance: the gap is minus
    the supports of the first body along the direction and of the second body against it.

    Args:
        shape: box, sphere, cylinder, capsule, cone, ellipsoid, hull or half space.
        directions: unit vectors in the frame of the shape. A half space is bounded along its normal alone.

    Raises:
        ModelError: the shape is not convex.
    """
    x, y, z = directions.T
    # coal blows a shape up by this radius: it adds to every direction.
    swept = shape.getSweptSphereRadius()
    rounding = 1e-9  # of a unit vector: a half space has a bound along its normal alone
    match shape:
        case coal.Box():
            found = np.abs(directions) @ np.ravel(shape.halfSide)
        case coal.Sphere():
            found = np.full(len(directions), shape.radius)
        case coal.Capsule():
            found = shape.halfLength * np.abs(z) + shape.radius
        case coal.Cylinder():
            found = shape.halfLength * np.abs(z) + shape.radius * np.hypot(x, y)
        case coal.Cone():
            found = np.maximum(shape.halfLength * z, shape.radius * np.hypot(x, y) - shape.halfLength * z)
        case coal.Ellipsoid():
            found = np.linalg.norm(directions * np.ravel(shape.radii), axis=1)
        case coal.ConvexBase():
            found = (directions @ np.array(shape.points()).T).max(axis=1)
        case coal.Halfspace():
            normal = np.ravel(shape.n)
            found = np.where(np.abs(directions - normal).max(axis=1) < rounding, shape.d, np.inf)
        case _:
            raise ModelError(f"a {type(shape).__name__} has no support function")
    return np.asarray(found + swept)


class PairEnds(NamedTuple):
    """Pairs along segments: the numbers of both places, and distance and normal (k, 4) of the pair at both.

    Normals are NaN where the distance is a lower bound.
    """

    start: Int[Array, " k"]
    end: Int[Array, " k"]
    pair: Int[Array, " k"]
    at_start: Float[Array, "k 4"]
    at_end: Float[Array, "k 4"]

    def chosen(self, which: Array | slice) -> PairEnds:
        """Some of the pairs.

        Args:
            which: indices or mask.
        """
        return PairEnds(*(each[which] for each in self))


class PairBounds:
    """Lower bounds of distances along segments.

    Args:
        distances: pairs of a robot and its obstacles.
    """

    def __init__(self, distances: CollisionDistances) -> None:
        model, links = distances.robot.model, distances.link_shapes
        moving = [k for k, each in enumerate(distances.obstacles) if each.motion is not None]
        columns = {links + k: model.njoints + place for place, k in enumerate(moving)}
        carried = np.zeros((len(distances.carriers), model.njoints + len(moving)), dtype=bool)
        for shape, joint in enumerate(distances.carriers):
            carried[shape, list(model.supports[joint])[1:]] = True
            if shape in columns:
                carried[shape, columns[shape]] = True
        spinning = distances.spinning
        # A wheel's own spin does not move its outline: its fast turns must not lower the bounds.
        carried[spinning.shapes, np.array(distances.carriers)[spinning.shapes]] = False
        first, second = distances.shape_pairs
        # The other body is the smaller one: its radius is the lever of rotations. Obstacles are seen from.
        swap = (second >= links) | (distances.radii[first] < distances.radii[second])
        self._from, self._other = np.where(swap, second, first), np.where(swap, first, second)
        self._sign = np.where(swap, -1.0, 1.0)  # of normals, which point from the first to the second body
        # A joint that carries both bodies moves them together, and one that carries none moves neither.
        self._between: Bool[Array, "k j"] = carried[first] ^ carried[second]
        # Both bounds and measured distances belong to turned shapes, each within a wobble of an exact one.
        self._wobble: Float[Array, " k"] = 4.0 * spinning.wobble[distances.shape_pairs].sum(axis=0)
        self._radii, self._shapes, self._links = distances.radii, distances.shapes, links
        self._moving = np.array([columns.get(shape, 0) for shape in second.tolist()])  # the column of an obstacle
        self._joints = model.njoints

    def coarse(self, segments: Segments, placed: PlacedBodies) -> Float[Array, "s k"]:
        """Largest decrease of each pair's mean distance along each segment, cheap and far from sharp.

        Segment k starts at place k.

        Args:
            segments: displacements along the segments (s,).
            placed: poses of all bodies at places.
        """
        middles, joints = placed.middles, placed.joints
        rows, robot = slice(0, len(segments.angular)), slice(1, self._joints)
        centers = middles[rows, : self._links]
        # One sphere around all links serves every pair: the bound needs no loop over pairs.
        center = centers.mean(axis=1, keepdims=True)
        far = (np.linalg.norm(centers - center, axis=2) + self._radii[: self._links]).max(axis=1)[:, None]
        levers = far + np.linalg.norm(joints[rows] - center, axis=2)
        levers[:, robot] = levers[:, robot].max(axis=1, initial=0.0, keepdims=True)
        found = np.empty((len(levers), len(self._from)))
        for column in np.unique(self._moving).tolist():
            used = np.arange(levers.shape[1]) < self._joints
            used[column] = True
            path, _, error = _paths(Segments(*(each * used for each in segments)), levers)
            found[:, self._moving == column] = (0.5 * path + error)[:, None]
        return found

    def along(
        self,
        ends: PairEnds,
        placed: PlacedBodies,
        rows: Int[Array, " k"],
        paths: Segments,
        segments: Segments | None = None,
    ) -> Float[Array, " k"]:
        """Lower bounds (k,) of distances [m].

        Args:
            ends: pairs and their segments.
            placed: poses at all places.
            rows: the row of ``paths`` and ``segments`` of each pair.
            paths: lengths of paths along some segments: they hold at whatever rates the joints move.
            segments: displacements along the same segments; without them the bound follows from the path alone, which
                is cheap.
        """
        found = np.empty(len(rows))
        chunk = 20_000  # entries at a time: bounds memory
        for first in range(0, len(rows), chunk):
            part = slice(first, first + chunk)
            here, between = ends.chosen(part), self._between[ends.pair[part]]
            own = [Segments(*(each[rows[part]] * between for each in some)) for some in (paths, segments) if some]
            found[part] = self._along(here, placed, *own) - self._wobble[here.pair]
        return found

    def _along(
        self, ends: PairEnds, placed: PlacedBodies, paths: Segments, segments: Segments | None = None
    ) -> Float[Array, " k"]:
        other = self._other[ends.pair]
        arms = placed.joints[ends.start] - placed.middles[ends.start, other][:, None]
        levers = np.sqrt(np.vecdot(arms, arms)) + self._radii[other][:, None]
        before, after = ends.at_start[:, 0], ends.at_end[:, 0]
        path, turning, error = _paths(paths, levers)
        found = 0.5 * (before + after - path) - error
        if segments is None:
            return found
        # Beyond the distance that counts, pairs have a bound and no normal: only the bound by the path holds for them.
        exact = np.flatnonzero(np.isfinite(ends.at_start[:, 1]) & np.isfinite(ends.at_end[:, 1]))
        some = ends.chosen(exact)
        gaps, sines = self._gaps_at_ends(some, placed), _sines(some, placed)
        # Translations move a point by their full length in any direction; turns about the normal do not close the gap.
        tilt = _tilt(sines, paths.angular[exact], turning[exact])
        moved = paths.linear[exact].sum(axis=1) * np.exp(np.minimum(turning[exact], _LARGEST))
        along = 0.5 * (gaps.sum(axis=1).max(axis=0) - moved - tilt * (path[exact] - moved)) - error[exact]
        found[exact] = np.maximum(found[exact], along)
        path, turning, error = _paths(segments, levers)
        curved = 2.0 * turning * path  # bound of the second derivative
        longest = np.minimum(path, self._chords(ends, placed) + 0.25 * curved)
        steady = 0.5 * (before + after - longest)
        # Each normal gives a gap that is linear in time, less a curvature; the better one of both counts at each time.
        straight = np.minimum(np.minimum(before, after)[exact], _smallest_maximum(*gaps[0], *gaps[1]))
        along = straight - 0.125 * curved[exact] * _tilt(sines, segments.angular[exact], turning[exact])
        steady[exact] = np.maximum(steady[exact], along)
        return np.maximum(found, steady - error)

    def _chords(self, ends: PairEnds, placed: PlacedBodies) -> Float[Array, " k"]:
        """Largest displacement of a point of the other body between both ends, seen from the first one [m]."""
        one, other = self._from[ends.pair], self._other[ends.pair]
        relative, centers = [], []
        for place in (ends.start, ends.end):
            world = placed.still[place, one].swapaxes(1, 2)
            relative.append(world @ placed.still[place, other])
            centers.append(np.matvec(world, placed.middles[place, other] - placed.origins[place, one]))
        # A chord of a rotation by a is 2 sin(a/2) times the lever, and the Frobenius norm has a root of two more.
        turn = np.linalg.norm((relative[1] - relative[0]).reshape(-1, 9), axis=1) * np.sqrt(0.5)
        return np.linalg.norm(centers[1] - centers[0], axis=1) + turn * self._radii[other]

    def _gaps_at_ends(self, ends: PairEnds, placed: PlacedBodies) -> Float[Array, "2 2 k"]:
        """Gaps along the normals of both ends (first axis) at both ends (second axis) [m]."""
        one, other, sign = self._from[ends.pair], self._other[ends.pair], self._sign[ends.pair, None]
        poses = []
        for place, numbers in ((ends.start, ends.at_start), (ends.end, ends.at_end)):
            world = placed.still[place, one].swapaxes(1, 2)
            shift = placed.origins[place, other] - placed.origins[place, one]
            normal = np.matvec(world, sign * numbers[:, 1:])
            turn = placed.still[place, other].swapaxes(1, 2) @ world.swapaxes(1, 2)
            poses.append((turn, np.matvec(world, shift), normal))
        turns, shifts, normals = (np.array(each) for each in zip(*poses, strict=True))
        inner = -np.matvec(turns, normals[:, None])
        bodies = np.concatenate([np.tile(one, 2), np.tile(other, 4)])
        supports = self._supports(bodies, np.concatenate([normals.reshape(-1, 3), inner.reshape(-1, 3)]))
        own, opposite = np.split(supports, [normals[..., 0].size])
        # The gap along a direction: distance of the origins less the supports of both bodies towards each other.
        found = np.vecdot(normals[:, None], shifts) - own.reshape(2, 1, -1) - opposite.reshape(2, 2, -1)
        unit_error = 1e-6  # of the square of a unit vector
        unit = np.abs(np.vecdot(normals, normals) - 1.0) < unit_error
        no_gap = -1e9  # [m]; along a direction that coal does not give, or in which a half space has no end
        return np.where(unit[:, None], np.maximum(found, no_gap), no_gap)

    def _supports(self, shapes: Int[Array, " k"], directions: Float[Array, "k 3"]) -> Float[Array, " k"]:
        """Largest value of ``direction . x`` over the points of each of these shapes [m]."""
        found = np.empty(len(shapes))
        for shape in np.unique(shapes).tolist():
            which = np.flatnonzero(shapes == shape)
            found[which] = support(self._shapes[shape], directions[which])
        return found


def _paths(segments: Segments, levers: Float[Array, "k j"]) -> tuple[Array, Array, Array]:
    """Longest path of a point, sum of rotations, and deviation of a point from constant rates, (k,) each.

    Levers are those at the start; along the segment they grow with the path, which gives the exponential function.
    """
    angular, linear, turned, moved = segments
    turning = angular.sum(axis=1)
    path = (linear + angular * levers).sum(axis=1) * np.exp(np.minimum(turning, _LARGEST))
    error = (moved + turned * (levers + path[:, None])).sum(axis=1)
    return path, turning, error * np.exp(np.minimum(turned.sum(axis=1), _LARGEST))


def _sines(ends: PairEnds, placed: PlacedBodies) -> Float[Array, "k j"]:
    """Largest sine of the angle between the normals at both ends and the axis of each joint there."""
    largest = np.zeros(placed.axes[ends.start].shape[:2])
    for place, numbers in ((ends.start, ends.at_start), (ends.end, ends.at_end)):
        across = np.cross(placed.axes[place], numbers[:, None, 1:])
        sines = np.sqrt(np.vecdot(across, across))
        largest = np.maximum(largest, np.where(np.isnan(sines), 1.0, sines))
    return largest


def _tilt(sines: Float[Array, "k j"], angular: Float[Array, "k j"], turning: Float[Array, " k"]) -> Float[Array, " k"]:
    """Largest sine of the angle between the normals and the axes of the joints that turn, along each segment.

    The angle of two axes changes at most by the turn times the sine of the angle to the axis of the turn, so that the
    largest sine grows at most as the exponential function of twice the turn. Parallel axes stay parallel.
    """
    largest = np.where(angular > 0.0, sines, 0.0).max(axis=1, initial=0.0)
    return np.minimum(1.0, largest * np.exp(np.minimum(2.0 * turning, _LARGEST)))


def _smallest_maximum(a0: Array, a1: Array, b0: Array, b1: Array) -> Array:
    """Value where two lines on [0, 1] cross, one from a0 to a1, the other from b0 to b1; the larger if they do not."""
    start, end = a0 - b0, b1 - a1
    steady = np.maximum(np.minimum(a0, a1), np.minimum(b0, b1))
    cross = (start > 0.0) & (end > 0.0)
    part = start / np.where(cross, start + end, 1.0)
    return np.where(cross, np.maximum(a0 + part * (a1 - a0), steady), steady)
