"""Release of the installed package, determined at import of this module."""

from importlib.metadata import PackageNotFoundError, version


def _installed() -> str:
    try:
        return version("rnc_pin")
    except PackageNotFoundError:  # a source folder on PYTHONPATH has no metadata
        return "unknown"


__version__ = _installed()
"""Release of the installed package; "unknown" for a source folder on ``PYTHONPATH``, which has no metadata."""
