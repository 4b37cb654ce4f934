"""Exact motions of a reduced system from one configuration to another, by steering that its constraint rows allow.

A motion is a sequence of displacements: joints move at constant rates along each, which is a geodesic of the
configuration manifold. A planar base then drives an arc of constant curvature. The constraint rows tell the kind:

    free                 all planned joints move independently: arms, Mecanum bases, bodies with thrusters
    differential drive   one row forbids side slip of the base: turn, drive straight, turn
    car                  the curvature of the base depends on one joint: shortest paths of Reeds and Shepp between
                         straight wheels; the car stands while it steers
    steered drives       the base follows any twist at which its pivots are aimed; it stands while they turn

Wheels and casters without limits follow: their angles are a result, and no part of a goal. A joint that is coupled to
another, such as a mimic finger or the second knuckle of a car, moves with it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import pairwise, product
from math import acos, asin, atan2, cos, hypot, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.array_shapes import Array, Bool, Float
from rnc_pin.constraints.wheeled_base import BaseMotion, WheeledBase
from rnc_pin.errors import ConfigurationError, InfeasibleError, SingularityError
from rnc_pin.model.coordinates import ConfigurationManifold, wrapped
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.motion.planning.action_models import KinematicFlow
from rnc_pin.robots.joint_values import NO_LIMIT, SingleJoint

_STEEPEST = np.deg2rad(80.0)  # largest steering angle of a joint without limits
_SHORT = 1e-12  # displacement [m or rad] that is left out
_EXACT = 1e-9  # [m or rad]; changes that rounding may cause
_PARTS = np.array([0.0, 0.4, 1.0])  # of a motion, at which the velocities of followers are compared
_OFFSETS = 0.3 * np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])  # [lengths of the base, rad] of a motion's middle
_PASSED = np.linspace(0.0, 1.0, 9)  # parts of a turn at which rows have to be independent


def base_axes(model: pin.Model) -> int:
    """Number of coordinates of the position of a mobile base, which come first in its joint; 0 for a fixed base."""
    return {"JointModelPlanar": 2, "JointModelFreeFlyer": 3}.get(model.joints[1].shortname(), 0)


class JointCouplings:
    """Joints that follow others by holonomic rows of one or two joints, such as mimic fingers and second knuckles.

    Args:
        reduced: the model.

    Attributes:
        velocities: indices in v of the joints that follow: of each row the last one that follows in no other.
        positions: first indices of the same joints in q.
        unknown: names of other holonomic rows.
    """

    def __init__(self, reduced: ReducedModel) -> None:
        self._reduced, self.velocities, self.unknown = reduced, list[int](), list[str]()
        joints, rows = list(reduced.robot.model.joints)[1:], reduced.assembly
        single = [each.idx_v for each in joints if each.nv == 1]
        # One configuration tells which joints a row moves: the ratios of a linkage change, not its members.
        at = Kinematics(reduced.robot).position(reduced.robot.configuration())
        for name, row in zip(rows.names, rows.jacobian(at) if rows.size else (), strict=True):
            moved = np.flatnonzero(row)
            free = np.setdiff1d(moved, self.velocities)
            if len(moved) <= 2 and len(free) and np.isin(moved, single).all():
                self.velocities.append(int(free[-1]))
            else:
                self.unknown.append(name)
        self.positions = [each.idx_q for each in joints if each.idx_v in self.velocities]
        names = zip(joints, reduced.robot.joint_names, strict=True)
        self._hold = [name for joint, name in names if joint.idx_v not in self.velocities]

    def applied(self, q: Float[Array, " nq"]) -> Float[Array, " nq"]:
        """Return a configuration with the joints that follow where the rows need them.

        Args:
            q: a configuration (nq,) with any positions of these joints.
        """
        return self._reduced.assembled(q, self._hold) if self.velocities else np.array(q)


class ExactMotion(NamedTuple):
    """Configurations (k + 1, nq), and the displacements (k, nv) that lead from each to the next.

    If the motion is no geodesic, the velocities of joints that follow change between two configurations.
    """

    q: Float[Array, "n nq"]
    steps: Float[Array, "k nv"]
    geodesic: bool = True

    def at(self, manifold: ConfigurationManifold, sizes: Array, places: Array) -> Float[Array, "n nq"]:
        """Configurations at places (n,) on the displacements, which have sizes (k,)."""
        ends = np.cumsum(sizes)
        k = np.minimum(np.searchsorted(ends, places), len(sizes) - 1)
        parts = 1.0 - (ends[k] - places) / sizes[k]
        return manifold.integrate(self.q[k], parts[:, None] * self.steps[k])


class Steering(ABC):
    """Family of exact motions between two configurations.

    Args:
        reduced: the model.
        planned: mask (nv,) of the velocities that are planned; all other joints follow.

    Attributes:
        kind: name of the family.
        radius: smallest turning radius [m]; zero if the base can turn on the spot.
        sampled: mask (nv,) of the planned velocities whose joints a search samples.
    """

    kind: str
    radius = 0.0

    def __init__(self, reduced: ReducedModel, planned: Bool[Array, " nv"]) -> None:
        self.reduced, self.planned, self.sampled = reduced, planned, planned
        self.couplings = JointCouplings(reduced)
        self.manifold = ConfigurationManifold(reduced.robot.model)
        self._turns = np.array([unit == "rad/s" for unit in reduced.robot.velocity_units])
        for joint in list(reduced.robot.model.joints)[1:]:
            self._turns[joint.idx_v : joint.idx_v + joint.nv] &= joint.nq != joint.nv

    @abstractmethod
    def displacements(self, start: Float[Array, " nq"], goal: Float[Array, " nq"]) -> Iterator[Float[Array, "k nv"]]:
        """Displacements of the planned joints that lead to a configuration; the best choice first."""

    def motions(self, start: Float[Array, " nq"], goal: Float[Array, " nq"]) -> Iterator[ExactMotion]:
        """Motions to a configuration, the best choice first; joints that follow do not move."""
        for steps in self.displacements(start, goal):
            yield self.along(start, steps)

    def prepared(self, q: Float[Array, " nq"]) -> Float[Array, " nq"]:
        """Return a configuration as motions end in it: a car has straight wheels.

        Args:
            q: any configuration (nq,).
        """
        return np.array(q)

    def along(self, start: Float[Array, " nq"], steps: Float[Array, "k nv"]) -> ExactMotion:
        """Motion along displacements, with long turns divided: two configurations do not tell them from short ones."""
        steps = steps[np.abs(steps).max(axis=1, initial=0.0) > _SHORT]
        turn = 1.7  # [rad]; longest turn of one displacement, below a half turn about any axis
        # A base and a ball turn by the logarithm of a rotation, which is the shorter turn: two nodes more than half a
        # turn apart would tell of the opposite motion.
        counts = np.maximum(np.ceil(np.abs(steps[:, self._turns]).max(axis=1, initial=0.0) / turn), 1.0).astype(int)
        steps = np.repeat(steps / counts[:, None], counts, axis=0)
        found, led = [np.array(start)], self.couplings.velocities
        for step in steps:
            found.append(self.couplings.applied(self.manifold.integrate(found[-1][None], step[None])[0]))
            # Joints that are coupled take part in the step: bounds of distances and durations read it.
            step[led] = self.manifold.difference(found[-2][None], found[-1][None])[0, led]
        return ExactMotion(np.array(found), steps)

    def completed(self, motion: ExactMotion, start: Float[Array, " nq"]) -> ExactMotion:
        """The motion of the planned joints from another start, with the joints that follow.

        Raises:
            ConfigurationError: the rows do not allow the motion.
        """
        flow, q, steps, geodesic = KinematicFlow(self.reduced, self.planned), [np.array(start)], list[Array](), True
        for step in motion.steps[:, self.planned]:
            along = flow.step(np.repeat(q[-1][None], len(_PARTS), axis=0), np.outer(_PARTS, step))
            v = flow.velocity(along, np.repeat(step[None], len(_PARTS), axis=0))
            if np.abs(v[:, self.planned] - step).max() > _EXACT:
                raise ConfigurationError("find_way: the rows do not allow a motion of the exact steering")
            # A wheel of a base on an arc keeps its rate, and one step is exact. A caster swings round behind it.
            changes = np.ptp(v, axis=0).max() > _EXACT
            fine = 0.02  # [m or rad]; steps of a motion in which followers change their velocities
            pieces = int(np.ceil(np.abs(step).max() / fine)) if changes else 1
            geodesic = geodesic and not changes
            for _ in range(pieces):
                steps.append(flow.velocity(q[-1][None], step[None] / pieces)[0])
                q.append(self.couplings.applied(flow.step(q[-1][None], step[None] / pieces)[0]))
        return ExactMotion(np.array(q), np.array(steps).reshape(-1, len(self.planned)), geodesic)


class FreeSteering(Steering):
    """Geodesic between two configurations: the planned joints move independently."""

    kind = "free"

    def displacements(self, start: Array, goal: Array) -> Iterator[Array]:
        yield np.where(self.planned, self.manifold.difference(start[None], goal[None])[0], 0.0)[None]


class _AxleSteering(Steering):
    """Base that does not slip along an axle.

    Args:
        reduced: the model.
        planned: as for ``Steering``.
        row: coefficients (3,) of the base's velocity in the row without side slip.
    """

    def __init__(self, reduced: ReducedModel, planned: Bool[Array, " nv"], row: Float[Array, " 3"]) -> None:
        super().__init__(reduced, planned)
        # Complex numbers turn and add plane vectors in one expression: an arc is a product.
        across = complex(row[0], row[1])
        forward = -1j * across / abs(across)
        along = forward.real if abs(forward.real) > 1e-6 else forward.imag
        self._forward = forward if along > 0.0 else -forward  # a unit vector, as a complex number
        self._point = float(row[2]) / abs(across) * forward  # on the axle, nearest to the origin of the base

    def driven(self, length: float, turn: float) -> Float[Array, " nv"]:
        """Displacement of the base along an arc, or on the spot; all other joints stand."""
        step, moved = np.zeros(len(self.planned)), length * self._forward - 1j * turn * self._point
        step[:3] = [moved.real, moved.imag, turn]
        return step

    def seen(self, start: Array, goal: Array) -> tuple[float, float, float]:
        """Pose (x, y, heading) of the axle at a configuration, seen from the axle at another one."""
        (first, heading), (second, other) = (self._pose(each) for each in (start, goal))
        away = (second - first) / heading
        return away.real, away.imag, float(np.angle(other / heading))

    def _pose(self, q: Array) -> tuple[complex, complex]:
        """Position and heading of the axle."""
        x, y, c, s = q[:4]
        turned = complex(c, s)
        return complex(x, y) + turned * self._point, turned * self._forward

    def joints(self, start: Array, goal: Array) -> Float[Array, " nv"]:
        """Displacement of all planned joints but the base."""
        step = np.where(self.planned, self.manifold.difference(start[None], goal[None])[0], 0.0)
        step[:3] = 0.0
        return step


class DifferentialDrive(_AxleSteering):
    """Turn on the spot, drive straight, turn on the spot; other joints move at the same time."""

    kind = "differential drive"

    def displacements(self, start: Array, goal: Array) -> Iterator[Array]:
        x, y, turn = self.seen(start, goal)
        joints, away = self.joints(start, goal), float(np.hypot(x, y))
        # Forwards or backwards: the one that turns less comes first.
        choices = []
        for length, bearing in ((away, np.arctan2(y, x)), (-away, np.arctan2(-y, -x))) if away > _SHORT else ((0, 0),):
            last = float(wrapped(turn - bearing))
            choices.append((abs(bearing) + abs(last), [(0.0, bearing), (length, 0.0), (0.0, last)]))
        for _, pieces in sorted(choices, key=lambda choice: choice[0]):
            yield _shared([self.driven(*piece) for piece in pieces], joints)


class CarSteering(_AxleSteering):
    """Shortest paths of Reeds and Shepp between configurations with straight wheels.

    Args:
        reduced: the model.
        planned: as for ``Steering``.
        row: as for ``_AxleSteering``, (3,).
        joint: index of the velocity of the steering joint.
        q0: configuration (nq,) at which the curvature is evaluated; only the steering joint matters.
        room: part of the range of the steering joint that stays free at each end.

    Raises:
        InfeasibleError: the car cannot drive straight, or not turn to both sides.
    """

    kind = "car"

    def __init__(
        self, reduced: ReducedModel, planned: Bool[Array, " nv"], row: Array, joint: int, q0: Array, room: float = 0.0
    ) -> None:
        super().__init__(reduced, planned, row)
        model = reduced.robot.model
        self._q0, self._turn = q0, np.eye(reduced.n)[joint]
        self._joint = SingleJoint.of(next(each for each in list(model.joints)[1:] if each.idx_v == joint))
        low, high = (each[self._joint.idx_q] for each in (model.lowerPositionLimit, model.upperPositionLimit))
        unlimited = self._joint.continuous or not low < high or max(-low, high) > NO_LIMIT
        free = room * (high - low)
        grid = 161  # steering angles at which the curvature is evaluated
        angles = np.linspace(*((-_STEEPEST, _STEEPEST) if unlimited else (low + free, high - free)), grid)
        curvatures = np.array([self._curvature(angle) for angle in angles])
        middle, slopes = int(np.nanargmin(np.abs(curvatures))), np.diff(curvatures)
        # Around straight ahead, the curvature is monotonic; beyond the first turning points, or where rows are
        # singular, an angle for a curvature would not be unique.
        turns_back = np.flatnonzero(~(slopes * slopes[min(middle, len(slopes) - 1)] > 0.0))
        first = turns_back[turns_back < middle].max(initial=-1) + 1
        last = turns_back[turns_back >= middle].min(initial=len(slopes))
        ends = curvatures[[first, last]]
        if not ends.min() < 0.0 < ends.max():
            raise InfeasibleError(
                f"joint '{reduced.robot.velocity_names[joint]}' steers the base from a curvature of {ends.min():.3g} "
                f"to {ends.max():.3g} 1/m: a way needs turns to both sides"
            )
        rounded = 1e-12  # error of a curvature, relative to the largest one, that rounding may cause
        # At the end itself, rounding would decide on the sign.
        largest = (1.0 - rounded) * float(min(-ends.min(), ends.max()))
        self.radius, bracket = 1.0 / largest, angles[[first, last]]
        self._angles = dict[int, float]()
        for side in (-1, 0, 1):
            miss = partial(lambda wanted, angle: self._curvature(angle) - wanted, side * largest)
            self._angles[side] = float(scipy.optimize.brentq(miss, *bracket, xtol=1e-14))
        # The curvature at these angles is exact, whatever the error of the root.
        self._driven = {side: self._curvature(angle) for side, angle in self._angles.items()}

    def prepared(self, q: Float[Array, " nq"]) -> Float[Array, " nq"]:
        found = np.array(q)
        self._joint.put(found, np.asarray(self._angles[0]))
        return found

    def _curvature(self, angle: float) -> float:
        """Curvature of the axle's path [1/m]; NaN where rows are singular, limits exceeded or nothing moves."""
        q, led = self._q0.copy(), self.couplings.positions
        self._joint.put(q, np.asarray(angle))
        q, model = self.couplings.applied(q), self.reduced.robot.model
        low, high = model.lowerPositionLimit[led], model.upperPositionLimit[led]
        try:
            R = self.reduced.at(q).R
        except SingularityError:
            return np.nan
        # The rows leave one direction of the base, whatever the reducing outputs: the first singular vector.
        x, y, turn = np.linalg.svd(R[:3])[0][:, 0]
        speed = (complex(x, y) / self._forward).real  # of the axle
        held = (low >= high) | ((q[led] > low - _EXACT) & (q[led] < high + _EXACT))
        return float(turn / speed) if abs(speed) > 1e-6 and held.all() else np.nan

    def displacements(self, start: Array, goal: Array) -> Iterator[Array]:
        paths = 3  # shortest paths of a car that are tried
        # Each path costs a check of distances, and a search has many pairs to try; a guess takes all of them.
        for word in self._words(start, goal)[:paths]:
            yield self._steered(word, start, goal)

    def paths(self, start: Float[Array, " nq"], goal: Float[Array, " nq"]) -> Iterator[tuple[ExactMotion, Word]]:
        """Motions along all paths, the shortest first, each with its segments in turning radii."""
        for word in self._words(start, goal):
            if word:
                yield self.along(start, self._steered(word, start, goal)), word

    def _words(self, start: Array, goal: Array) -> list[Word]:
        x, y, turn = self.seen(start, goal)
        if np.hypot(x, y) < _SHORT and abs(turn) < _SHORT:
            return [[]]
        return reeds_shepp_words(x / self.radius, y / self.radius, turn)

    def _steered(self, word: Word, start: Array, goal: Array) -> Array:
        """Displacements along a path, the car stands where it steers."""
        joints = self.joints(start, goal)
        joints[self._turn > 0.0] = 0.0
        angle, pieces, steering = float(self._joint.position(start)), [], []
        for side, length in word:
            if abs(length) < _SHORT:
                continue
            steering.append((self._angles[side] - angle) * self._turn)
            angle, along = self._angles[side], length * self.radius
            pieces.append(self.driven(along, self._driven[side] * along))
        end = (float(self._joint.position(goal)) - angle) * self._turn
        if not pieces:
            return (joints + end)[None]
        moved = _shared(pieces, joints)
        return np.array([step for pair in zip(steering, moved, strict=True) for step in pair] + [end])


