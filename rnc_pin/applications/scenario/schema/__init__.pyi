"""Exports of ``rnc_pin.applications.scenario.schema``, which ``__init__.py`` imports at their first use."""

from .run_settings import SimulationSettings as SimulationSettings
from .scenario import ScenarioFile as ScenarioFile
