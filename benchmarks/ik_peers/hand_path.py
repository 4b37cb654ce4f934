"""Common task of all libraries: TIAGo draws a path with its hand and drives. Its wheels, limits and costs."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

import rnc_pin as rnc

HAND, BASE, RADIUS = "arm_tool_link", "base_link", 0.0985
WHEELS = ("wheel_left", "wheel_right")
DT, DURATION, GAIN = 0.01, 12.0, 5.0
DAMPING, ROLLING = 1e-4, 100.0
"""Weights of joint velocities, and of rolling where it is a cost, beside the weight 1 of the hand."""
_START = {"arm_1_joint": 0.7, "arm_2_joint": -0.5, "arm_3_joint": -1.2, "arm_4_joint": 1.9, "arm_5_joint": -1.0}
_PARTS = (0.0, 0.5, 1.0)  # of a sample, at which motion is measured


class Case(NamedTuple):
    """Robot, its rolling system, start, and the reference of the hand in the world."""

    robot: rnc.Robot
    reduced: rnc.ReducedModel
    q0: np.ndarray
    reference: rnc.planning.ViaPoints

    @property
    def joints(self) -> list[str]:
        """Joints other than the base."""
        return [name for name in self.robot.joint_names if name != "root_joint"]


class Motion(NamedTuple):
    """Configuration and velocity of the commanded motion, in Pinocchio's coordinates."""

    q: np.ndarray
    v: np.ndarray


class Follower(Protocol):
    """Library that computes a command from the configuration, once a sample."""

    name: str
    rolling: str

    def command(self, t: float) -> None:
        """Compute the command of the sample that starts at t [s]: what is timed."""

    def motion(self, elapsed: float) -> Motion:
        """Motion within the sample, as the library defines it."""

    def advance(self) -> None:
        """Go to the end of the sample."""


class Result(NamedTuple):
    """Errors of a run: of the hand, of rolling, and beyond limits."""

    hand_rms: float
    hand_max: float
    side_slip: float
    rolling_slip: float
    beyond_position: float
    beyond_velocity: float
    acceleration: float


def case() -> Case:
    """TIAGo without head, at the start of the path: forward to the left and up, back to the right and down, forward."""
    robot = rnc.Robot.from_example("tiago_no_hand", base="planar", lock={"head_1_joint": 0.0, "head_2_joint": -0.3})
    arm = [name for name in robot.joint_names if name != "root_joint" and not name.startswith("wheel")]
    rolling = [rnc.RollingWheel(f"{wheel}_link", RADIUS) for wheel in WHEELS]
    system = rnc.NonholonomicSystem(robot, rolling, [*(f"{wheel}_joint" for wheel in WHEELS), *arm])
    reduced = system.reduce([rnc.FrameSpeed(BASE), rnc.FrameYaw(BASE), *map(rnc.JointPosition, arm)])
    q0 = robot.configuration({"torso_lift_joint": 0.25, "arm_6_joint": 0.4, **_START})
    hand = reduced.at(q0).position.placement(robot.frame_id(HAND)).translation.copy()
    ways = [[0.0, 0.0, 0.0], [0.8, 0.5, 0.3], [0.3, -0.4, -0.2], [1.4, 0.2, 0.0]]
    return Case(robot, reduced, q0, rnc.planning.ViaPoints([0.0, 4.0, 8.0, DURATION], hand + np.array(ways)))


def followed(given: Case, follower: Follower) -> Result:
    """Follow the path to its end and measure every sample, with Pinocchio's frame velocities."""
    measure = _Measures(given)
    for sample in range(round(DURATION / DT)):
        follower.command(sample * DT)
        measure.add([follower.motion(part * DT) for part in _PARTS], (sample + 1) * DT)
        follower.advance()
    return measure.result()


class _Measures:
    """Errors along a run."""

    def __init__(self, given: Case) -> None:
        self._given, model = given, given.robot.model
        self._model, self._data = model, model.createData()
        self._hand = given.robot.frame_id(HAND)
        self._wheels = [given.robot.frame_id(f"{wheel}_link") for wheel in WHEELS]
        joints = [model.joints[given.robot.joint_id(name)] for name in given.joints]
        bounded = [joint for joint in joints if joint.nq == joint.nv]
        self._q, self._arm = [joint.idx_q for joint in bounded], [joint.idx_v for joint in bounded]
        self._v = [joint.idx_v for joint in joints]
        self._last: np.ndarray | None = None
        self._hands: list[float] = []
        self._worst = np.zeros(5)

    def add(self, motions: list[Motion], end: float) -> None:
        """Measure one sample, which ends at a time [s]."""
        model = self._model
        for q, v in motions:
            pin.forwardKinematics(model, self._data, q, v)
            pin.updateFramePlacements(model, self._data)
            slips = np.abs([self._slip(frame) for frame in self._wheels]).max(axis=0)
            low, high = model.lowerPositionLimit[self._q], model.upperPositionLimit[self._q]
            outside = np.maximum(low - q[self._q], q[self._q] - high).max()
            fast = (np.abs(v[self._v]) / model.upperVelocityLimit[self._v]).max() - 1.0
            self._worst[:4] = np.maximum(self._worst[:4], [*slips, outside, fast])
        goal = self._given.reference.at(end).position
        self._hands.append(float(np.linalg.norm(self._data.oMf[self._hand].translation - goal)))
        v = motions[-1].v[self._arm]
        if self._last is not None:
            self._worst[4] = max(self._worst[4], np.abs(v - self._last).max() / DT)
        self._last = v

    def _slip(self, frame: int) -> tuple[float, float]:
        """Velocity of the lowest point of a wheel, along its axle and along its heading [m/s]."""
        velocity = pin.getFrameVelocity(self._model, self._data, frame, pin.LOCAL_WORLD_ALIGNED)
        at_ground = velocity.linear + np.cross(velocity.angular, [0.0, 0.0, -RADIUS])
        axle = self._data.oMf[frame].rotation[:, 2]
        return float(axle @ at_ground), float(np.cross(axle, [0.0, 0.0, 1.0]) @ at_ground)

    def result(self) -> Result:
        hands = np.array(self._hands)
        return Result(float(np.sqrt(np.mean(hands**2))), float(hands.max()), *self._worst.tolist())
