"""Inverse kinematics: configurations that reach targets of outputs, within constraints, limits and collisions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
import pinocchio as pin
from annotated_types import Ge
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Array, Float
from rnc_pin.collision import CollisionDistances
from rnc_pin.errors import ConfigurationError, InputError, SingularityError
from rnc_pin.math.convex_programs import nearest_point
from rnc_pin.model.input_validation import admit_configuration, check_settings, is_number
from rnc_pin.model.kinematics import Kinematics, PositionKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import OutputTarget, OutputTargets
from rnc_pin.printing import printed
from rnc_pin.robots.joint_values import NO_LIMIT
from rnc_pin.robots.robot import Robot

_CLOSED = 1e-9  # largest residual of holonomic rows of a solution [m or rad]
_ROUNDING = 1e-13
_LIMIT = 1e-8  # distance from a limit that counts as active [rad or m]
_REPULSION = 3.0  # weight of collisions relative to targets
_EXTRA = 1e-3  # distance beyond the clearance that the search keeps [m]
_TURN, _AWAY = np.pi, 1.0  # spread of random starts without limits [rad, m]


@printed(residuals="rad or m", collisions="m", holonomic_residual="rad or m")
@dataclass(frozen=True)
class IkResult:
    """Solution of inverse kinematics, or the best configuration that was found. Printed, it tells what is missing.

    Attributes:
        q: configuration (nq,), read-only.
        converged: True if all targets are reached, holonomic rows hold, and no pair is nearer than the clearance.
        residuals: length of the error of each target [m or rad].
        unreachable: residuals of the targets that are not reached.
        active_limits: joints at a position limit, such as ``elbow_joint (upper)``.
        collisions: signed distance [m] of each pair that is nearer than the clearance.
        holonomic_residual: largest residual of the holonomic constraint rows [m or rad].
        ignored_rows: constraint rows that restrict velocities. The solver assumes that they do not restrict
            configurations; ``analyze`` lists those that do (integrable rows).
        starts: number of descents.
        steps: number of steps of all descents.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> result = rnc.solve_ik(reduced, robot.configuration(), {rnc.FramePosition("tip", "xy"): [4.0, 1.0]})
        >>> result.converged, result.ignored_rows
        (True, ('no_side_slip(axle.y)',))
    """

    q: Float[Array, " nq"]
    converged: bool
    residuals: Mapping[str, float]
    unreachable: Mapping[str, float]
    active_limits: tuple[str, ...]
    collisions: Mapping[str, float]
    holonomic_residual: float
    ignored_rows: tuple[str, ...]
    starts: int
    steps: int


@dataclass(frozen=True)
class IkSearch:
    """Search of ``solve_ik``.

    Attributes:
        tolerance: largest error of a reached target [m or rad].
        starts: largest number of descents.
        seed: random seed of the starts; equal seeds give equal results.

    Raises:
        ConfigurationError: an option is out of range.

    Example:
        >>> rnc.IkSearch(starts=50, seed=1).tolerance
        1e-06
    """

    # Rows close to 1e-9 and descents end by rounding: no finer error can be told.
    tolerance: Annotated[float, Ge(1e-10)] = 1e-6
    starts: Annotated[int, Ge(1)] = 20
    seed: int = 0

    def __post_init__(self) -> None:
        check_settings(self)


_SEARCH = IkSearch()


def solve_ik(
    reduced: ReducedModel,
    q0: Float[Array, " nq"],
    targets: Mapping[OutputTarget, ArrayLike],
    *,
    hold: Sequence[str] = (),
    limits: bool = True,
    collisions: CollisionDistances | None = None,
    clearance: float = 0.0,
    search: IkSearch = _SEARCH,
) -> IkResult:
    """Return a configuration in which outputs have given values.

    Holonomic constraint rows (loop closures, joint couplings, wheels on the ground) hold exactly, and joints stay
    within the position limits of the robot's file. The first descent starts at q0, the others at random
    configurations. The first solution is returned; without one, the configuration with the smallest error.

    Rolling, side-slip and momentum rows restrict velocities. They do not restrict configurations, unless they are
    integrable: then the path from q0 decides what can be reached. ``IkResult.ignored_rows`` names them.

    Args:
        reduced: the model.
        q0: first start (nq,).
        targets: values by name of an output of the model, or by output object: positions [m], angles [rad], rotation
            vectors (3,) or rotation matrices (3, 3).
        hold: names of joints that keep their positions.
        limits: False ignores the position limits of the robot's file.
        collisions: pairs of bodies to keep apart; None for none.
        clearance: smallest distance of these pairs [m].
        search: tolerance, number of descents and seed of their starts.

    Raises:
        ConfigurationError: unknown output, or a value that no configuration can have.
        InputError: a value has the wrong shape or is not finite, or the clearance is negative.
        ModelError: unknown joint.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf")
        >>> reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce([rnc.FramePosition("tip", "xy")])
        >>> q0 = robot.configuration({"joint_1": 0.3, "joint_2": 0.5})
        >>> result = rnc.solve_ik(reduced, q0, {"tip_x": 1.2, "tip_y": 0.6})
        >>> result.converged, reduced.at(result.q).outputs()[1].round(6)
        (True, array([1.2, 0.6]))
        >>> far = rnc.solve_ik(reduced, q0, {rnc.FramePosition("tip", "xy"): [5.0, 0.0]})
        >>> far.converged, {name: round(error, 3) for name, error in far.unreachable.items()}
        (False, {'tip': 3.0})
    """
    q0 = admit_configuration(q0, reduced.robot, "q0")
    if not (is_number(clearance) and clearance >= 0.0):
        raise InputError(f"clearance: expected a number of at least 0 m, found {clearance!r}")
    bounds = TangentBounds(reduced.robot, hold, limits)
    problem = _Problem(reduced, OutputTargets(reduced, targets), bounds, collisions, clearance)
    generator = np.random.default_rng(search.seed)
    best: Descent | None = None
    steps = count = 0
    for count in range(1, search.starts + 1):
        start = problem.bounds.clip(q0) if count == 1 else problem.random_start(q0, generator)
        try:
            found = problem.closed(descend(problem.evaluate, problem.bounds, start))
        except SingularityError:  # an output is undefined there, such as the direction of two equal points
            continue
        steps += found.steps
        if best is None or problem.rank(found) < problem.rank(best):
            best = found
        if problem.result(best.q, search.tolerance, count, steps).converged:
            break
    if best is None:
        raise ConfigurationError(
            f"targets {', '.join(problem.targets.labels)} are undefined at all {search.starts} starts"
        )
    if not problem.result(best.q, search.tolerance, count, steps).converged:
        flat = 1e-13  # relative decrease of the squared error that still counts at a flat minimum
        # Minima beyond the reach are flat: the usual progress ends a descent early, and the nearest configuration would
        # be inexact. Only the best one is worth the further steps.
        best = problem.closed(descend(problem.evaluate, problem.bounds, best.q, progress=flat))
        steps += best.steps
    return problem.result(problem.with_fewest_turns(best.q, q0), search.tolerance, count, steps)


@dataclass(eq=False)
class _Problem:
    """Inverse kinematics as a least-squares problem with equalities and bounds."""

    reduced: ReducedModel
    targets: OutputTargets
    bounds: TangentBounds
    collisions: CollisionDistances | None
    clearance: float

    def __post_init__(self) -> None:
        self._kinematics = Kinematics(self.reduced.robot)

    def evaluate(self, q: np.ndarray) -> Residuals:
        at = self._kinematics.position(q)
        e = self.targets.error(at, self.targets.goal)
        J = self.targets.error_jacobian(at, e)
        if self.collisions is not None:
            # A little farther than the clearance, so that the configuration keeps it although the error is not zero.
            near = self.collisions.at(q, within=self.clearance + _EXTRA)
            e = np.concatenate([e, _REPULSION * (self.clearance + _EXTRA - near.distance)])
            J = np.concatenate([J, _REPULSION * near.jacobian])
        return self._with_rows(at, e, J)

    def _with_rows(self, at: PositionKinematics, e: np.ndarray, J: np.ndarray) -> Residuals:
        """Errors of targets beside the holonomic rows that do not follow from others."""
        assembly = self.reduced.assembly
        return Residuals(e, J, assembly.residual(at.q)[assembly.leading], assembly.jacobian(at)[assembly.leading])

    def closed(self, found: Descent) -> Descent:
        """Return the result of a descent with its holonomic rows satisfied to rounding, if they can be."""
        if found.residual <= _ROUNDING:
            return found
        # The descent weighs targets against rows where both cannot hold: without targets, the rows decide.
        nothing = np.zeros((0, self.reduced.n))
        place = self._kinematics.position
        polished = descend(lambda q: self._with_rows(place(q), nothing[:, 0], nothing), self.bounds, found.q)
        error = float(np.linalg.norm(self.evaluate(polished.q).e))
        return Descent(polished.q, error, polished.residual, found.steps + polished.steps)

    def random_start(self, q0: np.ndarray, generator: np.random.Generator) -> np.ndarray:
        """Return a random configuration: within the limits; joints without limits near q0."""
        bounds, model = self.bounds, self.reduced.robot.model
        step = generator.uniform(-_TURN, _TURN, model.nv)
        step[[unit == "m/s" for unit in self.reduced.robot.velocity_units]] *= _AWAY / _TURN
        step[bounds.held] = 0.0
        q = pin.integrate(model, q0, step)
        # Entries with limits are drawn anew, over their whole range.
        here, wide = q0[bounds.q_index], bounds.upper - bounds.lower > 2 * _TURN  # a full turn is enough
        low = np.where(wide, np.maximum(bounds.lower, here - _TURN), bounds.lower)
        high = np.where(wide, np.minimum(bounds.upper, here + _TURN), bounds.upper)
        free = ~bounds.held[bounds.v_index]
        q[bounds.q_index[free]] = generator.uniform(low, np.maximum(low, high))[free]
        return bounds.clip(q)

    def with_fewest_turns(self, q: np.ndarray, q0: np.ndarray) -> np.ndarray:
        """Return the same configuration without full turns from q0, as far as limits and targets do not need them."""
        turned, (low, high) = q.copy(), self.bounds.room(q)
        for joint in list(self.reduced.robot.model.joints)[1:]:
            if joint.nq == 1 and joint.shortname().startswith("JointModelR"):
                k = joint.idx_q
                turns = -2 * np.pi * np.round((q[k] - q0[k]) / (2 * np.pi))
                turned[k] += turns if low[joint.idx_v] <= turns <= high[joint.idx_v] else 0.0
        # A target may ask for the turns, such as a position of a joint beyond half a turn.
        before, after = (self.evaluate(each) for each in (q, turned))
        worse = np.abs(after.e).sum() > np.abs(before.e).sum() + _ROUNDING
        return q if worse or self._holonomic_residual(turned) > self._holonomic_residual(q) + _ROUNDING else turned

    def rank(self, found: Descent) -> tuple[bool, float]:
        """Return a key that is smaller for a better configuration: rows that hold come first."""
        return found.residual > _CLOSED, found.error

    def _holonomic_residual(self, q: np.ndarray) -> float:
        assembly = self.reduced.assembly
        return float(np.abs(assembly.residual(q)[assembly.leading]).max(initial=0.0))

    def _near(self, q: np.ndarray) -> dict[str, float]:
        """Return the pairs that are nearer than the clearance, with their distances [m]."""
        if self.collisions is None:
            return {}
        near = self.collisions.at(q, within=self.clearance)
        labels = [self.collisions.pairs[pair].label for pair in near.pairs.tolist()]
        return dict(zip(labels, near.distance.tolist(), strict=True))

    def result(self, q: np.ndarray, tolerance: float, starts: int, steps: int) -> IkResult:
        residuals = self.targets.residuals(self._kinematics.position(q))
        unreachable = {name: error for name, error in residuals.items() if not error <= tolerance}
        holonomic, near, rows = self._holonomic_residual(q), self._near(q), self.reduced.constraints
        q = q.copy()
        q.setflags(write=False)
        return IkResult(
            q=q,
            converged=not unreachable and holonomic <= _CLOSED and not near,
            residuals=residuals,
            unreachable=unreachable,
            active_limits=self._active_limits(q),
            collisions=near,
            holonomic_residual=holonomic,
            ignored_rows=tuple(name for name, flag in zip(rows.names, rows.holonomic, strict=True) if not flag),
            starts=starts,
            steps=steps,
        )

    def _active_limits(self, q: np.ndarray) -> tuple[str, ...]:
        bounds, names = self.bounds, self.reduced.robot.velocity_names
        here = q[bounds.q_index]
        ends = np.select([here <= bounds.lower + _LIMIT, here >= bounds.upper - _LIMIT], ["lower", "upper"], "")
        return tuple(f"{names[k]} ({end})" for k, end in zip(bounds.v_index, ends, strict=True) if end)


# ---------------------------------------------------------------------- descent within bounds


_STEPS = 150
_LONGEST = 1.0  # largest step [rad or m]
_EXACT = 1e-13  # error at which the descent stops
_STATIONARY = 1e-10  # largest gradient of a minimum, and largest motion to a bound
_DAMPING, _LEAST, _MOST = 0.5, 1e-10, 1e6  # damping over the square of the error, and its limits
_STALLS = 8  # number of stalled steps that end a descent
_DEPENDENT = 1e-9


class Residuals(NamedTuple):
    """Linearized problem at a configuration: ``J dq = e`` in the least-squares sense, ``H dq = -h`` exactly."""

    e: np.ndarray
    """Error (k,) to minimize."""
    J: np.ndarray
    """Jacobian (k, nv) of ``-e``."""
    h: np.ndarray
    """Residual (c,) of the equalities."""
    H: np.ndarray
    """Jacobian (c, nv) of h."""


class Descent(NamedTuple):
    """Result of a descent."""

    q: np.ndarray
    error: float
    """Length of e."""
    residual: float
    """Largest entry of h."""
    steps: int


class TangentBounds:
    """Position limits of the robot's file in tangent coordinates; entries beyond ``NO_LIMIT`` are none.

    Args:
        robot: the robot.
        hold: names of joints that do not move.
        limits: False for no limits.
    """

    def __init__(self, robot: Robot, hold: Sequence[str] = (), limits: bool = True) -> None:
        self.model, self.held = robot.model, np.zeros(robot.nv, dtype=bool)
        for name in hold:
            self.held[robot.velocity_indices(name)] = True
        joints = [joint for joint in list(self.model.joints)[1:] if joint.nq == joint.nv]
        entries = [(joint.idx_q + k, joint.idx_v + k) for joint in joints for k in range(joint.nv)]
        iq, iv = np.array(entries, dtype=int).reshape(-1, 2).T
        low, high = self.model.lowerPositionLimit[iq], self.model.upperPositionLimit[iq]
        bounded = limits & (low < high) & ((low > -NO_LIMIT) | (high < NO_LIMIT))
        self.q_index, self.v_index, self.lower, self.upper = iq[bounded], iv[bounded], low[bounded], high[bounded]

    def clip(self, q: np.ndarray) -> np.ndarray:
        """Return q with all entries within the limits; held entries too."""
        clipped = q.copy()
        clipped[self.q_index] = np.clip(q[self.q_index], self.lower, self.upper)
        return clipped

    def room(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the largest steps (nv,) down and up; zero for held entries."""
        low, high = np.full(self.model.nv, -np.inf), np.full(self.model.nv, np.inf)
        low[self.v_index], high[self.v_index] = self.lower - q[self.q_index], self.upper - q[self.q_index]
        low[self.held] = high[self.held] = 0.0
        return np.minimum(low, 0.0), np.maximum(high, 0.0)


