"""Complete scenario: the run and its plots; its validation, and the JSON Schema for editors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, ClassVar, Literal, TypeVar, cast

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, TypeAdapter, model_validator

from rnc_pin.applications.scenario.controllers import TYPES, ControllerItem
from rnc_pin.applications.scenario.schema import kinds
from rnc_pin.applications.scenario.schema.derived import ClassReader, Content, FileName, checked
from rnc_pin.applications.scenario.schema.motions import OptimalPlanner, References
from rnc_pin.applications.scenario.schema.run_settings import Distribution, GripSettings, SimulationSettings
from rnc_pin.applications.scenario.schema.world import ObstacleItem, RobotSource
from rnc_pin.control.loop import LoopOptions
from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.figures import Sheet, Size
from rnc_pin.interruption import nothing_to_keep
from rnc_pin.io import LIST, Json, Strict, validated
from rnc_pin.lab.mujoco import Integrator, MuJoCoSettings, Stance
from rnc_pin.model import ConstraintKind, NonholonomicSystem, NotNegative, OutputKind, Positive, ReducedModel
from rnc_pin.plants import Faults, StuckJoint
from rnc_pin.verdict import FindingKind
from rnc_pin.visualization import View


class ControlLoopSettings(Strict):
    """Options of a control loop.

    Attributes:
        velocity: "measured"; or "observer": estimated from configurations by a fading-memory filter, without lag at
            constant acceleration.
        cutoff: cutoff frequency of the velocity estimate [rad/s]; 0.3 / dt by default.
        fallback: safe command: "hold" the last inputs, "brake" (``F = -brake diag(H) v2``, with the inertia of the
            model), "zero", or "raise" the error. The default of ``simulate`` and of scenarios is "raise" on the reduced
            model without faults.
        timeout: time for which the last inputs are held while measurements are invalid [s]; five steps by default.
        max_speed: largest valid speed, of v and of the difference of two configurations over time [rad/s, m/s].
        min_singular_value: limit for the smallest singular value of E. Below it the loop fails with a SingularityError
            instead of a step.
        brake: decay rate of the velocities under "brake" [1/s].
    """

    velocity: Literal["measured", "observer"] = "measured"
    cutoff: Positive | None = None
    fallback: Literal["hold", "brake", "zero", "raise"] | None = None
    timeout: Positive | None = None
    max_speed: Positive | None = 100.0
    min_singular_value: NotNegative | None = 0.0
    brake: Positive | None = 5.0

    @property
    def options(self) -> LoopOptions:
        """Options that the file states: plants have defaults of their own for the others."""
        # A run under faults has another fallback than one without: what the file omits stays open here.
        stated = {name: value for name, value in self if name in self.model_fields_set and value is not None}
        return cast(LoopOptions, stated)


class PlantSettings(Strict):
    """Simulated plant: the reduced model of rnc_pin, or the robot in MuJoCo.

    ``MuJoCoSettings`` describes the settings of MuJoCo.

    Attributes:
        type: "reduced": the reduced model of rnc_pin; it has only ``servo_time``. "mujoco": MuJoCo with the other
            settings.
        servo_time: time constant of ideal velocity servos [s], for a controller whose commands are velocities.
    """

    described_by: ClassVar[type] = MuJoCoSettings

    step: float = 0.0005
    integrator: Integrator = "RK4"
    friction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    contact_time: float = 0.0
    stance: Stance = "auto"
    casters: Literal["auto"] | bool = "auto"
    settling: float = 0.2
    joint_limits: bool = False
    joint_damping: bool = False
    effort_limits: bool = False
    type: Literal["reduced", "mujoco"] = "mujoco"
    servo_time: Positive | None = None

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, raw: object) -> object:
        return {"type": raw} if isinstance(raw, str) else raw

    @model_validator(mode="after")
    def _suit(self) -> PlantSettings:
        others = sorted(self.model_fields_set - {"type", "servo_time"})  # stated, not merely different from a default
        if self.type == "reduced" and others:
            raise ValueError(f"'{others[0]}' belongs to the type 'mujoco'")
        if self.type == "mujoco" and self.servo_time is not None:
            raise ValueError("'servo_time' belongs to the type 'reduced'")
        checked(lambda: self.settings)
        return self

    @property
    def settings(self) -> MuJoCoSettings:
        """Settings of MuJoCo."""
        return MuJoCoSettings(**self.model_dump(exclude={"type", "servo_time"}))


class FaultSettings(Strict):
    """Differences between the simulated plant and the model of the controller.

    Attributes:
        position_noise: standard deviations [rad or m, rad/s or m/s].
        velocity_noise: standard deviations [rad or m, rad/s or m/s].
        counts: encoder counts per 2 pi rad or 2 pi m; positions are rounded to them.
        delay: measurement delay [samples].
        dropped: fraction of samples that are lost; the previous sample is repeated.
        effort: input limit of every actuator [N or N m]; the loop knows it.
        masses: largest relative error of the inertia of each body, as a fraction. The scenario's ``seed`` draws the
            errors.
        forces: springs, dampers, friction and wrenches that the model of the controller does not contain.
        stuck: joint that locks; the model of the controller does not contain this.
    """

    position_noise: float = 0.0
    velocity_noise: float = 0.0
    counts: float | None = None
    delay: int = 0
    dropped: float = 0.0
    effort: float | None = None
    masses: Annotated[float, Field(ge=0, lt=1)] = 0.0
    forces: list[kinds.ForceItem] = []
    stuck: Annotated[StuckJoint, ClassReader(StuckJoint)] | None = None

    @model_validator(mode="after")
    def _suit(self) -> FaultSettings:
        checked(lambda: self.faults)
        return self

    @property
    def faults(self) -> Faults:
        """Faults of sensors and actuators."""
        counts, effort = (math.inf if each is None else each for each in (self.counts, self.effort))
        return Faults(self.position_noise, self.velocity_noise, counts, self.delay, self.dropped, effort)


class Initial(Strict):
    """Initial configuration and initial velocity.

    Attributes:
        q: joint to position: angle [rad] or displacement [m]. Planar base: (x, y, yaw). Free base: (x, y, z, quaternion
            x, y, z, w). If position constraints do not hold there, only the joints that are not listed move to satisfy
            them.
        v2: reducing output to initial rate; zero for outputs that are not listed.
    """

    q: dict[str, float | list[float]] = {}
    v2: dict[str, float] = {}


_Formats = Annotated[list[Literal["png", "pdf", "svg"]], Field(min_length=1)]


def _checked_size(value: object) -> object:
    Sheet.of(cast(Size, tuple(value) if isinstance(value, list) else value))
    return value


_FigureSize = Annotated[Literal["column", "page"] | tuple[Positive, Positive] | None, BeforeValidator(_checked_size)]


class FigureSettings(Strict):
    """Form of the pictures of a run.

    Attributes:
        formats: file formats. Each picture is written in all of them.
        size: width of a column (3.4 inches) or of a page (7 inches) of a paper, or width and height [inches]. By
            default pictures are for the screen. ``overview`` always is.
        labels: text by name of an output, an input or an axis, such as ``{joint_1: "$\\theta_1$"}``.
    """

    formats: _Formats = ["png"]
    size: _FigureSize = None
    labels: dict[str, str] = {}


class PlotSettings(Strict):
    """Plot of quantities over time.

    Attributes:
        outputs: names of outputs, such as ``tip_x``, or quantities: ``top_view``, ``rates``, ``outputs``, ``errors``,
            ``inputs``, ``estimates``, ``prediction_error``, ``normal_forces``, ``margin``.
        title: title of the plot.
        comparisons: labels of the comparisons in the plot; all by default.
        formats: file formats of this plot; those of ``figures`` by default.
        size: size of this plot; that of ``figures`` by default.
    """

    outputs: Annotated[list[str], Field(min_length=1)]
    title: str | None = None
    comparisons: list[str] | None = None
    formats: _Formats | None = None
    size: _FigureSize = None


class ScenarioFile(Strict):
    """Complete scenario: robot, constraints, outputs, task, controller and simulation.

    Attributes:
        title: title in ``rnc-pin list`` and in plots.
        robot: the robot.
        obstacles: bodies in the world, at rest or with a motion: drawn, and compared with the robot in preflight and
            summary.
        ground: ground of all constraints that have none of their own; the plane z = 0 at rest by default.
        constraints: constraints on the motion of the robot.
        contacts: contacts with the ground that close when the robot lands and open when it lifts off; the model of the
            controller does not contain them.
        mimic: True to keep the mimic joints of the robot's file coupled to their drivers.
        actuators: actuators: names of joints, or forces and torques on frames.
        forces: springs, dampers, friction and wrenches, which plant and controller model both have.
        outputs: reducing and vertical outputs. Without them, the reducing outputs are entries of ``v`` that are never
            dependent.
        task: roles of the outputs; by default all reducing outputs are primary.
        initial: initial configuration and velocity.
        reference: reference trajectories of the outputs.
        planner: planner of a motion before the run: ``{type: optimal, goal: ..., duration: ...}``.
        controller: type and gains of the controller; a run requires it.
        simulation: duration and steps; a run requires it.
        plant: simulated plant: "reduced" (default, the reduced model of rnc_pin) or "mujoco", or a mapping with
            settings.
        faults: differences between the simulated plant and the model of the controller.
        loop: velocity estimation, supervision and safe commands of the control loop.
        grip: friction of the ground; references before the run, and the forces of the run, are compared with it.
        preflight: action if the check before the run finds a singular configuration on the reference, or a goal out of
            reach.
        goal_tolerance: error at the end of a run above which a goal is missed [m, rad]: preflight, warning and summary
            name it.
        accept: kinds of findings that do not fail a run, such as ``lift_off``. Say in a comment why they are
            acceptable.
        seed: seed of all random numbers.
        comparisons: names of the variants to run for comparison. A mapping states variants for this alone.
        presets: values for each preset of the controller: preset to dotted keys and their values. Options of the
            command line take precedence.
        variant: name of the entry of ``variants`` to run; none by default.
        variants: variants of the scenario, such as other coordinates or another task: name to dotted keys and their
            values.
        sweep: values that ``rnc-pin sweep`` draws for each run: dotted key to [minimum, maximum] of a uniform
            distribution, or to another distribution.
        plots: plots to write: file name without extension to plot.
        figures: formats, size and labels of the pictures.
        view: camera and layers of the animation.
    """

    title: str | None = None
    robot: RobotSource
    obstacles: list[ObstacleItem] = []
    ground: kinds.GroundItem = None
    constraints: list[kinds.ConstraintItem] = []
    contacts: list[kinds.ContactItem] = []
    mimic: bool = True
    actuators: list[kinds.ActuatorItem] = []
    forces: list[kinds.ForceItem] = []
    outputs: kinds.Outputs | None = None
    task: kinds.TaskOutputs = kinds.TaskOutputs()
    initial: Initial = Initial()
    reference: References = References()
    planner: OptimalPlanner | None = None
    controller: ControllerItem | None = None
    simulation: SimulationSettings | None = None
    plant: PlantSettings | None = None
    faults: FaultSettings | None = None
    loop: ControlLoopSettings | None = None
    grip: GripSettings | None = None
    preflight: Literal["warn", "refuse"] = "warn"
    goal_tolerance: Positive = 0.02
    accept: list[FindingKind] = []
    seed: Annotated[int, Field(ge=0)] = 0
    comparisons: list[str] | dict[str, dict[str, Content]] = []
    presets: dict[Literal["paper", "scaled"], dict[str, Content]] = {}
    variant: str | None = None
    variants: dict[str, dict[str, Content]] = {}
    sweep: dict[str, Distribution] = {}
    plots: dict[FileName, PlotSettings] = {}
    figures: FigureSettings = FigureSettings()
    view: Annotated[View, ClassReader(View)] = View()

    @property
    def listed_outputs(self) -> tuple[OutputKind, ...]:
        """Outputs of the file: the reducing ones, then the vertical ones."""
        return () if self.outputs is None else (*self.outputs.reducing, *self.outputs.vertical)

    @property
    def contact_constraints(self) -> tuple[ConstraintKind, ...]:
        """Constraints of the contacts that open and close."""
        return tuple(each.constraint for each in self.contacts)

    @property
    def compared(self) -> dict[str, dict[str, Content]]:
        """Variants to run for comparison: name to dotted keys and their values."""
        named = self.comparisons
        return named if isinstance(named, dict) else {name: self.variants[name] for name in named}

    @property
    def timing(self) -> SimulationSettings:
        """Settings of the simulation, which a run needs."""
        if self.simulation is None:
            raise ConfigurationError("simulation: is missing; a run needs {duration: ..., dt: ...}")
        return self.simulation

    def reduced(self, system: NonholonomicSystem) -> ReducedModel:
        """System, reduced to the outputs of the file.

        Args:
            system: the system of the file.
        """
        return system.reduce() if self.outputs is None else system.reduce(self.outputs.reducing, self.outputs.vertical)

    @model_validator(mode="after")
    def _constraints_have_ground(self) -> ScenarioFile:
        if self.ground is None:
            return self
        # Together: a ground that contacts stand on is not useless.
        grounded = kinds.with_ground([*self.constraints, *self.contact_constraints], self.ground)
        count = len(self.constraints)
        landing = [replace(each, constraint=kind) for each, kind in zip(self.contacts, grounded[count:], strict=True)]
        return self.model_copy(update={"constraints": grounded[:count], "contacts": landing})

    @model_validator(mode="after")
    def _names_exist(self) -> ScenarioFile:
        # Before anything is built: a comparison would fail after the run.
        asked = self.comparisons if isinstance(self.comparisons, list) else []
        for name in filter(None, (self.variant, *asked)):
            if name not in self.variants:
                raise ValueError(f"no variant '{name}'{nearest(name, self.variants)}")
        for name, plot in self.plots.items():
            for label in plot.comparisons or []:
                if label not in self.comparisons:
                    hint = nearest(label, self.comparisons)
                    raise ValueError(f"plots.{name}.comparisons: no comparison '{label}'{hint}")
        return self


@nothing_to_keep()
def validate(raw: Mapping[str, Json], source: str) -> ScenarioFile:
    """Validate the mapping of a scenario.

    Args:
        raw: mapping of the scenario, with its options.
        source: file or part, for messages.

    Raises:
        ConfigurationError: one line for the first error: file, key, expected value and found value.
    """
    return admitted(ScenarioFile, raw, source)


# pydantic names the member of a union in the place of an error; a user's file has no such key.
_UNION_MEMBERS = {"float", "str", "list[float]", "constrained-list", "name", "unknown_masses", "unknown_wheels"}
_UNION_MEMBERS |= {LIST, "constrained-float", "literal['plan']"}


def _is_tag(part: str, previous: object) -> bool:
    return part in _UNION_MEMBERS or (previous == "controller" and part in TYPES)


_Model = TypeVar("_Model", bound=BaseModel)


def admitted(model: type[_Model], raw: Mapping[str, Json], source: str) -> _Model:
    """Validate the mapping of a part of a scenario, like ``validate``.

    Args:
        model: class of the part.
        raw: its mapping.
        source: file or part, for messages.
    """
    return validated(model, raw, source, _is_tag)


_AT_FIRST_USE = ConfigDict(defer_build=True)  # building a reader takes 30 ms
_CONSTRAINT: TypeAdapter[ConstraintKind] = TypeAdapter(kinds.ConstraintItem, config=_AT_FIRST_USE)
_OUTPUT: TypeAdapter[OutputKind] = TypeAdapter(kinds.OutputItem, config=_AT_FIRST_USE)


def constraint_of(entry: Mapping[str, Json] | str) -> ConstraintKind:
    """Constraint of one valid entry of ``constraints``.

    Args:
        entry: the entry.
    """
    return _CONSTRAINT.validate_python(entry)


def output_of(entry: Mapping[str, Json]) -> OutputKind:
    """Output of one valid entry of ``outputs``.

    Args:
        entry: the entry.
    """
    return _OUTPUT.validate_python(entry)


def schema() -> dict[str, Json]:
    """Return the schema of the models that read scenario files."""
    content = {**ScenarioFile.model_json_schema(), "title": "rnc_pin scenario"}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **content}
