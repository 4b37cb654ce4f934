"""Path of a vehicle with front steering, from pose to pose in one or several legs: paper (22) and section 4.3."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import scipy
from numpy import ndarray as Array
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Float
from rnc_pin.errors import ConfigurationError
from rnc_pin.planning.car_planner import plan_legs
from rnc_pin.planning.driven_path import continued_back, distances
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
        wheelbase: rear to front axle [m].
        via: intermediate poses where the vehicle stops, in this order.
        max_steering: largest angle of a front wheel in the middle [rad]; it and the wheelbase give the smallest radius.
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
        duration: float,
        wheelbase: float,
        *,
        via: Sequence[ArrayLike] = (),
        max_steering: float = np.pi / 4,
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
        return distances(points, continued_back(self.poses, 3.0))


def _pose(value: ArrayLike, what: str) -> Array:
    pose = np.asarray(value, dtype=float)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise ConfigurationError(f"{what} of a path: expected x, y and heading, found {pose.tolist()}")
    return pose
