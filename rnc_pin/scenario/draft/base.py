"""How a robot stands in the world: what rolls, what drives it, and what has to be held still for that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from rnc_pin.plain import Json
from rnc_pin.scenario.draft.wheels import DrawnAxle, Wheel

Entry = str | Mapping[str, Json]


@dataclass
class Mobility:
    """What a draft says of the base, before the rest of the robot.

    Attributes:
        base: "fixed", "planar", "free", or None for what the file says.
        why: what it was guessed from.
        frame: of the base.
        constraints: entries and a remark on each.
        actuators: entries of the base, wheels and steering.
        outputs: candidates for reducing outputs, the most wanted first.
        vertical: where the base is.
        lock: joint and value, to be held still.
        notes: assumptions, a line each.
        passive: joints that nothing drives.
        ground: height of the ground [m], where it is known.
        weightless: whether gravity is taken away.
    """

    base: str | None
    why: str
    frame: str = ""
    constraints: list[tuple[Entry, str]] = field(default_factory=list)
    actuators: list[tuple[Entry, str]] = field(default_factory=list)
    outputs: list[tuple[Mapping[str, Json], float]] = field(default_factory=list)
    vertical: list[Mapping[str, Json]] = field(default_factory=list)
    lock: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    passive: set[str] = field(default_factory=set)
    ground: float | None = None
    weightless: bool = False


_DRIVEN, _TURNED, _BENT = 0.5, 0.4, 0.2  # how far the reference goes [m, rad, rad]


def on_wheels(wheels: list[Wheel], frame: str, placement: pin.SE3, q0: dict[str, float]) -> Mobility:
    """A base on wheels.

    Args:
        wheels: all of them.
        frame: of the base.
        placement: of that frame in the world.
        q0: values of joints at the start.
    """
    result = Mobility("planar", f"{len(wheels)} wheel{'s' * (len(wheels) > 1)}", frame)
    result.ground = float(np.median([wheel.center[2] - wheel.radius for wheel in wheels]))
    casters = [wheel for wheel in wheels if wheel.is_caster]
    fixed = [wheel for wheel in wheels if not wheel.is_caster and not wheel.is_steered]
    steered = [wheel for wheel in wheels if wheel.is_steered]
    for joint in sorted({joint for wheel in wheels for joint in wheel.carriers}):
        result.lock[joint] = q0.get(joint, 0.0)
    if result.lock:
        result.notes.append(f"locked, because they would lift wheels off the ground: {', '.join(result.lock)}")
    if any(wheel.omnidirectional for wheel in fixed) or (steered and not fixed) or not fixed:
        _omnidirectional(result, fixed + steered, casters)
        return result
    kept = _one_axle(result, fixed, placement.translation)
    for wheel in kept:
        result.constraints.append((_rolls(wheel), _measured(wheel)))
        result.actuators.append((wheel.joint, ""))
    along = own_axis(placement.rotation, np.cross(kept[0].axle, [0.0, 0.0, 1.0]))
    result.outputs.append(({"frame_speed": {"frame": frame, "axis": along}}, _DRIVEN))
    if steered:
        _steer(result, steered)
    else:
        if len(kept) == 1:
            result.actuators.append(({"torque": {"frame": frame, "axis": "z"}}, "turns the base: one wheel cannot"))
        result.outputs.append(({"frame_yaw": frame}, _TURNED))
    for wheel in casters:
        assert wheel.swivel is not None
        result.constraints.append((_rolls(wheel), f"a caster, not driven; {_measured(wheel)}"))
        result.passive |= {wheel.joint, wheel.swivel}
    result.vertical.append({"frame_position": {"frame": frame, "axes": "xy"}})
    if steered:
        result.vertical.append({"frame_yaw": frame})
    return result


def on_drawn_axles(axles: list[DrawnAxle], frame: str, placement: pin.SE3) -> Mobility:
    """A base whose wheels are part of bodies: each axle is a knife edge."""
    result = Mobility(
        "planar", f"wheels are drawn on {len(axles)} axle{'s' * (len(axles) > 1)}, and no joint turns them", frame
    )
    result.notes.append("wheels are not joints of this file, so that axles are taken as knife edges: no side slip")
    for each in axles:
        result.constraints.append(({"no_side_slip": {"frame": each.frame, "axis": each.axis}}, "knife edge"))
    own = [each for each in axles if each.joint == 0] or axles[:1]
    along = own_axis(placement.rotation, np.cross(own[0].axle, [0.0, 0.0, 1.0]))
    result.actuators.append(({"force": {"frame": frame, "axis": along}}, "drives the base"))
    if len(axles) == 1:
        result.actuators.append(({"torque": {"frame": frame, "axis": "z"}}, "turns the base"))
    result.outputs += [({"frame_speed": {"frame": frame, "axis": along}}, _DRIVEN), ({"frame_yaw": frame}, _TURNED)]
    result.vertical.append({"frame_position": {"frame": frame, "axes": "xy"}})
    return result


def own_axis(axes: np.ndarray, direction: np.ndarray) -> str:
    """Which of a frame's own axes lies nearest to a direction, "x" where that is a tie."""
    return "xyz"[int(np.argmax(np.round(np.abs(axes.T @ direction), 6)))]


