"""Bases that wheels do not hold upright, which balance; and bases without wheels: bolted down, floating, flying."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection
from statistics import median
from typing import NoReturn

import numpy as np
import pinocchio as pin

from rnc_pin.applications.init.assumptions import DRIVEN, DURATION, BaseAssumptions, measured, place_and_heading, rolls
from rnc_pin.applications.init.evidence import GUESSED, LIKELY, SURE, Alternative, DraftDecision, has_word, joint_limits
from rnc_pin.applications.init.omnidirectional_base import push
from rnc_pin.applications.init.robot_at_start import RobotAtStart
from rnc_pin.applications.init.wheel_detection import NEAR, Wheel
from rnc_pin.applications.init.wheel_layout import WheelLayout
from rnc_pin.applications.init.wheeled_base import planar
from rnc_pin.errors import ConfigurationError, few
from rnc_pin.io import Json
from rnc_pin.printing import significant
from rnc_pin.robots import NO_LIMIT, flat_links


def balance_decision(layout: WheelLayout, at_start: RobotAtStart, asked: bool | None) -> DraftDecision | None:
    """Return whether a base that stands on two wheels of one axle balances: by an option, its mass, supports and names.

    Args:
        layout: wheels by their function.
        at_start: the robot at its start values.
        asked: answer of the user, or None.

    Returns:
        The decision, whose answer is "yes" or "no"; None if the question does not arise.
    """
    lonely = not (layout.casters or layout.balls or layout.steered or layout.trailers)
    if not lonely or len(layout.fixed) != 2 or len(layout.axles) != 1:
        return None
    one, other = layout.fixed
    if np.linalg.norm(one.center - other.center) < one.radius:  # twin wheels in the middle, which is one wheel
        return None
    question = "Does the base balance on its two wheels?"
    yes = Alternative("it does", {"balance": True})
    no = Alternative("a caster is missing in the file", {"balance": False})
    if asked is not None:
        return DraftDecision(question, "yes" if asked else "no", SURE, "by an option")
    above, beside = _center_of_mass(layout, at_start)
    balances = "balanc.*|segway|pendul.*|upkie|hoverboard|two_?wheel(?:ed)?|self_?balanc.*"
    named = has_word(balances, *at_start.title)  # a load balancer on a cart is none
    on_legs = bool(one.carriers and other.carriers)
    tall = 1.5  # smallest height of the center of mass above the axle of a balancing robot, in radii
    # Low or beside the axle, gravity tips the body onto something that the file lacks, not onto its wheels.
    if beside >= max(0.5 * above, 0.2 * one.radius) or above <= (0.0 if named or on_legs else tall * one.radius):
        where = "its center of mass is low, or beside the axle" + ", but its wheels are on legs" * on_legs
        return DraftDecision(question, "no", GUESSED if on_legs else LIKELY, where, (yes,))
    # A robot that is called a balancer may have a stand for its rest.
    if not named and (support := _support(layout, at_start)):
        return DraftDecision(question, "no", LIKELY, f"{support} supports it", (yes,))
    efforts = [at_start.drives.efforts[wheel.joint] for wheel in layout.fixed]
    stated = sum(each for each in efforts if 0 < each < NO_LIMIT)
    needed = _holding_torque(layout, at_start)
    # Wheels that cannot hold the body at a small tilt cannot balance it.
    if stated and needed > stated:
        need = f"it takes {needed:.2g} N m at a tilt of 0.1 rad, and its wheels have {stated:.2g} N m"
        return DraftDecision(question, "no", GUESSED, f"{need}: a caster may be missing in the file", (yes,))
    if named:
        return DraftDecision(question, "yes", LIKELY, "by a name, and its center of mass is above the axle", (no,))
    evidence = "nothing else reaches the ground, and its center of mass is high"
    return DraftDecision(question, "yes", LIKELY if stated or on_legs else GUESSED, evidence, (no,))


def balancing_base(layout: WheelLayout, at_start: RobotAtStart) -> BaseAssumptions:
    """Free base on one axle: two wheel torques control both wheel angles and the pitch.

    Args:
        layout: wheels by their function.
        at_start: the robot at its start values.
    """
    wheels, kind = layout.fixed, "2 wheels under a body that balances"
    result = BaseAssumptions("free", kind, at_start.frame, at_start.start, travel=DRIVEN)
    _lie_down(result, wheels)
    ahead = at_start.along(wheels[0].heading)
    tilt = f"{at_start.frame}_tilt_{ahead}"
    leaning: dict[str, Json] = {"frame_tilt": {"frame": at_start.frame, "axis": ahead}}
    forward = at_start.placement.rotation[:, "xyz".index(ahead)]
    # Costs are stated for wheels of 0.1 m: lengths grow with the radius, and times with its square root. A displacement
    # of 0.05 m and a speed of 0.5 m/s then cost as much as a tilt of 0.1 rad.
    size, far, fast = wheels[0].radius / 0.1, 0.05, 0.5
    cost: dict[str, Json] = {tilt: 100, f"{tilt}_dot": significant(size)}
    result.roll_line(wheels)
    for wheel in wheels:
        result.actuators.append((wheel.joint, ""))
        way = float(np.sign(wheel.heading @ forward)) * DRIVEN / wheel.radius
        result.outputs.append(({"joint": wheel.joint}, round(way, 2)))
        cost[wheel.joint] = significant((wheel.radius / (size * far)) ** 2)
        cost[f"{wheel.joint}_dot"] = significant((wheel.radius / fast) ** 2 / size)
    # Two torques move two wheels; the tilt is a coordinate of the state, and has no reference of its own.
    result.outputs.append((leaning, 0.0))
    result.untracked.add(tilt)
    result.vertical += place_and_heading(at_start.frame)
    # Wheel angles, not path length and heading: the motion of an unbalanced wheel depends on its angle.
    result.feedback = {
        "type": "state_feedback",
        "coordinates": [*(wheel.joint for wheel in wheels), leaning],
        "state_cost": cost,
        "input_cost": significant(_holding_torque(layout, at_start) ** -2),
    }
    # The run starts with a small tilt: an upright start at rest would show nothing of the balance.
    result.lean = wheels[0].axle
    result.notes.append(
        "only two wheels touch the ground: feedback balances the base about the equilibrium near the start; "
        "if a caster is missing in the file, use --no-balance"
    )
    return result


def refuse_one_track(layout: WheelLayout, crossed: Collection[str]) -> NoReturn:
    """Refuse wheels in line without steering, or wheels that seem so because the axes of their joints are wrong.

    Args:
        layout: wheels by their function.
        crossed: joints with an axis across their drawn cylinder.

    Raises:
        ConfigurationError: always.
    """
    if crossed:
        raise ConfigurationError(
            f"{few([*crossed])}: the joint's axis is across that of its drawn cylinder; correct <axis> in the file"
        )
    raise ConfigurationError(
        f"the wheels {few([wheel.joint for wheel in layout.wheels])} stand in line: such a robot falls sideways and "
        "cannot turn by its wheels; add a steered wheel to the file, or hold it upright with --base planar"
    )


def bicycle_base(layout: WheelLayout, at_start: RobotAtStart) -> BaseAssumptions:
    """Free base that rolls forward, tilts, and is balanced by its steering.

    Args:
        layout: wheels by their function.
        at_start: the robot at its start values.
    """
    rear, fork = layout.fixed[0], layout.steered[0]
    front = fork.wheels[0]
    across, along, steering = at_start.along(rear.axle), at_start.along(rear.heading), fork.pivot.joint
    result = BaseAssumptions("free", "2 wheels in line: a bicycle, which leans", at_start.frame, at_start.start)
    upright = Alternative("it is held upright", {"base": "planar"})
    evidence = "its wheels stand in line, and one of them is steered"
    result.decide("Does it lean, as a bicycle does?", "yes", LIKELY, evidence, upright)
    _lie_down(result, [rear, front])
    result.constraints.append((rolls(rear), measured(rear)))
    result.constraints.append((rolls(front), f"steered by {steering}; {measured(front)}"))
    result.actuators.append((rear.joint, "drives"))
    result.steer(steering)
    result.passive.add(front.joint)
    # Names as the outputs give them to their rows: costs and initial rates refer to these.
    speed, tilt = f"{at_start.frame}_speed_{along}", f"{at_start.frame}_tilt_{across}"
    leaning: dict[str, Json] = {"frame_tilt": {"frame": at_start.frame, "axis": across}}
    result.drive_along(along, 0.0)
    result.outputs += [(leaning, 0.0), ({"joint": steering}, 0.0)]
    result.vertical += place_and_heading(at_start.frame)
    size = rear.radius / 0.3  # the costs are stated for wheels of 0.3 m
    cost: dict[str, Json] = {tilt: 100, steering: 10, speed: significant(4 / size)}
    cost |= {f"{tilt}_dot": significant(size), f"{steering}_dot": significant(size)}
    wheelbase = abs(float((front.center - rear.center) @ rear.heading))
    forward = at_start.placement.rotation[:, "xyz".index(along)]
    sense = 1.0 if forward @ (front.center - rear.center) > 0 else -1.0  # the steered wheel leads
    froude = 1.5  # speed of a bicycle / sqrt(gravity * wheelbase): enough for balance by steering
    rolling = round(sense * froude * float(np.sqrt(9.81 * wheelbase)), 2)
    pushed = 0.1  # initial tilt rate of a bicycle [rad/s]; an initial tilt could also be that of a steady circle
    result.v2 = {speed: rolling, tilt: pushed}
    result.travel = abs(rolling) * DURATION
    result.feedback = {
        "type": "state_feedback",
        "coordinates": [leaning, steering],
        "rates": [speed, tilt, steering],
        "state_cost": cost,
        "input_cost": significant(_holding_torque(layout, at_start) ** -2),
        "v2": {speed: rolling},
        # Wheels of a file are symmetric about their axles only to a few digits; their angles are cyclic all the same.
        "cyclic": [rear.joint, front.joint],
    }
    result.notes.append(
        "a bicycle falls when it stands: it starts rolling, fast enough to be kept upright by steering alone"
    )
    return result


def _lie_down(result: BaseAssumptions, wheels: list[Wheel]) -> None:
    """Put the base at the height where the wheels touch the ground, and lock all other joints."""
    # Radii and heights of a file differ by rounding: no single wheel decides.
    height = median(float(wheel.radius - wheel.center[2]) for wheel in wheels)
    result.initial["root_joint"] = [0.0, 0.0, round(height, 6), 0.0, 0.0, 0.0, 1.0]
    result.ground = 0.0
    # What balances is one body: an arm that moves would be a disturbance, and its torques other inputs.
    moving = {joint for wheel in wheels for joint in (wheel.joint, *(pivot.joint for pivot in wheel.pivots))}
    result.lock_carriers(wheels)
    others = [name for name in result.start if name not in moving and name not in result.lock]
    result.hold(others, "locked, while the base is balanced")


def _center_of_mass(layout: WheelLayout, at_start: RobotAtStart) -> tuple[float, float]:
    """Center of mass of all bodies except the wheels: height above the axle, horizontal offset from it [m]."""
    own = {at_start.robot.joint_id(wheel.joint) for wheel in layout.fixed}
    model = at_start.robot.model
    bodies = [index for index, inertia in enumerate(model.inertias) if index not in own and inertia.mass > 0]
    if not bodies:  # nothing to balance: far beside every axle
        return 0.0, np.inf
    places = [at_start.data.oMi[index].act(model.inertias[index].lever) for index in bodies]
    middle = np.average(places, axis=0, weights=[model.inertias[index].mass for index in bodies])
    offset = middle - layout.fixed[0].center
    return float(offset[2]), abs(float(offset @ layout.fixed[0].heading))


def _support(layout: WheelLayout, at_start: RobotAtStart) -> str:
    """Name of a link that reaches the ground beside the wheels, or that is called a support; empty if there is none.

    A link without a shape counts by its name if its origin is not higher than the axle.
    """
    axle, radius = layout.fixed[0].center[2], layout.fixed[0].radius
    model, joint_id = at_start.robot.model, at_start.robot.joint_id
    supports = [int(each) for wheel in layout.fixed for each in model.supports[joint_id(wheel.joint)]]
    own = {each for each in supports if each > at_start.root}  # wheels and legs
    # A low skid or a ball without a joint, whatever its name.
    beside = [each for each in at_start.all_shapes if each.joint not in own]
    low = [each.name for each in beside if each.bottom - (axle - radius) < NEAR * radius]
    if low:
        return low[0]
    support = "caster.*|.*caster|castor.*|.*castor|support|skid|stabili[sz]er|ball|roller|slider|foot|feet|leg_rest"
    for index, frame in enumerate(model.frames):
        low = at_start.data.oMf[index].translation[2] <= axle
        if low and frame.parentJoint not in own and frame.name != "universe" and has_word(support, frame.name):
            return str(frame.name)
    return ""


def _holding_torque(layout: WheelLayout, at_start: RobotAtStart) -> float:
    """Torque that holds the body at a tilt of 0.1 rad [N m]."""
    above, _ = _center_of_mass(layout, at_start)
    weight = 9.81 * sum(inertia.mass for inertia in at_start.robot.model.inertias)
    # At least one radius: a center of mass at the axle would make the cost of inputs infinite.
    return float(0.1 * weight * max(above, layout.fixed[0].radius))


_LIMBS = 3  # a body with at least this number of limbs probably floats
_UPRIGHT = 0.8  # smallest vertical part of the axes of rotors, and ratio of the lengths of their arms
_AFLOAT = (
    "satellite|spacecraft|space_?robot|space|chaser|servicer|free_?fly(?:er|ing)|free_?float.*|floating|drone"
    "|.*copter|quadrotor|.*rotor|uav|mav|airship|blimp|rocket|underwater|rov|auv|submarine"
)
_AT_SEA = "boat|ship|vessel|usv|asv|catamaran|kayak|canoe|barge|hull|wam_?v|surface_vehicle"


def moves_over_ground(at_start: RobotAtStart) -> str:
    """Return why a robot without rolling wheels moves over the ground in any direction, or an empty string.

    Args:
        at_start: the robot at its start values.
    """
    moves = "planar_?move.*|.*planar_?move|omnidirectional|holonomic|mecanum.*|force_?based_?move"
    if has_word(moves, at_start.names.plugins):
        return "a plugin of the file moves it over the ground in any direction"
    if has_word(_AT_SEA, *at_start.title):
        return "a name of something that swims on the surface"
    return ""


def is_called_afloat(at_start: RobotAtStart) -> bool:
    """True if the name of the robot means that it swims, dives or flies: bodies that turn are propellers then.

    Args:
        at_start: the robot at its start values.
    """
    return has_word(f"{_AFLOAT}|{_AT_SEA}", *at_start.title)


def without_wheels(
    at_start: RobotAtStart, mass_of_base: Callable[[], float], asked: str | None, because: str = "asked for"
) -> BaseAssumptions:
    """Return the assumptions for a robot without wheels.

    Args:
        at_start: the robot.
        mass_of_base: returns the mass of the first link [kg]; it loads the robot.
        asked: "fixed", "planar" or "free" if the base is given, else None.
        because: reason for the given base.
    """
    given = None if asked is None else (asked, asked == "free", because, SURE)
    base, floats, why, sure = given or _likely_motion(at_start, mass_of_base)
    # Three ways to have no wheels: afloat, over the ground, or bolted down.
    if floats:
        rotors = _rotors(at_start)
        if rotors and base == "free":
            # A robot that floats in space may have a ring of wheels, too: never more than a guess.
            why, sure = f"{why}: {len(rotors)} rotors with upright axes around it carry it", min(sure, GUESSED)
        result = _afloat(at_start, None if at_start.has_free_joint and asked is None else base, why, rotors)
    elif base == "planar":
        said = "asked for; no wheels were found, so that it moves in any direction"
        result = planar(at_start, why if asked is None else moves_over_ground(at_start) or said, [])
        result.travel = 0.0  # without wheels, the trial does not ask how far they roll
        push(result)
    else:
        kind = because if asked else "no wheels were found, and the first link is taken to be bolted down"
        result = BaseAssumptions("fixed", kind, at_start.frame, at_start.start)
        if at_start.own_planar_joints:
            joints = ", ".join(at_start.own_planar_joints)
            result.kind = f"joints of the file let it move over the ground: {joints}"
            result.notes.append(f"{joints} are driven, and the base moves in any direction")
    # The file's own planar joints answer the question; what a user asked for is none.
    if asked is None and not (base == "fixed" and at_start.own_planar_joints):
        words = {"fixed": "it is bolted down", "planar": "it moves over the ground", "free": "it floats or flies"}
        without = {base, "fixed"} if at_start.is_rigid else {base}
        others = [Alternative(words[each], {"base": each}) for each in words if each not in without]
        result.decide("How does the base move, without wheels that roll?", words[base], sure, why, *others)
    return _doubting_wheels(result, at_start)


def _likely_motion(at_start: RobotAtStart, mass_of_base: Callable[[], float]) -> tuple[str, bool, str, float]:
    """Likely base of a robot without wheels, whether it floats, the evidence, and the confidence."""
    if over_ground := moves_over_ground(at_start):
        return "planar", False, over_ground, LIKELY
    if at_start.has_free_joint:
        return "free", True, "a free joint in the file", SURE
    why, sure = _floats(at_start, mass_of_base)
    if not why:
        return "fixed", False, "no wheels were found, and nothing tells that it floats", LIKELY
    # Against floating: names of wheels, and bodies that resist turning about one axis only.
    if _called_wheels(at_start):
        called = "links are called wheels, so that it stands on the ground, and no joint turns them there"
        return "planar", False, called, GUESSED
    if flat := flat_links(at_start.robot.model):
        about = f"{few(flat)} have a moment of inertia about one axis only, as of a robot in a plane"
        return "planar", True, f"{why}, and {about}", LIKELY
    return "free", True, why, sure


def fixed_base_with_locked_joints(at_start: RobotAtStart) -> BaseAssumptions:
    """Robot on a fixed base with its joints without effort locked, because they would fall.

    Args:
        at_start: the robot at its start values.
    """
    kind = "bolted down, with the joints held that nothing drives"
    result = BaseAssumptions("fixed", kind, at_start.frame, at_start.start)
    weak = [name for name in at_start.start if at_start.drives.efforts[name] == 0]
    why = "effort 0 in the file" if at_start.is_urdf else "no actuator in the file"
    result.hold(weak, f"{why}, and the rest falls or diverges without them: held")
    return _doubting_wheels(result, at_start)


def _called_wheels(at_start: RobotAtStart) -> list[str]:
    """Links that are called wheels, casters or tracks."""
    links = [frame.name for frame in at_start.robot.model.frames if frame.type == pin.FrameType.BODY]
    wheel = ".*wheel|wheel.*|tire|tyre|crawler|track|caster"
    inner_wheel = "reaction_?wheel|fly_?wheel|momentum_?wheel|steering_?wheel"
    return [each for each in links if has_word(wheel, each) and not has_word(inner_wheel, each)]


def _doubting_wheels(result: BaseAssumptions, at_start: RobotAtStart) -> BaseAssumptions:
    """Add a note on links with a wheel's name that do not roll."""
    if named := _called_wheels(at_start):
        result.note("links that are called wheels or tracks do not roll on the ground as they are read", [few(named)])
    return result


