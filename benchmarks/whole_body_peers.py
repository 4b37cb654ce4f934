"""Whole-body control of an arm at acceleration level here, by placo and by TSID: tasks, limits and plant are the same.

Peers live in environments of their own, because they need other versions of Pinocchio: ``placo==0.10.2``, and
``tsid==1.7.1`` with ``pin==3.4.0``, ``cmeel-urdfdom<5`` and ``cmeel-tinyxml2<11``. The variables ``RNC_PIN_PLACO`` and
``RNC_PIN_TSID`` name their interpreters. Their torques are replayed here before their times count.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

import rnc_pin as rnc
from benchmarks.peers.environments import answer
from rnc_pin.control import InverseDynamicsQP, limits, tasks
from rnc_pin.motion.planning import Harmonic
from rnc_pin.robots.robot_files import find_example

_SCRIPT = Path(__file__).parent / "peers" / "whole_body_arm.py"
_DT, _SAMPLES, _ROUNDS, _HAND = 0.002, 1000, 3, "panda_hand"
_RATE = 20.0  # [1/s] of positions and of velocities: stiffness 400 and damping 40 in the terms of the peers
_WEIGHTS = 1.0, 1e-3  # of the hand and of the posture
_START = [0.0, -0.6, 0.0, -2.0, 0.0, 1.5, 0.7]
_FOLLOWED = 0.02  # [m], largest error of a hand that follows


def _file(folder: str) -> Path:
    """URDF of the arm, its fingers fixed, without shapes."""
    tree = ElementTree.parse(find_example("panda")[0])
    for link in tree.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    for joint in tree.iter("joint"):
        if "finger" in joint.attrib["name"]:
            joint.attrib["type"] = "fixed"
    path = Path(folder) / "robot.urdf"
    tree.write(path)
    return path


def whole_body_peers() -> None:
    """Print the processor time of a sample, the error of the hand and the use of limits, here and for the peers."""
    with tempfile.TemporaryDirectory() as folder:
        _compare(_file(folder))


def _compare(path: Path) -> None:
    robot = rnc.Robot.from_urdf(str(path), base="fixed")
    reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce()
    q0 = np.array(_START)
    here = reduced.at(q0).position.placement(robot.frame_id(_HAND)).translation.copy()
    circle = Harmonic(here, [0.0, 0.1, 0.1], 0.5, [0.0, 0.0, np.pi / 2])
    wanted = [list(circle.at(sample * _DT)[:3]) for sample in range(_SAMPLES)]
    posture = tasks.PostureTask(dict(zip(robot.joint_names, _START, strict=True)), gain=_RATE, weight=_WEIGHTS[1])
    follow = tasks.OutputTask(rnc.FramePosition(_HAND), circle, gain=_RATE, weight=_WEIGHTS[0])
    print(f"Panda, hand on a circle, posture, limits of the file; {_SAMPLES} samples of {1e3 * _DT:.0f} ms")
    print("processor time of a sample in Python, least of rounds; largest error of the hand; largest use of limits")
    for braking in (None, 2.0):
        given = [limits.JointPositionLimit(), limits.JointVelocityLimit()]
        qp = InverseDynamicsQP(reduced, [follow, posture], given, dt=_DT, velocity_gain=_RATE, braking_time=braking)
        used, efforts = min((_run(qp, reduced, q0) for _ in range(_ROUNDS)), key=lambda each: each[0])
        verified = "" if braking is None else ", with a verified braking motion"
        _report(f"here{verified}", used, efforts, reduced, wanted)
    problem = {
        "urdf": str(path),
        "joints": list(robot.joint_names),
        "hand": _HAND,
        "q": _START,
        "dt": _DT,
        "rounds": _ROUNDS,
        "stiffness": _RATE**2,
        "damping": 2.0 * _RATE,
        "weights": _WEIGHTS,
        "efforts": robot.model.upperEffortLimit.tolist(),
        "velocities": robot.model.upperVelocityLimit.tolist(),
        "reference": [[each.tolist() for each in point] for point in wanted],
    }
    for peer in ("placo", "tsid"):
        found = answer(peer, f"RNC_PIN_{peer.upper()}", _SCRIPT, problem, peer)
        if found is not None:
            _report(f"{peer} {found['version']}", found["time"], np.array(found["efforts"]), reduced, wanted)


def _run(program: InverseDynamicsQP, reduced: rnc.ReducedModel, q: np.ndarray) -> tuple[float, np.ndarray]:
    """Processor time of a sample [s], and the torques of all samples."""
    plant, used, efforts = rnc.ReducedPlant(reduced), 0.0, []
    plant.reset(q, np.zeros(reduced.robot.nv))
    state = program.initial_state(reduced.at(q, np.zeros(reduced.r)).measure())
    for sample in range(_SAMPLES):
        q, v = plant.read()
        measurement = reduced.at(q, v=v).measure()
        begin = time.process_time()
        command, state = program.step(sample * _DT, measurement, state)
        used += time.process_time() - begin
        efforts.append(np.array(command.T))
        plant.apply(efforts[-1])
        plant.advance(_DT)
    return used / _SAMPLES, np.array(efforts)


def _report(name: str, used: float, efforts: np.ndarray, reduced: rnc.ReducedModel, wanted: list[list[Any]]) -> None:
    """Print what torques do on the plant, whoever computed them."""
    robot, plant = reduced.robot, rnc.ReducedPlant(reduced)
    plant.reset(np.array(_START), np.zeros(robot.nv))
    hand, model, error, speed, beyond = robot.frame_id(_HAND), robot.model, 0.0, 0.0, -np.inf
    for T, (position, *_) in zip(efforts, wanted, strict=True):
        q, v = plant.read()
        error = max(error, float(np.linalg.norm(reduced.at(q).position.placement(hand).translation - position)))
        speed = max(speed, float(np.max(np.abs(v) / model.upperVelocityLimit)))
        outside = np.maximum(model.lowerPositionLimit - q, q - model.upperPositionLimit)
        beyond = max(beyond, float(outside.max()))
        plant.apply(T)
        plant.advance(_DT)
    effort = float(np.max(np.abs(efforts) / model.upperEffortLimit))
    kept = "" if error < _FOLLOWED and max(effort, speed) < 1.0 + 1e-6 and beyond < 1e-6 else ", does NOT do the task"
    uses = f"velocity {speed:.0%}, effort {effort:.0%}, {-beyond:.3f} rad inside positions"
    print(f"  {name}: {1e6 * used:.0f} us; {1e3 * error:.2f} mm; {uses}{kept}", flush=True)
