"""Plants: controlled systems with actuator inputs and measured states, and wrappers for faults and mid-run changes."""

from rnc_pin.plants.changing import ChangingMachine
from rnc_pin.plants.faults import Faults, FaultyMachine
from rnc_pin.plants.protocol import Machine

__all__ = ["ChangingMachine", "Faults", "FaultyMachine", "Machine"]
