"""Classification of wheels: fixed, steered, caster, ball caster, or wheel of a trailer."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from rnc_pin.applications.init.evidence import DriveEvidence, DrivenJoints, has_word
from rnc_pin.applications.init.robot_at_start import first_smallest, placed
from rnc_pin.applications.init.wheel_detection import Pivot, Wheel

_CASTER = "caster.*|.*caster|castor.*|.*castor|swivel.*"
TOWED = "hitch|trailer|kingpin|king_pin|coupler|coupling|drawbar|tow|towed|towbar"


@dataclass(frozen=True)
class WheelGroup:
    """Wheels on one pivot."""

    pivot: Pivot
    wheels: tuple[Wheel, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints of the pivot and of the wheels."""
        return self.pivot.joint, *(wheel.joint for wheel in self.wheels)

    @property
    def is_lone(self) -> bool:
        """True for one wheel, or for twin wheels side by side."""
        # 2.5 radii: two wheels of one diameter with a gap between them. An axle of a trailer is wider.
        widest = max(np.linalg.norm(each.center - self.wheels[0].center) for each in self.wheels)
        return bool(widest < 2.5 * self.wheels[0].radius) and len(self.wheels) <= 2

    @property
    def trail(self) -> float:
        """Distance from the pivot's axis to the midpoint of the wheels along their heading [m]."""
        middle = np.mean([each.center for each in self.wheels], axis=0)
        return abs(float(self.wheels[0].heading @ self.pivot.offset(middle)))

    @property
    def follows(self) -> bool:
        """True if the trail is long enough for the wheels to follow the motion of the base."""
        trails = 0.2  # smallest caster trail, in radii: from the swivel axis to the wheel
        return self.trail > trails * self.wheels[0].radius


@dataclass
class WheelLayout:
    """Wheels of a robot by their function.

    Attributes:
        fixed: wheels on the base with a constant heading.
        balls: spheres on the base, which slide where they do not roll, and casters drawn as a joint across the others.
        casters: wheels on swivels that align themselves with the motion of the base.
        steered: wheels on pivots that need an actuator.
        trailers: wheels on towed pivots.
        straight: driven pivots of towed bodies, which are held straight.
        sliding: fixed wheels with rollers beside others without, so that they slide sideways.
        raised: round bodies above the ground in the planes of the fixed wheels, as sprockets of tracks.
        driven: wheels with a motor.
    """

    fixed: list[Wheel] = field(default_factory=list)
    balls: list[Wheel] = field(default_factory=list)
    casters: list[WheelGroup] = field(default_factory=list)
    steered: list[WheelGroup] = field(default_factory=list)
    trailers: list[WheelGroup] = field(default_factory=list)
    straight: list[Pivot] = field(default_factory=list)
    sliding: list[Wheel] = field(default_factory=list)
    raised: list[Wheel] = field(default_factory=list)
    driven: DrivenJoints = field(default_factory=lambda: DrivenJoints((), 0.0, ""))

    @property
    def wheels(self) -> list[Wheel]:
        """All wheels."""
        carried = [wheel for each in (*self.casters, *self.steered, *self.trailers) for wheel in each.wheels]
        # ``sliding`` wheels are among the fixed ones; ``raised`` ones do not stand on the ground.
        return [*self.fixed, *self.balls, *carried]

    @property
    def motorized(self) -> list[Wheel]:
        """Wheels that may have a motor: fixed and steered ones with a joint, and sprockets."""
        steered = [wheel for each in self.steered for wheel in each.wheels]
        return [wheel for wheel in (*self.fixed, *self.raised, *steered) if wheel.edge is None]

    @property
    def dollies(self) -> list[str]:
        """Pivots that carry other pivots with wheels, but no wheels directly."""
        own = {each.pivot.joint for each in (*self.casters, *self.steered, *self.trailers)}
        beyond = (pivot.joint for wheel in self.wheels for pivot in wheel.pivots)
        return [joint for joint in dict.fromkeys(beyond) if joint not in own]

    @property
    def is_straight(self) -> bool:
        """True if all fixed wheels have the same heading."""
        return all(are_parallel(self.fixed[0], wheel) for wheel in self.fixed)

    @property
    def axles(self) -> list[list[Wheel]]:
        """Fixed wheels without rollers grouped by axle line."""
        return in_line(wheel for wheel in self.fixed if wheel.joint not in {each.joint for each in self.sliding})

    @property
    def middle(self) -> np.ndarray:
        """Midpoint of the fixed axles in the world frame (3,) [m]."""
        return np.asarray(np.mean([np.mean([wheel.center for wheel in axle], axis=0) for axle in self.axles], axis=0))

    @property
    def guide(self) -> list[Wheel]:
        """Fixed axle nearest to the middle of all: a base with steered wheels turns about a point of its line."""
        axles = self.axles
        # Not the first axle of the file: the middle one skids least in a turn, in whatever order they are written.
        distances = [abs(float((axle[0].center - self.middle) @ axle[0].heading)) for axle in axles]
        return axles[first_smallest(distances, placed(axles[0][0].radius))]

    @property
    def is_turret(self) -> bool:
        """True if one pivot carries two or more driven wheels of one axle line, and nothing else guides the base."""
        if self.fixed or self.trailers or len(self.steered) != 1:
            return False
        wheels = self.steered[0].wheels
        # One wheel, or two on different lines, would be a caster or a bogie: only an axle turns by its two motors.
        is_axle = len(wheels) > 1 and len(in_line(wheels)) == 1
        return is_axle and all(each.joint in self.driven.joints for each in wheels)

    @property
    def is_swerve(self) -> bool:
        """True if two or more driven or drawn wheels are steered one by one and guide the base."""
        if self.fixed or self.trailers or len(self.steered) < 2:
            return False
        wheels = [each.wheels[0] for each in self.steered]
        driven = [each.joint in self.driven.joints or each.edge is not None for each in wheels]
        # One driven wheel is a tricycle with a second wheel that only steers.
        return sum(driven) > 1 and all(are_parallel(wheels[0], each) for each in wheels)

    @property
    def is_bicycle(self) -> bool:
        """True if a steered wheel is in front of a fixed wheel, in one plane."""
        if len(self.fixed) != 1 or len(self.steered) != 1 or self.balls or self.casters:
            return False
        rear, front = self.fixed[0], self.steered[0].wheels[0]
        if len(self.steered[0].wheels) != 1 or not (rear.can_lean and front.can_lean and are_parallel(rear, front)):
            return False
        between = front.center - rear.center
        # The wheels may be aside by a third of their distance, 1.05 = 1 / cos(18 degrees), as in a rough drawing.
        along = abs(float(between @ rear.heading))
        return bool(np.linalg.norm(between[:2]) < 1.05 * along and along > 0.8 * rear.radius)

    @property
    def is_on_one_track(self) -> bool:
        """True if all wheels stand one behind the other, so that the robot falls sideways."""
        wheels = self.wheels
        if len(wheels) < 2 or self.balls or not all(each.can_lean and are_parallel(wheels[0], each) for each in wheels):
            return False
        centers = np.array([each.center for each in wheels])
        one_track = 0.25  # largest lateral distance of wheels that stand in line, in radii
        beside, along = np.ptp(centers @ wheels[0].axle), np.ptp(centers @ wheels[0].heading)
        return bool(beside < one_track * wheels[0].radius < along)


