"""Springs, dampers, friction, wrenches and laws of a user, against closed forms and Pinocchio's dynamics."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from refusals import refused
from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.forces import Damper, ForceFunction, SmoothFriction, Spring, Wrench
from rnc_pin.model.user_functions import gradient
from systems import arm_on_base, random_states
from textbook_systems import rail_sliders

HAND = rnc.FramePosition("tip", "xy")
FORCES = [Spring(rnc.Distance("base", "tip"), 40.0, 0.3), Spring(HAND, (5.0, 2.0), (0.1, -0.2))]
FORCES += [Damper(rnc.FrameSpeed("base"), 3.0), Damper(rnc.Distance("base", "tip"), 7.0)]
FORCES += [SmoothFriction(rnc.JointPosition("joint_1"), 2.0, 0.4), Wrench("tip", (1.0, -2.0, 0.5), (0.3, 0.2, 0.7))]
FORCES += [Wrench("base", (4.0, 1.0, 0.0), (0.0, 0.0, 0.6), axes="own")]
FORCES += [ForceFunction(lambda q, v: -0.2 * np.abs(v) * v - 0.1 * np.sin(q[0]) * v)]


def of_arm(forces):
    return arm_on_base(forces=forces).reduce([HAND, rnc.FrameSpeed("base"), rnc.FrameYaw("base")])


@pytest.fixture(scope="module")
def arm():
    return of_arm(FORCES)


def written_out(model, q, v):
    """The same forces from placements and velocities of Pinocchio alone."""
    data = model.createData()
    tip, base = model.getFrameId("tip"), model.getFrameId("base")
    pin.computeJointJacobians(model, data, q)
    pin.framesForwardKinematics(model, data, q)
    place = [data.oMf[frame].translation for frame in (base, tip)]
    J = [pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED) for frame in (base, tip)]
    across = place[1] - place[0]
    length = np.linalg.norm(across)
    along = across @ (J[1] - J[0])[:3] / length
    own = pin.getFrameJacobian(model, data, base, pin.LOCAL)
    first = model.joints[model.getJointId("joint_1")].idx_v
    force = -(40.0 * (length - 0.3) + 7.0 * along @ v) * along
    force -= J[1][:2].T @ (np.array([5.0, 2.0]) * (place[1][:2] - [0.1, -0.2]))
    force -= 3.0 * own[0] * (own[0] @ v)
    force[first] -= 2.0 * np.tanh(v[first] / 0.4)
    force += J[1].T @ [1.0, -2.0, 0.5, 0.3, 0.2, 0.7] + own.T @ [4.0, 1.0, 0.0, 0.0, 0.0, 0.6]
    return force - 0.2 * np.abs(v) * v - 0.1 * np.sin(q[0]) * v


def test_forces_and_motion_are_those_of_bodies_written_out(arm):
    model = arm.robot.model
    for q, v2 in random_states(arm, 5):
        T = np.random.default_rng(3).normal(size=arm.p)
        state = arm.at(q, v2)
        force = written_out(model, q, state.v)
        np.testing.assert_allclose(state.passive_force, force, atol=1e-12 * np.abs(force).max())
        A, A_dot = state.A, state.A_dot
        M, bias = pin.crba(model, model.createData(), q), pin.nonLinearEffects(model, model.createData(), q, state.v)
        whole = np.block([[np.triu(M) + np.triu(M, 1).T, A.T], [A, np.zeros((arm.m, arm.m))]])
        right = np.concatenate([state.B @ T + force - bias, -A_dot @ state.v])
        solution = np.linalg.solve(whole, right)
        np.testing.assert_allclose(state.acceleration(T), solution[: arm.n], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(state.multipliers(T), solution[arm.n :], rtol=1e-8, atol=1e-8)
        v2_dot = arm.forward_dynamics(q, v2, T)
        np.testing.assert_allclose(state.v_dot(v2_dot), solution[: arm.n], rtol=1e-9, atol=1e-9)
        terms, F = arm.terms(q, v2), arm.inverse_dynamics(q, v2, v2_dot)
        np.testing.assert_allclose(terms.H @ v2_dot + terms.V @ v2 + terms.G, F, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(F, terms.input_matrix @ T, rtol=1e-9, atol=1e-9)


def test_forces_of_a_user_stay_in_python():
    assert of_arm([]).reduction_data.forces.kernel_forces() == []
    assert of_arm([FORCES[0], FORCES[-1]]).reduction_data.forces.kernel_forces() is None


def test_derivatives_are_those_of_differences(arm):
    q, v2 = random_states(arm, 1, seed=4)[0]
    T, model = np.array([1.0, -0.5, 0.3, 0.7]), arm.robot.model
    found = state_derivatives(arm, q, v2, T)
    by_q = gradient(model, lambda p: arm.forward_dynamics(p, v2, T), q)
    by_v2 = np.stack([(arm.forward_dynamics(q, v2 + h, T) - arm.forward_dynamics(q, v2 - h, T)) / 2e-5
                      for h in 1e-5 * np.eye(arm.r)], axis=-1)  # fmt: skip
    np.testing.assert_allclose(found.v2_dot_q, by_q, rtol=1e-6, atol=1e-6 * np.abs(by_q).max())
    np.testing.assert_allclose(found.v2_dot_v2, by_v2, rtol=1e-6, atol=1e-6 * np.abs(by_v2).max())
    assert 0 < found.difference_error < 1e-3  # of the function of a user
    closed = of_arm(FORCES[:7])
    assert state_derivatives(closed, q, v2, T).difference_error == 0.0


def test_a_damped_oscillator_is_the_closed_form():
    """``x'' = -k (x - 0.5) - c x'``: its roots, its rest and its energy."""
    k, c = 30.0, 1.2
    robot, slider = rail_sliders(1), rnc.JointPosition("s0")
    forces = [Spring(slider, k, 0.5), Damper(slider, c)]
    reduced = rnc.NonholonomicSystem(robot, [], ["s0"], forces=forces).reduce()
    linear = rnc.linearize(reduced, np.array([0.5]))
    omega = np.sqrt(k - c**2 / 4)
    np.testing.assert_allclose(linear.eigenvalues, [-c / 2 - 1j * omega, -c / 2 + 1j * omega], rtol=1e-12)
    rest = rnc.equilibrium(rnc.NonholonomicSystem(robot, [], forces=forces).reduce(), np.array([2.0]))
    np.testing.assert_allclose(rest.q, [0.5], atol=1e-9)
    plant = rnc.ReducedPlant(reduced)
    plant.reset(np.array([1.5]), np.zeros(1))
    start = reduced.at(np.array([1.5]), np.zeros(1)).energy
    assert start == pytest.approx(0.5 * k)
    for _ in range(200):
        plant.advance(0.005)
    q, v = plant.read()
    expected = 0.5 + np.exp(-c / 2) * (np.cos(omega) + c / (2 * omega) * np.sin(omega))
    np.testing.assert_allclose(q, [expected], atol=1e-7)
    energy = reduced.at(q, v=v).energy
    assert energy - plant.work == pytest.approx(start, abs=1e-6)
    assert plant.work < -0.4 * start  # the damper's