class AimedSteering(Steering):
    """Base with pivots that can be aimed at any motion: one screw motion, or two beside angles of dependent rows.

    Args:
        reduced: the model.
        planned: as for ``Steering``.
        base: the base, whose pivots turn by half a turn at least.
        q0: configuration (nq,) whose angles the pivots have between motions.
    """

    kind = "steered drives"

    def __init__(self, reduced: ReducedModel, planned: Bool[Array, " nv"], base: WheeledBase, q0: Array) -> None:
        super().__init__(reduced, planned)
        self._base, self._q0 = base, np.array(q0)
        self.sampled = planned & ~np.isin(np.arange(len(planned)), [*base.pivots, *base.resting])

    def prepared(self, q: Float[Array, " nq"]) -> Float[Array, " nq"]:
        by = self.manifold.difference(q[None], self._q0[None])
        return self.manifold.integrate(q[None], np.where(self.planned & ~self.sampled, by, 0.0))[0]

    def displacements(self, start: Array, goal: Array) -> Iterator[Array]:
        difference, move, own = self.manifold.difference, self.manifold.integrate, self._base.base
        whole = difference(start[None], goal[None])[0]
        if np.abs(whole[self._base.resting]).max(initial=0.0) > _EXACT:
            return
        whole[~self.sampled] = 0.0
        # Where the pivots for the straight motion have dependent rows, a middle aside of it has other angles.
        aside, part = np.zeros(len(whole)), np.isin(np.arange(len(whole)), own)
        for offset in _OFFSETS:
            aside[own] = offset * [self._base.length, self._base.length, 1.0]
            middle = move(move(start[None], 0.5 * (whole * part)[None]), aside[None])
            ends = [start[None], middle, goal[None]] if offset.any() else [start[None], goal[None]]
            pieces = [difference(*pair)[0] * part for pair in pairwise(ends)]
            steps = self._aimed(start, goal, _shared(pieces, whole * ~part))
            if steps is not None:
                yield steps
                return

    def _aimed(self, start: Array, goal: Array, pieces: Array) -> Array | None:
        """Displacements along pieces of a motion, with turns of the pivots before each and at the end; or None."""
        base, q, steps, pivots = self._base, start, list[Array](), self._base.pivots
        for piece in pieces:
            if np.abs(piece[base.base]).max() > _SHORT:  # a base that stands needs no aim
                motion = base.at(q)
                twist = np.linalg.solve(motion.moving[base.base], piece[base.base])
                turn, beyond = base.turns(motion, q, twist, np.zeros(len(pivots)))
                turns = self._regular(motion, turn)
                if turns is None or beyond.any():
                    return None
                steps += [*turns]
                q = self.manifold.integrate(q[None], sum(turns)[None])[0]
            steps.append(piece)
            q = self.manifold.integrate(q[None], piece[None])[0]
        turns = self._regular(base.at(q), self.manifold.difference(q[None], goal[None])[0, pivots])
        return None if turns is None else np.array([*steps, *turns])

    def _regular(self, motion: BaseMotion, turn: Array) -> Array | None:
        """Turns of the pivots, one after the other if the rows become dependent otherwise; None if they do anyway."""
        for turns in (turn[None], np.diag(turn), np.diag(turn)[::-1]):
            before = np.cumsum(turns, axis=0) - turns
            passed = (before[:, None] + _PASSED[:, None] * turns[:, None]).reshape(-1, len(turn))
            independent = 0.02  # smallest singular value of the guides
            if min(self._base.independence(motion, each) for each in passed) > independent:
                return np.asarray(turns @ np.eye(len(self.planned))[self._base.pivots])
        return None


