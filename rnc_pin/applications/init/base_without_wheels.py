"""Robots without wheels: fixed to the ground, floating in space, flying."""

from __future__ import annotations

from collections.abc import Callable

import pinocchio as pin

from rnc_pin.applications.init.assumptions import DRIVEN, BaseAssumptions
from rnc_pin.applications.init.evidence import GUESSED, LIKELY, SURE, Alternative, DraftDecision, effort_limit, has_word
from rnc_pin.applications.init.omnidirectional_base import push
from rnc_pin.applications.init.robot_at_start import RobotAtStart
from rnc_pin.applications.init.wheeled_base import planar
from rnc_pin.errors import few

_LIMBS = 3  # a body with at least this number of limbs probably floats
_HEAVY, _VERY_HEAVY = 0.5, 0.8  # share of the mass in the first link above which the base may float, and floats
_AFLOAT = (
    "satellite|spacecraft|space_?robot|space|chaser|servicer|free_?fly(?:er|ing)|free_?float.*|floating|drone"
    "|.*copter|quadrotor|.*rotor|uav|mav|airship|blimp|rocket|underwater|rov|auv|submarine"
)
_AT_SEA = "boat|ship|vessel|usv|asv|catamaran|kayak|canoe|barge|hull|wam_?v|surface_vehicle"
_MOVES_OVER_GROUND = "planar_?move.*|.*planar_?move|omnidirectional|holonomic|mecanum.*|force_?based_?move"
_WHEEL = ".*wheel|wheel.*|tire|tyre|crawler|track|caster"
_INNER_WHEEL = "reaction_?wheel|fly_?wheel|momentum_?wheel|steering_?wheel"
_BOLTED = "table|pedestal|stand|mount|wall|ground|world|rail"


def moves_over_ground(at_start: RobotAtStart) -> str:
    """Return why a robot without rolling wheels moves over the ground in any direction, or an empty string."""
    if has_word(_MOVES_OVER_GROUND, at_start.names.plugins):
        return "a plugin of the file moves it over the ground in any direction"
    if has_word(_AT_SEA, *at_start.title):
        return "a name of something that swims on the surface"
    return ""


def is_called_afloat(at_start: RobotAtStart) -> bool:
    """True if the name of the robot means that it swims, dives or flies: bodies that turn are propellers then."""
    return has_word(f"{_AFLOAT}|{_AT_SEA}", *at_start.title)


def without_wheels(
    at_start: RobotAtStart, asked: str | None, mass_of_base: Callable[[], float], because: str = "asked for"
) -> BaseAssumptions:
    """Return the assumptions for a robot without wheels.

    Args:
        at_start: the robot.
        asked: "fixed", "planar" or "free" if the base is given, else None.
        mass_of_base: returns the mass of the first link [kg]; it loads the robot.
        because: reason for the given base.
    """
    over_ground = moves_over_ground(at_start)
    if asked == "planar" or (asked is None and over_ground):
        result = _on_ice(at_start, over_ground or "asked for; no wheels were found, so that it moves in any direction")
        if asked is None:
            _decide(result, "planar", over_ground, LIKELY, at_start)
        return _doubting_wheels(result, at_start)
    own = bool(at_start.root) and at_start.robot.model.joints[at_start.root].nv == 6 and not at_start.is_rigid
    why, sure = (because, SURE) if asked else ("a free joint in the file", SURE)
    if not asked and not own:
        why, sure = _floats(at_start, mass_of_base)
    if asked == "fixed" or not why:
        kind = why or "no wheels were found, and the first link is taken to be bolted down"
        result = BaseAssumptions("fixed", kind, at_start.frame)
        if at_start.own_planar_joints:
            joints = ", ".join(at_start.own_planar_joints)
            result.kind = f"joints of the file let it move over the ground: {joints}"
            result.notes.append(f"{joints} are driven, and the base moves in any direction")
        elif asked is None:
            _decide(result, "fixed", "no wheels were found, and nothing tells that it floats", LIKELY, at_start)
        return _doubting_wheels(result, at_start)
    if asked is None and not own and _called_wheels(at_start):
        called = "links are called wheels, so that it stands on the ground, and no joint turns them there"
        result = _on_ice(at_start, called)
        _decide(result, "planar", called, GUESSED, at_start)
        return _doubting_wheels(result, at_start)
    result = _afloat(at_start, None if own and asked is None else "free", why)
    if asked is None:
        _decide(result, "free", why, sure, at_start)
    return _doubting_wheels(result, at_start)


