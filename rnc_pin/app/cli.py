"""Entry point of ``rnc-pin``. Ctrl-C during its imports prints one line, not a traceback."""

import time

_STARTED = [time.perf_counter()]  # before anything else is imported

from rnc_pin.app.termination import interruptible_imports  # noqa: E402

with interruptible_imports():
    from rnc_pin.app.command_line import main as _main

__all__ = ["main"]


def main() -> None:
    """Run the command line. Exit status: 0 success, 1 failed run, 2 wrong usage or input."""
    # At a second call in one process the imports are done already.
    _main(_STARTED.pop() if _STARTED else time.perf_counter())


if __name__ == "__main__":
    main()
