"""What a scenario file may say. Each kind of constraint, output, actuator and reference knows what it builds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from rnc_pin import planning
from rnc_pin.actuators import Actuator, FrameForce, FrameTorque
from rnc_pin.constraints import MomentumConservation, NoSideSlip, RollingWheel
from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.outputs import Distance, FramePosition, FrameSpeed, FrameYaw, JointPosition
from rnc_pin.robot import Robot
from rnc_pin.rows import ConstraintKind, OutputKind
from rnc_pin.urdf_files import find_urdf

Positive = Annotated[float, Field(gt=0)]
Axis = Literal["x", "y", "z"]
Numbers = Annotated[list[float], Field(min_length=1)]


def _file_name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        raise ValueError(f"'{name}' cannot name a file: use letters, digits, - and _")
    return name


FileName = Annotated[str, AfterValidator(_file_name)]


class Strict(BaseModel):
    """A mapping that knows all its keys, and says the nearest for one it does not know."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, raw: Any) -> Any:
        if isinstance(raw, dict):
            for key in raw:
                if key not in cls.model_fields:
                    raise ValueError(f"'{key}' is not known{nearest(str(key), cls.model_fields)}")
        return raw


_NAME, _OTHER = "name", "other"


def _kind(raw: Any) -> str:
    """What an entry is: its one key, or a bare name."""
    if isinstance(raw, dict) and len(raw) == 1:
        return str(next(iter(raw)))
    return _NAME if isinstance(raw, str) else _OTHER


_BY_KIND = Discriminator(_kind)


# ---------------------------------------------------------------------- robot


class RobotSource(Strict):
    """Where the robot comes from: one of ``urdf`` and ``example``."""

    urdf: str | None = None
    """A file, relative to the scenario's, or the name of one shipped with rnc_pin."""
    example: str | None = None
    """A robot of example-robot-data."""
    base: Literal["fixed", "planar", "free"] = "fixed"
    package_dirs: list[str] = []
    lock: dict[str, float | list[float]] = {}
    gravity: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None

    @model_validator(mode="after")
    def _one_source(self) -> RobotSource:
        if (self.urdf is None) == (self.example is None):
            raise ValueError("expected one of 'urdf' and 'example'")
        return self

    def build(self, folder: Path) -> Robot:
        if self.example is not None:
            return Robot.from_example(self.example, self.base, self.lock or None, self.gravity)
        assert self.urdf is not None
        packages = [folder / each for each in self.package_dirs]
        return Robot.from_urdf(find_urdf(self.urdf, folder), self.base, packages, self.lock or None, self.gravity)


# ---------------------------------------------------------------------- constraints


class Momentum(Strict):
    """Zero momentum of an unactuated base joint."""

    momentum: str

    def build(self) -> ConstraintKind:
        return MomentumConservation(self.momentum)


class _FrameAxis(Strict):
    frame: str
    axis: Axis


class _SlipArguments(Strict):
    frame: str
    axis: Axis = "y"


class SideSlip(Strict):
    """A knife edge."""

    no_side_slip: _SlipArguments

    def build(self) -> ConstraintKind:
        return NoSideSlip(self.no_side_slip.frame, self.no_side_slip.axis)


class _WheelArguments(Strict):
    frame: str
    radius: Positive
    axis: Axis | None = None


class Wheel(Strict):
    """A wheel that rolls on the plane z = 0."""

    rolling_wheel: _WheelArguments

    def build(self) -> ConstraintKind:
        return RollingWheel(self.rolling_wheel.frame, self.rolling_wheel.radius, self.rolling_wheel.axis)


Constraint = Annotated[
    Annotated[Momentum, Tag("momentum")]
    | Annotated[SideSlip, Tag("no_side_slip")]
    | Annotated[Wheel, Tag("rolling_wheel")],
    _BY_KIND,
]


# ---------------------------------------------------------------------- actuators


class _ForceArguments(_FrameAxis):
    limit: Positive | None = None


class Force(Strict):
    """A force along a frame's own axis."""

    force: _ForceArguments

    def build(self) -> Actuator:
        return FrameForce(self.force.frame, self.force.axis, self.force.limit or np.inf)


class Torque(Strict):
    """A torque about a frame's own axis."""

    torque: _ForceArguments

    def build(self) -> Actuator:
        return FrameTorque(self.torque.frame, self.torque.axis, self.torque.limit or np.inf)


ActuatorItem = Annotated[
    Annotated[str, Tag(_NAME)] | Annotated[Force, Tag("force")] | Annotated[Torque, Tag("torque")],
    _BY_KIND,
]


# ---------------------------------------------------------------------- outputs


class Joint(Strict):
    """A joint's coordinate."""

    joint: str

    def build(self) -> OutputKind:
        return JointPosition(self.joint)


class _PositionArguments(Strict):
    frame: str
    axes: str = "xyz"


class Position(Strict):
    """World coordinates of a frame."""

    frame_position: _PositionArguments

    def build(self) -> OutputKind:
        return FramePosition(self.frame_position.frame, self.frame_position.axes)


