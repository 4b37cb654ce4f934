"""Entry point of ``rnc-pin``: runs a command, prints one line per error and sets the exit status.

Ctrl-C during its imports prints one line, not a traceback.
"""

import time

_STARTED = [time.perf_counter()]  # before anything else is imported

from rnc_pin.interruption import endings_as_ctrl_c, ignore_endings, interruptible_imports  # noqa: E402

with interruptible_imports():
    import gc
    import os
    import sys
    import traceback

    import click

    from rnc_pin.applications.command_line.messages import DONE, FAILED, USAGE, complain, told_warnings
    from rnc_pin.applications.command_line.usage import cli
    from rnc_pin.errors import RncError


def main() -> None:
    """Run the command line. Exit status: 0 success, 1 failed run, 2 wrong usage or input."""
    # At a second call in one process the imports are done already.
    started = _STARTED.pop() if _STARTED else time.perf_counter()
    if sys.stdout is None:  # the next file that is opened would take its place
        complain("standard output is closed: redirect it, e.g. to /dev/null")
        sys.exit(USAGE)
    try:
        with endings_as_ctrl_c(), told_warnings():
            status = cli.main(standalone_mode=False, obj=started)
            sys.stdout.flush()
    except click.exceptions.Abort:
        complain("interrupted")
        sys.exit(FAILED)
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx else "rnc-pin"
        complain(f"{' '.join(error.format_message().split()).rstrip('.')} (see '{command} --help')")
        sys.exit(USAGE)
    except click.ClickException as error:
        complain(error.format_message())
        sys.exit(USAGE)
    except RncError as error:
        if "--debug" in sys.argv:
            traceback.print_exc()
        complain(str(error))
        sys.exit(USAGE)
    except BrokenPipeError:  # the reader of the pipe has closed it
        sys.stderr.close()
        sys.exit(FAILED)
    except Exception as error:
        if "--debug" in sys.argv:
            traceback.print_exc()
        complain(_unexpected(error))
        sys.exit(FAILED)
    sys.exit(status if isinstance(status, int) else DONE)


def _unexpected(error: Exception) -> str:
    """Message of an error that is none of the package, or of a standard output that is full."""
    try:
        if isinstance(error, OSError) and error.filename is None:
            print(flush=True)  # this fails again if standard output is full, and no file
    except OSError as full:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 (Python would write the rest at its end)
        return f"standard output cannot be written: {full.strerror}"
    return f"unexpected {type(error).__name__}: {' '.join(str(error).split())} (--debug shows where)"


def run() -> None:
    """Run the command line in a process of its own. A signal after the command does not change its status."""
    gc.set_threshold(50_000)  # what imports and runs make lives to the end: collections find little
    try:
        with endings_as_ctrl_c():  # until they are ignored
            try:
                main()
            finally:
                ignore_endings()
                gc.freeze()  # a collection at the exit would take as long as writing a run
    except KeyboardInterrupt:  # it came between the command and the end
        sys.exit(FAILED)


if __name__ == "__main__":
    run()
