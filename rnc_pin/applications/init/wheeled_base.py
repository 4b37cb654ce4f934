"""Bases on wheels without slip: carts, skid-steered bases, cars, tricycles, trucks with trailers."""

from __future__ import annotations

from statistics import median

import numpy as np

from rnc_pin.applications.init.assumptions import BENT, DRIVEN, TURNED, BaseAssumptions, place_and_heading
from rnc_pin.applications.init.evidence import GUESSED, LIKELY, SURE, Alternative, has_word
from rnc_pin.applications.init.robot_at_start import RobotAtStart, placed
from rnc_pin.applications.init.wheel_detection import Wheel
from rnc_pin.applications.init.wheel_layout import TOWED, WheelGroup, WheelLayout, are_parallel, in_line
from rnc_pin.errors import few
from rnc_pin.io import Json


def wheeled_base(layout: WheelLayout, at_start: RobotAtStart) -> BaseAssumptions:
    """Base on one or more axles, with steered wheels, casters, trailers or tracks.

    Args:
        layout: wheels by their function.
        at_start: the robot.
    """
    sides = tracks(layout)
    result = planar_on_wheels(layout, at_start, _kind(layout, is_tracked=bool(sides)))
    towed = (pivot.joint for pivot in layout.straight)
    result.hold(towed, "a steered axle of a trailer does not steer the base: locked straight")
    if sides:
        _crawl(result, layout, sides, at_start)
    else:
        _roll(result, layout, at_start)
        add_wheel_motors(result, layout, at_start)
    result.drive_along(at_start.along(layout.fixed[0].heading))
    if layout.steered:
        _steer(result, layout, at_start)
    else:
        if len(layout.fixed) == 1:
            result.act("torque", "z", "turns the base: one wheel cannot")
            result.notes.append("one wheel, held upright by assumption: if it may fall, give the robot a free base")
        result.outputs.append(({"frame_yaw": at_start.frame}, TURNED))
    support_by_casters(result, layout)
    for carriage in layout.trailers:
        _tow(result, carriage, at_start)
    result.vertical += place_and_heading(at_start.frame)
    return result


def add_wheel_motors(result: BaseAssumptions, layout: WheelLayout, at_start: RobotAtStart) -> None:
    """Add the driven wheels to the actuators; the others are passive. Wheels that move together have one motor.

    Args:
        result: assumptions about the base; they are extended.
        layout: wheels by their function.
        at_start: the robot at its start values.
    """
    wheels = [wheel.joint for wheel in layout.motorized]
    if not wheels:
        return
    # A driver that is no wheel, such as a gear above, has its own entry among the joints.
    drivers = {joint: at_start.driver(joint) for joint in wheels if at_start.driver(joint) in wheels}
    own, driven = [joint for joint in wheels if drivers.get(joint, joint) == joint], layout.driven
    # Two wheels on one motor are one input: two would fight each other.
    motors = list(dict.fromkeys(drivers.get(joint, joint) for joint in driven.joints))
    idle = [joint for joint in own if joint not in motors]
    result.actuators += [(joint, "") for joint in own if joint in motors]
    result.passive |= set(idle)
    others = [Alternative(few(idle), {"driven": idle})] if idle else []
    result.decide("Which wheels are driven?", few(motors), driven.confidence, driven.evidence, *others)


def support_by_casters(result: BaseAssumptions, layout: WheelLayout) -> None:
    """Add casters, which follow the base; a swivel without a trail does not, so that its wheel skids.

    Args:
        result: assumptions about the base; they are extended.
        layout: wheels by their function.
    """
    for carriage in layout.casters:
        if carriage.follows:
            for line in in_line(carriage.wheels):
                result.roll_line(line, "a caster, not driven")
        else:
            result.hold([carriage.pivot.joint], "a swivel without a trail does not turn by itself: held")
            result.roll_line(carriage.wheels, "skids sideways", lateral=False)
        result.passive |= set(carriage.joints)


