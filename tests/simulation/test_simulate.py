"""The sampled loop and the integrator under it."""

import json

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import free_body
from places import DATA
from rnc_pin.model.integrators import LieRungeKutta4
from rnc_pin.simulation import run_data
from simple_controllers import Idle, Inputs, Memoryless
from systems import ALL, four_bar, mobile_manipulator, random_states, space_robot, space_robot_in_joints
from tolerances import REFERENCE_SIMULATION


def integrate(reduced, q, v2, T, duration, steps):
    def rate(p, y):
        v, v2_dot, _ = reduced.at(p, y).flow(T)
        return v, v2_dot

    integrator, h = LieRungeKutta4(reduced.robot), duration / steps
    for _ in range(steps):
        q, v2 = integrator.step(rate, q, v2, h)
    return q, v2


@pytest.mark.parametrize("name", ["four_bar", "free_flying_panda", "leaning_wheel", "mecanum", "spinning_space_robot"])
def test_integrator_has_order_four_on_every_kind_of_joint(name):
    reduced = ALL[name]()
    q, v2 = random_states(reduced, 1, seed=5)[0]
    # A long enough step for the error to stand above rounding, a short enough one for its order to show.
    v2 = 0.7 * v2 / np.linalg.norm(reduced.terms(q, v2).v)
    T = 0.3 * np.ones(reduced.p)
    scale = np.abs(reduced.forward_dynamics(q, v2, T)).max()
    duration = 0.4 / max(1.0, np.sqrt(scale))
    exact_q, exact_v2 = integrate(reduced, q, v2, T, duration, 64)
    errors = []
    for steps in (4, 8):
        end_q, end_v2 = integrate(reduced, q, v2, T, duration, steps)
        gap = pin.difference(reduced.robot.model, end_q, exact_q)
        errors.append(np.linalg.norm(gap) + np.linalg.norm(end_v2 - exact_v2) / max(1.0, scale))
    assert errors[0] > 1e-12, "too exact to tell the order"
    assert np.log2(errors[0] / errors[1]) > 3.7


def test_reference_simulation_of_the_space_robot():
    """Open loop, against an order-20 integrator with 30 digits (tests/data)."""
    data = json.loads((DATA / "space_robot.json").read_text())["simulation"]
    reduced, dt = space_robot_in_joints(), 2e-3

    def torque(t):
        return np.array([2 * np.sin(t), -1.5 * np.cos(2 * t), 0.7 * np.sin(3 * t)])

    # The data have smooth torques, so integrate them as such: time goes along as a state.
    def rate(q, y):
        v, v2_dot, _ = reduced.at(q, y[:3]).flow(torque(y[3]))
        return v, np.append(v2_dot, 1.0)

    integrator = LieRungeKutta4(reduced.robot)
    q, y = np.array(data["q0"]), np.append(data["v0"], 0.0)
    for k, t in enumerate(data["t"]):
        while y[3] < t - dt / 2:
            q, y = integrator.step(rate, q, y, dt)
        np.testing.assert_allclose(q, data["q"][k], atol=REFERENCE_SIMULATION)
        np.testing.assert_allclose(y[:3], data["v"][k], atol=REFERENCE_SIMULATION)


def test_inputs_are_held_between_samples():
    reduced = space_robot_in_joints()
    q0 = reduced.robot.configuration({"joint_2": 1.0})
    pulse = Inputs(lambda t: np.array([1.0, 0.0, 0.0]) if 0.05 <= t < 0.06 - 1e-9 else np.zeros(3))
    run = rnc.simulate(reduced, pulse, q0, duration=0.1, dt=0.01)
    held_q, held_v2 = integrate(reduced, q0, np.zeros(3), np.array([1.0, 0, 0]), 0.01, 1)
    np.testing.assert_allclose(run.q[6], held_q, atol=1e-15)
    np.testing.assert_allclose(run.v2[6], held_v2, atol=1e-15)
    assert np.abs(run.v2[5]).max() == 0


def test_singularity_in_a_simulation_carries_its_time():
    reduced = space_robot()

    class Straight(Idle):
        def step(self, t, measurement, state):
            if t > 0.015:
                reduced.forward_dynamics(reduced.robot.configuration(), np.zeros(3), np.zeros(3))
            return super().step(t, measurement, state)

    q0 = reduced.robot.configuration({"joint_2": 1.0, "joint_3": 1.0})
    with pytest.raises(rnc.SingularityError) as caught:
        rnc.simulate(reduced, Straight(3), q0, 1.0)
    error = caught.value
    assert error.time == pytest.approx(0.016)
    assert error.condition > 1e8
    assert error.rows == ("tip_x",)  # the arm is straight, along x
    assert error.trajectory.outcome is rnc.Outcome.SINGULAR


