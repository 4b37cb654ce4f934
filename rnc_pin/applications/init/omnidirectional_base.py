"""Bases that move in every direction: omnidirectional wheels, steered drives, turrets, and forces without wheels."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from rnc_pin.applications.init import wheeled_base
from rnc_pin.applications.init.assumptions import BENT, DRIVEN, TURNED, BaseAssumptions, place_and_heading
from rnc_pin.applications.init.evidence import GUESSED, LIKELY, SURE, Alternative, DraftDecision, has_word, words_of
from rnc_pin.applications.init.robot_at_start import PLACED, SAME, RobotAtStart, first_smallest
from rnc_pin.applications.init.wheel_detection import Wheel
from rnc_pin.applications.init.wheel_layout import WheelLayout, in_line
from rnc_pin.errors import few
from rnc_pin.math import unit_rows

_GUIDES = 2  # largest number of axle lines with a lateral row: two of them fix the centre of rotation


def turret_base(layout: WheelLayout, at_start: RobotAtStart) -> BaseAssumptions:
    """Body on casters above a driven turret: two wheels side by side, on a pivot that is driven too.

    If the axle is beside the pivot, the body moves in any direction; if it is below the pivot, the turret has to turn
    first, and the outputs are its speed, the angle of the turret and the heading of the body.

    Args:
        layout: wheels by their function.
        at_start: the robot at its start values.
    """
    unit = layout.steered[0]
    kind = f"{len(layout.wheels)} wheels, driven by a turret with {len(unit.wheels)} wheels"
    result = wheeled_base.planar_on_wheels(layout, at_start, kind)
    result.roll_line(unit.wheels, f"steered by {unit.pivot.joint}")
    wheeled_base.add_wheel_motors(result, layout, at_start)
    pivot = unit.pivot
    result.steer(pivot.joint, "turns the turret")
    frame = at_start.body_frame(pivot.index)
    # An axle below the pivot cannot push the body sideways: then its pose is no output, see above.
    if abs(pivot.offset(unit.wheels[0].center) @ unit.wheels[0].heading) > 0.1 * unit.wheels[0].radius:
        result.add_planar_pose_outputs()
    result.drive_along(at_start.along(unit.wheels[0].heading, frame), frame=frame)
    result.outputs += [({"frame_yaw": result.frame}, TURNED), ({"joint": pivot.joint}, BENT)]
    wheeled_base.support_by_casters(result, layout)
    result.vertical.append({"frame_position": {"frame": result.frame, "axes": "xy"}})
    question, evidence = "Is the turret driven?", "it carries all driven wheels, and the other wheels are casters"
    result.decide(question, f"yes, {pivot.joint}", LIKELY, evidence, _as_casters([pivot.joint]))
    return result


def swerve_base(layout: WheelLayout, at_start: RobotAtStart) -> BaseAssumptions:
    """Base on steered drives: each has a motor that steers and a motor that drives.

    Two axle lines fix the centre of rotation; the wheels of the others skid sideways if they are not aimed at it.

    Args:
        layout: wheels by their function.
        at_start: the robot at its start values.
    """
    kind = f"{len(layout.wheels)} wheels, {len(layout.steered)} of them steered drives"
    result = wheeled_base.planar_on_wheels(layout, at_start, kind)
    first, *_ = wheels = [each for cart in _carts(layout, at_start) for each in _farthest(cart)]
    guides = [each.joint for each in wheels]
    # The rate of a wheel tells a motion in every direction; a forward speed is zero while the base moves sideways.
    if len(guides) >= _GUIDES and first.joint in layout.driven.joints:
        result.outputs.append(({"joint": first.joint}, round(DRIVEN / first.radius, 3)))
    else:
        result.drive_along(at_start.along(first.heading))
    if len(guides) < _GUIDES:  # wheels on one line leave the turn about a point of that line
        result.outputs.append(({"frame_yaw": result.frame}, 0.0))
    wheeled_base.add_wheel_motors(result, layout, at_start)
    for each in layout.steered:
        result.roll_line(each.wheels, f"steered by {each.pivot.joint}", lateral=each.wheels[0].joint in guides)
        result.steer(each.pivot.joint)
        # All wheels turn to the same side, also about an axis that points down.
        upward = np.sign(at_start.turning_axis(each.pivot.index)[2])
        result.outputs.append(({"joint": each.pivot.joint}, float(upward * BENT)))
    wheeled_base.support_by_casters(result, layout)
    result.vertical += place_and_heading(result.frame)
    if len(layout.steered) > len(guides):
        result.notes.append("the controller has to aim all wheels at one point: those without a lateral row would skid")
    pivots = [each.pivot.joint for each in layout.steered]
    question, evidence, sure = "Are the wheels steered one by one?", "each driven wheel has a pivot of its own", LIKELY
    if not layout.motorized:
        evidence, sure = "wheels are only drawn on pivots, and the file has no joints about their axles", GUESSED
    result.decide(question, "yes", sure, evidence, _as_casters(pivots[:1] if layout.motorized else pivots))
    return result


def _carts(layout: WheelLayout, at_start: RobotAtStart) -> list[list[list[Wheel]]]:
    """Axle lines of the bodies that carry pivots, if each has two, such as carts under one load; else of all wheels."""
    carts: dict[int, list[Wheel]] = {}
    for each in layout.steered:
        carts.setdefault(int(at_start.robot.model.parents[each.pivot.index]), []).append(each.wheels[0])
    lines = [in_line(wheels) for wheels in carts.values()]
    whole = [in_line(each.wheels[0] for each in layout.steered)]
    return lines if all(len(each) >= _GUIDES for each in lines) else whole


def _farthest(lines: list[list[Wheel]]) -> tuple[Wheel, ...]:
    """Wheels of the first and the last axle line that are farthest apart; one if there is one line."""
    along = [float(line[0].center @ lines[0][0].heading) for line in lines]
    # Two lateral rows on a diagonal stay independent for straight and sideways motion, where rows in line would not.
    pairs = [*itertools.product(lines[int(np.argmax(along))], lines[int(np.argmin(along))])]
    apart = [-float(np.linalg.norm(one.center - other.center)) for one, other in pairs]
    return (lines[0][0],) if len(lines) == 1 else pairs[first_smallest(apart, PLACED)]


def _as_casters(pivots: Sequence[str]) -> Alternative:
    are = "is a caster" if len(pivots) == 1 else "are casters"
    return Alternative(f"{few(pivots)} {are}", {"passive": pivots})


_OMNIDIRECTIONAL = "mecanum.*|.*mecanum|omni|omniwheel|omnidirectional|swedish|holonomic|planar_move"


def wheels_called_omni(wheels: Sequence[Wheel], at_start: RobotAtStart) -> list[Wheel]:
    """Return the wheels of which a joint, a link or a mesh has the name of a wheel with rollers.

    Args:
        wheels: wheels that touch the ground.
        at_start: the robot at its start values.
    """
    return [wheel for wheel in wheels if has_word(_OMNIDIRECTIONAL, *at_start.names_on(wheel.joint))]


def _is_called_omni(at_start: RobotAtStart) -> bool:
    """True if a name of the whole robot tells of rollers; "omni" before a word for a sensor is one of its sensors."""
    # "omni_camera" and "omni wrist" are sensors and tools on any base.
    pairs = (pair for name in at_start.title for pair in itertools.pairwise([*words_of(name), ""]))
    called = (pair for pair in pairs if has_word(_OMNIDIRECTIONAL, pair[0]) or pair == ("planar", "move"))
    sensor = "cam|camera|vision|eye|lidar|laser|scan|scanner|sensor|microphone|mic|antenna|wrist|tool"
    return any(not has_word(sensor, after) for _, after in called)


def rollers_decision(layout: WheelLayout, at_start: RobotAtStart, asked: bool | None) -> DraftDecision | None:
    """Return whether wheels have rollers: by an option, as joints of the file, by headings, or by names.

    Names count if they belong to a wheel or to the whole robot: an omnidirectional camera says nothing of the wheels.

    Args:
        layout: wheels by their function.
        at_start: the robot at its start values.
        asked: answer of the user, or None.

    Returns:
        The decision, whose answer is "yes" or "no"; None if the question does not arise.
    """
    wheels = layout.fixed
    if layout.steered or len(wheels) < 3:  # rollers on two wheels would let the base slide sideways freely
        return None
    no, yes = Alternative("no rollers", {"rollers": False}), Alternative("rollers", {"rollers": True})
    question = "Do the wheels have rollers?"
    if asked is not None:
        return DraftDecision(question, "yes" if asked else "no", SURE, "by an option")
    # The strongest evidence first; each answer but that of the user has another one beside it.
    if any(wheel.rollers for wheel in wheels):
        return DraftDecision(question, "yes", SURE, "they are joints of the file", (no,))
    if not layout.is_straight:
        return DraftDecision(question, "yes", LIKELY, "wheels with different headings could not roll without", (no,))
    if layout.sliding:
        called = few([wheel.joint for wheel in layout.sliding])
        return DraftDecision(question, f"only {called}, which slide", LIKELY, "by their names", (no, yes))
    if wheels_called_omni(wheels, at_start):
        return DraftDecision(question, "yes", LIKELY, "by the name of a wheel", (no,))
    if _is_called_omni(at_start):
        return DraftDecision(question, "yes", GUESSED, "by the name of a plugin or the robot", (no,))
    return DraftDecision(question, "no", LIKELY, "nothing in the file tells of rollers", (yes,))


def omnidirectional_base(layout: WheelLayout, at_start: RobotAtStart) -> BaseAssumptions:
    """Base on three or more wheels with rollers; each roller is one constraint row.

    Args:
        layout: wheels by their function.
        at_start: the robot at its start values.
    """
    wheels, parallel = layout.fixed, layout.is_straight
    angles = [_angle(wheel, wheels, at_start, parallel) for wheel in wheels]
    apart = 0.05  # smallest singular value of three independent rows on the base velocity
    # Roller axes through one point leave the turn about it free, parallel ones a slide: no wheel would tell it.
    if np.linalg.svd(unit_rows(_on_base(wheels, angles)), compute_uv=False)[2] < apart:
        return force_driven_base(layout, at_start, "these rollers do not constrain the base in three directions")
    result = wheeled_base.planar(at_start, f"{len(wheels)} {'Mecanum' if parallel else 'omni'} wheels", wheels)
    modelled = [roller for wheel in wheels for roller in wheel.rollers]
    # Which roller touches changes as a wheel turns; the row holds for the one at the ground, at every angle.
    result.hold(modelled, "the roller at the ground is a constraint row; those of the file are locked")
    for wheel, angle in zip(wheels, angles, strict=True):
        doubt = "as Mecanum wheels are mounted to turn well: MEASURE its sign" if parallel else "MEASURE its angle"
        result.roll(wheel, "" if wheel.rollers else doubt, roller=round(angle, 6) + 0.0)
        result.actuators.append((wheel.joint, ""))
    if not parallel:
        result.notes.append("wheels with different headings can move the base only if they are omni wheels")
    _release(result, layout)
    result.add_planar_pose_outputs()
    return result


def force_driven_base(layout: WheelLayout, at_start: RobotAtStart, why: str = "") -> BaseAssumptions:
    """Base that moves in any direction, driven by forces in place of the wheels.

    Args:
        layout: wheels by their function.
        at_start: the robot.
        why: reason against the wheels; by default that of the layout.
    """
    result = wheeled_base.planar(at_start, f"{len(layout.wheels)} wheels, in any direction", layout.wheels)
    pivots = [pivot.joint for wheel in layout.wheels for pivot in wheel.pivots]
    rollers = [roller for wheel in layout.wheels for roller in wheel.rollers]
    said = "the base is assumed to move in any direction, by forces in place of the wheels; locked and only drawn"
    wheels = (wheel.joint for wheel in layout.wheels)
    result.hold([*wheels, *pivots, *rollers], f"{why or _why_not_on_wheels(layout)}: {said}")
    _release(result, layout)
    push(result)
    return result


def _why_not_on_wheels(found: WheelLayout) -> str:
    if len(found.steered) == 1 and found.casters and not found.fixed:
        still = " ".join(f"--lock {each.pivot.joint}" for each in found.casters)
        pivot = found.steered[0].pivot.joint
        return f"{pivot} alone steers, and casters do not hold the heading of the base (if they are fixed: {still})"
    return "these wheels do not hold the base as they are read"


def push(result: BaseAssumptions) -> None:
    """Add forces along x and y, a torque about z, and the outputs of the base's planar pose.

    Args:
        result: assumptions about the base; they are extended.
    """
    for axis in "xy":
        result.act("force", axis, "in place of the wheels")
    result.act("torque", "z", "")
    result.add_planar_pose_outputs()


def _release(result: BaseAssumptions, layout: WheelLayout) -> None:
    """Lock joints that would lift wheels, and wheels that only support."""
    result.lock_carriers(layout.wheels)
    supports = [joint for each in (*layout.casters, *layout.trailers) for joint in each.joints]
    supports += [wheel.joint for wheel in layout.balls]
    free = [joint for joint in supports if joint not in result.lock]  # a lock has one reason in the draft
    result.hold(free, "wheels that only support are locked and only drawn")


def _angle(wheel: Wheel, wheels: list[Wheel], at_start: RobotAtStart, parallel: bool) -> float:
    """Angle from the wheel's heading to the axis of the roller at the ground [rad]."""
    if wheel.rollers:
        return _modelled_angle(wheel, at_start)
    if not parallel:
        return 0.0
    # Roller axes through the middle give no torque about it: each roller axis is normal to its diagonal.
    middle = np.mean([each.center for each in wheels], axis=0)
    heading, offset = wheels[0].heading, wheel.center - middle
    # Left and right wheels, front and rear, alternate in sign: the product of both offsets tells the diagonal.
    beside = [float(offset @ each) for each in (heading, np.cross([0.0, 0.0, 1.0], heading))]
    side = np.sign(np.prod([each if abs(each) > SAME * wheel.radius else 0.0 for each in beside]))
    return float(-np.pi / 4 * (side or 1.0))


