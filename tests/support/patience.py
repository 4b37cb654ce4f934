"""Waiting for what happens in another thread, process or browser."""

import signal
import time
from contextlib import contextmanager

import pytest

PATIENCE = 180.0  # [s]; for browsers and processes on a machine that is busy with other work


def eventually(condition, patience=PATIENCE):
    """Return True if a condition becomes true within the time limit."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.02)
    return False


@contextmanager
def ending_within(seconds):
    """Stop what would not end, after so many seconds of processor time: the test fails and does not hang."""

    def stop(*_):
        pytest.fail(f"still running after {seconds} s of processor time")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
