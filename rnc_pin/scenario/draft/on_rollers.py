"""Omnidirectional bases: Mecanum wheels, omni wheels, or independently steered wheels."""

from __future__ import annotations

import numpy as np

from rnc_pin.io.json import Json
from rnc_pin.math.linear_algebra import unit_rows
from rnc_pin.scenario.draft.chassis import WheelLayout
from rnc_pin.scenario.draft.joints import turning_axis
from rnc_pin.scenario.draft.mobility import BaseAssumptions, measured, rolls
from rnc_pin.scenario.draft.on_wheels import planar
from rnc_pin.scenario.draft.site import RobotAtStart
from rnc_pin.scenario.draft.tolerances import SAME
from rnc_pin.scenario.draft.wheels import Wheel

_OMNIDIRECTIONAL = ("mecanum", "omni", "swedish", "holonomic", "planar_move")
_APART = 0.05  # smallest singular value of three independent rows on the base velocity
_MECANUM = np.pi / 4


def has_rollers(chassis: WheelLayout, site: RobotAtStart) -> bool:
    """True if wheels have rollers: as joints of the file, by name, or because their headings differ."""
    wheels = chassis.fixed
    if len(wheels) < 3 or chassis.steered:
        return False
    if any(wheel.rollers for wheel in wheels):
        return True
    return not chassis.is_straight or any(word in site.words for word in _OMNIDIRECTIONAL)


def omnidirectional_base(chassis: WheelLayout, site: RobotAtStart) -> BaseAssumptions:
    """Base on three or more wheels with rollers; each roller is one constraint row."""
    wheels, parallel = chassis.fixed, chassis.is_straight
    angles = [_angle(wheel, wheels, site, parallel) for wheel in wheels]
    if np.linalg.svd(unit_rows(_on_base(wheels, angles)), compute_uv=False)[2] < _APART:
        return force_driven_base(chassis, site, "these rollers do not constrain the base in three directions")
    kind = f"{len(wheels)} {'Mecanum' if parallel else 'omni'} wheels"
    result = planar(site, kind, wheels)
    modelled = [roller for wheel in wheels for roller in wheel.rollers]
    result.hold(modelled, site.start, "the roller at the ground is a constraint row; those of the file are locked")
    for wheel, angle in zip(wheels, angles, strict=True):
        doubt = "" if wheel.rollers else "MEASURE its angle; "
        if parallel and not wheel.rollers:
            doubt = "as Mecanum wheels are mounted to turn well: MEASURE its sign; "
        entry = rolls(wheel, roller=round(angle, 6) + 0.0)
        result.constraints.append((entry, f"{doubt}{measured(wheel)}"))
        result.actuators.append((wheel.joint, ""))
    if not parallel:
        result.notes.append("wheels with different headings can move the base only if they are omni wheels")
    _release(result, chassis, site)
    result.add_planar_pose_outputs()
    return result


def force_driven_base(chassis: WheelLayout, site: RobotAtStart, why: str) -> BaseAssumptions:
    """Base that moves in any direction, driven by forces in place of the wheels."""
    result = planar(site, f"{len(chassis.wheels)} wheels, in any direction", chassis.wheels)
    pivots = [pivot.joint for wheel in chassis.wheels for pivot in wheel.pivots]
    rollers = [roller for wheel in chassis.wheels for roller in wheel.rollers]
    result.hold(
        [*(wheel.joint for wheel in chassis.wheels), *pivots, *rollers],
        site.start,
        f"{why}: the base is assumed to move in any direction, by forces in place of the wheels; locked and only drawn",
    )
    _release(result, chassis, site)
    push(result)
    return result


def push(result: BaseAssumptions) -> None:
    """Add forces along x and y, a torque about z, and the outputs of the base's planar pose."""
    for axis in "xy":
        force: dict[str, Json] = {"force": {"frame": result.frame, "axis": axis}}
        result.actuators.append((force, "in place of the wheels"))
    result.actuators.append(({"torque": {"frame": result.frame, "axis": "z"}}, ""))
    result.add_planar_pose_outputs()


def _release(result: BaseAssumptions, chassis: WheelLayout, site: RobotAtStart) -> None:
    """Lock joints that would lift wheels, and wheels that only support."""
    result.lock_carriers(chassis.wheels, site.start)
    supports = [
        joint
        for carriage in (*chassis.casters, *chassis.trailers)
        for joint in carriage.joints
        if joint not in result.lock
    ]
    supports += [wheel.joint for wheel in chassis.balls if wheel.joint not in result.lock]
    result.hold(supports, site.start, "wheels that only support are locked and only drawn")


def _angle(wheel: Wheel, wheels: list[Wheel], site: RobotAtStart, parallel: bool) -> float:
    """Angle from the wheel's heading to the axis of the roller at the ground [rad]."""
    if wheel.rollers:
        return _modelled_angle(wheel, site)
    if not parallel:
        return 0.0
    # Roller axes through the middle give no torque about it: each roller axis is normal to its diagonal.
    middle = np.mean([each.center for each in wheels], axis=0)
    heading, across = wheels[0].heading, np.cross([0.0, 0.0, 1.0], wheels[0].heading)
    offset = wheel.center - middle
    beside = [float(offset @ each) for each in (heading, across)]
    side = np.sign(np.prod([each if abs(each) > SAME * wheel.radius else 0.0 for each in beside]))
    return float(-_MECANUM * (side or 1.0))


def _modelled_angle(wheel: Wheel, site: RobotAtStart) -> float:
    """Roller angle from the file [rad]; all rollers of a wheel have the same angle to the axle, with the same sign."""
    joint = site.robot.joint_id(wheel.rollers[0])
    axis = turning_axis(site.robot.model, site.data, joint)
    out = site.data.oMi[joint].translation - wheel.center
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
