"""Bases whose driven wheels are steered: a driven turret on casters, two or more steered drives (swerve)."""

from __future__ import annotations

import numpy as np

from rnc_pin.applications.init.base_assumptions import (
    BENT,
    DRIVEN,
    TURNED,
    BaseAssumptions,
    measured,
    place_and_heading,
)
from rnc_pin.applications.init.decision import LIKELY, Alternative, DraftDecision
from rnc_pin.applications.init.joint_properties import body_frame, turning_axis
from rnc_pin.applications.init.robot_at_start import RobotAtStart
from rnc_pin.applications.init.wheel_detection import Wheel
from rnc_pin.applications.init.wheel_layout import WheelGroup, WheelLayout, are_parallel, in_line
from rnc_pin.applications.init.wheeled_base import (
    add_wheel_motors,
    one_lateral,
    planar_on_wheels,
    support_by_casters,
    turned,
)
from rnc_pin.io import Json

_GUIDES = 2  # largest number of axle lines with a lateral row: two of them fix the centre of rotation


def is_turret(layout: WheelLayout) -> bool:
    """True if one pivot carries two or more driven wheels of one axle line, and nothing else guides the base."""
    if layout.fixed or layout.trailers or len(layout.steered) != 1:
        return False
    wheels = layout.steered[0].wheels
    return len(wheels) > 1 and len(in_line(wheels)) == 1 and all(each.joint in layout.driven.joints for each in wheels)


def is_swerve(layout: WheelLayout) -> bool:
    """True if two or more driven wheels are steered one by one, and nothing else guides the base."""
    if layout.fixed or layout.trailers or len(layout.steered) < 2:
        return False
    wheels = [each.wheels[0] for each in layout.steered]
    driven = [each.joint in layout.driven.joints for each in wheels]
    return sum(driven) > 1 and all(are_parallel(wheels[0], each) for each in wheels)


def turret_base(layout: WheelLayout, at_start: RobotAtStart) -> BaseAssumptions:
    """Body on casters above a driven turret: two wheels side by side, on a pivot that is driven too.

    If the axle is beside the pivot, the body moves in any direction; if it is below the pivot, the turret has to turn
    first, and the outputs are its speed and its heading.
    """
    unit = layout.steered[0]
    result = planar_on_wheels(
        layout, at_start, f"{len(layout.wheels)} wheels, driven by a turret with {len(unit.wheels)} wheels"
    )
    _add_unit(result, unit, lateral=True)
    add_wheel_motors(result, layout)
    pivot = unit.pivot
    result.actuators.append((pivot.joint, "turns the turret"))
    frame = body_frame(at_start.robot, pivot.index)
    along = np.abs(at_start.data.oMi[pivot.index].rotation.T @ unit.wheels[0].heading)
    speed: dict[str, Json] = {"frame_speed": {"frame": frame, "axis": "xyz"[int(along.argmax())]}}
    result.outputs += zip(place_and_heading(result.frame), (DRIVEN, TURNED), strict=True)
    result.outputs += [(speed, DRIVEN), ({"frame_yaw": result.frame}, TURNED), ({"joint": pivot.joint}, BENT)]
    support_by_casters(result, layout, at_start)
    result.vertical.append({"frame_position": {"frame": result.frame, "axes": "xy"}})
    evidence = "its pivot carries all driven wheels, and the other wheels are casters"
    _decide(result, "Is the pivot of the driven wheels driven?", f"yes, {pivot.joint}", evidence, pivot.joint)
    return result


def swerve_base(layout: WheelLayout, at_start: RobotAtStart) -> BaseAssumptions:
    """Base on steered drives: each has a motor that steers and a motor that drives.

    Two axle lines fix the centre of rotation; the wheels of the others skid sideways if they are not aimed at it.
    """
    result = planar_on_wheels(
        layout, at_start, f"{len(layout.wheels)} wheels, {len(layout.steered)} of them steered drives"
    )
    lines = in_line(wheel for each in layout.steered for wheel in each.wheels[:1])
    guides = [line[0].joint for line in _farthest(lines)]
    heading = layout.steered[0].wheels[0].heading
    result.outputs.append(({"frame_speed": {"frame": result.frame, "axis": at_start.along(heading)}}, DRIVEN))
    if len(guides) < _GUIDES:
        result.outputs.append(({"frame_yaw": result.frame}, 0.0))
    for each in layout.steered:
        _add_unit(result, each, lateral=each.wheels[0].joint in guides)
        upward = np.sign(turning_axis(at_start.robot.model, at_start.data, each.pivot.index)[2])
        result.outputs.append(({"joint": each.pivot.joint}, float(upward * BENT)))
    add_wheel_motors(result, layout)
    result.actuators += [(each.pivot.joint, "steering") for each in layout.steered]
    support_by_casters(result, layout, at_start)
    result.vertical += place_and_heading(result.frame)
    if len(layout.steered) > len(guides):
        result.notes.append("the controller has to aim all wheels at one point: those without a lateral row would skid")
    evidence = "each driven wheel has a pivot of its own"
    _decide(result, "Are the wheels steered one by one?", "yes", evidence, layout.steered[0].pivot.joint)
    return result


def _add_unit(result: BaseAssumptions, unit: WheelGroup, *, lateral: bool) -> None:
    for wheel, more in one_lateral(unit.wheels):
        entry = turned(wheel, **(more if lateral else {"lateral": False}))
        result.constraints.append((entry, f"steered by {unit.pivot.joint}; {measured(wheel)}"))


def _farthest(lines: list[list[Wheel]]) -> list[list[Wheel]]:
    """First and last axle line along the heading; only one if all wheels are on one line."""
    along = [float(line[0].center @ lines[0][0].heading) for line in lines]
    return [lines[0]] if len(lines) == 1 else [lines[int(np.argmin(along))], lines[int(np.argmax(along))]]


def _decide(result: BaseAssumptions, question: str, answer: str, evidence: str, joint: str) -> None:
    other = Alternative(f"{joint} is a caster's", ("--passive", joint))
    result.decisions.append(DraftDecision(question, answer, LIKELY, evidence, (other,)))
