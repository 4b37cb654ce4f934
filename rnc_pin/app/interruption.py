"""Requests to end: all of them as Ctrl-C; and while something is imported, one line and an exit status."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from rnc_pin.app.status import FAILED
from rnc_pin.interruption import requests_to_end

_WORDS = "rnc-pin: error: interrupted\n"


@contextmanager
def interruptible_imports() -> Iterator[None]:
    """End the process at once on Ctrl-C inside, and on other requests to end.

    An exception would not do: libraries written in C turn it into an error of their own or print a traceback. Nothing
    is lost, for nothing has been computed while modules are still being imported.
    """
    with requests_to_end(_end, signal.default_int_handler):
        try:
            yield
        except KeyboardInterrupt:
            sys.stderr.write(_WORDS)
            sys.exit(FAILED)


@contextmanager
def endings_as_ctrl_c() -> Iterator[None]:
    """Let a command end on SIGTERM, and when its terminal is closed, as it does on Ctrl-C: results so far are kept."""
    with requests_to_end(signal.default_int_handler, signal.SIG_DFL):
        yield


def _end(number: int, frame: FrameType | None) -> None:
    os.write(2, _WORDS.encode())
    os._exit(FAILED)
