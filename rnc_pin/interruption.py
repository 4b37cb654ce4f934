"""Ctrl-C between the steps of a run; it is deferred while results are collected or written, so that none is lost.

SIGTERM and SIGHUP act as Ctrl-C. During the imports of a command, each prints one line and ends the process.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

Handler = Callable[[int, FrameType | None], object]


@contextmanager
def termination_handler(handler: Handler, instead_of: Handler | signal.Handlers) -> Iterator[None]:
    """Handle SIGINT (Ctrl-C), SIGTERM and SIGHUP (closed terminal) inside.

    Args:
        handler: handler of those signals.
        instead_of: expected current handler. Signals with another handler do not change, nor do threads other than
            the main one.
    """
    # Only the handlers that are expected: a program that set its own keeps them, and threads may set none.
    replaced = [number for number in _SIGNALS if _in_main_thread() and signal.getsignal(number) is instead_of]
    for number in replaced:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number in replaced:
            if signal.getsignal(number) is handler:  # it may be ignored meanwhile
                signal.signal(number, instead_of)


_WORDS = "rnc-pin: error: interrupted"
_of_command = False


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
            sys.exit(_WORDS)


@contextmanager
def nothing_to_keep() -> Iterator[None]:
    """In a command, end the process at once as in imports: pydantic and finalizers swallow exceptions."""
    with termination_handler(_end, signal.default_int_handler) if _of_command else nullcontext():
        yield


def _end(number: int, frame: FrameType | None) -> None:
    # Not print: a handler may run while the buffer of the stream is locked.
    os.write(2, f"{_WORDS}\n".encode())
    os._exit(1)  # as sys.exit with words


@contextmanager
def endings_as_ctrl_c() -> Iterator[None]:
    """Treat SIGTERM and SIGHUP (closed terminal) as Ctrl-C in a command: results so far are kept."""
    global _of_command
    before, _of_command = _of_command, True
    try:
        with termination_handler(signal.default_int_handler, signal.SIG_DFL):
            yield
    finally:
        _of_command = before


def ignore_endings() -> None:
    """Ignore Ctrl-C, SIGTERM and SIGHUP from now on: an impatient user's second one would end the exit by a signal."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)


class _Deferral:
    """Signal handler that raises KeyboardInterrupt in sections that accept it, and remembers the signal in others."""

    def __init__(self) -> None:
        self._accepting = self._pending = self._raised = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        if self._accepting:
            self._raise()
        self._pending = True

    def raise_pending(self) -> None:
        """Raise a deferred interruption. After one was raised, deferred ones have no further effect."""
        if self._pending and not self._raised:
            self._raise()

    @contextmanager
    def section(self, accepting: bool) -> Iterator[None]:
        """Accept or defer interruptions inside."""
        before, self._accepting, raised = self._accepting, accepting, self._raised
        try:
            if accepting:
                self.raise_pending()
            yield
            if accepting and self._raised and not raised:  # something swallowed it, such as a finalizer
                raise KeyboardInterrupt
        finally:
            self._accepting = before
        if before:
            self.raise_pending()

    def _raise(self) -> None:
        # Once only: handlers that clean up after the first one are not interrupted again.
        self._accepting, self._raised = False, True
        raise KeyboardInterrupt


_deferral: _Deferral | None = None


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Defer interruptions to the next ``interruptible`` inside, or to the end if there is none.

    After one interruption was raised inside, deferred ones are ignored. Signals with another handler do not change, nor
    do threads other than the main one.

    Raises:
        KeyboardInterrupt: at the end, if an interruption came and was not raised inside.
    """
    global _deferral
    # Python delivers signals to the main thread alone.
    if not _in_main_thread():
        yield
    # One handler for all: a section inside another defers to the end of the outer one.
    elif _deferral is not None:
        with _deferral.section(accepting=False):
            yield
    else:
        _deferral = deferral = _Deferral()
        try:
            with termination_handler(deferral, signal.default_int_handler):
                yield
        finally:
            _deferral = None
        # After the handlers are back, so that a second Ctrl-C during this one is an ordinary one.
        deferral.raise_pending()


@contextmanager
def interruptible() -> Iterator[None]:
    """Accept interruptions here, inside ``uninterrupted``.

    Raises:
        KeyboardInterrupt: at the beginning if one was deferred; inside, as they come.
    """
    if _deferral is None or not _in_main_thread():
        yield
        return
    with _deferral.section(accepting=True):
        yield


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
