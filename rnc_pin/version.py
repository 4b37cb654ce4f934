"""Which release this is, looked up when somebody asks."""

from importlib.metadata import version

__version__ = version("rnc_pin")