def planar(at_start: RobotAtStart, kind: str, wheels: list[Wheel]) -> BaseAssumptions:
    """Planar base; it uses the file's own planar joints if there are any.

    Args:
        at_start: the robot at its start values.
        kind: description of the base.
        wheels: wheels that tell the height of the ground.
    """
    result = BaseAssumptions("planar", kind, at_start.frame, at_start.start, travel=DRIVEN)
    if at_start.own_planar_joints:
        result.base = "fixed"
        result.passive |= set(at_start.own_planar_joints)
        said = "the file's own joints let the base move over the ground, its wheels drive it"
        result.note(said, at_start.own_planar_joints)
    elif at_start.is_urdf and at_start.has_free_joint:
        result.lock[at_start.root_joint] = at_start.free_joints[at_start.root_joint]
        result.notes.append(f"a planar base replaces the file's own {at_start.root_joint}")
    elif at_start.root and not at_start.is_rigid:
        result.base = "fixed" if at_start.is_urdf else "planar"
    # The median: one wheel whose radius was read wrongly does not move the ground.
    result.ground = median(float(wheel.center[2] - wheel.radius) for wheel in wheels) if wheels else None
    return result


def planar_on_wheels(layout: WheelLayout, at_start: RobotAtStart, kind: str) -> BaseAssumptions:
    """Planar base with the joints held that would lift its wheels or that only slide.

    Args:
        layout: wheels by their function.
        at_start: the robot at its start values.
        kind: description of the base.
    """
    result = planar(at_start, kind, layout.wheels)
    # A planar base keeps its height, so a suspension would take wheels off their rows.
    result.lock_carriers(layout.wheels)
    drawn = [wheel.frame for wheel in layout.wheels if wheel.edge is not None]
    result.note("no joint turns these wheels about their axles, so that they are knife edges", drawn)
    # A ball slides where it does not roll, so it has no row, and its joint about one axis is only a drawing.
    result.hold([wheel.joint for wheel in layout.balls], "ball casters slide, so that they are locked and only drawn")
    result.passive |= {dolly for dolly in layout.dollies if not at_start.drives.says(dolly)}
    return result


def knife_edge_base(axles: list[Wheel], drawn: WheelLayout, at_start: RobotAtStart) -> BaseAssumptions:
    """Base whose wheels are only drawn: one knife edge for the axles of each body, and one for each steered wheel.

    A force drives the body that carries steered wheels, else the first one.

    Args:
        axles: axles on bodies.
        drawn: wheels on pivots.
        at_start: the robot.
    """
    count = f"{len(axles)} axle{'s' * (len(axles) > 1)}"
    result = planar(at_start, f"wheels are drawn on {count}, and no joint turns them", [])
    result.notes.append("wheels are not joints of this file, so that axles are taken as knife edges: no side slip")
    bodies = list(dict.fromkeys(each.joint for each in axles))
    for body in bodies:  # one row each: two parallel edges of one body would allow no turn
        there = [each for each in axles if each.joint == body]
        edge = there[0].edge
        if len(there) > 1:
            if body == at_start.root_joint:
                edge = _midway(at_start, there[0].axle, np.mean([each.center for each in there], axis=0))
            result.notes.append(f"{len(there)} axles of one body cannot all roll in a turn: MEASURE where it turns")
        result.constraints.append(({"no_side_slip": edge}, "knife edge"))
    model = at_start.robot.model
    carriers = [str(model.names[model.parents[group.pivot.index]]) for group in drawn.steered]
    # The truck of a semitrailer drives, although the tree of the file may begin at the trailer.
    own = [each for each in axles if each.joint in carriers]
    own = own or [each for each in axles if each.joint == at_start.root_joint] or axles[:1]
    steered = [group for group, carrier in zip(drawn.steered, carriers, strict=True) if carrier == own[0].joint]
    if steered and own[0].joint != at_start.root_joint:
        result.frame = at_start.body_frame(at_start.robot.joint_id(own[0].joint))
    along = at_start.along(own[0].heading, result.frame)
    result.act("force", along, "drives the base")
    result.drive_along(along)
    if steered:
        result.passive |= {pivot.joint for each in axles for pivot in each.pivots}  # hitches
        _steer(result, WheelLayout(fixed=own[:1], steered=steered), at_start)
    else:
        if len(bodies) == 1:  # joints between several bodies turn them
            result.act("torque", "z", "turns the base")
        result.outputs.append(({"frame_yaw": result.frame}, TURNED))
    support_by_casters(result, drawn)
    result.vertical += place_and_heading(result.frame)
    return result


