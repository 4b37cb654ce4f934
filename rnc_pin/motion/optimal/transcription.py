"""Direct multiple shooting: an optimal control problem over nodes, its values and its linearization.

Free duration: it is a constant last entry of the state, which an input of a first stage without motion sets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.motion.optimal.bounds import DISTANCE, GoalRows, NodeBound
from rnc_pin.motion.optimal.costs import BoundCost, NodeData
from rnc_pin.motion.optimal.interior_point import LinearQuadratic, RiccatiFactors
from rnc_pin.motion.planning.action_models import ActionModel, Nodes, StepDerivatives

_LEAST = 1e-12
_GOAL, _BOUND = 1e2, 1e6
"""Weights of the goal and of active bounds of inputs in the feedback, relative to the cost of typical inputs."""
_ACTIVE = 1e-3  # distance from a limit that counts as active, in typical sizes


class Iterate(NamedTuple):
    """Motion over K intervals."""

    q: Float[Array, "K1 nq"]
    w: Float[Array, "K1 nw"]
    u: Float[Array, "K nu"]
    duration: float


class Values(NamedTuple):
    """Values of a problem at an iterate."""

    cost: float
    gaps: Float[Array, "K nx"]
    rows: Float[Array, "K1 k"]
    """Values of the bounded rows of each node."""


class Violation(NamedTuple):
    """Largest violation of a constraint."""

    amount: float
    name: str
    time: float


@dataclass(eq=False)
class Transcription:
    """Optimal control problem over K intervals of equal length with constant inputs.

    Args:
        model: action model.
        start: initial state, one node.
        K: number of intervals.
        costs, bounds: bound costs and bounds.
        goal: rows that hold at the end; None without a hard goal.
        duration: (shortest, longest) [s]; free if these differ.
        time_weight: cost of the duration [1/s].
        begin: time of the first node [s], for references and obstacles that move.
        reserve: share of the bounded ranges of outputs and velocities that the motion keeps free.
        margins: amounts at every node (K + 1,) by which rows are narrower, by title; "distance" for all distances.
    """

    model: ActionModel
    start: Nodes
    K: int
    costs: Sequence[BoundCost]
    bounds: Sequence[NodeBound]
    goal: NodeBound | None
    duration: tuple[float, float]
    time_weight: float = 0.0
    begin: float = 0.0
    reserve: float = 0.0
    margins: dict[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        K, goal = self.K, self.goal
        self.running = [each for each in self.costs if each.running]
        self.terminal = [each for each in self.costs if each.terminal]
        self.free = self.duration[1] > self.duration[0]
        blocks = [*self.bounds, *([] if goal is None else [goal])]
        ends = np.cumsum([len(each.names) for each in blocks]).tolist()
        self.blocks = [(each, slice(a, b)) for each, a, b in zip(blocks, [0, *ends], ends, strict=False)]
        self.names = tuple(title for each in blocks for title in each.titles)
        self.lower = np.full((K + 1, len(self.names)), -np.inf)
        """Lower limits of the rows of every node (K + 1, k); infinite for rows that do not hold at a node."""
        self.upper = -self.lower
        for each, rows in self.blocks:
            # The goal holds at the end; the start cannot be moved, so that rows of its state would ask for nothing.
            nodes = slice(K, None) if each is goal else slice(1, None) if each.of_state else slice(0, K)
            self.lower[nodes, rows], self.upper[nodes, rows] = each.lower, each.upper
        self._keep_reserve()
        for each, rows in self.blocks:
            for row, title in enumerate(each.titles, rows.start):
                margin = self.margins.get(DISTANCE if each.quantity == DISTANCE else title, 0.0)
                self.lower[:, row] += margin
                self.upper[:, row] -= margin

    def changed(self, **new: Any) -> Transcription:
        """Return the same problem with other arguments."""
        kept = self.margins if new.get("K", self.K) == self.K else {}  # margins belong to the nodes of a grid
        return replace(self, **{"margins": kept, **new})

    def _keep_reserve(self) -> None:
        """Narrow the limits of outputs and velocities, as far as the start and the goal are within."""
        nodes = NodeData(self.model, self.start, None, np.full(1, self.begin))
        # By the range of an output, and by the size of a velocity: zero is inside the limits of a velocity.
        for each, rows in self.blocks if self.reserve else ():
            if each.quantity not in ("output", "velocity", *(("input",) if self.model.form == "kinematic" else ())):
                continue  # saturation keeps accelerations and efforts
            span = each.upper - each.lower
            widths = (span, span) if each.quantity == "output" else (np.abs(each.lower), np.abs(each.upper))
            low, high = (np.where(np.isfinite(width), self.reserve * width, 0.0) for width in widths)
            ends = [each.rows(nodes, False).value[0]] if each.of_state else []
            if isinstance(self.goal, GoalRows) and each.quantity == "output":
                reached = self.goal.values_of(each)
                ends.append(np.array([reached.get(name, np.nan) for name in each.names]))
            # No node keeps more than the start and the goal do: the problem would have no solution. NaN is no end.
            for values in ends:
                low = np.fmax(np.fmin(low, values - each.lower), 0.0)
                high = np.fmax(np.fmin(high, each.upper - values), 0.0)
            self.lower[:, rows] += low
            self.upper[:, rows] -= high

    @property
    def limits(self) -> tuple[tuple[str, str, float, float], ...]:
        """Bounds of inputs, velocities and outputs: quantity, name, smallest and largest value."""
        return tuple(
            (bound.quantity, name, float(low), float(high))
            for bound in self.bounds
            for name, low, high in zip(bound.names, bound.lower, bound.upper, strict=True)
            if bound.quantity in ("input", "velocity", "output")
        )

    def times(self, duration: float) -> Array:
        """Times of the nodes (K + 1,) [s]."""
        return self.begin + np.linspace(0.0, duration, self.K + 1)

    # ------------------------------------------------------------------ values

    def from_start(self, guess: Iterate) -> Iterate:
        """Return a motion with the start of the problem as its first node."""
        q, w = self.start
        return guess._replace(q=np.concatenate([q, guess.q[1:]]), w=np.concatenate([w, guess.w[1:]]))

    def values(self, at: Iterate) -> Values:
        """Cost, gaps and bounded rows."""
        nodes, end = self._data(at)
        h = at.duration / self.K
        after = self.model.step(nodes.at, at.u, np.full(self.K, h))
        gaps = self.model.difference(Nodes(at.q[1:], at.w[1:]), after)
        cost = self.time_weight * at.duration
        for each in self.running:
            r = each.rows(nodes, False).value * each.root_weights(nodes.time)
            cost += 0.5 * h * float((r**2).sum())
        for each in self.terminal:
            cost += 0.5 * float(((each.rows(end, False).value * each.root_weights(end.time)) ** 2).sum())
        return Values(cost, gaps, self._rows(nodes, end, False)[0])

    def rows(self, at: Iterate) -> Float[Array, "K1 k"]:
        """Bounded rows at every node."""
        return self._rows(*self._data(at), False)[0]

    def _rows(self, nodes: NodeData, end: NodeData, derivatives: bool) -> tuple[Array, Array]:
        """Rows of every node, and their derivatives by (x, u), if they are wanted."""
        values = np.zeros(self.lower.shape)
        G = np.zeros((*values.shape, self.model.nx + self.model.nu))
        for data, at in ((nodes, slice(None, -1)), (end, slice(-1, None))):
            # The goal holds at the end alone. Rows of inputs hold before it: the last state has none.
            for block, where in self.blocks:
                if block.of_state if data is end else block is not self.goal:
                    found = block.rows(data, derivatives)
                    values[at, where] = found.value
                    if derivatives:
                        G[at, where] = found.J
        return values, G

    def excess(self, values: Values) -> Float[Array, "K1 k"]:
        """Amounts by which the rows are beyond their limits."""
        return np.maximum(0.0, np.maximum(self.lower - values.rows, values.rows - self.upper))

    def worst(self, values: Values, duration: float) -> Violation:
        """Largest violation of a bound, of the goal, or of the dynamics."""
        found, times, amounts = Violation(0.0, "", 0.0), self.times(duration), self.excess(values)
        if amounts.size and amounts.max() > 0:
            k, row = divmod(int(amounts.argmax()), amounts.shape[1])
            found = Violation(float(amounts[k, row]), self.names[row], float(times[k]))
        # Gaps are violations of the dynamics, in the units of the state.
        gaps = np.abs(values.gaps).max(axis=1)
        if gaps.max(initial=0.0) > found.amount:
            k = int(gaps.argmax())
            found = Violation(float(gaps[k]), "dynamics (gap between intervals)", float(times[k + 1]))
        return found

    def _data(self, at: Iterate, derivatives: StepDerivatives | None = None) -> tuple[NodeData, NodeData]:
        times = self.times(at.duration)
        flow = None if derivatives is None else derivatives.flow
        nodes = NodeData(self.model, Nodes(at.q[:-1], at.w[:-1]), at.u, times[:-1], flow)
        return nodes, NodeData(self.model, Nodes(at.q[-1:], at.w[-1:]), None, times[-1:])

    # ------------------------------------------------------------------ linearization

    def linearize(self, at: Iterate) -> tuple[LinearQuadratic, Values]:
        """Return the subproblem and the values at an iterate; all nodes are evaluated in one block."""
        K, h = self.K, at.duration / self.K
        steps = self.model.step_derivatives(Nodes(at.q[:-1], at.w[:-1]), at.u, np.full(K, h))
        nodes, end = self._data(at, steps)
        gaps = self.model.difference(Nodes(at.q[1:], at.w[1:]), steps.after)
        cost, H, g, H_end, g_end = self._costs(nodes, end, at.duration)
        rows, G = self._rows(nodes, end, True)
        limits = (self.lower - rows, self.upper - rows)
        holding, rates = np.zeros(steps.u.mT.shape), slice(self.model.nv, None)
        if self.model.form == "dynamic":
            # Efforts that keep the velocity although the state deviates: without them, damping and typical sizes would
            # count what gravity needs, and the sizes of an unstable motion would grow from stage to stage.
            holding = -np.linalg.pinv(steps.u[:, rates]) @ (steps.x - np.eye(self.model.nx))[:, rates]
        AB = np.concatenate([steps.x, steps.u], axis=2)
        problem = LinearQuadratic(AB, gaps, H, g, H_end, g_end, G, *limits, holding)
        values = Values(cost, gaps, rows)
        return (self._with_duration(problem, steps.h / K, at) if self.free else problem), values

    def _costs(self, nodes: NodeData, end: NodeData, duration: float) -> tuple[float, Array, Array, Array, Array]:
        """Cost, and Gauss-Newton Hessians and gradients by (x, u[, duration])."""
        nx = self.model.nx
        r, J = self._residuals(self.running, nodes, np.sqrt(duration / self.K))
        if self.free:  # sqrt(h) r depends on the duration
            J = np.concatenate([J, (r / (2 * duration))[:, :, None]], axis=2)
        r_end, J_end = self._residuals(self.terminal, end)
        r_end, x_end = r_end[0], J_end[0, :, :nx]
        cost = 0.5 * float((r**2).sum()) + self.time_weight * duration + 0.5 * float((r_end**2).sum())
        return cost, J.mT @ J, np.matvec(J.mT, r), x_end.T @ x_end, x_end.T @ r_end

    def _residuals(self, costs: Sequence[BoundCost], nodes: NodeData, root: float = 1.0) -> tuple[Array, Array]:
        """Weighted residuals (n, k) and their derivatives (n, k, nx + nu)."""
        r, J = [np.empty((nodes.size, 0))], [np.empty((nodes.size, 0, self.model.nx + self.model.nu))]
        for each in costs:
            found, roots = each.rows(nodes, True), root * each.root_weights(nodes.time)
            r.append(roots * found.value)
            assert found.J is not None
            J.append(roots[:, :, None] * found.J)
        return np.concatenate(r, axis=1), np.concatenate(J, axis=1)

    def _with_duration(self, problem: LinearQuadratic, by_duration: Array, at: Iterate) -> LinearQuadratic:
        """Add the duration to the state, and a first stage whose only motion is its change."""
        nx, nz = problem.AB.shape[1:]
        AB = np.pad(np.insert(problem.AB, [nx], by_duration[:, :, None], axis=2), ((1, 0), (0, 1), (0, 0)))
        AB[:, nx, nx] = 1.0
        order = np.r_[0:nx, nz, nx:nz]  # costs have the duration last
        H = np.zeros((self.K + 1, nz + 1, nz + 1))
        H[1:] = problem.H[:, order][:, :, order]
        g, gap = np.pad(problem.g[:, order], ((1, 0), (0, 0))), np.pad(problem.gap, ((1, 0), (0, 1)))
        usual = np.einsum("nii->ni", problem.H)[:, nx:nz].mean(axis=0)
        usual = np.maximum(usual, max(1e-6 * float(usual.max()), _LEAST))
        H[0, nx + 1 :, nx + 1 :] = np.diag(usual)
        # All but the first input of this stage do nothing; with the usual weights, all stages have the same scales. The
        # first one is in units in which its weight is the curvature of the cost by the duration.
        curvature = float(problem.H[:, -1, -1].sum()) + self.time_weight / at.duration
        unit = float(np.sqrt(usual[0] / curvature)) if curvature > _LEAST else 1.0
        G = np.pad(np.insert(problem.G, nx, 0.0, axis=2), ((1, 0), (0, 1), (0, 0)))
        AB[0, nx, nx + 1], g[0, nx + 1], G[0, -1, nx + 1] = unit, self.time_weight * unit, unit
        lower = np.pad(problem.lower, ((1, 0), (0, 1)), constant_values=-np.inf)
        upper = np.pad(problem.upper, ((1, 0), (0, 1)), constant_values=np.inf)
        lower[0, -1], upper[0, -1] = self.duration[0] - at.duration, self.duration[1] - at.duration
        H_end = np.pad(problem.H_end, (0, 1))
        holding = np.pad(problem.holding, ((1, 0), (0, 0), (0, 1)))
        return LinearQuadratic(AB, gap, H, g, H_end, np.append(problem.g_end, 0.0), G, lower, upper, holding)

    # ------------------------------------------------------------------ feedback

    def feedback_gains(self, at: Iterate, linear: LinearQuadratic | None = None) -> Float[Array, "K nu nx"]:
        """Gains of ``u + K dx`` about a motion, from the Riccati recursion with the costs of the problem.

        Deviations at the goal have a finite weight. Inputs at a bound have none to give: their feedback vanishes.

        Args:
            at: the motion.
            linear: linearization at the motion, if it is known; that of a free duration is of no use.
        """
        if linear is None or self.free:
            linear, _ = self.changed(duration=(at.duration, at.duration)).linearize(at)
        return gains_of(linear, np.minimum(linear.upper, -linear.lower))

    def moved(self, at: Iterate, x: Array, u: Array, length: float) -> Iterate:
        """Iterate after a part of a direction of the subproblem."""
        duration = at.duration
        if self.free:
            # Rounding of the subproblem may pass the limits of the duration, which have no tolerance.
            duration = float(np.clip(duration + length * x[1, -1], *self.duration))
            x, u = x[1:, :-1], u[1:]
        states = self.model.displaced(Nodes(at.q, at.w), length * x)
        return Iterate(states.q, states.w, at.u + length * u, duration)

    def closed(self, at: Iterate, linear: LinearQuadratic) -> Iterate:
        """Motion in the dynamic form whose inputs close the gaps of velocities, as far as inputs can.

        Args:
            at: the motion.
            linear: linearization near it.
        """
        nv, nx, K = self.model.nv, self.model.nx, self.K
        if self.model.form == "dynamic":
            # Inputs move velocities directly, and configurations by half a step: gaps of these are left to the solver.
            by_velocity = np.linalg.pinv(linear.AB[-K:, nv:nx, -self.model.nu :])
            closings = 2  # Newton steps: the gap of a second one is of fourth order
            for _ in range(closings):
                after = self.model.step(Nodes(at.q[:-1], at.w[:-1]), at.u, np.full(K, at.duration / K))
                at = at._replace(u=at.u + np.matvec(by_velocity, at.w[1:] - after.w))
        return at


def gains_of(linear: LinearQuadratic, room: Float[Array, "N1 k"]) -> Float[Array, "N nu nx"]:
    """Gains of the feedback of a linearization, and the distances of its rows from their limits."""
    nx, inputs, sizes = linear.AB.shape[1], linear.input_scales, linear.typical_sizes
    # Some cost for inputs without a weight: else their feedback would be infinite.
    H = linear.scaled_hessian(1e-6)
    active = ((room / sizes)[:-1] < _ACTIVE)[:, :, None]
    of_input = active * linear.G[:-1, :, nx:] * inputs / sizes[:-1, :, None]
    H[:, nx:, nx:] += _BOUND * of_input.mT @ of_input
    # Rows with one value at the end are the goal.
    equal = linear.lower[-1] == linear.upper[-1]
    C = linear.G[-1, equal, :nx] / sizes[-1, equal, None]
    factors = RiccatiFactors(linear.scaled_dynamics, H, linear.H_end + _GOAL * C.T @ C)
    return inputs[:, None] * factors.K