class Yaw(Strict):
    """Heading of a frame."""

    frame_yaw: str

    def build(self) -> OutputKind:
        return FrameYaw(self.frame_yaw)


class _DistanceArguments(Strict):
    frame_a: str
    frame_b: str


class DistanceBetween(Strict):
    """Distance between two frames."""

    distance: _DistanceArguments

    def build(self) -> OutputKind:
        return Distance(self.distance.frame_a, self.distance.frame_b)


class _SpeedArguments(Strict):
    frame: str
    axis: Axis = "x"


class Speed(Strict):
    """A frame's speed along its own axis."""

    frame_speed: _SpeedArguments

    def build(self) -> OutputKind:
        return FrameSpeed(self.frame_speed.frame, self.frame_speed.axis)


OutputItem = Annotated[
    Annotated[Joint, Tag("joint")]
    | Annotated[Position, Tag("frame_position")]
    | Annotated[Yaw, Tag("frame_yaw")]
    | Annotated[DistanceBetween, Tag("distance")]
    | Annotated[Speed, Tag("frame_speed")],
    _BY_KIND,
]


class Outputs(Strict):
    """Reducing outputs x2 and vertical outputs x1."""

    reducing: Annotated[list[OutputItem], Field(min_length=1)]
    vertical: list[OutputItem] = []


class TaskNames(Strict):
    """How the reducing outputs are divided, by the names of their rows (``tip_x``)."""

    primary: list[str] = []
    redundant: list[str] = []
    vertical: list[str] | None = None


# ---------------------------------------------------------------------- references


class _MinimumJerkArguments(Strict):
    to: Numbers | None = None
    by: Numbers | None = None
    """Displacement from the initial value, instead of ``to``."""
    duration: Positive
    begin: float = 0.0

    @model_validator(mode="after")
    def _one_goal(self) -> _MinimumJerkArguments:
        if (self.to is None) == (self.by is None):
            raise ValueError("expected one of 'to' and 'by'")
        return self


class MinimumJerkReference(Strict):
    """From the initial value to a goal, at rest at both ends."""

    minimum_jerk: _MinimumJerkArguments

    def build(self, start: np.ndarray) -> planning.Reference:
        a = self.minimum_jerk
        goal = _sized(a.to, start) if a.to is not None else _sized(a.by, start) + start
        return planning.MinimumJerk(start, goal, a.duration, a.begin)


class _ViaArguments(Strict):
    times: Numbers
    """Increasing, after zero: the initial value is the first point [s]."""
    points: list[Numbers]


class ViaReference(Strict):
    """From the initial value through points."""

    via_points: _ViaArguments

    def build(self, start: np.ndarray) -> planning.Reference:
        a = self.via_points
        if len(a.times) != len(a.points):
            raise ConfigurationError(f"via_points has {len(a.times)} times for {len(a.points)} points")
        points = [start, *(_sized(np.array(point), start) for point in a.points)]
        return planning.ViaPoints([0.0, *a.times], points)


class _HarmonicArguments(Strict):
    amplitude: Numbers
    frequency: float | Numbers
    phase: float | Numbers = 0.0
    center: Numbers | None = None
    """The initial value by default."""
    ramp: Positive = 1.0


class HarmonicReference(Strict):
    """A sine about a center."""

    harmonic: _HarmonicArguments

    def build(self, start: np.ndarray) -> planning.Reference:
        a = self.harmonic
        center = start if a.center is None else _sized(np.array(a.center), start)
        return planning.Harmonic(center, _sized(np.array(a.amplitude), start), a.frequency, a.phase, a.ramp)


class _HoldArguments(Strict):
    value: Numbers | None = None
    """The initial value by default."""


class HoldReference(Strict):
    """A constant."""

    hold: _HoldArguments = _HoldArguments()

    def build(self, start: np.ndarray) -> planning.Reference:
        return planning.Hold(start if self.hold.value is None else _sized(np.array(self.hold.value), start))


ReferenceItem = Annotated[
    Annotated[MinimumJerkReference, Tag("minimum_jerk")]
    | Annotated[ViaReference, Tag("via_points")]
    | Annotated[HarmonicReference, Tag("harmonic")]
    | Annotated[HoldReference, Tag("hold")],
    _BY_KIND,
]


class TrailerSettings(Strict):
    """A trailer whose axle should stay on the path of the vehicle that pulls it."""

    frame: str
    """At the middle of its axle."""
    length: Positive
    """Kingpin to axle [m]."""


class PathSettings(Strict):
    """A vehicle with front steering driven from where it is to a pose; gives the primary and vertical references."""

    frame: str
    """At the middle of the rear axle, x forward."""
    to: Annotated[list[float], Field(min_length=3, max_length=3)]
    """x, y [m] and heading [rad]."""
    duration: Positive
    wheelbase: Positive
    trailer: TrailerSettings | None = None


class References(Strict):
    """Desired trajectories of the task's outputs; what is left out stays at its initial value."""

    path: PathSettings | None = None
    """Instead of ``primary`` (distance driven, steering angle) and, with a trailer, ``vertical`` (its heading)."""

    primary: ReferenceItem | None = None
    redundant: ReferenceItem | None = None
    vertical: ReferenceItem | None = None


