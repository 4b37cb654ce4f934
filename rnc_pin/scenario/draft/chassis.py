"""What each wheel is there for: it drives, is steered, trails after the base, or carries a trailer."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from rnc_pin.scenario.draft.wheels import Pivot, Wheel

_TRAILS = 0.2  # from a swivel's axis to the wheel, in radii, above which the wheel turns after the base by itself
_AXLE = 1.0  # the same, of several wheels on one pivot, above which they carry a trailer
_CASTER = re.compile("caster|castor|swivel")
_GLIDES = re.compile("caster|castor|ball|support")
_STEERED = re.compile("steer|knuckle|articul")
_TOWED = re.compile("hitch|trailer|kingpin|coupl|drawbar|tow")


@dataclass(frozen=True)
class Carriage:
    """Wheels on one pivot."""

    pivot: Pivot
    wheels: tuple[Wheel, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        """Of the pivot and of the wheels."""
        return self.pivot.joint, *(wheel.joint for wheel in self.wheels)

    @property
    def is_lone(self) -> bool:
        """One wheel, or twins beside each other."""
        widest = max(np.linalg.norm(each.center - self.wheels[0].center) for each in self.wheels)
        return bool(widest < 2.5 * self.wheels[0].radius) and len(self.wheels) <= 2

    @property
    def trail(self) -> float:
        """From the pivot's axis to the wheels, along their heading [m]."""
        center = np.mean([each.center for each in self.wheels], axis=0)
        return abs(float(self.wheels[0].heading @ self.pivot.offset(center)))


@dataclass
class Chassis:
    """The wheels of a robot by what they do.

    Attributes:
        fixed: on the base, in one heading.
        balls: on the base, as round in every direction: they slide where they do not roll.
        casters: on a pivot each, turning after the base by themselves.
        steered: on pivots that somebody has to turn.
        trailers: on pivots that are towed.
    """

    fixed: list[Wheel] = field(default_factory=list)
    balls: list[Wheel] = field(default_factory=list)
    casters: list[Carriage] = field(default_factory=list)
    steered: list[Carriage] = field(default_factory=list)
    trailers: list[Carriage] = field(default_factory=list)

    @property
    def wheels(self) -> list[Wheel]:
        """All of them."""
        carried = [wheel for each in (*self.casters, *self.steered, *self.trailers) for wheel in each.wheels]
        return [*self.fixed, *self.balls, *carried]

    @property
    def dollies(self) -> list[str]:
        """Pivots that carry no wheels themselves but others that do."""
        own = {each.pivot.joint for each in (*self.casters, *self.steered, *self.trailers)}
        beyond = (pivot.joint for wheel in self.wheels for pivot in wheel.pivots)
        return [joint for joint in dict.fromkeys(beyond) if joint not in own]

    @property
    def is_straight(self) -> bool:
        """Whether all fixed wheels have one heading."""
        return all(are_parallel(self.fixed[0], wheel) for wheel in self.fixed)

    @property
    def axles(self) -> list[list[Wheel]]:
        """Fixed wheels by the line they turn about."""
        return in_line(self.fixed)


def in_line(wheels: Iterable[Wheel]) -> list[list[Wheel]]:
    """Wheels by the line they turn about."""
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
    """Whether two wheels have one heading, but for the digits of a file."""
    return bool(abs(one.heading @ other.heading) > 1 - 1e-3)


def chassis(wheels: list[Wheel]) -> Chassis:
    """Sort wheels by what they do."""
    result = Chassis()
    on_base = [wheel for wheel in wheels if not wheel.pivots]
    others = any(not wheel.is_ball for wheel in on_base)  # where all are spheres, that is how wheels are drawn
    for wheel in on_base:
        glides = wheel.is_ball and (others or _GLIDES.search(wheel.words) is not None)
        (result.balls if glides else result.fixed).append(wheel)
    groups: dict[str, list[Wheel]] = {}
    for wheel in wheels:
        if wheel.pivots:
            groups.setdefault(wheel.pivots[0].joint, []).append(wheel)
    for group in groups.values():
        carriage = Carriage(group[0].pivots[0], tuple(group))
        _others_like(carriage, result).append(carriage)
    if not result.fixed and result.casters and all(_CASTER.search(_words(each)) is None for each in result.casters):
        result.steered, result.casters = result.steered + result.casters, []  # a base on driven swivels
    return result


def _others_like(carriage: Carriage, chassis: Chassis) -> list[Carriage]:
    """Which of the lists of a chassis it belongs to."""
    words, trail, radius = _words(carriage), carriage.trail, carriage.wheels[0].radius
    if _TOWED.search(words):
        return chassis.trailers
    if _STEERED.search(words):
        return chassis.steered
    if _CASTER.search(words):
        return chassis.casters
    if not carriage.is_lone:
        return chassis.trailers if trail > _AXLE * radius else chassis.steered
    follows = trail > _TRAILS * radius and carriage.pivot.turns_round
    return chassis.casters if follows else chassis.steered


def _words(carriage: Carriage) -> str:
    return " ".join([carriage.pivot.joint, *(each.words for each in carriage.wheels)]).lower()
