"""Limit: a frame stays in a convex region."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rnc_pin.array_shapes import Float
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.limits.control_limit import BoundLimit, ControlLimit, LimitRows
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.parameter_types import Positive
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation


@dataclass(frozen=True)
class RegionLimit(ControlLimit):
    """Convex region of the world for a frame's origin: a box, a polygon in the x-y plane, half-spaces, or all of them.

    The origin approaches a boundary at most at ``gain`` times its distance. Outside, it returns at that rate.

    Args:
        frame: name of the frame.
        box: lower and upper coordinate [m] of world axes, e.g. ``{"x": [0, 2], "z": [0.1, 1]}``.
        polygon: corners (x, y) [m] of a convex polygon, in order.
        half_spaces: normal and offset (n_x, n_y, n_z, c) of half-spaces ``n . p <= c`` [m].
        gain: rate of approach [1/s]; below 1 over the sampling interval.
        priority: order in which soft limits give way; the largest number first.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> limit = rnc.control.limits.RegionLimit("base", box={"x": (-1.0, 2.0)}, gain=5.0)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = limit.bind(reduced).rows(sample)
        >>> rows.upper.round(6)  # gain times the distances of 1 m and 2 m
        array([ 5., 10.])
    """

    frame: str
    box: Mapping[str, tuple[float, float]] | None = None
    polygon: Sequence[tuple[float, float]] | None = None
    half_spaces: Sequence[tuple[float, float, float, float]] | None = None
    gain: Positive = 5.0
    priority: int = field(default=1, kw_only=True)

    def bind(self, reduced: ReducedModel) -> BoundLimit:
        return _BoundRegion(self, reduced)


class _BoundRegion(BoundLimit):
    def __init__(self, limit: RegionLimit, reduced: ReducedModel) -> None:
        sides = [*_box_sides(limit), *_polygon_sides(limit), *_half_space_sides(limit)]
        if not sides:
            raise ConfigurationError(f"region of frame '{limit.frame}': give a box, a polygon or half-spaces")
        if not 0 < limit.gain < np.inf:
            raise ConfigurationError(f"region of frame '{limit.frame}': gain has to be positive, found {limit.gain}")
        self._frame, self._gain = reduced.robot.frame_id(limit.frame), limit.gain
        self.names = tuple(f"{limit.frame} {name}" for name, *_ in sides)
        self._normals, self._offsets = np.array([n for _, n, _ in sides]), np.array([c for *_, c in sides])
        if not (np.isfinite(self._normals).all() and np.isfinite(self._offsets).all()):
            raise ConfigurationError(f"region of frame '{limit.frame}': expected finite numbers")
        self._below = np.full(len(sides), -np.inf)

    def rows(self, sample: ControlSample) -> LimitRows:
        at = sample.end.position
        distance = self._offsets - self._normals @ at.placement(self._frame).translation
        jacobian = self._normals @ at.jacobian(self._frame)[:3]
        return LimitRows(jacobian, self._below, self._gain * distance)

    def exceeded_by(
        self, state: StateEvaluation, time: float, mean: Float[np.ndarray, " nv"] | None = None
    ) -> Float[np.ndarray, " k"]:
        return self._normals @ state.position.placement(self._frame).translation - self._offsets


_Side = tuple[str, np.ndarray, float]
"""Name, outward unit normal and offset of a boundary ``n . p <= c``."""


def _box_sides(limit: RegionLimit) -> list[_Side]:
    sides = []
    for axis, ends in (limit.box or {}).items():
        low, high = (float(each) for each in ends)
        if not low < high:
            raise ConfigurationError(f"region of frame '{limit.frame}': {axis} from {low} to {high} is empty")
        unit = np.eye(3)[axis_index(axis)]
        sides += [(f"{axis} lower", -unit, -low)] if np.isfinite(low) else []
        sides += [(f"{axis} upper", unit, high)] if np.isfinite(high) else []
    return sides


def _polygon_sides(limit: RegionLimit) -> list[_Side]:
    if limit.polygon is None:
        return []
    corners = np.asarray(limit.polygon, dtype=float)
    wrong = f"region of frame '{limit.frame}': expected a convex polygon, with at least three corners (x, y) in order"
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise ConfigurationError(wrong)
    edges = np.roll(corners, -1, axis=0) - corners
    following = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    total = np.arctan2(turns, (edges * following).sum(axis=1)).sum()
    if not ((turns > 0).all() or (turns < 0).all()) or not np.isclose(abs(total), 2 * np.pi):
        raise ConfigurationError(wrong)
    outward = np.sign(turns[0]) * np.stack([edges[:, 1], -edges[:, 0], np.zeros(len(edges))], axis=1)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    offsets = (outward[:, :2] * corners).sum(axis=1)
    return [(f"side {k}", n, float(c)) for k, (n, c) in enumerate(zip(outward, offsets, strict=True))]


def _half_space_sides(limit: RegionLimit) -> list[_Side]:
    sides = []
    for k, each in enumerate(limit.half_spaces or ()):
        plane = np.asarray(each, dtype=float)
        if plane.shape != (4,) or not np.linalg.norm(plane[:3]) > 0:
            raise ConfigurationError(
                f"region of frame '{limit.frame}': a half-space is (n_x, n_y, n_z, c) with a normal, found {each}"
            )
        length = float(np.linalg.norm(plane[:3]))
        sides.append((f"half-space {k}", plane[:3] / length, float(plane[3]) / length))
    return sides
