"""From controller settings to controllers: one function a type."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rnc_pin.control import (
    ComputedTorque,
    Controller,
    JacobianTransposeController,
    KinematicController,
    PositionGains,
    PositionTracker,
    ReducingOutputController,
    RedundancyController,
    Secondary,
    SlitheringReference,
    SplitController,
    SteeringController,
    UncertainRedundancyController,
    UnicycleStabilizer,
    VelocityGains,
    VelocityTracker,
)
from rnc_pin.control.redundancy import check_freedom
from rnc_pin.errors import ConfigurationError, InfeasibleError, RncError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import Task
from rnc_pin.planning import Joined, Reference, ReferencePoint
from rnc_pin.scenario.schema import ControllerSettings, SimulationSettings
from rnc_pin.simulation import Margins, margins_along

_ROLLOUT_STEP = 0.05  # [s]; the region that gains are scaled to is smooth
_OUTER_GAIN = 2.0  # the paper's k3 [1/s]
_COMPUTED_TORQUE_GAIN = 20.0  # [1/s]
_ALPHA = {"paper": 1.0, "scaled": 20.0}
_THIN = 0.01  # smallest singular value below which a reference deserves a warning


@dataclass
class Setting:
    """What a controller is built from, and what was noticed on the way."""

    settings: ControllerSettings
    simulation: SimulationSettings
    reduced: ReducedModel
    task: Task
    references: dict[str, Reference]
    q0: np.ndarray
    preflight: str = "warn"
    given: tuple[str, ...] = ()
    """References that the scenario gives; the others hold what they start with."""
    slithering: SlitheringReference | None = None
    """Instead of ``references["vertical"]``: what follows from the path that is driven."""
    watched: tuple[np.ndarray, Reference] | None = None
    warnings: list[str] = field(default_factory=list)
    notes: dict[str, Any] = field(default_factory=dict)
    """What the record of the run should say."""

    @property
    def horizon(self) -> float:
        """How long references move, and a little longer [s]."""
        longest = max(reference.duration for reference in self.references.values()) + 1.0
        return min(self.simulation.duration, longest)

    @property
    def held(self) -> np.ndarray | None:
        """What the actuators hold before the run begins, if the controller is told, as a reduced force (r,)."""
        if not self.settings.held:
            return None
        rest = np.zeros(self.reduced.r)
        return self.reduced.inverse_dynamics(self.q0, rest, rest)

    def gain(self, name: str, default: float | np.ndarray, size: int) -> float | np.ndarray:
        """A gain of the settings, checked for its length, or the preset's."""
        value = getattr(self.settings, name)
        if value is None:
            return default
        if isinstance(value, list) and len(value) != size:
            raise ConfigurationError(f"controller.{name}: {len(value)} values for {size} outputs")
        return np.array(value) if isinstance(value, list) else value


def build_controller(setting: Setting) -> Controller:
    """The controller that the settings name.

    Raises:
        ConfigurationError: a setting does not belong to it, or has the wrong length.
    """
    _refuse_strangers(setting.settings)
    _refuse_unread(setting)
    return _TYPES[setting.settings.type](setting)


def _redundancy(setting: Setting) -> Controller:
    """(12) over (10) or computed torque."""
    return _tracked(setting, _class_1(setting), setting.task)


def _uncertain_redundancy(setting: Setting) -> Controller:
    """(16) and (20) over (10) or computed torque."""
    settings, unknown = setting.settings, setting.settings.unknown
    if unknown is None:
        raise ConfigurationError("controller.unknown: is missing; name bodies of unknown mass, or radii and tracks")
    kinematic = _class_1(setting)
    alpha = _ALPHA[settings.preset] if settings.alpha is None else settings.alpha
    low, high = unknown.bounds
    with _named("controller.unknown"):
        regressor = unknown.build(setting.reduced)
        estimating = UncertainRedundancyController(
            setting.reduced, kinematic, regressor, unknown.estimates, (low, high), alpha
        )
    setting.notes["estimates"] = dict(zip(regressor.names, regressor.units, strict=True))
    setting.notes["predicted"] = dict(zip(regressor.predicted, regressor.predicted_units, strict=True))
    # Gains are scaled along the way that exact kinematics would take: the way that is meant.
    return _tracked(setting, estimating, setting.task, kinematic)


def _steering(setting: Setting) -> Controller:
    """Class 2s over (10) or computed torque."""
    settings, task, references = setting.settings, setting.task, setting.references
    k21 = 0.0 if settings.preset == "paper" else _OUTER_GAIN
    kinematic = SteeringController(
        setting.reduced,
        task,
        references["primary"],
        setting.slithering or references["vertical"],
        k3=setting.gain("k3", _OUTER_GAIN, len(task.vertical)),
        k21=setting.gain("k21", k21, len(task.primary)),
        watched=setting.watched,
        **({} if settings.k4 is None else {"k4": settings.k4}),
    )
    return _tracked(setting, kinematic)


