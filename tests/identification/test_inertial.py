"""Inertial identification: exact from exact logs, refused where a log does not show a parameter."""

import numpy as np
import pinocchio as pin
import pytest
import scipy

import rnc_pin as rnc
from benchmarks.identification import (
    ARM,
    JOINTS,
    arm,
    better,
    floating,
    floating_error,
    floating_log,
    parameters,
    tiago,
)
from measured_logs import MEASURED
from rnc_pin.identification import (
    BodyInertia,
    CoulombFriction,
    EffortOffset,
    EffortScale,
    MotorInertia,
    ViscousFriction,
)
from rnc_pin.identification.inertial_fit import InertiaPrior, dynamic_parameters, pseudo_inertia
from rnc_pin.identification.reduced_regressor import BaseParameters, ReducedRegressor, WindowAverages
from systems import four_bar

SIDES = ("left", "right")
DRY, VISCOUS, MOTOR = np.array([0.3, 0.2, 0.1]), np.array([0.5, 0.4, 0.2]), np.array([0.05, 0.02, 0.03])


def fixed_arm_log(noise=0.0, seed=0, moving=(1.0, 1.0, 1.0), scale=(1.0, 1.0, 1.0), seconds=16.0):
    """Log of the arm on the ground with friction and motors, by Pinocchio's inverse dynamics at known accelerations."""
    robot = arm(base=False)
    model, data = robot.model, robot.model.createData()
    time = np.arange(0.0, seconds, 0.005)[:, None]
    rates, sizes = 2 * np.pi * np.array([[0.31, 0.47, 0.67], [0.73, 0.29, 0.41]]), np.array([1.0, 0.6]) * 0.9
    moving = np.array(moving)
    q = moving * sum(a * np.sin(w * time) for a, w in zip(sizes, rates, strict=True))
    v = moving * sum(a * w * np.cos(w * time) for a, w in zip(sizes, rates, strict=True))
    a = -moving * sum(a * w**2 * np.sin(w * time) for a, w in zip(sizes, rates, strict=True))
    efforts = np.array([pin.rnea(model, data, *each) for each in zip(q, v, a, strict=True)])
    efforts += DRY * np.sign(v) + VISCOUS * v + MOTOR * a
    draw = np.random.default_rng(seed)
    efforts = efforts * scale + noise * draw.normal(size=efforts.shape)
    return rnc.Log.of_motion(robot, time[:, 0], q, v, dict(zip(ARM, efforts.T, strict=True)))


def fixed_arm(changed=1):
    return rnc.NonholonomicSystem(arm(changed, base=False), (), ARM)


ALL = [kind(name) for kind in (BodyInertia, CoulombFriction, ViscousFriction, MotorInertia) for name in ARM]


def test_momentum_alone_shows_every_base_parameter_of_a_free_flying_arm():
    count, before, after = floating_error()
    assert count == 31  # 10 of the base and 7 of each body behind a revolute joint
    assert before > 0.1
    assert after < 1e-6


def test_momentum_does_not_show_the_scale_of_all_masses():
    found = rnc.identify(floating(arm(1)), floating_log())
    assert found.assumed == "mass of the robot of momentum(root_joint)[0]"
    mass = parameters(arm(1))[::10].sum()
    assert parameters(found.system.robot)[::10].sum() == pytest.approx(mass)


