"""Ctrl-C taken where nothing is lost by it: between steps of a run, and not while results are gathered or written."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

Handler = Callable[[int, FrameType | None], object]


@contextmanager
def requests_to_end(handler: Handler, instead_of: Handler | signal.Handlers) -> Iterator[None]:
    """Handle Ctrl-C, SIGTERM and the end of the terminal inside.

    Args:
        handler: of those signals.
        instead_of: what handles them by now; signals that somebody else handles, and threads beside the main one, are
            left alone.
    """
    main = threading.current_thread() is threading.main_thread()
    ours = [number for number in _SIGNALS if main and signal.getsignal(number) is instead_of]
    for number in ours:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, instead_of)


@dataclass
class _Held:
    """What became of interruptions.

    Attributes:
        open: whether one is raised at once.
        wanted: one came while that was not so.
        taken: one was raised; what comes after it asks for the same.
    """

    open: bool = False
    wanted: bool = False
    taken: bool = False

    def take(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal."""
        if not self.open:
            self.wanted = True
            return
        self.open, self.taken = False, True
        raise KeyboardInterrupt

    def take_wanted(self) -> None:
        """Raise what came before and was not acted upon."""
        if self.wanted and not self.taken:
            self.taken = True
            raise KeyboardInterrupt


_held: _Held | None = None


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let interruptions wait for the next ``interruptible`` inside, or for the end if there is none.

    Once one has been raised inside, further ones are taken for impatience. Signals that somebody else handles, and
    threads beside the main one, are left alone.

    Raises:
        KeyboardInterrupt: at the end, where one came that nothing inside has taken.
    """
    global _held
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    if _held is not None:
        held, before = _held, _held.open
        held.open = False
        try:
            yield
        finally:
            held.open = before
        if before:
            held.take_wanted()
        return
    held = _held = _Held()
    try:
        with requests_to_end(held.take, signal.default_int_handler):
            yield
    finally:
        _held = None
    held.take_wanted()


@contextmanager
def interruptible() -> Iterator[None]:
    """Inside ``uninterrupted``: take interruptions here.

    Raises:
        KeyboardInterrupt: at the beginning, where one is waiting; inside, as they come.
    """
    held = _held
    if held is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    held.take_wanted()
    before, held.open = held.open, True
    try:
        yield
    finally:
        held.open = before
