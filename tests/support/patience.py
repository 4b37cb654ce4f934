"""Waiting for what happens in another thread, process or browser."""

import time

PATIENCE = 30.0  # [s]; for a browser without a graphics card on a busy machine


def eventually(condition, patience=PATIENCE):
    """Return True if a condition becomes true within the time limit."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.02)
    return False
