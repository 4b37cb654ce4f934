"""Memory that Python code of all threads holds. Resident memory of a process also depends on what was freed before."""

import tracemalloc
from contextlib import contextmanager


@contextmanager
def holding_at_most(megabytes):
    """Fail if objects that are created inside the block, by any thread, ever need more than so many megabytes."""
    tracemalloc.start()
    try:
        yield
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 1e6 * megabytes, f"{peak / 1e6:.1f} MB"