def descend(
    evaluate: Callable[[np.ndarray], Residuals], bounds: TangentBounds, q: np.ndarray, progress: float = 1e-6
) -> Descent:
    """Minimize ``|e|`` subject to ``h = 0`` and the bounds, from a configuration (nq,) within the bounds.

    The damping starts as that of Sugihara ("Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt
    method", 2011): proportional to ``|e|^2``. So convergence is quadratic for reachable targets. Its factor grows after
    failed steps and shrinks after others. Each step is the nearest point within the bounds, by DAQP.

    Args:
        evaluate: linearized problem at a configuration.
        bounds: position limits.
        q: start (nq,).
        progress: relative decrease of the squared error below which a step counts as stalled.
    """
    here, factor, stalls, steps = evaluate(q), 1.0, 0, 0
    merit = _merit(here)
    while steps < _STEPS and merit > _EXACT**2 and stalls < _STALLS and factor <= _MOST:
        steps += 1
        low, high = bounds.room(q)
        damping = factor * max(_DAMPING * float(here.e @ here.e), _LEAST)
        dq, gradient = _step(here, damping, low, high)
        if gradient < _STATIONARY and np.abs(here.h).max(initial=0.0) < _EXACT:
            break
        dq *= min(1.0, _LONGEST / max(float(np.abs(dq).max(initial=0.0)), 1e-300))
        # Steps keep to the bounds by themselves; rounding may pass them by an ulp.
        ahead_q = bounds.clip(pin.integrate(bounds.model, q, dq))
        try:
            ahead = evaluate(ahead_q)
            after = _merit(ahead)
        except SingularityError:  # outputs are not defined there: a shorter step is tried
            after = np.inf
        descent_rounding = 1e-14  # relative change of the squared error that rounding hides
        # Near a minimum beyond reach, rounding hides the decrease: only the gradient still shows progress.
        if after <= (1.0 + descent_rounding) * merit:
            stalls = stalls + 1 if after > (1.0 - progress) * merit else 0
            boldest = 1e-4  # smallest factor of the damping
            q, here, merit, factor = ahead_q, ahead, after, max(factor / 4.0, boldest)
        else:
            stalls += 1
            factor *= 8.0
    return Descent(q, float(np.linalg.norm(here.e)), float(np.abs(here.h).max(initial=0.0)), steps)


