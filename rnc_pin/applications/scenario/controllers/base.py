"""Inputs and result of building a controller, checks and settings that several types share, and free motion.

A settings class holds and checks the values of a file. Its keys are parameters of the classes and functions that
compute with them. ``build`` passes them on.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Literal, Protocol

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from rnc_pin import control
from rnc_pin.analysis import Grip
from rnc_pin.applications.scenario.schema.run_settings import SimulationSettings
from rnc_pin.collision import Obstacle
from rnc_pin.control import Controller, KinematicController, SlitheringReference, VelocityQP, VelocityTarget
from rnc_pin.errors import ConfigurationError, InfeasibleError, place_of
from rnc_pin.io import Json, Numbers, Strict, wrong
from rnc_pin.model import Measurement, NotNegative, OutputKind, Positive, ReducedModel, Task
from rnc_pin.motion.optimal import MotionPlan
from rnc_pin.motion.planning import Reference
from rnc_pin.motion.whole_body import ProgramState
from rnc_pin.simulation import Margins, PlannedPath, margins_along, obstacles_passed

MIN_SINGULAR_VALUE = 0.01
"""Smallest singular value below which a warning is given."""


class StatedRun(Protocol):
    """Parts of a scenario file that all controllers read, beside their own settings."""

    @property
    def preflight(self) -> Literal["warn", "refuse"]: ...

    @property
    def listed_outputs(self) -> tuple[OutputKind, ...]: ...


@dataclass(frozen=True)
class ControllerContext:
    """Objects that a scenario has built before its controller.

    Attributes:
        scenario: the validated file.
        reduced: the model.
        q0: initial configuration, (nq,).
        v2_0: initial reduced velocity, (r,).
        task: roles of the outputs.
        simulation: duration and steps.
        obstacles: bodies in the world.
        plan: optimal motion of ``planner``, if the scenario has one.
        references: references of the task's outputs by role: ``primary``, ``redundant``, ``vertical``; constant at the
            start if not given.
        given: roles of the references that the scenario or its plan gives.
        slithering: reference of a trailer on the path of its tractor, which replaces the vertical one.
        monitored: indices in x1 and reference of the x and y of a vehicle on its path; for the record only.
        path: planned path of a vehicle, for plots.
        grip: friction of the wheels on the ground, if the scenario gives it.
    """

    scenario: StatedRun
    reduced: ReducedModel
    q0: np.ndarray
    v2_0: np.ndarray
    task: Task
    simulation: SimulationSettings
    obstacles: tuple[Obstacle, ...] = ()
    plan: MotionPlan | None = None
    references: Mapping[str, Reference] = field(default_factory=dict)
    given: tuple[str, ...] = ()
    slithering: SlitheringReference | None = None
    monitored: tuple[np.ndarray, Reference] | None = None
    path: PlannedPath | None = None
    grip: Grip | None = None

    @property
    def names(self) -> dict[str, tuple[str, ...]]:
        """Names of the task's outputs by role."""
        task = self.task
        return {"primary": task.primary_names, "redundant": task.redundant_names, "vertical": task.vertical_names}

    @property
    def horizon(self) -> float:
        """Time until all references are constant, plus 1 s, at most the duration of the simulation [s]."""
        longest = max(reference.duration for reference in self.references.values()) + 1.0
        return min(self.simulation.seconds, longest)

    def refuse_or_warn(self, complaints: Sequence[str]) -> tuple[str, ...]:
        """Return the warnings of the check before a run.

        Args:
            complaints: reasons against the run.

        Raises:
            InfeasibleError: there are complaints, and ``preflight`` refuses such a run.
        """
        if complaints and self.scenario.preflight == "refuse":
            # An error is one line: of many reasons, the first.
            longest = 350  # letters of the reasons that one error names
            shown = 1 if sum(map(len, complaints)) > longest else len(complaints)
            rest = len(complaints) - shown
            more = f"; and {rest} more: 'preflight: warn' shows all" if rest else ""
            raise InfeasibleError("; ".join(complaints[:shown]) + more)
        return tuple(complaints)

    def passed_obstacles(self, what: str, times: np.ndarray, configurations: np.ndarray) -> tuple[str, ...]:
        """Return complaints about a motion through obstacles.

        Args:
            what: name of the motion, for the messages.
            times: its times (n,) [s].
            configurations: its configurations (n, nq).
        """
        passed = obstacles_passed(self.reduced.robot, times, configurations, self.obstacles)
        return tuple(f"{what} passes through obstacle '{each.names[1]}': {each}" for each in passed)


