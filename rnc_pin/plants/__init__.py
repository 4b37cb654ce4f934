"""Plants: controlled systems with actuator inputs and measured states, and wrappers for faults and mid-run changes."""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
