"""Chaplygin's sleigh (1911): v = V tanh(a V t / c^2), w = (V / c) sech(a V t / c^2), c^2 = (I + m a^2) / m.

As in Neimark and Fufaev (1972) and Bloch (2003), a from the edge to the centre of mass. The trajectory in
tests/data/chaplygin_sleigh.json is the closed form evaluated with 30 digits.
"""

from __future__ import annotations

import json
from functools import cache

import numpy as np

import rnc_pin as rnc
from benchmarks.validation.row import DATA, MOTION, Row, conserved

SOURCE = "Chaplygin 1911, Neimark & Fufaev 1972"
REFERENCE = json.loads((DATA / "chaplygin_sleigh.json").read_text())
A, C = 0.3, np.sqrt((0.5 + 2 * 0.3**2) / 2)


@cache
def sleigh() -> rnc.ReducedModel:
    """Forward speed and heading as reducing outputs; nothing is driven."""
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
    return system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")], [rnc.FramePosition("sleigh", "xy")])


def rows() -> list[Row]:
    """Velocities, the whole change of heading, and a trajectory."""
    reduced = sleigh()
    q0 = reduced.robot.configuration()
    V, x0 = 1.2, 9.0  # from backing up, x0 time constants before the turn, to as long after it
    rate = A * V / C**2
    start = np.array([-V * np.tanh(x0), V / C / np.cosh(x0)])
    # Backing up is unstable, so an error in the spin, 3e-4 at first, grows by exp(9).
    run = rnc.free_motion(reduced, q0, start, 2 * x0 / rate, dt=0.05, tolerance=(1e-13, 1e-15))
    phase = rate * run.time - x0
    closed = np.column_stack([V * np.tanh(phase), V / C / np.cosh(phase)])
    # What is left of the turn before the start and after the end, in closed form.
    turned = run.x2[-1, 1] - run.x2[0, 1] + (C / A) * (np.pi - 4 * np.arctan(np.tanh(x0 / 2)))
    data = REFERENCE["trajectory"]
    free = rnc.free_motion(reduced, q0, np.array(data["v0"]), max(data["t"]), dt=0.005)
    every = np.searchsorted(free.time, np.array(data["t"]) - 1e-9)
    moved = np.column_stack([free.x1, free.x2[:, 1]])[every]
    return [
        Row(SOURCE, "sleigh: speed and spin through the turn", closed, run.v2, MOTION),
        Row(SOURCE, "sleigh: whole change of heading, pi c / a [rad]", np.pi * C / A, turned, MOTION),
        Row(SOURCE, "sleigh: place and heading over 10 s", data["q"], moved, MOTION),
        conserved("sleigh: energy", np.abs(run.energy / run.energy[0] - 1).max()),
    ]