def _omnidirectional(result: Mobility, driven: list[Wheel], casters: list[Wheel]) -> None:
    wheels = driven + casters
    joints = [wheel.joint for wheel in wheels] + [wheel.swivel for wheel in wheels if wheel.swivel]
    result.lock.update(dict.fromkeys(joints, 0.0))
    if any(wheel.omnidirectional for wheel in driven):
        what = "rollers of the omnidirectional wheels are not in the file"
    elif driven:
        what = "every wheel is steered by itself"
    else:
        what = "all wheels are casters"
    result.notes.append(f"{what}: the base is taken to move in any direction, its wheels are locked and only drawn")
    frame = result.frame
    for axis in "xy":
        result.actuators.append(({"force": {"frame": frame, "axis": axis}}, "what the wheels do together"))
    result.actuators.append(({"torque": {"frame": frame, "axis": "z"}}, ""))
    result.outputs += [
        ({"frame_position": {"frame": frame, "axes": "xy"}}, _DRIVEN),
        ({"frame_yaw": frame}, _TURNED),
    ]


def _one_axle(result: Mobility, fixed: list[Wheel], origin: np.ndarray) -> list[Wheel]:
    """Wheels on one line, of several the one nearest the base's origin: the others have to slip in a turn."""
    axles: list[list[Wheel]] = []
    for wheel in fixed:
        for axle in axles:
            offset = wheel.center - axle[0].center
            beside = offset - (offset @ wheel.axle) * wheel.axle
            if abs(abs(axle[0].axle @ wheel.axle) - 1) < 1e-3 and np.hypot(beside[0], beside[1]) < 0.1 * wheel.radius:
                axle.append(wheel)
                break
        else:
            axles.append([wheel])

    def rank(axle: list[Wheel]) -> tuple[int, float]:
        offset = np.mean([wheel.center for wheel in axle], axis=0) - origin
        return -len(axle), round(float(np.hypot(offset[0], offset[1])), 6)

    kept = min(axles, key=rank)
    others = [wheel.joint for axle in axles if axle is not kept for wheel in axle]
    if others:
        result.lock.update(dict.fromkeys(others, 0.0))
        names = ", ".join(others)
        result.notes.append(f"several axles without steering cannot all roll in a turn: {names} slip, and are locked")
    return kept


def _steer(result: Mobility, steered: list[Wheel]) -> None:
    """One steered wheel stands for all: two that turn by themselves would fight each other."""
    first, *others = steered
    assert first.swivel is not None
    result.constraints.append((_rolls(first), f"steered by {first.swivel}; {_measured(first)}"))
    result.actuators.append((first.swivel, "steering"))
    result.passive.add(first.joint)
    result.outputs.append(({"joint": first.swivel}, _BENT))
    joints = [joint for wheel in others for joint in (wheel.swivel, wheel.joint) if joint]
    if joints:
        result.lock.update(dict.fromkeys(joints, 0.0))
        result.notes.append(f"one steered wheel stands for all (a bicycle): locked are {', '.join(joints)}")


def _rolls(wheel: Wheel) -> dict[str, Json]:
    return {"rolling_wheel": {"frame": wheel.frame, "radius": round(wheel.radius, 6)}}


def _measured(wheel: Wheel) -> str:
    if wheel.measured == "height":
        return "MEASURE the radius: the file has no shape for this wheel, it is the axle's height"
    return f"radius from the {wheel.measured} geometry"
