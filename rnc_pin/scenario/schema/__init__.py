"""Schema of scenario files: one module for each group of keys."""

from rnc_pin.scenario.schema.scenario import Scenario
from rnc_pin.scenario.schema.simulation_settings import SimulationSettings

__all__ = ["Scenario", "SimulationSettings"]
