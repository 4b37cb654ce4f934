"""The entry point of ``rnc-pin``: imports the command line in such a way that Ctrl-C meanwhile is one line too."""

import time

_STARTED = [time.perf_counter()]  # before anything else is imported

from rnc_pin.app.interruption import interruptible_imports  # noqa: E402

with interruptible_imports():
    from rnc_pin.app.command_line import main as _main

__all__ = ["main"]


def main() -> None:
    """Entry point: exit status 0 done, 1 the run failed, 2 wrong usage or input."""
    # A process that calls it again has imported everything before.
    _main(_STARTED.pop() if _STARTED else time.perf_counter())


if __name__ == "__main__":
    main()
