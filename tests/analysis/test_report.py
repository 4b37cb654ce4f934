"""Growth vectors, redundancy classes and the report."""

import json
import time

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.analysis import growth_vector, integrability
from systems import (
    ALL,
    fire_truck,
    free_flying_panda,
    leaning_wheel,
    mobile_manipulator,
    random_states,
    space_robot,
    space_robot_in_joints,
    tiago,
)
from textbook_systems import planar_model, prismatic, turreted, unicycle, unicycle_with_trailers
from tolerances import ROUNDING


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (unicycle, (2, 3)),
        (fire_truck, (3, 5, 6)),
        (space_robot, (3, 4)),
        (lambda: unicycle_with_trailers(1), (2, 3, 4)),
        (lambda: unicycle_with_trailers(2), (2, 3, 4, 5)),
        (lambda: unicycle_with_trailers(3), (2, 3, 4, 5, 6)),
        (leaning_wheel, (3, 4, 5)),  # the height above the plane is holonomic
        (free_flying_panda, (7, 10)),  # linear momentum is holonomic: the centre of mass stays
        (tiago, (12, 13, 14)),  # the difference of the wheels' angles is the heading
    ],
    ids=["unicycle", "fire truck", "space robot", "1 trailer", "2 trailers", "3 trailers", "disk", "panda", "tiago"],
)
def test_growth_vector(make, expected):
    reduced = make()
    q, _ = random_states(reduced, 1, seed=11)[0]
    assert growth_vector(reduced, q) == expected


def test_a_growth_vector_takes_well_below_half_a_second():
    """TIAGo: twelve generators, four levels. Ten times the time is allowed for, against a busy machine."""
    reduced = tiago()
    q, _ = random_states(reduced, 1, seed=11)[0]
    started = time.process_time()
    growth_vector(reduced, q)
    assert time.process_time() - started < 0.5


# ---------------------------------------------------------------------- integrable rows


