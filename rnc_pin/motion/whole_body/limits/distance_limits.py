"""Limits of distances: a region in which a frame stays, distances between links and to obstacles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from rnc_pin.array_shapes import Float
from rnc_pin.collision import CollisionDistances, Obstacle, PairDistances, PairSelection
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.frame_rows import axis_index
from rnc_pin.model.input_validation import NotNegative, Positive
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.motion.whole_body.limits.control_limit import (
    BoundLimit,
    ControlLimit,
    ControlSample,
    LimitRows,
    PlannedBraking,
)


@dataclass(frozen=True)
class RegionLimit(ControlLimit):
    """Convex region of the world for a frame's origin: a box, a polygon in the x-y plane, or both.

    The origin approaches a boundary at most at ``gain`` times its distance. Outside, it returns at that rate.

    Args:
        frame: name of the frame.
        box: lower and upper coordinate [m] of world axes, e.g. ``{"x": [0, 2], "z": [0.1, 1]}``.
        polygon: corners (x, y) [m] of a convex polygon, in order.
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
    gain: Positive = 5.0
    priority: int = field(default=1, kw_only=True)

    def bind(self, reduced: ReducedModel) -> BoundLimit:
        return _BoundRegion(self, reduced)


class _BoundRegion(BoundLimit):
    def __init__(self, limit: RegionLimit, reduced: ReducedModel) -> None:
        sides = [*_box_sides(limit), *_polygon_sides(limit)]
        if not sides:
            raise ConfigurationError(f"region of frame '{limit.frame}': give a box or a polygon")
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

    def exceeded_by(self, state: StateEvaluation, time: float, turning: np.ndarray | None = None) -> np.ndarray:
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


_SHARE = 0.5
_SPACING = 5e-3  # [m, rad]; an obstacle that moves is checked at every sample
_EDGES = 5e-3  # [m] of room, in which edges of bodies count beside their nearest points


@dataclass(frozen=True)
class CollisionAvoidance(ControlLimit):
    """Velocity damper with stopping distance: ``d_dot >= -speed(d - clearance)`` for pairs nearer than ``influence``.

    Near the clearance the speed is ``rate`` times the remaining distance (Faverjon and Tournassoud 1987, with
    ``rate = xi / (influence - clearance)``), so that the clearance is reached only in infinite time. Farther away it is
    ``sqrt(2 a (d - clearance) - (a / rate)^2)``: the approach never needs more than the deceleration a. By default a is
    half of what the effort limits of the actuators give at the configuration; without such limits, the damper counts
    alone.

    If the velocity changes linearly over a sample, ``rate * dt <= 2`` keeps the clearance up to the turning of the
    normal within a sample. The motion of obstacles enters with its velocity at the end of the sample: from an obstacle
    that approaches faster than this speed, the robot retreats. An obstacle that changes its velocity needs a part of a.

    Pairs of links that are nearer than twice the clearance at ``q0`` keep half of that distance instead, because
    neighbours in a wrist are near by design.

    Between parallel faces the nearest points are not unique: a body that turns can lose clearance within a sample.

    Args:
        clearance: distance that remains [m].
        influence: distance from which a pair is slowed down [m]; larger than the clearance. To stop from an approach
            of speed u, it takes ``u^2 / (2 a) + a / (2 rate^2)`` more than the clearance.
        rate: largest rate of approach over remaining distance [1/s].
        obstacles: bodies in the world.
        selection: rules for pairs of links; by default all pairs that are not adjacent.
        q0: configuration (nq,) without collisions; by default the neutral one.
        deceleration: deceleration a of an approach [m/s^2]; by default from the effort limits.

    Example:
        >>> import coal
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> box = rnc.collision.Obstacle(coal.Box(0.2, 0.2, 2.0), position=(2.45, 0.0, 0.0), name="box")
        >>> limit = rnc.control.limits.CollisionAvoidance(clearance=0.02, influence=0.08, obstacles=[box])
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = limit.bind(reduced).rows(sample)
        >>> rows.lower.round(6)  # both fingers are 5 cm from the box: -rate (0.05 - clearance)
        array([-0.15, -0.15])
    """

    clearance: NotNegative = 0.02
    influence: Positive = 0.15
    rate: Positive = 5.0
    obstacles: Sequence[Obstacle] = ()
    selection: PairSelection = field(default_factory=PairSelection)
    q0: Sequence[float] | np.ndarray | None = None
    deceleration: Positive | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.clearance < self.influence:
            found = f"clearance {self.clearance} and influence {self.influence}"
            raise ConfigurationError(f"collision avoidance needs clearance < influence, found {found}")

    def bind(self, reduced: ReducedModel) -> BoundLimit:
        return BoundCollisionAvoidance(self, reduced)