def _midway(at_start: RobotAtStart, axle: np.ndarray, middle: np.ndarray) -> dict[str, Json]:
    """Knife edge at the midpoint of several axles; axle direction (3,) and midpoint (3,) in the world frame."""
    return at_start.knife_edge(axle, np.array([*middle[:2], at_start.placement.translation[2]]))


def _kind(layout: WheelLayout, *, is_tracked: bool) -> str:
    count = f"{len(layout.wheels)} wheel{'s' * (len(layout.wheels) > 1)}"
    if layout.steered:
        what = "steered like a car"
    elif len(layout.axles) > 1:
        what = "on tracks, skid-steered" if is_tracked else "skid-steered"
    else:
        what = "differential drive" if len(layout.fixed) > 1 else "one wheel"
    towing = f" with {len(layout.trailers)} trailer{'s' * (len(layout.trailers) > 1)}" if layout.trailers else ""
    return f"{count}, {what}{towing}"


def _roll(result: BaseAssumptions, layout: WheelLayout, at_start: RobotAtStart) -> None:
    """Add fixed wheels: one axle, or an equivalent one midway, has no side slip; the others skid in a turn."""
    axles, guide = layout.axles, layout.guide
    if len(axles) > 1:
        # Wheels skid about the middle of all contacts; an axle nearer to it than a tenth of a radius can stand for it.
        away = abs(float((guide[0].center - layout.middle) @ guide[0].heading))
        if not layout.steered and away >= 0.1 * guide[0].radius:
            guide = []
            edge = _midway(at_start, layout.fixed[0].axle, layout.middle)
            result.constrain("no_side_slip", "the equivalent axle, midway: MEASURE where it turns", **edge)
        result.notes.append(
            f"{len(axles)} axles cannot all roll in a turn: wheels skid sideways, but for "
            + (f"the axle of {', '.join(wheel.joint for wheel in guide)}" if guide else "an equivalent axle midway")
            + "; if these are Mecanum or omni wheels, give each its roller instead of lateral"
        )
    # One lateral row for each axle line that guides: wheels of a file are never on one line exactly, and two nearly
    # equal rows would lock the base. The other wheels of the line skid within the tolerance of the file.
    for axle in axles:
        guides = bool(guide) and axle[0] is guide[0]
        result.roll_line(axle, "" if guides else "skids sideways", lateral=guides)
    result.roll_line(layout.sliding, "slides on its rollers", lateral=False)


def tracks(layout: WheelLayout) -> list[list[Wheel]]:
    """Return the wheels of the left and the right track on the ground; empty if they are no tracks.

    Wheels of a track are called so, or turn below a sprocket, or are many: vehicles with more than four axles run on
    tracks. If the file names a motor of each wheel, there is no track.

    Args:
        layout: wheels by their function.
    """
    wheels = layout.fixed
    of_track, many = 3, 5  # smallest number of wheels of a track: called so, or of any name
    sides: dict[bool, list[Wheel]] = {}
    # Where each wheel has a motor that the file names, no band is needed to drive it.
    all_named = layout.driven.confidence >= SURE and len(layout.driven.joints) == len(layout.motorized)
    if layout.steered or len(wheels) < 2 * of_track or all_named:
        return []
    for wheel in wheels:
        sides.setdefault(_is_left(wheel, layout), []).append(wheel)
    track_words = "track|crawler|idler|sprocket|bogie|road|roadwheel|caterpillar|band|belt"
    called = all(has_word(track_words, *wheel.names) for wheel in wheels)
    # A sprocket on one side only is some other machine above the wheels.
    driven_above = {_is_left(wheel, layout) for wheel in layout.raised} == {True, False}
    least = of_track if called or driven_above else many
    return [*sides.values()] if len(sides) == 2 and min(map(len, sides.values())) >= least else []