def two_upright_wheels():
    """Wheels of radius 0.1 at 0.3 either side of a planar base, every row written down by hand.

    Of the two rolling rows, ``u + 0.3 w = 0.1 right`` and ``u - 0.3 w = 0.1 left``, the difference is
    ``d(0.6 yaw - 0.1 (right - left)) = 0``.
    """
    model, joint = planar_model("differential drive")
    for name, y in (("left", 0.3), ("right", -0.3)):
        wheel = model.addJoint(joint, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([0.0, y, 0.1])), name)
        model.appendBodyToJoint(wheel, pin.Inertia(0.5, np.zeros(3), 0.01 * np.eye(3)), pin.SE3.Identity())
        model.addFrame(pin.Frame(f"{name}_hub", wheel, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    wheels = [rnc.RollingWheel(f"{name}_hub", 0.1) for name in ("left", "right")]
    system = rnc.NonholonomicSystem(rnc.Robot(model), wheels, ["left", "right"])
    return system.reduce([rnc.FrameSpeed("body"), rnc.FrameYaw("body")])


def bead(curve_slope):
    """A bead on a wire y = f(x) in the plane: ``dy = f'(x) dx``, which is df."""
    model = pin.Model()
    model.name = "bead"
    first = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
    second = model.addJoint(first, pin.JointModelPY(), pin.SE3.Identity(), "y")
    model.appendBodyToJoint(second, pin.Inertia(1.0, np.zeros(3), 0.1 * np.eye(3)), pin.SE3.Identity())
    slope, curvature = curve_slope
    wire = rnc.Pfaffian(
        lambda q: np.array([[-slope(q[0]), 1.0]]), lambda q, v: np.array([[-curvature(q[0]) * v[0], 0.0]]), ["wire"]
    )
    return rnc.NonholonomicSystem(rnc.Robot(model), [wire], ["x"]).reduce([rnc.JointPosition("x")])


def three_sliders(rows, rows_dot, names):
    """Three prismatic joints with rows of one's own, coordinates (x, y, z)."""
    model = pin.Model()
    model.name = "sliders"
    parent = 0
    for name, joint in (("x", pin.JointModelPX()), ("y", pin.JointModelPY()), ("z", pin.JointModelPZ())):
        parent = model.addJoint(parent, joint, pin.SE3.Identity(), name)
        model.appendBodyToJoint(parent, pin.Inertia(1.0, np.zeros(3), 0.1 * np.eye(3)), pin.SE3.Identity())
    return rnc.NonholonomicSystem(rnc.Robot(model), [rnc.Pfaffian(rows, rows_dot, names)], ["x", "y"])


def sorted_rows(reduced, seed=13):
    return integrability(reduced, np.stack([q for q, _ in random_states(reduced, 3, seed=seed)]))


def test_a_unicycle_has_no_integrable_row():
    found = sorted_rows(unicycle())
    assert found.nonholonomic == ("no_side_slip(body.y)",)
    assert found.integrable == found.combinations == ()


def test_the_difference_of_two_wheels_is_the_heading():
    reduced = two_upright_wheels()
    found = sorted_rows(reduced)
    assert found.growth_vector == (2, 3, 4)
    assert found.integrable == ()
    assert len(found.nonholonomic) == 3
    (combination,) = found.combinations
    assert str(combination) == "rolling(left_hub) - rolling(right_hub)"
    assert combination.constant
    # The combination of rows is the differential that was written down: constant, in (x, y, yaw, left, right).
    names = reduced.constraints.names
    c = np.array([combination.coefficients.get(name, 0.0) for name in names])
    for q, _ in random_states(reduced, 4, seed=14):
        row = c @ reduced.stacked_rows(q)[: reduced.m]
        assert np.abs(row / row[2] - np.array([0, 0, 0.6, 0.1, -0.1]) / 0.6).max() < ROUNDING


def test_a_bead_on_a_rail_is_integrable():
    for curve in ((np.cos, lambda x: -np.sin(x)), (lambda x: 0.5, lambda x: 0.0)):
        found = sorted_rows(bead(curve))
        assert found.growth_vector == (1,)
        assert found.integrable == ("wire",)
        assert [str(each) for each in found.combinations] == ["wire"]


def test_a_single_row_is_integrable_exactly_if_frobenius_says_so():
    """``dz = y dx + s x dy``: the differential of x y for s = 1, the contact form of Brockett for s = -1."""
    for s, expected, growth in ((1.0, ("row",), (2,)), (-1.0, (), (2, 3))):
        system = three_sliders(
            lambda q, s=s: np.array([[-q[1], -s * q[0], 1.0]]),
            lambda q, v, s=s: np.array([[-v[1], -s * v[0], 0.0]]),
            ["row"],
        )
        found = sorted_rows(system.reduce([rnc.JointPosition("x"), rnc.JointPosition("y")]))
        assert (found.integrable, found.growth_vector) == (expected, growth)


def test_an_integrable_combination_with_varying_coefficients_is_named_so():
    """Rows ``a`` and ``b`` with ``a - x b = dz - 2 dw`` in four sliders: neither is integrable, that combination is."""
    model = pin.Model()
    model.name = "sliders"
    parent = 0
    for k in range(4):
        parent = model.addJoint(
            parent, pin.JointModelPX() if k % 2 else pin.JointModelPY(), pin.SE3.Identity(), f"s{k}"
        )
        model.appendBodyToJoint(parent, pin.Inertia(1.0, np.zeros(3), 0.1 * np.eye(3)), pin.SE3.Identity())

    def rows(q):
        x, y = q[:2]
        b = np.array([-y, x, 1.0, 0.0])  # contact form in (x, y, z)
        return np.stack([np.array([0.0, 0.0, 1.0, -2.0]) + x * b, b])

    def rows_dot(q, v):
        b, b_dot = np.array([-q[1], q[0], 1.0, 0.0]), np.array([-v[1], v[0], 0.0, 0.0])
        return np.stack([v[0] * b + q[0] * b_dot, b_dot])

    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.Pfaffian(rows, rows_dot, ["a", "b"])])
    found = sorted_rows(system.reduce([rnc.JointPosition("s0"), rnc.JointPosition("s1")]))
    assert found.growth_vector == (2, 3)
    assert found.nonholonomic == ("a", "b")
    (combination,) = found.combinations
    assert not combination.constant
    assert set(combination.coefficients) == {"a", "b"}
    assert str(combination) == "a combination of a, b whose coefficients vary"


