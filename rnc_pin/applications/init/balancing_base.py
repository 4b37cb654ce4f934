"""Statically unstable bases: two wheels under a body, bicycles."""

from __future__ import annotations

from statistics import median
from typing import NoReturn

import numpy as np

from rnc_pin.applications.init.assumptions import DRIVEN, BaseAssumptions, measured, place_and_heading, rolls
from rnc_pin.applications.init.evidence import LIKELY, SURE, Alternative, DraftDecision, has_word
from rnc_pin.applications.init.robot_at_start import RobotAtStart
from rnc_pin.applications.init.wheel_detection import Wheel
from rnc_pin.applications.init.wheel_layout import WheelGroup, WheelLayout, are_parallel
from rnc_pin.applications.init.wheeled_base import one_lateral
from rnc_pin.errors import ConfigurationError, few
from rnc_pin.io import Json
from rnc_pin.printing import significant

_SUPPORT = "caster.*|.*caster|castor.*|.*castor|support|skid|stabili[sz]er|ball|roller|slider|foot|feet|leg_rest"
_BALANCES = "balanc.*|segway|pendul.*|upkie|hoverboard|two_?wheel(?:ed)?|self_?balanc.*"
_TALL = 1.5  # smallest height of the center of mass above the axle of a balancing robot, in radii
_NEAR = 0.3  # largest height of a support above the ground, in radii
_FAR, _FAST = 0.05, 0.5  # displacement and speed with the same cost as a tilt of 0.1 rad, at wheels of 0.1 m [m, m/s]
_SMALL, _LARGE = 0.1, 0.3  # radii for which the costs of a body on one axle, and of a bicycle, are stated [m]
_PUSHED = 0.1  # initial tilt rate of a bicycle [rad/s]; an initial tilt could also be that of a steady circle
_FROUDE = 1.5  # speed of a bicycle / sqrt(gravity * wheelbase): enough for balance by steering


def balance_decision(layout: WheelLayout, at_start: RobotAtStart, asked: bool | None) -> DraftDecision | None:
    """Return whether a base that stands on two wheels of one axle balances: by an option, its mass, supports and names.

    Returns:
        The decision, whose answer is "yes" or "no"; None if the question does not arise.
    """
    lonely = not (layout.casters or layout.balls or layout.steered or layout.trailers)
    if not lonely or len(layout.fixed) != 2 or len(layout.axles) != 1:
        return None
    one, other = layout.fixed
    if np.linalg.norm(one.center - other.center) < one.radius:
        return None
    question = "Does the base balance on its two wheels?"
    no, yes = Alternative("a caster is missing in the file", ("--no-balance",)), Alternative("it does", ("--balance",))
    if asked is not None:
        return DraftDecision(question, "yes" if asked else "no", SURE, "by an option")
    above, beside = _center_of_mass(layout, at_start)
    named = has_word(_BALANCES, *at_start.title)  # a load balancer on a cart is none
    if beside >= max(0.5 * above, 0.2 * one.radius) or above <= (0.0 if named else _TALL * one.radius):
        return DraftDecision(question, "no", LIKELY, "its center of mass is low, or beside the axle", (yes,))
    if named:
        return DraftDecision(question, "yes", LIKELY, "by a name, and its center of mass is above the axle", (no,))
    support = _support(layout, at_start)
    if support:
        return DraftDecision(question, "no", LIKELY, f"{support} supports it", (yes,))
    return DraftDecision(
        question, "yes", LIKELY, "nothing else reaches the ground, and its center of mass is high", (no,)
    )


