"""Bases on wheels without slip: carts, skid-steered bases, cars, tricycles, trucks with trailers."""

from __future__ import annotations

import numpy as np

from rnc_pin.io.json import Json
from rnc_pin.scenario.draft.base_assumptions import BENT, DRIVEN, TURNED, BaseAssumptions, measured, rolls
from rnc_pin.scenario.draft.drawn_axles import DrawnAxle
from rnc_pin.scenario.draft.robot_at_start import RobotAtStart
from rnc_pin.scenario.draft.tolerances import SAME, first_smallest
from rnc_pin.scenario.draft.wheel_detection import UPRIGHT, Wheel
from rnc_pin.scenario.draft.wheel_layout import WheelGroup, WheelLayout, are_parallel, in_line


def wheeled_base(
    layout: WheelLayout, at_start: RobotAtStart, driven: frozenset[str] = frozenset(), *, toe: bool = False
) -> BaseAssumptions:
    """Base on one or more axles, with steered wheels, casters and trailers.

    Args:
        layout: wheels by their function.
        at_start: the robot.
        driven: driven joints of the file; empty if the file does not name any.
        toe: True if the second steered wheel skids, because the angles of a file do not let both roll.
    """
    result = planar(at_start, _kind(layout), layout.wheels)
    result.lock_carriers(layout.wheels, at_start.start)
    gliding = [wheel.joint for wheel in layout.balls]
    result.hold(gliding, at_start.start, "ball casters slide, so that they are locked and only drawn")
    for dolly in layout.dollies:
        result.passive.add(dolly)
    _roll(result, layout, at_start)
    idle = [wheel.joint for wheel in layout.fixed if wheel.joint not in driven]
    if 0 < len(idle) < len(layout.fixed):
        result.actuators = [(entry, remark) for entry, remark in result.actuators if entry not in idle]
        result.passive |= set(idle)
        result.notes.append(f"the file drives other wheels, not {', '.join(idle)}")
    along = at_start.along(layout.fixed[0].heading)
    result.outputs.append(({"frame_speed": {"frame": at_start.frame, "axis": along}}, DRIVEN))
    if layout.steered:
        _steer(result, layout, at_start, toe)
    else:
        if len(layout.fixed) == 1:
            torque: dict[str, Json] = {"torque": {"frame": at_start.frame, "axis": "z"}}
            result.actuators.append((torque, "turns the base: one wheel cannot"))
            result.notes.append("one wheel, held upright by assumption: if it may fall, give the robot a free base")
        result.outputs.append(({"frame_yaw": at_start.frame}, TURNED))
    for carriage in layout.casters:
        for wheel in carriage.wheels:
            result.constraints.append((_turned(wheel), f"a caster, not driven; {measured(wheel)}"))
        result.passive |= set(carriage.joints)
    for carriage in layout.trailers:
        _tow(result, carriage)
    result.vertical.append({"frame_position": {"frame": at_start.frame, "axes": "xy"}})
    if layout.steered:
        result.vertical.append({"frame_yaw": at_start.frame})
    return result


def planar(at_start: RobotAtStart, kind: str, wheels: list[Wheel]) -> BaseAssumptions:
    """Planar base; it uses the file's own planar joints if there are any."""
    result = BaseAssumptions("planar", kind, at_start.frame, travel=DRIVEN)
    if at_start.own_planar_joints:
        result.base = "fixed"
        result.passive |= set(at_start.own_planar_joints)
        result.notes.append(
            "the file's own joints let the base move over the ground, its wheels drive it: "
            f"{', '.join(at_start.own_planar_joints)}"
        )
    elif at_start.has_replaceable_free_joint:
        result.lock.update(at_start.own_joint)
        result.notes.append(f"a planar base replaces the file's own {', '.join(at_start.own_joint)}")
    elif at_start.root:
        result.base = "fixed" if at_start.is_urdf else "planar"
    result.ground = float(np.median([wheel.center[2] - wheel.radius for wheel in wheels])) if wheels else None
    return result


