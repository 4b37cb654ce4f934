"""Tasks of a program in reduced velocities, level by level: a lexicographic cascade of least squares within limits.

At each level, the rows J of its tasks are restricted to the null space Z of the levels above. In the coordinates of the
singular value decomposition of ``J Z`` the program has the identity as Hessian. So it needs no regularisation in the
directions that tasks determine, and without active limits its solution is that of linear equations.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin import _kernel
from rnc_pin.array_shapes import Array, Float, Int
from rnc_pin.errors import ConfigurationError
from rnc_pin.math.convex_programs import nearest_point
from rnc_pin.math.linear_algebra import as_slice, inverse
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.motion.whole_body.limit_stack import LimitStack, ProgramBounds
from rnc_pin.motion.whole_body.limits.control_limit import ControlSample
from rnc_pin.motion.whole_body.tasks import ControlTask, OutputsTogether
from rnc_pin.robots.joint_values import limited_positions

_SAMPLED_DAMPING = 2.0  # the inverse of the largest factor per sample
_RANK = 1e-8  # singular value, relative to the rows of the level, below which a direction is free
_NOTHING = 1e-100  # size of rows that do not act; squares of smaller singular values are zero in floating point
_FREE_COST = 1e-3  # cost of a direction that no task determines, relative to the least determined direction
_TOUCHING = 1e-12  # relative excess of a limit that is rounding
_EXCEEDED = 1e-8  # excess of a limit above which it gave way
_ROUNDING = 1e-12  # residual, relative to the rate, that is rounding
_SLOW = 0.2  # of the speed of lower levels at which a null space turns by half within a sample
_TOUCHES, _PUSHES = 1e-3, 0.1  # push of a limit, relative to the largest, from which it counts, and counts fully
_LEAST_SHARE = 1e-9  # of a direction that lower levels may use, below which they do not see it
_SECANT = 1e-6  # relative error of the damping
_ITERATIONS = 20  # of the damping of a level; four or five are enough
_WHEEL = 1e-3  # cost of the turns of a wheel, relative to those of other joints
_SAME = 1e-9  # change of constraint rows that is rounding


class MotionBasis(NamedTuple):
    """Unknowns u for reduced velocities v2: ``|u|`` is the size of a motion."""

    to_v2: Float[Array, "r r"]
    """v2 of unknowns."""
    of_v2: Float[Array, "r r"]
    """Unknowns of v2."""


class MotionMetric:
    """Size of a velocity v of the robot, whatever the reduced velocities are: ``|v|^2 = sum_i c_i^2 v_i^2``.

    c_i is 1 for rotations, and 1 / Lambda for translations, with the longest lever Lambda of a joint at full stretch.
    The turns of a wheel cost nearly nothing beside the motion of its base, since nothing depends on its angle.

    A task of positions x has rows whose column J_i is the lever of velocity i. Let Omega_j be the angular velocity of
    the link that joint j moves, Omega_p that of the link that carries the joint, and delta_j the velocity of x that the
    joint itself causes. At constant rates of the joints between x and the world,

        x'' = sum_j (Omega_p + Omega_j) x delta_j

    Let ``|n_j|`` be the size of the motion of joint j, and L_j the norm of the columns ``J_i / c_i`` of its velocities.
    Then ``|delta_j| <= L_j |n_j|``, and ``|Omega_j|`` is at most the sum of ``|n_i|`` over the joints that turn the
    link. So ``|rho . x''| <= |rho| sum_ij G_ij |n_i| |n_j|``, where G has ``G_jj = L_j`` if joint j turns, and
    ``G_ij = G_ji = L_j`` if joint i turns and carries joint j. The norm of G bounds its eigenvalues:

        |rho . x''| <= |rho| L |n|^2,    L^2 = sum_j w_j L_j^2

    with ``w_j`` = 2 for each joint that turns and carries joint j, and 1 more if it turns itself. For an orientation,
    x'' has Omega_p alone, and the bound holds. By the inequality of Cauchy and Schwarz, it holds for several frames
    together, each in all axes with one weight, and for centres of mass. Distances have a curvature of their own, and so
    have constraints whose motions change with the configuration in the coordinates of the joints.

    Args:
        reduced: the model.

    Attributes:
        scales: c of each velocity, (nv,).
        curvature: effects on L^2 of the square of the column of each velocity, (nv,).
    """

    def __init__(self, reduced: ReducedModel) -> None:
        robot, model, rows = reduced.robot, reduced.robot.model, reduced.all_constraints
        kinematics, limited = Kinematics(robot), limited_positions(robot, None)
        straight, joint_of = kinematics.position(robot.configuration()), np.repeat(np.arange(model.njoints), model.nvs)
        turns = np.array([straight.joint_jacobian(j)[3:, i].any() for i, j in enumerate(joint_of.tolist())], dtype=bool)
        chains, turning = np.zeros((model.njoints, model.njoints)), np.zeros(model.njoints)
        for joint, carriers in enumerate(model.supports):
            chains[joint, list(carriers)] = 1.0
        turning[joint_of[turns]] = 1.0
        turned = chains @ turning  # number of joints that turn a link
        carried = turned - turning > 0.0
        self.curvature = (2.0 * turned - turning)[joint_of]
        travel = np.zeros(reduced.n)
        travel[limited.v] = np.maximum(np.abs(limited.lower), np.abs(limited.upper))
        lengths = np.linalg.norm([each.translation for each in model.jointPlacements], axis=1)
        reach = chains @ (carried * (lengths + np.bincount(joint_of, travel * ~turns, model.njoints)))
        ends = [(each.parentJoint, float(np.linalg.norm(each.placement.translation))) for each in model.frames]
        longest = max((reach[joint] + offset for joint, offset in ends if turned[joint]), default=0.0)
        self.scales = np.where(turns, 1.0, 1.0 / (longest or 1.0))
        somewhere = kinematics.position(pin.integrate(model, robot.configuration(), np.cos(np.arange(reduced.n))))
        last = (chains.sum(axis=0) * np.bincount(joint_of, minlength=model.njoints) == 1.0)[joint_of]
        last[limited.v] = False
        # Constraint rows of a wheel are the same after a turn of it: nothing depends on its angle.
        for i in np.flatnonzero(last & turns & rows.jacobian(somewhere).any(axis=0)):
            if np.abs(rows.jacobian_dot(somewhere.with_velocity(np.eye(reduced.n)[i]))).max() < _SAME:
                self.scales[i] = _WHEEL
        self.curvature /= self.scales**2
        self._last: tuple[bytes, MotionBasis] | None = None

    def basis(self, R: Float[Array, "nv r"]) -> MotionBasis:
        """Return unknowns for the motions ``R v2``; the last ones if R has not changed."""
        # R of a fixed base is constant, and a factorization takes longer than a comparison.
        numbers, last = R.tobytes(), self._last
        if last is None or last[0] != numbers:
            of_v2 = np.asarray(np.linalg.qr(self.scales[:, None] * R, mode="r"))
            # A factorization leaves the signs open: unknowns must not change theirs between samples.
            of_v2 *= np.sign(of_v2.diagonal())[:, None]
            last = self._last = numbers, MotionBasis(np.ascontiguousarray(inverse(of_v2)), of_v2)
        return last[1]


class SampledDamping(NamedTuple):
    """Damping of tasks that do not attain their rates: without it, a sampled loop can oscillate between its limits.

    A level minimises ``|J v - rate|^2``. Where it leaves a residual rho, the gradient ``J^T rho`` turns with the
    configuration q: its slope is ``N = sum_i rho_i d^2 x_i / dq^2``. The program decides the velocity at the end of a
    sample, at the configuration that the velocity at the start predicts there. So one sample of duration h multiplies
    a velocity along a motion n by

        -h n^T N n / |J n|^2

    Where an arm is stretched towards a goal out of reach, ``|J n|`` vanishes and N does not. Below -1, the velocity
    changes its sign at every sample and grows up to a limit. With ``lambda |v|^2`` in the cost, the denominator is
    ``|J n|^2 + lambda |n|^2``. The unknowns of the program are chosen such that ``|n|`` is the size of a motion by
    ``MotionMetric``, which does not depend on the reduced velocities. It also has an L with
    ``|n^T N n| <= |rho| L |n|^2``. Therefore

        lambda = 2 h |rho(lambda)| L

    bounds the factor by 1/2. The residual depends on the damping itself. For one singular value sigma of J and the rate
    e along it, ``rho = lambda e / (sigma^2 + lambda)``, and the equation has the solution
    ``lambda = max(0, 2 h e L - sigma^2)``: continuous in sigma, and exactly zero near a goal in reach. In
    general it is the root of one increasing function. Levenberg-Marquardt methods of inverse kinematics damp by the
    residual likewise (T. Sugihara, IEEE Transactions on Robotics 27 (2011) 984-991), at every singular value;
    A. A. Maciejewski and C. A. Klein (International Journal of Robotics Research 8(6) (1989) 38-55) at small ones.
    """

    dt: float
    """Duration of the sample [s]."""
    levers: Float[Array, " levels"]
    """L of each level, from its curved rows."""
    curved: Float[Array, " k"]
    """One for rows whose Jacobian depends on the configuration; zero for constant ones, which have no slope N."""
    near: Sequence[float] = ()
    """Damping of each level in a similar program; empty if none is known."""


def residual_damping(
    residual: Callable[[float], float], factor: float, highest: float, at_zero: float, start: float = 0.0
) -> float:
    """Return the largest lambda with ``lambda = factor * residual(lambda)``; zero if there is none.

    The right-hand side over lambda falls. Its inverse is linear for one singular value, so the secant method is exact
    there.

    Args:
        residual: residual of a level that is damped.
        factor: damping over residual.
        highest: bound of the residual.
        at_zero: value of ``lambda / (factor * residual(lambda))`` at zero.
        start: lambda near the solution; zero if none is known.
    """
    low, high = 0.0, factor * highest
    if at_zero >= 1.0 or high <= 0.0:
        return 0.0
    before, at_before = low, at_zero
    now = start if 0.0 < start < high else high
    for _ in range(_ITERATIONS):
        at_now = now / max(factor * residual(now), 1e-300)
        if abs(at_now - 1.0) <= _SECANT or (at_now < 1.0 and now >= high):
            return now
        low, high = (now, high) if at_now < 1.0 else (low, now)
        rise = at_now - at_before
        ahead = now + (1.0 - at_now) * (now - before) / rise if rise else low
        before, at_before = now, at_now
        now = ahead if low < ahead < high else now / at_now  # a step of the fixed point stays on its side of it
    return high


class TaskLevels(NamedTuple):
    """Tasks of all levels, which minimise ``|J v2 - rate|^2`` one by one; rows are multiplied by roots of weights."""

    jacobian: Float[Array, "k r"]
    """Rows of the highest level, then those of the next one."""
    rate: Float[Array, " k"]
    ends: Int[Array, " levels"]
    """End of the rows of each level."""

    def split(self, entries: Array) -> list[Array]:
        """Entries (k, ...) of all rows, level by level."""
        return [entries[start:end] for start, end in pairwise([0, *self.ends.tolist()])]


class CascadeSolution(NamedTuple):
    """Solution of all levels within limits, which may have given way."""

    unknowns: Float[Array, " n"]
    """Reduced velocities, or inputs and contact forces."""
    multipliers: Float[Array, "levels total"]
    """Multipliers of all limits at each level; zero at a level that touches no limit."""
    excess: Float[Array, " total"]
    """Amount by which each limit gave way; zero if it did not."""
    damping: tuple[float, ...] = ()
    """Damping lambda of each level within its limits."""
    unsolved: str = ""
    """Reason why the tasks are not solved: the unknowns only keep the limits, or come to rest."""


class TaskStack:
    """All tasks of a program.

    Args:
        tasks: the tasks.
        reduced: the model.
        resting: number of rows below those of the tasks, with constant Jacobians.
        metric: size of motions.

    Attributes:
        bound: the tasks of the model.
        ends: end of the rows of each level, highest level first.
        roots: root of the weight of each row (k,), those of resting left out.
        squares: squared weights (levels, k) of the rows of each level whose Jacobian depends on the configuration.
        curved: one for these rows (k + resting,), zero for others.
        curvature: as of ``MotionMetric``.
    """

    def __init__(self, tasks: Sequence[ControlTask], reduced: ReducedModel, resting: int, metric: MotionMetric) -> None:
        for each in tasks:
            if not isinstance(each, ControlTask):
                raise ConfigurationError(f"a task has to be a ControlTask, found {type(each).__name__}")
        self.bound = [each.bind(reduced) for each in tasks]
        pairs = sorted(zip(tasks, self.bound, strict=True), key=lambda pair: pair[0].priority)
        ranks = [task.priority for task, bound in pairs for _ in bound.names]
        ends = [bisect_right(ranks, priority) for priority in sorted({*ranks})]
        self.ends = np.array([*ends, len(ranks) + resting] if resting or not ends else ends)
        roots = [np.sqrt(task.numbers("weight", task.weight, len(bound.names))) for task, bound in pairs]
        self.roots = np.concatenate([np.zeros(0), *roots])
        stops = np.cumsum([0, *(len(bound.names) for _, bound in pairs)]).tolist()
        placed = [(bound, slice(*part)) for (_, bound), part in zip(pairs, pairwise(stops), strict=True)]
        curved = [not bound.constant for _, bound in pairs for _ in bound.names]
        self.curved, rows = np.array([*curved, *[False] * resting], dtype=float), np.arange(len(ranks) + resting)
        level_of = np.searchsorted(self.ends, rows[: len(ranks)], side="right")
        self.squares = self.roots**2 * curved * (level_of == np.arange(len(self.ends))[:, None])
        self.curvature = metric.curvature
        outputs = [(each.output, where) for each, where in placed if each.output is not None]
        self._outputs = OutputsTogether([each for each, _ in outputs], reduced) if outputs else None
        self._output_rows = as_slice(np.concatenate([rows[:0], *(rows[where] for _, where in outputs)]))
        self._others = [(each, where) for each, where in placed if each.output is None]
        self._nv, self._affine = reduced.n, reduced.affine

    def at(self, sample: ControlSample) -> tuple[TaskLevels, SampledDamping]:
        """Return the rows of all tasks at the end of a sample, and the damping of all levels in it."""
        (J,), (rate,) = self.rows(sample)
        damping = SampledDamping(sample.dt, self.levers(J), self.curved)
        if self._affine:
            rate = rate - J @ sample.end.b
        return TaskLevels(self.roots[:, None] * J.dot(sample.end.R), self.roots * rate, self.ends), damping

    def levers(self, J: Float[Array, "k nv"]) -> Float[Array, " levels"]:
        """Return L of each level for the rows of all tasks."""
        return np.asarray(np.sqrt(self.squares.dot((J * J).dot(self.curvature))))

    def rows(self, *samples: ControlSample) -> tuple[Float[Array, "s k nv"], Float[Array, "s k"]]:
        """Return the rows of all tasks at the ends of samples, on the full velocity and unweighted, and their rates."""
        # Outputs share the kinematics of their joints: one evaluation gives all of them.
        outputs = self._outputs.rows(*samples) if self._outputs else None
        if outputs and not self._others:
            return outputs
        k, s = len(self.roots), len(samples)
        J, rate = np.empty((s, k, self._nv)), np.empty((s, k))
        if outputs:
            J[:, self._output_rows], rate[:, self._output_rows] = outputs
        for i, sample in enumerate(samples):
            for bound, where in self._others:
                J[i, where], rate[i, where] = bound.rows(sample)
        return J, rate


def solve_within(
    levels: TaskLevels,
    bounds: ProgramBounds,
    limits: LimitStack,
    otherwise: Callable[[], Array],
    damping: float = 0.0,
    multipliers: Array | None = None,
    before: Sequence[Array] = (),
    sampled: SampledDamping | None = None,
) -> CascadeSolution:
    """Solve the levels; limits that exclude each other give way.

    Args:
        levels, bounds, damping, sampled: as for ``solve_cascade``.
        multipliers: multipliers of all limits in a similar program, (levels, k), to start from.
        limits: the limits, in the order in which they give way.
        otherwise: gives the unknowns (n,) if no program is solved.
        before: groups of further bounds, which give way after all limits.
    """
    found = solve_cascade(levels, bounds, damping, multipliers, sampled)
    if found is not None:
        return found
    none = np.zeros((len(levels.ends), bounds.total)), np.zeros(bounds.total)
    relaxed = limits.relaxed(bounds, before)
    if relaxed is None:
        reason = "the program of the least excess over limits is not solved"
        return CascadeSolution(otherwise(), *none, unsolved=reason)
    found = solve_cascade(levels, relaxed[0], damping, None, sampled)
    if found is None:
        found = CascadeSolution(relaxed[1], *none, unsolved="tasks within limits that gave way are not solved")
    values, excess = bounds.rows @ found.unknowns, np.zeros(bounds.total)
    beyond = np.maximum(values - bounds.upper, bounds.lower - values)
    # Bounds that gave way were widened by the tolerance of the solver, which is no excess.
    excess[bounds.places] = np.where(beyond < _EXCEEDED, 0.0, beyond)
    return found._replace(excess=excess)


class _FreeDirections(NamedTuple):
    """Unknowns ``kept + Z z`` that higher levels leave free, at the cost ``|stiffness z|^2``."""

    kept: Array
    """Solution of the higher levels (n,)."""
    Z: Array
    """Directions (n, k), orthogonal."""
    stiffness: Array
    """Roots of the cost of each direction (k,), relative to the rows of a level; zero for a free one."""


class _Point(NamedTuple):
    """Solution of one level."""

    unknowns: Array
    determined: Array
    """Part of the unknowns that the rows of the level determine, beside what is kept."""
    multipliers: Array


class _Level:
    """One level in the coordinates of its singular values: with ``y = scales V^T z`` its cost is a distance.

    Args:
        free: what higher levels leave free.
        own: rows (k, n) on z.
        rate: their desired values (k,).
        norm: size of the rows before higher levels restrict them: a level may repeat rows of theirs.
        damping: cost of the unknowns.
        curved: indices of the rows whose Jacobian depends on the configuration; none without sampled damping.
        factor: sampled damping over residual.
    """

    def __init__(
        self, free: _FreeDirections, own: Array, rate: Array, norm: float, damping: float, curved: Array, factor: float
    ) -> None:
        # Lower levels need the directions that no row sees, and they are missing in the short form.
        left, values, self._right = np.linalg.svd(own, full_matrices=len(own) < own.shape[1])
        rank = int((values > _RANK * norm).sum())
        self._free, self._own, self._norm, self._factor = free, own, norm, factor
        self.unused = self._right[rank:]
        self._values, self._squares = values[:rank], values[:rank] ** 2 + damping**2
        self._amounts = rate @ left[:, :rank]
        # Costs of all coordinates, also of those that are left free, and their products with the goal.
        cheap = _FREE_COST**2 * (float(self._squares[-1]) if rank else 1.0)
        self._costs = np.append(self._squares, np.full(len(self.unused), cheap))
        self._pulls = np.append(self._values * self._amounts, np.zeros(len(self.unused)))
        self._along, self._wanted = left[curved, :rank], rate[curved]
        self._start: Array | None = None
        self._solved: dict[float, tuple[Array, Array]] = {}  # the last program, by its damping
        self.added = self._added_without_limits() if factor else 0.0

    def _added_without_limits(self) -> float:
        along = self._along * self._amounts
        least = self._wanted - along.sum(axis=1)
        at_rest = _size(self._wanted)
        turns = self._factor * _size(along @ (1.0 / self._squares))
        at_zero = 1.0 / max(turns, 1e-300) if _size(least) <= _ROUNDING * at_rest else 0.0
        return residual_damping(
            lambda added: _size(least + along @ (added / (self._squares + added))), self._factor, at_rest, at_zero
        )

    def without_limits(self) -> _Point:
        """Solution without limits."""
        share = self._values * self._amounts / (self._squares + self.added)
        determined = self._free.Z @ (self._right[: len(self._values)].T @ share)
        return _Point(self._free.kept + determined, determined, np.zeros(0))

    def within(self, bounds: ProgramBounds, start: Array | None, near: float) -> _Point | None:
        """Solution within limits, which can cause a residual too; None if there is none.

        Args:
            bounds: the limits.
            start: multipliers to start from.
            near: damping in a similar program; zero if none is known.
        """
        self._start, kept = start, bounds.rows @ self._free.kept
        self._limits = bounds.rows @ self._free.Z @ self._right.T, bounds.lower - kept, bounds.upper - kept
        if self._factor:
            self.added = residual_damping(self._residual, self._factor, _size(self._wanted), 0.0, near or self.added)
        found = self._solved.get(self.added) or self._nearest(self.added)
        if found is None:
            return None
        along, multipliers = found
        directions, rank = self._free.Z @ self._right.T, len(self._values)
        determined = directions[:, :rank] @ along[:rank]
        return _Point(self._free.kept + directions @ along, determined, multipliers)

    def _nearest(self, added: float) -> tuple[Array, Array] | None:
        """Amounts along the singular directions within limits, and multipliers; None if there are none."""
        units, (rows, lower, upper) = np.sqrt(self._costs + added), self._limits
        if (found := nearest_point(self._pulls / units, rows / units, lower, upper, self._start)) is None:
            return None
        # The next damping is near this one, and mostly the same limits are active.
        self._start = found.multipliers
        return found.point / units, found.multipliers

    def _residual(self, added: float) -> float:
        found = self._nearest(added)
        if found is None:
            return 0.0
        self._solved = {added: found}
        return _size(self._wanted - self._along @ (self._values * found[0][: len(self._values)]))

    def left_free(self, lower: Sequence[tuple[Array, Array]], determined: Array) -> _FreeDirections | None:
        """Return the directions that lower levels may use; None if there are none.

        Where the level does not attain its rates, a direction with the singular value sigma is free in part. Motion of
        lower levels at the speed w turns the null space by ``L w / sigma``, so it concerns directions with
        ``sigma < 2 (2 h L w)``.
        """
        kept, rank = self._free.kept + determined, len(self._values)
        share = np.zeros(rank)
        if self.added:
            speed = sum(_speed(self._free.Z, J, rate - J @ kept) for J, rate in lower)
            near = np.maximum(0.0, 1.0 - self._values / max(2.0 * self._factor * speed, 1e-300))
            share = self.added / (self._squares + self.added) * near
        loose = share > _LEAST_SHARE
        if not (len(self.unused) or loose.any()):
            return None
        directions = np.vstack([np.sqrt(share[loose])[:, None] * self._right[:rank][loose], self.unused])
        stiffness = np.append(np.sqrt(1.0 - share[loose]), np.zeros(len(self.unused)))
        return _FreeDirections(kept, self._free.Z @ directions.T, stiffness)

    def largest_speed(self, bounds: ProgramBounds, multipliers: Array) -> float:
        """Largest speed of lower levels along active limits: the null space turns slowly at it.

        Limits count by their push, the product of multiplier and row. One that only touches, or is nearly parallel to
        others, must not change the speed at once: it would come and go with it.
        """
        pushes = multipliers[:, None] * (bounds.rows @ self._free.Z)
        _, sizes, right = np.linalg.svd(pushes[multipliers != 0.0])
        shares = np.maximum(sizes / sizes.max(initial=_NOTHING), _NOTHING)
        grades = np.log(shares / _TOUCHES) / np.log(_PUSHES / _TOUCHES)
        grades = np.concatenate([[1.0], np.clip(grades, 0.0, 1.0), [0.0]])
        # The time of a turn is the mean over the numbers of directions that are excluded.
        weights = enumerate(grades[:-1] - grades[1:])
        time = sum(weight / self._speed_along(right[count:]) for count, weight in weights if weight > 0.0)
        return 1.0 / time if time else np.inf

    def _speed_along(self, directions: Array) -> float:
        values = np.linalg.svd(self._own @ directions.T, compute_uv=False)
        values = values[values > _RANK * self._norm]
        damped = self.added / (values**2 + self.added)  # what is attained may turn
        return _SLOW * float((values / damped).min(initial=np.inf)) / self._factor


def solve_cascade(
    levels: TaskLevels,
    bounds: ProgramBounds,
    damping: float,
    multipliers: Array | None = None,
    sampled: SampledDamping | None = None,
) -> CascadeSolution | None:
    """Solve the levels from the highest to the lowest; None if no velocity satisfies the limits.

    A level that attains its rates is kept exactly. Where its rows are nearly dependent and it does not, lower levels
    may use part of these directions: a null space that gained a direction at once, where its singular value vanishes,
    would turn from sample to sample. For the same reason they are slow where active limits make rows dependent, by the
    share of the residual that these limits cause.

    Args:
        levels: tasks.
        bounds: limits.
        damping: cost of the velocity at every level, which bounds it near singular configurations.
        multipliers: multipliers of all limits in a similar cascade, (levels, total), to start from.
        sampled: damping of levels that do not attain their rates; by default none.
    """
    rows, r, count = bounds.rows, bounds.rows.shape[1], len(levels.ends)
    found, excess = np.zeros((count, bounds.total)), np.zeros(bounds.total)
    sampled = sampled or SampledDamping(0.0, np.zeros(count), np.zeros(len(levels.rate)))
    if not damping and (attained := _within_all_limits(levels, bounds, sampled)) is not None:
        return CascadeSolution(attained, found, excess, (0.0,) * count)
    room = _TOUCHING * (1.0 + np.abs(rows).sum(axis=1))
    low, high = bounds.lower - room, bounds.upper + room
    near = list(sampled.near) or [0.0] * count
    parts = list(zip(*map(levels.split, (levels.jacobian, levels.rate)), strict=True))
    curved = [np.flatnonzero(each) for each in levels.split(sampled.curved)]
    free, unknowns = _FreeDirections(np.zeros(r), np.eye(r), np.zeros(r)), None
    slow: tuple[Array, float] | None = None
    for index, (J, rate) in enumerate(parts):
        own, rate = J @ free.Z, rate - J @ free.kept
        norm, size = (max(float(np.sqrt(np.vdot(each, each))), _NOTHING) for each in (own, J))
        start = None if multipliers is None else multipliers[index, bounds.places]
        if free.stiffness.any():
            own, rate = np.vstack([own, np.diag(norm * free.stiffness)]), np.append(rate, np.zeros(len(free.stiffness)))
        factor = _SAMPLED_DAMPING * sampled.dt * float(sampled.levers[index])
        level = _Level(free, own, rate, size, damping, curved[index], factor)
        point = level.without_limits()
        reached = rows @ point.unknowns
        if not ((reached <= high).all() and (reached >= low).all()):
            limited = level.within(bounds, start, near[index])
            if limited is None:
                break  # at a lower level: rounding left no room
            # Of the residual, limits cause this: nothing where they only touch, or lower levels would stop at once.
            caused, residual = J @ (limited.unknowns - point.unknowns), parts[index][1] - J @ limited.unknowns
            point, found[index, bounds.places], near[index] = limited, limited.multipliers, level.added
            if level.added and slow is None and index + 1 < count:
                speed = level.largest_speed(bounds, point.multipliers) * _size(residual)
                slow = point.unknowns, speed / max(_size(caused), _NOTHING)
        unknowns = point.unknowns
        left = level.left_free(parts[index + 1 :], point.determined)
        if left is None:
            break
        free = left
    if slow is not None and unknowns is not None:  # both ends of the line keep the limits
        change = unknowns - slow[0]
        unknowns = slow[0] + min(1.0, slow[1] / max(_size(change), 1e-300)) * change
    return None if unknowns is None else CascadeSolution(unknowns, found, excess, tuple(near))


def _size(values: Array) -> float:
    return float(np.sqrt(values @ values))


def _speed(basis: Array, J: Array, rate: Array) -> float:
    """Size of the velocity that a level asks for along a basis; zero if its rows act there by rounding only."""
    own = J @ basis
    largest = float(np.einsum("kr,kr->k", own, own).max(initial=0.0))
    return _size(rate @ own) / largest if largest > _RANK**2 * np.vdot(J, J) else 0.0


def _within_all_limits(levels: TaskLevels, bounds: ProgramBounds, sampled: SampledDamping) -> Array | None:
    """Solution of all levels where no limit is active at any; None for others, or without the compiled kernel."""
    unknowns, factors = np.empty(levels.jacobian.shape[1]), _SAMPLED_DAMPING * sampled.dt * sampled.levers
    tasks = levels.jacobian, levels.rate, sampled.curved, levels.ends, factors
    found = _kernel.library.cascade(*tasks, bounds.rows, bounds.lower, bounds.upper, unknowns)
    return unknowns if found else None
