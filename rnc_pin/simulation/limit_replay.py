"""Replay of a trajectory against the limits of the robot's file, and against collisions by coal."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Literal, NamedTuple, get_args

import numpy as np

from rnc_pin import collision
from rnc_pin.control.controller import LimitedAcceleration
from rnc_pin.errors import InputError
from rnc_pin.printing import printed
from rnc_pin.robots.joint_values import NO_LIMIT, known_velocity_limits, limited_positions
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation.run_data import RunData

ROUNDING = 1e-9
"""Largest excess over a limit that counts as rounding, as a share of its range."""


LimitKind = Literal["position", "velocity", "effort", "acceleration"]
LIMIT_KINDS: tuple[LimitKind, ...] = get_args(LimitKind)


@printed()
class LimitUse(NamedTuple):
    """Largest use of a joint limit in a run.

    Attributes:
        kind: "position", "velocity", "effort" or "acceleration".
        name: joint, actuator, or the reducing output whose rate an acceleration is of.
        excess: largest excess over the limit, as a share of its range; negative while the limit is kept. The range is
            that from the lower to the upper position limit, or the limit itself. For an effort limit of zero it is
            the largest effort in the file.
        time: time of the largest excess [s].
        value: value at that time [rad, m, rad/s, m/s, N m, N, rad/s^2 or m/s^2].
        limit: limit that is nearest to it.
        rounding: excess that counts as rounding.
    """

    kind: LimitKind
    name: str
    excess: float
    time: float
    value: float
    limit: float
    rounding: float = ROUNDING

    @property
    def exceeded(self) -> bool:
        """True if the excess is more than rounding."""
        return self.excess > self.rounding

    def __str__(self) -> str:
        of = "its range" if self.limit or self.kind != "effort" else "the largest effort in the file"
        return (
            f"{self.kind} of {self.name}: {self.value:.4g} at t = {self.time:.3f} s, limit {self.limit:.4g} "
            f"({100 * self.excess:+.2g} % of {of})"
        )


@printed(distance="m")
class Clearance(NamedTuple):
    """Smallest distance of a pair in a run.

    Attributes:
        names: the two bodies; the second may be an obstacle.
        distance: smallest signed distance [m]; negative for penetration. It is certain to a tolerance, between the
            samples of the run too.
        time: time of the smallest distance [s]; it may be between two samples.
        obstacle: True if the second body is an obstacle.
        constant: True if the distance does not change during the run.
        uncertain: True if the run is too fast between its samples for the tolerance.
    """

    names: tuple[str, str]
    distance: float
    time: float
    obstacle: bool
    constant: bool = False
    uncertain: bool = False

    def __str__(self) -> str:
        # A length has no sign in a sentence: the word has it.
        words = "distance" if self.distance > 0 else "penetration"
        return f"{' / '.join(self.names)}: {words} {1e3 * abs(self.distance):.3g} mm at t = {self.time:.3f} s"


@printed(within="m", tolerance="m")
@dataclass(frozen=True)
class LimitReplay:
    """Result of ``replay_limits``.

    Attributes:
        uses: largest use of every limit of a joint.
        clearances: smallest distance of every pair that comes nearer than ``within``, nearest first.
        omitted: pairs of links that are not checked because they touch at the start, and why.
        time: times (N,) of the distances and excesses [s].
        excesses: excess (N, u) of each limit in ``uses`` over time, as a share of its range.
        within: distance up to which distances are exact [m].
        tolerance: tolerance of the distances in ``clearances`` [m]; zero without collision geometry.
        curves: measurement of ``distances``, which takes long; None without collision geometry.
    """

    uses: tuple[LimitUse, ...]
    clearances: tuple[Clearance, ...]
    omitted: tuple[collision.OmittedPair, ...]
    time: np.ndarray
    excesses: np.ndarray
    within: float
    tolerance: float = 0.0
    curves: Callable[[], np.ndarray] | None = field(default=None, repr=False)

    @cached_property
    def distances(self) -> np.ndarray:
        """Distances (N, k) of the pairs in ``clearances`` over time [m]. Beyond ``within`` they are lower bounds."""
        return np.zeros((len(self.time), 0)) if self.curves is None else self.curves()

    def __getstate__(self) -> dict[str, object]:
        """State with the curves themselves: what measures them takes long to build again."""
        return {**self.__dict__, "distances": self.distances, "curves": None}

    @property
    def violations(self) -> tuple[LimitUse, ...]:
        """Limits that the run exceeds."""
        return tuple(use for use in self.uses if use.exceeded)

    @property
    def collisions(self) -> tuple[Clearance, ...]:
        """Pairs that penetrate each other in the run."""
        return tuple(each for each in self.clearances if each.distance < -ROUNDING)

    def nearest(self, obstacle: bool) -> Clearance | None:
        """Pair with the smallest distance; None if none comes near.

        Args:
            obstacle: True for pairs of a link and an obstacle; False for pairs of links, without those whose distance
                does not change during the run.
        """
        varying = (each for each in self.clearances if obstacle or not each.constant)
        return next((each for each in varying if each.obstacle is obstacle), None)

    def worst(self, kind: LimitKind) -> LimitUse | None:
        """Limit of a kind with the largest excess; None without such limits.

        Args:
            kind: "position", "velocity", "effort" or "acceleration".
        """
        return max((use for use in self.uses if use.kind == kind), key=lambda use: use.excess, default=None)


@dataclass(frozen=True)
class FurtherLimits:
    """Limits that a robot's file cannot have: of accelerations, and of forces on frames.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> push = rnc.FrameForce("sleigh", "x", limit=5.0)
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], [push]).reduce()
        >>> weaker = rnc.simulation.FurtherLimits(efforts={"force(sleigh.x)": 3.0})
        >>> run = rnc.free_motion(reduced, robot.configuration(), [1.0, 0.0], duration=0.1, inputs=[4.0])
        >>> [use.name for use in rnc.simulation.replay_limits(robot, run, further=weaker).violations]
        ['force(sleigh.x)']
    """

    accelerations: Sequence[LimitedAcceleration] = ()
    """Limits of accelerations, such as those of a whole-body program. The acceleration is the change of the velocity
    from sample to sample over the time between them."""
    efforts: Mapping[str, float] = field(default_factory=dict)
    """Limits by name of actuators that are not joints, such as ``stated_limits`` of an actuation [N or N m]."""


def replay_limits(
    robot: Robot,
    trajectory: RunData,
    obstacles: Sequence[collision.Obstacle] = (),
    selection: collision.PairSelection | None = None,
    step: float = 0.0,
    within: float = 0.05,
    exact: float | None = None,
    further: FurtherLimits | None = None,
) -> LimitReplay:
    """Replay a trajectory and return how much of each limit it uses, and the smallest distances of pairs.

    Limits of position and velocity, and those of the effort of driven joints, come from the robot's file.

    Args:
        robot: robot of the trajectory.
        trajectory: a run.
        obstacles: bodies in the world.
        selection: rules for pairs of links; by default all pairs that are not adjacent.
        step: time between the samples whose distances are over time in the result [s]; every sample by default.
            Smallest distances are those of the whole motion, whose joints move at constant rate from sample to sample.
        within: distance up to which distances are exact [m].
        exact: distance up to which samples have no tolerance, as in ``continuous_distances`` [m].
        further: limits that the robot's file does not have; by default those of the run's actuators and controller.

    Raises:
        InputError: the trajectory has no samples, or belongs to another robot.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> run = rnc.free_motion(reduced, robot.configuration(), [1.0, 0.5], duration=1.0)
        >>> replay = rnc.simulation.replay_limits(robot, run)
        >>> replay.violations, replay.collisions
        ((), ())
    """
    if trajectory.q.shape[1] != robot.nq:
        raise InputError(f"q has {trajectory.q.shape[1]} entries, but nq of the robot is {robot.nq}")
    if not len(trajectory.time):
        raise InputError("the run has no samples")
    if further is None:
        # A run that was just made knows its limits; one from a file is judged by the robot alone.
        grounds, further = trajectory.grounds, FurtherLimits()
        if grounds is not None:
            further = FurtherLimits(grounds.accelerations, grounds.reduced.actuation.stated_limits)
    # A run that comes near a limit is told how near: all uses are kept, not only those beyond.
    found = [
        *_positions(robot, trajectory),
        *_rates(robot, trajectory),
        *_efforts(robot, trajectory, further.efforts),
        *_accelerations(trajectory, further.accelerations),
    ]
    # Curves may be coarse; uses and smallest distances are those of all samples.
    every = _spaced(trajectory.time, step)
    time, uses = trajectory.time[every], tuple(each.use(trajectory.time) for each in found)
    excesses = np.array([each.excess[every] for each in found]).reshape(len(found), len(every)).T
    if not robot.has_collision_shapes:
        return LimitReplay(uses, (), (), time, excesses, within)
    # The start tells which links overlap by design: their distance says nothing.
    checked = collision.CollisionDistances(robot, obstacles, selection, q0=trajectory.q[0])
    # Pairs that the user left out are no news; pairs that overlap by the robot's own file are.
    omitted = tuple(each for each in checked.omitted if each.reason.startswith("overlap"))
    measured = collision.continuous_distances(
        checked, trajectory.time, trajectory.q, within, samples=every, exact=exact
    )
    smallest = measured.smallest
    # Stable: pairs at one distance keep their order, so that equal runs have equal reports.
    near = [k for k in np.argsort(smallest, kind="stable").tolist() if smallest[k] < within]
    clearances = tuple(_clearance(checked, measured, k) for k in near)
    # Curves of many pairs take longer than the smallest distances, and only figures show them.
    curves = partial(measured.curves, np.array(near, dtype=int))
    return LimitReplay(uses, clearances, omitted, time, excesses, within, measured.tolerance, curves)


def obstacles_passed(
    robot: Robot, time: np.ndarray, q: np.ndarray, obstacles: Sequence[collision.Obstacle]
) -> tuple[Clearance, ...]:
    """Return the deepest penetration of each obstacle along a motion, deepest first; empty without collision geometry.

    Joints move at constant rate between the given configurations.

    Args:
        robot: the robot.
        time: times (N,) [s].
        q: configurations (N, nq).
        obstacles: bodies in the world.
    """
    if not obstacles or not robot.has_collision_shapes:  # in this order: reading meshes takes time
        return ()
    checked = collision.CollisionDistances(robot, obstacles, collision.PairSelection(links=False))
    distances, found = collision.continuous_distances(checked, time, q, within=0.0), dict[str, Clearance]()
    for k in np.argsort(distances.smallest, kind="stable").tolist():
        passed = _clearance(checked, distances, k)
        if passed.distance < -ROUNDING:
            # Deepest first: of each obstacle the first pair stays.
            found.setdefault(passed.names[1], passed)
    return tuple(found.values())


def _clearance(checked: collision.CollisionDistances, found: collision.ContinuousDistances, pair: int) -> Clearance:
    names, obstacle = checked.pairs[pair].names, checked.pairs[pair].second >= checked.link_shapes
    kind = bool(found.constant[pair]), bool(found.uncertain[pair])
    return Clearance(names, float(found.smallest[pair]), float(found.time[pair]), obstacle, *kind)


def _spaced(time: np.ndarray, step: float) -> np.ndarray:
    """Indices of samples that are at least a step apart, with the first and the last."""
    if not step > 0:
        return np.arange(len(time))
    # Sums of periods round: a sample may be just before its mark.
    marks = np.arange(time[0], time[-1], step) - 1e-9 * step
    # The end of a run is what a reader of a curve looks for.
    return np.unique([*np.searchsorted(time, marks), len(time) - 1])


class _Limited(NamedTuple):
    """Values (N,) over time with their limits, the range that shares refer to, and the share that is rounding."""

    kind: LimitKind
    name: str
    values: np.ndarray
    lower: float
    upper: float
    span: float
    rounding: float = ROUNDING

    @property
    def excess(self) -> np.ndarray:
        """Excess (N,) over the limits, as a share of the range; -1 for values that are not finite."""
        beyond = np.maximum(self.values - self.upper, self.lower - self.values) / self.span
        # Values that are not finite have a finding of their own, and would hide the largest use.
        return np.where(np.isfinite(self.values), beyond, -1.0)

    def use(self, time: np.ndarray) -> LimitUse:
        """Largest use, at times (N,); a limit of an absolute value is positive."""
        excess = self.excess
        at = int(excess.argmax())
        value, limit = float(self.values[at]), self.upper
        # Of limits with signs the nearer one is told.
        if self.kind in ("position", "acceleration") and self.lower - value > value - self.upper:
            limit = self.lower
        return LimitUse(self.kind, self.name, float(excess[at]), float(time[at]), value, limit, self.rounding)


def _positions(robot: Robot, run: RunData) -> Iterator[_Limited]:
    names = robot.velocity_names
    for q, v, low, high in zip(*limited_positions(robot, None), strict=True):
        yield _Limited("position", names[v], run.q[:, q], float(low), float(high), float(high - low))


def _rates(robot: Robot, run: RunData) -> Iterator[_Limited]:
    limits = known_velocity_limits(robot.model).tolist()
    for name, limit, values in zip(robot.velocity_names, limits, run.v.T, strict=True):
        if limit < np.inf:
            yield _Limited("velocity", name, values, -limit, limit, limit)


def _efforts(robot: Robot, run: RunData, others: Mapping[str, float]) -> Iterator[_Limited]:
    """Effort limits of driven joints, and of other actuators with stated limits.

    A limit of zero holds where the file states another effort for some joint: nothing can drive this one. Zeros are
    placeholders if the file has no other efforts, or if the velocity limit of the joint is zero too.
    """
    limits = robot.model.upperEffortLimit
    stated = limits[(limits > 0) & (limits < NO_LIMIT)]
    for column, name in enumerate(run.info.outputs.T.names):
        # Forces on frames are actuators without a joint, so the file cannot limit them.
        if name in others:
            yield _Limited("effort", name, run.T[:, column], -others[name], others[name], others[name])
        if name not in robot.joint_names:
            continue
        place = robot.velocity_indices(name)
        limit = float(limits[place.start])
        # A limit of zero counts if the file lets the joint move: a passive joint. Files without limits have zeros
        # everywhere. Plants and programs clip to no limit of zero (``Actuation.limits``), so a run can exceed it.
        is_stated = limit > 0 or (limit == 0 and len(stated) > 0 and robot.model.upperVelocityLimit[place.start] > 0)
        if place.stop - place.start == 1 and is_stated and limit < NO_LIMIT:
            # An excess over zero has no share of its own limit.
            span = limit if limit > 0 else float(stated.max())
            yield _Limited("effort", name, run.T[:, column], -limit, limit, span)


def _accelerations(run: RunData, limits: Sequence[LimitedAcceleration]) -> Iterator[_Limited]:
    """Limits of acceleration, each at the sample before the change of velocity."""
    if len(run.time) < 2:
        return
    spans = np.diff(run.time, append=np.nan)  # the last sample has no acceleration
    spans[spans <= 0.0] = np.nan  # velocities jump between the samples of an impact
    for name, quantity, column, lower, upper, rounding in limits:
        rates = np.diff(run.arrays[quantity][:, column], append=0.0) / spans
        # One side may be unlimited or zero: the other one gives the scale.
        span = max((abs(each) for each in (lower, upper) if 0.0 < abs(each) < np.inf), default=1.0)
        yield _Limited("acceleration", name, rates, lower, upper, span, rounding)
