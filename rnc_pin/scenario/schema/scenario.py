"""A whole scenario: what it runs, and what it shows of it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from rnc_pin.errors import nearest
from rnc_pin.scenario.schema.actuators import ActuatorItem
from rnc_pin.scenario.schema.base import FileName, Strict
from rnc_pin.scenario.schema.constraints import ConstraintItem
from rnc_pin.scenario.schema.controllers import ControllerItem
from rnc_pin.scenario.schema.derived import Entry
from rnc_pin.scenario.schema.grip import GripSettings
from rnc_pin.scenario.schema.outputs import Outputs, TaskNames
from rnc_pin.scenario.schema.plant import FaultSettings, LoopSettings, PlantSettings
from rnc_pin.scenario.schema.references import References
from rnc_pin.scenario.schema.robot import RobotSource
from rnc_pin.scenario.schema.simulation import SimulationSettings
from rnc_pin.visualization.view import View


class Initial(Strict):
    """Where the run starts, and how it moves there."""

    q: dict[str, float | list[float]] = {}
    """Joint: angle [rad], displacement [m]; a planar base (x, y, yaw), a free one (x, y, z, quaternion x, y, z, w).
    Where loops are to be closed or wheels to stand, those named stay and the others give way."""
    v2: dict[str, float] = {}
    """Reducing output: its rate; the others rest."""


class PlotSettings(Strict):
    """One plot: some outputs over time."""

    outputs: list[str] = []
    """Names of outputs, such as ``tip_x``."""
    quantity: Literal["outputs", "estimates", "prediction_error"] = "outputs"
    """Outputs by name, or all that the controller estimates or mispredicts."""
    title: str | None = None
    """Above the plot."""
    comparisons: list[str] | None = None
    """Labels of the comparisons that it shows; all by default."""

    @model_validator(mode="after")
    def _something_to_show(self) -> PlotSettings:
        if bool(self.outputs) != (self.quantity == "outputs"):
            raise ValueError("expected 'outputs', or a 'quantity' other than outputs")
        return self


class Scenario(Strict):
    """A whole run."""

    title: str | None = None
    """What ``rnc-pin list`` and the plots call it."""
    robot: RobotSource
    constraints: list[ConstraintItem] = []
    mimic: bool = True
    """Whether joints that the robot's file couples to others follow them."""
    actuators: list[ActuatorItem] = []
    outputs: Outputs
    task: TaskNames = TaskNames()
    initial: Initial = Initial()
    reference: References = References()
    controller: ControllerItem | None = None
    simulation: SimulationSettings | None = None
    plant: PlantSettings | None = None
    """What moves: "reduced", our own, or "mujoco", with its settings."""
    faults: FaultSettings | None = None
    """What the machine does otherwise than the controller believes."""
    loop: LoopSettings | None = None
    """The loop around the controller."""
    grip: GripSettings | None = None
    """Friction of the ground, that preflight holds references against."""
    preflight: Literal["warn", "refuse"] = "warn"
    """What to do about a reference that leads to a singular configuration, found before anything moves."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Of everything that is drawn at random."""
    comparisons: dict[str, dict[str, Any]] = {}
    """Label: dotted keys and values that differ from this run."""
    presets: dict[Literal["paper", "normalised", "scaled"], dict[str, Any]] = {}
    """Preset of the controller: dotted keys and values that go with it, where they are not said otherwise."""
    variant: str | None = None
    """Which of the ``variants`` is run; none of them by default."""
    variants: dict[str, dict[str, Any]] = {}
    """Name: dotted keys and values of the same robot with other coordinates or another task."""
    sweep: dict[str, Annotated[list[float], Field(min_length=2, max_length=2)]] = {}
    """Dotted key: range from which ``rnc-pin sweep`` draws uniformly."""
    plots: dict[FileName, PlotSettings] = {}
    view: Annotated[View, Entry(View)] = View()

    @model_validator(mode="after")
    def _variant_exists(self) -> Scenario:
        if self.variant is not None and self.variant not in self.variants:
            raise ValueError(f"no variant '{self.variant}'{nearest(self.variant, self.variants)}")
        return self

    @model_validator(mode="after")
    def _labels_exist(self) -> Scenario:
        for name, plot in self.plots.items():
            for label in plot.comparisons or []:
                if label not in self.comparisons:
                    hint = nearest(label, self.comparisons)
                    raise ValueError(f"plots.{name}.comparisons: no comparison '{label}'{hint}")
        return self
