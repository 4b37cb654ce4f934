"""``python -m rnc_pin``: the same as ``rnc-pin``."""

from rnc_pin.app.cli import main

main()