def knife_edge_base(axles: list[DrawnAxle], at_start: RobotAtStart) -> BaseAssumptions:
    """Base whose wheels are only drawn: one knife edge for the axles of each body."""
    count = f"{len(axles)} axle{'s' * (len(axles) > 1)}"
    result = planar(at_start, f"wheels are drawn on {count}, and no joint turns them", [])
    result.notes.append("wheels are not joints of this file, so that axles are taken as knife edges: no side slip")
    bodies = list(dict.fromkeys(each.joint for each in axles))
    for body in bodies:
        there = [each for each in axles if each.joint == body]
        edge: dict[str, Json] = {"frame": there[0].frame, "axis": there[0].axis}
        if len(there) > 1:
            if body == at_start.root:
                edge = _midway(at_start, there[0].axle, np.mean([each.center for each in there], axis=0))
            result.notes.append(f"{len(there)} axles of one body cannot all roll in a turn: MEASURE where it turns")
        result.constraints.append(({"no_side_slip": edge}, "knife edge"))
    own = [each for each in axles if each.joint == at_start.root] or axles[:1]
    along = at_start.along(np.cross(own[0].axle, [0.0, 0.0, 1.0]))
    frame = at_start.frame
    result.actuators.append(({"force": {"frame": frame, "axis": along}}, "drives the base"))
    if len(bodies) == 1:
        result.actuators.append(({"torque": {"frame": frame, "axis": "z"}}, "turns the base"))
    result.outputs += [({"frame_speed": {"frame": frame, "axis": along}}, DRIVEN), ({"frame_yaw": frame}, TURNED)]
    result.vertical.append({"frame_position": {"frame": frame, "axes": "xy"}})
    return result


def _midway(at_start: RobotAtStart, axle: np.ndarray, middle: np.ndarray) -> dict[str, Json]:
    """Knife edge at the midpoint of several axles; axle direction (3,) and midpoint (3,) in the world frame."""
    edge: dict[str, Json] = {"frame": at_start.frame, "axis": at_start.along(axle)}
    height = float(at_start.placement.translation[2])
    at = at_start.own_point(np.array([middle[0], middle[1], height]))
    if any(at):
        edge["at"] = at
    return edge


def _kind(layout: WheelLayout) -> str:
    count = f"{len(layout.wheels)} wheel{'s' * (len(layout.wheels) > 1)}"
    if layout.steered:
        what = "steered like a car"
    elif len(layout.axles) > 1:
        what = "skid-steered"
    else:
        what = "differential drive" if len(layout.fixed) > 1 else "one wheel"
    towing = f" with {len(layout.trailers)} trailer{'s' * (len(layout.trailers) > 1)}" if layout.trailers else ""
    return f"{count}, {what}{towing}"


def _roll(result: BaseAssumptions, layout: WheelLayout, at_start: RobotAtStart) -> None:
    """Add fixed wheels: one axle, or an equivalent one midway, has no side slip; the others skid in a turn."""
    axles = layout.axles
    middle = np.mean([np.mean([wheel.center for wheel in axle], axis=0) for axle in axles], axis=0)
    guide = axles[0]
    if len(axles) > 1:
        distances = [abs(float((axle[0].center - middle) @ axle[0].heading)) for axle in axles]
        guide = axles[first_smallest(distances, SAME * guide[0].radius)]
        nearby = min(distances) < 0.1 * guide[0].radius
        if not layout.steered and not nearby:
            guide = []
            edge = _midway(at_start, layout.fixed[0].axle, middle)
            result.constraints.append(({"no_side_slip": edge}, "the equivalent axle, midway: MEASURE where it turns"))
        result.notes.append(
            f"{len(axles)} axles cannot all roll in a turn: wheels skid sideways, but for "
            + (f"the axle of {', '.join(wheel.joint for wheel in guide)}" if guide else "an equivalent axle midway")
            + "; if these are Mecanum or omni wheels, give each its roller instead of lateral"
        )
    for axle in axles:
        for wheel in axle:
            if axle is guide:
                result.constraints.append((rolls(wheel), measured(wheel)))
            else:
                result.constraints.append((rolls(wheel, lateral=False), f"skids sideways; {measured(wheel)}"))
            result.actuators.append((wheel.joint, ""))


