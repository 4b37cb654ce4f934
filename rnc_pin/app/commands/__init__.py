"""What each command does; imported when it is called, so that help and completion wait for nothing.

Listed in ``__init__.pyi``. A module here imports whatever it needs at its top.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
