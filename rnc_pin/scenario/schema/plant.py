"""What moves in a run, and what it does wrong."""

from __future__ import annotations

from typing import Annotated, Literal, cast

from pydantic import Field, model_validator

from rnc_pin.plants import Faults
from rnc_pin.plants.mujoco import MuJoCoSettings
from rnc_pin.scenario.schema.base import Positive, Strict
from rnc_pin.scenario.schema.derived import Entry

_MUJOCO, _FAULTS = Entry(MuJoCoSettings), Entry(Faults)


class PlantSettings(_MUJOCO.model):  # type: ignore[name-defined, misc]
    """What moves: our own reduced model, or the robot in MuJoCo with settings of that."""

    type: Literal["reduced", "mujoco"] = "mujoco"
    """"reduced": our own; "mujoco": MuJoCo, to which the other settings belong."""

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, raw: object) -> object:
        return {"type": raw} if isinstance(raw, str) else raw

    @model_validator(mode="after")
    def _suit(self) -> PlantSettings:
        others = sorted(self.model_fields_set - {"type"})
        if self.type == "reduced" and others:
            raise ValueError(f"'{others[0]}' belongs to the type 'mujoco'")
        _ = self.settings  # refused here, with their place in the file
        return self

    @property
    def settings(self) -> MuJoCoSettings:
        """Those of MuJoCo."""
        return cast(MuJoCoSettings, _MUJOCO.build(self))


class Payload(Strict):
    """A load that the robot takes up, as a point mass."""

    frame: str
    """Frame that it is fixed to."""
    mass: Positive
    """[kg]"""
    time: Annotated[float, Field(ge=0)] = 0.0
    """When it is taken up [s]."""


class StuckJoint(Strict):
    """A joint that stops moving."""

    joint: str
    """Its name."""
    time: Annotated[float, Field(ge=0)] = 0.0
    """When it gets stuck [s]."""


class FaultSettings(_FAULTS.model):  # type: ignore[name-defined, misc]
    """What the real machine does otherwise than the controller believes."""

    masses: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Share by which the inertia of each body differs from the robot's file at most; drawn by the seed."""
    payload: Payload | None = None
    """A load that the controller does not know of."""
    stuck: StuckJoint | None = None
    """A joint that gets stuck."""

    @model_validator(mode="after")
    def _suit(self) -> FaultSettings:
        _ = self.faults
        return self

    @property
    def faults(self) -> Faults:
        """Those of sensors and actuators."""
        return cast(Faults, _FAULTS.build(self))


class LoopSettings(Strict):
    """The loop around the controller: what it makes of measurements, and what it does in trouble."""

    velocity: Literal["measured", "filtered", "observer"] = "measured"
    """Velocities as sensors give them; or from positions, through low passes or by an observer."""
    cutoff: Positive | None = None
    """Of the velocity's estimate [rad/s]; 0.3 / dt by default."""
    on_trouble: Literal["hold", "brake", "zero", "raise"] | None = None
    """Safe command, or to end the run; the latter by default on our own plant, "hold" elsewhere."""
    patience: Positive | None = None
    """How long the last inputs are held while measurements are no good [s]."""
    fastest: Positive | None = None
    """Speed beyond which a measurement cannot be true [rad/s, m/s]."""
    margin: Annotated[float, Field(ge=0)] | None = None
    """Smallest singular value of E below which the controller is no longer asked."""
    brake: Positive | None = None
    """Rate at which the safe command "brake" takes velocities away [1/s]."""
