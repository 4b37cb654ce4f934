"""Controllers in a scenario file: one settings class for each ``type``, which builds its controller.

To add a type, write its class in a new module and add it to ``_AnyType``.
"""

from __future__ import annotations

from typing import Annotated, get_args

from pydantic import BeforeValidator, Field

from rnc_pin.errors import nearest
from rnc_pin.scenario.schema.base import wrong
from rnc_pin.scenario.schema.controllers.base import Built, Context, ControllerSettings
from rnc_pin.scenario.schema.controllers.jacobian_transpose import JacobianTransposeSettings
from rnc_pin.scenario.schema.controllers.reducing_outputs import ReducingOutputsSettings
from rnc_pin.scenario.schema.controllers.redundancy import RedundancySettings
from rnc_pin.scenario.schema.controllers.state_feedback import StateFeedbackSettings
from rnc_pin.scenario.schema.controllers.steering import SteeringSettings
from rnc_pin.scenario.schema.controllers.two_phase import TwoPhaseSettings
from rnc_pin.scenario.schema.controllers.uncertain_redundancy import UncertainRedundancySettings

__all__ = ["TYPES", "Built", "Context", "ControllerItem", "ControllerSettings"]

_AnyType = (
    RedundancySettings
    | ReducingOutputsSettings
    | JacobianTransposeSettings
    | UncertainRedundancySettings
    | SteeringSettings
    | StateFeedbackSettings
    | TwoPhaseSettings
)

TYPES: dict[str, type[ControllerSettings]] = {
    get_args(each.model_fields["type"].annotation)[0]: each for each in get_args(_AnyType)
}
"""Name of each type to its settings class."""


def _of_its_type(raw: object) -> object:
    """Refuse settings that belong to another type.

    Such a setting is dropped if it is null. A comparison can therefore change the type alone.
    """
    kind = raw.get("type") if isinstance(raw, dict) else None
    own = TYPES.get(kind) if isinstance(kind, str) else None
    if own is None or not isinstance(raw, dict):
        return raw
    kept = {}
    for key, value in raw.items():
        others = [name for name, each in TYPES.items() if key in each.model_fields]
        if key in own.model_fields or not others:
            kept[key] = value
        elif value is not None:
            whose, hint = ", ".join(others), nearest(key, own.model_fields)
            raise wrong(key, f"does not belong to type '{kind}' (but to {whose}){hint}")
    return kept


ControllerItem = Annotated[_AnyType, Field(discriminator="type"), BeforeValidator(_of_its_type)]