def _decide(result: BaseAssumptions, base: str, evidence: str, confidence: float, at_start: RobotAtStart) -> None:
    words = {"fixed": "it is bolted down", "planar": "it moves over the ground", "free": "it floats or flies"}
    bases = ("planar", "free") if at_start.is_rigid else ("fixed", "planar", "free")
    others = tuple(Alternative(words[each], ("--base", each)) for each in bases if each != base)
    decision = DraftDecision(
        "How does the base move, without wheels that roll?", words[base], confidence, evidence, others
    )
    result.decisions.append(decision)


def fixed_base_with_locked_joints(at_start: RobotAtStart) -> BaseAssumptions:
    """Robot on a fixed base with its joints without effort locked, because they would fall."""
    result = BaseAssumptions("fixed", "bolted down, with the joints held that nothing drives", at_start.frame)
    weak = [name for name in at_start.start if effort_limit(at_start.robot, name) == 0]
    why = "effort 0 in the file" if at_start.is_urdf else "no actuator in the file"
    result.hold(weak, at_start.start, f"{why}, and the rest falls or diverges without them: held")
    return _doubting_wheels(result, at_start)


def _called_wheels(at_start: RobotAtStart) -> list[str]:
    """Links that are called wheels, casters or tracks."""
    links = [frame.name for frame in at_start.robot.model.frames if frame.type == pin.FrameType.BODY]
    return [each for each in links if has_word(_WHEEL, each) and not has_word(_INNER_WHEEL, each)]


def _doubting_wheels(result: BaseAssumptions, at_start: RobotAtStart) -> BaseAssumptions:
    """Add a note on links with a wheel's name that do not roll."""
    named = _called_wheels(at_start)
    if named:
        result.notes.append(
            f"links that are called wheels or tracks do not roll on the ground as they are read: {few(named)}"
        )
    return result


def _floats(at_start: RobotAtStart, mass_of_base: Callable[[], float]) -> tuple[str, float]:
    """Reason why the robot probably floats, or an empty string, and the confidence of this decision."""
    is_named = has_word(_AFLOAT, *at_start.title)
    if at_start.is_rigid:
        return ("one rigid body, with a name", LIKELY) if is_named else ("one rigid body", GUESSED)
    mass = 0.0 if at_start.root else mass_of_base()
    if mass <= 0:
        return "", LIKELY
    limbs = len(at_start.robot.model.children[0])
    if limbs >= _LIMBS:
        return f"no wheels, and {limbs} limbs on one body", LIKELY
    if is_named:
        return "no wheels, and a name of something that floats", LIKELY
    share = mass / (mass + sum(inertia.mass for inertia in at_start.robot.model.inertias[1:]))
    if share > _HEAVY and not has_word(_BOLTED, *at_start.title, *at_start.names_on("universe")):
        why = f"no wheels, and {100 * share:.0f} % of the mass in the first link: nothing is bolted so"
        return why, LIKELY if share > _VERY_HEAVY else GUESSED
    return "", LIKELY


def _on_ice(at_start: RobotAtStart, why: str) -> BaseAssumptions:
    result = planar(at_start, why, [])
    result.travel = 0.0
    push(result)
    return result


def _afloat(at_start: RobotAtStart, base: str | None, why: str) -> BaseAssumptions:
    result = BaseAssumptions(base, why, at_start.frame, weightless=True)
    joint = at_start.robot.joint_names[0] if base is None else "root_joint"
    result.notes.append(
        "a floating base is free of contacts and of gravity, as in space; for a bolted one: --base fixed"
    )
    place = {"frame_position": {"frame": at_start.frame}}
    if not at_start.start:  # one rigid body: with conserved momentum it would not move
        for axis in "xyz":
            result.actuators.append(({"force": {"frame": at_start.frame, "axis": axis}}, "thrusters"))
        for axis in "xyz":
            result.actuators.append(({"torque": {"frame": at_start.frame, "axis": axis}}, "thrusters"))
        result.outputs += [(place, DRIVEN), ({"frame_orientation": at_start.frame}, 0.0)]
        result.notes.append("one rigid body: forces and torques stand for its thrusters or rotors")
        return result
    result.constraints.append(({"momentum": joint}, "nothing pushes the base, and it starts at rest"))
    result.vertical += [place, {"frame_yaw": at_start.frame}]
    result.passive.add(joint)
    return result
