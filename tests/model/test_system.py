"""Constraints, outputs and actuators: what they mean, and what is refused."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from systems import ALL, leaning_wheel, mobile_manipulator, random_states, space_robot, tiago
from tolerances import ROUNDING


def space(**changes):
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    given = {"constraints": [rnc.MomentumConservation("platform")], "actuators": ["joint_1", "joint_2", "joint_3"]}
    return rnc.NonholonomicSystem(robot, **{**given, **changes})


# ---------------------------------------------------------------------- meaning


def test_momentum_row_is_the_angular_momentum_about_the_pin():
    reduced = space_robot()
    model = reduced.robot.model
    data = model.createData()
    generator = np.random.default_rng(0)
    for _ in range(5):
        q, v = reduced.robot.random_configuration(generator), generator.normal(size=4)
        pin.computeCentroidalMomentum(model, data, q, v)
        about_pin = data.hg.angular + np.cross(data.com[0], data.hg.linear)
        np.testing.assert_allclose(reduced.constraint_residual(q, v), about_pin[2:], atol=ROUNDING * 100)


def test_rolling_wheel_keeps_the_lowest_point_at_rest():
    """Independent: the velocity of the wheel's material point that is lowest, from its placement alone."""
    reduced = leaning_wheel()
    model = reduced.robot.model
    for q, v2 in random_states(reduced, 5):
        v, h = reduced.terms(q, v2).v, 1e-6
        placement = pin.SE3(pin.Quaternion(q[3:7]).toRotationMatrix(), q[:3])
        angles = np.linspace(0, 2 * np.pi, 200_001)
        rim = 0.3 * np.stack([np.cos(angles), np.zeros_like(angles), np.sin(angles)])
        lowest = rim[:, np.argmin((placement.rotation @ rim)[2])]  # a point of the wheel, in its own axes
        there = []
        for sign in (1, -1):
            p = pin.integrate(model, q, sign * h * v)
            there.append(pin.SE3(pin.Quaternion(p[3:7]).toRotationMatrix(), p[:3]).act(lowest))
        np.testing.assert_allclose((there[0] - there[1]) / (2 * h), 0.0, atol=1e-4)  # the rim is sampled


def test_tiago_has_six_contact_rows_of_rank_three():
    reduced = tiago()
    assert reduced.m == 3
    assert [row.name.split("(")[0] for row in reduced.dropped_rows] == ["vertical", "lateral", "vertical"]
    reasons = [row.reason for row in reduced.dropped_rows]
    assert reasons[0] == reasons[2] == "zero at every configuration"
    assert reasons[1] == "a combination of lateral(wheel_left_link)"


def test_two_knife_edges_on_one_axle_are_one_constraint():
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle"), rnc.NoSideSlip("base")])
    assert system.m == 1
    assert system.dropped_rows[0].name == "no_side_slip(base.y)"
    assert system.dropped_rows[0].reason == "a combination of no_side_slip(axle.y)"


def test_pfaffian_rows_agree_with_the_constraint_they_spell_out():
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    edge = np.array([[0.0, 1.0, 0.0, 0.0, 0.0]])  # the body's own y velocity
    written = rnc.Pfaffian(lambda q: edge, lambda q, v: 0 * edge, ["edge"])
    drive = [rnc.FrameForce("base", "x"), rnc.FrameTorque("base", "z"), "joint_1", "joint_2"]
    outputs = [rnc.FramePosition("tip", "xy"), rnc.FrameSpeed("base"), rnc.FrameYaw("base")]
    other = rnc.NonholonomicSystem(robot, [written], drive).reduce(outputs)
    reduced = mobile_manipulator()
    for q, v2 in random_states(reduced, 5):
        T = np.arange(4.0)
        np.testing.assert_allclose(
            other.forward_dynamics(q, v2, T), reduced.forward_dynamics(q, v2, T), rtol=0, atol=ROUNDING * 100
        )


