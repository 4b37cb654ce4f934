"""Complete scenario: the run and its plots; its validation, and the JSON Schema for editors."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Annotated, Literal, TypeVar, cast

from pydantic import BaseModel, BeforeValidator, Field, TypeAdapter, model_validator

from rnc_pin.applications.scenario.controllers import TYPES, ControllerItem
from rnc_pin.applications.scenario.schema import kinds
from rnc_pin.applications.scenario.schema.derived import Content, Entry, FileName, PartialCall
from rnc_pin.applications.scenario.schema.motions import OptimalPlanner, References
from rnc_pin.applications.scenario.schema.run_settings import Distribution, GripItem, SimulationSettings
from rnc_pin.applications.scenario.schema.world import ObstacleItem, RobotSource
from rnc_pin.constraints import GroundPlane
from rnc_pin.control.loop import LoopSettings
from rnc_pin.errors import nearest
from rnc_pin.figures import Sheet, Size
from rnc_pin.interruption import nothing_to_keep
from rnc_pin.io import LIST, Json, Strict, validated
from rnc_pin.lab.mujoco import MuJoCoSettings
from rnc_pin.model import ConstraintKind, NonholonomicSystem, NotNegative, OutputKind, Positive, ReducedModel
from rnc_pin.plants import Faults, StuckJoint
from rnc_pin.verdict import FindingKind
from rnc_pin.visualization import View

_MUJOCO, _FAULTS = Entry(MuJoCoSettings), Entry(Faults)
_LOOP = {"max_speed": Positive | None, "min_singular_value": NotNegative | None, "brake": Positive | None}
LoopItem = Annotated[
    PartialCall[LoopSettings], Entry(LoopSettings, late=("limits", "deadline"), optional=("fallback",), forms=_LOOP)
]
"""Control loop around the controller: velocity estimation, supervision and safe commands."""


class PlantSettings(_MUJOCO.model):  # type: ignore[name-defined, misc]
    """Simulated plant: the reduced model of rnc_pin, or the robot in MuJoCo."""

    type: Literal["reduced", "mujoco"] = "mujoco"
    """"reduced": the reduced model of rnc_pin; it has only ``servo_time``. "mujoco": MuJoCo with the other settings."""
    servo_time: Positive | None = None
    """Time constant of ideal velocity servos [s], for a controller whose commands are velocities."""

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, raw: object) -> object:
        return {"type": raw} if isinstance(raw, str) else raw

    @model_validator(mode="after")
    def _suit(self) -> PlantSettings:
        others = sorted(self.model_fields_set - {"type", "servo_time"})
        if self.type == "reduced" and others:
            raise ValueError(f"'{others[0]}' belongs to the type 'mujoco'")
        if self.type == "mujoco" and self.servo_time is not None:
            raise ValueError("'servo_time' belongs to the type 'reduced'")
        _MUJOCO.read(self)  # check them here: the error then names the place in the file
        return self

    @property
    def settings(self) -> MuJoCoSettings:
        """Settings of MuJoCo."""
        return _MUJOCO.build(self)


class FaultSettings(_FAULTS.model):  # type: ignore[name-defined, misc]
    """Differences between the simulated plant and the model of the controller."""

    masses: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Largest relative error of the inertia of each body, as a fraction. The scenario's ``seed`` draws the errors."""
    forces: list[kinds.ForceItem] = []
    """Springs, dampers, friction and wrenches that the model of the controller does not contain."""
    stuck: Annotated[StuckJoint, Entry(StuckJoint)] | None = None
    """Joint that locks; the model of the controller does not contain this."""

    @model_validator(mode="after")
    def _suit(self) -> FaultSettings:
        _FAULTS.read(self)
        return self

    @property
    def faults(self) -> Faults:
        """Faults of sensors and actuators."""
        return _FAULTS.build(self)


class Initial(Strict):
    """Initial configuration and initial velocity."""

    q: dict[str, float | list[float]] = {}
    """Joint to position: angle [rad] or displacement [m]. Planar base: (x, y, yaw). Free base: (x, y, z, quaternion x,
    y, z, w). If position constraints do not hold there, only the joints that are not listed move to satisfy them."""
    v2: dict[str, float] = {}
    """Reducing output to initial rate; zero for outputs that are not listed."""


_Formats = Annotated[list[Literal["png", "pdf", "svg"]], Field(min_length=1)]