def test_height_of_a_rolling_disk_and_centre_of_mass_of_a_free_robot_are_integrable():
    assert sorted_rows(leaning_wheel()).integrable == ("vertical(disk)",)
    assert sorted_rows(leaning_wheel()).nonholonomic == ("rolling(disk)", "lateral(disk)")
    found = sorted_rows(free_flying_panda())
    assert found.integrable == tuple(f"momentum(root_joint)[{k}]" for k in range(3))


# ---------------------------------------------------------------------- brackets


def test_first_bracket_is_the_commutator_of_flows():
    """Independent of any formula: along r1, r2, back along r1, back along r2."""
    from rnc_pin.integrators import LieRungeKutta4

    for reduced in (unicycle(), leaning_wheel()):
        model, integrator = reduced.robot.model, LieRungeKutta4(reduced.robot)
        q, _ = random_states(reduced, 1, seed=12)[0]
        h = 3e-3

        def flow(p, column, time, reduced=reduced, integrator=integrator):
            field = np.eye(reduced.r)[column]
            return integrator.step(lambda s, y: (reduced.terms(s, field).v, y), p, np.zeros(1), time)[0]

        end = q
        for column, duration in ((0, h), (1, h), (0, -h), (1, -h)):
            end = flow(end, column, duration)
        commutator = pin.difference(model, q, end) / h**2
        R = reduced.terms(q, np.zeros(reduced.r)).R
        from rnc_pin.analysis.frame_bracket import frame_bracket

        along_0, along_1 = reduced.basis_rate(q, R.T[:2])[1]
        bracket = along_0[:, 1] - along_1[:, 0] + frame_bracket(model)(R[:, 0], R[:, 1])
        np.testing.assert_allclose(commutator, bracket, atol=0.02 * (1 + np.abs(bracket).max()))


def test_the_space_robot_is_class_1():
    report = rnc.analyze(space_robot(), primary=["tip_x", "tip_y"], redundant=["joint_1"])
    assert report.redundancy_class == "1"
    assert report.redundancy.tracked == ("platform",)
    assert report.completely_nonholonomic


def test_the_fire_truck_is_class_2s_not_2():
    """The paper says 2; the rate of the rear steering moves nothing, its angle does."""
    report = rnc.analyze(fire_truck(), redundant=["rear_steering"])
    assert report.redundancy_class == "2s"
    assert report.redundancy.evidence.A4_singular_values == (0.0, 0.0)
    assert report.redundancy.evidence.steering > 0.1
    assert report.redundancy.tracked == ("trailer_yaw",)
    assert report.redundancy.driven == ("tractor_x", "tractor_y", "tractor_yaw")


def test_a_unicycle_with_a_turret_is_class_2():
    """The turret's own heading is tracked by its joint, position by the base alone: A6 = 0, A5 free of x22."""
    reduced = turreted()
    report = rnc.analyze(reduced, redundant=["turret"])
    assert report.redundancy_class == "2"
    assert report.redundancy.tracked == ("gun_yaw",)


def test_nothing_redundant_is_no_class_and_says_why():
    report = rnc.analyze(unicycle())
    assert report.redundancy_class is None
    assert report.redundancy.reason == "no redundant output"


@pytest.mark.parametrize("name", ALL)
def test_lemma_1_holds_in_the_report_and_it_is_json(name):
    report = rnc.analyze(ALL[name](), samples=16)
    assert report.lemma1_holds
    assert report.lemma1["Hdot - V - V^T"] < 1e-8
    content = json.loads(json.dumps(report.to_dict()))
    assert content["condition"]["min"] <= content["condition"]["median"] <= content["condition"]["max"]
    assert content["actuation_rank"] == content["r"]


def test_lemma_1_is_denied_to_wrong_rates():
    """The residuals can fail: a constraint whose rate is a lie."""
    robot = rnc.Robot.from_urdf("space_robot.urdf")

    def rows(q):
        return np.array([[1.0, np.sin(q[1]), 0.2, 0.1]])

    honest = rnc.Pfaffian(rows, lambda q, v: np.array([[0.0, np.cos(q[1]) * v[1], 0.0, 0.0]]))
    lying = rnc.Pfaffian(rows, lambda q, v: np.zeros((1, 4)))
    outputs = [rnc.JointPosition(f"joint_{i}") for i in (1, 2, 3)]
    holds = [
        rnc.analyze(rnc.NonholonomicSystem(robot, [kind]).reduce(outputs), samples=8).lemma1_holds
        for kind in (honest, lying)
    ]
    assert holds == [True, False]


