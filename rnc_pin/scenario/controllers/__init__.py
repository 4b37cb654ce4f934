"""Construction of controllers from their settings.

A builder passes the numbers of its settings to ``rnc_pin.control``. The gains come from ``control.gain_design``.
"""

from __future__ import annotations

from dataclasses import replace

from rnc_pin.control import (
    Estimator,
    MomentumRegressor,
    Regressor,
    UncertainController,
    UnknownMass,
    UnknownRadius,
    UnknownTrack,
    WheelRegressor,
)
from rnc_pin.control.gain_design import OUTER_GAINS
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.scenario.controllers import (  # noqa: F401
    over_nothing,
    over_plan,
    over_position_tracker,
    over_state_feedback,
    over_velocity_tracker,
    whole_body_builder,
)
from rnc_pin.scenario.controllers.context import BuiltController, ControllerContext, at_key, build_type
from rnc_pin.scenario.schema.controllers import AdaptationSettings, ControllerSettings
from rnc_pin.scenario.schema.unknown_parameters import UnknownMasses

__all__ = ["BuiltController", "ControllerContext", "build_controller"]


def build_controller(settings: ControllerSettings, context: ControllerContext) -> BuiltController:
    """Build a controller. With unknown parameters it uses the estimated model and never the true one.

    Raises:
        ConfigurationError: the scenario gives a reference that the controller does not read.
        RncError: the settings do not fit the robot or the task.
    """
    estimator, notes = None, {}
    if isinstance(settings, AdaptationSettings) and settings.unknown is not None:
        estimator = _estimator(settings, context.reduced)
        context = replace(context, reduced=estimator.model)
        regressor = estimator.regressor
        notes = {
            "estimates": dict(zip(regressor.names, regressor.units, strict=True)),
            "predicted": dict(zip(regressor.predicted, regressor.predicted_units, strict=True)),
        }
    for name in context.given:
        if name not in settings.followed:
            message = f"is not followed by a controller of type '{settings.type}'{settings.advice}"
            raise ConfigurationError(f"reference.{name}: {message}")
    built = build_type(settings, context)
    if estimator is None:
        return built
    return replace(built, controller=UncertainController(estimator, built.controller), notes={**built.notes, **notes})


def _estimator(settings: AdaptationSettings, reduced: ReducedModel) -> Estimator:
    """Build the estimator of the unknown parameters."""
    unknown = settings.unknown
    assert unknown is not None
    alpha = OUTER_GAINS[settings.preset].alpha if settings.alpha is None else settings.alpha
    low, high = unknown.bounds
    with at_key("controller.unknown"):
        regressor: Regressor
        if isinstance(unknown, UnknownMasses):
            masses = [UnknownMass(joint, unknown.unit) for joint in unknown.initial]
            regressor = MomentumRegressor(reduced.robot, unknown.base, masses)
        else:
            radii = [UnknownRadius(each.wheels) for each in unknown.radii]
            tracks = [UnknownTrack(each.wheels) for each in unknown.tracks]
            regressor = WheelRegressor(reduced, [*radii, *tracks])
        return Estimator(reduced, regressor, unknown.estimates, (low, high), alpha, unknown.dead_zone)
