"""Batch of episodes of a scenario: plants, observations, rewards and failures; no dependence on Gymnasium."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rnc_pin.errors import ConfigurationError, DivergenceError, InputError, LimitError, RncError, SingularityError
from rnc_pin.gym.episode_limits import SpaceBounds
from rnc_pin.gym.episode_task import EpisodeStart, EpisodeTask
from rnc_pin.math.coordinates import wrapped
from rnc_pin.plants import ReducedPlant
from rnc_pin.plants.reduced.reduced_plant import Checkpoint
from rnc_pin.simulation.stop import Stop, StopMonitor


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
        failures: reason (B,) of each failure: "singular", "diverged", "limit"; empty without one.

    Raises:
        ConfigurationError: the scenario has no reference, and there is no ``reward``.
    """

    def __init__(self, task: EpisodeTask, bounds: SpaceBounds, size: int, reward: Reward | None = None) -> None:
        self._task, self._bounds, self._reduced, self.size = task, bounds, task.reduced, size
        self.largest_inputs = bounds.input
        settings, reduced = task.scenario.simulation, task.reduced
        assert settings is not None
        damped, rubbing, substeps = settings.joint_damping, settings.joint_friction, settings.substeps * task.samples
        self._plants = [ReducedPlant(reduced, damped, True, rubbing, substeps) for _ in range(size)]
        self._plants[0].reset(task.nominal.q, task.nominal.v)
        self._nominal = self._plants[0].checkpoint()
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
        plant, nominal, r = self._plants[i], self._nominal, self._r
        # The chart of the nominal start serves all others that it covers: a new one costs as much as many steps.
        y = nominal.y.copy()
        y[:r] = nominal.chart.W @ start.v
        try:
            plant.rollback(Checkpoint(start.q, y, None, np.zeros(self._reduced.p), nominal.chart))
            _ = plant.state
        except (SingularityError, DivergenceError):
            plant.reset(start.q, start.v)
        self._starts[i], self._counts[i], self.failures[i] = start, 0, ""
        self._over[i] = False
        self._observe(i)

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
        T = np.clip(T, -self._bounds.input, self._bounds.input)
        for i in chosen:
            self._counts[i] += 1
            self.failures[i] = self._advance(int(i), T[i])
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

    def _advance(self, i: int, T: np.ndarray) -> str:
        """Advance one episode and return its failure."""
        plant, task = self._plants[i], self._task
        try:
            plant.apply(T)
            plant.advance(task.period)
            state = plant.state
            self._stop.check(0.0, state)
            self._observe(i)
            if not (np.abs(state.v2) < self._bounds.speed).all():
                return "diverged"
            singular = state.smallest_singular_value < task.min_singular_value
            return "singular" if singular else ""
        except LimitError:
            self._observe(i)
            return "limit"
        except DivergenceError:
            return "diverged"
        except RncError:
            return "singular"

    def _observe(self, i: int) -> None:
        """Read the outputs, errors and velocities of one episode."""
        plant, reduced, t = self._plants[i], self._reduced, float(self._counts[i] * self._task.period)
        state = plant.state
        x1, x2 = state.outputs(plant.integrals)
        desired_1, desired_2 = x1.copy(), x2.copy()
        for is_vertical, places, reference in self._starts[i].references:
            (desired_1 if is_vertical else desired_2)[places] = reference.at(t).position
        self._q[i], values = state.q, np.concatenate([x1, x2])
        self._values[i] = np.concatenate(
            [
                np.where(self._angular, wrapped(values), values),
                reduced.vertical.coordinates.difference(desired_1, x1)[self._goals_1],
                reduced.reducing.coordinates.difference(desired_2, x2)[self._goals_2],
                state.v2,
            ]
        )


def _places(start: EpisodeStart, is_vertical: bool) -> np.ndarray:
    """Indices of the vertical or of the reducing outputs that have a reference, in increasing order."""
    places = [each.places for each in start.references if each.is_vertical == is_vertical]
    return np.unique(np.concatenate([np.zeros(0, dtype=int), *places]))