def _checked_size(value: object) -> object:
    Sheet.of(cast(Size, tuple(value) if isinstance(value, list) else value))
    return value


_FigureSize = Annotated[Literal["column", "page"] | tuple[Positive, Positive] | None, BeforeValidator(_checked_size)]


class FigureSettings(Strict):
    """Form of the pictures of a run."""

    formats: _Formats = ["png"]
    """File formats. Each picture is written in all of them."""
    size: _FigureSize = None
    """Width of a column (3.4 inches) or of a page (7 inches) of a paper, or width and height [inches]. By default
    pictures are for the screen. ``overview`` always is."""
    labels: dict[str, str] = {}
    """Text by name of an output, an input or an axis, such as ``{joint_1: "$\\theta_1$"}``."""


class PlotSettings(Strict):
    """Plot of quantities over time."""

    outputs: Annotated[list[str], Field(min_length=1)]
    """Names of outputs, such as ``tip_x``, or quantities: ``top_view``, ``rates``, ``outputs``, ``errors``, ``inputs``,
    ``estimates``, ``prediction_error``, ``normal_forces``, ``margin``."""
    title: str | None = None
    """Title of the plot."""
    comparisons: list[str] | None = None
    """Labels of the comparisons in the plot; all by default."""
    formats: _Formats | None = None
    """File formats of this plot; those of ``figures`` by default."""
    size: _FigureSize = None
    """Size of this plot; that of ``figures`` by default."""


class ScenarioFile(Strict):
    """Complete scenario: robot, constraints, outputs, task, controller and simulation."""

    title: str | None = None
    """Title in ``rnc-pin list`` and in plots."""
    robot: RobotSource
    """The robot."""
    obstacles: list[ObstacleItem] = []
    """Bodies in the world, at rest or with a motion: drawn, and compared with the robot in preflight and summary."""
    ground: kinds.GroundItem = None
    """Ground of all constraints that have none of their own; the plane z = 0 at rest by default."""
    constraints: list[kinds.ConstraintItem] = []
    """Constraints on the motion of the robot."""
    contacts: list[kinds.ContactItem] = []
    """Contacts with the ground that close when the robot lands and open when it lifts off; the model of the controller
    does not contain them."""
    mimic: bool = True
    """True to keep the mimic joints of the robot's file coupled to their drivers."""
    actuators: list[kinds.ActuatorItem] = []
    """Actuators: names of joints, or forces and torques on frames."""
    forces: list[kinds.ForceItem] = []
    """Springs, dampers, friction and wrenches, which plant and controller model both have."""
    outputs: kinds.Outputs | None = None
    """Reducing and vertical outputs. Without them, the reducing outputs are entries of ``v`` that are never
    dependent."""
    task: kinds.TaskOutputs = kinds.TaskOutputs()
    """Roles of the outputs; by default all reducing outputs are primary."""
    initial: Initial = Initial()
    """Initial configuration and velocity."""
    reference: References = References()
    """Reference trajectories of the outputs."""
    planner: OptimalPlanner | None = None
    """Planner of a motion before the run: ``{type: optimal, goal: ..., duration: ...}``."""
    controller: ControllerItem | None = None
    """Type and gains of the controller; a run requires it."""
    simulation: SimulationSettings | None = None
    """Duration and steps; a run requires it."""
    plant: PlantSettings | None = None
    """Simulated plant: "reduced" (default, the reduced model of rnc_pin) or "mujoco", or a mapping with settings."""
    faults: FaultSettings | None = None
    """Differences between the simulated plant and the model of the controller."""
    loop: LoopItem | None = None
    """Velocity estimation, supervision and safe commands of the control loop."""
    grip: GripItem | None = None
    """Friction of the ground; references before the run, and the forces of the run, are compared with it."""
    preflight: Literal["warn", "refuse"] = "warn"
    """Action if the check before the run finds a singular configuration on the reference, or a goal out of reach."""
    goal_tolerance: Positive = 0.02
    """Error at the end of a run above which a goal is missed [m, rad]: preflight, warning and summary name it."""
    accept: list[FindingKind] = []
    """Kinds of findings that do not fail a run, such as ``lift_off``. Say in a comment why they are acceptable."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of all random numbers."""
    comparisons: dict[str, dict[str, Content]] = {}
    """Additional runs for comparison: label to dotted keys and their values."""
    presets: dict[Literal["paper", "scaled"], dict[str, Content]] = {}
    """Values for each preset of the controller: preset to dotted keys and their values. Options of the command line
    take precedence."""
    variant: str | None = None
    """Name of the entry of ``variants`` to run; none by default."""
    variants: dict[str, dict[str, Content]] = {}
    """Variants of the scenario, such as other coordinates or another task: name to dotted keys and their values."""
    sweep: dict[str, Distribution] = {}
    """Values that ``rnc-pin sweep`` draws for each run: dotted key to [minimum, maximum] of a uniform distribution, or
    to another distribution."""
    plots: dict[FileName, PlotSettings] = {}
    """Plots to write: file name without extension to plot."""
    figures: FigureSettings = FigureSettings()
    """Formats, size and labels of the pictures."""
    view: Annotated[View, Entry(View)] = View()
    """Camera and layers of the animation."""

    @property
    def listed_outputs(self) -> tuple[OutputKind, ...]:
        """Outputs of the file: the reducing ones, then the vertical ones."""
        return () if self.outputs is None else (*self.outputs.reducing, *self.outputs.vertical)

    def reduced(self, system: NonholonomicSystem) -> ReducedModel:
        """System, reduced to the outputs of the file."""
        return system.reduce() if self.outputs is None else system.reduce(self.outputs.reducing, self.outputs.vertical)

    @model_validator(mode="after")
    def _constraints_have_ground(self) -> ScenarioFile:
        if self.ground is None:
            return self
        plane, contacts = cast(GroundPlane, self.ground), [each.constraint for each in self.contacts]
        grounded = kinds.with_ground([*self.constraints, *contacts], plane)
        count = len(self.constraints)
        landing = [replace(each, constraint=kind) for each, kind in zip(self.contacts, grounded[count:], strict=True)]
        return self.model_copy(update={"constraints": grounded[:count], "contacts": landing})

    @model_validator(mode="after")
    def _variant_exists(self) -> ScenarioFile:
        if self.variant is not None and self.variant not in self.variants:
            raise ValueError(f"no variant '{self.variant}'{nearest(self.variant, self.variants)}")
        return self

    @model_validator(mode="after")
    def _labels_exist(self) -> ScenarioFile:
        for name, plot in self.plots.items():
            for label in plot.comparisons or []:
                if label not in self.comparisons:
                    hint = nearest(label, self.comparisons)
                    raise ValueError(f"plots.{name}.comparisons: no comparison '{label}'{hint}")
        return self