def _modelled_angle(wheel: Wheel, at_start: RobotAtStart) -> float:
    """Roller angle from the file [rad]; all rollers of a wheel have the same angle to the axle, with the same sign."""
    joint = at_start.robot.joint_id(wheel.rollers[0])
    axis = at_start.turning_axis(joint)
    out = at_start.data.oMi[joint].translation - wheel.center
    along_rim = np.cross(out, wheel.axle)  # the wheel's heading if the roller is at the bottom
    # The axis may be written in either direction; seen with its position on the rim, the sign is the same for all.
    angle = np.arcsin(min(abs(float(axis @ wheel.axle)), 1.0))
    return float(angle if (axis @ wheel.axle) * (axis @ along_rim) >= 0 else -angle)


def _on_base(wheels: list[Wheel], angles: list[float]) -> np.ndarray:
    """Roller rows (k, 3) for linear and angular velocity of a base in the middle of the wheels."""
    centers, headings = (np.array(each) for each in zip(*((each.center, each.heading) for each in wheels), strict=True))
    cosines, sines = np.cos(angles)[:, None], np.sin(angles)[:, None]
    x, y, _ = (cosines * headings + sines * np.cross([0.0, 0.0, 1.0], headings)).T
    ahead, left, _ = (centers - centers.mean(axis=0)).T
    # Rotation as speed of a wheel: then a singular value does not depend on the size of the base.
    return np.column_stack([x, y, (ahead * y - left * x) / np.maximum(np.hypot(ahead, left), 1e-9)])