def in_line(wheels: Iterable[Wheel]) -> list[list[Wheel]]:
    """Return wheels grouped by axle line.

    Args:
        wheels: wheels to group.
    """
    axles: list[list[Wheel]] = []
    same_line = 0.25  # largest distance of wheels of one axle line along their heading, in radii: at ends of legs too
    for wheel in wheels:
        for axle in axles:
            beside = (wheel.center - axle[0].center) @ axle[0].heading
            if are_parallel(axle[0], wheel) and abs(beside) < same_line * wheel.radius:
                axle.append(wheel)
                break
        else:
            axles.append([wheel])
    return axles


def are_parallel(one: Wheel, other: Wheel) -> bool:
    """True if two wheels have the same heading, up to 2.5 degrees.

    Args:
        one: one wheel.
        other: the other wheel.
    """
    return bool(abs(one.heading @ other.heading) > 1 - 1e-3)


def classify_wheels(
    wheels: list[Wheel], drives: DriveEvidence, raised: Iterable[Wheel] = (), sliding: Iterable[Wheel] = ()
) -> WheelLayout:
    """Classify wheels by their function.

    Args:
        wheels: wheels that stand on the ground.
        drives: evidence for which joints have a motor.
        raised: round bodies above the ground in the planes of several wheels.
        sliding: wheels that are called wheels with rollers: they slide if others on the base are called otherwise.
    """
    result = WheelLayout()
    on_base = [wheel for wheel in wheels if not wheel.pivots]
    others = any(not wheel.is_ball for wheel in wheels)  # if all are spheres, the file draws its wheels as spheres
    for wheel in on_base:
        slides = others or has_word(f"{_CASTER}|ball|support", *wheel.names)
        # A ball with a motor is a wheel.
        glides = wheel.is_ball and slides and drives.says(wheel.joint) is not True
        (result.balls if glides or _is_caster_across(wheel, on_base, drives) else result.fixed).append(wheel)
    carriages = []
    for group in _on_pivots(each for each in wheels if each.pivots):
        idle = {each.joint for each in group.wheels if each.is_ball and not drives.says(each.joint)}
        # Balls beside wheels on a turret support it; alone, a ball may be the wheel of a caster.
        if len(idle) < len(group.wheels):
            result.balls += [each for each in group.wheels if each.joint in idle]
            group = replace(group, wheels=tuple(each for each in group.wheels if each.joint not in idle))
        carriages.append(group)
    for carriage in carriages:
        is_paired = any(_are_knuckles(carriage, each) for each in carriages if each is not carriage)
        _others_like(carriage, result, drives, is_paired).append(carriage)
    named = [each for each in result.casters if has_word(_CASTER, each.pivot.joint, *each.wheels[0].names)]
    aimed = [each for each in result.casters if drives.says(each.pivot.joint) is False]
    # A base on casters alone would not move. Where no word and no list of motors calls them casters, they are steered.
    if not result.fixed and not result.steered and result.casters and not named and not aimed:
        result.steered, result.casters = result.casters, []
    _straighten_towed(result)
    result.raised = [] if result.steered else [*raised]  # vehicles on tracks do not steer wheels
    rollers = {wheel.joint for wheel in sliding}
    if any(wheel.joint not in rollers for wheel in result.fixed):
        result.sliding = [wheel for wheel in result.fixed if wheel.joint in rollers]
    # Wheels that slide on their rollers are not the usual drives; a base has others, unless all slide.
    usual = [wheel for axle in result.axles for wheel in axle if wheel.edge is None] or result.motorized
    result.driven = drives.driven_of([each.joint for each in result.motorized], [each.joint for each in usual])
    return result