def test_efforts_show_base_parameters_friction_and_motor_inertia():
    found = rnc.identify(fixed_arm(), fixed_arm_log(), ALL)
    for name, friction in zip(ARM, np.column_stack([DRY, VISCOUS]), strict=True):
        assert found.value(f"Coulomb friction of {name}") == pytest.approx(friction[0], abs=2e-3)  # steps in windows
        assert found.value(f"viscous friction of {name}") == pytest.approx(friction[1], abs=2e-3)
    ours, true, draw = found.system.robot.model, arm(base=False).model, np.random.default_rng(7)
    file = arm(1, base=False).model
    before = []
    for _ in range(20):
        state = draw.normal(size=(3, 3))
        efforts = pin.rnea(true, true.createData(), *state) + MOTOR * state[2]
        assert np.abs(pin.rnea(ours, ours.createData(), *state) - efforts).max() < 1e-3
        before.append(np.abs(pin.rnea(file, file.createData(), *state) - efforts).max())
    assert np.median(before) > 0.1
    for body in list(ours.inertias)[1:]:
        assert np.linalg.eigvalsh(pseudo_inertia(body.toDynamicParameters())).min() > 0
    assert not [name for name in found.names if name.startswith("motor inertia of arm_1")]


def test_gears_follow_from_the_mass_of_one_body():
    scale = np.array([2.0, -0.5, 10.0])
    log = fixed_arm_log(scale=scale)
    unknown = [each for each in ALL if not isinstance(each, MotorInertia)]
    scales = [EffortScale(name) for name in ARM]
    with pytest.raises(rnc.InfeasibleError, match="effort scale"):
        rnc.identify(fixed_arm(None), log, [*unknown, *scales])
    known = rnc.NonholonomicSystem(arm(base=False), (), ARM)
    known.robot.model.armature[:] = MOTOR
    friction = [each for each in unknown if not isinstance(each, BodyInertia)]
    found = rnc.identify(known, log, [*friction, *scales])
    np.testing.assert_allclose([found.value(each.name) for each in scales], scale, rtol=1e-3)


def test_offsets_of_efforts_are_told_from_gravity():
    log = fixed_arm_log()
    efforts = {name: log.channel("effort", name).values[:, 0] + 0.7 for name in ARM}
    moved = [each for each in log if each.quantity != "effort"]
    log = rnc.Log([*moved, *(rnc.logs.Channel("effort", n, moved[0].time, e[:, None]) for n, e in efforts.items())])
    found = rnc.identify(fixed_arm(), log, [*ALL, *map(EffortOffset, ARM)])
    assert [found.value(f"effort offset of {name}") for name in ARM] == pytest.approx([0.7] * 3, abs=5e-3)


def test_standard_deviations_are_those_of_repeated_logs():
    draws = [rnc.identify(fixed_arm(), fixed_arm_log(0.2, seed, seconds=4.0), ALL) for seed in range(12)]
    exact = rnc.identify(fixed_arm(), fixed_arm_log(seconds=4.0), ALL).values
    ratios = np.array([(each.values - exact) / each.std for each in draws])
    assert np.mean(np.abs(ratios) < 3) > 0.95
    assert 0.5 < np.sqrt(np.mean(ratios**2)) < 1.5


def test_a_closed_loop_is_identified_from_its_crank_alone():
    """The passive joints are not measured; efforts follow from Pinocchio's constrained dynamics."""
    reduced = four_bar()
    system = rnc.NonholonomicSystem(
        reduced.robot, reduced.reduction_data.given.constraints, reduced.reduction_data.given.actuators
    )
    crank = system.actuation.names[0]
    driven = system.reduce([rnc.JointPosition(crank)])
    time, q, log = np.arange(0.0, 3.0, 0.004), system.assembly.random_configuration(np.random.default_rng(0)), []
    for t in time:
        rate, slope = 1.5 + np.sin(3 * t), 3 * np.cos(3 * t)
        state = driven.at(q, [rate])
        log.append((q, state.v, driven.inverse_dynamics(q, [rate], [slope])[0]))
        middle = pin.integrate(system.robot.model, q, 0.002 * state.v)
        q = system.assembled(
            pin.integrate(system.robot.model, q, 0.004 * driven.at(middle, [1.5 + np.sin(3 * (t + 0.002))]).v)
        )
    q, v, effort = (np.array(each) for each in zip(*log, strict=True))
    whole = rnc.Log.of_motion(system.robot, time, q, v, {crank: effort})
    measured = rnc.Log(each for each in whole if each.of == crank)
    heavy = system.robot.with_masses({})
    for k in range(1, heavy.model.njoints):
        heavy.model.inertias[k] = pin.Inertia(
            1.3 * heavy.model.inertias[k].mass, heavy.model.inertias[k].lever, 1.1 * heavy.model.inertias[k].inertia
        )
    file = system.with_robot(heavy, system.kinds)
    found = rnc.identify(file, measured, prior=1.0, window=0.1)
    assert found.errors[crank].fit < 1e-2 * found.errors[crank].file


