"""Plant, faults and control loop in a scenario file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from rnc_pin.plants import Faults
from rnc_pin.plants.mujoco import MuJoCoSettings
from rnc_pin.scenario.schema.base import Positive, Strict
from rnc_pin.scenario.schema.derived import Entry
from rnc_pin.scenario.schema.forces import ForceItem

_MUJOCO, _FAULTS = Entry(MuJoCoSettings), Entry(Faults)


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
        _ = self.settings  # check them here: the error then names the place in the file
        return self

    @property
    def settings(self) -> MuJoCoSettings:
        """Settings of MuJoCo."""
        return _MUJOCO.build(self)


class Payload(Strict):
    """Point mass that the robot picks up."""

    frame: str
    """Frame that carries the mass at its origin."""
    mass: Positive
    """Mass [kg]."""
    time: Annotated[float, Field(ge=0)] = 0.0
    """Time of the pick-up [s]."""


class StuckJoint(Strict):
    """Joint that locks during the run."""

    joint: str
    """Name of the joint."""
    time: Annotated[float, Field(ge=0)] = 0.0
    """Time at which the joint locks [s]."""


class FaultSettings(_FAULTS.model):  # type: ignore[name-defined, misc]
    """Differences between the simulated plant and the model of the controller."""

    masses: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Largest relative error of the inertia of each body, as a fraction. The scenario's ``seed`` draws the errors."""
    forces: list[ForceItem] = []
    """Springs, dampers, friction and wrenches that the model of the controller does not contain."""
    payload: Payload | None = None
    """Point mass that the model of the controller does not contain."""
    stuck: StuckJoint | None = None
    """Joint that locks; the model of the controller does not contain this."""

    @model_validator(mode="after")
    def _suit(self) -> FaultSettings:
        _ = self.faults
        return self

    @property
    def faults(self) -> Faults:
        """Faults of sensors and actuators."""
        return _FAULTS.build(self)


class LoopSettings(Strict):
    """Control loop around the controller: velocity estimation, supervision and safe commands."""

    velocity: Literal["measured", "filtered", "observer"] = "measured"
    """"measured": velocities of the sensors. "filtered": velocities from positions by low-pass filters. "observer":
    velocities from positions by an observer."""
    cutoff: Positive | None = None
    """Cutoff frequency of the velocity estimate [rad/s]; 0.3 / dt by default."""
    fallback: Literal["hold", "brake", "zero", "raise"] | None = None
    """Safe command after a fault: "hold" the last inputs, "brake", or "zero" inputs. "raise" ends the run. The default
    is "raise" on the plant "reduced" without faults, otherwise "hold"."""
    timeout: Positive | None = None
    """Time for which the loop holds the last inputs while measurements are invalid [s]; five periods by default."""
    max_speed: Positive | None = None
    """Largest plausible speed [rad/s, m/s]; a faster measurement is invalid."""
    min_singular_value: Annotated[float, Field(ge=0)] | None = None
    """Limit for the smallest singular value of E; below it the loop gives the safe command."""
    brake: Positive | None = None
    """Rate at which the safe command "brake" reduces velocities [1/s]."""
