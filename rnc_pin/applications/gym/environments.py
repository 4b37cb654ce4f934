"""Environments in the interfaces of Gymnasium."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy

import numpy as np
from gymnasium import Env, spaces
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from rnc_pin.applications.gym.episode_batch import EpisodeBatch
from rnc_pin.errors import ConfigurationError, nearest

Info = dict[str, object]


def autoreset_of(mode: str | AutoresetMode) -> AutoresetMode:
    """Return the mode in which finished environments restart.

    Raises:
        ConfigurationError: the mode is not known.
    """
    try:
        return AutoresetMode(mode)
    except ValueError:
        hint = nearest(str(mode), [each.value for each in AutoresetMode])
        raise ConfigurationError(f"autoreset_mode: '{mode}' is not known{hint}") from None


class ScenarioEnv(Env[np.ndarray, np.ndarray]):
    """Environment of one episode at a time.

    Observations are ``[x1, x2, error, v2]``, actions are the inputs of the actuators. ``info`` has the time [s] of the
    episode, and the ``failure`` that ended it: "singular", "ended_early", "position", or none.

    Args:
        batch: a batch of one episode.
    """

    metadata: dict[str, object] = {"render_modes": []}  # noqa: RUF012

    def __init__(self, batch: EpisodeBatch) -> None:
        self.batch = batch
        self.observation_space, self.action_space = _spaces(batch)

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[np.ndarray, Info]:
        """Start an episode; ``options`` are not used."""
        super().reset(seed=seed)
        self.batch.start(0, self.np_random)
        return self.batch.observations[0], _info(self.batch, 0)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, Info]:
        """Hold the inputs (p,) for one period."""
        rewards, failed, ended = self.batch.step(np.asarray(action)[None], np.zeros(1, dtype=int))
        return self.batch.observations[0], float(rewards[0]), bool(failed[0]), bool(ended[0]), _info(self.batch, 0)


class ScenarioVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Environment of many episodes at a time; see ``ScenarioEnv``.

    Args:
        batch: the episodes.
        autoreset_mode: time at which finished episodes restart.
    """

    def __init__(self, batch: EpisodeBatch, autoreset_mode: AutoresetMode) -> None:
        self.batch, self.num_envs = batch, batch.size
        self.metadata = {"render_modes": [], "autoreset_mode": autoreset_mode}
        self.single_observation_space, self.single_action_space = _spaces(batch)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._mode = autoreset_mode
        self._generators = [np_random()[0] for _ in range(self.num_envs)]
        self._finished = np.zeros(self.num_envs, dtype=bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Info | None = None
    ) -> tuple[np.ndarray, Info]:
        """Start all episodes, or those of the mask ``options["reset_mask"]`` (num_envs,).

        Args:
            seed: the seed of the first environment, which the others count up from; or a seed for each.
            options: options of Gymnasium.
        """
        if seed is None or isinstance(seed, int | np.integer):
            seeds = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool)))
        if len(seeds) != self.num_envs or mask.shape != (self.num_envs,) or mask.dtype != bool:
            raise ConfigurationError(f"seed and reset_mask: expected {self.num_envs} seeds, and as many booleans")
        infos: Info = {}
        for i in np.flatnonzero(mask):
            if seeds[i] is not None:
                self._generators[i] = np_random(seeds[i])[0]
            infos = self._start(int(i), infos)
        return self.batch.observations, infos

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, Info]:
        """Hold the inputs (num_envs, p) for one period.

        Raises:
            ConfigurationError: an episode is over, and the mode is "Disabled".
        """
        rewards, (terminated, truncated) = np.zeros(self.num_envs), np.zeros((2, self.num_envs), dtype=bool)
        if self._mode is AutoresetMode.DISABLED and self._finished.any():
            raise ConfigurationError("an episode is over: reset it with options={'reset_mask': ...}")
        waiting, going = np.flatnonzero(self._finished), np.flatnonzero(~self._finished)
        if len(going):
            rewards[going], terminated[going], truncated[going] = self.batch.step(actions, going)
        infos: Info = {}
        self._finished = terminated | truncated
        for i in range(self.num_envs):
            if i in waiting:
                infos = self._start(i, infos)
            elif self._finished[i] and self._mode is AutoresetMode.SAME_STEP:
                final = {"final_obs": self.batch.observations[i], "final_info": _info(self.batch, i)}
                infos = self._start(i, self._add_info(infos, final, i))
            else:
                infos = self._add_info(infos, _info(self.batch, i), i)
        return self.batch.observations, rewards, terminated, truncated, infos

    def _start(self, i: int, infos: Info) -> Info:
        """Start one episode and add its information."""
        self.batch.start(i, self._generators[i])
        self._finished[i] = False
        found: Info = self._add_info(infos, _info(self.batch, i), i)
        return found


def _spaces(batch: EpisodeBatch) -> tuple[spaces.Box, spaces.Box]:
    """Spaces of observations and actions."""
    largest = deepcopy(batch.largest_inputs)
    return spaces.Box(-batch.high, batch.high, dtype=np.float64), spaces.Box(-largest, largest, dtype=np.float64)


def _info(batch: EpisodeBatch, i: int) -> Info:
    return {"time": float(batch.times[i]), "failure": batch.failures[i]}
