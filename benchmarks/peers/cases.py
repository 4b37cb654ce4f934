"""Systems of the comparison, each with its solution by hand and the coordinates in which a user would integrate it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from benchmarks.peers.coordinates import PlainCoordinates, QuaternionCoordinates
from benchmarks.peers.hand_written import FreeArm, MobileManipulator, Solution, Tiago
from rnc_pin.applications.scenario.scenario import Scenario


@dataclass(frozen=True)
class Case:
    """A system and its solution by hand.

    Attributes:
        name: short name.
        reduced: our model.
        q0: configuration near which states are drawn.
        by_hand: ``(q, v2, T) -> (v2_dot, v, v_dot)``.
        free: True if momentum is the only constraint, so that an engine needs no constraints.
        regular: True if v2 stays regular during a free motion, so that the solution by hand can follow it.
    """

    name: str
    reduced: rnc.ReducedModel
    q0: np.ndarray
    by_hand: Callable[[np.ndarray, np.ndarray, np.ndarray], Solution]
    free: bool
    regular: bool = True
    coordinates: PlainCoordinates | QuaternionCoordinates = field(init=False)
    """Coordinates of a user's integrator."""

    def __post_init__(self) -> None:
        model = self.model
        has_quaternion = model.joints[1].shortname() == "JointModelFreeFlyer"
        object.__setattr__(self, "coordinates", QuaternionCoordinates() if has_quaternion else PlainCoordinates(model))

    @property
    def model(self) -> pin.Model:
        """Robot of the system."""
        return self.reduced.robot.model


@cache
def space_robot() -> Case:
    """Pinned platform with an arm of three joints, one momentum row."""
    experiment = Scenario.load("space-robot").experiment
    return Case(
        "space-robot",
        experiment.reduced,
        experiment.q0,
        FreeArm(experiment.reduced.robot.model, base=1, hand="tip", axes=2, joints=[1]),
        free=True,
    )


@cache
def tiago() -> Case:
    """TIAGo on two rolling wheels, three independent contact rows."""
    experiment = Scenario.load("tiago").experiment
    return Case("tiago", experiment.reduced, experiment.q0, Tiago(experiment.reduced.robot.model), free=False)


@cache
def mobile_manipulator() -> Case:
    """Platform with a knife edge and an arm of two joints."""
    experiment = Scenario.load("mobile-manipulator").experiment
    by_hand = MobileManipulator(experiment.reduced.robot.model)
    return Case("mobile-manipulator", experiment.reduced, experiment.q0, by_hand, free=False)


@cache
def free_panda() -> Case:
    """Panda on a free base with six momentum rows: hand and four joints, which are singular at some configurations."""
    reduced, bent = _panda(hand=True)
    by_hand = FreeArm(reduced.robot.model, base=6, hand="panda_hand", axes=3, joints=[6, 8, 10, 12])
    return Case("free-panda", reduced, bent, by_hand, free=True, regular=False)


@cache
def free_panda_joints() -> Case:
    """The same in its joints, which are regular everywhere."""
    reduced, bent = _panda(hand=False)
    by_hand = FreeArm(reduced.robot.model, base=6, hand="panda_hand", axes=0, joints=list(range(6, 13)))
    return Case("free-panda-joints", reduced, bent, by_hand, free=True)


def _panda(hand: bool) -> tuple[rnc.ReducedModel, np.ndarray]:
    fingers = {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}
    robot = rnc.Robot.from_example("panda", base="free", gravity=(0, 0, 0), lock=fingers)
    joints = [f"panda_joint{number}" for number in range(1, 8)]
    system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("root_joint")], joints)
    outputs = [rnc.FramePosition("panda_hand"), *map(rnc.JointPosition, joints[::2])] if hand else []
    reduced = system.reduce(outputs or [rnc.JointPosition(name) for name in joints])
    return reduced, robot.configuration(dict(zip(joints, (0.3, -0.6, 0.4, -1.8, 0.2, 1.4, 0.5), strict=True)))


CASES = {
    "space-robot": space_robot,
    "tiago": tiago,
    "mobile-manipulator": mobile_manipulator,
    "free-panda": free_panda,
    "free-panda-joints": free_panda_joints,
}
