"""Ctrl-C between the steps of a run; it is deferred while results are collected or written, so that none is lost."""

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
    """Handle SIGINT (Ctrl-C), SIGTERM and SIGHUP (closed terminal) inside.

    Args:
        handler: handler of those signals.
        instead_of: expected current handler. Signals with another handler do not change, nor do threads other than
            the main one.
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
    """State of deferred interruptions.

    Attributes:
        open: True if an interruption is raised at once.
        wanted: an interruption came while ``open`` was False.
        taken: an interruption was raised; later ones have no further effect.
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
        """Raise an earlier interruption that was deferred."""
        if self.wanted and not self.taken:
            self.taken = True
            raise KeyboardInterrupt


_held: _Held | None = None


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Defer interruptions to the next ``interruptible`` inside, or to the end if there is none.

    After one interruption was raised inside, further ones are ignored. Signals with another handler do not change, nor
    do threads other than the main one.

    Raises:
        KeyboardInterrupt: at the end, if an interruption came and was not raised inside.
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
    """Accept interruptions here, inside ``uninterrupted``.

    Raises:
        KeyboardInterrupt: at the beginning if one was deferred; inside, as they come.
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
