"""Drops of rods and boxes that do not slip: how many go on, and the largest rise of their energy.

    python -m benchmarks drops 120

Every second body is a rod with two ends, the others are boxes with eight corners, both of 1 kg. They fall from a height
of 1 m with random attitudes and velocities, for one second. All contacts of a body have one energetic coefficient of
restitution, drawn from 0, 0.3, 0.6, 0.9 and 1. A rise is that of the mechanical energy within a sample of 10 ms.
"""

from __future__ import annotations

import sys
from collections import Counter

import numpy as np
import pinocchio as pin

import rnc_pin as rnc

COEFFICIENTS = (0.0, 0.3, 0.6, 0.9, 1.0)
LENGTH, RADIUS, DT, SAMPLES = 0.5, 0.01, 0.01, 100


def body(inertia: np.ndarray, points: np.ndarray) -> rnc.Robot:
    """A free body of 1 kg with frames at points (k, 3) on it."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.diag(inertia)), pin.SE3.Identity())
    for k, point in enumerate(points):
        model.addFrame(pin.Frame(f"point_{k}", joint, 0, pin.SE3(np.eye(3), point), pin.FrameType.OP_FRAME))
    return rnc.Robot(model)


def drawn(number: int, generator: np.random.Generator) -> rnc.Robot:
    """A rod, or a box with random edges."""
    if number % 2 == 0:
        moment = LENGTH**2 / 12
        return body(np.array([1e-3, moment, moment]), np.array([[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]]) * LENGTH)
    edges = generator.uniform(0.1, 0.3, 3)
    signs = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
    return body(((edges**2).sum() - edges**2) / 12, signs * edges)


def energy(robot: rnc.Robot, plant: rnc.ContactPlant | rnc.FrictionPlant) -> float:
    """Mechanical energy of the state of a plant [J]."""
    data, (q, v) = robot.model.createData(), plant.read()
    return float(pin.computeKineticEnergy(robot.model, data, q, v) + pin.computePotentialEnergy(robot.model, data, q))


def dropped(number: int, generator: np.random.Generator) -> tuple[int, float]:
    """Number of events of a drop, and the largest rise of its energy [J]."""
    robot, e = drawn(number, generator), float(generator.choice(COEFFICIENTS))
    names = [frame.name for frame in robot.model.frames if frame.name.startswith("point_")]
    contacts = [rnc.UnilateralContact(rnc.RollingBall(name, RADIUS), restitution=e) for name in names]
    plant = rnc.ContactPlant(rnc.NonholonomicSystem(robot), contacts)
    turned = pin.Quaternion(pin.exp3(generator.normal(size=3))).coeffs()
    plant.reset(np.r_[0.0, 0.0, 1.0, turned], generator.normal(size=6))
    energies = [energy(robot, plant)]
    for _ in range(SAMPLES):
        plant.advance(DT)
        energies.append(energy(robot, plant))
    return len(plant.contact_events) - 1, float(np.diff(energies).max())


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 120
    generator, ends, events, rise = np.random.default_rng(0), Counter[str](), 0, 0.0
    for number in range(count):
        try:
            some, most = dropped(number, generator)
        except rnc.RncError as error:
            ends[f"{type(error).__name__}: {error}"] += 1
            continue
        ends["goes on"] += 1
        events, rise = events + some, max(rise, most)
    for end, times in ends.most_common():
        print(f"{times} of {count}: {end}")
    print(f"{events} events; largest rise of the energy in a sample {rise:.1e} J")


if __name__ == "__main__":
    main()
