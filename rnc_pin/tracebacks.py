"""Short tracebacks in IPython and notebooks: errors of this package without its own frames.

The frames that remain are those of the user, among them controllers and functions that the package calls. Plain Python
and errors of other classes do not change.
"""

from __future__ import annotations

import os
import sys
import sysconfig
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

from rnc_pin.errors import RncError

VARIABLE = "RNC_PIN_FULL_TRACEBACKS"
"""Environment variable that shows full tracebacks if it is set and not empty."""
_OWN = str(Path(__file__).parent) + os.sep
_OTHERS = tuple(f"{sysconfig.get_path(name)}{os.sep}" for name in ("stdlib", "purelib", "platlib"))


def set_full_tracebacks(full: bool) -> None:
    """Show or hide the frames of this package in tracebacks of IPython and notebooks.

    They are hidden by default, unless the environment variable ``RNC_PIN_FULL_TRACEBACKS`` is set. A handler of
    exceptions that was set with IPython's ``set_custom_exc`` stays. Outside IPython, this has no effect.

    Args:
        full: True to show all frames.

    Example:
        >>> rnc.set_full_tracebacks(True)
    """
    shell = _shell()
    if shell is None:
        return
    ours = shell.custom_exceptions == (RncError,)
    if full and ours:
        shell.set_custom_exc((), None)
    elif not full and not shell.custom_exceptions:
        shell.set_custom_exc((RncError,), _show_short)


def hide_frames_in_ipython() -> None:
    """Hide the frames of this package if it is imported in IPython, and the environment does not ask for them."""
    if not os.environ.get(VARIABLE):
        set_full_tracebacks(False)


def without_own_frames(trace: TracebackType | None) -> TracebackType | None:
    """Return a traceback without frames of this package, and without those of libraries that it called.

    Args:
        trace: traceback, outermost frame first.
    """
    kept, is_inside = [], False
    for each in _frames(trace):
        name = each.tb_frame.f_code.co_filename
        own = name.startswith(_OWN)
        is_inside = is_inside or own
        if not own and not (is_inside and (name.startswith((*_OTHERS, "<")) and not _is_cell(name))):
            kept.append(each)
    short: TracebackType | None = None
    for each in reversed(kept):
        short = TracebackType(short, each.tb_frame, each.tb_lasti, each.tb_lineno)
    return short


def _is_cell(name: str) -> bool:
    """True for the code of an input of IPython or of Python's prompt."""
    return name.startswith(("<ipython-input", "<stdin"))


def _frames(trace: TracebackType | None) -> Iterator[TracebackType]:
    while trace is not None:
        yield trace
        trace = trace.tb_next


def _shell() -> Any:
    """The running shell of IPython, or None."""
    ipython = sys.modules.get("IPython")
    return None if ipython is None else ipython.get_ipython()


def _show_short(
    shell: Any, kind: type, error: BaseException, trace: TracebackType, tb_offset: int | None = None
) -> None:
    """Show an error and its causes without frames of this package; the error keeps its full traceback."""
    chain: list[BaseException] = []
    cause = error.__cause__ or (None if error.__suppress_context__ else error.__context__)
    while cause is not None and cause not in chain:
        chain.append(cause)
        cause = cause.__cause__ or (None if cause.__suppress_context__ else cause.__context__)
    full = [each.__traceback__ for each in chain]
    try:
        for each in chain:
            each.__traceback__ = without_own_frames(each.__traceback__)
        shell.showtraceback((kind, error, without_own_frames(trace)), tb_offset=tb_offset)
    finally:
        for each, whole in zip(chain, full, strict=True):
            each.__traceback__ = whole
