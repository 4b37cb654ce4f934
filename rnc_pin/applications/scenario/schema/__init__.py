"""Schema of scenario files: one module for each group of keys.

Its exports are imported at their first use: a scenario contains controllers, whose settings use this package.
"""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
