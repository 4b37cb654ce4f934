"""What a scenario file may say, one file a family."""

from rnc_pin.scenario.schema.scenario import Scenario
from rnc_pin.scenario.schema.simulation import SimulationSettings

__all__ = ["Scenario", "SimulationSettings"]
