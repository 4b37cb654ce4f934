"""Compiled evaluation of reduced models; ``kernel`` names the active path, "c" or "numpy".

The environment variable ``RNC_PIN_KERNEL`` selects a path. By default, the compiled kernel is used if the installation
has it. See ``rnc_pin/model/compiled.py``.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import Any

from rnc_pin.errors import ConfigurationError

_VARIABLE, _INTERFACE = "RNC_PIN_KERNEL", 17


def _load() -> Any:
    """The compiled module; None if the installation has none, or one for other sources."""
    try:
        compiled = import_module("rnc_pin._kernel.compiled")
    except ImportError:
        return None
    return compiled if compiled.INTERFACE == _INTERFACE else None


def _chosen() -> Any:
    asked = os.environ.get(_VARIABLE, "")
    if asked not in ("", "c", "numpy"):
        raise ConfigurationError(f"{_VARIABLE} is '{asked}': expected 'c' or 'numpy'")
    found = None if asked == "numpy" else _load()
    if asked == "c" and found is None:
        raise ConfigurationError(
            f"{_VARIABLE} is 'c', but this installation has no compiled kernel: reinstall with a C compiler"
        )
    return found


library: Any = _chosen()
"""Extension module with the class ``Evaluator``; None if NumPy evaluates."""
kernel: str = "numpy" if library is None else "c"
"""Path that evaluates models: "c" or "numpy"."""