def _two_phase(setting: Setting) -> Controller:
    """Class 3: the primary outputs quickly by (8)-(9), then held while the platform goes its own way."""
    settings, task, reduced = setting.settings, setting.task, setting.reduced
    goal, x2 = settings.platform, reduced.reducing
    if goal is None:
        raise ConfigurationError("controller.platform: is missing; say where it goes: {position, to, begin}")
    if len(task.redundant) != 2 or not x2.quasi[task.redundant[0]] or not x2.angular[task.redundant[1]]:
        raise ConfigurationError("task.redundant: two_phase needs the platform's forward speed and yaw there")
    places = Task.of(reduced, task.primary_names, task.redundant_names, goal.position).vertical
    dt, start = setting.simulation.dt, setting.q0[None]
    position, velocity = PositionGains.paper(), VelocityGains.paper()
    if settings.preset == "scaled":
        hand = np.ix_(np.arange(1), task.primary, task.primary)
        with _named("controller"):
            position = PositionGains.scaled(reduced.inertia(start)[hand], dt)
            velocity = VelocityGains.scaled(
                reduced, start, dt, outputs=task.redundant, adaptation=settings.adaptation or 1.0
            )
    held = setting.held
    tracker = PositionTracker(
        setting.references["primary"],
        position,
        angular=task.primary_coordinates,
        held=None if held is None else held[task.primary],
    )
    stabilizer = UnicycleStabilizer(np.array(goal.to), places, goal.begin, k=0.4, rate=1.0)
    # Found now rather than at the first sample.
    measured = reduced.measure(setting.q0, np.zeros(task.r))
    stabilizer.initial_state(measured._replace(x2=measured.x2[task.redundant]))
    drive = VelocityTracker(stabilizer, velocity, None if held is None else held[task.redundant])
    return SplitController([(tracker, task.primary), (drive, task.redundant)], task.r)


def _class_1(setting: Setting) -> RedundancyController:
    task, references, wanted = setting.task, setting.references, setting.settings.secondary
    if setting.slithering is not None:
        raise ConfigurationError("reference.path.trailer: needs the controller type 'steering'")
    secondary: Secondary | None = None
    if wanted is not None:
        try:
            check_freedom(task)
            secondary = wanted.build(setting.reduced, task, references["redundant"])
        except RncError as error:
            raise ConfigurationError(f"controller.secondary: {error}") from None
    # The paper feeds x21d_dot open loop.
    k21 = 0.0 if setting.settings.preset == "paper" else _OUTER_GAIN
    return RedundancyController(
        task,
        references["primary"],
        references["vertical"],
        k3=setting.gain("k3", _OUTER_GAIN, len(task.vertical)),
        k21=setting.gain("k21", k21, len(task.primary)),
        secondary=secondary,
    )


def _reducing_outputs(setting: Setting) -> Controller:
    """Every reducing output follows a reference of its own."""
    task, references = setting.task, setting.references
    order = np.argsort(np.concatenate([task.primary, task.redundant]))
    reference = _Reordered(Joined([references["primary"], references["redundant"]]), order)
    k21 = setting.gain("k21", _OUTER_GAIN, task.r)
    return _tracked(setting, ReducingOutputController(setting.reduced, reference, k2=k21, watched=setting.watched))


def _tracked(
    setting: Setting, kinematic: KinematicController, task: Task | None = None, meant: KinematicController | None = None
) -> Controller:
    """A kinematic controller over the dynamic one that the settings ask for, after a preflight.

    ``task``: whose A4 the kinematic controller inverts, if any. Margins are watched and gains scaled along where
    ``meant`` leads, by default the kinematic controller itself.
    """
    settings, reduced, r = setting.settings, setting.reduced, setting.reduced.r
    margins = _look_ahead(setting, meant or kinematic, task)
    if settings.tracker == "computed_torque":
        if settings.held:
            raise ConfigurationError("controller.held: computed torque knows what holds the robot from its model")
        return ComputedTorque(reduced, kinematic, setting.gain("k", _COMPUTED_TORQUE_GAIN, r))
    gains = VelocityGains.paper()
    if settings.preset == "scaled":
        # A run that will end in a singular configuration is wanted all the same, for its results until then.
        region = margins.q if margins.singular is None else setting.q0[None]
        with _named("controller"):
            gains = VelocityGains.scaled(
                reduced, region, setting.simulation.dt, settings.bandwidth, adaptation=settings.adaptation or 1.0
            )
    sigma = gains.sigma if settings.sigma is None else settings.sigma
    gains = VelocityGains(setting.gain("k", gains.k, r), setting.gain("beta", gains.beta, r), sigma)
    return VelocityTracker(kinematic, gains, setting.held)


