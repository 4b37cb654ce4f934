"""Robots that nothing rolls: bolted down, floating in space, flying."""

from __future__ import annotations

import re

from rnc_pin.scenario.draft.mobility import DRIVEN, TURNED, Mobility
from rnc_pin.scenario.draft.on_rollers import push
from rnc_pin.scenario.draft.site import Site

_LIMBS = 3  # a body with so many is more likely to float than to be bolted down
_HEAVY = 0.5  # share of the mass in the first link above which arms move it rather than it them
_AFLOAT = re.compile(
    "satellite|spacecraft|space_?robot|chaser|servicer|free_?fl|floating|drone|copter|quadrotor|uav|underwater"
)
_BOLTED = re.compile("table|pedestal|stand|mount|wall|ground|world|rail")


def without_wheels(site: Site, asked: str | None, mass_of_base: float) -> Mobility:
    """A robot without wheels.

    Args:
        site: the robot.
        asked: "fixed", "planar" or "free", or None.
        mass_of_base: of its first link [kg].
    """
    if asked == "planar":
        return _on_ice(site)
    own = site.root == 1 and site.robot.model.joints[1].nv == 6
    why = "asked for" if asked else "a free joint in the file" if own else _floats(site, mass_of_base)
    if asked == "fixed" or not why:
        kind = why or "no wheels were found, and the first link is taken to be bolted down"
        result = Mobility("fixed", kind, site.frame)
        if asked is None:
            result.notes.append("if it floats, as in space: --base free")
        return result
    return _afloat(site, None if own and asked is None else "free", why)


def _floats(site: Site, mass_of_base: float) -> str:
    """Why it is taken to float, or nothing."""
    if site.root or mass_of_base <= 0:
        return ""
    limbs = len(site.robot.model.children[0])
    if limbs >= _LIMBS:
        return f"no wheels, and {limbs} limbs on one body"
    if _AFLOAT.search(site.words):
        return "no wheels, and a name of something that floats"
    total = mass_of_base + sum(inertia.mass for inertia in site.robot.model.inertias[1:])
    if mass_of_base > _HEAVY * total and not _BOLTED.search(site.words):
        return f"no wheels, and {100 * mass_of_base / total:.0f} % of the mass in the first link: nothing is bolted so"
    return ""


def _on_ice(site: Site) -> Mobility:
    result = Mobility("planar", "asked for; no wheels were found, so that it moves in any direction", site.frame)
    push(result, site.frame)
    result.outputs += [
        ({"frame_position": {"frame": site.frame, "axes": "xy"}}, DRIVEN),
        ({"frame_yaw": site.frame}, TURNED),
    ]
    return result


def _afloat(site: Site, base: str | None, why: str) -> Mobility:
    result = Mobility(base, why, site.frame, weightless=True)
    joint = site.robot.joint_names[0] if base is None else "root_joint"
    result.notes.append(
        "a floating base is free of contacts and of gravity, as in space; for a bolted one: --base fixed"
    )
    place = {"frame_position": {"frame": site.frame}}
    if not site.start:  # one rigid body: with its momentum kept nothing would move
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
