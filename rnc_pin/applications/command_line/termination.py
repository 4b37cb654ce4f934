"""Exit statuses, and termination signals: all act as Ctrl-C; during imports they print one line and exit."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from rnc_pin.interruption import termination_handler

DONE, FAILED, USAGE = 0, 1, 2


_WORDS = "rnc-pin: error: interrupted\n"


@contextmanager
def interruptible_imports() -> Iterator[None]:
    """End the process at once on Ctrl-C, SIGTERM or SIGHUP inside.

    An exception is not enough: C libraries turn it into an error of their own or print a traceback. No result is lost,
    since nothing is computed during imports.
    """
    with termination_handler(_end, signal.default_int_handler):
        try:
            yield
        except KeyboardInterrupt:
            sys.stderr.write(_WORDS)
            sys.exit(FAILED)


@contextmanager
def endings_as_ctrl_c() -> Iterator[None]:
    """Treat SIGTERM and SIGHUP (closed terminal) as Ctrl-C: results so far are kept."""
    with termination_handler(signal.default_int_handler, signal.SIG_DFL):
        yield


def _end(number: int, frame: FrameType | None) -> None:
    os.write(2, _WORDS.encode())
    os._exit(FAILED)
