"""Velocity-commanded robots in MuJoCo: the hand follows, and wheels give the commanded twist."""

import numpy as np
import pytest

import rnc_pin as rnc
import systems

pytest.importorskip("mujoco", reason="comes with the extra mujoco")

from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.plants.mujoco import MuJoCoPlant, MuJoCoSettings

FAST = {"step": 0.002, "integrator": "implicitfast"}


def test_a_differential_drive_moves_as_commanded_with_little_slip():
    reduced = systems.differential_drive()
    plant = MuJoCoPlant(reduced, MuJoCoSettings(servo_time=0.02, integrator="implicitfast"))
    plant.set_actuator_friction(0.05)
    way = rnc.planning.MinimumJerk(np.zeros(2), [0.8, 0.6], duration=2.0)
    loop = rnc.VelocityLoop(reduced, rnc.control.ReducingOutputController(reduced, way), 0.02)
    plant.reset(reduced.robot.configuration(), np.zeros(5))
    slip, missed = 0.0, 0.0
    for sample in range(125):
        command = loop.step(0.02 * sample, *plant.read())
        assert np.abs(reduced.at(plant.read()[0], v=command.v).residual).max() < 1e-12  # no slip by construction
        plant.apply(command.u)
        plant.advance(0.02)
        v = plant.read()[1]
        missed = max(missed, np.abs(v[[0, 2]] - [command.twist.forward, command.twist.yaw]).max())
        slip = max(slip, np.abs(plant.slip()).max())
    assert loop.state.fault is None
    assert np.abs(loop.last.measurement.x2 - [0.8, 0.6]).max() < 2e-3
    assert missed < 0.02  # of 0.75 m/s: the lag of the servos
    assert 0 < slip < 5e-3
    assert plant.servos.joints == ("left_wheel_joint", "right_wheel_joint")
    assert np.abs(plant.effort).max() > 0  # of the friction, at rest


def test_servos_stand_still_at_zero_velocity_against_gravity():
    """The integral action carries the weight: a velocity gain alone lets the arm sink."""
    robot = rnc.Robot.from_example("ur5_robot")
    reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce()
    q0 = robot.configuration({"shoulder_lift_joint": -0.6, "elbow_joint": 1.0})
    plant = MuJoCoPlant(reduced, MuJoCoSettings(servo_time=0.02, **FAST), q0)
    plant.reset(q0, np.zeros(6))
    for _ in range(50):
        plant.apply(np.zeros(6))
        plant.advance(0.01)
    q, v = plant.read()
    assert np.abs(v).max() < 1e-3
    assert np.abs(q - q0).max() < 5e-3
    assert plant.effort == pytest.approx(reduced.inverse_dynamics(q, np.zeros(6), np.zeros(6)), abs=0.1)


def test_the_hand_of_a_mobile_manipulator_follows_with_friction():
    reduced = systems.mobile_manipulator()
    task = rnc.Task.of(reduced, ["tip_x", "tip_y", "base_yaw"], ["base_speed_x"], ["distance_base_tip"])
    q0 = reduced.robot.configuration({"joint_1": 0.5, "joint_2": -1.2})
    x1, x2 = reduced.at(q0).outputs()
    way = rnc.planning.MinimumJerk(x2[task.primary], x2[task.primary] + [0.6, 0.3, 0.2], duration=2.0)
    target = rnc.control.RedundancyController(task, way, rnc.planning.Hold(x1[task.vertical]), k21=2.0)
    plant = MuJoCoPlant(reduced, MuJoCoSettings(servo_time=0.02, **FAST), q0)
    plant.set_actuator_friction(0.5)
    controller = rnc.control.ActuatorVelocityController(reduced, target)
    run = rnc.simulate(reduced, controller, q0, 3.0, 0.02, plant=plant)
    assert run.outcome == rnc.Outcome.COMPLETED
    assert np.abs(run.x2 - run.x2_desired)[:, :2].max() < 0.02  # servo and sample lag at up to 0.6 m/s
    assert np.abs(run.x2 - run.x2_desired)[-1, :2].max() < 2e-3
    assert np.abs(run.x1 - run.x1_desired)[:, 0].max() < 5e-3
    assert 0 < np.abs(run.slip).max() < 1e-3
    assert np.abs(run.T[10:-10, 2:]).max() > 0.4  # friction


