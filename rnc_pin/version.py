"""Which release this is, looked up when somebody asks."""

from importlib.metadata import PackageNotFoundError, version


def _installed() -> str:
    try:
        return version("rnc_pin")
    except PackageNotFoundError:  # a source folder on PYTHONPATH has no metadata
        return "unknown"


__version__ = _installed()
"""Release of the installed package; "unknown" where a source folder on ``PYTHONPATH`` has no metadata."""
