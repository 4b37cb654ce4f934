"""Functions of the commands, imported at the first call, so that help and completion are fast.

``__init__.pyi`` lists them. Each module here imports what it needs at its top.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