def test_user_defined_output_agrees_with_the_one_it_spells_out():
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    row = np.array([[0.0, 1.0, 0.0, 0.0]])
    joint = rnc.Output(lambda q: q[1:2], lambda q: row, lambda q, v: 0 * row, ["shoulder"])
    system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], ["joint_1", "joint_2", "joint_3"])
    other = system.reduce([rnc.FramePosition("tip", "xy"), joint], [rnc.JointPosition("platform")])
    reduced = space_robot()
    for q, v2 in random_states(reduced, 5):
        np.testing.assert_allclose(other.terms(q, v2).V, reduced.terms(q, v2).V, atol=1e-9)
        np.testing.assert_array_equal(other.outputs(q)[1], reduced.outputs(q)[1])


def test_inputs_can_be_a_matrix_or_a_function():
    q, v2 = random_states(space_robot(), 1)[0]
    B = np.eye(4)[:, 1:]
    expected = space_robot().terms(q, v2).input_matrix
    for actuators in (B, lambda q: B):
        reduced = space(actuators=actuators).reduce([rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")])
        np.testing.assert_array_equal(reduced.terms(q, v2).input_matrix, expected)


def test_fewer_actuators_than_motions_are_told_only_where_they_matter():
    reduced = space(actuators=["joint_2"]).reduce([rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")])
    q, v2 = random_states(reduced, 1)[0]
    assert reduced.forward_dynamics(q, v2, np.ones(1)).shape == (3,)
    with pytest.raises(rnc.ConstraintError, match="reach rank 1 of the 3 reduced forces"):
        reduced.allocate(q, np.ones(3))


def test_more_actuators_than_motions_share_with_the_least_effort():
    thrusters = ["joint_1", "joint_2", "joint_3", rnc.FrameTorque("link_3", "z")]
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    free = rnc.NonholonomicSystem(
        robot, [rnc.Pfaffian(lambda q: np.eye(4)[:1], lambda q, v: 0 * np.eye(4)[:1])], thrusters
    )
    reduced = free.reduce([rnc.JointPosition(f"joint_{i}") for i in (1, 2, 3)])
    q, F = robot.configuration({"joint_2": 0.7}), np.array([1.0, 2.0, 3.0])
    T, matrix = reduced.allocate(q, F), reduced.input_matrix(q)
    np.testing.assert_allclose(matrix @ T, F, atol=ROUNDING)
    np.testing.assert_allclose(T, np.linalg.lstsq(matrix, F, rcond=None)[0], atol=ROUNDING)


# ---------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (lambda: space(constraints=[rnc.MomentumConservation("platfrm")]), rnc.ModelError, "did you mean 'platform'"),
        (
            lambda: space(constraints=[rnc.MomentumConservation("joint_2")]),
            rnc.ConstraintError,
            "depends on its position",
        ),
        (lambda: space(constraints=[rnc.NoSideSlip("tipp")]), rnc.ModelError, "did you mean 'tip'"),
        (lambda: space(constraints=[rnc.NoSideSlip("tip", "w")]), rnc.ConfigurationError, "axis 'w' is not known"),
        (lambda: space(constraints=[rnc.RollingWheel("tip", 0.0)]), rnc.ConstraintError, "has to be positive"),
        (
            lambda: space(constraints=[rnc.MomentumConservation("platform")] * 2),
            rnc.ConstraintError,
            "duplicate constraint row",
        ),
        (lambda: space(actuators=["platform", "joint_2"]), rnc.ConstraintError, "'platform' drives momentum"),
        (lambda: space(actuators=["joint_1", "joint_1"]), rnc.ConstraintError, "duplicate actuator"),
        (lambda: space(actuators=["joint_9"]), rnc.ModelError, "did you mean 'joint_"),
        (lambda: space(actuators=[3]), rnc.ConstraintError, "has the wrong type"),
        (lambda: space(actuators=np.eye(3)), rnc.ConstraintError, r"shape \(3, 3\), expected \(4, p\)"),
        (lambda: space(actuators=[rnc.FrameForce("tip", "x")]), rnc.ConstraintError, "drives momentum"),
        (
            lambda: space(constraints=[rnc.Pfaffian(lambda q: np.eye(4), lambda q, v: np.eye(4))]),
            rnc.ConstraintError,
            "leave no motion",
        ),
        (
            lambda: space(constraints=[rnc.Pfaffian(lambda q: np.zeros((1, 3)), lambda q, v: np.zeros((1, 3)))]),
            rnc.InputError,
            r"shape \(1, 3\), expected \(1, 4\)",
        ),
        (
            lambda: space(
                constraints=[rnc.Pfaffian(lambda q: np.eye(4)[:1] * (q[1] > 0), lambda q, v: np.zeros((1, 4)))]
            ),
            rnc.ConstraintError,
            "rank of the constraints changes with the configuration, from 0 to 1",
        ),
        (lambda: space().reduce([rnc.JointPosition("joint_1")]), rnc.ConstraintError, "1 reducing outputs"),
        (
            lambda: space().reduce([rnc.JointPosition("joint_1"), rnc.JointPosition("joint_1"), rnc.FrameYaw("tip")]),
            rnc.ConstraintError,
            "duplicate output 'joint_1'",
        ),
        (
            lambda: space().reduce(
                [rnc.JointPosition("joint_1"), rnc.FrameYaw("link_1"), rnc.JointPosition("platform")]
            ),
            rnc.ConstraintError,
            "do not parametrise the motion",
        ),
        (lambda: space().reduce([rnc.FramePosition("tip", "xx")]), rnc.ConfigurationError, "at most once"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(make, error, words):
    with pytest.raises(error, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_gravity_along_a_conserved_momentum_is_refused():
    robot = rnc.Robot.from_example("panda", base="free")
    with pytest.raises(rnc.ConstraintError, match="gravity acts along it"):
        rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("root_joint")])


def test_a_wheel_without_an_axis_of_its_own_asks_for_one():
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    with pytest.raises(rnc.ConstraintError, match="has no single axis: give the axle with axis="):
        rnc.NonholonomicSystem(robot, [rnc.RollingWheel("axle", 0.2)])


def test_a_wheel_that_lies_flat_is_said():
    reduced = leaning_wheel()
    flat = reduced.robot.configuration({"root_joint": [0, 0, 0, np.sin(np.pi / 4), 0, 0, np.cos(np.pi / 4)]})
    with pytest.raises(rnc.SingularityError, match="lies flat"):
        reduced.forward_dynamics(flat, np.zeros(3), np.zeros(3))


# ---------------------------------------------------------------------- singular and wrong states


def test_a_straight_arm_is_singular_and_names_the_rows():
    reduced = space_robot()
    q = reduced.robot.configuration()
    for call in (
        lambda: reduced.terms(q, np.zeros(3)),
        lambda: reduced.forward_dynamics(q, np.zeros(3), np.zeros(3)),
        lambda: reduced.measure(q, np.zeros(3)),
    ):
        with pytest.raises(rnc.SingularityError) as caught:
            call()
        error = caught.value
        assert error.condition > 1e8
        assert error.time is None
        np.testing.assert_array_equal(error.q, q)
        assert error.rows == ("tip_x",)  # along x the arm cannot move in x


def test_one_singular_state_in_a_batch_is_found():
    reduced = space_robot()
    q, v2 = (np.stack(each) for each in zip(*random_states(reduced, 4), strict=True))
    q[2] = reduced.robot.configuration({"platform": 0.3})
    with pytest.raises(rnc.SingularityError) as caught:
        reduced.forward_dynamics(q, v2, np.zeros((4, 3)))
    np.testing.assert_array_equal(caught.value.q, q[2])


def test_next_to_a_singular_configuration_the_answer_is_still_right():
    """No silent regularisation: right down to the limit the KKT residual is at the level of rounding."""
    reduced = space_robot()
    q, v2, T = reduced.robot.configuration({"joint_2": 1e-5, "joint_3": 2e-5}), np.array([0.0, 1e-3, 0.1]), np.ones(3)
    t = reduced.terms(q, v2)
    assert np.abs(t.A @ t.R).max() < 1e-6 * np.abs(t.R).max()
    F = t.input_matrix @ T
    back = reduced.inverse_dynamics(q, v2, reduced.forward_dynamics(q, v2, T))
    assert np.linalg.norm(back - F) < 1e-5 * np.linalg.norm(F)


@pytest.mark.parametrize("name", ["space_robot", "tiago"])
def test_wrong_shapes_and_numbers_are_caught_at_the_boundary(name):
    reduced = ALL[name]()
    q, v2 = random_states(reduced, 1)[0]
    T, nan = np.zeros(reduced.p), np.full_like(v2, np.nan)
    for call, words in (
        (lambda: reduced.forward_dynamics(q[:-1], v2, T), f"q has shape .*, expected \\(..., {reduced.robot.nq}\\)"),
        (lambda: reduced.forward_dynamics(q, v2[:-1], T), "v2 has shape"),
        (lambda: reduced.forward_dynamics(q, v2, T[:-1]), "T has shape"),
        (lambda: reduced.forward_dynamics(q, nan, T), "v2 holds values that are not finite"),
        (lambda: reduced.forward_dynamics(q, v2, T * np.nan), "T holds values that are not finite"),
        (lambda: reduced.forward_dynamics(q * np.nan, v2, T), "q holds values that are not finite"),
        (lambda: reduced.forward_dynamics(np.stack([q] * 2), np.stack([v2] * 3), T), "do not broadcast"),
        (lambda: reduced.allocate(q, v2[:-1]), "F has shape"),
    ):
        with pytest.raises(rnc.InputError, match=words):
            call()


def test_a_quaternion_of_wrong_length_is_caught():
    reduced = leaning_wheel()
    q, v2 = random_states(reduced, 1)[0]
    with pytest.raises(rnc.InputError, match="not of unit length"):
        reduced.forward_dynamics(1.1 * q, v2, np.zeros(3))


def test_lists_and_one_configuration_for_many_velocities_are_welcome():
    reduced = space_robot()
    q, _ = random_states(reduced, 1)[0]
    v2, T = np.random.default_rng(0).normal(size=(2, 5, 3))
    batch = reduced.forward_dynamics(q.tolist(), v2, T)
    assert batch.shape == (5, 3)
    np.testing.assert_allclose(batch[3], reduced.forward_dynamics(q, v2[3].tolist(), T[3].tolist()), rtol=1e-10)


@pytest.mark.parametrize(
    ("joint", "units"),
    [
        (pin.JointModelPX(), ("kg m/s",)),
        (pin.JointModelRZ(), ("N m s",)),
        (pin.JointModelPlanar(), ("kg m/s", "kg m/s", "N m s")),
        (pin.JointModelSpherical(), ("N m s",) * 3),
        (pin.JointModelTranslation(), ("kg m/s",) * 3),
        (pin.JointModelFreeFlyer(), ("kg m/s",) * 3 + ("N m s",) * 3),
    ],
    ids=lambda value: value.shortname() if isinstance(value, pin.JointModel) else "",
)
def test_momentum_has_the_unit_of_the_motion_that_it_belongs_to(joint, units):
    model = pin.Model()
    model.gravity.linear = np.zeros(3)
    base = model.addJoint(0, joint, pin.SE3.Identity(), "base")
    model.appendBodyToJoint(base, pin.Inertia(2.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    arm = model.addJoint(base, pin.JointModelRZ(), pin.SE3.Identity(), "arm")
    model.appendBodyToJoint(arm, pin.Inertia(1.0, np.array([0.3, 0.0, 0.0]), np.eye(3)), pin.SE3.Identity())
    assert rnc.MomentumConservation("base").bind(rnc.Robot(model)).units == units