def _on_pivots(wheels: Iterable[Wheel]) -> list[WheelGroup]:
    """Wheels by the pivot next to them: twin wheels on one pivot are one caster, or one axle of a trailer."""
    groups: dict[str, list[Wheel]] = {}
    for wheel in wheels:
        groups.setdefault(wheel.pivots[0].joint, []).append(wheel)
    return [WheelGroup(group[0].pivots[0], tuple(group)) for group in groups.values()]


def _is_caster_across(wheel: Wheel, on_base: Iterable[Wheel], drives: DriveEvidence) -> bool:
    """True if an undriven wheel stands across all others: a ball caster of which the file draws one axis."""
    others = [each for each in on_base if each.joint != wheel.joint and not are_parallel(each, wheel)]
    # An effort of 0 tells something only beside others: many files write 0 everywhere.
    is_weak = drives.efforts.get(wheel.joint) == 0 and all(drives.efforts.get(each.joint) for each in others)
    is_idle = wheel.joint in drives.passive or is_weak or has_word(_CASTER, *wheel.names)
    if drives.says(wheel.joint) or not is_idle:
        return False
    # Three wheels with three headings are omni wheels, not an axle and a caster.
    return len(others) > 1 and all(are_parallel(others[0], each) for each in others)


def _straighten_towed(layout: WheelLayout) -> None:
    """Hold steered axles of towed bodies straight if the base has an axle of its own."""
    towed = [each for each in layout.steered if len(each.wheels[0].pivots) > 1]
    if len(towed) == len(layout.steered) and not layout.fixed:
        return  # nothing else guides the base: steered drives of carts under a load
    layout.steered = [each for each in layout.steered if len(each.wheels[0].pivots) == 1]
    layout.straight = [each.pivot for each in towed]
    behind = [replace(wheel, pivots=wheel.pivots[1:]) for each in towed for wheel in each.wheels]
    layout.trailers = _on_pivots([*(wheel for each in layout.trailers for wheel in each.wheels), *behind])


def _are_knuckles(one: WheelGroup, other: WheelGroup) -> bool:
    """True if two single wheels of one axle line have a pivot each on the same body, as those of a car."""
    above = [[pivot.joint for pivot in each.wheels[0].pivots[1:]] for each in (one, other)]
    single = above[0] == above[1] and one.is_lone and other.is_lone
    return single and len(in_line((one.wheels[0], other.wheels[0]))) == 1


def _others_like(carriage: WheelGroup, layout: WheelLayout, drives: DriveEvidence, is_paired: bool) -> list[WheelGroup]:
    """List of the layout to which a carriage belongs: by its motor, else by its name, else by its trail.

    A pair of pivots side by side is no hitch, whatever its name: the axis of a knuckle is a kingpin too.
    """
    pivot, radius, names = carriage.pivot, carriage.wheels[0].radius, (carriage.pivot.joint, *carriage.wheels[0].names)
    follows = carriage.follows and pivot.is_continuous
    # What the user and the file say of the motor counts before all words and lengths.
    if pivot.joint in drives.passive:
        return layout.casters if carriage.is_lone else layout.trailers
    if drives.says(pivot.joint):
        return layout.steered
    if has_word(TOWED, *names) and not is_paired:
        return layout.trailers
    steered = "steer|steering|steered|knuckle|articulat.*"
    if has_word(steered, *names):
        return layout.steered
    if has_word(_CASTER, *names):
        return layout.casters
    axle = 1.0  # smallest such distance of several wheels on one pivot that carry a trailer, in radii
    if not carriage.is_lone:
        return layout.trailers if carriage.trail > axle * radius else layout.steered
    # A wheel below its pivot does not align itself; a fork with limits is one that somebody turns.
    return layout.casters if follows else layout.steered
