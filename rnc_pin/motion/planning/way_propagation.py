"""Search for a way of a system without a known steering: two trees of propagated motions, joined by Newton's method.

Both trees grow from the start and from the goals by random inputs of the kinematic form ``v = R(q) u``. Where they are
near each other, Newton's method changes all inputs of the path through both, until it ends at the goal. Motions without
rows over time can be driven backwards, so that the tree of the goals is followed from its leaves to its root.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.analysis.growth import filtration, grow
from rnc_pin.array_shapes import Array, Bool, Float, Int
from rnc_pin.motion.planning.action_models import KinematicFlow, Shots
from rnc_pin.motion.planning.exact_steering import ExactMotion, base_axes
from rnc_pin.motion.planning.way import drive_times
from rnc_pin.motion.planning.way_search import WayTask
from rnc_pin.robots.joint_values import limited_positions

DEVIATION = 5e-4
"""Largest distance [m] between a motion and the geodesics between its nodes, which are checked for collisions."""

_LONGEST = 1.0  # [m or rad] of a propagated motion; each edge has two
_COARSE, _FINE = 5, 0.01  # steps of a motion in the search, and length of the steps of a way [m or rad]
_CHOICES = 24  # random motions of which the one that ends nearest to the target is taken
_NEAR = 0.6  # [m]; trees that are nearer are joined
_MADE, _TRIED = 0.05, 0.3  # [m]; nodes with children, and those without a free motion, count as farther away
_NEWTON, _CHORD = 12, 12  # largest numbers of iterations
_EXACT, _END = 1e-11, 3e-10  # [m or rad] largest errors where motions follow each other, and at the goal
_LOOSE = 100.0  # weight of the inputs beside that of the nodes, when ways are made shorter


class _Tree:
    """Configurations, the inputs that lead to them, and their parents.

    Args:
        roots: configurations (n, nq).
    """

    def __init__(self, roots: Float[Array, "n nq"]) -> None:
        self.q, self.away = np.array(roots), np.zeros(len(roots))
        self._parents, self._edges = [-1] * len(roots), [(np.empty((0, 0)), np.empty((0, 0)))] * len(roots)

    def add(self, motion: Float[Array, "k nq"], parent: int, inputs: Array) -> None:
        """Add the end of a motion; ``inputs`` (2, r) lead to its middle and from there to its end."""
        self.q, self.away = np.concatenate([self.q, motion[-1:]]), np.append(self.away, 0.0)
        self._parents.append(parent)
        self._edges.append((motion[[len(motion) // 2, -1]], inputs))

    def path(self, node: int) -> tuple[int, Float[Array, "n nq"], list[Array]]:
        """Root of a node, and the configurations and inputs that lead from it to the node."""
        q, inputs = [], []
        while self._parents[node] >= 0:
            places, moved = self._edges[node]
            q.append(places)
            inputs.append(moved)
            node = self._parents[node]
        return node, np.concatenate([self.q[node : node + 1], *q[::-1]]), inputs[::-1]


class PropagatedSearch:
    """Search between configurations, and shortening of what it finds.

    Args:
        task: start, goals, and what the search may take. The clearance of its checker contains ``DEVIATION``.

    Attributes:
        nearest: configuration that was reached from the start so far.
    """

    def __init__(self, task: WayTask) -> None:
        self._flow, self._task = KinematicFlow(task.reduced), task
        self._planned, self._checker = task.planned, task.checker
        model = task.reduced.robot.model
        self._limits = limited_positions(task.reduced.robot, None)
        joints = 0.5  # [m]; metric: joints count as a path of this length for 1 rad
        self._weights = np.where(task.planned, joints, 0.0)  # a wheel that follows is as near at any angle
        self._box = task.start + np.array([[-np.pi], [np.pi]])
        self._box[:, self._limits.q] = self._limits.lower, self._limits.upper
        if size := base_axes(model):
            self._weights[: model.joints[1].nv] = 1.0
            self._box[:, :size] = task.area[:, :size]
        self._reach = 0.0
        if task.checker is not None:
            distances = task.checker.distances
            self._reach = max(1.0, 2.0 * float(distances.radii[: distances.link_shapes].sum()))
        self._reachable = [self._directions(goal) for goal in task.goals]
        self.nearest, self._nearest_distance = task.start, np.inf

    def direct(self) -> None:
        """Return None: every motion needs a search."""

    def run(self, held: Sequence[str], most: int, seed: int) -> ExactMotion | None:
        """Search for a way until the time is up; None if none is found.

        Args:
            held, most: no effect; as for ``WaySearch``.
            seed: seed of all random choices.
        """
        generator = np.random.default_rng(seed)
        pin.seed(seed)
        trees = [_Tree(self._task.start[None]), _Tree(self._task.goals)]
        grown = 0
        while not self._task.budget.is_over:
            tree, other = trees[grown], trees[1 - grown]
            # Towards the other tree for the rest: both have to meet.
            target = other.q[generator.integers(len(other.q))]
            random = 0.6  # share of targets that are random; others are places of the other tree
            if generator.random() < random:
                target = pin.randomConfiguration(self._flow.reduced.robot.model, *self._box)
            if self._extended(tree, target, generator):
                apart = self._distances(other.q, tree.q[-1])
                meeting = int(np.argmin(apart))
                if not grown:
                    self._note(tree.q[-1])
                if apart[meeting] < _NEAR:
                    new = len(tree.q) - 1
                    places = (meeting, new) if grown else (new, meeting)
                    found = self._joined(trees, places)
                    if found is not None:
                        return found
            grown = 1 - grown
        return None

    def _directions(self, goal: Array) -> Float[Array, "k d"]:
        """Orthonormal directions that brackets reach at a goal: rows may keep other combinations of positions."""
        reduced, rows = self._flow.reduced, self._planned
        if np.linalg.matrix_rank(grow(reduced, goal).closure[rows], rtol=1e-9) == rows.sum():
            return np.eye(rows.sum())  # further brackets are for joints that follow
        return np.asarray(scipy.linalg.orth(filtration(reduced, goal).closure[rows], rcond=1e-9))

    def _distances(self, q: Array, target: Array) -> Float[Array, " n"]:
        away = self._flow.manifold.difference(q, np.broadcast_to(target, q.shape))
        return np.linalg.norm(self._weights * away, axis=1)

    def _note(self, q: Array) -> None:
        distance = float(self._distances(self._task.goals, q).min())
        if distance < self._nearest_distance:
            self.nearest, self._nearest_distance = np.array(q), distance

    def _extended(self, tree: _Tree, target: Array, generator: np.random.Generator) -> bool:
        """True if a tree has a new node, nearer to a target."""
        # Nodes that have been tried count as farther, or a node at a wall would be tried for ever.
        parent = int(np.argmin(self._distances(tree.q, target) + tree.away))
        inputs = self._drawn(tree.q[parent], generator)
        starts = np.repeat(tree.q[parent][None], len(inputs), axis=0)
        motions = self._flow.coarse(starts, np.repeat(inputs / _COARSE, _COARSE, axis=1))
        inside = np.flatnonzero(self._within(motions))
        order = np.argsort(self._distances(motions[inside, -1], target), kind="stable")
        for k in inside[order[:3]]:  # each costs a check of distances
            self._task.budget.motions += 1
            if self._clear(motions[k, 1:]):
                tree.add(motions[k], parent, inputs[k])
                tree.away[parent] += _MADE
                return True
        tree.away[parent] += _TRIED
        return False

    def _drawn(self, q: Array, generator: np.random.Generator) -> Float[Array, "n 2 r"]:
        """Random displacements of the reduced coordinates: half of them of one coordinate only at a time."""
        r = self._flow.reduced.r
        inputs = generator.normal(size=(_CHOICES, 2, r))
        single = np.eye(r)[generator.integers(0, r, (_CHOICES // 2, 2))]
        # Half of them along one coordinate: a bracket is a sequence of such motions.
        inputs[: _CHOICES // 2] = single * generator.choice([-1.0, 1.0], (_CHOICES // 2, 2, 1))
        size = np.abs(inputs @ self._flow.reduced.at(q).R.T).max(axis=2, keepdims=True)
        return inputs / np.maximum(size, 1e-12) * generator.uniform(0.1, 1.0, size.shape) * _LONGEST

    def _within(self, q: Float[Array, "*n k nq"]) -> Bool[Array, "*n"]:
        """True for motions within the position limits."""
        own, limits = q[..., self._limits.q], self._limits
        return np.asarray(((own >= limits.lower - 1e-9) & (own <= limits.upper + 1e-9)).all(axis=(-2, -1)))

    def _clear(self, q: Float[Array, "k nq"]) -> bool:
        """True if configurations are far enough from all obstacles; the last ones are looked at first."""
        return self._checker is None or all(self._checker.violation(each) is None for each in q[::-2])

    # ------------------------------------------------------------------ exact paths

    def _joined(self, trees: list[_Tree], places: tuple[int, int]) -> ExactMotion | None:
        """Free motion through nodes of both trees that are near each other."""
        _, before, first = trees[0].path(places[0])
        goal, after, second = trees[1].path(places[1])
        # The tree of the goal grew from it: its motions are driven backwards, in reversed order.
        edges = [*first, *(-each[::-1] for each in reversed(second))]
        if not edges:
            return None
        self._goal, self._open = self._task.goals[goal], self._reachable[goal]
        nodes = np.concatenate([before, after[-2::-1]])
        nodes[-1] = self._goal
        return self._exact(nodes, np.concatenate(edges))

    def _exact(
        self, nodes: Float[Array, "n nq"], inputs: Float[Array, "k r"], shorter: float = 0.0
    ) -> ExactMotion | None:
        """Free motion from the start to the goal near a path; None if Newton's method finds none."""
        try:
            return self._shot(nodes, inputs, shorter)
        except np.linalg.LinAlgError:  # its equations are singular, as along a straight trailer
            return None

    def _shot(self, nodes: Float[Array, "n nq"], inputs: Float[Array, "k r"], shorter: float) -> ExactMotion | None:
        """Free motion by multiple shooting; None if Newton's method does not converge.

        The nodes are unknowns too (multiple shooting): a change stays near its place, also where motions are unstable,
        as those of trailers that are pushed.

        Args:
            nodes: configurations between the inputs.
            inputs: displacements of the reduced coordinates.
            shorter: share by which the inputs become smaller, as far as the goal allows.
        """
        nodes, inputs, last = np.array(nodes), np.array(inputs), np.inf
        loose = _LOOSE if shorter else 1.0
        for iteration in range(_NEWTON):
            shots = self._flow.shots(nodes[:-1], inputs, _COARSE)
            missed = self._missed(shots.q[-1], nodes[1:])
            size = np.abs(missed).max()
            # Where the error is not halved after a few iterations, the equations are too nonlinear: another pair of
            # nodes costs less.
            if not size < 5.0 or (iteration > 3 and size > 0.5 * last):
                return None
            last = size
            if size < 1e-6 and iteration:
                break
            wanted = -shorter * inputs if not iteration else np.zeros_like(inputs)
            self._change(nodes, inputs, shots, missed * min(1.0, 0.5 / max(size, 1e-300)), wanted, loose)
        else:
            return None
        # Coarse motions are looked at first: a fine one takes many evaluations of the rows.
        q = np.swapaxes(shots.q, 0, 1)
        if not self._within(q).all() or not self._clear(q[:, 1:].reshape(-1, q.shape[-1])):
            return None
        moved = self._flow.manifold.difference(q[:, :-1].reshape(-1, q.shape[-1]), q[:, 1:].reshape(-1, q.shape[-1]))
        lengths = np.abs(moved).max(axis=1).reshape(len(q), _COARSE).max(axis=1) * _COARSE
        return self._refined(nodes, inputs, shots, np.maximum(np.ceil(lengths / _FINE), 1).astype(int))

    def _missed(self, ends: Float[Array, "k nq"], q: Float[Array, "k nq"]) -> Float[Array, "k n"]:
        """Differences from ends to configurations, in the planned coordinates."""
        return self._flow.manifold.difference(ends, q)[:, self._planned]

    def _change(
        self, nodes: Array, inputs: Array, shots: Shots, missed: Float[Array, "k n"], wanted: Array, loose: float
    ) -> None:
        """Change nodes and inputs, so that the shots meet the nodes to first order.

        The change is the one with the least ``|du - wanted|^2 + |dq|^2 / loose``. Its conditions are block tridiagonal.
        """
        A, B = shots.by_start[:, self._planned][:, :, self._planned], shots.by_input[:, self._planned]
        AT, BT = A.transpose(0, 2, 1), B.transpose(0, 2, 1)
        free = np.eye(A.shape[1]) - self._open @ self._open.T  # directions in which rows keep the end
        # Conditions of the least change: multipliers of neighbouring shots couple through the node between them.
        diagonal = B @ BT + loose * np.eye(A.shape[1])
        diagonal[1:] += loose * A[1:] @ AT[1:]
        diagonal[-1] += free - loose * np.eye(A.shape[1])
        rest = missed - (B @ wanted[:, :, None])[:, :, 0]
        factors = scipy.linalg.solveh_banded(_banded(diagonal, -loose * AT[1:]), rest.ravel()).reshape(rest.shape)
        inputs += wanted + (BT @ factors[:, :, None])[:, :, 0]
        moved = np.zeros((len(A), len(self._planned)))
        moved[:-1, self._planned] = loose * ((AT[1:] @ factors[1:, :, None])[:, :, 0] - factors[:-1])
        moved[-1, self._planned] = -free @ factors[-1]
        nodes[1:] = self._flow.manifold.integrate(nodes[1:], moved)

    def _refined(
        self, nodes: Float[Array, "n nq"], inputs: Float[Array, "k r"], shots: Shots, counts: Int[Array, " k"]
    ) -> ExactMotion | None:
        """Free motion in fine steps, which ends at the goal exactly; the derivatives are those of coarse shots."""
        last = np.inf
        for _ in range(_CHORD):
            pieces = self._flow.along(nodes[:-1], inputs, counts)
            missed = self._missed(np.array([piece[-1] for piece in pieces]), nodes[1:])
            size = np.abs(missed).max()
            if size < _EXACT:
                finer = self._finer(pieces, inputs, counts)
                # More steps change the motion a little: the end is corrected again, with the same derivatives.
                if (finer == counts).all():
                    break
                counts, last = finer, np.inf
                continue
            if not size < last:  # derivatives of the coarse motion no longer lead nearer
                return None
            last = size
            self._change(nodes, inputs, shots, missed, np.zeros_like(inputs), 1.0)
        else:
            return None
        q = self._with_followers(pieces)
        if np.abs(self._missed(q[-1:], self._goal[None])).max() > _END or not self._within(q):
            return None
        self._task.budget.motions += 1
        steps = self._flow.velocity(q[:-1], np.repeat(inputs / counts[:, None], counts, axis=0))
        motion = ExactMotion(q, steps, geodesic=False)
        if self._checker is not None and not self._checker.is_free(motion):
            return None
        self._nodes, self._inputs = nodes, inputs
        return motion

    def _finer(self, pieces: list[Array], inputs: Array, counts: Int[Array, " k"]) -> Int[Array, " k"]:
        """Numbers of steps with which the motions are near the geodesics between their configurations."""
        if self._checker is None:
            return counts
        manifold, places = self._flow.manifold, np.concatenate([piece[:-1] for piece in pieces])
        steps = manifold.difference(places, np.concatenate([piece[1:] for piece in pieces]))
        middles = self._flow.step(places, np.repeat(0.5 * inputs / counts[:, None], counts, axis=0))
        away = manifold.difference(manifold.integrate(places, 0.5 * steps), middles)
        farthest = np.maximum.reduceat(self._reach * np.abs(away).sum(axis=1), np.cumsum(counts) - counts)
        more = np.ceil(counts * np.sqrt(1.1 * farthest / DEVIATION)).astype(int)  # the deviation is of second order
        return np.where(farthest < DEVIATION, counts, more)

    def _with_followers(self, pieces: list[Array]) -> Float[Array, "n nq"]:
        """One sequence of configurations; joints that follow continue from piece to piece."""
        place, found = self._task.start, []
        for piece in pieces:
            away = self._flow.manifold.difference(piece[:1], place[None])
            away[:, self._planned] = 0.0
            moved = self._flow.manifold.integrate(piece, np.repeat(away, len(piece), axis=0))
            found.append(moved[:-1])
            place = moved[-1]
        return np.concatenate([*found, place[None]])

    # ------------------------------------------------------------------ shorter ways

    def shortened(self, motion: ExactMotion, tries: int, seed: int = 0) -> ExactMotion:
        """The same or a faster motion: smaller inputs that lead to the same goal, as long as this helps.

        Args:
            motion: the motion that was found last.
            tries: largest number of attempts.
            seed: no effect; as for ``WaySearch``.
        """
        share = 0.4
        for _ in range(tries):
            faded = 0.05  # share of the inputs below which shortening ends
            if self._task.budget.is_over or share < faded:
                break
            kept = self._nodes, self._inputs
            found = self._exact(*kept, share)
            times = [drive_times(each.steps, self._task.speeds).sum() for each in (motion, found) if each is not None]
            if found is not None and times[1] < 0.99 * times[0]:
                motion = found
            else:
                self._nodes, self._inputs = kept
                share /= 2
        return motion


def _banded(diagonal: Float[Array, "k n n"], beside: Float[Array, "k-1 n n"]) -> Float[Array, "b m"]:
    """Upper band of a symmetric block tridiagonal matrix, for ``scipy.linalg.solveh_banded``."""
    n = diagonal.shape[1]
    band = np.zeros((2 * n, len(diagonal) * n))
    for i in range(n):
        for j in range(n):
            if j >= i:
                band[2 * n - 1 + i - j, j::n] = diagonal[:, i, j]
            band[n - 1 + i - j, n + j :: n] = beside[:, i, j]
    return band
