"""Exports of ``rnc_pin.applications.gym``, which ``__init__.py`` imports at their first use."""

from .episode_batch import Transition as Transition
from .episode_task import EpisodeLimits as EpisodeLimits
from .making import make as make
from .making import make_vec as make_vec