def test_a_robot_on_wheels_gets_its_reduced_inertia_from_two_motors():
    """The base is not measured. The true reduced inertia is that of another evaluation: ``R^T M R``."""
    joints, wheels = ["left_wheel_joint", "right_wheel_joint"], [rnc.RollingWheel(f"{s}_wheel", 0.1) for s in SIDES]
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
    file = rnc.NonholonomicSystem(robot, wheels, joints)
    true = file.with_robot(robot.with_masses({"base": 14.0}), wheels)
    outputs = [rnc.JointPosition(name) for name in joints]
    reduced, q, states = true.reduce(outputs), robot.configuration(), []
    for t in np.arange(0.0, 8.0, 0.01):
        v2 = np.array([6 * np.sin(2 * t), 5 * np.sin(3 * t)])
        v2_dot = np.array([12 * np.cos(2 * t), 15 * np.cos(3 * t)])
        states.append((q, reduced.at(q, v2).v, reduced.allocate(q, reduced.inverse_dynamics(q, v2, v2_dot))))
        q = pin.integrate(robot.model, q, 0.01 * states[-1][1])
    positions, velocities, efforts = (np.array(each) for each in zip(*states, strict=True))
    time = 0.01 * np.arange(len(states))
    log = rnc.Log.of_motion(robot, time, positions, velocities, dict(zip(joints, efforts.T, strict=True)))
    found = rnc.identify(file, log, prior=0.5)
    H = reduced.at(q).H
    assert np.abs(file.reduce(outputs).at(q).H - H).max() > 0.2 * H.max()
    np.testing.assert_allclose(found.system.reduce(outputs).at(q).H, H, atol=1e-4 * H.max())


def test_a_log_that_does_not_show_a_parameter_is_refused_by_name():
    unknown = [each for each in ALL if "friction of arm_3" not in each.name and "friction of arm_2" not in each.name]
    log = fixed_arm_log(moving=(1.0, 0.0, 0.0))
    with pytest.raises(rnc.InfeasibleError, match=r"the log does not determine the .*: move arm_[23](, arm_[23])?, or"):
        rnc.identify(fixed_arm(None), log, unknown)
    found = rnc.identify(fixed_arm(None), log, unknown, prior=0.3)
    assert found.weakest.std == np.inf
    assert set(found.weakest.joints) <= {"arm_2", "arm_3"}


@pytest.mark.parametrize(("unknown", "change", "words"), [
    ([BodyInertia("arm_9")], {}, "unknown body behind joint 'arm_9'.*did you mean"),
    ([CoulombFriction("arm_9")], {}, "unknown joint 'arm_9'"),
    ([EffortScale("arm_9")], {}, "unknown measured effort of joint 'arm_9'"),
    ([], {}, "name at least one unknown parameter"),
    ([BodyInertia("arm_1")] * 2, {}, "named twice"),
    (None, {"prior": -1.0}, "prior: expected a positive number, found -1"),
    (None, {"held_out": 1.0}, "held_out: expected a share"),
    (None, {"window": 0.01}, "window: expected at least 4 samples"),
    (None, {"window": 100.0}, "shorter than a window"),
])  # fmt: skip
def test_mistakes_are_refused(unknown, change, words):
    with pytest.raises(rnc.ConfigurationError, match=words):
        rnc.identify(fixed_arm(), fixed_arm_log(), unknown, **change)


