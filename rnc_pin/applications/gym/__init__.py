"""Gymnasium environments of scenarios, for learning; Gymnasium itself is the extra ``gym``.

envs = rnc.gym.make_vec("mobile-manipulator", num_envs=64)
observations, info = envs.reset(seed=0)
"""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
