"""Makers of environments from scenarios."""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType
from typing import TYPE_CHECKING

from rnc_pin.applications.gym.episode_batch import EpisodeBatch, Reward
from rnc_pin.applications.gym.episode_task import EpisodeLimits, EpisodeTask
from rnc_pin.errors import ConfigurationError
from rnc_pin.extras import check_extra
from rnc_pin.io import Json

if TYPE_CHECKING:
    from rnc_pin.applications.gym.environments import ScenarioEnv, ScenarioVectorEnv


def make(
    scenario: str,
    *,
    options: Mapping[str, Json] | None = None,
    draws: Mapping[str, object] | None = None,
    period: float | None = None,
    limits: EpisodeLimits | None = None,
    reward: Reward | None = None,
) -> ScenarioEnv:
    """Make one environment of a scenario; ``make_vec`` makes many at a time.

    Args:
        scenario: a built-in name or a file.
        options: dotted keys and values to replace.
        draws: dotted keys under ``initial`` or ``reference``, with ranges for random starts; by default the ``sweep``
            of the scenario, ``{}`` for one start.
        period: time between two actions [s], a multiple of ``simulation.dt``; ten of them by default.
        limits: limits of an episode; those left out have the defaults of ``EpisodeLimits``.
        reward: function of a ``Transition``; by default ``EpisodeBatch.tracking_reward``.

    Raises:
        ConfigurationError: Gymnasium is missing, or an environment does not support the scenario.
        RncError: the scenario or a limit is invalid.

    Example:
        >>> env = rnc.gym.make("space-robot", limits=rnc.gym.EpisodeLimits(input=5.0, speed=5.0, output=3.0))
        >>> observation, info = env.reset(seed=0)
        >>> env.action_space
        Box(-5.0, 5.0, (3,), float64)
    """
    from_gymnasium = _environments()
    return from_gymnasium.ScenarioEnv(_batch(scenario, options, draws, period, limits, reward, 1))


def make_vec(
    scenario: str,
    num_envs: int,
    *,
    options: Mapping[str, Json] | None = None,
    draws: Mapping[str, object] | None = None,
    period: float | None = None,
    limits: EpisodeLimits | None = None,
    reward: Reward | None = None,
    autoreset_mode: str = "NextStep",
) -> ScenarioVectorEnv:
    """Make many environments of a scenario, each equal to that of ``make`` to the bit.

    Args:
        scenario, options, draws, period, limits, reward: as for ``make``.
        num_envs: number of environments.
        autoreset_mode: "NextStep", "SameStep" or "Disabled", as in ``gymnasium.vector.AutoresetMode``.

    Raises:
        ConfigurationError: as ``make``; num_envs is not positive, or the mode is not known.
        RncError: the scenario or a limit is invalid.

    Example:
        >>> limits = rnc.gym.EpisodeLimits(input=5.0, speed=5.0, output=3.0)
        >>> envs = rnc.gym.make_vec("space-robot", num_envs=3, limits=limits)
        >>> observations, info = envs.reset(seed=0)
        >>> observations, rewards, terminated, truncated, info = envs.step(np.zeros((3, 3)))
        >>> observations.shape, rewards.shape
        ((3, 10), (3,))
    """
    from_gymnasium = _environments()
    if isinstance(num_envs, bool) or not isinstance(num_envs, int) or num_envs < 1:
        raise ConfigurationError(f"num_envs: expected a positive integer, found {num_envs!r}")
    mode = from_gymnasium.autoreset_of(autoreset_mode)
    batch = _batch(scenario, options, draws, period, limits, reward, num_envs)
    return from_gymnasium.ScenarioVectorEnv(batch, mode)


def _batch(
    scenario: str,
    options: Mapping[str, Json] | None,
    draws: Mapping[str, object] | None,
    period: float | None,
    limits: EpisodeLimits | None,
    reward: Reward | None,
    size: int,
) -> EpisodeBatch:
    changes = dict(options or {})
    chosen = limits or EpisodeLimits()
    task = EpisodeTask(scenario, changes, draws, period, chosen.singular_value)
    bounds = chosen.completed(task.reduced, scenario, changes)
    return EpisodeBatch(task, bounds, size, reward)


def _environments() -> ModuleType:
    """Module of the environments, which imports Gymnasium."""
    check_extra("gym", "rnc.gym")
    from rnc_pin.applications.gym import environments

    return environments