def balancing_base(layout: WheelLayout, at_start: RobotAtStart, decided: DraftDecision) -> BaseAssumptions:
    """Free base on one axle: two wheel torques control both wheel angles and the pitch.

    The feedback uses wheel angles, not path length and heading: the motion of an unbalanced wheel depends on its angle.
    """
    wheels = layout.fixed
    result = BaseAssumptions("free", "2 wheels under a body that balances", at_start.frame, travel=DRIVEN)
    result.decisions.append(decided)
    _lie_down(result, wheels, at_start)
    ahead = at_start.along(wheels[0].heading)
    tilt = f"{at_start.frame}_tilt_{ahead}"
    leaning: dict[str, Json] = {"frame_tilt": {"frame": at_start.frame, "axis": ahead}}
    forward = at_start.placement.rotation[:, "xyz".index(ahead)]
    size = wheels[0].radius / _SMALL  # lengths grow with it, and times with its square root
    cost: dict[str, Json] = {tilt: 100, f"{tilt}_dot": significant(size)}
    for wheel, more in one_lateral(wheels):
        result.constraints.append((rolls(wheel, **more), measured(wheel)))
        result.actuators.append((wheel.joint, ""))
        way = float(np.sign(wheel.heading @ forward)) * DRIVEN / wheel.radius
        result.outputs.append(({"joint": wheel.joint}, round(way, 2)))
        cost[wheel.joint] = significant((wheel.radius / (size * _FAR)) ** 2)
        cost[f"{wheel.joint}_dot"] = significant((wheel.radius / _FAST) ** 2 / size)
    result.outputs.append((leaning, 0.0))
    result.untracked.add(tilt)
    result.vertical += place_and_heading(at_start.frame)
    result.feedback = {
        "type": "state_feedback",
        "coordinates": [*(wheel.joint for wheel in wheels), leaning],
        "state_cost": cost,
        "input_cost": _input_cost(layout, at_start),
    }
    result.lean = wheels[0].axle
    result.notes.append(
        "only two wheels touch the ground: feedback balances the base about the equilibrium near the start; "
        "if a caster is missing in the file, use --no-balance"
    )
    return result


def is_bicycle(layout: WheelLayout) -> bool:
    """True if a steered wheel is in front of a fixed wheel, in one plane."""
    if len(layout.fixed) != 1 or len(layout.steered) != 1 or layout.balls or layout.casters:
        return False
    rear, (front,) = layout.fixed[0], (layout.steered[0].wheels or (None,))[:1]
    if front is None or len(layout.steered[0].wheels) != 1 or not are_parallel(rear, front):
        return False
    between = front.center - rear.center
    along = abs(float(between @ rear.heading))
    return bool(np.linalg.norm(between[:2]) < 1.05 * along and along > 0.8 * rear.radius)


def refuse_one_track(layout: WheelLayout) -> NoReturn:
    """Refuse wheels in line without steering.

    Raises:
        ConfigurationError: always.
    """
    raise ConfigurationError(
        f"the wheels {few([wheel.joint for wheel in layout.wheels])} stand in line: such a robot falls sideways and "
        "cannot turn by its wheels; add a steered wheel to the file, or hold it upright with --base planar"
    )


def bicycle_base(layout: WheelLayout, at_start: RobotAtStart) -> BaseAssumptions:
    """Free base that rolls forward, tilts, and is balanced by its steering."""
    rear, fork = layout.fixed[0], layout.steered[0]
    front = fork.wheels[0]
    result = BaseAssumptions("free", "2 wheels in line: a bicycle, which leans", at_start.frame)
    upright = Alternative("it is held upright", ("--base", "planar"))
    evidence = "its wheels stand in line, and one of them is steered"
    result.decisions.append(DraftDecision("Does it lean, as a bicycle does?", "yes", LIKELY, evidence, (upright,)))
    _lie_down(result, [rear, front], at_start)
    result.constraints.append((rolls(rear), measured(rear)))
    result.constraints.append((rolls(front), f"steered by {fork.pivot.joint}; {measured(front)}"))
    result.actuators += [(rear.joint, "drives"), (fork.pivot.joint, "steering")]
    result.passive.add(front.joint)
    ahead = _ahead(fork, rear)
    across = at_start.along(rear.axle)
    along, steering = at_start.along(rear.heading), fork.pivot.joint
    speed, tilt = f"{at_start.frame}_speed_{along}", f"{at_start.frame}_tilt_{across}"
    leaning: dict[str, Json] = {"frame_tilt": {"frame": at_start.frame, "axis": across}}
    driven: dict[str, Json] = {"frame_speed": {"frame": at_start.frame, "axis": along}}
    result.outputs += [(driven, 0.0), (leaning, 0.0), ({"joint": steering}, 0.0)]
    result.vertical += place_and_heading(at_start.frame)
    size = rear.radius / _LARGE
    feedback: dict[str, Json] = {
        "type": "state_feedback",
        "coordinates": [leaning, steering],
        "rates": [speed, tilt, steering],
        "state_cost": {
            tilt: 100,
            steering: 10,
            speed: significant(4 / size),
            f"{tilt}_dot": significant(size),
            f"{steering}_dot": significant(size),
        },
        "input_cost": _input_cost(layout, at_start),
    }
    wheelbase = abs(float((front.center - rear.center) @ rear.heading))
    forward = at_start.placement.rotation[:, "xyz".index(along)]
    sense = 1.0 if forward @ ahead > 0 else -1.0
    rolling = {speed: round(sense * _FROUDE * float(np.sqrt(9.81 * wheelbase)), 2)}
    result.v2 = {**rolling, tilt: _PUSHED}
    result.travel = abs(rolling[speed]) * result.duration
    # Wheels of a file are symmetric about their axles only to a few digits; their angles are cyclic all the same.
    result.feedback = {**feedback, "v2": dict(rolling), "cyclic": [rear.joint, front.joint]}
    result.notes.append(
        "a bicycle falls when it stands: it starts rolling, fast enough to be kept upright by steering alone"
    )
    return result


