"""Requests to end: all of them as Ctrl-C; and while something is imported, one line and an exit status."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from rnc_pin.app.status import FAILED

_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_WORDS = "rnc-pin: error: interrupted\n"


@contextmanager
def interruptible_imports() -> Iterator[None]:
    """End the process at once on Ctrl-C inside, and on other requests to end.

    An exception would not do: libraries written in C turn it into an error of their own or print a traceback. Nothing
    is lost, for nothing has been computed while modules are still being imported.
    """
    main = threading.current_thread() is threading.main_thread()
    usual = [number for number in _ENDING if main and signal.getsignal(number) is signal.default_int_handler]
    for number in usual:  # of others somebody else sees to it
        signal.signal(number, _end)
    try:
        yield
    except KeyboardInterrupt:
        sys.stderr.write(_WORDS)
        sys.exit(FAILED)
    finally:
        for number in usual:
            signal.signal(number, signal.default_int_handler)


@contextmanager
def endings_as_ctrl_c() -> Iterator[None]:
    """Let a command end on SIGTERM, and when its terminal is closed, as it does on Ctrl-C: results so far are kept."""
    main = threading.current_thread() is threading.main_thread()
    usual = [number for number in _ENDING if main and signal.getsignal(number) is signal.SIG_DFL]
    for number in usual:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in usual:
            signal.signal(number, signal.SIG_DFL)


def _end(number: int, frame: FrameType | None) -> None:
    os.write(2, _WORDS.encode())
    os._exit(FAILED)