def _floats(at_start: RobotAtStart, mass_of_base: Callable[[], float]) -> tuple[str, float]:
    """Reason why the robot probably floats, or an empty string, and the confidence of this decision."""
    is_named = has_word(_AFLOAT, *at_start.title)
    if at_start.is_rigid:
        return ("one rigid body, with a name", LIKELY) if is_named else ("one rigid body", GUESSED)
    mass = 0.0 if at_start.root else mass_of_base()
    if mass <= 0:  # a ground or world link without mass: something stands on it
        return "", LIKELY
    limbs = len(at_start.robot.model.children[0])
    if limbs >= _LIMBS:
        return f"no wheels, and {limbs} limbs on one body", LIKELY
    if is_named:
        return "no wheels, and a name of something that floats", LIKELY
    # The base of an arm weighs less than half of it; a satellite more than its arm.
    share = mass / (mass + sum(inertia.mass for inertia in at_start.robot.model.inertias[1:]))
    heavy, very_heavy = 0.5, 0.8  # share of the mass in the first link above which the base may float, and floats
    bolted = "table|pedestal|stand|mount|wall|ground|world|rail"
    if share > heavy and not has_word(bolted, *at_start.title, *at_start.names_on("universe")):
        why = f"no wheels, and {100 * share:.0f} % of the mass in the first link: nothing is bolted so"
        return why, LIKELY if share > very_heavy else GUESSED
    return "", LIKELY


