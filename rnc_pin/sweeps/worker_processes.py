"""Worker processes that end with their parent process."""

from __future__ import annotations

import os
import signal
import threading
import time

_PERIOD = 0.5  # [s]
_watched: set[int] = set()


def exit_with_parent(parent: int) -> None:
    """End this process when its parent ends for any reason, and ignore Ctrl-C.

    Args:
        parent: id of the parent process; in that process itself this function does nothing.
    """
    if os.getpid() == parent or parent in _watched:
        return
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends Ctrl-C to both processes
    _watched.add(parent)
    threading.Thread(target=_watch, args=(parent,), name="parent", daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_PERIOD)
    os._exit(1)