def _jacobian_transpose(setting: Setting) -> Controller:
    """(8)-(9) for the primary outputs on some of the actuators, the others off."""
    settings, task, reduced = setting.settings, setting.task, setting.reduced
    if settings.active is None:
        raise ConfigurationError("controller.active: is missing; name the actuators that are on")
    tracker = PositionTracker(setting.references["primary"], outputs=task.primary, angular=task.primary_coordinates)
    controller = JacobianTransposeController(reduced, tracker, settings.active)
    size = len(task.primary)
    gains = PositionGains.paper()
    if settings.preset == "scaled":
        # Outputs that nothing drives drift, so the region is not known beforehand: take the start.
        with _named("controller"):
            gains = PositionGains.scaled(controller.effective_inertia(setting.q0)[None], setting.simulation.dt)
    tracker.gains = PositionGains(
        k1=setting.gain("k1", gains.k1, size),
        k2=setting.gain("k2", gains.k2, size),
        gamma=gains.gamma if settings.gamma is None else settings.gamma,
        beta=setting.gain("beta", gains.beta, size),
        sigma=gains.sigma if settings.sigma is None else settings.sigma,
    )
    return controller


_TYPES: dict[str, Callable[[Setting], Controller]] = {
    "redundancy": _redundancy,
    "reducing_outputs": _reducing_outputs,
    "jacobian_transpose": _jacobian_transpose,
    "uncertain_redundancy": _uncertain_redundancy,
    "steering": _steering,
    "two_phase": _two_phase,
}
_READ = {  # references that a type follows; vertical ones left alone are what reducing_outputs is there to show
    "redundancy": {"primary", "vertical"},
    "reducing_outputs": {"primary", "redundant", "vertical"},
    "jacobian_transpose": {"primary"},
    "uncertain_redundancy": {"primary", "vertical"},
    "steering": {"primary", "vertical"},
    "two_phase": {"primary"},
}
_VELOCITY_GAINS = {"k", "k21", "bandwidth", "adaptation", "held"}
_OWN = {  # settings that some types have and others do not
    "redundancy": {*_VELOCITY_GAINS, "k3", "secondary"},
    "reducing_outputs": _VELOCITY_GAINS,
    "jacobian_transpose": {"k1", "k2", "gamma", "active"},
    "uncertain_redundancy": {*_VELOCITY_GAINS, "k3", "unknown", "alpha"},
    "steering": {*_VELOCITY_GAINS, "k3", "k4"},
    "two_phase": {"platform", "adaptation", "held"},
}


def _refuse_unread(setting: Setting) -> None:
    """A reference that the controller does not read would be ignored in silence."""
    kind, secondary = setting.settings.type, setting.settings.secondary
    read = _READ[kind] | ({"redundant"} if secondary is not None and secondary.posture is not None else set())
    for name in setting.given:
        if name not in read:
            advice = "; controller.secondary.posture would" if kind == "redundancy" else ""
            raise ConfigurationError(f"reference.{name}: is not followed by a controller of type '{kind}'{advice}")


def _refuse_strangers(settings: ControllerSettings) -> None:
    """A gain that the controller does not have would be ignored in silence."""
    strangers = set().union(*_OWN.values()) - _OWN[settings.type]
    if settings.type == "two_phase":
        strangers |= {"beta", "sigma"}  # two trackers: a number for both would mean two things
    for name in sorted(strangers):
        if getattr(settings, name) is not None:
            raise ConfigurationError(f"controller.{name}: does not belong to type '{settings.type}'")
    for name in ("bandwidth", "adaptation"):
        if settings.preset != "scaled" and getattr(settings, name) is not None:
            raise ConfigurationError(f"controller.{name}: belongs to the preset 'scaled'")


@contextmanager
def _named(key: str) -> Iterator[None]:
    """Say which part of the scenario an error is about."""
    try:
        yield
    except ConfigurationError as error:
        raise type(error)(f"{key}: {error}") from None


def _look_ahead(setting: Setting, kinematic: KinematicController, task: Task | None) -> Margins:
    """Preflight: warn of singular configurations along the reference, or refuse it, before anything moves."""
    margins = margins_along(setting.reduced, kinematic, setting.q0, setting.horizon, _ROLLOUT_STEP, task)
    complaints = margins.complaints(_THIN)
    if complaints and setting.preflight == "refuse":
        raise InfeasibleError("; ".join(complaints))
    setting.warnings.extend(complaints)
    return margins


class _Reordered:
    """A reference with its outputs in another order."""

    def __init__(self, reference: Reference, order: np.ndarray) -> None:
        self._reference, self._order = reference, order
        self.size, self.duration = reference.size, reference.duration

    def at(self, t: float) -> ReferencePoint:
        point = self._reference.at(t)
        return ReferencePoint(*(each[self._order] for each in point))
