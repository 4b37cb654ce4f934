"""Constraints in a scenario file: each kind knows what it builds."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import GetJsonSchemaHandler, Tag, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from rnc_pin.constraints import (
    JointCoupling,
    LoopClosure,
    MomentumConservation,
    NoSideSlip,
    RollingBall,
    RollingWheel,
)
from rnc_pin.model.rows import ConstraintKind
from rnc_pin.scenario.schema.base import BY_KIND, Axis, Numbers, Positive, Strict


class _MomentumArguments(Strict):
    joint: str
    value: float | Numbers = 0.0

    @model_validator(mode="before")
    @classmethod
    def _bare_name(cls, raw: object) -> object:
        if isinstance(raw, str):
            return {"joint": raw}
        if not isinstance(raw, dict):
            raise ValueError(f"expected a joint's name or a mapping with joint and value, found {raw!r}")
        return raw

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"anyOf": [{"type": "string", "description": "A joint's name."}, handler(core)]}


class Momentum(Strict):
    """Momentum of an unactuated base joint: its name where it is zero, or ``{joint, value}``."""

    momentum: _MomentumArguments

    def build(self) -> ConstraintKind:
        return MomentumConservation(self.momentum.joint, self.momentum.value)


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
    """[m]"""
    axis: Axis | None = None


class Wheel(Strict):
    """A wheel that rolls on the plane z = 0."""

    rolling_wheel: _WheelArguments

    def build(self) -> ConstraintKind:
        return RollingWheel(self.rolling_wheel.frame, self.rolling_wheel.radius, self.rolling_wheel.axis)


class _BallArguments(Strict):
    frame: str
    radius: Positive


class Ball(Strict):
    """A ball that rolls on the plane z = 0."""

    rolling_ball: _BallArguments

    def build(self) -> ConstraintKind:
        return RollingBall(self.rolling_ball.frame, self.rolling_ball.radius)


class _CouplingArguments(Strict):
    joint: str
    driver: str
    ratio: float = 1.0
    offset: float = 0.0


class Coupling(Strict):
    """A joint that follows another."""

    joint_coupling: _CouplingArguments

    def build(self) -> ConstraintKind:
        a = self.joint_coupling
        return JointCoupling(a.joint, a.driver, a.ratio, a.offset)


class _LoopArguments(Strict):
    frame_a: str
    frame_b: str
    kind: Literal["frame", "point"] = "frame"


class Loop(Strict):
    """Two frames, or their origins, that stay together."""

    loop_closure: _LoopArguments

    def build(self) -> ConstraintKind:
        return LoopClosure(self.loop_closure.frame_a, self.loop_closure.frame_b, self.loop_closure.kind)


Constraint = Annotated[
    Annotated[Momentum, Tag("momentum")]
    | Annotated[SideSlip, Tag("no_side_slip")]
    | Annotated[Wheel, Tag("rolling_wheel")]
    | Annotated[Ball, Tag("rolling_ball")]
    | Annotated[Coupling, Tag("joint_coupling")]
    | Annotated[Loop, Tag("loop_closure")],
    BY_KIND,
]
