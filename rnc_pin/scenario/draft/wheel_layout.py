"""Classification of wheels: fixed, steered, caster, ball caster, or wheel of a trailer."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from rnc_pin.scenario.draft.wheel_detection import Pivot, Wheel

_TRAILS = 0.2  # smallest caster trail, in radii: from the swivel axis to the wheel
_AXLE = 1.0  # smallest such distance of several wheels on one pivot that carry a trailer, in radii
_CASTER = re.compile("caster|castor|swivel")
_GLIDES = re.compile("caster|castor|ball|support")
_STEERED = re.compile("steer|knuckle|articul")
_TOWED = re.compile("hitch|trailer|kingpin|coupl|drawbar|tow")


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
        widest = max(np.linalg.norm(each.center - self.wheels[0].center) for each in self.wheels)
        return bool(widest < 2.5 * self.wheels[0].radius) and len(self.wheels) <= 2

    @property
    def trail(self) -> float:
        """Distance from the pivot's axis to the wheels along their heading [m]."""
        center = np.mean([each.center for each in self.wheels], axis=0)
        return abs(float(self.wheels[0].heading @ self.pivot.offset(center)))


@dataclass
class WheelLayout:
    """Wheels of a robot by their function.

    Attributes:
        fixed: wheels on the base with a constant heading.
        balls: spheres on the base, which slide where they do not roll.
        casters: wheels on swivels that align themselves with the motion of the base.
        steered: wheels on pivots that need an actuator.
        trailers: wheels on towed pivots.
    """

    fixed: list[Wheel] = field(default_factory=list)
    balls: list[Wheel] = field(default_factory=list)
    casters: list[WheelGroup] = field(default_factory=list)
    steered: list[WheelGroup] = field(default_factory=list)
    trailers: list[WheelGroup] = field(default_factory=list)

    @property
    def wheels(self) -> list[Wheel]:
        """All wheels."""
        carried = [wheel for each in (*self.casters, *self.steered, *self.trailers) for wheel in each.wheels]
        return [*self.fixed, *self.balls, *carried]

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
        """Fixed wheels grouped by axle line."""
        return in_line(self.fixed)


def in_line(wheels: Iterable[Wheel]) -> list[list[Wheel]]:
    """Return wheels grouped by axle line."""
    axles: list[list[Wheel]] = []
    for wheel in wheels:
        for axle in axles:
            beside = (wheel.center - axle[0].center) @ axle[0].heading
            if are_parallel(axle[0], wheel) and abs(beside) < 0.1 * wheel.radius:
                axle.append(wheel)
                break
        else:
            axles.append([wheel])
    return axles


def are_parallel(one: Wheel, other: Wheel) -> bool:
    """True if two wheels have the same heading, up to the rounding of a file."""
    return bool(abs(one.heading @ other.heading) > 1 - 1e-3)


def classify_wheels(wheels: list[Wheel]) -> WheelLayout:
    """Classify wheels by their function."""
    result = WheelLayout()
    on_base = [wheel for wheel in wheels if not wheel.pivots]
    others = any(not wheel.is_ball for wheel in on_base)  # if all are spheres, the file draws its wheels as spheres
    for wheel in on_base:
        glides = wheel.is_ball and (others or _GLIDES.search(wheel.words) is not None)
        (result.balls if glides else result.fixed).append(wheel)
    groups: dict[str, list[Wheel]] = {}
    for wheel in wheels:
        if wheel.pivots:
            groups.setdefault(wheel.pivots[0].joint, []).append(wheel)
    for group in groups.values():
        carriage = WheelGroup(group[0].pivots[0], tuple(group))
        _others_like(carriage, result).append(carriage)
    if not result.fixed and result.casters and all(_CASTER.search(_words(each)) is None for each in result.casters):
        result.steered, result.casters = result.steered + result.casters, []  # without fixed wheels
    return result


def _others_like(carriage: WheelGroup, layout: WheelLayout) -> list[WheelGroup]:
    """List of the layout to which a carriage belongs."""
    words, trail, radius = _words(carriage), carriage.trail, carriage.wheels[0].radius
    if _TOWED.search(words):
        return layout.trailers
    if _STEERED.search(words):
        return layout.steered
    if _CASTER.search(words):
        return layout.casters
    if not carriage.is_lone:
        return layout.trailers if trail > _AXLE * radius else layout.steered
    follows = trail > _TRAILS * radius and carriage.pivot.is_continuous
    return layout.casters if follows else layout.steered


def _words(carriage: WheelGroup) -> str:
    return " ".join([carriage.pivot.joint, *(each.words for each in carriage.wheels)]).lower()
