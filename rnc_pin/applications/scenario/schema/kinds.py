"""Constraints, outputs, tasks, actuators and forces in a scenario file: the key and the class of each kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, cast

import numpy as np
from pydantic import AfterValidator, Field

from rnc_pin import constraints, model, outputs
from rnc_pin.applications.scenario.schema.derived import ClassReader, one_of
from rnc_pin.applications.scenario.schema.motions import ReferenceItem
from rnc_pin.forces import Damper, SmoothFriction, Spring, Wrench
from rnc_pin.io import Numbers, Strict
from rnc_pin.motion.planning import Reference
from rnc_pin.plants import UnilateralContact

_Shape = Annotated[object, one_of(sphere=constraints.Sphere, ellipsoid=constraints.Ellipsoid, torus=constraints.Torus)]
_CURVED = {"sphere": constraints.SphericalGround, "cylinder": constraints.CylindricalGround}
_Ground = constraints.GroundPlane | constraints.CurvedGround
GroundItem = Annotated[_Ground, one_of(plane=constraints.GroundPlane, **_CURVED)] | None
_Plane = Annotated[constraints.GroundPlane, one_of(plane=constraints.GroundPlane)] | None
OutputItem = Annotated[
    model.OutputKind,
    one_of(
        joint=ClassReader(outputs.JointPosition, short="joint"),
        frame_position=outputs.FramePosition,
        frame_orientation=ClassReader(outputs.FrameOrientation, short="frame"),
        frame_yaw=ClassReader(outputs.FrameYaw, short="frame"),
        distance=outputs.Distance,
        center_of_mass=outputs.CenterOfMass,
        frame_speed=outputs.FrameSpeed,
        frame_angular_velocity=outputs.FrameAngularVelocity,
        frame_tilt=outputs.FrameTilt,
    ),
]


class Outputs(Strict):
    """Reducing outputs x2 and vertical outputs x1.

    Attributes:
        reducing: reducing outputs x2; their rates are the reduced velocity.
        vertical: vertical outputs x1.
    """

    reducing: Annotated[list[OutputItem], Field(min_length=1)]
    vertical: list[OutputItem] = []


class TaskOutputs(Strict):
    """Roles of the outputs in the task, by the names of their rows (``tip_x``).

    Attributes:
        primary: reducing outputs that follow the primary reference; all if neither primary nor redundant outputs are
            given.
        redundant: reducing outputs that the controller uses to move the vertical outputs.
        vertical: vertical outputs of the task; all by default.
    """

    primary: list[str] = []
    redundant: list[str] = []
    vertical: list[str] | None = None


class _MotionArguments(Strict):
    """Motion over time.

    Attributes:
        start: values of the output at time zero [m or rad]; zeros for a speed.
        reference: motion from there, of the output or of the integral of a speed.
    """

    start: Numbers
    reference: ReferenceItem


def _motion(given: _MotionArguments) -> Reference:
    start = np.array(given.start, dtype=float)
    # Without a robot, the kinds of the output's rows are not known here: they count as numbers.
    return given.reference.from_start(start, model.Coordinates([False] * start.size))


ConstraintItem = Annotated[
    model.ConstraintKind,
    one_of(
        momentum=ClassReader(constraints.MomentumConservation, short="joint"),
        no_side_slip=ClassReader(constraints.NoSideSlip, forms={"ground": _Plane}),
        rolling_wheel=ClassReader(constraints.RollingWheel, forms={"ground": GroundItem}),
        rolling_ball=ClassReader(constraints.RollingBall, forms={"ground": GroundItem}),
        rolling_body=ClassReader(constraints.RollingBody, forms={"shape": _Shape, "ground": GroundItem}),
        caster=ClassReader(constraints.Caster, forms={"ground": _Plane}),
        ackermann=constraints.AckermannSteering,
        joint_coupling=constraints.JointCoupling,
        loop_closure=constraints.LoopClosure,
        fixed_output=ClassReader(constraints.FixedOutput, forms={"output": OutputItem, "value": float | Numbers}),
        prescribed_motion=ClassReader(
            constraints.PrescribedMotion,
            forms={"output": OutputItem, "motion": Annotated[_MotionArguments, AfterValidator(_motion)]},
        ),
    ),
]


ContactItem = Annotated[UnilateralContact, ClassReader(UnilateralContact, forms={"constraint": ConstraintItem})]


_ON_GROUND = (
    constraints.NoSideSlip,
    constraints.RollingWheel,
    constraints.RollingBall,
    constraints.RollingBody,
    constraints.Caster,
)


def with_ground(given: Sequence[model.ConstraintKind], ground: _Ground) -> list[model.ConstraintKind]:
    """Return constraints with a ground for those that have none of their own.

    Args:
        given: the constraints.
        ground: ground of the scenario.

    Raises:
        ValueError: no constraint rolls on a ground.
    """
    if not any(isinstance(each, _ON_GROUND) for each in given):
        raise ValueError("ground: no constraint takes a ground")
    # Constraints are made before the ground is known: those that name none have None until here.
    on_it = cast(constraints.GroundPlane, ground)  # constraints on planes refuse another ground themselves
    return [
        replace(each, ground=on_it) if isinstance(each, _ON_GROUND) and each.ground is None else each for each in given
    ]


_ON_OUTPUT = {"output": OutputItem}
ActuatorItem = Annotated[
    model.Actuator, one_of(True, force=model.FrameForce, torque=model.FrameTorque, differential=model.OpenDifferential)
]


ForceItem = Annotated[
    model.ForceKind,
    one_of(
        spring=ClassReader(Spring, forms=_ON_OUTPUT),
        damper=ClassReader(Damper, forms=_ON_OUTPUT),
        smooth_friction=ClassReader(SmoothFriction, forms=_ON_OUTPUT),
        wrench=Wrench,
    ),
]
