"""Omnidirectional bases: Mecanum wheels, omni wheels, or independently steered wheels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rnc_pin.applications.init.base_assumptions import BaseAssumptions, measured, rolls
from rnc_pin.applications.init.decision import LIKELY, SURE, Alternative, DraftDecision
from rnc_pin.applications.init.joint_properties import has_word, turning_axis
from rnc_pin.applications.init.robot_at_start import RobotAtStart
from rnc_pin.applications.init.tolerances import SAME
from rnc_pin.applications.init.wheel_detection import Wheel
from rnc_pin.applications.init.wheel_layout import WheelLayout
from rnc_pin.applications.init.wheeled_base import planar
from rnc_pin.errors import few
from rnc_pin.io import Json
from rnc_pin.math import unit_rows

_OMNIDIRECTIONAL = "mecanum.*|.*mecanum|omni|omniwheel|omnidirectional|swedish|holonomic|planar_move"
_APART = 0.05  # smallest singular value of three independent rows on the base velocity
_MECANUM = np.pi / 4


def wheels_called_omni(wheels: Sequence[Wheel], at_start: RobotAtStart) -> list[Wheel]:
    """Return the wheels of which a joint, a link or a mesh has the name of a wheel with rollers."""
    return [wheel for wheel in wheels if has_word(_OMNIDIRECTIONAL, *at_start.names_on(wheel.joint))]


def rollers_decision(layout: WheelLayout, at_start: RobotAtStart, asked: bool | None) -> DraftDecision | None:
    """Return whether wheels have rollers: by an option, as joints of the file, by headings, or by names.

    Names count if they belong to a wheel or to the whole robot: an omnidirectional camera says nothing of the wheels.

    Returns:
        The decision, whose answer is "yes" or "no"; None if the question does not arise.
    """
    wheels = layout.fixed
    if layout.steered or len(wheels) < 3:
        return None
    no, yes = Alternative("no rollers", ("--no-rollers",)), Alternative("rollers", ("--rollers",))
    question = "Do the wheels have rollers?"
    if asked is not None:
        return DraftDecision(question, "yes" if asked else "no", SURE, "by an option")
    if any(wheel.rollers for wheel in wheels):
        return DraftDecision(question, "yes", SURE, "they are joints of the file", (no,))
    if not layout.is_straight:
        return DraftDecision(question, "yes", LIKELY, "wheels with different headings could not roll without", (no,))
    if layout.sliding:
        called = few([wheel.joint for wheel in layout.sliding])
        return DraftDecision(question, f"only {called}, which slide", LIKELY, "by their names", (no, yes))
    if wheels_called_omni(wheels, at_start) or has_word(_OMNIDIRECTIONAL, *at_start.title):
        return DraftDecision(question, "yes", LIKELY, "by the name of a wheel, a plugin or the robot", (no,))
    return DraftDecision(question, "no", LIKELY, "nothing in the file tells of rollers", (yes,))


def omnidirectional_base(layout: WheelLayout, at_start: RobotAtStart, decided: DraftDecision) -> BaseAssumptions:
    """Base on three or more wheels with rollers; each roller is one constraint row."""
    wheels, parallel = layout.fixed, layout.is_straight
    angles = [_angle(wheel, wheels, at_start, parallel) for wheel in wheels]
    if np.linalg.svd(unit_rows(_on_base(wheels, angles)), compute_uv=False)[2] < _APART:
        return force_driven_base(layout, at_start, "these rollers do not constrain the base in three directions")
    kind = f"{len(wheels)} {'Mecanum' if parallel else 'omni'} wheels"
    result = planar(at_start, kind, wheels)
    result.decisions.append(decided)
    modelled = [roller for wheel in wheels for roller in wheel.rollers]
    result.hold(modelled, at_start.start, "the roller at the ground is a constraint row; those of the file are locked")
    for wheel, angle in zip(wheels, angles, strict=True):
        doubt = "" if wheel.rollers else "MEASURE its angle; "
        if parallel and not wheel.rollers:
            doubt = "as Mecanum wheels are mounted to turn well: MEASURE its sign; "
        entry = rolls(wheel, roller=round(angle, 6) + 0.0)
        result.constraints.append((entry, f"{doubt}{measured(wheel)}"))
        result.actuators.append((wheel.joint, ""))
    if not parallel:
        result.notes.append("wheels with different headings can move the base only if they are omni wheels")
    _release(result, layout, at_start)
    result.add_planar_pose_outputs()
    return result


def force_driven_base(layout: WheelLayout, at_start: RobotAtStart, why: str) -> BaseAssumptions:
    """Base that moves in any direction, driven by forces in place of the wheels."""
    result = planar(at_start, f"{len(layout.wheels)} wheels, in any direction", layout.wheels)
    pivots = [pivot.joint for wheel in layout.wheels for pivot in wheel.pivots]
    rollers = [roller for wheel in layout.wheels for roller in wheel.rollers]
    result.hold(
        [*(wheel.joint for wheel in layout.wheels), *pivots, *rollers],
        at_start.start,
        f"{why}: the base is assumed to move in any direction, by forces in place of the wheels; locked and only drawn",
    )
    _release(result, layout, at_start)
    push(result)
    return result


def push(result: BaseAssumptions) -> None:
    """Add forces along x and y, a torque about z, and the outputs of the base's planar pose."""
    for axis in "xy":
        force: dict[str, Json] = {"force": {"frame": result.frame, "axis": axis}}
        result.actuators.append((force, "in place of the wheels"))
    result.actuators.append(({"torque": {"frame": result.frame, "axis": "z"}}, ""))
    result.add_planar_pose_outputs()


