"""Robots without wheels: fixed to the ground, floating in space, flying."""

from __future__ import annotations

import re
from collections.abc import Callable

import pinocchio as pin

from rnc_pin.errors import few
from rnc_pin.scenario.draft.joints import effort_limit
from rnc_pin.scenario.draft.mobility import DRIVEN, BaseAssumptions
from rnc_pin.scenario.draft.on_rollers import push
from rnc_pin.scenario.draft.site import RobotAtStart

_LIMBS = 3  # a body with at least this number of limbs probably floats
_HEAVY = 0.5  # share of the mass in the first link above which the base probably floats
_AFLOAT = re.compile(
    "satellite|spacecraft|space_?robot|chaser|servicer|free_?fl|floating|drone|copter|quadrotor|uav|underwater"
)
_WHEEL = re.compile("(?<!reaction_)wheel|tire|tyre|crawler|track(?!ing)")
_BOLTED = re.compile("table|pedestal|stand|mount|wall|ground|world|rail")


def without_wheels(
    site: RobotAtStart, asked: str | None, mass_of_base: Callable[[], float], because: str = "asked for"
) -> BaseAssumptions:
    """Return the assumptions for a robot without wheels.

    Args:
        site: the robot.
        asked: "fixed", "planar" or "free" if the base is given, else None.
        mass_of_base: returns the mass of the first link [kg]; it loads the robot.
        because: reason for the given base.
    """
    if asked == "planar":
        return _doubting_wheels(_on_ice(site), site)
    own = bool(site.root) and site.robot.model.joints[site.root].nv == 6 and not site.is_rigid
    why = because if asked else "a free joint in the file" if own else _floats(site, mass_of_base)
    if asked == "fixed" or not why:
        kind = why or "no wheels were found, and the first link is taken to be bolted down"
        result = BaseAssumptions("fixed", kind, site.frame)
        if site.own_planar_joints:
            joints = ", ".join(site.own_planar_joints)
            result.kind = f"joints of the file let it move over the ground: {joints}"
            result.notes.append(f"{joints} are driven, and the base moves in any direction")
        elif asked is None:
            result.notes.append("if it floats, as in space: --base free; if it drives: --base planar")
        return _doubting_wheels(result, site)
    return _doubting_wheels(_afloat(site, None if own and asked is None else "free", why), site)


def fixed_base_with_locked_joints(site: RobotAtStart) -> BaseAssumptions:
    """Robot on a fixed base with its joints without effort locked, because they would fall."""
    result = BaseAssumptions("fixed", "bolted down, with the joints held that nothing drives", site.frame)
    weak = [name for name in site.start if effort_limit(site.robot, name) == 0]
    why = "effort 0 in the file" if site.is_urdf else "no actuator in the file"
    result.hold(weak, site.start, f"{why}, and the rest falls or diverges without them: held")
    return _doubting_wheels(result, site)


def _doubting_wheels(result: BaseAssumptions, site: RobotAtStart) -> BaseAssumptions:
    """Add a note on links with a wheel's name that do not roll."""
    frames = site.robot.model.frames
    named = [frame.name for frame in frames if frame.type == pin.FrameType.BODY and _WHEEL.search(frame.name.lower())]
    if named:
        result.notes.append(
            f"links that are called wheels or tracks do not roll on the ground as they are read: {few(named)}"
        )
    return result


def _floats(site: RobotAtStart, mass_of_base: Callable[[], float]) -> str:
    """Reason why the robot probably floats, or an empty string."""
    if site.is_rigid:
        return "one rigid body"
    mass = 0.0 if site.root else mass_of_base()
    if mass <= 0:
        return ""
    limbs = len(site.robot.model.children[0])
    if limbs >= _LIMBS:
        return f"no wheels, and {limbs} limbs on one body"
    if _AFLOAT.search(site.words):
        return "no wheels, and a name of something that floats"
    total = mass + sum(inertia.mass for inertia in site.robot.model.inertias[1:])
    if mass > _HEAVY * total and not _BOLTED.search(site.words):
        return f"no wheels, and {100 * mass / total:.0f} % of the mass in the first link: nothing is bolted so"
    return ""


def _on_ice(site: RobotAtStart) -> BaseAssumptions:
    result = BaseAssumptions("planar", "asked for; no wheels were found, so that it moves in any direction", site.frame)
    push(result)
    return result


def _afloat(site: RobotAtStart, base: str | None, why: str) -> BaseAssumptions:
    result = BaseAssumptions(base, why, site.frame, weightless=True)
    joint = site.robot.joint_names[0] if base is None else "root_joint"
    result.notes.append(
        "a floating base is free of contacts and of gravity, as in space; for a bolted one: --base fixed"
    )
    place = {"frame_position": {"frame": site.frame}}
    if not site.start:  # one rigid body: with conserved momentum it would not move
        for axis in "xyz":
            result.actuators.append(({"force": {"frame": site.frame, "axis": axis}}, "thrusters"))
        for axis in "xyz":
            result.actuators.append(({"torque": {"frame": site.frame, "axis": axis}}, "thrusters"))
        result.outputs += [(place, DRIVEN), ({"frame_orientation": site.frame}, 0.0)]
        result.notes.append("one rigid body: forces and torques stand for its thrusters or rotors")
        return result
    result.constraints.append(({"momentum": joint}, "nothing pushes the base, and it starts at rest"))
    result.vertical += [place, {"frame_yaw": site.frame}]
    result.passive.add(joint)
    return result
