"""Ctrl-C while something is imported: one line and an exit status, whatever it was that was being imported."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from rnc_pin.app.status import FAILED

_WORDS = "rnc-pin: error: interrupted\n"


@contextmanager
def interruptible_imports() -> Iterator[None]:
    """End the process at once on Ctrl-C inside.

    An exception would not do: libraries written in C turn it into an error of their own or print a traceback. Nothing
    is lost, for nothing has been computed while modules are still being imported.
    """
    usual = threading.current_thread() is threading.main_thread() and (
        signal.getsignal(signal.SIGINT) is signal.default_int_handler  # else somebody else sees to it
    )
    if usual:
        signal.signal(signal.SIGINT, _end)
    try:
        yield
    except KeyboardInterrupt:
        sys.stderr.write(_WORDS)
        sys.exit(FAILED)
    finally:
        if usual:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def _end(number: int, frame: FrameType | None) -> None:
    os.write(2, _WORDS.encode())
    os._exit(FAILED)
