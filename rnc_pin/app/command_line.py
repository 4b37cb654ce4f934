"""Command line: runs a command, prints one line per error and sets the exit status."""

from __future__ import annotations

import sys
import time
import traceback

import click

from rnc_pin.app.messages import complain, told_warnings
from rnc_pin.app.status import DONE, FAILED, USAGE
from rnc_pin.app.termination import endings_as_ctrl_c
from rnc_pin.app.usage import cli
from rnc_pin.errors import RncError


def main(started: float | None = None) -> None:
    """Run the command line. Exit status: 0 success, 1 failed run, 2 wrong usage or input.

    Args:
        started: ``time.perf_counter()`` at the start of the command; now by default.
    """
    try:
        with endings_as_ctrl_c(), told_warnings():
            status = cli.main(standalone_mode=False, obj=time.perf_counter() if started is None else started)
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
        complain(f"unexpected {type(error).__name__}: {' '.join(str(error).split())} (--debug shows where)")
        sys.exit(FAILED)
    sys.exit(status if isinstance(status, int) else DONE)
