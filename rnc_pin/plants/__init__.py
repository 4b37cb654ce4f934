"""What is controlled: anything that moves under inputs and can be measured."""

from rnc_pin.plants.protocol import Machine

__all__ = ["Machine"]