def _ahead(fork: WheelGroup, rear: Wheel) -> np.ndarray:
    along = fork.wheels[0].center - rear.center
    return np.asarray(along / np.linalg.norm(along))


def _lie_down(result: BaseAssumptions, wheels: list[Wheel], at_start: RobotAtStart) -> None:
    """Put the base at the height where the wheels touch the ground, and lock all other joints."""
    height = median(float(wheel.radius - wheel.center[2]) for wheel in wheels)
    result.initial["root_joint"] = [0.0, 0.0, round(height, 6), 0.0, 0.0, 0.0, 1.0]
    result.ground = 0.0
    pivots = {pivot.joint for wheel in wheels for pivot in wheel.pivots}
    moving = {wheel.joint for wheel in wheels} | pivots
    result.lock_carriers(wheels, at_start.start)
    others = [name for name in at_start.start if name not in moving and name not in result.lock]
    result.hold(others, at_start.start, "locked, while the base is balanced")


def _center_of_mass(layout: WheelLayout, at_start: RobotAtStart) -> tuple[float, float]:
    """Center of mass of all bodies except the wheels: height above the axle, horizontal offset from it [m]."""
    own = {at_start.robot.joint_id(wheel.joint) for wheel in layout.fixed}
    model = at_start.robot.model
    total, moment = 0.0, np.zeros(3)
    for index, inertia in enumerate(model.inertias):
        if index not in own and inertia.mass > 0:
            total += inertia.mass
            moment += inertia.mass * (at_start.data.oMi[index].act(inertia.lever))
    if not total:
        return 0.0, np.inf
    offset = moment / total - layout.fixed[0].center
    return float(offset[2]), abs(float(offset @ layout.fixed[0].heading))


def _support(layout: WheelLayout, at_start: RobotAtStart) -> str:
    """Name of a link that reaches the ground beside the wheels, or that is called a support; empty if there is none.

    A link without a shape counts by its name if its origin is not higher than the axle.
    """
    axle, radius = layout.fixed[0].center[2], layout.fixed[0].radius
    own = {at_start.robot.joint_id(wheel.joint) for wheel in layout.fixed}
    everything = [each for kind in at_start.shapes.values() for each in kind if each.joint not in own]
    for shape in everything:
        if shape.bottom - (axle - radius) < _NEAR * radius:
            return shape.name
    for index, frame in enumerate(at_start.robot.model.frames):
        low = at_start.data.oMf[index].translation[2] <= axle
        if low and frame.parentJoint not in own and frame.name != "universe" and has_word(_SUPPORT, frame.name):
            return str(frame.name)
    return ""


def _input_cost(layout: WheelLayout, at_start: RobotAtStart) -> float:
    """Inverse square of the torque that holds the body at a tilt of 0.1 rad [1/(N m)^2]."""
    above, _ = _center_of_mass(layout, at_start)
    weight = 9.81 * sum(inertia.mass for inertia in at_start.robot.model.inertias)
    return significant((0.1 * weight * max(above, layout.fixed[0].radius)) ** -2)
