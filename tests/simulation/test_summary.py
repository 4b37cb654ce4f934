"""Figures of a run."""

from dataclasses import replace

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.simulation.summary import summarize
from simple_controllers import Inputs
from systems import space_robot_in_joints


def test_drift_is_the_energy_that_no_work_explains():
    reduced = space_robot_in_joints()
    q0, push = reduced.robot.configuration({"joint_2": 1.0}), Inputs(lambda t: np.array([1.0, 0.5, -0.4]))
    run = rnc.simulate(reduced, push, q0, duration=0.5, dt=0.01)
    exchanged = np.ptp(run.energy)
    assert exchanged > 1e-3
    assert run.constraint_residual.max() < 1e-9
    assert summarize(run)["energy_drift"] < 1e-9  # though its energy is not what it was
    lost = 0.25 * exchanged * np.linspace(0, 1, len(run.time)) ** 2
    assert summarize(replace(run, work=run.work + lost))["energy_drift"] == pytest.approx(0.25, abs=1e-9)
    assert summarize(replace(run, work=np.zeros_like(run.work)))["energy_drift"] == pytest.approx(1.0)
    constant = replace(run, energy=5.0 + 1e-9 * np.linspace(0, 1, len(run.time)), work=np.zeros_like(run.work))
    assert summarize(constant)["energy_drift"] == pytest.approx(2e-10)  # of the energy, not of its errors
