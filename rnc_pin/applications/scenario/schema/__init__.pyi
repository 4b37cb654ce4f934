"""Exports of ``rnc_pin.applications.scenario.schema``, which ``__init__.py`` imports at their first use."""

from .scenario import ScenarioFile as ScenarioFile
from .simulation_settings import SimulationSettings as SimulationSettings