def _merit(at: Residuals) -> float:
    """Return the square of the errors; equalities count more than targets."""
    return float(at.e @ at.e) + 100.0 * float(at.h @ at.h)


def _step(at: Residuals, damping: float, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the step (nv,) within the room that minimizes the damped errors, and their largest gradient along it."""
    first, basis = np.zeros(len(low)), np.eye(len(low))
    if len(at.H):  # most robots have no loops, and need no decomposition
        # By singular values: rows of a loop lose rank at dead centres, and the step along the others is still wanted.
        left, values, right = np.linalg.svd(at.H)
        rank = int((values > _DEPENDENT * max(values[0], 1e-300)).sum())
        first, basis = -right[:rank].T @ ((left[:, :rank].T @ at.h) / values[:rank]), right[rank:].T
    J = at.J @ basis
    # Of rows, not of their squares: those of long robots would lose the damping to rounding.
    root = np.linalg.qr(np.vstack([J, np.sqrt(damping) * np.eye(J.shape[1])])).R.T
    rows, wanted = np.linalg.solve(root, basis.T).T, np.linalg.solve(root, J.T @ (at.e - at.J @ first))
    found = nearest_point(wanted, rows, low - first, high - first)
    # Equalities that lead beyond the bounds: as far as the bounds let each entry go.
    y = wanted if found is None else found.point
    return np.clip(first + rows @ y, low, high), float(np.abs(root @ y).max(initial=0.0))