def _sized(values: Sequence[float] | np.ndarray | None, like: np.ndarray) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    if array.shape != like.shape:
        raise ConfigurationError(f"a reference has {array.size} values for {like.size} outputs")
    return array


# ---------------------------------------------------------------------- controller and simulation


class UnknownMasses(Strict):
    """Bodies whose masses are estimated."""

    base: str
    """The joint whose momentum is conserved."""
    initial: Annotated[dict[str, float], Field(min_length=1)]
    """Joint that carries the body: first estimate, in ``unit``."""
    unit: Positive = 1.0
    """Mass that counts as 1 [kg]; the paper's parameters m_k / J have unit J."""
    bounds: Annotated[list[float], Field(min_length=2, max_length=2)] = [0.05, 20.0]


class PlatformGoal(Strict):
    """Where a unicycle platform goes in the second phase."""

    position: Annotated[list[str], Field(min_length=2, max_length=2)]
    """Vertical outputs that are its x and y."""
    to: Annotated[list[float], Field(min_length=3, max_length=3)]
    """x, y [m] and heading [rad]."""
    begin: Annotated[float, Field(ge=0)]
    """When the second phase starts [s]."""


class ControllerSettings(Strict):
    """Which controller, which preset of gains, and gains set by hand on top of it."""

    type: Literal[
        "redundancy", "reducing_outputs", "jacobian_transpose", "uncertain_redundancy", "steering", "two_phase"
    ]
    """``redundancy``: (12) over a velocity tracker. ``reducing_outputs``: references for all reducing outputs, the
    vertical ones go where they will. ``jacobian_transpose``: (8)-(9) on the ``active`` actuators, the others off.
    ``uncertain_redundancy``: (16) with masses estimated by (20). ``steering``: class 2s.
    ``two_phase``: class 3, (8)-(9) for the primary outputs, then a point stabiliser for the platform."""
    tracker: Literal["adaptive", "computed_torque"] = "adaptive"
    """Under the first two types: (10), or the model-based baseline."""
    preset: Literal["paper", "scaled"] = "scaled"
    active: list[str] | None = None
    unknown: UnknownMasses | None = None
    platform: PlatformGoal | None = None
    alpha: Annotated[float, Field(ge=0)] | None = None
    k: float | Numbers | None = None
    k1: float | Numbers | None = None
    k2: float | Numbers | None = None
    k3: float | Numbers | None = None
    k21: float | Numbers | None = None
    k4: Positive | None = None
    gamma: Positive | None = None
    beta: float | Numbers | None = None
    sigma: Annotated[float, Field(ge=0)] | None = None
    bandwidth: Positive | None = None


class SimulationSettings(Strict):
    """How long, how finely, and what of the real machine takes part."""

    duration: Positive
    dt: Positive = 0.002
    substeps: Annotated[int, Field(ge=1)] = 1
    joint_damping: bool = False
    actuator_limits: bool = False
    position_limits: bool = False


class Initial(Strict):
    """Where the run starts; it starts at rest."""

    q: dict[str, float | list[float]] = {}


class PlotSettings(Strict):
    """One plot: some outputs over time."""

    outputs: list[str] = []
    quantity: Literal["outputs", "estimates", "prediction_error"] = "outputs"
    """Outputs by name, or all that the controller estimates or mispredicts."""
    title: str | None = None
    comparisons: list[str] | None = None
    """Labels of the comparisons that it shows; all by default."""

    @model_validator(mode="after")
    def _something_to_show(self) -> PlotSettings:
        if bool(self.outputs) != (self.quantity == "outputs"):
            raise ValueError("expected 'outputs', or a 'quantity' other than outputs")
        return self


class View(Strict):
    """What the animation shows besides the robot."""

    trail: list[str] = []
    """Frames whose paths are drawn."""
    camera: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None
    target: Annotated[list[float], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]
    ground: float | None = 0.0
    """Height of the grid [m]; null for none."""


class Scenario(Strict):
    """A whole run."""

    title: str | None = None
    robot: RobotSource
    constraints: list[Constraint] = []
    actuators: list[ActuatorItem] = []
    outputs: Outputs
    task: TaskNames = TaskNames()
    initial: Initial = Initial()
    reference: References = References()
    controller: ControllerSettings | None = None
    simulation: SimulationSettings | None = None
    seed: Annotated[int, Field(ge=0)] = 0
    comparisons: dict[str, dict[str, Any]] = {}
    """Label: dotted keys and values that differ from this run."""
    sweep: dict[str, Annotated[list[float], Field(min_length=2, max_length=2)]] = {}
    """Dotted key: range from which ``rnc-pin sweep`` draws uniformly."""
    plots: dict[FileName, PlotSettings] = {}
    view: View = View()

    @model_validator(mode="after")
    def _labels_exist(self) -> Scenario:
        for name, plot in self.plots.items():
            for label in plot.comparisons or []:
                if label not in self.comparisons:
                    hint = nearest(label, self.comparisons)
                    raise ValueError(f"plots.{name}.comparisons: no comparison '{label}'{hint}")
        return self
