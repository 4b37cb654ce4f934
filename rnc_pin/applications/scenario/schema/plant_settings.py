"""Plant, faults and control loop in a scenario file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from rnc_pin.applications.scenario.schema.derived import Entry, PartialCall
from rnc_pin.applications.scenario.schema.forces import ForceItem
from rnc_pin.loop import ControlLoop
from rnc_pin.model import NotNegative, Positive
from rnc_pin.plants import Faults, Payload, StuckJoint
from rnc_pin.plants.mujoco import MuJoCoSettings

_MUJOCO, _FAULTS = Entry(MuJoCoSettings), Entry(Faults)
LoopItem = Annotated[
    PartialCall[ControlLoop],
    Entry(
        ControlLoop,
        late=("reduced", "controller", "dt", "limits"),
        optional=("fallback",),
        forms={"max_speed": Positive | None, "min_singular_value": NotNegative | None, "brake": Positive | None},
    ),
]
"""Control loop around the controller: velocity estimation, supervision and safe commands."""


class PlantSettings(_MUJOCO.model):  # type: ignore[name-defined, misc]
    """Simulated plant: the reduced model of rnc_pin, or the robot in MuJoCo."""

    type: Literal["reduced", "mujoco"] = "mujoco"
    """"reduced": the reduced model of rnc_pin; of the other settings it has only ``servo_time``. "mujoco": MuJoCo with
    the other settings."""

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, raw: object) -> object:
        return {"type": raw} if isinstance(raw, str) else raw

    @model_validator(mode="after")
    def _suit(self) -> PlantSettings:
        others = sorted(self.model_fields_set - {"type", "servo_time"})
        if self.type == "reduced" and others:
            raise ValueError(f"'{others[0]}' belongs to the type 'mujoco'")
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
    forces: list[ForceItem] = []
    """Springs, dampers, friction and wrenches that the model of the controller does not contain."""
    payload: Annotated[Payload, Entry(Payload)] | None = None
    """Point mass that the model of the controller does not contain."""
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