def test_limits_of_a_velocity_program_hold_in_mujoco():
    """Wheel speeds and a wall in front of the base limit the motion; the outer wheel turns faster in the curve."""
    reduced = systems.differential_drive()
    wanted = [
        rnc.control.tasks.OutputTask(rnc.FrameSpeed("base"), rnc.planning.MinimumJerk([0.0], [1.5], duration=2.0)),
        rnc.control.tasks.OutputTask(rnc.FrameYaw("base"), rnc.planning.MinimumJerk([0.0], [0.5], duration=1.5),
            gain=3.0),
    ]  # fmt: skip
    allowed = [
        rnc.control.limits.JointVelocityLimit(["left_wheel_joint", "right_wheel_joint"], 6.0, margin=0.05),
        rnc.control.limits.AccelerationLimit(1.0),
        rnc.control.limits.RegionLimit("base", box={"x": (-1.0, 0.5)}, gain=1.5),
    ]
    program = rnc.control.VelocityQP(reduced, wanted, allowed, dt=0.02)
    plant = MuJoCoPlant(reduced, MuJoCoSettings(servo_time=0.02, **FAST))
    controller = rnc.control.ActuatorVelocityController(reduced, program)
    run = rnc.simulate(reduced, controller, reduced.robot.configuration(), 1.6, 0.02, plant=plant)
    assert run.outcome == rnc.Outcome.COMPLETED
    base, wheels = run.q[:, 0], np.abs(run.v[:, 3:])
    assert 0.4 < base.max() < 0.5
    assert 5.6 < wheels.max() < 6.0
    assert 0 < np.abs(run.slip).max() < 0.02  # m/s, in the first samples; the base moves at up to 0.55 m/s


def test_effort_limits_of_servos_hold():
    reduced = systems.differential_drive()  # 20 N m each
    plant = MuJoCoPlant(reduced, MuJoCoSettings(servo_time=0.02, effort_limits=True, **FAST))
    plant.reset(reduced.robot.configuration(), np.zeros(5))
    plant.apply(np.array([25.0, 25.0]))
    assert plant.effort == pytest.approx([20.0, 20.0])
    plant.advance(0.01)
    assert np.abs(plant.data.actuator_force).max() <= 20.0


def test_a_step_that_is_too_long_for_the_servos_is_refused():
    reduced = systems.differential_drive()
    with pytest.raises(rnc.ConfigurationError, match=r"servo_time 0.0005 s is too short for integrator 'RK4'.*step"):
        MuJoCoPlant(reduced, MuJoCoSettings(servo_time=0.0005))
    MuJoCoPlant(reduced, MuJoCoSettings(servo_time=0.0005, integrator="implicitfast"))
    for wrong in (0.0, True, np.nan, "fast"):
        with pytest.raises(rnc.ConfigurationError, match="servo_time: expected a positive number, found"):
            MuJoCoSettings(servo_time=wrong)


def test_a_scenario_runs_velocity_commands():
    changes = {"controller": {"type": "redundancy", "tracker": "velocity", "k21": 2.0}, "simulation.dt": 0.02}
    changes |= {"simulation.duration": 2.0, "reference.primary.minimum_jerk.by": [0.6, 0.3, 0.2]}
    changes |= {"reference.primary.minimum_jerk.duration": 1.5, "comparisons": {}}
    for plant in ({"type": "reduced", "servo_time": 0.02}, {"type": "mujoco", "servo_time": 0.02, **FAST}):
        experiment = Scenario.load("mobile-manipulator", {**changes, "plant": plant}).experiment
        run = rnc.simulate(experiment.reduced, experiment.controller, experiment.q0, 2.0, 0.02, plant=experiment.plant)
        assert run.outcome == rnc.Outcome.COMPLETED
        assert np.abs(run.x2 - run.x2_desired)[-1, :2].max() < 5e-3


@pytest.mark.parametrize(("changes", "words"), [
    ({"controller.tracker": "velocity"}, "'velocity' requires velocity servos: set plant.servo_time"),
    ({"plant": {"type": "reduced", "servo_time": 0.02}}, "plant.servo_time: requires controller.tracker"),
    ({"plant": {"type": "reduced", "step": 0.02}}, "'step' belongs to the type 'mujoco'"),
    ({"controller.tracker": "velocity", "plant": {"type": "reduced", "servo_time": 0.02},
        "simulation.joint_damping": True}, "joint_damping: has no effect on ideal velocity servos"),
    ({"controller.tracker": "velocity", "plant": {"type": "reduced", "servo_time": 0.02}, "faults": {"effort": 2.0}},
        "effort and dead_zone are those of forces"),
    ({"controller.tracker": "velocity", "controller.gravity_compensation": True}, "which gives no forces"),
])  # fmt: skip
def test_scenarios_that_mix_forces_and_velocities_are_refused(changes, words):
    with pytest.raises(rnc.ConfigurationError, match=words):
        Scenario.load("mobile-manipulator", {**changes, "comparisons": {}}).build()
