"""Bases on wheels of all kinds: files, drafted models, and a plant that takes velocities of motors."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from rnc_pin.applications.init import DraftOptions, draft_with_decisions
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control.actuator_velocity import velocity_from_actuators
from urdf_parts import BOX, caster, joint, link, pivot, robot, transmissions, wheel

RADIUS = 0.1
STEERING_RATE = 2.0  # largest rate of a pivot [rad/s]
SENSOR = (0.31, -0.12, 0.7)
"""Pose (x, y, heading) of the frame "sensor" on each base."""


class Wheel(NamedTuple):
    """Wheel at a place on the base, or on a vertical pivot there."""

    x: float
    y: float
    pivot: str | None = None
    beside: float = 0.0
    """Place of the wheel to the left of its pivot."""


@dataclass(frozen=True, eq=False)
class Base:
    """URDF with its wheels, and angles of rollers from the heading, by joint."""

    urdf: str
    wheels: dict[str, Wheel]
    rollers: dict[str, float]


def _base(*parts, driven, wheels, rollers=()):
    x, y, heading = SENSOR
    sensor = f"""<link name="sensor"/><joint name="sensor_mount" type="fixed"><parent link="base"/>
        <child link="sensor"/><origin xyz="{x} {y} 0.2" rpy="0 0 {heading}"/></joint>"""
    rates = {"turn": f'velocity="{STEERING_RATE}"', "swivel": 'velocity="1e3"'}  # of wheels: 20 rad/s
    for named, limit in rates.items():
        parts = [each.replace('velocity="20"', limit) if f'name="{named}' in each else each for each in parts]
    text = robot(link("base", 20.0, BOX), *parts, sensor, transmissions(*driven))
    return Base(text, wheels, dict(rollers))


def _fixed(**places):
    """Parts and table of wheels on the base itself."""
    table = {f"{name}_joint": Wheel(x, y) for name, (x, y) in places.items()}
    return [wheel(name, "base", (x, y, 0), RADIUS) for name, (x, y) in places.items()], table


def _steered(turns_round=False, parent="base", **places):
    """Parts and table of wheels on one pivot each."""
    parts, table = [], {}
    for name, (x, y) in places.items():
        parts += [pivot(f"turn_{name}", parent, (x, y, 0), turns_round=turns_round)]
        parts += [wheel(name, f"turn_{name}", (0, 0, 0), RADIUS)]
        table[f"{name}_joint"] = Wheel(x, y, f"turn_{name}_joint")
    return parts, table


def differential():
    parts, wheels = _fixed(left=(0.0, 0.2), right=(0.0, -0.2))
    return _base(*parts, caster("swivel", "base", (0.3, 0.0, -0.05)), driven=wheels, wheels=wheels)


def tricycle(turns_round=False):
    """Two wheels behind, one in front on a pivot, with limits or not."""
    back, wheels = _fixed(left=(-0.4, 0.2), right=(-0.4, -0.2))
    front, more = _steered(turns_round, front=(0.5, 0.0))
    return _base(*back, *front, driven=["front_joint", "turn_front_joint"], wheels=wheels | more)


def forklift():
    """Load wheels in front, a driven wheel on a pivot behind, beside the middle."""
    front, wheels = _fixed(left=(0.3, 0.25), right=(0.3, -0.25))
    rear, more = _steered(drive=(-0.8, 0.1))
    return _base(*front, *rear, driven=["drive_joint", "turn_drive_joint"], wheels=wheels | more)


def car(trailer=False):
    back, wheels = _fixed(left=(-0.3, 0.2), right=(-0.3, -0.2))
    front, more = _steered(fl=(0.3, 0.2), fr=(0.3, -0.2))
    towed = []
    if trailer:
        hitch = joint("hitch", "base", "trailer", (-0.5, 0, 0), "0 0 1", "revolute", 0.0, (-1.2, 1.2))
        towed = [link("trailer", 5.0, at="-0.5 0 0"), hitch]
        towed += [wheel(f"tow_{side}", "trailer", (-0.6, y, 0)) for side, y in (("l", 0.2), ("r", -0.2))]
    driven = ["left_joint", "right_joint", "turn_fl_joint"]
    return _base(*back, *front, *towed, driven=driven, wheels=wheels | more)


def swerve(*places, turns_round=True):
    parts, wheels = _steered(turns_round, **{f"w{k}": place for k, place in enumerate(places)})
    return _base(*parts, driven=[*wheels, *(each.pivot for each in wheels.values())], wheels=wheels)


def carts():
    """Two carts with four steered drives each, on loose pivots under a load."""
    parts, wheels, corners = [], {}, [(x, y) for x in (0.25, -0.25) for y in (0.2, -0.2)]
    for name, ahead in (("a", 0.8), ("b", -0.8)):
        own, table = _steered(True, name, **{f"{name}{k}": place for k, place in enumerate(corners)})
        parts += [link(name, 10.0), joint(f"{name}_joint", "base", name, (ahead, 0, 0), "0 0 1", effort=0.0), *own]
        wheels |= {each: wheel._replace(x=wheel.x + ahead) for each, wheel in table.items()}
    return _base(*parts, driven=[*wheels, *(each.pivot for each in wheels.values())], wheels=wheels)


def mecanum():
    parts, wheels = _fixed(fl=(0.3, 0.25), fr=(0.3, -0.25), bl=(-0.3, 0.25), br=(-0.3, -0.25))
    side = {"fl_joint": -np.pi / 4, "fr_joint": np.pi / 4, "bl_joint": np.pi / 4, "br_joint": -np.pi / 4}
    return _base(*parts, driven=wheels, wheels=wheels, rollers=side)


def turret(behind=0.0):
    """A body on casters; a driven pivot carries two driven wheels, below it or some way behind."""
    places = ((0.45 * np.cos(a), 0.45 * np.sin(a), -0.05) for a in (0.5, 2.6, 4.7))
    parts = [caster(f"swivel{k}", "base", place) for k, place in enumerate(places)]
    parts += [pivot("turn", "base", (0.05, 0, 0), turns_round=True)]
    parts += [wheel(f"drive_{side}", "turn", (-behind, y, 0)) for side, y in (("l", 0.15), ("r", -0.15))]
    wheels = {f"drive_{side}_joint": Wheel(0.05, 0.0, "turn_joint", y) for side, y in (("l", 0.15), ("r", -0.15))}
    return _base(*parts, driven=["turn_joint", *wheels], wheels=wheels)


KINDS = {
    "differential drive": differential(),
    "tricycle, driven in front": tricycle(),
    "forklift": forklift(),
    "car": car(),
    "car with trailer": car(trailer=True),
    "four-wheel steering": swerve((0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2), turns_round=False),
    "two steered drives": swerve((0.3, 0.2), (-0.3, -0.2)),
    "two steered drives side by side": swerve((0.0, 0.3), (0.0, -0.3)),
    "four steered drives": swerve((0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)),
    "two carts": carts(),
    "Mecanum": mecanum(),
    "turret": turret(),
}


def with_gripper(base: Base) -> Base:
    """The base with a joint of an arm, and two fingers of which one mimics the other; its body is clear of wheels."""
    parts = link("arm", 1.0, at="0.1 0 0") + joint("shoulder", "base", "arm", (0, 0, 0.4), "0 0 1", limits=(-2, 2))
    for side, mimic in ((1, ""), (-1, '<mimic joint="f1_joint" multiplier="-1"/>')):
        place = (0.3, 0.02 * side, 0)
        finger = joint(f"f{side}_joint", "arm", f"f{side}", place, limits=(-0.05, 0.05), kind="prismatic")
        parts += link(f"f{side}", 0.1) + finger.replace("</joint>", mimic + "</joint>")
    urdf = base.urdf.replace("</robot>", parts + transmissions("shoulder", "f1_joint") + "</robot>")
    return replace(base, urdf=urdf.replace(BOX, '<box size="0.04 0.04 0.04"/>'))


@cache
def drafted_model(base: Base) -> rnc.ReducedModel:
    """Reduced model of the scenario that ``rnc-pin init`` drafts, which tests share."""
    with TemporaryDirectory() as name:
        return Scenario.load(drafted_file(base, Path(name))).experiment.reduced


def drafted_file(base: Base, folder: Path) -> str:
    """Scenario file that ``rnc-pin init`` drafts in a folder."""
    (folder / "unit.urdf").write_text(base.urdf)
    wishes = DraftOptions(rollers=True) if base.rollers else DraftOptions()
    (folder / "unit.yaml").write_text(draft_with_decisions(str(folder / "unit.urdf"), folder, wishes).text)
    return str(folder / "unit.yaml")


class KinematicPlant:
    """Base with velocity servos: its motion follows from the motors alone, by the independent rows."""

    def __init__(self, reduced, q, substeps=2):
        self.reduced, self.q, self.v, self._substeps = reduced, q, np.zeros(reduced.n), substeps
        self.middle = q

    def advance(self, u, dt, hold=()):
        """Hold velocities u of the motors for dt [s]."""
        h = dt / self._substeps
        for _ in range(self._substeps):
            half = velocity_from_actuators(self.reduced.at(self.q), u)
            self.middle = pin.integrate(self.reduced.robot.model, self.q, 0.5 * h * half)
            self.v = velocity_from_actuators(self.reduced.at(self.middle), u)
            self.q = pin.integrate(self.reduced.robot.model, self.q, h * self.v)
            if self.reduced.assembly.size:
                self.q = self.reduced.assembled(self.q, hold=hold)
