"""``python -m rnc_pin``: the same as ``rnc-pin``."""

from rnc_pin.applications.command_line.cli import run

run()
