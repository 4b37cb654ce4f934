"""Statically unstable bases: two wheels under a body, bicycles."""

from __future__ import annotations

import re

import numpy as np

from rnc_pin.io.json import Json
from rnc_pin.printing import significant
from rnc_pin.scenario.draft.chassis import WheelGroup, WheelLayout, are_parallel
from rnc_pin.scenario.draft.mobility import DRIVEN, BaseAssumptions, measured, place_and_heading, rolls
from rnc_pin.scenario.draft.site import RobotAtStart
from rnc_pin.scenario.draft.wheels import Wheel

_SUPPORT = re.compile("caster|castor|support|skid|stabil|ball|roller|slider|foot|leg_rest")
_BALANCES = re.compile("balanc|segway|pendul|upkie|hoverboard|two_?wheel")
_TALL = 1.5  # smallest height of the center of mass above the axle of a balancing robot, in radii
_NEAR = 0.3  # largest height of a support above the ground, in radii
_FAR, _FAST = 0.05, 0.5  # displacement and speed with the same cost as a tilt of 0.1 rad [m, m/s]
_PUSHED = 0.1  # initial tilt rate of a bicycle [rad/s]; an initial tilt could also be that of a steady circle
_FROUDE = 1.5  # speed of a bicycle / sqrt(gravity * wheelbase): enough for balance by steering


def balances(chassis: WheelLayout, site: RobotAtStart) -> bool:
    """True if a base stands only on two wheels of one axle."""
    lonely = not (chassis.casters or chassis.balls or chassis.steered or chassis.trailers)
    if not lonely or len(chassis.fixed) != 2 or len(chassis.axles) != 1:
        return False
    one, other = chassis.fixed
    if np.linalg.norm(one.center - other.center) < one.radius:
        return False
    above, beside = _center_of_mass(chassis, site)
    named = _BALANCES.search(site.words) is not None
    tall = above > (0.0 if named else _TALL * one.radius) and beside < max(0.5 * above, 0.2 * one.radius)
    return tall and (named or not _is_supported(chassis, site))


def balancing_base(chassis: WheelLayout, site: RobotAtStart) -> BaseAssumptions:
    """Free base on one axle: two wheel torques control both wheel angles and the pitch.

    The feedback uses wheel angles, not path length and heading: the motion of an unbalanced wheel depends on its angle.
    """
    wheels = chassis.fixed
    result = BaseAssumptions("free", "2 wheels under a body that balances", site.frame)
    _lie_down(result, wheels, site)
    ahead = site.along(wheels[0].heading)
    tilt = f"{site.frame}_tilt_{ahead}"
    leaning: dict[str, Json] = {"frame_tilt": {"frame": site.frame, "axis": ahead}}
    forward = site.placement.rotation[:, "xyz".index(ahead)]
    cost: dict[str, Json] = {tilt: 100, f"{tilt}_dot": 1}
    for wheel in wheels:
        result.constraints.append((rolls(wheel), measured(wheel)))
        result.actuators.append((wheel.joint, ""))
        way = float(np.sign(wheel.heading @ forward)) * DRIVEN / wheel.radius
        result.outputs.append(({"joint": wheel.joint}, round(way, 2)))
        cost[wheel.joint] = significant((wheel.radius / _FAR) ** 2)
        cost[f"{wheel.joint}_dot"] = significant((wheel.radius / _FAST) ** 2)
    result.outputs.append((leaning, 0.0))
    result.untracked.add(tilt)
    result.vertical += place_and_heading(site.frame)
    result.feedback = {
        "type": "state_feedback",
        "coordinates": [*(wheel.joint for wheel in wheels), leaning],
        "state_cost": cost,
        "input_cost": _input_cost(chassis, site),
    }
    result.lean = wheels[0].axle
    result.notes.append(
        "only two wheels touch the ground: feedback balances the base about the equilibrium near the start; "
        "if a caster is missing in the file, use --base planar"
    )
    return result


def is_bicycle(chassis: WheelLayout) -> bool:
    """True if a steered wheel is in front of a fixed wheel, in one plane."""
    if len(chassis.fixed) != 1 or len(chassis.steered) != 1 or chassis.balls or chassis.casters:
        return False
    rear, (front,) = chassis.fixed[0], (chassis.steered[0].wheels or (None,))[:1]
    if front is None or len(chassis.steered[0].wheels) != 1 or not are_parallel(rear, front):
        return False
    between = front.center - rear.center
    along = abs(float(between @ rear.heading))
    return bool(np.linalg.norm(between[:2]) < 1.05 * along and along > 0.8 * rear.radius)


