"""Random drops with friction: the largest energy that appears, and what the runs cost.

Boxes, balls and disks with random coefficients, attitudes and velocities fall on the ground. Each drop prints when its
energy rises by more than rounding, or when it ends with an error.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from benchmarks.drops import body, energy

DT, SAMPLES, TOLERANCE = 0.02, 30, 1e-4


def drawn(generator: np.random.Generator) -> tuple[str, rnc.Robot, list[rnc.ConstraintKind], float]:
    """A kind of body, its robot, the contacts, and a height from which it falls [m]."""
    kind = str(generator.choice(["box", "ball", "disk"]))
    if kind == "disk":
        robot = rnc.Robot.from_urdf("rolling_disk.urdf", base="free")
        return kind, robot, [rnc.RollingWheel("disk", 0.25, axis="y")], float(generator.uniform(0.26, 0.5))
    half = generator.uniform(0.05, 0.2, 3)
    places = np.array([half * (1 - 2 * np.array([i & 1, i >> 1 & 1, i >> 2 & 1])) for i in range(8)])
    moments = (half @ half - half**2) / 3
    if kind == "ball":
        places, moments = np.zeros((1, 3)), np.full(3, 0.4 * 0.1**2)
    radius = 0.1 if kind == "ball" else 1e-3
    contacts = [rnc.RollingBall(f"point_{number}", radius) for number in range(len(places))]
    height = float(np.linalg.norm(half)) + radius + float(generator.uniform(0.1, 0.3))
    return kind, body(moments, places), contacts, height


def drop(seed: int) -> tuple[str, float, int, str]:
    """Kind of body, largest rise of its energy [J] over its energy at the start, landings, and the error if any."""
    generator = np.random.default_rng(seed)
    kind, robot, places, height = drawn(generator)
    e, friction = generator.uniform(0, 0.9), generator.uniform(0, 1.2)
    rolling, spin = generator.uniform(0, 0.01, 2) if kind == "ball" else (0.0, 0.0)
    contacts = [rnc.UnilateralContact(each, e, 0.1, friction, rolling, spin) for each in places]
    plant = rnc.FrictionPlant(rnc.NonholonomicSystem(robot), contacts, tolerance=TOLERANCE)
    size = 0.3 if kind == "disk" else 3.0  # a disk that falls flat has no defined contact
    turned = pin.Quaternion(pin.exp3(size * generator.uniform(-1, 1, 3) / np.sqrt(3))).coeffs()
    plant.reset(np.r_[0.0, 0.0, height, turned], generator.normal(size=6))
    start = lowest = energy(robot, plant)
    rise, error = -np.inf, ""
    try:
        for _ in range(SAMPLES):
            plant.advance(DT)
            now = energy(robot, plant)
            rise, lowest = max(rise, now - lowest), min(lowest, now)
    except rnc.RncError as failure:
        error = f"{type(failure).__name__}: {failure}"
    landings = sum(event.cause.startswith("landing") for event in plant.contact_events)
    return kind, rise / start, landings, error


def main() -> None:
    """Drop bodies and print the totals."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drops", type=int, default=1000, help="number of drops")
    parser.add_argument("--minutes", type=float, default=20.0, help="processor time after which no drop begins")
    given = parser.parse_args()
    began, worst, landings, errors, kinds = time.process_time(), -np.inf, 0, 0, Counter[str]()
    for seed in range(given.drops):
        if time.process_time() - began > 60 * given.minutes:
            break
        kind, rise, landed, error = drop(seed)
        kinds[kind] += 1
        landings, errors, worst = landings + landed, errors + bool(error), max(worst, rise)
        if error or rise > 1e-6:
            print(f"drop {seed}, {kind}: energy rises by {rise:.1e} of its start {error}", flush=True)
        if sum(kinds.values()) % 50 == 0:
            print(f"{sum(kinds.values())} drops, {landings} landings, largest rise {worst:.1e}", flush=True)
    spent = time.process_time() - began
    print(f"{dict(kinds)}: {landings} landings, {errors} errors, largest rise of energy {worst:.1e} of the start")
    print(f"tolerance {TOLERANCE:g} a second, samples of {DT:g} s, {spent / sum(kinds.values()):.2f} s a drop")


if __name__ == "__main__":
    main()
