"""Geometry of a robot, whose meshes are read on first access."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pinocchio as pin


class LazyGeometry:
    """Visual and collision geometry of a model.

    Meshes are slow to load, and a run without pictures needs none. A pickle or copy omits geometry that can be loaded
    again, because meshes are large.

    Args:
        load: function that loads the geometry of a kind, "visual" or "collision"; None if there is none to load.
        visual: visual geometry, if it is there already.
        collision: collision geometry, if it is there already.
    """

    def __init__(
        self,
        load: Callable[[str], pin.GeometryModel] | None = None,
        visual: pin.GeometryModel | None = None,
        collision: pin.GeometryModel | None = None,
    ) -> None:
        self._load = load
        self._models = {"visual": visual, "collision": collision}

    def get(self, kind: str) -> pin.GeometryModel | None:
        """Geometry of a kind, or None."""
        if self._models[kind] is None and self._load is not None:
            self._models[kind] = self._load(kind)
        return self._models[kind]

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for pickle and copy."""
        state = dict(self.__dict__)
        if self._load is not None:
            state["_models"] = dict.fromkeys(self._models)
        return state
