"""What a scenario file may say, one file a family."""

from rnc_pin.scenario.schema.controller import ControllerSettings
from rnc_pin.scenario.schema.scenario import Scenario, SimulationSettings

__all__ = ["ControllerSettings", "Scenario", "SimulationSettings"]
