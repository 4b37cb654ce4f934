"""What is controlled: anything that moves under inputs and can be measured."""

from rnc_pin.plants.changing import ChangingMachine
from rnc_pin.plants.faults import Faults, FaultyMachine
from rnc_pin.plants.protocol import Machine

__all__ = ["ChangingMachine", "Faults", "FaultyMachine", "Machine"]
