"""Logs of vehicles by textbook formulas, without rnc_pin: wheels, encoders and a sensor on the base, with noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

import rnc_pin as rnc
from rnc_pin.lab.calibration import EncoderOffset, EncoderScale, JointShift, SensorPlace, WheelRadius
from rnc_pin.lab.logs import Channel
from urdf_parts import joint, link, robot

STEP, ENCODERS, SENSOR = 1e-3, 20, 40  # period of the motion [s]; steps between samples of encoders and of the sensor
TICKS = 16384
POSITION, HEADING = 0.005, 0.002
"""Standard deviations of the measured pose [m, rad]."""
Numbers = Mapping[str, float]
Signal = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Vehicle:
    """Vehicle with parameters of its file, of the true robot, and its kinematics in closed form."""

    nominal: Numbers
    true: Numbers
    unknown: tuple[object, ...]  # what a calibration estimates, in the order of ``true``
    urdf: Callable[[Numbers], str]
    constraints: Callable[[Numbers], list[object]]
    # Twist (N, 3) of the base, and of joints rates (N,), or angles in a tuple, from numbers and two signals (N,).
    motion: Callable[[Numbers, list[np.ndarray]], tuple[np.ndarray, dict[str, object]]]

    def system(self, folder, numbers: Numbers | None = None) -> rnc.NonholonomicSystem:
        """The robot of the file, or one with other numbers, written to a folder."""
        numbers = self.nominal if numbers is None else numbers
        path = folder / "vehicle.urdf"
        path.write_text(self.urdf(numbers))
        return rnc.NonholonomicSystem(rnc.Robot.from_urdf(path, base="planar"), self.constraints(numbers))

    def log(self, seed, duration=30.0, noise=1.0, ticks=TICKS, inputs: Sequence[Signal] | None = None) -> rnc.Log:
        """Log of a motion of the true robot, by default a drawn one; ``ticks`` is zero for exact encoders."""
        generator = np.random.default_rng(seed)
        time = np.arange(round(duration / STEP) + 1) * STEP
        middle, true = time[:-1] + STEP / 2, dict(self.true)
        # Inputs in the middle of steps: a second-order rule, far finer than the samples.
        inputs = [signal(generator) for _ in range(2)] if inputs is None else inputs
        twist, joints = self.motion(true, [each(middle) for each in inputs])
        heading = np.concatenate([[0.0], np.cumsum(twist[:, 2] * STEP)])
        turn = heading[:-1] + twist[:, 2] * STEP / 2
        c, s = np.cos(turn), np.sin(turn)
        x = np.concatenate([[0.0], np.cumsum((c * twist[:, 0] - s * twist[:, 1]) * STEP)])
        y = np.concatenate([[0.0], np.cumsum((s * twist[:, 0] + c * twist[:, 1]) * STEP)])
        channels = []
        _, at_samples = self.motion(true, [each(time) for each in inputs])
        for name, rate in joints.items():
            is_angle = isinstance(rate, tuple)
            angle = at_samples[name][0] if is_angle else np.concatenate([[0.0], np.cumsum(rate * STEP)])
            angle = (angle - true.get(f"offset {name}", 0.0)) / true.get(f"scale {name}", 1.0)
            if ticks:
                angle = np.round(angle * ticks / (2 * np.pi)) * (2 * np.pi) / ticks
            channels.append(Channel("position", name, time[::ENCODERS], angle[::ENCODERS, None]))
        c, s = np.cos(heading), np.sin(heading)
        place = np.column_stack([x + c * true["sx"] - s * true["sy"], y + s * true["sx"] + c * true["sy"], heading])
        place = place[::SENSOR] + noise * generator.normal(size=place[::SENSOR].shape) * [POSITION, POSITION, HEADING]
        # The fixed frame of the poses is somewhere else.
        c, s = np.cos(0.7), np.sin(0.7)
        xy = place[:, :2] @ np.array([[c, s], [-s, c]]) + [3.0, -2.0]
        half = (place[:, 2] + 0.7) / 2
        zero = np.zeros(len(half))
        poses = np.column_stack([xy, zero, zero, zero, np.sin(half), np.cos(half)])
        return rnc.Log([*channels, Channel("pose", "sensor", time[::SENSOR], poses)])


def signal(generator: np.random.Generator) -> Signal:
    """Smooth signal between -1 and 1: a mean and three waves of 4 to 20 s."""
    size, period, phase = (generator.uniform(*ends, 3) for ends in ((0.1, 0.3), (4, 20), (0, 6)))
    rate = 2 * np.pi / period
    return lambda time: 0.1 + sum(a * np.sin(w * time + p) for a, w, p in zip(size, rate, phase, strict=True))


def _file(numbers: Numbers, *parts: tuple[str, str, tuple[float, ...], str]) -> str:
    """File of a base with a sensor, and bodies: parent, name, place and axis."""
    sensor = joint("sensor_joint", "base", "sensor", (numbers["sx"], numbers["sy"], 0.5), kind="fixed", effort=None)
    joints = (joint(f"{name}_joint", parent, name, at, axis, effort=None) for parent, name, at, axis in parts)
    bodies = (link(name) for _, name, _, _ in parts)
    return robot(link("base"), '<link name="sensor"/>', sensor, *bodies, *joints, name="vehicle")


Y, Z = "0 1 0", "0 0 1"
SX, SY = SensorPlace("x"), SensorPlace("y")


def _differential(p: Numbers, u: list[np.ndarray]) -> tuple[np.ndarray, dict[str, object]]:
    left, right = 4 * u[0] + 2, 4 * u[1] + 2
    speed, turn = (p["rl"] * left + p["rr"] * right) / 2, (p["rr"] * right - p["rl"] * left) / p["track"]
    return np.column_stack([speed, 0 * speed, turn]), {"left_joint": left, "right_joint": right}


DIFFERENTIAL = Vehicle(
    {"rl": 0.1, "rr": 0.1, "track": 0.5, "sx": 0.2, "sy": 0.0},
    {"rl": 0.103, "rr": 0.098, "track": 0.53, "sx": 0.25, "sy": -0.03},
    (WheelRadius("left"), WheelRadius("right"), JointShift({"left_joint": 0.5, "right_joint": -0.5}, "y"), SX, SY),
    lambda p: _file(p, ("base", "left", (0, p["track"] / 2, 0.1), Y), ("base", "right", (0, -p["track"] / 2, 0.1), Y)),
    lambda p: [rnc.RollingWheel("left", p["rl"]), rnc.RollingWheel("right", p["rr"])],
    _differential,
)


def _tricycle(p: Numbers, u: list[np.ndarray]) -> tuple[np.ndarray, dict[str, object]]:
    drive, steer = 6 * u[0] + 3, 0.8 * u[1]
    speed = p["r"] * drive
    twist = np.column_stack([speed * np.cos(steer), 0 * speed, speed * np.sin(steer) / p["base"]])
    return twist, {"fork_joint": (steer,), "front_joint": drive}


TRICYCLE = Vehicle(
    {"r": 0.12, "base": 1.4, "scale fork_joint": 1.0, "offset fork_joint": 0.0, "sx": 0.9, "sy": 0.0},
    {"r": 0.125, "base": 1.5, "scale fork_joint": 1.1, "offset fork_joint": -0.05, "sx": 1.0, "sy": 0.04},
    (WheelRadius("front"), JointShift("fork_joint", "x"), EncoderScale("fork_joint"), EncoderOffset("fork_joint"), SX,
     SY),
    lambda p: _file(p, ("base", "fork", (p["base"], 0, 0.12), Z), ("fork", "front", (0, 0, 0), Y),
                    ("base", "rear", (0, 0.4, 0.1), Y)),
    lambda p: [rnc.RollingWheel("front", p["r"]), rnc.RollingWheel("rear", 0.1)],
    _tricycle,
)  # fmt: skip


def _car(p: Numbers, u: list[np.ndarray]) -> tuple[np.ndarray, dict[str, object]]:
    speed, bend = 0.6 * u[0] + 0.3, 0.5 * u[1]
    joints: dict[str, object] = {}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        # No slip: each axle points to the centre (0, 1 / bend); a wheel goes as far as its distance from it.
        y = sign * p["front track"] / 2
        joints[f"{side}_steer_joint"] = (np.arctan2(bend * p["base"], 1 - bend * y),)
        joints[f"{side}_front_joint"] = speed * np.hypot(bend * p["base"], 1 - bend * y) / p["front"]
        joints[f"{side}_rear_joint"] = speed * (1 - bend * sign * 0.35) / p["rear"]
    return np.column_stack([speed, 0 * speed, speed * bend]), joints


CAR = Vehicle(
    {"rear": 0.15, "front": 0.15, "base": 1.1, "front track": 0.7, "offset left_steer_joint": 0.0, "sx": 0.5,
     "sy": 0.0},
    {"rear": 0.153, "front": 0.147, "base": 1.16, "front track": 0.74, "offset left_steer_joint": 0.03, "sx": 0.55,
     "sy": 0.02},
    (WheelRadius(["left_rear", "right_rear"]), WheelRadius(["left_front", "right_front"]),
     JointShift({"left_steer_joint": 1.0, "right_steer_joint": 1.0}, "x"),
     JointShift({"left_steer_joint": 0.5, "right_steer_joint": -0.5}, "y"),
     EncoderOffset("left_steer_joint"), SX, SY),
    lambda p: _file(
        p,
        *(("base", f"{side}_steer", (p["base"], s * p["front track"] / 2, 0.15), Z)
          for side, s in (("left", 1), ("right", -1))),
        *((f"{side}_steer", f"{side}_front", (0, 0, 0), Y) for side in ("left", "right")),
        *(("base", f"{side}_rear", (0, s * 0.35, 0.15), Y) for side, s in (("left", 1), ("right", -1))),
    ),
    # A lateral row of both steered wheels would leave a rank that changes with their angles.
    lambda p: [rnc.RollingWheel(f"{side}_{end}", p[end], lateral=(side, end) != ("right", "front"))
               for side in ("left", "right") for end in ("front", "rear")],
    _car,
)  # fmt: skip

VEHICLES = {"differential drive": DIFFERENTIAL, "tricycle": TRICYCLE, "car": CAR}