@dataclass(frozen=True)
class BuiltController:
    """Controller, with the warnings of the check before the run.

    Attributes:
        controller: ready to run.
        warnings: messages for the user.
        notes: entries for the record of the run.
    """

    controller: Controller
    warnings: tuple[str, ...] = ()
    notes: Mapping[str, Json] = field(default_factory=dict)


def reduced_velocity(reduced: ReducedModel, rates: Mapping[str, float], key: str) -> np.ndarray:
    """Return the reduced velocity (r,) from rates by name of the reducing outputs; other rates are zero.

    Args:
        reduced: the model.
        rates: rates by name [m/s or rad/s].
        key: key of the file, for messages.

    Raises:
        ConfigurationError: no reducing output has this name.
    """
    v2 = np.zeros(reduced.r)
    for name, rate in rates.items():
        v2[place_of(name, reduced.reducing.names, f"{key}: no reducing output")] = rate
    return v2


_ROLLOUT_STEP = 0.05  # [s]; a coarse step is enough, because the inertia varies smoothly


def check_motion(
    context: ControllerContext, kinematic: KinematicController, task: Task | None = None, horizon: float | None = None
) -> tuple[Margins, tuple[str, ...]]:
    """Roll out a kinematic controller. Return the margins of the motion, and complaints.

    Args:
        context: inputs for building the controller.
        kinematic: computes the rates of the reducing outputs.
        task: task whose A4 the kinematic controller inverts, if any.
        horizon: duration of the motion to check [s]; by default that of the references of the scenario.

    Raises:
        InfeasibleError: there are complaints, and preflight refuses such a motion.
    """
    reduced, horizon = context.reduced, context.horizon if horizon is None else horizon
    # Stages of an integration step would each solve the program again for the same command.
    if isinstance(kinematic, VelocityQP):
        kinematic = _OncePerSample(kinematic)
    margins = margins_along(reduced, kinematic, context.q0, horizon, _ROLLOUT_STEP, task, context.grip)
    passed = context.passed_obstacles("the reference", margins.time, margins.q)
    try:
        return margins, context.refuse_or_warn((*margins.complaints(MIN_SINGULAR_VALUE), *passed))
    except InfeasibleError as error:
        weakest = margins.stack
        # A caller that searches other references wants the place, and not only the words.
        if weakest.value < MIN_SINGULAR_VALUE:
            error.q, error.time, error.rows = weakest.q, weakest.time, weakest.rows
            error.singular_value = weakest.value
        raise


class _OncePerSample:
    """Program whose velocity is computed once per sample of a roll-out: within a sample it does not read q."""

    def __init__(self, program: VelocityQP) -> None:
        self._program = program
        self._last: tuple[ProgramState, tuple[VelocityTarget, ProgramState]] | None = None

    def initial_state(self, measurement: Measurement) -> ProgramState:
        return self._program.initial_state(measurement)

    def step(self, t: float, measurement: Measurement, state: ProgramState) -> tuple[VelocityTarget, ProgramState]:
        # Stages of one sample share the state, so identity tells the sample.
        if self._last is None or self._last[0] is not state:
            self._last = state, self._program.step(t, measurement, state)
        return self._last[1]


# ------------------------------------------------------------------ settings


Gain = float | Numbers
"""Gain in a file: a number, or one for each output."""
_Bounds = Annotated[list[float], Field(min_length=2, max_length=2)]


class _EstimatedParameters(Strict):
    """Parameters to estimate.

    Attributes:
        bounds: lower and upper bound of all estimates, in their unit.
        dead_zone: prediction error below which adaptation stops, because of noise [m/s or rad/s].
    """

    bounds: _Bounds
    dead_zone: NotNegative = 0.0

    @abstractmethod
    def regressor(self, reduced: ReducedModel) -> tuple[control.Regressor, list[float]]:
        """Model of the unknown parameters, and their first estimates."""

    def estimator(self, reduced: ReducedModel, alpha: float) -> control.Estimator:
        """Build the estimator with an adaptation gain."""
        with ConfigurationError.at("controller.unknown"):
            low, high = self.bounds
            return control.Estimator(reduced, *self.regressor(reduced), (low, high), alpha, self.dead_zone)


