"""``python -m rnc_pin`` is ``rnc-pin``."""

from rnc_pin.app.cli import main

main()
