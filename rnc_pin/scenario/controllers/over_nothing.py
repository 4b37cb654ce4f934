"""Builder of runs without control."""

from __future__ import annotations

from rnc_pin.control import ZeroInput
from rnc_pin.scenario.controllers.context import BuiltController, ControllerContext, build_type
from rnc_pin.scenario.schema.controllers import NoControlSettings


@build_type.register
def _no_control(settings: NoControlSettings, context: ControllerContext) -> BuiltController:
    return BuiltController(ZeroInput(context.reduced))
