"""Path of a vehicle with front steering, from pose to pose in one or several legs: paper (22) and section 4.3."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from typing import Annotated

import numpy as np
import scipy
from annotated_types import Gt, Lt
from numpy import ndarray as Array
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Float
from rnc_pin.errors import ConfigurationError, InfeasibleError
from rnc_pin.model.parameter_types import Positive
from rnc_pin.planning.driven_path import continued_back, path_distances
from rnc_pin.planning.leg import Leg, best_legs
from rnc_pin.planning.references import InTurn, Reference, ViaPoints
from rnc_pin.planning.steering_geometry import SteeringGeometry

_SAMPLES = 401  # of a leg


class CarPath:
    """Path from pose to pose. The vehicle rests with straight wheels at both ends and at stops in between.

    The path is one leg if possible, else two or three (``plan_legs``), forwards or backwards. Each leg takes a time in
    proportion to its length.

    Args:
        start: (x, y, heading) of the rear axle's middle [m, m, rad].
        goal: the same.
        duration: [s].
        wheelbase: distance between rear and front axle [m].
        via: intermediate poses where the vehicle stops, in this order. If the path is infeasible, further ones follow.
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
        InfeasibleError: no path was found, or the vehicle cannot steer as tightly.
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
        self.legs = [leg for a, b in pairwise(stops) for leg in plan_legs(a, b, radius, forward_only)]
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


# ------------------------------------------------------------------ plan

# Candidates for first and last legs, in turning radii; the middle leg covers longer distances.
_DISTANCES = np.array([1.2, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 11.0])
_BEARINGS = np.deg2rad([-60.0, -40.0, -20.0, 0.0, 20.0, 40.0, 60.0])
_TURNS = np.deg2rad([-120.0, -90.0, -60.0, -30.0, 0.0, 30.0, 60.0, 90.0, 120.0])
_COARSE = 25  # samples of a leg in the coarse search
_CHECKED = 40  # number of cheapest paths whose legs are checked with fine sampling
_STOP = 3.0  # cost of a stop, in turning radii
_FEW = 13  # number of candidates for each turn at either end, if there is a middle leg


def plan_legs(
    start: Float[Array, " 3"], goal: Float[Array, " 3"], radius: float, forward_only: bool = False
) -> list[Leg]:
    """Return one leg if it is feasible, else the cheapest two or three (``best_legs``) over a lattice of stops.

    The same poses always give the same legs.

    Args:
        start: (x, y, heading) of the rear axle's middle [m, m, rad].
        goal: the same.
        radius: smallest turning radius of the car [m].
        forward_only: True forbids backing up.

    Raises:
        ConfigurationError: start and goal are the same.
        InfeasibleError: no feasible legs were found.
    """
    single = _joined(start, goal[None], radius=radius, forward_only=forward_only)
    if single is not None:
        return single[1]
    if np.hypot(*(goal - start)[:2]) < 1e-6 * radius and abs(np.sin((goal - start)[2] / 2)) < 1e-9:
        raise ConfigurationError("start and goal of the path are the same pose")
    moves = _moves(forward_only) * [radius, radius, 1.0]
    after, before = _ahead(start, moves), _behind(goal, moves)
    once = _joined(start, np.concatenate([after, before]), goal, radius=radius, forward_only=forward_only)
    # Compute the costs of first and last legs once each, and of middle legs for all pairs.
    few = np.concatenate([np.flatnonzero(moves[:, 2] == turn)[:_FEW] for turn in _TURNS])
    first, last = np.repeat(after[few], len(few), axis=0), np.tile(before[few], (len(few), 1))
    middle, _ = best_legs(first, last, radius, forward_only, _COARSE)
    out, _ = best_legs(np.broadcast_to(start, (len(few), 3)), after[few], radius, forward_only, _COARSE)
    home, _ = best_legs(before[few], np.broadcast_to(goal, (len(few), 3)), radius, forward_only, _COARSE)
    best = np.argsort(np.add.outer(out, home).ravel() + middle, kind="stable")[:_CHECKED]
    twice = _joined(start, first[best], last[best], goal, radius=radius, forward_only=forward_only)
    found = [each for each in (once, twice) if each is not None]
    if not found:
        what = "forward legs" if forward_only else "legs"
        raise InfeasibleError(
            f"no path of at most three {what} is found from {_words(start)} to {_words(goal)} with turns of at least "
            f"{radius:.3g} m: allow more steering{' or backing up' if forward_only else ''}, or give poses to go by"
        )
    return min(found, key=lambda each: each[0] + _STOP * radius * len(each[1]))[1]


def _joined(*stops: Array, radius: float, forward_only: bool) -> tuple[float, list[Leg]] | None:
    """Cost and legs of the cheapest of n sequences of stops, each (3,) or (n, 3); None if none is feasible."""
    poses = np.stack(np.broadcast_arrays(*stops))
    if poses.shape[1] > _CHECKED:
        coarse = np.sum([best_legs(a, b, radius, forward_only, _COARSE)[0] for a, b in pairwise(poses)], axis=0)
        poses = poses[:, np.argsort(coarse, kind="stable")[:_CHECKED]]
    each = [best_legs(a, b, radius, forward_only) for a, b in pairwise(poses)]
    total = np.sum([costs for costs, _ in each], axis=0)
    best = int(np.argmin(total))
    if not np.isfinite(total[best]):
        return None
    return float(total[best]), [
        Leg(poses[i, best], poses[i + 1, best], float(charts[best])) for i, (_, charts) in enumerate(each)
    ]


@cache
def _moves(forward_only: bool) -> Float[Array, "n 3"]:
    """Poses that one leg reaches from the origin at turning radius 1, cheapest first."""
    grid = np.stack(np.meshgrid(_DISTANCES, _BEARINGS, _TURNS, indexing="ij"), axis=-1).reshape(-1, 3)
    distance, bearing, turn = grid.T
    poses = np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing), turn])
    if not forward_only:
        poses = np.concatenate([poses, poses * [-1.0, 1.0, 1.0]])
    costs, _ = best_legs(np.zeros_like(poses), poses, 1.0, forward_only)
    return poses[np.argsort(costs, kind="stable")[: np.isfinite(costs).sum()]]


def _ahead(pose: Array, moves: Array) -> Array:
    """Poses (n, 3) reached by moves (n, 3) from a pose."""
    return _placed(pose[2], moves) + pose


def _behind(pose: Array, moves: Array) -> Array:
    """Poses (n, 3) from which moves (n, 3) reach a pose."""
    turned = pose[2] - moves[:, 2]
    back = _placed(turned, moves)
    return np.column_stack([pose[:2] - back[:, :2], turned])


def _placed(heading: float | Array, moves: Array) -> Array:
    c, n = np.cos(heading), np.sin(heading)
    x, y, turn = moves.T
    return np.column_stack([c * x - n * y, n * x + c * y, turn])


def _words(pose: Array) -> str:
    return f"({pose[0]:.3g}, {pose[1]:.3g}, {np.rad2deg(pose[2]):.0f} deg)"