class BoundCollisionAvoidance(BoundLimit):
    """Collision avoidance of one model, with a row for each pair.

    Attributes:
        distances: distances of the pairs; ``distances.omitted`` lists pairs that are not checked.
        clearances: distance that each pair keeps (k,) [m].
    """

    def __init__(self, limit: CollisionAvoidance, reduced: ReducedModel) -> None:
        robot = reduced.robot
        q0 = robot.configuration() if limit.q0 is None else np.asarray(limit.q0, dtype=float)
        self.distances = CollisionDistances(robot, limit.obstacles, limit.selection, q0)
        labels = [pair.label for pair in self.distances.pairs]
        self.names = tuple(f"{label} distance" for label in labels)
        self._influence, self._rate = limit.influence, limit.rate
        self.spacing = 0.0 if any(each.motion is not None for each in limit.obstacles) else _SPACING
        self._deceleration, self._braking = limit.deceleration, PlannedBraking(reduced)
        self.clearances = np.full(len(labels), limit.clearance)
        # Only pairs of links are near by design: an obstacle keeps the whole clearance.
        at_start = self.distances.at(q0, within=limit.clearance / _SHARE)
        for k, distance in zip(at_start.pairs.tolist(), at_start.distance.tolist(), strict=True):
            if self.distances.pairs[k].second < self.distances.link_shapes:
                self.clearances[k] = _SHARE * distance
        self.clearances.setflags(write=False)
        # Neighbours in a wrist are nearer than that by design: their edges count when they are nearer than at q0.
        self._edges = np.where(self.clearances < limit.clearance, _SHARE * self.clearances, _EDGES)
        self._nearest = float(self.clearances.max(initial=0.0))

    def rows(self, sample: ControlSample) -> LimitRows:
        near = self.distances.at(sample.end, sample.time, self._influence)
        room = near.distance - self.clearances[near.pairs]
        touching = room < self._edges[near.pairs]
        rows = self._rows_of(near, sample)
        if not touching.any():
            return rows
        # Nearest points of parallel faces jump: edges keep the whole face away.
        parts = [getattr(near, each.name)[touching] for each in fields(near)]
        edges = self.distances.edges(PairDistances(*parts), sample.time)
        further = self._rows_of(edges, sample)
        # A pair's own row is the last one: it is the one that reports show.
        return LimitRows(
            np.vstack([further.jacobian, rows.jacobian]),
            np.append(further.lower, rows.lower),
            np.append(further.upper, rows.upper),
            np.append(edges.pairs, near.pairs),
        )

    def _rows_of(self, near: PairDistances, sample: ControlSample) -> LimitRows:
        room = near.distance - self.clearances[near.pairs]
        # A velocity damper alone would ask for more than the actuators give.
        given = self._deceleration
        planned = np.full(len(room), given) if given else self._braking.decelerations(near.jacobian, sample.start)
        lower = -approach_speed(room, self._rate, planned) - near.drift
        return LimitRows(near.jacobian, lower, np.full(len(lower), np.inf), near.pairs)

    def braking_rows(self, sample: ControlSample) -> None:
        return None

    def exceeded_by(self, state: StateEvaluation, time: float, turning: np.ndarray | None = None) -> np.ndarray:
        # Pairs beyond the largest clearance exceed nothing: they need no distance.
        near, found = self.distances.at(state, time, self._nearest), np.zeros(len(self.names))
        found[near.pairs] = self.clearances[near.pairs] - near.distance
        return found


def approach_speed(
    room: Float[np.ndarray, " k"], rate: float, deceleration: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " k"]:
    """Return the largest speed of approach (k,) [m/s]: a damper near the clearance, constant deceleration before it.

    Both parts have the same speed and deceleration at ``room = a / rate^2``.

    Args:
        room: distance to the clearance [m]; negative inside.
        rate: rate of the damper [1/s].
        deceleration: largest deceleration a [m/s^2]; infinite for the damper alone.
    """
    # A difference of infinite numbers is none: without a deceleration, the damper alone decides.
    bounded = np.where(np.isfinite(deceleration), deceleration, 0.0)
    braking = np.sqrt(np.maximum(2.0 * bounded * room - (bounded / rate) ** 2, 0.0))
    return np.asarray(np.where(rate**2 * room <= deceleration, rate * room, braking))
