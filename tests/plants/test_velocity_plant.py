"""Ideal velocity servos: an exact lag, exact constraints, and efforts that agree with the dynamics."""

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from controlled_tasks import reaching
from refusals import refused
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.plants import FaultyPlant, VelocityPlant


def reach():
    reduced, target, q0 = reaching(3.0)
    return reduced, target, rnc.control.ActuatorVelocityController(reduced, target), q0


def test_actuators_lag_exactly_and_constraints_hold():
    reduced = systems.mecanum()
    plant = VelocityPlant(reduced, servo_time=0.2)
    q0 = reduced.robot.configuration({"root_joint": [1.0, 2.0, 0.4]})
    w0, u = (reduced.at(q0).B.T @ reduced.at(q0, np.array(v2)).v for v2 in ([0.3, -0.2, 0.5], [0.1, 0.4, -0.6]))
    plant.reset(q0, reduced.at(q0, np.array([0.3, -0.2, 0.5])).v)
    plant.apply(u)
    for sample in range(1, 21):
        plant.advance(0.05)
        q, v = plant.read()
        assert reduced.at(q).B.T @ v == pytest.approx(u + np.exp(-0.05 * sample / 0.2) * (w0 - u), abs=1e-12)
        assert np.abs(reduced.at(q, v=v).residual).max() < 1e-12


def test_a_turning_base_draws_the_arc_of_its_speeds():
    reduced = systems.mecanum()
    plant = VelocityPlant(reduced, servo_time=1e-6)
    q0 = reduced.robot.configuration()
    plant.reset(q0, np.zeros(reduced.n))
    plant.apply(reduced.at(q0).B.T @ reduced.at(q0, np.array([0.5, 0.0, 0.8])).v)
    for _ in range(20):
        plant.advance(0.1)
    radius, angle = 0.5 / 0.8, 1.6
    q = plant.read()[0]
    assert q[:2] == pytest.approx([radius * np.sin(angle), radius * (1 - np.cos(angle))], abs=1e-5)


def test_efforts_give_the_acceleration():
    reduced = systems.mobile_manipulator()
    q0 = reduced.robot.configuration({"root_joint": [1.0, 0.5, 0.3], "joint_1": 0.5, "joint_2": -1.2})
    plant, step = VelocityPlant(reduced, servo_time=0.1), 1e-5
    v = reduced.at(q0, np.array([0.3, 0.2, 0.4, 0.5])).v
    plant.reset(q0, v)
    plant.apply(np.array([0.5, 0.4, -0.3, 1.0]))
    T = plant.effort
    plant.advance(step)
    accelerated = (plant.read()[1] - v) / step
    assert reduced.at(q0, v=v).acceleration(T) == pytest.approx(accelerated, rel=1e-3, abs=1e-3)


def test_a_simulation_follows_the_hand_and_records_efforts_that_move_it():
    reduced, target, controller, q0 = reach()
    run = rnc.simulate(reduced, controller, q0, 5.0, 0.01, plant=VelocityPlant(reduced, servo_time=0.1))
    assert run.outcome == rnc.Outcome.COMPLETED
    assert np.abs(run.x2[-1, :2] - target.primary.at(5.0).position[:2]).max() < 1e-3
    assert np.abs(run.x2 - run.x2_desired)[:, :2].max() < 0.05  # a lag of 0.1 s at 0.6 m/s
    # Energy balance: the work of the recorded efforts is the kinetic energy.
    w = np.array([reduced.at(q).B.T @ v for q, v in zip(run.q, run.v, strict=True)])
    power = np.vecdot(run.T, w)
    work = np.concatenate([[0.0], np.cumsum(0.5 * 0.01 * (power[1:] + power[:-1]))])
    assert np.ptp(run.energy - work) < 0.1 * np.ptp(run.energy)


def test_lost_measurements_stop_the_robot_but_not_the_run():
    reduced, target, controller, q0 = reach()
    generator = np.random.default_rng(3)

    class Blind(FaultyPlant):
        def read(self):
            q, v = super().read()
            return (np.full_like(q, np.nan), v) if generator.random() < 0.2 else (q, v)

    blind = Blind(VelocityPlant(reduced), rnc.Faults(), reduced)
    run = rnc.simulate(reduced, controller, q0, 4.0, 0.01, plant=blind)
    assert run.outcome == rnc.Outcome.COMPLETED
    assert np.abs(run.x2[-1, :2] - target.primary.at(4.0).position[:2]).max() < 0.02


test_scenarios_that_mix_forces_and_velocities_are_refused = refused([
    ({"controller.tracker": "velocity"}, "'velocity' requires velocity servos: set plant.servo_time"),
    ({"plant": {"type": "reduced", "servo_time": 0.02}}, "plant.servo_time: requires controller.tracker"),
    ({"plant": {"type": "mujoco", "servo_time": 0.02}}, "'servo_time' belongs to the type 'reduced'"),
    ({"plant": {"type": "reduced", "step": 0.02}}, "'step' belongs to the type 'mujoco'"),
    ({"controller.tracker": "velocity", "plant": {"type": "reduced", "servo_time": 0.02},
        "simulation.joint_damping": True}, "joint_damping: has no effect on ideal velocity servos"),
    ({"controller.tracker": "velocity", "plant": {"type": "reduced", "servo_time": 0.02}, "faults": {"effort": 2.0}},
        "effort is a limit of forces"),
    ({"controller.tracker": "velocity", "controller.gravity_compensation": True}, "which gives no forces"),
], lambda changes: Scenario.load("mobile-manipulator", {**changes, "comparisons": {}}).build(),
    rnc.ConfigurationError)  # fmt: skip
