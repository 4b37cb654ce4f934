"""Applications of the library: scenario files, drafts, driven runs, sweeps, environments, the command line."""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