def test_what_is_no_system_and_no_log_is_refused():
    with pytest.raises(rnc.ConfigurationError, match="log: expected a Log, found 'a'"):
        rnc.identify(fixed_arm(), "a")
    with pytest.raises(rnc.ConfigurationError, match="system: expected a NonholonomicSystem, found"):
        rnc.identify(fixed_arm().robot, fixed_arm_log())


def test_a_log_without_efforts_is_refused():
    moved = rnc.Log(each for each in fixed_arm_log() if each.quantity != "effort")
    with pytest.raises(rnc.ConfigurationError, match="no effort of the actuators, and no momentum is conserved"):
        rnc.identify(fixed_arm(), moved)
    log = rnc.Log(each for each in floating_log() if each.quantity != "twist")
    with pytest.raises(rnc.ConfigurationError, match="does not show the velocity of root_joint"):
        rnc.identify(floating(arm(1)), log)


def test_rows_by_parts_are_averages_of_those_with_accelerations():
    """A rolling base with an arm under gravity; the motion is integrated along the constraints."""
    from systems import tiago as rolling

    given = rolling().reduction_data.given
    system = rnc.NonholonomicSystem(rolling().robot, given.constraints, given.actuators)
    regressor = ReducedRegressor(system, system.actuation.names)
    draw = np.random.default_rng(1)
    size, phase = draw.normal(size=(2, len(regressor.entries)))
    dt, states, q = 1e-3, [], regressor.random_configurations(1, draw)[0]
    for t in dt * np.arange(201):
        v = regressor.basis(q[None]).R[0] @ (size * np.sin(3 * t + phase))
        R, R_dot = (each[0] for each in regressor.basis(q[None], v[None]))
        states.append((q, v, R @ (3 * size * np.cos(3 * t + phase)) + R_dot @ (size * np.sin(3 * t + phase))))
        middle = pin.integrate(system.robot.model, q, dt / 2 * v)
        q = pin.integrate(
            system.robot.model, q, dt * regressor.basis(middle[None]).R[0] @ (size * np.sin(3 * (t + dt / 2) + phase))
        )
    q, v, v_dot = (np.array(each) for each in zip(*states, strict=True))
    windows = WindowAverages(dt * np.arange(201), np.array([0]), 200)
    expected = windows.mean(regressor.forces(q, v, v_dot))
    np.testing.assert_allclose(regressor.weak(q, v, windows), expected, atol=1e-5 * np.abs(expected).max())
    # The rows of the file's parameters are Pinocchio's inverse dynamics, projected.
    forces = np.array([pin.rnea(system.robot.model, system.robot.model.createData(), *each) for each in states])
    R = regressor.basis(q).R[..., regressor.rows]
    ours = (
        regressor.forces(q, v, v_dot)[..., : 10 * len(regressor.bodies)]
        @ regressor.nominal()[: 10 * len(regressor.bodies)]
    )
    motors = system.robot.model.armature * v_dot
    np.testing.assert_allclose(ours, np.einsum("kij,ki->kj", R, forces - motors), atol=1e-9)


def test_divergence_is_that_of_the_eigenvalues():
    """Sum of ``x - log x - 1`` over the generalized eigenvalues x of two pseudo-inertias."""
    bodies = list(arm().model.inertias)[1:3]
    file, other = (each.toDynamicParameters() for each in bodies)
    values = scipy.linalg.eigh(pseudo_inertia(other), pseudo_inertia(file), eigvals_only=True)
    prior = InertiaPrior(file)
    assert prior.divergence(other) == pytest.approx(np.sum(values - np.log(values) - 1))
    assert prior.divergence(np.array([1.0, 0, 0, 0, 1.0, 0, 1.0, 0, 0, 3.0])) == np.inf  # violates the triangle rule
    residuals, rows = prior.rows(other)
    slopes = [(prior.divergence(other + s) - prior.divergence(other - s)) / 2e-6 for s in 1e-6 * np.eye(10)]
    np.testing.assert_allclose(rows.T @ residuals, slopes, rtol=1e-5, atol=1e-5)


