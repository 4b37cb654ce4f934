"""Command line: options, messages and tables, and the functions of the commands.

``__init__.pyi`` lists these functions. Each is imported at its first call, so that help and completion are fast. The
modules of commands import what they need at their top.
"""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