class UnknownMasses(_EstimatedParameters):
    """Unknown masses of bodies.

    Attributes:
        bounds: lower and upper bound of all estimates, in their unit.
        base: the joint whose momentum is conserved.
        unit: mass that counts as 1 [kg]. The paper's parameters are ``m_k / J``: unit J.
        initial: first estimates: joint that carries the body to mass, in ``unit``.
    """

    bounds: _Bounds = [0.05, 20.0]
    base: str
    unit: Positive = 1.0
    initial: Annotated[dict[str, float], Field(min_length=1)]

    def regressor(self, reduced: ReducedModel) -> tuple[control.Regressor, list[float]]:
        masses = [control.UnknownMass(joint, self.unit) for joint in self.initial]
        return control.MomentumRegressor(reduced.robot, self.base, masses), list(self.initial.values())


class _WheelLength(Strict):
    """Wheels with one unknown radius or track.

    Attributes:
        wheels: frames of ``RollingWheel`` constraints.
        initial: first estimate [m].
    """

    wheels: Annotated[list[str], Field(min_length=1)]
    initial: Positive


class UnknownWheels(_EstimatedParameters):
    """Unknown radii and tracks of wheels.

    Attributes:
        bounds: lower and upper bound of all estimates, in their unit.
        radii: unknown radii; each is common to its wheels.
        tracks: unknown tracks; each is the distance between two wheels along their axle.
    """

    bounds: _Bounds = [0.01, 5.0]
    radii: list[_WheelLength] = []
    tracks: list[_WheelLength] = []

    @model_validator(mode="after")
    def _check_any(self) -> UnknownWheels:
        if not self.radii and not self.tracks:
            raise ValueError("name at least one radius or track")
        return self

    def regressor(self, reduced: ReducedModel) -> tuple[control.Regressor, list[float]]:
        radii = [control.UnknownRadius(each.wheels) for each in self.radii]
        tracks = [control.UnknownTrack(each.wheels) for each in self.tracks]
        estimates = [each.initial for each in (*self.radii, *self.tracks)]
        return control.WheelRegressor(reduced, [*radii, *tracks]), estimates


def _kind_of(raw: object) -> str:
    keys = raw if isinstance(raw, dict) else ()
    return "unknown_wheels" if "radii" in keys or "tracks" in keys else "unknown_masses"


Unknown = Annotated[
    Annotated[UnknownMasses, Tag("unknown_masses")] | Annotated[UnknownWheels, Tag("unknown_wheels")],
    Discriminator(_kind_of),
]


class ControllerSettings(Strict):
    """Settings of one type of controller.

    Attributes:
        type: type of the controller.
        preset: default gains. "paper": gains of the paper. "scaled": gains scaled to the reduced inertia H along the
            reference. Only "scaled" reads H. With unknown masses it reads H of the first estimates.
    """

    follows: ClassVar[frozenset[str]]
    """References of the task that the controller reads."""
    advice: ClassVar[str] = ""
    """Hint for error messages: a setting that reads the other references."""
    scaled_only: ClassVar[tuple[str, ...]] = ()
    """Settings that only the preset ``scaled`` reads."""

    type: str
    preset: control.Preset = "scaled"

    @property
    def followed(self) -> frozenset[str]:
        """References that the controller reads with these settings."""
        return self.follows

    def build(self, context: ControllerContext) -> BuiltController:
        """Build the controller.

        Args:
            context: what the scenario has built so far.

        Raises:
            ConfigurationError: the scenario gives a reference that the controller does not read.
            RncError: the settings do not fit the robot or the task.
        """
        for name in context.given:
            # A reference that nothing follows would be plotted and never reached.
            if name not in self.followed:
                message = f"is not followed by a controller of type '{self.type}'{self.advice}"
                raise ConfigurationError(f"reference.{name}: {message}")
        return self._build(context)

    @abstractmethod
    def _build(self, context: ControllerContext) -> BuiltController: ...

    @property
    def velocity_command(self) -> str:
        """Key and value by which the controller commands velocities, for messages; empty if it commands forces."""
        return ""

    def given_gains(self, size: int, *names: str) -> dict[str, float | np.ndarray]:
        """Return the gains that the settings give, by name, after a check of their lengths.

        Args:
            size: number of outputs.
            *names: names of settings.

        Raises:
            ConfigurationError: the number of values is not ``size``.
        """
        given = {name: value for name, value in self.values_of(*names).items() if value is not None}
        for name, value in given.items():
            # With the name of the setting: broadcasting would fail in the loop, or silently repeat one value.
            if isinstance(value, list) and len(value) != size:
                raise ConfigurationError(f"controller.{name}: {len(value)} values for {size} outputs")
        return {name: np.array(value) if isinstance(value, list) else value for name, value in given.items()}

    @property
    def outer(self) -> control.OuterGains:
        """Outer gains of the preset, for those that the settings do not give."""
        return control.OUTER_GAINS[self.preset]

    @model_validator(mode="before")
    @classmethod
    def _name_missing_setting(cls, raw: object) -> object:
        # pydantic's "field required" does not tell what the setting is.
        for name, info in cls.model_fields.items():
            if isinstance(raw, dict) and info.is_required() and name not in raw:
                what = cls.key_descriptions()[name]
                raise wrong(name, f"is missing; expected {what[0].lower()}{what[1:].rstrip('.')}")
        return raw

    @model_validator(mode="after")
    def _check_preset(self) -> ControllerSettings:
        for name, value in self:
            if self.preset != "scaled" and name in self.scaled_only and value is not None:
                raise wrong(name, "belongs to the preset 'scaled'")
        return self