def test_a_point_mass_gets_some_thickness():
    p = dynamic_parameters(pin.Inertia(2.0, np.array([0.0, 0.0, 0.5]), np.zeros((3, 3))))
    assert np.linalg.eigvalsh(pseudo_inertia(p)).min() > 0
    np.testing.assert_allclose(p[:4], [2.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(p[4], 0.5, rtol=1e-5)


def test_base_parameters_of_a_pendulum_have_their_names():
    """Only ``m x``, ``m y`` and ``I_zz`` act on a revolute joint about a horizontal z axis."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3(pin.exp3(np.array([np.pi / 2, 0, 0])), np.zeros(3)), "hinge")
    model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    data, draw = model.createData(), np.random.default_rng(0)
    columns = np.vstack([pin.computeJointTorqueRegressor(model, data, *draw.normal(size=(3, 1))) for _ in range(30)])
    names = ("m", "m x", "m y", "m z", "I_xx", "I_xy", "I_yy", "I_xz", "I_yz", "I_zz")
    base = BaseParameters.of(columns, names)
    assert base.names == ("m x", "m y", "I_zz")
    assert base.invisible == ("m", "m z", "I_xx", "I_xy", "I_yy", "I_xz", "I_yz")


def test_the_urdf_has_the_new_numbers(tmp_path):
    source = tmp_path / "arm.urdf"
    source.write_text(URDF)
    robot = rnc.Robot.from_urdf(source)
    found = rnc.identify(rnc.NonholonomicSystem(robot, (), ["hinge"]), pendulum_log(robot), prior=0.5)
    found.write_urdf(source, tmp_path / "new.urdf")
    read = rnc.Robot.from_urdf(tmp_path / "new.urdf").model
    new = found.system.robot.model
    np.testing.assert_allclose(
        read.inertias[1].toDynamicParameters(), new.inertias[1].toDynamicParameters(), rtol=1e-12
    )
    np.testing.assert_allclose(read.damping, new.damping, rtol=1e-11)
    np.testing.assert_allclose(read.upperDryFrictionLimit, new.upperDryFrictionLimit, rtol=1e-11)
    assert read.damping[0] == pytest.approx(0.2, abs=2e-3)


def pendulum_log(robot):
    """Log of a pendulum of 2 kg at 0.3 m and 0.1 kg m^2, by its closed form."""
    time = np.arange(0.0, 10.0, 0.005)
    q, v, a = np.sin(2 * time), 2 * np.cos(2 * time), -4 * np.sin(2 * time)
    effort = (0.1 + 2.0 * 0.3**2) * a + 2.0 * 9.81 * 0.3 * np.sin(q) + 0.2 * v
    return rnc.Log.of_motion(robot, time, q[:, None], v[:, None], {"hinge": effort})


URDF = """<robot name="pendulum"><link name="world_link"/>
<link name="rod"><inertial><origin xyz="0 0 -0.2"/><mass value="1.5"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="bob"><inertial><mass value="0.5"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="world_link"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="50" velocity="9"/></joint>
<joint name="weld" type="fixed"><parent link="rod"/><child link="bob"/>
<origin xyz="0 0 -0.4" rpy="0.3 0.2 0.1"/></joint>
</robot>"""


@pytest.mark.skipif(not (MEASURED / "tiago").is_dir(), reason="the measured log of TIAGo is not in ../shared/data/logs")
def test_half_of_a_measured_log_predicts_the_efforts_of_the_other_half():
    found, scaled = tiago(), tiago(bodies=False)
    assert better(found) == list(JOINTS)
    assert all(found.held_out[name].fit < scaled.held_out[name].fit for name in JOINTS)  # the file in the right unit