# ---------------------------------------------------------------------- why, and where not


def mobile_manipulator_report(samples):
    return rnc.analyze(
        mobile_manipulator(), redundant=["base_speed_x"], samples=samples, vertical=["distance_base_tip"]
    )


def bearing_of_the_tip(values):
    """Of the mobile manipulator, whose links are both one metre long: from the heading, at the axle."""
    return values["joint_1"] + np.arctan2(np.sin(values["joint_2"]), 1 + np.cos(values["joint_2"]))


def test_blocks_of_the_evidence_have_the_figures_of_the_geometry():
    """The tip stands still while the base drives: A4 is minus the cosine of its bearing, less for its height."""
    report = mobile_manipulator_report(64)
    assert report.redundancy_class == "1"
    blocks = {block.name: block for block in report.redundancy.evidence.blocks}
    shapes = {name: block.shape for name, block in blocks.items()}
    assert shapes == {"A3": (1, 3), "A4": (1, 1), "A5": (0, 3), "A6": (0, 1)}
    assert (blocks["A4"].rows, blocks["A4"].columns) == (("distance_base_tip",), ("base_speed_x",))
    # Over A3, the way to the tip in the world: the horizontal part of the distance, whatever the heading.
    generator, height = np.random.default_rng(0), 0.48
    drawn = [mobile_manipulator().robot.random_configuration(generator) for _ in range(64)]
    conditions = np.array([mobile_manipulator().condition(q) for q in drawn])
    good = [mobile_manipulator().robot.joint_values(q) for q in np.array(drawn)[conditions <= np.median(conditions)]]
    reach = np.array([2 * abs(np.cos(values["joint_2"] / 2)) for values in good])
    across = reach / np.hypot(reach, height)
    A4 = across * np.abs(np.cos([bearing_of_the_tip(values) for values in good]))
    for name, expected in (("A3", across), ("A4", A4)):
        spread = blocks[name].smallest_singular_value
        assert spread.min == pytest.approx(expected.min())
        assert spread.median == pytest.approx(np.median(expected))
        assert spread.max == pytest.approx(expected.max())
    assert blocks["A4"].largest_entry == pytest.approx(A4.max())


def test_the_evidence_in_json_has_its_keys():
    evidence = mobile_manipulator_report(8).to_dict()["redundancy"]
    keys = "tracked driven A3 A4_singular_values A6 A5_along_x22 blocks reason"
    assert list(evidence) == keys.split()
    full, empty = evidence["blocks"][1], evidence["blocks"][3]
    assert (empty["name"], empty["shape"]) == ("A6", [0, 1])
    assert set(full) - set(empty) == {"largest_entry", "smallest_singular_value"}
    steered = rnc.analyze(fire_truck(), redundant=["rear_steering"], samples=8).to_dict()["redundancy"]
    assert steered["d(A3 v21)/dx22"] > 0.1
    assert [block["name"] for block in steered["blocks"]][4:] == ["d(A3 v21)/dx22"]
    assert set(rnc.analyze(unicycle(), samples=8).to_dict()["redundancy"]) == {"tracked", "driven", "reason"}


def test_the_mobile_manipulator_is_singular_with_a_straight_arm_and_with_the_tip_abeam():
    located = {each.matrix: each for each in mobile_manipulator_report(32).singularities}
    assert all(each.located for each in located.values())
    assert abs(np.sin(located["E"].configuration["joint_2"])) < ROUNDING
    # Along a straight arm the tip goes as the base does, however that turns.
    assert set(located["E"].rows) == {"no_side_slip(axle.y)", "tip_x", "tip_y", "base_speed_x"}
    assert located["A4"].rows == ("distance_base_tip",)
    assert abs(np.cos(bearing_of_the_tip(located["A4"].configuration))) < ROUNDING
    # What is reported can be set again.
    q = mobile_manipulator().robot.configuration(located["E"].configuration)
    assert mobile_manipulator().smallest_singular_value(q) < ROUNDING


def test_where_no_singular_surface_is_the_worst_sample_is_named():
    """Joints as outputs of the space robot: E is regular wherever the platform has inertia."""
    system = rnc.NonholonomicSystem(rnc.Robot.from_urdf("space_robot.urdf"), [rnc.MomentumConservation("platform")])
    reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
    (worst,) = rnc.analyze(reduced, samples=16).singularities
    assert not worst.located
    assert worst.smallest_singular_value > 0.1


