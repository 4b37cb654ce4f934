"""Bounds and distances of all selected pairs of a robot and its obstacles, with broad phase and exact rates."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple
from weakref import WeakKeyDictionary

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rnc_pin import _kernel
from rnc_pin.array_shapes import Array, Float, Int
from rnc_pin.collision.shapes import (
    NUMBERS,
    LinkPair,
    Obstacle,
    OmittedPair,
    PairDistances,
    PairMeasurement,
    PairSelection,
    SpinningShapes,
    bounding_box,
    check_ignored_links,
    convex_shape,
    select_pairs,
)
from rnc_pin.errors import InputError, ModelError, check_unique
from rnc_pin.model.cached_property import once_per_model
from rnc_pin.model.configuration_evaluation import ConfigurationEvaluation
from rnc_pin.model.input_validation import admit_configuration, admit_configurations
from rnc_pin.model.kinematics import moving_entries
from rnc_pin.robots.robot import Robot


class ShapePoses(NamedTuple):
    """Poses of all shapes, at one place of a motion or at many, which are then the first axis.

    Attributes:
        rotations: (..., s, 3, 3) in the world.
        origins: (..., s, 3) in the world [m].
        middles: centres of the boxes around the shapes (..., s, 3) in the world [m].
    """

    rotations: Array
    origins: Array
    middles: Array


def _carried(joints: Array, carriers: Array, rotations: Array, origins: Array, centers: Array) -> ShapePoses:
    """Poses of shapes that joints carry.

    Args:
        joints: placements of all joints (..., njoints, 12): the columns of a rotation, then a translation.
        carriers: joint of each of the first shapes (k,); further shapes are in the world.
        rotations, origins: poses of all shapes in their joints (..., s, 3, 3) and (..., s, 3).
        centers: centres of the boxes around the shapes, in their own frames (s, 3) [m].
    """
    # One place, in a control loop: the kernel avoids the overhead of NumPy. Many places share their cost.
    if joints.ndim == 2:
        # Arrays of their own: the bounds keep the last poses to see how far bodies have moved.
        found = ShapePoses(*(np.empty(each.shape) for each in (rotations, origins, origins)))
        if _kernel.library.shape_poses(joints, carriers, rotations.reshape(-1, 9), origins, centers, *found):
            return found
    rotations, origins, count = rotations.copy(), origins.copy(), len(carriers)
    carrying = joints.take(carriers, -2)
    turns = carrying[..., :9].reshape(*carrying.shape[:-1], 3, 3).swapaxes(-1, -2)
    origins[..., :count, :] = _product(turns, origins[..., :count, :, None])[..., 0] + carrying[..., 9:]
    rotations[..., :count, :, :] = _product(turns, rotations[..., :count, :, :])
    return ShapePoses(rotations, origins, origins + np.matvec(rotations, centers))


class PlacedBodies(NamedTuple):
    """Poses of all bodies in the world at n places of a motion.

    Attributes:
        rotations: rotations (n, s, 3, 3) of the shapes.
        still: the same, with shapes that spin about their own axes as if they did not.
        origins: origins (n, s, 3) of the shapes [m].
        middles: centres (n, s, 3) of the boxes around the shapes [m].
        joints: origins (n, j, 3) of all joints, then of the obstacles that move [m].
        axes: axes (n, j, 3) about which they turn; NaN for joints that turn about several ones, or none.
    """

    rotations: Array
    still: Array
    origins: Array
    middles: Array
    joints: Array
    axes: Array


class DistanceBounds:
    """Lower bounds of the distances of pairs of shapes.

    Args:
        first, second: shapes of each pair (k,).
        halves: half sides of the boxes around the shapes, in their own frames (s, 3) [m].
    """

    def __init__(self, first: Int[Array, " k"], second: Int[Array, " k"], halves: Float[Array, "s 3"]) -> None:
        self._first, self._second, self._halves = first, second, halves
        self._shapes = np.array([first, second])
        self._radii = np.linalg.norm(halves, axis=1)
        self._reach = self._radii[first] + self._radii[second]
        self._last: ShapePoses | None = None
        self._known = np.zeros(len(first))
        self._measured = np.zeros(len(first), dtype=bool)

    def of_volumes(self, at: ShapePoses | PlacedBodies, pairs: Array | slice = slice(None)) -> Float[Array, "*n k"]:
        """Bounds of these pairs [m], from spheres and from boxes along the axes of the world.

        Args:
            at: poses of all shapes, at one place or at n.
            pairs: indices of the pairs (k,); all by default.
        """
        first, second = self._first[pairs], self._second[pairs]
        halves = np.matvec(np.abs(at.rotations), self._halves)
        apart = np.abs(at.middles.take(second, -2) - at.middles.take(first, -2))
        spheres = np.sqrt(np.vecdot(apart, apart)) - self._reach[pairs]
        apart -= halves.take(first, -2)
        apart -= halves.take(second, -2)
        gaps = np.maximum(apart, 0.0, out=apart)
        # A sphere's bound is negative where spheres overlap, a box's bound is then zero.
        return np.maximum(np.sqrt(np.vecdot(gaps, gaps)), spheres, where=gaps.any(axis=-1), out=spheres)

    def nearby(self, at: ShapePoses, within: float) -> Int[Array, " n"]:
        """Pairs that may be nearer than a distance [m].

        A distance decreases at most by the motion of both bodies: of the centre, and of the rotation about it
        at the corner of the box. So pairs that were far need no volumes until they may be near.

        Args:
            at: poses of all shapes at one place.
            within: the distance [m].
        """
        if self._last is None:
            self._known = self.of_volumes(at)
            self._measured[:] = True
        elif not _kernel.library.pair_bounds(
            at.rotations, at.middles, self._last.rotations, self._last.middles, self._radii, self._shapes, self._known
        ):
            turn = (at.rotations - self._last.rotations).reshape(-1, 9)
            shift = at.middles - self._last.middles
            # The norm of a difference of rotations is its Frobenius norm over the root of two.
            moved = np.sqrt(np.vecdot(shift, shift)) + np.sqrt(0.5 * np.vecdot(turn, turn)) * self._radii
            # Both bodies may move towards each other: the bound loses the sum. It grows again only when the pair is
            # measured or bounded anew.
            self._known -= moved.take(self._first)
            self._known -= moved.take(self._second)
        self._last = at
        near = np.flatnonzero(self._known < within)
        fresh = near[~self._measured[near]]
        few = 6  # pairs for which bounds of volumes cost more than distances
        if len(fresh) > few:
            self._known[fresh] = np.maximum(self._known[fresh], self.of_volumes(at, fresh))
            # A fresh pair was known by its motion only; bounds of volumes may show that it is far.
            near = near[self._known[near] < within]
        self._measured[:] = False
        return near

    def measured(self, pairs: Int[Array, " n"], distances: Float[Array, " n"]) -> None:
        """Remember the distances [m] of pairs at the poses of ``nearby``.

        Args:
            pairs: indices of the pairs.
            distances: their measured distances [m].
        """
        tolerance = 1e-5  # [m] of coal's error, with a margin: a measured distance less this is a lower bound
        # In a control loop, most pairs keep such a bound for many cycles: only the near ones are measured again.
        self._known[pairs] = distances - tolerance
        self._measured[pairs] = True


def _product(left: Float[Array, "*k 3 3"], right: Float[Array, "*k 3 c"]) -> Float[Array, "*k 3 c"]:
    """Matrix products with the order of additions of the compiled kernel: coal then sees the same bits."""
    first, second, third = (left[..., k : k + 1] * right[..., k : k + 1, :] for k in range(3))
    return first + second + third


# ---------------------------------------------------------------------- distances


_ALWAYS: WeakKeyDictionary[Robot, frozenset[tuple[int, int]]] = WeakKeyDictionary()
"""Pairs of shapes of each robot that touch in nearly all of its configurations: its file means no collision by them."""

_TOUCHING = 1e-9  # [m] distance below which bodies touch: rounding of placements


class CollisionDistances:
    """Signed distances between links, and from links to obstacles. One object serves one thread at a time.

    Meshes count as their convex hulls. Pairs of links that touch at ``q0``, or in nearly all of 40 random
    configurations, cannot be told from a collision: they are not checked, and ``omitted`` lists them.

    Args:
        robot: robot with a collision model.
        obstacles: bodies in the world.
        selection: rules for pairs of links; by default all pairs that are not adjacent.
        q0: configuration (nq,) without collisions; by default the neutral one.

    Attributes:
        pairs: checked pairs. The second body of the last ones is an obstacle.
        omitted: pairs of links that are not checked, and why.
        shapes: convex shapes of the links, then of the obstacles.
        carriers: joint that carries each shape.
        radii: radii of the spheres around the boxes around the shapes [m].
        link_shapes: number of shapes of links; the shapes of obstacles follow.
        shape_pairs: first and second shape of each pair (2, k).
        spinning: shapes of links that spin about their own axes.

    Raises:
        ModelError: the robot has no collision geometry, two obstacles share a name, or a rule or an obstacle names an
            unknown link.

    Example:
        >>> import coal
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> box = rnc.collision.Obstacle(coal.Box(0.2, 0.2, 2.0), position=(2.45, 0.0, 0.0), name="box")
        >>> distances = rnc.collision.CollisionDistances(robot, [box])
        >>> nearest = distances.at(robot.configuration(), within=0.1)
        >>> [distances.pairs[pair].label for pair in nearest.pairs], nearest.distance.round(6)  # two fingers
        (['tip / box', 'tip / box'], array([0.05, 0.05]))
    """

    def __init__(
        self,
        robot: Robot,
        obstacles: Sequence[Obstacle] = (),
        selection: PairSelection | None = None,
        q0: ArrayLike | None = None,
    ) -> None:
        source = robot.collision_model
        if source is None or not robot.has_collision_shapes:
            raise ModelError(f"robot '{robot.name}' has no collision geometry")
        self.robot, self.obstacles = robot, tuple(obstacles)
        self._made_of = robot, self.obstacles, selection, None if q0 is None else np.array(q0, dtype=float)
        names = [obstacle.name for obstacle in self.obstacles]
        check_unique(names, "two obstacles are named", ModelError)
        self._model, self._data = robot.model, robot.model.createData()
        shapes = list(source.geometryObjects)
        self.link_shapes = len(shapes)
        links = [robot.model.frames[shape.parentFrame].name for shape in shapes]
        self.carriers = [int(shape.parentJoint) for shape in shapes] + [0] * len(self.obstacles)
        self.shapes = [*_convex_shapes(robot), *(obstacle.shape for obstacle in self.obstacles)]
        check_ignored_links(self.obstacles, robot)
        kept, omitted = select_pairs(robot.model, links, self.carriers[: len(shapes)], selection or PairSelection())
        kept += [
            LinkPair(link, len(shapes) + k, (links[link], obstacle.name))
            for k, obstacle in enumerate(self.obstacles)
            for link in range(len(shapes))
            if links[link] not in obstacle.ignored_links
        ]
        placements = [shape.placement for shape in shapes] + [each.placement(0.0) for each in self.obstacles]
        own = np.array([each.homogeneous for each in placements])
        self._own_rotations, self._own_origins = own[:, :3, :3].copy(), own[:, :3, 3].copy()
        self._link_carriers = np.array(self.carriers[: len(shapes)])
        self._moving = [k for k, obstacle in enumerate(self.obstacles) if obstacle.motion is not None]
        titles = [*(each.name for each in shapes), *names]
        boxes = [bounding_box(*each) for each in zip(self.shapes, titles, strict=True)]
        self._centers, self._halves = (np.array([box[k] for box in boxes]) for k in (0, 1))
        self.radii = np.linalg.norm(self._halves, axis=1)
        poses = self._own_rotations, self._own_origins
        self.spinning = SpinningShapes(self._model, self.shapes, self._link_carriers, *poses, self.radii)
        # A joint changes the distance of a pair if it carries one of both bodies and not the other.
        self._support = np.zeros((len(self.carriers), self._model.nv))
        for k, joint in enumerate(self.carriers):
            self._support[k, moving_entries(self._model, joint)] = 1.0
        usual: frozenset[tuple[int, int]] = frozenset()
        # Pairs that the user names are checked whatever they do in random configurations.
        if selection is None or (selection.links and selection.pairs is None):
            usual = self._always(select_pairs(robot.model, links, self.carriers[: len(shapes)], PairSelection())[0])
        self._use(kept)
        touching = {
            k: OmittedPair(pair.names, "overlap in nearly all configurations")
            for k, pair in enumerate(kept)
            if pair[:2] in usual
        } | self._touching(robot.configuration() if q0 is None else admit_configuration(q0, robot, "q0"))
        self.omitted = (*omitted, *touching.values())
        self._use([pair for k, pair in enumerate(kept) if k not in touching])

    def __reduce__(self) -> tuple[object, ...]:
        """Build the same distances again: geometry data of Pinocchio cannot be pickled."""
        return type(self), self._made_of

    def at(self, q: ArrayLike | ConfigurationEvaluation, t: float = 0.0, within: float = np.inf) -> PairDistances:
        """Distances of the pairs that are nearer than a distance.

        Args:
            q: configuration (nq,), or an evaluation of a model of the same robot there, whose kinematics are used.
            t: time, for obstacles that move [s].
            within: only pairs that may be nearer than this are evaluated [m].
        """
        if not isinstance(q, ConfigurationEvaluation):
            q = admit_configurations(q, self.robot)
        self._place(q, t)
        near = self._bounds.nearby(self._at, within)
        found = self._measurement.measure(near, self._at.rotations, self._at.origins)
        # All of them: a pair that is farther than asked for is bounded too, and is not measured again nearby.
        self._bounds.measured(near, found[:, 0])
        inside = found[:, 0] < within
        return self._with_rates(near[inside], found[inside], t)

    def edges(self, near: PairDistances, t: float = 0.0, turn: float = 0.05) -> PairDistances:
        """Further points of pairs at the last configuration, which are nearest if the first body turns a little.

        A body that rests on a corner turns about it until it meets another one: its distance then changes at once. With
        these points, both corners count. Distances are those to the plane through the nearest points: at least the
        pair's own one for convex bodies that are apart. A pair occurs several times.

        Args:
            near: the pairs, from the last call of ``at``.
            t: time, for obstacles that move [s].
            turn: angle [rad].
        """
        pairs, first = near.pairs, self.shape_pairs[0][near.pairs]
        found = []
        # Directions (4, 3) to the corners of a tetrahedron.
        turns = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]) / np.sqrt(3.0)
        # The corners of a tetrahedron: one of four axes is never far from the axis of the turn onto an edge.
        for axis in turns:
            rotation = pin.exp3(turn * axis)
            rotations = self._at.rotations.copy()
            rotations[first] = rotation @ rotations[first]
            middles = self._at.middles
            origins = self._at.origins.copy()
            origins[first] = middles[first] + np.matvec(rotation, origins[first] - middles[first])
            measured = self._measurement.measure(pairs, rotations, origins)
            # The nearest point of the turned body belongs to a point of the body as it is: turn it back.
            a = middles[first] + np.matvec(rotation.T, measured[:, 4:7] - middles[first])
            for point, plane, sign in ((a, near.point_b, 1.0), (measured[:, 7:10], near.point_a, -1.0)):
                distance = sign * np.vecdot(near.normal, plane - point)
                ends = point, point + (sign * distance)[:, None] * near.normal
                found.append(np.column_stack([distance, near.normal, *ends[:: int(sign)]]))
        numbers = np.concatenate(found)
        same_point = 1e-3  # [m]: nearer points would give the same row twice
        chosen = np.abs(numbers[:, 4:7] - np.tile(near.point_a, (len(found), 1))).max(axis=1) > same_point
        return self._with_rates(np.tile(pairs, len(found))[chosen], np.ascontiguousarray(numbers[chosen]), t)

    def smallest(self, q: ArrayLike, t: float = 0.0, beyond: float = 0.0) -> np.ndarray:
        """Distance of every pair (k,) [m]; pairs farther than ``beyond`` may have a lower bound instead.

        Args:
            q: configuration (nq,).
            t: time, for obstacles that move [s].
            beyond: distance up to which pairs are measured [m].
        """
        self._place(admit_configurations(q, self.robot), t)
        bounds = self._bounds.of_volumes(self._at)
        near = np.flatnonzero(bounds < beyond)
        bounds[near] = self._measurement.measure(near, self._at.rotations, self._at.origins)[:, 0]
        return bounds

    # ------------------------------------------------------------------ along motions

    def depends_on(self, velocities: np.ndarray) -> np.ndarray:
        """Mask (k,) of the pairs whose bodies move relative to each other by some velocities, a mask (nv,).

        Args:
            velocities: True (nv,) for the entries of v that move.
        """
        return np.asarray(self._signs[:, velocities].any(axis=1))

    def place(self, q: np.ndarray, t: np.ndarray) -> PlacedBodies:
        """Poses of all bodies at places of a motion.

        Args:
            q: configurations (n, nq).
            t: times (n,), for obstacles that move [s].
        """
        joints = np.empty((len(q), self._model.njoints, 12))
        rotations, places = (np.empty((len(q), *each.shape)) for each in (self._own_rotations, self._own_origins))
        for row, (configuration, moment) in enumerate(zip(q, t.tolist(), strict=True)):
            pin.forwardKinematics(self._model, self._data, configuration)
            joints[row] = self._joint_placements()
            rotations[row], places[row] = self._own_poses(moment)
        turns, origins = joints[..., :9].reshape(*joints.shape[:2], 3, 3).swapaxes(-1, -2), joints[..., 9:]
        moving = [self.link_shapes + k for k in self._moving]
        at = _carried(joints, self._link_carriers, rotations, places, self._centers)
        up = np.array([0.0, 0.0, 1.0])  # obstacles that move turn by yaw
        axes = np.matvec(turns, self.spinning.axes), np.broadcast_to(up, (len(q), len(moving), 3))
        still = self.spinning.without_spin(at.rotations, turns)
        pivots = np.concatenate([origins, at.origins[:, moving]], axis=1)
        return PlacedBodies(at.rotations, still, at.origins, at.middles, pivots, np.concatenate(axes, axis=1))

    def lower_bounds(self, placed: PlacedBodies, pairs: np.ndarray) -> np.ndarray:
        """Lower bounds (n, k) of the distances of pairs [m], by bounding volumes.

        Args:
            placed: poses of all bodies at n places.
            pairs: indices of the pairs (k,).
        """
        return self._bounds.of_volumes(placed, pairs)

    def measure(self, placed: PlacedBodies, places: np.ndarray, pairs: np.ndarray) -> np.ndarray:
        """Distance, normal and nearest points (k, 10) of pairs at places; equal places follow each other.

        Args:
            placed: poses of all bodies at the places.
            places: place of each pair (k,).
            pairs: indices of the pairs (k,).
        """
        # coal keeps one pose for each shape: all pairs of a place are measured before the shapes move on.
        ends = np.flatnonzero(np.diff(places, append=-1)) + 1
        found = [np.zeros((0, NUMBERS))]
        for start, end in pairwise([0, *ends.tolist()]):
            place = places[start]
            found.append(self._measurement.measure(pairs[start:end], placed.rotations[place], placed.origins[place]))
        return np.concatenate(found)

    # ------------------------------------------------------------------ set-up

    def _use(self, pairs: Sequence[LinkPair]) -> None:
        self.pairs = tuple(pairs)
        self.shape_pairs = np.array([pair[:2] for pair in pairs], dtype=int).reshape(-1, 2).T
        self._measurement = PairMeasurement(self.shapes, self.pairs)
        self._bounds = DistanceBounds(self.shape_pairs[0], self.shape_pairs[1], self._halves)
        self._signs = self._support[self.shape_pairs[1]] - self._support[self.shape_pairs[0]]

    def _always(self, pairs: Sequence[LinkPair]) -> frozenset[tuple[int, int]]:
        """Those of all pairs of links that touch in nearly all configurations."""
        found = _ALWAYS.get(self.robot)
        count, nearly_all = 40, 0.95  # configurations that are looked at, and the share of them
        if found is None:
            # A fixed seed: the same robot has the same checked pairs in each run.
            generator = np.random.default_rng(0)
            self._use(pairs)
            drawn = [self.robot.random_configuration(generator) for _ in range(count)]
            share = np.mean([self.smallest(q, beyond=_TOUCHING) < _TOUCHING for q in drawn], axis=0)
            found = frozenset(pair[:2] for pair, each in zip(pairs, share.tolist(), strict=True) if each >= nearly_all)
            _ALWAYS[self.robot] = found
        return found

    def _touching(self, q0: np.ndarray) -> dict[int, OmittedPair]:
        """Pairs of links that touch at a configuration, by index."""
        found = self.at(q0, within=_TOUCHING)
        return {
            int(k): OmittedPair(self.pairs[k].names, f"overlap by {depth:.4f} m at the reference configuration", depth)
            for k, depth in zip(found.pairs, (-found.distance).tolist(), strict=True)
            if self.pairs[k].second < self.link_shapes
        }

    # ------------------------------------------------------------------ one configuration

    def _place(self, at: np.ndarray | ConfigurationEvaluation, t: float) -> None:
        """Place all shapes, and find the joint Jacobians in the world, (6, nv)."""
        known = at.compiled_kinematics if isinstance(at, ConfigurationEvaluation) else None
        q = at.q if isinstance(at, ConfigurationEvaluation) else at
        if q.ndim != 1:
            raise InputError(f"q has shape {q.shape}, expected ({self.robot.nq},)")
        # The compiled evaluation has placements and Jacobian of this state: Pinocchio would compute them again.
        if known is not None:
            joints, self._jacobian = known["placements"], known["J"]
        else:
            pin.computeJointJacobians(self._model, self._data, q)
            joints, self._jacobian = self._joint_placements(), np.ascontiguousarray(self._data.J).reshape(6, -1)
        self._at = _carried(joints, self._link_carriers, *self._own_poses(t), self._centers)

    def _joint_placements(self) -> np.ndarray:
        """Placements of the joints (njoints, 12) by Pinocchio: the columns of a rotation, then a translation."""
        poses = np.array([each.homogeneous for each in self._data.oMi])
        return poses[:, :3].swapaxes(1, 2).reshape(-1, 12)

    def _own_poses(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Rotations and origins of all shapes in their joints; obstacles are where they are at a time."""
        rotations, origins, links = self._own_rotations, self._own_origins, self.link_shapes
        if self._moving:
            rotations, origins = rotations.copy(), origins.copy()
        for k in self._moving:
            pose = self.obstacles[k].placement(t)
            rotations[links + k], origins[links + k] = pose.rotation, pose.translation
        return rotations, origins

    def _with_rates(self, near: np.ndarray, found: np.ndarray, t: float) -> PairDistances:
        found.flags.writeable = False  # its columns are handed out
        distance, normal, a, b = found[:, 0], found[:, 1:4], found[:, 4:7], found[:, 7:10]
        jacobian = self._rate_rows(near, found)
        drift = np.zeros(len(near))
        links = self.link_shapes
        for k in self._moving:
            of_it = self.shape_pairs[1][near] == links + k
            if of_it.any():
                twist, origin = self.obstacles[k].twist(t), self.obstacles[k].placement(t).translation
                # The nearest point of the obstacle moves with it: this is the rate of the distance that no joint
                # causes.
                drift[of_it] = normal[of_it] @ twist[:3] + _cross(b[of_it] - origin, normal[of_it]) @ twist[3:]
        return PairDistances(near, distance, a, b, normal, jacobian, drift)

    def _rate_rows(self, near: np.ndarray, found: np.ndarray) -> np.ndarray:
        """Jacobians (k, nv) of the distances."""
        rows = np.empty((len(near), self._model.nv))
        if _kernel.library.pair_rows(found, near, self._signs, self._jacobian, rows):
            return rows
        # The difference of the nearest points is along the normal, so both have the same moment about the origin.
        normal = found[:, 1:4]
        lines = np.concatenate([normal, _cross(found[:, 7:10], normal)], axis=1)
        return np.asarray(lines @ self._jacobian * self._signs.take(near, 0))


@once_per_model
def _convex_shapes(robot: Robot) -> tuple[coal.CollisionGeometry, ...]:
    """Convex shapes of the links. Planner, controller and preflight each build distances of the same robot."""
    assert robot.collision_model is not None
    hulls: dict[bytes | str, coal.CollisionGeometry] = {}
    keys = []
    for shape in robot.collision_model.geometryObjects:
        is_mesh = isinstance(shape.geometry, coal.BVHModelBase)
        # A wheel's mesh occurs four times in a car: one hull serves all. Python's id of a shape changes.
        key = np.array(shape.geometry.vertices()).tobytes() if is_mesh else shape.name
        if key not in hulls:
            hulls[key] = convex_shape(shape.geometry, shape.name)
        keys.append(key)
    return tuple(hulls[key] for key in keys)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross products (k, 3); NumPy's own takes four times as long for few vectors."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]