def _release(result: BaseAssumptions, layout: WheelLayout, at_start: RobotAtStart) -> None:
    """Lock joints that would lift wheels, and wheels that only support."""
    result.lock_carriers(layout.wheels, at_start.start)
    supports = [
        joint
        for carriage in (*layout.casters, *layout.trailers)
        for joint in carriage.joints
        if joint not in result.lock
    ]
    supports += [wheel.joint for wheel in layout.balls if wheel.joint not in result.lock]
    result.hold(supports, at_start.start, "wheels that only support are locked and only drawn")


def _angle(wheel: Wheel, wheels: list[Wheel], at_start: RobotAtStart, parallel: bool) -> float:
    """Angle from the wheel's heading to the axis of the roller at the ground [rad]."""
    if wheel.rollers:
        return _modelled_angle(wheel, at_start)
    if not parallel:
        return 0.0
    # Roller axes through the middle give no torque about it: each roller axis is normal to its diagonal.
    middle = np.mean([each.center for each in wheels], axis=0)
    heading, across = wheels[0].heading, np.cross([0.0, 0.0, 1.0], wheels[0].heading)
    offset = wheel.center - middle
    beside = [float(offset @ each) for each in (heading, across)]
    side = np.sign(np.prod([each if abs(each) > SAME * wheel.radius else 0.0 for each in beside]))
    return float(-_MECANUM * (side or 1.0))


def _modelled_angle(wheel: Wheel, at_start: RobotAtStart) -> float:
    """Roller angle from the file [rad]; all rollers of a wheel have the same angle to the axle, with the same sign."""
    joint = at_start.robot.joint_id(wheel.rollers[0])
    axis = turning_axis(at_start.robot.model, at_start.data, joint)
    out = at_start.data.oMi[joint].translation - wheel.center
    along_rim = np.cross(out, wheel.axle)  # the wheel's heading if the roller is at the bottom
    angle = np.arcsin(min(abs(float(axis @ wheel.axle)), 1.0))
    return float(angle if (axis @ wheel.axle) * (axis @ along_rim) >= 0 else -angle)


def _on_base(wheels: list[Wheel], angles: list[float]) -> np.ndarray:
    """Roller rows (k, 3) for linear and angular velocity of a base in the middle of the wheels."""
    middle = np.mean([wheel.center for wheel in wheels], axis=0)
    rows = []
    for wheel, angle in zip(wheels, angles, strict=True):
        heading, across = wheel.heading, np.cross([0.0, 0.0, 1.0], wheel.heading)
        x, y, _ = np.cos(angle) * heading + np.sin(angle) * across
        at = wheel.center - middle
        size = max(float(np.hypot(at[0], at[1])), 1e-9)
        rows.append([x, y, (at[0] * y - at[1] * x) / size])
    return np.array(rows)
