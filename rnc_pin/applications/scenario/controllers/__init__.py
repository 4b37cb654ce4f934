"""Controllers of a scenario: one settings class for each ``type``, which builds its controller.

To add a type, write a subclass of ``ControllerSettings`` in a module of this package: ``type: Literal[NAME]``, the
references that it ``follows``, its keys with their meaning under Attributes, and ``_build``. ``TYPES`` finds it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module
from pkgutil import iter_modules
from typing import Annotated, get_args

from pydantic import BeforeValidator, Field

from rnc_pin.applications.scenario.controllers.base import ControllerContext, ControllerSettings
from rnc_pin.applications.scenario.schema.derived import either, read_as
from rnc_pin.errors import nearest
from rnc_pin.io import Json, Strict, wrong

__all__ = ["TYPES", "ControllerContext", "ControllerItem", "without_foreign_gains"]


def _types(base: type[Strict]) -> Iterator[tuple[str, type[Strict]]]:
    """Settings classes below a base, by the ``type`` that they name."""
    for each in base.__subclasses__():
        yield from ((str(name), each) for name in get_args(each.model_fields["type"].annotation))
        yield from _types(each)


# All modules, so that a class is found by being there: a list would be a second place to edit.
for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

TYPES: dict[str, type[Strict]] = dict(sorted(_types(ControllerSettings)))
"""Name of each type to its settings class."""


def owners(key: str) -> list[str]:
    """Types of controllers that read a setting.

    Args:
        key: name of the setting.
    """
    return [name for name, each in TYPES.items() if key in each.model_fields]


def _foreign(kind: str, controller: Mapping[str, Json]) -> list[str]:
    """Settings that only other types of controllers read. What no type reads is a misspelling: the model reports it."""
    return [key for key in controller if (types := owners(key)) and kind not in types]


def _check_keys(raw: object) -> object:
    """Refuse settings that belong to another type.

    Such a setting is dropped if it is null. A comparison can therefore change the type alone.
    """
    kind = raw.get("type") if isinstance(raw, dict) else None
    # An unknown type is reported by the union, with the nearest name.
    if not (isinstance(raw, dict) and isinstance(kind, str) and kind in TYPES):
        return raw
    foreign = _foreign(kind, raw)
    for key in foreign:
        if raw[key] is not None:
            hint = nearest(key, TYPES[kind].model_fields)
            raise wrong(key, f"does not belong to type '{kind}' (but to {', '.join(owners(key))}){hint}")
    return {key: value for key, value in raw.items() if key not in foreign}


_any_type = either(list(TYPES.values()))
ControllerItem = Annotated[
    ControllerSettings, read_as(Annotated[_any_type, Field(discriminator="type"), BeforeValidator(_check_keys)])
]


def without_foreign_gains(raw: Mapping[str, Json], changes: Mapping[str, Json]) -> Mapping[str, Json]:
    """Scenario whose controller has no settings that a comparison's other type of controller does not read.

    Args:
        raw: mapping of the scenario.
        changes: values of the variant by dotted key.
    """
    controller, kind = raw.get("controller"), changes.get("controller.type")
    # Only where the type changes: other wrong settings are mistakes, which the check has to find.
    if not isinstance(controller, Mapping) or not isinstance(kind, str) or kind not in TYPES:
        return raw
    foreign = _foreign(kind, controller)
    return {**raw, "controller": {key: value for key, value in controller.items() if key not in foreign}}