def _is_left(wheel: Wheel, layout: WheelLayout) -> bool:
    """True on one side of the middle of the fixed wheels."""
    middle = np.mean([each.center for each in layout.fixed], axis=0)
    return bool((wheel.center - middle) @ layout.fixed[0].axle > 0)


def _crawl(result: BaseAssumptions, layout: WheelLayout, sides: list[list[Wheel]], at_start: RobotAtStart) -> None:
    """Add two tracks: a band couples the wheels of one side, one of them drives it, and its ends support the base."""
    edge = _midway(at_start, layout.fixed[0].axle, np.mean([wheel.center for wheel in layout.fixed], axis=0))
    result.constrain("no_side_slip", "the middle of the tracks: MEASURE where it turns", **edge)
    drivers = []
    for side in sides:
        every = [*side, *(each for each in layout.raised if _is_left(each, layout) == _is_left(side[0], layout))]
        # One motor for each side: that of the file, else the wheel called so, else the first one.
        named = [wheel for wheel in every if wheel.joint in layout.driven.joints and layout.driven.confidence > GUESSED]
        called = [wheel for wheel in every if has_word("sprocket|drive|driver|driving", *wheel.names)]
        driver = (named or called or side)[0]
        # A sprocket above the ground does not roll: the first wheel below does, and the band couples it.
        rolling = driver if any(wheel is driver for wheel in side) else side[0]
        drivers.append(driver.joint)
        on_track = f"on the track of {driver.joint}"
        result.roll(rolling, "drives its track" if driver is rolling else on_track, lateral=False)
        result.actuators.append((driver.joint, "drives its track"))
        for wheel in every:
            if wheel is not rolling:
                # The band has one speed at all rims: rates are as the inverse radii.
                ratio = round(float(np.sign(wheel.axle @ rolling.axle)) * rolling.radius / wheel.radius, 6)
                result.constrain("joint_coupling", on_track, joint=wheel.joint, driver=rolling.joint, ratio=ratio)
        # Rolling rows of all wheels of a track would repeat each other: a caster holds the other end at its height.
        last = max(side, key=lambda wheel: abs(float((wheel.center - rolling.center) @ rolling.heading)))
        radius = round(last.radius, 6)
        result.constrain("caster", "supports the other end of its track", frame=last.frame, radius=radius)
        result.passive |= {wheel.joint for wheel in every if wheel is not driver}
    other = Alternative("each wheel has a motor", {"driven": [wheel.joint for wheel in layout.fixed]})
    evidence = "by sprockets above them" if layout.raised else "by the names or the number of its wheels"
    question, answer = "Do tracks couple the wheels of each side?", f"yes, driven by {few(drivers)}"
    result.decide(question, answer, LIKELY, evidence, other)


