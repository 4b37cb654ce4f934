"""An hour of control: does memory stay where it is?

    python -m benchmarks.soak --hours 1

A tracker goes round and round in a ``ControlLoop`` over measured q and v with noise and garbage; the memory of the
process is looked at every few simulated minutes.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

import rnc_pin as rnc
from rnc_pin.plants import FaultyPlant, ReducedPlant

DT = 0.01


def memory() -> float:
    """Of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def setting(dt: float = DT) -> tuple[rnc.ControlLoop, FaultyPlant]:
    """A sleigh that goes to and fro, and its loop."""
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    actuators = [rnc.FrameForce("sleigh", "x", limit=30.0), rnc.FrameTorque("sleigh", "z", limit=30.0)]
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
    reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
    swing = rnc.planning.Harmonic(np.zeros(2), [0.5, 0.8], [0.1, 0.07])
    target = rnc.control.ReducingOutputController(reduced, swing)
    tracker = rnc.control.VelocityTracker(target, rnc.control.VelocityGains(k=20.0, beta=20.0))
    faults = rnc.Faults(position_noise=1e-4, velocity_noise=1e-3, garbage=0.01)
    plant = FaultyPlant(ReducedPlant(reduced), faults, reduced, dt)
    plant.reset(robot.configuration(), np.zeros(3))
    return rnc.ControlLoop(reduced, tracker, dt), plant


def turn(loop: rnc.ControlLoop, plant: FaultyPlant, first: int, samples: int, dt: float = DT) -> float:
    """Go on for some samples; the largest velocity error meanwhile."""
    worst = 0.0
    for sample in range(first, first + samples):
        plant.apply(loop.step(sample * dt, *plant.read()))
        plant.advance(dt)
        assert loop.last is not None
        worst = max(worst, float(np.abs(loop.last.command.v2_desired - loop.last.measurement.v2).max()))
    return worst


def main() -> int:
    """Run, and say how memory went."""
    parser = argparse.ArgumentParser(description="An hour of control.")
    parser.add_argument("--hours", type=float, default=1.0)
    given = parser.parse_args()
    loop, plant = setting()
    total = round(3600 * given.hours / DT)
    block = max(1, total // 12)
    turn(loop, plant, 0, 1000)
    begin = memory()
    for first in range(1000, total, block):
        worst = turn(loop, plant, first, min(block, total - first))
        print(f"t = {first * DT / 60:6.1f} min: {memory():.1f} MB, velocity error at most {worst:.3f}", flush=True)
    grown = memory() - begin
    print(f"{total} steps, memory grew by {grown:.2f} MB")
    return 0 if grown < 1.0 else 1


if __name__ == "__main__":
    sys.exit(main())
