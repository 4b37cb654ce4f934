"""Batch of episodes of a scenario: plants, observations, rewards and failures; no dependence on Gymnasium."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rnc_pin.applications.gym.episode_task import EpisodeStart, EpisodeTask, SpaceBounds
from rnc_pin.errors import ConfigurationError, DivergenceError, InputError, LimitError, SingularityError
from rnc_pin.finding_kinds import FindingKind
from rnc_pin.model import StateEvaluation, scaled_rows, wrapped
from rnc_pin.plants import ReducedPlant, ReducedPlantBatch
from rnc_pin.simulation import PENETRATION, Stop, StopMonitor


class Transition(NamedTuple):
    """One step of B episodes: the state after it, and the inputs during it; the argument of a reward function.

    Example:
        >>> def reward(step: rnc.gym.Transition) -> np.ndarray:
        ...     return -np.square(step.error).sum(axis=-1) - 1e-3 * np.square(step.T).sum(axis=-1) - 10.0 * step.failed
        >>> env = rnc.gym.make("space-robot", limits=rnc.gym.EpisodeLimits(5.0, 5.0, 3.0), reward=reward)
    """

    time: np.ndarray
    """Times (B,) since the start of each episode [s]."""
    x1: np.ndarray
    """Vertical outputs (B, k)."""
    x2: np.ndarray
    """Reducing outputs (B, r); integrals of quasi-velocities."""
    error: np.ndarray
    """Desired minus actual values (B, g) of the outputs with a reference, vertical ones first."""
    v2: np.ndarray
    """Reduced velocities (B, r)."""
    T: np.ndarray
    """Applied inputs (B, p)."""
    failed: np.ndarray
    """True (B,) for episodes that end here by a failure."""


Reward = Callable[[Transition], np.ndarray]


class EpisodeBatch:
    """Episodes that advance together. Each is independent of the others, to the bit.

    Args:
        task: the task.
        bounds: limits of inputs, velocities and outputs.
        size: number of episodes B.
        reward: reward of each step (B,); None for ``tracking_reward``.

    Attributes:
        size: number of episodes.
        largest_inputs: bounds (p,) of the inputs [N or N m].
        high: bounds (n,) of the observations ``[x1, x2, error, v2]``.
        observations: clipped observations (B, n).
        failures: kind (B,) of the finding that each failure is in a verdict: "singular", "ended_early", "position" or
            "collision"; empty without one.

    Raises:
        ConfigurationError: the scenario has no reference, and there is no ``reward``.
    """

    def __init__(self, task: EpisodeTask, bounds: SpaceBounds, size: int, reward: Reward | None = None) -> None:
        self._task, self._bounds, self._reduced, self.size = task, bounds, task.reduced, size
        self.largest_inputs = bounds.input
        settings, reduced = task.scenario.simulation, task.reduced
        assert settings is not None
        options = settings.plant_options | {"actuator_limits": False}  # ``step`` clips
        if settings.substeps is not None:
            options["substeps"] = settings.substeps * task.samples
        plant = ReducedPlant(reduced, **options)
        self._plants = ReducedPlantBatch(plant, size)
        self._plants.reset(task.nominal.q, task.nominal.v)
        self._nominal = self._plants.checkpoint(0)
        self._stop = StopMonitor(Stop(speed=np.inf, position_limits=True), reduced.robot)
        self._starts: list[EpisodeStart] = [task.nominal] * size
        k, r = reduced.vertical.size, reduced.r
        self._goals_1, self._goals_2 = (_places(task.nominal, vertical) for vertical in (True, False))
        self._angular = np.concatenate([reduced.vertical.coordinates.angular, reduced.reducing.coordinates.angular])
        goals = np.concatenate([self._goals_1, k + self._goals_2])
        angles = np.concatenate([reduced.vertical.coordinates.kinds, reduced.reducing.coordinates.kinds]) > 0
        self.error_high = (np.where(angles, 1.0, 2.0) * bounds.output)[goals]
        self.high = np.concatenate([bounds.output, self.error_high, bounds.speed])
        if reward is None and not len(goals):
            raise ConfigurationError("the scenario has no 'reference' for its outputs: give a function as 'reward'")
        self._reward: Reward = self.tracking_reward if reward is None else reward
        self._k, self._g, self._r = k, len(goals), r
        self._values = np.zeros((size, k + r + len(goals) + r))
        self._q = np.tile(task.nominal.q, (size, 1))
        self._counts = np.zeros(size, dtype=int)
        self.failures = [""] * size
        self._over = np.ones(size, dtype=bool)

    @property
    def observations(self) -> np.ndarray:
        """Clipped observations (B, n), a copy."""
        return np.clip(self._values, -self.high, self.high)

    @property
    def configurations(self) -> np.ndarray:
        """Configurations (B, nq) at the last regular samples."""
        return self._q.copy()

    @property
    def times(self) -> np.ndarray:
        """Times (B,) since the start of each episode [s]."""
        return self._counts * self._task.period

    def start(self, i: int, generator: np.random.Generator) -> None:
        """Start episode i anew.

        Raises:
            ConfigurationError: no draw gives a start.
        """
        start = self._task.start(generator)
        plants, nominal, r = self._plants, self._nominal, self._r
        # The chart of the nominal start serves all others that it covers: a new one costs as much as many steps.
        y = nominal.y.copy()
        y[:r] = nominal.chart.W @ start.v
        try:
            nominal.chart.velocity(start.q, y[:r], 0.0)
            plants.rollback(i, nominal._replace(q=start.q, y=y, state=None, applied=np.zeros(self._reduced.p)))
        except SingularityError:
            plants.reset(start.q, start.v, [i])
        self._starts[i], self._counts[i], self.failures[i] = start, 0, ""
        self._over[i] = False
        state = self._reduced.at(start.q, v=start.v, t=0.0)
        x1, x2 = state.outputs(np.zeros(r))
        self._observe(np.array([i]), state.q[None], x1[None], x2[None], state.v2[None])

    def step(self, T: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Advance some episodes by one period.

        Args:
            T: inputs (B, p); larger ones than the limits are clipped.
            chosen: indices (b,) of the episodes.

        Returns:
            Rewards (b,), and masks (b,) of failed episodes and of those at the end of their time.

        Raises:
            InputError: T has the wrong shape, or is not finite; or an episode is over.
        """
        size, p = self.size, self._reduced.p
        if self._over[chosen].any():
            raise InputError("an episode has not started or is over: call reset()")
        T = np.asarray(T, dtype=float)
        if T.shape != (size, p) or not np.isfinite(T[chosen]).all():
            raise InputError(f"actions: expected finite numbers of shape {(size, p)}, found shape {T.shape}: {T}")
        T = np.clip(np.where(self._over[:, None], 0.0, T), -self._bounds.input, self._bounds.input)
        self._counts[chosen] += 1
        self._plants.apply(T)
        self._plants.advance(self._task.period)  # those that are over move too; nothing reads them
        self._measure(chosen)
        failed = np.array([self.failures[i] != "" for i in chosen], dtype=bool)
        x1, x2, error, v2 = np.split(self._values[chosen], np.cumsum([self._k, self._r, self._g]), axis=1)
        rewards = np.asarray(self._reward(Transition(self.times[chosen], x1, x2, error, v2, T[chosen], failed)), float)
        if rewards.shape != (len(chosen),):
            raise InputError(f"reward: expected shape {(len(chosen),)}, found {rewards.shape}")
        ended = self._counts[chosen] >= self._task.steps
        self._over[chosen] = failed | ended
        return rewards, failed, ended

    def tracking_reward(self, step: Transition) -> np.ndarray:
        """Default reward (B,): minus the mean error relative to its bound, times the period.

        A failure costs as much as errors at their bounds for the rest of the episode, so that it never pays. The sum
        over an episode is between minus its duration and zero.
        """
        period, duration = self._task.period, self._task.period * self._task.steps
        errors = np.minimum(np.abs(step.error) / self.error_high, 1.0).mean(axis=-1)
        return np.where(step.failed, -(duration - step.time + period), -period * errors)

    def _measure(self, chosen: np.ndarray) -> None:
        """Observe episodes after a step, and find their failures."""
        plants, data = self._plants, self._reduced.reduction_data
        integrals, known = plants.integrals, np.zeros(self.size, dtype=bool)
        if plants.measures:
            states, known = plants.measure()
            together = chosen[known[chosen]]
            x1, x2 = (each[together] for each in states.outputs(integrals))
            v2, singular_values = states.v2[together], _smallest_singular_values(states.E[together], data.lengths)
            self._observe(together, states.q[together], x1, x2, v2)
            stopping = self._stop.stopped(states).any()
            for i, speed, value in zip(together.tolist(), v2, singular_values, strict=True):
                state = plants.state(states, i) if stopping else None
                self.failures[i] = self._failure(state, speed, float(value))
        else:
            plants.read()
        for i in chosen[~known[chosen]].tolist():
            state = None if plants.failed[i] else plants.checkpoint(i).state
            if state is None:
                diverged = isinstance(plants.errors[i], DivergenceError)
                self.failures[i] = str(FindingKind.ENDED_EARLY if diverged else FindingKind.SINGULAR)
                continue
            x1, x2 = state.outputs(integrals[i])
            self._observe(np.array([i]), state.q[None], x1[None], x2[None], state.v2[None])
            self.failures[i] = self._failure(state, state.v2, float(state.smallest_singular_value))
        if self._task.distances is not None:
            for i in chosen.tolist():
                nearest = self._task.distances.smallest(self._q[i], float(self.times[i]))
                if not self.failures[i] and nearest.min(initial=0.0) < -PENETRATION:
                    self.failures[i] = str(FindingKind.COLLISION)

    def _failure(self, state: StateEvaluation | None, v2: np.ndarray, singular_value: float) -> str:
        """Failure at a measured state, which is None if all joints are within their limits."""
        if state is not None:
            try:
                self._stop.check(0.0, state)
            except LimitError:
                return str(FindingKind.POSITION)
            except DivergenceError:
                return str(FindingKind.ENDED_EARLY)
        if not (np.abs(v2) < self._bounds.speed).all():
            return str(FindingKind.ENDED_EARLY)
        return str(FindingKind.SINGULAR) if singular_value < self._task.min_singular_value else ""

    def _observe(self, which: np.ndarray, q: np.ndarray, x1: np.ndarray, x2: np.ndarray, v2: np.ndarray) -> None:
        """Write configurations, outputs, errors and velocities of some episodes, a row each."""
        desired_1, desired_2 = x1.copy(), x2.copy()
        for row, i in enumerate(which.tolist()):
            t = float(self._counts[i] * self._task.period)
            for is_vertical, places, reference in self._starts[i].references:
                (desired_1 if is_vertical else desired_2)[row, places] = reference.at(t).position
        values, reduced = np.concatenate([x1, x2], axis=1), self._reduced
        self._q[which] = q
        self._values[which] = np.concatenate(
            [
                np.where(self._angular, wrapped(values), values),
                reduced.vertical.coordinates.difference(desired_1, x1)[:, self._goals_1],
                reduced.reducing.coordinates.difference(desired_2, x2)[:, self._goals_2],
                v2,
            ],
            axis=1,
        )


def _smallest_singular_values(E: np.ndarray, typical: np.ndarray) -> np.ndarray:
    """Smallest singular values (b,) of stacks E (b, nv, nv) with scaled rows."""
    return np.linalg.svd(scaled_rows(E, typical), compute_uv=False)[:, -1]


def _places(start: EpisodeStart, is_vertical: bool) -> np.ndarray:
    """Indices of the vertical or of the reducing outputs that have a reference, in increasing order."""
    places = [each.places for each in start.references if each.is_vertical == is_vertical]
    return np.unique(np.concatenate([np.zeros(0, dtype=int), *places]))