def _steer(result: BaseAssumptions, layout: WheelLayout, at_start: RobotAtStart, toe: bool) -> None:
    """Add steered wheels: a pair with Ackermann steering, or all wheels of one turntable; lock further pivots."""
    first, *others = layout.steered
    axle = layout.fixed[0]
    beside = [each for each in others if _side_by_side(first, each, axle)]
    leader = at_start.leader(first.pivot.joint)
    for wheel in first.wheels:
        result.constraints.append((_turned(wheel), f"steered by {first.pivot.joint}; {measured(wheel)}"))
    result.actuators.append((leader, "steering"))
    result.outputs.append(({"joint": leader}, BENT))
    result.passive |= set(first.joints) - {leader}
    for other in beside[:1]:
        pair = [first.pivot.joint, other.pivot.joint]
        together = at_start.leader(pair[1]) == leader
        if together:
            result.notes.append(f"{pair[0]} and {pair[1]} have the same angle, so that the second wheel skids")
        else:
            ackermann: dict[str, Json] = {"left": pair[0], "right": pair[1], "axle": axle.frame}
            result.constraints.append(({"ackermann": ackermann}, "both steered wheels turn about one point"))
            if toe:
                said = "the axles of the steered wheels are not parallel in the file, as with toe-in"
                result.notes.append(f"{said}: the wheel on {pair[1]} skids a little, because both cannot roll")
        for wheel in other.wheels:
            entry = _turned(wheel, lateral=False) if together or toe else _turned(wheel)
            result.constraints.append((entry, f"steered by {other.pivot.joint}; {measured(wheel)}"))
        result.passive |= set(other.joints) - {leader}
    straight = [each for each in others if each not in beside[:1]]
    for each in straight:
        for wheel in each.wheels:
            result.constraints.append((rolls(wheel, lateral=False), f"locked straight, skids; {measured(wheel)}"))
        result.passive |= {wheel.joint for wheel in each.wheels}
    pivots = (each.pivot.joint for each in straight)
    result.hold(pivots, at_start.start, "only one pair of wheels steers; locked straight")


def _turned(wheel: Wheel, **more: Json) -> dict[str, Json]:
    """Entry of a wheel on a pivot; no vertical row if the pivot is inclined, because a planar base keeps its height."""
    leans = any(float(np.hypot(*pivot.axis[:2])) > UPRIGHT for pivot in wheel.pivots)
    return rolls(wheel, **more, **({"vertical": False} if leans else {}))


def _side_by_side(one: WheelGroup, other: WheelGroup, axle: Wheel) -> bool:
    across = other.pivot.point - one.pivot.point
    single = len(one.wheels) == len(other.wheels) == 1
    return bool(single and abs(across @ axle.heading) < 0.1 * np.linalg.norm(across)) and are_parallel(
        one.wheels[0], axle
    )


def _tow(result: BaseAssumptions, carriage: WheelGroup) -> None:
    guides = {wheel.joint for wheel in in_line(carriage.wheels)[0]}
    for wheel in carriage.wheels:
        entry = _turned(wheel) if wheel.joint in guides else _turned(wheel, lateral=False)
        what = "" if wheel.joint in guides else ", skids sideways"
        result.constraints.append((entry, f"of a trailer{what}; {measured(wheel)}"))
    result.notes.append(
        f"{carriage.pivot.joint} is a hitch that nothing drives: if it is steered, add it to the actuators"
    )
    result.passive |= set(carriage.joints)