def bicycle_base(chassis: WheelLayout, site: RobotAtStart) -> BaseAssumptions:
    """Free base that rolls forward, tilts, and is balanced by its steering."""
    rear, fork = chassis.fixed[0], chassis.steered[0]
    front = fork.wheels[0]
    result = BaseAssumptions("free", "2 wheels in line: a bicycle, which leans", site.frame)
    _lie_down(result, [rear, front], site)
    result.constraints.append((rolls(rear), measured(rear)))
    result.constraints.append((rolls(front), f"steered by {fork.pivot.joint}; {measured(front)}"))
    result.actuators += [(rear.joint, "drives"), (fork.pivot.joint, "steering")]
    result.passive.add(front.joint)
    ahead = _ahead(fork, rear)
    across = site.along(rear.axle)
    along, steering = site.along(rear.heading), fork.pivot.joint
    speed, tilt = f"{site.frame}_speed_{along}", f"{site.frame}_tilt_{across}"
    leaning: dict[str, Json] = {"frame_tilt": {"frame": site.frame, "axis": across}}
    driven: dict[str, Json] = {"frame_speed": {"frame": site.frame, "axis": along}}
    result.outputs += [(driven, 0.0), (leaning, 0.0), ({"joint": steering}, 0.0)]
    result.vertical += place_and_heading(site.frame)
    feedback: dict[str, Json] = {
        "type": "state_feedback",
        "coordinates": [leaning, steering],
        "rates": [speed, tilt, steering],
        "state_cost": {tilt: 100, steering: 10, speed: 4, f"{tilt}_dot": 1, f"{steering}_dot": 1},
        "input_cost": _input_cost(chassis, site),
    }
    wheelbase = abs(float((front.center - rear.center) @ rear.heading))
    forward = site.placement.rotation[:, "xyz".index(along)]
    sense = 1.0 if forward @ ahead > 0 else -1.0
    rolling = {speed: round(sense * _FROUDE * float(np.sqrt(9.81 * wheelbase)), 2)}
    result.v2 = {**rolling, tilt: _PUSHED}
    # Wheels of a file are symmetric about their axles only to a few digits; their angles are cyclic all the same.
    result.feedback = {**feedback, "v2": dict(rolling), "cyclic": [rear.joint, front.joint]}
    result.notes.append(
        "a bicycle falls when it stands: it starts rolling, fast enough to be kept upright by steering alone"
    )
    return result


def _ahead(fork: WheelGroup, rear: Wheel) -> np.ndarray:
    along = fork.wheels[0].center - rear.center
    return np.asarray(along / np.linalg.norm(along))


def _lie_down(result: BaseAssumptions, wheels: list[Wheel], site: RobotAtStart) -> None:
    """Put the base at the height where the wheels touch the ground, and lock all other joints."""
    height = float(np.median([wheel.radius - wheel.center[2] for wheel in wheels]))
    result.initial["root_joint"] = [0.0, 0.0, round(height, 6), 0.0, 0.0, 0.0, 1.0]
    result.ground = 0.0
    pivots = {pivot.joint for wheel in wheels for pivot in wheel.pivots}
    moving = {wheel.joint for wheel in wheels} | pivots
    result.lock_carriers(wheels, site.start)
    others = [name for name in site.start if name not in moving and name not in result.lock]
    result.hold(others, site.start, "locked, while the base is balanced")


def _center_of_mass(chassis: WheelLayout, site: RobotAtStart) -> tuple[float, float]:
    """Center of mass of all bodies except the wheels: height above the axle, horizontal offset from it [m]."""
    own = {site.robot.joint_id(wheel.joint) for wheel in chassis.fixed}
    model = site.robot.model
    total, moment = 0.0, np.zeros(3)
    for index, inertia in enumerate(model.inertias):
        if index not in own and inertia.mass > 0:
            total += inertia.mass
            moment += inertia.mass * (site.data.oMi[index].act(inertia.lever))
    if not total:
        return 0.0, np.inf
    offset = moment / total - chassis.fixed[0].center
    return float(offset[2]), abs(float(offset @ chassis.fixed[0].heading))


def _is_supported(chassis: WheelLayout, site: RobotAtStart) -> bool:
    """True if another shape than the wheels reaches the ground, or if a name in the file means a support."""
    if _SUPPORT.search(site.words):
        return True
    ground = chassis.fixed[0].center[2] - chassis.fixed[0].radius
    own = {site.robot.joint_id(wheel.joint) for wheel in chassis.fixed}
    slack = _NEAR * chassis.fixed[0].radius
    everything = [each for kind in site.shapes.values() for each in kind]
    return any(shape.joint not in own and shape.bottom - ground < slack for shape in everything)


def _input_cost(chassis: WheelLayout, site: RobotAtStart) -> float:
    """Inverse square of the torque that holds the body at a tilt of 0.1 rad [1/(N m)^2]."""
    above, _ = _center_of_mass(chassis, site)
    weight = 9.81 * sum(inertia.mass for inertia in site.robot.model.inertias)
    return significant((0.1 * weight * max(above, chassis.fixed[0].radius)) ** -2)