def test_nothing_actuated_is_reported_not_refused():
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")])
    joints = [f"joint_{k}" for k in (1, 2, 3)]
    report = rnc.analyze(system.reduce([rnc.JointPosition(joint) for joint in joints]), samples=8)
    assert (report.p, report.actuation_rank, report.unactuated) == (0, 0, tuple(joints))


def test_too_few_actuators_name_what_they_cannot_move():
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], ["joint_1", "joint_3"])
    report = rnc.analyze(system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)]), samples=8)
    assert (report.actuation_rank, report.unactuated) == (2, ("joint_2",))


@pytest.mark.parametrize(
    ("along", "expected"),
    [
        ((0, 0, 0, 0), "2"),
        ((0, 0, 1, 0), "2"),  # on x21
        ((0, 1, 0, 0), "2"),  # on x12
        ((1, 0, 0, 0), "2"),  # on x11, which x22 moves: the paper asks for A5(x11, x12, x21)
        ((0, 0, 0, 1), None),  # on x22
        ((1, 0, 0, -1), None),  # on x11 - x22, which x22 does not change under the constraints
        ((1, 1, 1, 0.2), None),
    ],
)
def test_class_2_asks_for_an_A5_without_x22_and_lets_it_depend_on_all_else(along, expected):
    along = np.array(along, dtype=float)
    reduced = prismatic(lambda q: 1 + 0.5 * np.sin(along @ q), lambda q: 0.5 * np.cos(along @ q) * along)
    found = rnc.analyze(reduced, ["x21"], ["x22"], samples=16).redundancy
    assert found.redundancy_class == expected
    assert (found.tracked, found.driven) == (("x11",), ("x12",))
    assert (found.evidence.A5_along_x22 > 0.01 * abs(along[3])) == (along[3] != 0)
    assert ("A5 depends on x22" in found.reason) == (expected is None)


def test_lemma_1_is_bounded_where_nothing_is_singular():
    """A unicycle in speed and yaw: H is diag(m, I), V and G vanish."""
    bounds = rnc.analyze(unicycle(), samples=8).lemma1_bounds
    assert bounds.everywhere
    assert bounds.approaches == ()
    np.testing.assert_allclose([bounds.H.min, bounds.H.max], 1.0, atol=ROUNDING)
    np.testing.assert_allclose([bounds.V.max, bounds.G.max], 0.0, atol=ROUNDING)


def test_lemma_1_has_no_bound_towards_outputs_that_stop_parametrising_the_motion():
    """The same in x and yaw: ``v = xdot / cos(yaw)``, so H grows as ``m / d^2`` and V as ``m / d^3``."""
    model, _ = planar_model()
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("body")])
    report = rnc.analyze(system.reduce([rnc.FramePosition("body", "x"), rnc.FrameYaw("body")]), samples=16)
    bounds = report.lemma1_bounds
    assert not bounds.everywhere
    (way,) = bounds.approaches
    assert "body_x" in way.rows
    assert (way.H_order, way.V_order) == (pytest.approx(2.0, abs=0.02), pytest.approx(3.0, abs=0.02))
    assert way.H[-1] > 1e3 * bounds.H.median
    assert json.loads(json.dumps(report.to_dict()))["lemma1_bounds"]["approaches"][0]["bounded"] is False


def test_lemma_1_of_the_space_robot_holds_off_its_straight_arm():
    """In joints nothing is singular; in tip coordinates H and V have no bound towards a straight arm.

    Three links of 10 kg within 3 m and the platform have moments of inertia below 10 (1 + 4 + 9) + 10 about the pin.
    """
    joints = rnc.analyze(space_robot_in_joints(), samples=16).lemma1_bounds
    assert joints.everywhere
    assert joints.H.max < 3 * 150.0
    tip = rnc.analyze(space_robot(), samples=16).lemma1_bounds
    assert not tip.everywhere
    for way in tip.approaches:
        assert way.H_order == pytest.approx(2.0, abs=0.1)
        assert way.V_order == pytest.approx(4.0, abs=0.2)  # at unit rates of the tip joints turn at 1 / d: R_dot ~ d^-3