def _shared(pieces: Sequence[Array], joints: Array) -> Array:
    """Pieces of a motion of the base, with a motion of other joints in proportion to their sizes."""
    moved = np.array(pieces)
    sizes = np.linalg.norm(moved, axis=1)
    total = float(sizes.sum())
    shares = sizes / total if total > _SHORT else np.full(len(moved), 1.0 / len(moved))
    return moved + shares[:, None] * joints


# ---------------------------------------------------------------------- shortest paths
# Of a car with turning radius 1, in closed form: J. A. Reeds and L. A. Shepp, "Optimal paths for a car that goes both
# forwards and backwards", Pacific Journal of Mathematics 145 (1990). A word is a list of segments: curvature (1 left,
# -1 right, 0 straight) and signed length.


Word = list[tuple[int, float]]
LEFT, STRAIGHT, RIGHT = 1, 0, -1


def reeds_shepp_words(x: float, y: float, heading: float) -> list[Word]:
    """Paths with forward and backward segments from the origin to a pose, in turning radii, the shortest first."""
    found, back = list[Word](), (x * cos(heading) + y * sin(heading), x * sin(heading) - y * cos(heading))
    # All words: nine formulas, with motions in reversed time, reflected, and in reversed order.
    for (a, b), order in (((x, y), 1), (back, -1)):
        for backward, side in product((1, -1), (1, -1)):
            for word in _base_words(backward * a, side * b, backward * side * heading):
                found.append([(side * curvature, backward * length) for curvature, length in word][::order])
    return sorted(found, key=word_length)


