"""Numbers with units in YAML files loaded by a xacro file: ``!degrees 90``."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import yaml

from rnc_pin.io.safe_yaml import BoundedLoader
from rnc_pin.robots.sources.xacro.bounded_values import Budget
from rnc_pin.robots.sources.xacro.expressions import evaluate
from rnc_pin.robots.sources.xacro.functions import builtins

_UNITS: Mapping[str, float] = {
    "!radians": 1.0,
    "!degrees": math.pi / 180.0,
    "!meters": 1.0,
    "!millimeters": 0.001,
    "!foot": 0.3048,
    "!inches": 0.0254,
}


def unit_loader(budget: Budget) -> type[BoundedLoader]:
    """Return a safe YAML loader with support for units.

    Args:
        budget: limit on the steps of the expressions in it.
    """
    names = builtins()

    def reading(factor: float) -> Callable[[BoundedLoader, yaml.ScalarNode], float]:
        def read(loader: BoundedLoader, node: yaml.ScalarNode) -> float:
            return float(evaluate(str(loader.construct_scalar(node)), names, budget)) * factor

        return read

    class Loader(BoundedLoader):
        """YAML loader with the unit tags and the budget of one file."""

    for tag, factor in _UNITS.items():
        Loader.add_constructor(tag, reading(factor))
    return Loader
