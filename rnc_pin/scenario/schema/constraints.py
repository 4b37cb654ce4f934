"""Constraints in a scenario file: the key and the class of each kind."""

from __future__ import annotations

from typing import Annotated

from rnc_pin.constraints import (
    AckermannSteering,
    Caster,
    JointCoupling,
    LoopClosure,
    MomentumConservation,
    NoSideSlip,
    RollingBall,
    RollingWheel,
)
from rnc_pin.model.rows import ConstraintKind
from rnc_pin.scenario.schema.derived import Entry, one_of

ConstraintItem = Annotated[
    ConstraintKind,
    one_of(
        momentum=Entry(MomentumConservation, short="joint", keys={"momentum": "value"}),
        no_side_slip=NoSideSlip,
        rolling_wheel=RollingWheel,
        rolling_ball=RollingBall,
        caster=Caster,
        ackermann=AckermannSteering,
        joint_coupling=JointCoupling,
        loop_closure=LoopClosure,
    ),
]