def _rotors(at_start: RobotAtStart) -> list[str]:
    """Joints that turn on and on about upright axes in a circle around the base: those of a multicopter."""
    model = at_start.robot.model
    leaves = [k for k in at_start.single_joints if model.parents[k] == at_start.root and not len(model.children[k])]
    upright = [k for k in leaves if abs(at_start.turning_axis(k)[2]) > _UPRIGHT]
    on_and_on = 4 * np.pi  # smallest range of a rotor; files write large limits for none [rad]
    found = [k for k in upright if np.ptp(joint_limits(at_start.robot, model.names[k])) > on_and_on]
    # A ring around the base: equal arms about the middle of all rotors.
    places = np.array([at_start.data.oMi[k].translation[:2] for k in found]).reshape(-1, 2)
    arms = np.linalg.norm(places - places.sum(axis=0) / max(len(found), 1), axis=1)
    in_circle = len(found) >= _LIMBS and arms.min() > _UPRIGHT * arms.max()
    return [str(model.names[k]) for k in found] if in_circle else []


def _afloat(at_start: RobotAtStart, base: str | None, why: str, rotors: Collection[str] = ()) -> BaseAssumptions:
    result = BaseAssumptions(base, why, at_start.frame, at_start.start, weightless=not rotors)
    joint = at_start.robot.joint_names[0] if base is None else "root_joint"
    said = "forces and torques on the body stand for those of its rotors, which are locked"
    result.hold(rotors, f"{said}; none push it sideways, CHECK")
    if not rotors:
        said = "a floating base is free of contacts and of gravity, as in space; for a bolted one: --base fixed"
        result.notes.append(said)
    on_ground: dict[str, Json] = {"axes": "xy"} if base == "planar" else {}
    place: dict[str, Json] = {"frame_position": {"frame": at_start.frame, **on_ground}}
    if rotors or not at_start.start:  # one rigid body: with conserved momentum it would not move
        for kind, axis in itertools.product(("force", "torque"), "xyz"):
            result.act(kind, axis, "thrusters")
        result.outputs += [(place, DRIVEN), ({"frame_orientation": at_start.frame}, 0.0)]
        if not rotors:
            result.notes.append("one rigid body: forces and torques stand for its thrusters or rotors")
        return result
    result.constraints.append(({"momentum": joint}, "nothing pushes the base, and it starts at rest"))
    result.vertical += [place, {"frame_yaw": at_start.frame}]
    result.passive.add(joint)
    return result
