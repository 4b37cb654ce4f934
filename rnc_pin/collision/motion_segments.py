"""Segments of a sampled motion: displacements of joints and obstacles along each, and their deviation from it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Array, Float, Int
from rnc_pin.collision.shapes import Obstacle, ObstacleMotion
from rnc_pin.errors import ModelError
from rnc_pin.model.coordinates import ConfigurationManifold

_HELICAL = ("JointModelH",)


class _Part(NamedTuple):
    """Part of a joint: the norm of these velocity components times two factors is its rotation and its translation."""

    joint: int
    columns: slice
    angular: float
    linear: float


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
        self._parts = [
            part for index in range(1, model.njoints) for part in _parts(index, model.joints[index], 0.0, np.abs(q))
        ]

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


def _parts(index: int, joint: pin.JointModel, lever: float, largest: Float[Array, "N nq"]) -> list[_Part]:
    """Parts of a joint whose origin is at most a lever [m] away from the origin of joint ``index``."""
    kind, start, size = joint.shortname(), joint.idx_v, joint.nv
    every = slice(start, start + size)
    each = [slice(k, k + 1) for k in range(start, start + size)]
    if kind == "JointModelFreeFlyer":
        return [_Part(index, slice(start, start + 3), 0.0, 1.0), _Part(index, slice(start + 3, start + 6), 1.0, lever)]
    if kind == "JointModelPlanar":
        return [_Part(index, slice(start, start + 2), 0.0, 1.0), _Part(index, each[2], 1.0, lever)]
    prismatic = ("JointModelP",)
    if kind == "JointModelTranslation" or kind.startswith(prismatic):
        return [_Part(index, every, 0.0, 1.0)]
    if kind in ("JointModelSpherical",):
        return [_Part(index, every, 1.0, lever)]
    several_axes = ("JointModelSphericalZYX", "JointModelUniversal")
    revolute = ("JointModelR",)  # bounded and unbounded, along an axis of the frame or not
    if kind in several_axes or kind.startswith(revolute):
        return [_Part(index, one, 1.0, lever) for one in each]
    if kind.startswith(_HELICAL):
        return [_Part(index, every, 1.0, lever + abs(float(_extracted(joint).pitch)))]
    if kind == "JointModelEllipsoid":
        inside = _extracted(joint)
        reach = max(inside.radius_x, inside.radius_y, inside.radius_z)
        return [_Part(index, one, 1.0, lever + reach) for one in each]
    if kind == "JointModelComposite":
        return _composite_parts(index, _extracted(joint), lever, largest)
    raise ModelError(f"joint {index} is a {kind}: its motion between two configurations is not known")


def _composite_parts(
    index: int, joint: pin.JointModelComposite, lever: float, largest: Float[Array, "N nq"]
) -> list[_Part]:
    """Parts of the joints in a composite joint; the origin of the last one is the origin of the whole joint."""
    found: list[_Part] = []
    for inner, placement in reversed(list(zip(joint.joints, joint.jointPlacements, strict=True))):
        found += _parts(index, inner, lever, largest)
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
        steady = self._manifold.interpolate(starts[rows], ends[rows], parts)
        return rows, self._manifold.difference(steady, self._q[samples])


class _Track:
    """Motion of an obstacle, evaluated once at each time."""

    def __init__(self, motion: ObstacleMotion) -> None:
        self._motion = motion
        self._known: dict[float, tuple[Array, Array]] = {}

    def segments(self, times: Float[Array, "k 2"]) -> tuple[Array, Array, Array, Array]:
        """Rotations, translations and their deviations, (k,) each, along segments of constant velocity and yaw rate."""
        longest = 0.05  # [s] over which an obstacle is judged from its poses and velocities at both ends
        counts = np.maximum(np.ceil((times[:, 1] - times[:, 0]) / longest), 1.0).astype(int)
        rows, first = np.repeat(np.arange(len(times)), counts), np.cumsum(counts) - counts
        number = np.arange(len(rows)) - first[rows]  # of each piece in its segment
        start, end = times[rows].T
        parts = number / counts[rows], (number + 1) / counts[rows]
        moments = [start + parts[0] * (end - start), np.where(parts[1] < 1.0, start + parts[1] * (end - start), end)]
        (poses, rates), (next_poses, next_rates) = ([np.array(x) for x in self._at(each)] for each in moments)
        step, slope = ((end - start) / counts[rows])[:, None], next_poses - poses
        cubic = 0.25  # a cubic deviates from its chord by 4/27 of the differences of its slopes times the duration
        bent = cubic * (np.abs(rates * step - slope) + np.abs(next_rates * step - slope))
        origin, last = poses[first], next_poses[first + counts - 1]
        away = np.abs(next_poses - origin[rows] - parts[1][:, None] * (last - origin)[rows])
        deviation = np.zeros((2, len(times), 4))
        np.maximum.at(deviation[0], rows, bent)
        np.maximum.at(deviation[1], rows, away)
        return (*_sizes(last - origin), *_sizes(deviation.sum(axis=0)))

    def _at(self, times: Float[Array, " k"]) -> tuple[list[Array], list[Array]]:
        """Poses and rates at times."""
        poses, rates = [], []
        for t in times.tolist():
            # Segments meet at their ends: a user's motion is asked once for each time.
            if t not in self._known:
                point = self._motion.at(t)
                self._known[t] = np.array(point.position, dtype=float), np.array(point.velocity, dtype=float)
            pose, rate = self._known[t]
            poses.append(pose)
            rates.append(rate)
        return poses, rates


def _sizes(steps: Float[Array, "k 4"]) -> tuple[Array, Array]:
    """Rotations [rad] and translations [m] of steps of x, y, z and yaw."""
    return np.abs(steps[:, 3]), np.linalg.norm(steps[:, :3], axis=1)
