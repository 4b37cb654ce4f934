"""Gymnasium environments of scenarios, for learning; Gymnasium itself is the extra ``gym``.

envs = rnc.gym.make_vec("mobile-manipulator", num_envs=64)
observations, info = envs.reset(seed=0)
"""

from rnc_pin.gym.episode_batch import Transition
from rnc_pin.gym.episode_limits import EpisodeLimits
from rnc_pin.gym.making import make, make_vec

__all__ = ["EpisodeLimits", "Transition", "make", "make_vec"]