@pytest.mark.parametrize("speed", [1e9, np.inf, np.nan])
def test_a_step_without_bound_is_said_rather_than_taken(speed):
    reduced = mobile_manipulator()
    integrator = LieRungeKutta4(reduced.robot)
    with pytest.raises(rnc.DivergenceError, match=r"one step of 0\.1 s would move by"):
        integrator.step(lambda q, y: (np.full(5, speed), y), reduced.robot.configuration(), np.zeros(1), 0.1)


def test_a_free_motion_knows_the_same_plant_and_the_same_end():
    model = pin.Model()
    joint = model.addJoint(
        0, pin.JointModelPX(), pin.SE3.Identity(), "slide", np.array([2.0]), np.array([9.0]), *np.array([[-1.0], [1.0]])
    )
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(4.0, 0.1), pin.SE3.Identity())
    reduced = rnc.NonholonomicSystem(rnc.Robot(model), [], ["slide"]).reduce()
    mass = float(reduced.at(np.zeros(1)).H[0, 0])
    plant, push = rnc.ReducedPlant(reduced, actuator_limits=True), np.array([3.0])
    run = rnc.free_motion(plant, np.zeros(1), np.zeros(1), 1.0, 0.1, push)
    np.testing.assert_array_equal(run.T, 2.0)
    np.testing.assert_allclose(run.q[:, 0], run.time**2 / mass, atol=1e-9)
    with pytest.raises(rnc.LimitError, match=r"joint 'slide' left its range \[-1, 1\]") as end:
        rnc.free_motion(
            plant, np.zeros(1), np.zeros(1), 9.0, 0.1, push,
            options=rnc.SimulationOptions(rnc.Stop(position_limits=True)),
        )  # fmt: skip
    assert end.value.trajectory.q.max() <= 1.0
    ended = end.value.trajectory  # it has all samples before the stop, and none of those computed with them
    assert len(ended.time) in (20, 21)  # at 2 s it is at the limit, to rounding
    np.testing.assert_allclose(ended.q[:, 0], ended.time**2 / mass, atol=1e-9)
    np.testing.assert_array_equal(ended.T, 2.0)
    with pytest.raises(rnc.InputError, match="has to be positive, found 0"):
        rnc.Stop(speed=0)


def test_a_roll_out_keeps_loops_closed():
    reduced = four_bar()
    q0 = reduced.assembled(reduced.robot.configuration({"crank": 0.3, "coupler": 0.5, "rocker": 1.5}))
    crank = reduced.at(q0).outputs()[1]

    turn = Memoryless(lambda *_: rnc.control.VelocityTarget(v2=np.array([4.0]), v2_dot=np.zeros(1)))
    _, path = rnc.kinematic_rollout(reduced, turn, q0, 1.2, 0.1)
    assert abs(reduced.at(path[-1]).outputs()[1] - crank) > 1.0
    assert np.abs(reduced.assembly.residual(path)).max() < 1e-10


def test_a_run_stops_where_a_contact_would_pull():
    """A pull that grows as 100 t lifts a ball of 2 kg from its rolling contact when it equals the weight."""
    robot = free_body(2.0, 0.008, ball=[0, 0, 0])
    rolling = rnc.NonholonomicSystem(robot, [rnc.RollingBall("ball", 0.1)], [rnc.FrameForce("ball", "z")]).reduce()
    q0 = robot.configuration({"root_joint": [0, 0, 0.1, 0, 0, 0, 1]})
    options = rnc.SimulationOptions(rnc.Stop(lift_off=True))
    with pytest.raises(rnc.LimitError, match=r"contact 'ball' lifts off at t = 0\.200 s") as caught:
        rnc.simulate(rolling, Inputs(lambda t: [100.0 * t]), q0, 1.0, 0.01, options=options)
    assert len(caught.value.trajectory.time) == 20
    with pytest.raises(rnc.LimitError, match=r"lifts off at t = 0\.000 s"):
        rnc.free_motion(rolling, q0, np.zeros(3), 0.1, inputs=[30.0], options=options)


def test_blocks_of_samples_give_what_the_whole_run_gives(monkeypatch):
    reduced, runs = space_robot_in_joints(), []
    push = Inputs(lambda t: np.array([np.sin(3 * t), 0.5, -0.4]))
    for length in (1000, 7):
        monkeypatch.setattr(run_data, "_BLOCK", length)
        runs.append(rnc.simulate(reduced, push, reduced.robot.configuration({"joint_2": 1.0}), 0.3, 0.01))
    for values, whole in zip(*(run.arrays.values() for run in runs), strict=True):
        np.testing.assert_allclose(values, whole, rtol=1e-9, atol=1e-9 * np.abs(whole[:1]).max(initial=1.0))
    longest = max(each.stop - each.start for each in run_data.blocks(10**4, 50_000))
    assert 1 < longest <= 16e6 / (8 * 50_000)  # bytes of a block
