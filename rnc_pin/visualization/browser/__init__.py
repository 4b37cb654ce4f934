"""Browser: the drawing commands that a page receives, the page, the server, and the check of who may connect."""

from rnc_pin.lazy_exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__)
