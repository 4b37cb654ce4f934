"""Control loop for an external process: measurements in, actuator inputs out."""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
