"""Constraints in a scenario file: the key and the class of each kind."""

from __future__ import annotations

from typing import Annotated

from rnc_pin.constraints import (
    AckermannSteering,
    Caster,
    Ellipsoid,
    GroundPlane,
    JointCoupling,
    LoopClosure,
    MomentumConservation,
    NoSideSlip,
    RollingBall,
    RollingBody,
    RollingWheel,
    Sphere,
    Torus,
)
from rnc_pin.model.rows import ConstraintKind
from rnc_pin.scenario.schema.derived import Entry, one_of

_Shape = Annotated[object, one_of(sphere=Sphere, ellipsoid=Ellipsoid, torus=Torus)]
_Ground = Annotated[GroundPlane, Entry(GroundPlane)] | None

ConstraintItem = Annotated[
    ConstraintKind,
    one_of(
        momentum=Entry(MomentumConservation, short="joint", keys={"momentum": "value"}),
        no_side_slip=NoSideSlip,
        rolling_wheel=RollingWheel,
        rolling_ball=RollingBall,
        rolling_body=Entry(RollingBody, forms={"shape": _Shape, "ground": _Ground}),
        caster=Caster,
        ackermann=AckermannSteering,
        joint_coupling=JointCoupling,
        loop_closure=LoopClosure,
    ),
]
