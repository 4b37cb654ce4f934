"""Constraints in a scenario file: the key and the class of each kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, cast

import numpy as np
from pydantic import AfterValidator

from rnc_pin.applications.scenario.schema.base import Numbers, Strict
from rnc_pin.applications.scenario.schema.derived import Entry, one_of, plain_or
from rnc_pin.applications.scenario.schema.outputs import OutputItem
from rnc_pin.applications.scenario.schema.reference_settings import ReferenceItem
from rnc_pin.constraints import (
    AckermannSteering,
    BodySurface,
    Caster,
    Cone,
    CurvedGround,
    Cylinder,
    CylindricalGround,
    Ellipsoid,
    FixedOutput,
    GroundPlane,
    JointCoupling,
    LoopClosure,
    MomentumConservation,
    NoSideSlip,
    PrescribedMotion,
    RollingBall,
    RollingBody,
    RollingWheel,
    Sphere,
    SphericalGround,
    Torus,
)
from rnc_pin.model import ConstraintKind, Coordinates
from rnc_pin.planning import Reference
from rnc_pin.plants import UnilateralContact

_Shape = Annotated[object, one_of(sphere=Sphere, ellipsoid=Ellipsoid, torus=Torus, cylinder=Cylinder, cone=Cone)]
_Smooth = Annotated[object, one_of(sphere=Sphere, ellipsoid=Ellipsoid, torus=Torus)]
_Surfaces = plain_or(
    GroundPlane,
    sphere=SphericalGround,
    cylinder=CylindricalGround,
    body=Entry(BodySurface, forms={"shape": _Smooth}),
)
GroundItem = Annotated[object, _Surfaces] | None
_Plane = Annotated[GroundPlane, Entry(GroundPlane)] | None


class _MotionArguments(Strict):
    """Motion over time."""

    start: Numbers
    """Values of the output at time zero [m or rad]; zeros for a speed."""
    reference: ReferenceItem
    """Motion from there, of the output or of the integral of a speed."""


def _motion(given: _MotionArguments) -> Reference:
    start = np.array(given.start, dtype=float)
    return given.reference.from_start(start, Coordinates([False] * start.size))


ConstraintItem = Annotated[
    ConstraintKind,
    one_of(
        momentum=Entry(MomentumConservation, short="joint"),
        no_side_slip=Entry(NoSideSlip, forms={"ground": _Plane}),
        rolling_wheel=Entry(RollingWheel, forms={"ground": GroundItem}),
        rolling_ball=Entry(RollingBall, forms={"ground": GroundItem}),
        rolling_body=Entry(RollingBody, forms={"shape": _Shape, "ground": GroundItem}),
        caster=Entry(Caster, forms={"ground": _Plane}),
        ackermann=AckermannSteering,
        joint_coupling=JointCoupling,
        loop_closure=LoopClosure,
        fixed_output=Entry(FixedOutput, forms={"output": OutputItem, "value": float | Numbers}),
        prescribed_motion=Entry(
            PrescribedMotion,
            forms={"output": OutputItem, "motion": Annotated[_MotionArguments, AfterValidator(_motion)]},
        ),
    ),
]


ContactItem = Annotated[UnilateralContact, Entry(UnilateralContact, forms={"constraint": ConstraintItem})]


def with_ground(constraints: Sequence[ConstraintKind], ground: GroundPlane | CurvedGround) -> list[ConstraintKind]:
    """Return constraints with a ground for those that have none of their own.

    Raises:
        ValueError: no constraint rolls on a ground.
    """
    if not any(hasattr(each, "ground") for each in constraints):
        raise ValueError("ground: no constraint takes a ground")
    return [
        replace(cast(RollingBody, each), ground=ground) if getattr(each, "ground", ground) is None else each
        for each in constraints
    ]