def _steer(result: BaseAssumptions, layout: WheelLayout, at_start: RobotAtStart) -> None:
    """Add steered axles: the one that is farthest from the fixed axle leads, the others turn about the same point."""
    fixed = layout.guide
    steered = _steered_axles(layout, fixed[0])
    main = steered[0]
    driver = at_start.driver(main[0].pivot.joint)
    result.steer(driver)
    result.outputs.append(({"joint": driver}, BENT))
    # Steering is one freedom: the first pivot is an output, and each other one has a row or a lock.
    for number, axle in enumerate(steered):
        for one in axle:
            pivot, leads = one.pivot.joint, one is main[0]
            if leads:
                pass
            elif at_start.driver(pivot) == driver:
                result.notes.append(f"{main[0].pivot.joint} and {pivot} have the same angle, so that a wheel skids")
            elif at_start.are_in_loops(main[0].pivot.joint, pivot):
                said = f"the wheel of {pivot} skids where its angle is not that of Ackermann steering"
                result.notes.append(f"loops of the file couple {main[0].pivot.joint} and {pivot}: {said}")
            elif _reach(one, fixed[0]) > placed(one.wheels[0].radius):
                ackermann: dict[str, Json] = {"left": main[0].pivot.joint, "right": pivot, "axle": fixed[0].frame}
                if number:  # by default, the line between both pivots is taken as across: of one axle it is
                    ackermann["axis"] = at_start.own_axis(fixed[0].axle, fixed[0].frame)
                result.constrain("ackermann", "all steered wheels turn about one point", **ackermann)
            else:
                result.hold([pivot], "on the line of the fixed axle, where no steering is needed")
            # The Ackermann row of the others replaces their lateral rows, which would depend on it.
            for line in in_line(one.wheels):
                result.roll_line(line, f"steered by {pivot}", lateral=leads)
            result.passive |= {pivot} - {driver}
    others = [Alternative(axle[0].pivot.joint, {"passive": [main[0].pivot.joint]}) for axle in steered[1:2]]
    evidence = "the farthest from the fixed axle" if others else "the only steered axle"
    result.decide("Which axle steers?", driver, LIKELY, evidence, *others)


def _steered_axles(layout: WheelLayout, axle: Wheel) -> list[list[WheelGroup]]:
    """Steered axles of the base, of one or two groups each, those that are farthest from the fixed axle first."""
    found: list[list[WheelGroup]] = []
    for each in layout.steered:
        mates = [line for line in found if len(line) == 1 and _side_by_side(line[0], each, axle)]
        if mates:
            mates[0].append(each)
        else:
            found.append([each])
    return sorted(found, key=lambda line: -round(_reach(line[0], axle), 2))  # stable: in the order of the file


def _reach(group: WheelGroup, axle: Wheel) -> float:
    """Distance of a pivot from the line of the fixed axle [m]."""
    return abs(float((group.pivot.point - axle.center) @ axle.heading))


def _side_by_side(one: WheelGroup, other: WheelGroup, axle: Wheel) -> bool:
    across = other.pivot.point - one.pivot.point
    single = len(one.wheels) == len(other.wheels) == 1
    beside = abs(across @ axle.heading) < 0.1 * np.linalg.norm(across)  # 6 degrees: the same axle, toe-in and all
    return bool(single and beside) and are_parallel(one.wheels[0], axle)


def _tow(result: BaseAssumptions, carriage: WheelGroup, at_start: RobotAtStart) -> None:
    """Add the wheels of a trailer on its hitch; a pivot with an effort may be the joint of an articulated vehicle."""
    result.roll(carriage.wheels[0], "of a trailer")
    result.roll_line(carriage.wheels[1:], "of a trailer, without a lateral row of its own", lateral=False)
    joint, drives = carriage.pivot.joint, at_start.drives
    # A file may give every joint an effort, hitches too: a name settles it, else the draft asks.
    if drives.says(joint) is False or not drives.efforts.get(joint):
        sure, evidence = LIKELY, "nothing drives it"
    elif has_word(TOWED, joint, *carriage.wheels[0].names):
        sure, evidence = LIKELY, "by its name"
    else:
        sure, evidence = GUESSED, "its wheels are far behind it, but the file gives it an effort"
    steers = Alternative("no, it is driven and steers", {"driven": [joint]})
    result.decide(f"Is {joint} a free hitch?", "yes", sure, evidence, steers)
    result.passive |= set(carriage.joints)