class AdaptationSettings(ControllerSettings):
    """Settings of controllers that learn disturbance forces, and unknown parameters of the kinematics.

    Attributes:
        gravity_compensation: True if the actuators hold the robot against gravity before the run. Trackers then start
            with that force. By default with preset "scaled", for a run that starts at rest where gravity loads the
            outputs.
        unknown: masses, or radii and tracks of wheels, to estimate.
        alpha: adaptation gain of parameter estimates (20); 0 for constant estimates.
        dead_zone: velocity error below which adaptation stops, as large as the velocity noise [m/s or rad/s]; zero in
            the paper (``control.feedback``). One number, or one for each reducing output.
        adaptation: for "scaled": adaptation rate ``beta / k`` [1/s]; by default 1, and up to 20 where gravity loads the
            outputs.
        delay: for "scaled": time from a measurement to its force, without sampling [s]; 0 by default.
    """

    scaled_only: ClassVar[tuple[str, ...]] = ("adaptation", "delay")

    gravity_compensation: bool | None = None
    unknown: Unknown | None = None
    alpha: NotNegative | None = None
    dead_zone: Gain | None = None
    adaptation: Positive | None = None
    delay: NotNegative | None = None

    def build(self, context: ControllerContext) -> BuiltController:
        """Build the controller. With unknown parameters it uses the estimated model and never the true one.

        Args:
            context: what the scenario has built so far.
        """
        if self.unknown is None:
            return super().build(context)
        estimator = self.unknown.estimator(context.reduced, self.outer.alpha if self.alpha is None else self.alpha)
        # The controller is built on the estimates: not even its gains know the true parameters.
        built, regressor = super().build(replace(context, reduced=estimator.model)), estimator.regressor
        notes = {
            **built.notes,
            "estimates": dict(zip(regressor.names, regressor.units, strict=True)),
            "predicted": dict(zip(regressor.predicted, regressor.predicted_units, strict=True)),
        }
        return replace(built, controller=control.UncertainController(estimator, built.controller), notes=notes)

    def holding_force(self, context: ControllerContext) -> np.ndarray | None:
        """Reduced force that holds the robot at rest at ``q0``, (r,); None without gravity compensation.

        Args:
            context: what the scenario has built so far.
        """
        wanted = self.gravity_compensation
        # The paper's gains have no such force. A start in motion is no equilibrium that brakes have held before.
        if wanted is None:
            starts_at_rest = self.preset == "scaled" and not context.v2_0.any()
            wanted = starts_at_rest and control.gravity_loads(context.reduced, context.q0)
        if not wanted:
            return None
        rest = np.zeros(context.reduced.r)
        return context.reduced.inverse_dynamics(context.q0, rest, rest)

    @model_validator(mode="after")
    def _check_adaptation(self) -> AdaptationSettings:
        if self.alpha is not None and self.unknown is None:
            raise wrong("alpha", "needs 'unknown', which is missing")
        if self.dead_zone is not None and np.min(self.dead_zone) < 0:
            raise wrong("dead_zone", f"expected numbers of at least 0, found {self.dead_zone}")
        return self


class NoControlSettings(ControllerSettings):
    """No control: the robot moves freely.

    Attributes:
        type: free motion: all actuator inputs are zero, and no output has a goal.
    """

    follows: ClassVar[frozenset[str]] = frozenset()

    type: Literal["none"]

    def _build(self, context: ControllerContext) -> BuiltController:
        return BuiltController(control.ZeroInput(context.reduced))
