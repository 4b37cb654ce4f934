"""Constraints, outputs, tasks, actuators and forces in a scenario file: the key and the class of each kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, cast

import numpy as np
from pydantic import AfterValidator, Field

from rnc_pin import constraints, outputs
from rnc_pin.applications.scenario.schema.derived import Entry, one_of
from rnc_pin.applications.scenario.schema.motions import ReferenceItem
from rnc_pin.forces import Damper, SmoothFriction, Spring, Wrench
from rnc_pin.io import Numbers, Strict
from rnc_pin.model import (
    Actuator,
    ConstraintKind,
    Coordinates,
    ForceKind,
    FrameForce,
    FrameTorque,
    OpenDifferential,
    OutputKind,
)
from rnc_pin.motion.planning import Reference
from rnc_pin.plants import UnilateralContact

_Shape = Annotated[object, one_of(sphere=constraints.Sphere, ellipsoid=constraints.Ellipsoid, torus=constraints.Torus)]
_CURVED = {"sphere": constraints.SphericalGround, "cylinder": constraints.CylindricalGround}
GroundItem = Annotated[object, one_of(plane=constraints.GroundPlane, **_CURVED)] | None
_Ground = constraints.GroundPlane | constraints.CurvedGround
_Plane = Annotated[constraints.GroundPlane, one_of(plane=constraints.GroundPlane)] | None
OutputItem = Annotated[
    OutputKind,
    one_of(
        joint=Entry(outputs.JointPosition, short="joint"),
        frame_position=outputs.FramePosition,
        frame_orientation=Entry(outputs.FrameOrientation, short="frame"),
        frame_yaw=Entry(outputs.FrameYaw, short="frame"),
        distance=outputs.Distance,
        center_of_mass=outputs.CenterOfMass,
        frame_speed=outputs.FrameSpeed,
        frame_angular_velocity=outputs.FrameAngularVelocity,
        frame_tilt=outputs.FrameTilt,
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
        momentum=Entry(constraints.MomentumConservation, short="joint"),
        no_side_slip=Entry(constraints.NoSideSlip, forms={"ground": _Plane}),
        rolling_wheel=Entry(constraints.RollingWheel, forms={"ground": GroundItem}),
        rolling_ball=Entry(constraints.RollingBall, forms={"ground": GroundItem}),
        rolling_body=Entry(constraints.RollingBody, forms={"shape": _Shape, "ground": GroundItem}),
        caster=Entry(constraints.Caster, forms={"ground": _Plane}),
        ackermann=constraints.AckermannSteering,
        joint_coupling=constraints.JointCoupling,
        loop_closure=constraints.LoopClosure,
        fixed_output=Entry(constraints.FixedOutput, forms={"output": OutputItem, "value": float | Numbers}),
        prescribed_motion=Entry(
            constraints.PrescribedMotion,
            forms={"output": OutputItem, "motion": Annotated[_MotionArguments, AfterValidator(_motion)]},
        ),
    ),
]


ContactItem = Annotated[UnilateralContact, Entry(UnilateralContact, forms={"constraint": ConstraintItem})]


def with_ground(given: Sequence[ConstraintKind], ground: _Ground) -> list[ConstraintKind]:
    """Return constraints with a ground for those that have none of their own.

    Raises:
        ValueError: no constraint rolls on a ground.
    """
    if not any(hasattr(each, "ground") for each in given):
        raise ValueError("ground: no constraint takes a ground")
    return [
        replace(cast(constraints.RollingBody, each), ground=ground) if getattr(each, "ground", ground) is None else each
        for each in given
    ]


ActuatorItem = Annotated[Actuator, one_of(True, force=FrameForce, torque=FrameTorque, differential=OpenDifferential)]


ForceItem = Annotated[
    ForceKind,
    one_of(
        spring=Entry(Spring, forms={"output": OutputItem}),
        damper=Entry(Damper, forms={"output": OutputItem}),
        smooth_friction=Entry(SmoothFriction, forms={"output": OutputItem}),
        wrench=Wrench,
    ),
]
