"""Search for a way of a system without a known steering: two trees of propagated motions, joined by Newton's method.

Both trees grow from the start and from the goals by random inputs of the kinematic form ``v = R(q) u``. Where they are
near each other, Newton's method changes all inputs of the path through both, until it ends at the goal. Motions without
rows over time can be driven backwards, so that the tree of the goals is followed from its leaves to its root.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import scipy
from numpy import ndarray as Array

from rnc_pin.analysis.growth import filtration
from rnc_pin.array_shapes import Bool, Float, Int
from rnc_pin.planning.exact_steering import ExactMotion
from rnc_pin.planning.kinematic_flow import KinematicFlow
from rnc_pin.planning.way_checking import WayChecker
from rnc_pin.planning.way_search import Clock, Nearest
from rnc_pin.robots.joint_values import NO_LIMIT

DEVIATION = 5e-4
"""Largest distance [m] between a motion and the geodesics between its nodes, which are checked for collisions."""

_JOINTS = 0.5  # [m]; metric: joints count as a path of this length for 1 rad
_LONGEST = 1.0  # [m or rad] of a propagated motion; each edge has two
_COARSE, _FINE = 5, 0.01  # steps of a motion in the search, and length of the steps of a way [m or rad]
_CHOICES = 24  # random motions of which the one that ends nearest to the target is taken
_NEAR = 0.6  # [m]; trees that are nearer are joined
_RANDOM = 0.6  # share of targets that are random; others are places of the other tree
_MADE, _TRIED = 0.05, 0.3  # [m]; nodes with children, and those without a free motion, count as farther away
_NEWTON, _CHORD = 12, 12  # largest numbers of iterations
_EXACT = 3e-10  # [m or rad] error at the goal
_FADED = 0.05  # share of the inputs below which shortening ends


class _Tree:
    """Configurations, the inputs that lead to them, and their parents.

    Args:
        roots: configurations (n, nq).
    """

    def __init__(self, roots: Float[Array, "n nq"]) -> None:
        self.size = len(roots)
        self._q, self.away = np.array(roots), np.zeros(self.size)
        self._parents, self._inputs = [-1] * self.size, [np.empty((0, 0))] * self.size

    @property
    def q(self) -> Float[Array, "n nq"]:
        return self._q[: self.size]

    def add(self, q: Array, parent: int, inputs: Array) -> None:
        if self.size == len(self._q):
            self._q = np.concatenate([self._q, np.empty_like(self._q)])
            self.away = np.concatenate([self.away, np.zeros_like(self.away)])
        self._q[self.size] = q
        self._parents.append(parent)
        self._inputs.append(inputs)
        self.size += 1

    def path(self, node: int) -> tuple[int, list[Array]]:
        """Root of a node, and the inputs of the edges that lead from it to the node."""
        found: list[Array] = []
        while self._parents[node] >= 0:
            found.append(self._inputs[node])
            node = self._parents[node]
        return node, found[::-1]


class PropagatedSearch:
    """Search between configurations, and shortening of what it finds.

    Args:
        flow: motions of the system.
        planned: mask (nv,) of the velocities whose joints end at the goal; all others follow.
        checker: check of motions, with ``DEVIATION`` in its clearance.
        ends: configurations (n, nq): the start and the goals.
        area: smallest and largest coordinates (2, 3) of the base [m].
        speeds: largest speeds (nv,).
        clock: time that the search may take.

    Attributes:
        nearest: configuration that was reached from the start so far.
        edges: number of motions that were checked.
    """

    def __init__(
        self,
        flow: KinematicFlow,
        planned: Bool[Array, " nv"],
        checker: WayChecker | None,
        ends: Float[Array, "n nq"],
        area: Float[Array, "2 3"],
        speeds: Float[Array, " nv"],
        clock: Clock,
    ) -> None:
        self._flow, self._planned, self._checker, self._clock = flow, planned, checker, clock
        self._start, self._goals, self._speeds = ends[0], ends[1:], speeds
        model = flow.reduced.robot.model
        low, high = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
        limited = (low < high) & (low > -NO_LIMIT) & (high < NO_LIMIT)
        self._low, self._high = np.where(limited, low, -np.inf), np.where(limited, high, np.inf)
        self._weights = np.where(planned, _JOINTS, 0.0)
        self._box = np.where(limited, [low, high], self._start + np.array([[-np.pi], [np.pi]]))
        base = model.joints[1]
        size = {"JointModelPlanar": 2, "JointModelFreeFlyer": 3}.get(base.shortname(), 0)
        if size:
            self._weights[base.idx_v : base.idx_v + base.nv] = 1.0
            self._box[:, base.idx_q : base.idx_q + size] = area[:, :size]
        self._reach = 0.0
        if checker is not None:
            self._reach = max(1.0, 2.0 * float(checker.distances.radii[: checker.distances.link_shapes].sum()))
        self._reachable = [self._directions(goal) for goal in self._goals]
        self.edges = 0
        self.nearest = Nearest(np.inf, self._start)

    def run(self, seed: int) -> ExactMotion | None:
        """Search for a way until the time is up; None if none is found.

        Args:
            seed: seed of all random choices.
        """
        generator = np.random.default_rng(seed)
        pin.seed(seed)
        trees = [_Tree(self._start[None]), _Tree(self._goals)]
        grown = 0
        while not self._clock.is_over:
            tree, other = trees[grown], trees[1 - grown]
            target = other.q[generator.integers(other.size)]
            if generator.random() < _RANDOM:
                target = pin.randomConfiguration(self._flow.reduced.robot.model, *self._box)
            if self._extended(tree, target, generator):
                apart = self._distances(other.q, tree.q[-1])
                meeting = int(np.argmin(apart))
                if not grown:
                    self._note(tree.q[-1])
                if apart[meeting] < _NEAR:
                    places = (meeting, tree.size - 1) if grown else (tree.size - 1, meeting)
                    found = self._joined(trees, places)
                    if found is not None:
                        return found
            grown = 1 - grown
        return None

    def _directions(self, goal: Array) -> Float[Array, "k d"]:
        """Orthonormal directions that brackets reach at a goal: rows may keep other combinations of positions."""
        return np.asarray(scipy.linalg.orth(filtration(self._flow.reduced, goal).closure[self._planned], rcond=1e-9))

    def _distances(self, q: Array, target: Array) -> Float[Array, " n"]:
        away = self._flow.manifold.difference(q, np.broadcast_to(target, q.shape))
        return np.linalg.norm(self._weights * away, axis=1)

    def _note(self, q: Array) -> None:
        distance = float(self._distances(self._goals, q).min())
        if distance < self.nearest.distance:
            self.nearest = Nearest(distance, np.array(q))

    def _extended(self, tree: _Tree, target: Array, generator: np.random.Generator) -> bool:
        """True if a tree has a new node, nearer to a target."""
        parent = int(np.argmin(self._distances(tree.q, target) + tree.away[: tree.size]))
        inputs = self._drawn(tree.q[parent], generator)
        q = [np.repeat(tree.q[parent][None], len(inputs), axis=0)]
        for k in range(inputs.shape[1]):
            for _ in range(_COARSE):
                q.append(self._flow.coarse_step(q[-1], inputs[:, k] / _COARSE))
        motions = np.stack(q, axis=1)
        inside = np.flatnonzero(self._within(motions))
        order = np.argsort(self._distances(motions[inside, -1], target), kind="stable")
        for k in inside[order[:3]]:
            self.edges += 1
            if self._clear(motions[k, 1:]):
                tree.add(motions[k, -1], parent, inputs[k])
                tree.away[parent] += _MADE
                return True
        tree.away[parent] += _TRIED
        return False

    def _drawn(self, q: Array, generator: np.random.Generator) -> Float[Array, "n 2 r"]:
        """Random displacements of the reduced coordinates: half of them of one coordinate only at a time."""
        r = self._flow.reduced.r
        inputs = generator.normal(size=(_CHOICES, 2, r))
        single = np.eye(r)[generator.integers(0, r, (_CHOICES // 2, 2))]
        inputs[: _CHOICES // 2] = single * generator.choice([-1.0, 1.0], (_CHOICES // 2, 2, 1))
        size = np.abs(inputs @ self._flow.reduced.at(q).R.T).max(axis=2, keepdims=True)
        return inputs / np.maximum(size, 1e-12) * generator.uniform(0.1, 1.0, size.shape) * _LONGEST

    def _within(self, q: Float[Array, "*n k nq"]) -> Bool[Array, "*n"]:
        """True for motions within the position limits."""
        return np.asarray(((q >= self._low - 1e-9) & (q <= self._high + 1e-9)).all(axis=(-2, -1)))

    def _clear(self, q: Float[Array, "k nq"]) -> bool:
        """True if configurations are far enough from all obstacles; the last ones are looked at first."""
        return self._checker is None or all(self._checker.violation(each) is None for each in q[::-2])

    # ------------------------------------------------------------------ exact paths

    def _joined(self, trees: list[_Tree], places: tuple[int, int]) -> ExactMotion | None:
        """Free motion through nodes of both trees that are near each other."""
        _, first = trees[0].path(places[0])
        goal, second = trees[1].path(places[1])
        edges = [*first, *(-each[::-1] for each in reversed(second))]
        if not edges:
            return None
        self._goal, self._open = self._goals[goal], self._reachable[goal]
        self._inputs = np.concatenate(edges)
        return self._exact(self._inputs)

    def _exact(self, inputs: Float[Array, "k r"], shorter: float = 0.0) -> ExactMotion | None:
        """Free motion from the start to the goal near inputs; None if Newton's method finds none.

        Args:
            inputs: displacements of the reduced coordinates.
            shorter: share by which the inputs become smaller, as far as the goal allows.
        """
        inputs, last = np.array(inputs), np.inf
        for iteration in range(_NEWTON):
            found = self._flow.sensitivity(self._start, np.repeat(inputs / _COARSE, _COARSE, axis=0))
            J = found.end.reshape(len(self._planned), len(inputs), _COARSE, -1).mean(axis=2)
            J = self._open.T @ J.reshape(len(self._planned), -1)[self._planned]
            missed = self._open.T @ self._missed(found.q[-1])
            size = np.abs(missed).max()
            if not size < 5.0 or (iteration > 3 and size > 0.5 * last):
                return None
            last = size
            if size < 1e-6 and iteration:
                break
            share = shorter if not iteration else 0.0
            wanted = missed * min(1.0, 0.5 / max(size, 1e-300)) + share * J @ inputs.ravel()
            change = np.linalg.lstsq(J, wanted, rcond=1e-8)[0] - share * inputs.ravel()
            inputs += change.reshape(inputs.shape)
        else:
            return None
        if not self._within(found.q) or not self._clear(found.q):
            return None
        moved = np.abs(self._flow.manifold.difference(found.q[:-1], found.q[1:])).max(axis=1)
        lengths = moved.reshape(-1, _COARSE).max(axis=1) * _COARSE
        return self._refined(inputs, J, np.maximum(np.ceil(lengths / _FINE), 1).astype(int))

    def _missed(self, q: Array) -> Float[Array, " k"]:
        return self._flow.manifold.difference(q[None], self._goal[None])[0, self._planned]

    def _refined(self, inputs: Float[Array, "k r"], J: Array, counts: Int[Array, " k"]) -> ExactMotion | None:
        """Free motion in fine steps, which ends at the goal exactly; J is the derivative of a coarse one."""
        last = np.inf
        for _ in range(_CHORD):
            steps = np.repeat(inputs / counts[:, None], counts, axis=0)
            q = self._flow.along(self._start, steps)
            missed = self._missed(q[-1])
            if np.abs(missed).max() < _EXACT:
                break
            missed = self._open.T @ missed
            size = np.abs(missed).max()
            if not size < last:
                return None
            last = size
            inputs = inputs + np.linalg.lstsq(J, missed, rcond=1e-8)[0].reshape(inputs.shape)
        else:
            return None
        self.edges += 1
        motion = ExactMotion(q, np.asarray(self._flow.reduced.at(q[:-1], steps).v))
        if not self._within(q) or not self._is_free(motion, steps):
            return None
        self._inputs = inputs
        return motion

    def _is_free(self, motion: ExactMotion, steps: Array) -> bool:
        """True if the geodesics between nodes are free, and the motion is near them."""
        if self._checker is None:
            return True
        manifold = self._flow.manifold
        straight = manifold.integrate(motion.q[:-1], 0.5 * manifold.difference(motion.q[:-1], motion.q[1:]))
        away = manifold.difference(straight, self._flow.step(motion.q[:-1], 0.5 * steps))
        return self._reach * np.abs(away).sum(axis=1).max() < DEVIATION and self._checker.is_free(motion)

    # ------------------------------------------------------------------ shorter ways

    def durations(self, steps: Float[Array, "k nv"]) -> Float[Array, " k"]:
        """Durations (k,) of displacements at the largest speeds [s]."""
        return (np.abs(steps) / self._speeds).max(axis=1, initial=0.0)

    def shortened(self, motion: ExactMotion, tries: int) -> ExactMotion:
        """The same or a faster motion: smaller inputs that lead to the same goal, as long as this helps.

        Args:
            motion: the motion that was found last.
            tries: largest number of attempts.
        """
        share = 0.4
        for _ in range(tries):
            if self._clock.is_over or share < _FADED:
                break
            kept = self._inputs
            found = self._exact(kept, share)
            if found is not None and self.durations(found.steps).sum() < 0.99 * self.durations(motion.steps).sum():
                motion = found
            else:
                self._inputs = kept
                share /= 2
        return motion
