"""The checker that tests put on annotated functions: beartype, to which an int is a float too.

A run calls the same functions thousands of times, and each check costs several times the call: of each function only
the first calls in a test are checked.
"""

import functools
import sys

from beartype import BeartypeConf, beartype

CHECKED = 100  # calls of a function in a test
_check = beartype(conf=BeartypeConf(is_pep484_tower=True))
_calls = {}  # of each function in this test
_resting = set()  # functions that jaxtyping passes by


def check(function):
    checked, name = _check(function), (function.__module__, function.__qualname__)

    @functools.wraps(checked)
    def counted(*arguments, **keywords):
        calls = _calls[name] = _calls.get(name, 0) + 1
        if calls == 2 * CHECKED:  # of parameters, and of the result with them
            _rest(*name)
        return checked(*arguments, **keywords)

    return counted


def _rest(module, qualified):
    found = functools.reduce(lambda within, each: vars(within)[each], qualified.split("."), sys.modules[module])
    while hasattr(found, "__wrapped__") or not callable(found):
        inner = (getattr(found, name, None) for name in ("__wrapped__", "fget", "func", "__func__"))
        found = next(each for each in inner if each is not None)
    found.__no_type_check__ = True
    _resting.add(found)


def start_again():
    """Check the first calls of each function once more: of the next test."""
    _calls.clear()
    for function in _resting:
        del function.__no_type_check__
    _resting.clear()