def word_length(word: Word) -> float:
    """Length of a word, in turning radii."""
    return sum(abs(length) for _, length in word)


def _base_words(x: float, y: float, heading: float) -> Iterator[Word]:
    """Formulas 8.1 to 8.11 of Reeds and Shepp. Lengths have signs, so that each word ends at the pose."""
    quarter = pi / 2
    same = x - sin(heading), y - 1 + cos(heading)  # the last segment turns left
    other = x + sin(heading), y - 1 - cos(heading)  # it turns right
    u, t = hypot(*same), atan2(same[1], same[0])
    yield [(LEFT, t), (STRAIGHT, u), (LEFT, _turn(heading - t))]  # 8.1
    if u <= 4:
        v = -2 * asin(u / 4)
        s = _turn(t + v / 2 + pi)
        yield [(LEFT, s), (RIGHT, v), (LEFT, _turn(heading - s + v))]  # 8.3 and 8.4
    if u >= 2:
        r = sqrt(u**2 - 4)
        s = _turn(t + atan2(r, -2))
        yield [(LEFT, s), (RIGHT, -quarter), (STRAIGHT, 2 - r), (LEFT, _turn(heading - quarter - s))]  # 8.9
    u, t = hypot(*other), atan2(other[1], other[0])
    if u >= 2:
        r = sqrt(u**2 - 4)
        s = _turn(t + atan2(2, r))
        yield [(LEFT, s), (STRAIGHT, r), (RIGHT, _turn(s - heading))]  # 8.2
        s = atan2(other[0], -other[1])
        yield [(LEFT, s), (RIGHT, -quarter), (STRAIGHT, 2 - u), (RIGHT, _turn(s + quarter - heading))]  # 8.10
        v = 4 - r
        s = _turn(atan2((4 - v) * other[0] - 2 * other[1], -2 * other[0] + (v - 4) * other[1]))
        yield [(LEFT, s), (RIGHT, -quarter), (STRAIGHT, v), (LEFT, -quarter), (RIGHT, _turn(s - heading))]  # 8.11
    if u <= 2:
        yield from _four_arcs(acos((2 + u) / 4), -1, *other, heading)  # 8.7
    if 4 <= u**2 <= 20:
        yield from _four_arcs(-acos((20 - u**2) / 16), 1, *other, heading)  # 8.8


def _four_arcs(u: float, sign: int, xi: float, eta: float, heading: float) -> Iterator[Word]:
    """Words with two middle arcs of equal size: (u, -u) with a cusp between them, or (u, u) with one at either end."""
    v = -u if sign < 0 else u
    delta = u - v
    a, b = sin(u) - sin(delta), cos(u) - cos(delta) - 1
    t = atan2(eta * a - xi * b, xi * a + eta * b)
    yield [(LEFT, t), (RIGHT, u), (LEFT, v), (RIGHT, _turn(t - u + v - heading))]


def _turn(angle: float) -> float:
    """Angle within half a turn."""
    return (angle + pi) % (2 * pi) - pi
