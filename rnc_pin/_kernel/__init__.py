"""Compiled evaluation of reduced models; ``kernel`` names the active path, "c" or "numpy".

The environment variable ``RNC_PIN_KERNEL`` selects a path. By default, the compiled kernel is used if the installation
has it. See ``rnc_pin/model/evaluator.py``.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rnc_pin.errors import ConfigurationError, ModelWarning

_VARIABLE = "RNC_PIN_KERNEL"
INTERFACE = 45
"""Number that changes with the arguments of the kernel's methods; ``tools/generate_rows.py`` writes it for C."""
_REINSTALL = "reinstall with pip install -e ."
_NONE = "this installation has no compiled kernel: reinstall with a C compiler"


class _NumPyAlone:
    """Library without a compiled kernel: each function declines, and the caller evaluates its formula by NumPy."""

    def __getattr__(self, name: str) -> Callable[..., None]:
        # Not False: None is what calls return that give an array, and both mean no.
        return lambda *arguments: None


NUMPY_ALONE: Any = _NumPyAlone()


def _load() -> tuple[object, str]:
    """Compiled module, or ``NUMPY_ALONE`` with the reason; no reason if the installation has none."""
    try:
        # By name: an installation without a C compiler has no such module, and type checkers need none.
        compiled = import_module("rnc_pin._kernel.compiled")
    except ImportError:
        return NUMPY_ALONE, ""
    # A library from an earlier build would read arguments in another order, without an error.
    if compiled.INTERFACE == INTERFACE:
        return compiled, ""
    return NUMPY_ALONE, f"compiled kernel is of interface {compiled.INTERFACE}, {INTERFACE} expected"


def _chosen() -> tuple[object, str]:
    asked = os.environ.get(_VARIABLE, "")
    # A slip such as "C" would otherwise be taken for the default.
    if asked not in ("", "c", "numpy"):
        raise ConfigurationError(f"{_VARIABLE} is '{asked}': expected 'c' or 'numpy'")
    if asked == "numpy":
        return NUMPY_ALONE, ""
    found, reason = _load()
    # Who asks for it measures time: a silent fallback would be taken for the kernel.
    if asked == "c" and found is NUMPY_ALONE:
        why = f"the {reason}: {_REINSTALL}" if reason else _NONE
        raise ConfigurationError(f"{_VARIABLE} is 'c', but {why}")
    # Without its library a run takes about ten times as long: said once, at import.
    if reason:
        warnings.warn(f"rnc_pin: {reason}; using NumPy; {_REINSTALL}", ModelWarning, stacklevel=2)
    return found, reason


_found, outdated = _chosen()
"""Library in use, and the reason why the compiled kernel of this installation is not used; empty if there is none."""
if TYPE_CHECKING:
    from rnc_pin._kernel import compiled as library  # ``compiled.pyi`` has the types
else:
    library = _found
    """Extension module, or ``NUMPY_ALONE``. Functions return False or None for arrays that they leave to NumPy."""
kernel: str = "numpy" if _found is NUMPY_ALONE else "c"
"""Path that evaluates models: "c" or "numpy"."""
