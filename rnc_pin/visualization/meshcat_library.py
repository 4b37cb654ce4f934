"""Meshcat and Pinocchio's visualizers, imported without packages that a run does not use.

``pinocchio.visualize`` imports viser and trimesh where other packages installed them, and Meshcat imports IPython.
Together they take three quarters of the time of these imports.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType


class _Deferred(ModuleType):
    """Placeholder of a module; its attributes are those of the module, which is imported at the first use of one."""

    def __init__(self, name: str, functions: Sequence[str]) -> None:
        super().__init__(name)
        for function in functions:
            setattr(self, function, _deferred_call(name, function))

    def __getattr__(self, name: str) -> object:
        if name.startswith("__"):  # import statements look for these, e.g. __path__
            raise AttributeError(name)
        if sys.modules.get(self.__name__) is self:
            del sys.modules[self.__name__]
        return getattr(import_module(self.__name__), name)


def _deferred_call(module: str, name: str) -> Callable[..., object]:
    def call(*arguments: object, **keywords: object) -> object:
        return getattr(import_module(module), name)(*arguments, **keywords)

    return call


@contextmanager
def deferred_imports(modules: Mapping[str, Sequence[str]]) -> Iterator[None]:
    """Replace modules by placeholders while others import them, unless they are already imported or not installed.

    Args:
        modules: functions or classes that ``from`` takes from each module, and that are only called.
    """
    placeholders = {
        name: _Deferred(name, functions)
        for name, functions in modules.items()
        if name not in sys.modules and find_spec(name.partition(".")[0]) is not None
    }
    sys.modules.update(placeholders)
    try:
        yield
    finally:
        for name, placeholder in placeholders.items():
            if sys.modules.get(name) is placeholder:
                del sys.modules[name]


with deferred_imports({"viser": (), "trimesh": (), "imageio": (), "IPython.display": ("HTML",)}):
    import meshcat
    import meshcat.geometry as mg
    from pinocchio.visualize import BaseVisualizer
    from pinocchio.visualize.meshcat_visualizer import DaeMeshGeometry, MeshcatVisualizer

__all__ = ["BaseVisualizer", "DaeMeshGeometry", "MeshcatVisualizer", "meshcat", "mg"]