def test_mujoco_moves_as_the_reduced_plant(robot):
    pytest.importorskip("mujoco")
    from rnc_pin.lab.mujoco import MuJoCoPlant

    drag = ForceFunction(lambda q, v: -3.0 * np.abs(v) * v, name="drag")
    forces = [Spring(rnc.JointPosition("joint_1"), 30.0, 0.4), Damper(rnc.Distance("platform_body", "tip"), 5.0),
              Wrench("tip", (3.0, 1.0, 0.0), axes="own"), drag]  # fmt: skip
    reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names, forces=forces).reduce()
    ends = []
    for plant in (rnc.ReducedPlant(reduced), MuJoCoPlant(reduced)):
        plant.reset(robot.configuration({"joint_2": 1.0, "joint_3": -0.5}), np.array([0.1, -0.3, 0.2, 0.0]))
        for _ in range(20):
            plant.advance(0.01)
        ends.append(np.concatenate(plant.read()))
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-4)


def test_scenario_files_have_forces_of_the_robot_and_of_the_plant_alone():
    both = {"spring": {"output": {"joint": "joint_2"}, "stiffness": 3.0}}
    alone = [
        {"wrench": {"frame": "tip", "force": [1, 0, 0]}},
        {"damper": {"output": {"joint": "joint_1"}, "damping": 2}},
    ]
    experiment = Scenario.load("mobile-manipulator", {"forces": [both], "faults.forces": alone}).experiment
    assert experiment.reduced.reduction_data.forces.names == ("spring(joint_2)",)
    plant = experiment.plant.plant.reduced
    assert plant.reduction_data.forces.names == ("spring(joint_2)", "wrench(tip)", "damper(joint_1)")
    uneven = {"spring": {**both["spring"], "stiffness": [1.0, 2.0]}}
    with pytest.raises(rnc.InputError, match=r"mobile-manipulator: spring\(joint_2\): stiffness"):
        Scenario.load("mobile-manipulator", {"forces": [uneven]}).build()


test_wrong_forces_are_refused_by_name = refused([
    (lambda: Spring(rnc.FrameSpeed("base"), 1.0), "quasi-velocity"),
    (lambda: Spring(HAND, (1.0, 2.0, 3.0)), "expected one finite number or 2"),
    (lambda: Damper(HAND, np.nan), "expected one finite number or 2"),
    (lambda: SmoothFriction(HAND, 1.0, 0.0), "expected a positive number"),
    (lambda: Wrench("tipp"), "did you mean 'tip'"),
    (lambda: Wrench("tip", axes="mine"), "expected 'world' or 'own'"),
    (lambda: ForceFunction(lambda q, v: v[:1]), r"returned shape \(1,\), expected \(5,\)"),
    (lambda: Spring, "expected an object with bind"),
    (lambda: HAND, "is no force"),
], lambda make: of_arm([make()]))  # fmt: skip


def test_a_force_on_a_conserved_momentum_is_refused(robot):
    momentum, joints = [rnc.MomentumConservation("platform")], robot.joint_names[1:]
    within = Spring(rnc.Distance("platform_body", "tip"), 3.0)
    assert "distance" in str(rnc.NonholonomicSystem(robot, momentum, joints, forces=[within]))
    with pytest.raises(rnc.ConstraintError, match=r"damper\(platform\) acts on momentum"):
        rnc.NonholonomicSystem(robot, momentum, joints, forces=[within, Damper(rnc.JointPosition("platform"), 1.0)])
