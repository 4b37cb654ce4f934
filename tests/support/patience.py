"""Waiting for what happens in another thread, process or browser."""

import time

PATIENCE = 30.0  # [s]; for a browser without a graphics card on a busy machine


def eventually(condition, patience=PATIENCE):
    """Whether a condition comes true before patience runs out."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.02)
    return False