@nothing_to_keep()
def validate(raw: Mapping[str, Json], source: str) -> ScenarioFile:
    """Validate the mapping of a scenario.

    Raises:
        ConfigurationError: one line for the first error: file, key, expected value and found value.
    """
    return admitted(ScenarioFile, raw, source)


_UNION_MEMBERS = {"float", "str", "list[float]", "constrained-list", "name", "unknown_masses", "unknown_wheels"}
_UNION_MEMBERS |= {LIST, "constrained-float", "literal['plan']"}


def _is_tag(part: str, previous: object) -> bool:
    return part in _UNION_MEMBERS or (previous == "controller" and part in TYPES)


_Model = TypeVar("_Model", bound=BaseModel)


def admitted(model: type[_Model], raw: Mapping[str, Json], source: str) -> _Model:
    """Validate the mapping of a part of a scenario, like ``validate``."""
    return validated(model, raw, source, _is_tag)


def constraint_of(entry: Mapping[str, Json] | str) -> ConstraintKind:
    """Constraint of one valid entry of ``constraints``."""
    return cast("ConstraintKind", _validator(kinds.ConstraintItem).validate_python(entry))


def output_of(entry: Mapping[str, Json]) -> OutputKind:
    """Output of one valid entry of ``outputs``."""
    return cast("OutputKind", _validator(kinds.OutputItem).validate_python(entry))


@cache  # building a validator takes 30 ms
def _validator(item: object) -> TypeAdapter[object]:
    return TypeAdapter(item)  # type: ignore[arg-type]


def schema() -> dict[str, Json]:
    """Return the schema of the models that read scenario files."""
    content = ScenarioFile.model_json_schema()
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "rnc_pin scenario",
        **{key: value for key, value in content.items() if key != "title"},
    }


def schema_text() -> str:
    """Return the schema as text."""
    return json.dumps(schema(), indent=2, ensure_ascii=False) + "\n"
