"""Constraints, outputs, tasks, actuators and forces in a scenario file: the key and the class of each kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, cast

import numpy as np
from pydantic import AfterValidator, Field

from rnc_pin.applications.scenario.schema.derived import Entry, one_of
from rnc_pin.applications.scenario.schema.motions import ReferenceItem
from rnc_pin.constraints import (
    AckermannSteering,
    Caster,
    CurvedGround,
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
from rnc_pin.forces import Damper, SmoothFriction, Spring, Wrench
from rnc_pin.io import Numbers, Strict
from rnc_pin.model import (
    Actuator,
    ConstraintKind,
    Coordinates,
    ForceKind,
    FrameForce,
    FrameTorque,
    OutputKind,
)
from rnc_pin.outputs import (
    CenterOfMass,
    Distance,
    FrameAngularVelocity,
    FrameOrientation,
    FramePosition,
    FrameSpeed,
    FrameTilt,
    FrameYaw,
    JointPosition,
)
from rnc_pin.planning import Reference
from rnc_pin.plants import UnilateralContact

_Shape = Annotated[object, one_of(sphere=Sphere, ellipsoid=Ellipsoid, torus=Torus)]
GroundItem = Annotated[object, one_of(plane=GroundPlane, sphere=SphericalGround, cylinder=CylindricalGround)] | None
_Plane = Annotated[GroundPlane, one_of(plane=GroundPlane)] | None
OutputItem = Annotated[
    OutputKind,
    one_of(
        joint=Entry(JointPosition, short="joint"),
        frame_position=FramePosition,
        frame_orientation=Entry(FrameOrientation, short="frame"),
        frame_yaw=Entry(FrameYaw, short="frame"),
        distance=Distance,
        center_of_mass=CenterOfMass,
        frame_speed=FrameSpeed,
        frame_angular_velocity=FrameAngularVelocity,
        frame_tilt=FrameTilt,
    ),
]


class Outputs(Strict):
    """Reducing outputs x2 and vertical outputs x1."""

    reducing: Annotated[list[OutputItem], Field(min_length=1)]
    """Reducing outputs x2; their rates are the reduced velocity."""
    vertical: list[OutputItem] = []
    """Vertical outputs x1."""


class TaskOutputs(Strict):
    """Roles of the outputs in the task, by the names of their rows (``tip_x``)."""

    primary: list[str] = []
    """Reducing outputs that follow the primary reference; all if neither primary nor redundant outputs are given."""
    redundant: list[str] = []
    """Reducing outputs that the controller uses to move the vertical outputs."""
    vertical: list[str] | None = None
    """Vertical outputs of the task; all by default."""


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


ActuatorItem = Annotated[
    Actuator,
    one_of(True, force=FrameForce, torque=FrameTorque),
]


ForceItem = Annotated[
    ForceKind,
    one_of(
        spring=Entry(Spring, forms={"output": OutputItem}),
        damper=Entry(Damper, forms={"output": OutputItem}),
        smooth_friction=Entry(SmoothFriction, forms={"output": OutputItem}),
        wrench=Wrench,
    ),
]
