"""Holonomic rows: loops, couplings, contacts; their positions, their rank, and what a simulation keeps of them."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, add_frame, frame_placement
from refusals import refused
from rnc_pin.model.kinematics import Kinematics
from simple_controllers import Idle
from systems import COUPLER, CRANK, GROUND, ROCKER, four_bar, four_bar_robot, leaning_wheel, random_states
from tolerances import ROUNDING


def closed_form(crank, branch):
    """Angles of rocker and coupler, rates for unit rate of the crank; links point along exp(-i angle) in x + i z."""
    a = CRANK * np.exp(1j * crank) - GROUND
    d = abs(a)
    rocker = np.angle(a) + branch * np.arccos((ROCKER**2 + d**2 - COUPLER**2) / (2 * ROCKER * d))
    coupler = np.angle(GROUND + ROCKER * np.exp(1j * rocker) - CRANK * np.exp(1j * crank))
    rocker_rate = CRANK * np.sin(crank - coupler) / (ROCKER * np.sin(rocker - coupler))
    coupler_rate = CRANK * np.sin(crank - rocker) / (COUPLER * np.sin(rocker - coupler))
    return rocker, coupler, rocker_rate, coupler_rate


def turn(angle):
    return np.remainder(angle + np.pi, 2 * np.pi) - np.pi


def four_bar_with_knee():
    system = rnc.NonholonomicSystem(four_bar_robot(knee=True), [rnc.LoopClosure("coupler_tip", "knee_pin")], ["crank"])
    return system.reduce([rnc.JointPosition("crank")], [rnc.JointPosition("rocker")])


@pytest.mark.parametrize("make", [four_bar, four_bar_with_knee], ids=["point", "frame"])
def test_four_bar_moves_as_in_closed_form(make):
    reduced, branches = make(), set()
    for q, v2 in random_states(reduced, 8):
        candidates = {branch: closed_form(q[0], branch) for branch in (-1, 1)}
        branch = min(candidates, key=lambda b: abs(turn(candidates[b][0] - q[2])))
        branches.add(branch)
        rocker, coupler, rocker_rate, coupler_rate = candidates[branch]
        np.testing.assert_allclose(turn(q[2] - rocker), 0, atol=ROUNDING)
        np.testing.assert_allclose(turn(q[0] + q[1] - coupler), 0, atol=ROUNDING)
        v = reduced.at(q, v2).v
        expected = v2[0] * np.array([1.0, coupler_rate - 1.0, rocker_rate])
        np.testing.assert_allclose(v[:3], expected, rtol=1e-8, atol=1e-9)
    assert branches == {-1, 1}, "both ways to close the loop"


def test_a_planar_loop_keeps_two_rows_of_three_and_three_of_six():
    reduced = four_bar()
    assert reduced.m == 2
    assert [row.name for row in reduced.dropped_rows] == ["closure_y(coupler_tip, rocker_tip)"]
    reduced = four_bar_with_knee()
    assert reduced.m == 3
    assert {row.name.split("(")[0] for row in reduced.dropped_rows} == {"closure_y", "closure_roll", "closure_yaw"}
    assert all(reduced.constraints.holonomic)


def test_the_rank_is_that_of_closed_loops():
    """Bennett's linkage: six rows of rank three where it is closed, of rank four where it is not."""
    twist = np.array([0.6, np.arcsin(np.sin(0.6) * 1.4 / 1.0)])
    lengths = np.array([1.0, 1.4])  # a / sin(alpha) = b / sin(beta)
    model, joint, placement = pin.Model(), 0, pin.SE3.Identity()
    for k in range(4):
        joint = add_body(model, f"joint_{k}", "RZ", 1.0, joint, moments=0.1, at=placement)
        placement = pin.SE3(pin.utils.rpyToMatrix(twist[k % 2], 0, 0), np.array([lengths[k % 2], 0, 0]))
    add_frame(model, "end", joint, placement)
    robot = rnc.Robot(model)
    assert rnc.NonholonomicSystem(robot, [rnc.LoopClosure("universe", "end")]).m == 3
    position = Kinematics(robot).position(robot.random_configuration(np.random.default_rng(0)))
    open_rank = np.linalg.matrix_rank(rnc.LoopClosure("universe", "end").bind(robot).jacobian(position))
    assert open_rank == 4


def test_rows_of_a_closed_loop_are_the_rate_of_their_residual():
    """Of a logarithm, which ``tests/model/test_row_rates.py`` leaves out: it holds where the loop is closed."""
    reduced, h = four_bar_with_knee(), 1e-6
    blocks = [block for block, _, _ in reduced.constraints.places]
    generator, kinematics = np.random.default_rng(1), Kinematics(reduced.robot)
    for q, _ in random_states(reduced, 4):
        v = generator.normal(size=reduced.n)  # need not satisfy anything
        for block in blocks:
            residuals = []
            for sign in (1, -1):
                ahead = kinematics.position(pin.integrate(reduced.robot.model, q, sign * h * v))
                residuals.append(block.residual(ahead))
            rows = block.jacobian(kinematics.position(q)) * np.array(block.holonomic)[:, None]
            np.testing.assert_allclose(rows @ v, (residuals[0] - residuals[1]) / (2 * h), atol=1e-7)


def test_a_loop_closes_with_the_orientation_and_offsets_that_it_is_given():
    """The placement of b in a is that of roll, pitch and yaw; of a point only the offsets matter."""
    robot = rnc.Robot.from_example("panda", lock={"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0})
    rpy, offset_a, offset_b = (0.3, -0.5, 0.8), (0.1, 0.0, -0.2), (0.0, 0.05, 0.1)
    loop = rnc.LoopClosure("panda_link2", "panda_hand", "frame", offset_a, offset_b, rpy).bind(robot)
    point = rnc.LoopClosure("panda_link2", "panda_hand", "point", offset_a, offset_b).bind(robot)
    q = robot.random_configuration(np.random.default_rng(3))
    a, b = (frame_placement(robot, q, name) for name in ("panda_link2", "panda_hand"))
    wanted = a * pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(offset_a))
    gap = wanted.actInv(b * pin.SE3(np.eye(3), np.array(offset_b)))
    position = Kinematics(robot).position(q)
    np.testing.assert_allclose(point.residual(position), a.actInv(b.act(np.array(offset_b))) - offset_a, atol=ROUNDING)
    distance, residual = np.linalg.norm(gap.translation), loop.residual(position)
    assert distance == pytest.approx(np.linalg.norm(pin.exp6(residual).translation), rel=1e-10)
    # The orientation of the closed loop: no rotation is left where b has the given one.
    turned = pin.log3(pin.exp6(residual).rotation)
    assert np.linalg.norm(turned) == pytest.approx(np.linalg.norm(pin.log3(gap.rotation)), rel=1e-10)


@pytest.mark.parametrize(("frame", "words"), [
    ("far", "closure_x"), ("aside", r"closure_y\(coupler_tip, aside\) has residual 0.02"),
])  # fmt: skip
def test_loops_that_cannot_close_are_refused(frame, words):
    model = four_bar_robot().model.copy()
    add_frame(model, "far", 3, (3.0, 0.0, 0.0))
    add_frame(model, "aside", 3, (ROCKER, 0.02, 0.0))
    with pytest.raises(rnc.ConstraintError, match=words):
        rnc.NonholonomicSystem(rnc.Robot(model), [rnc.LoopClosure("coupler_tip", frame, "point")])


test_couplings_that_make_no_sense_are_refused = refused([
    (rnc.LoopClosure("coupler_tp", "rocker_tip"), rnc.ModelError, "did you mean 'coupler_tip'"),
    (rnc.LoopClosure("coupler_tip", "rocker_tip", "pint"), rnc.ConfigurationError, "did you mean 'point'"),
    (rnc.LoopClosure("coupler_tip", "coupler_tip"), rnc.ConstraintError, "are on one body"),
    (rnc.LoopClosure("coupler_tip", "rocker_tip", "point", rpy=(0.0, 0.1, 0.0)), rnc.ConfigurationError,
        "'coupler_tip' and 'rocker_tip' with kind 'point' has no orientation: omit rpy"),
    (rnc.LoopClosure("coupler_tip", "rocker_tip", rpy=(0.0, 0.1)), rnc.ConfigurationError, "rpy of the loop"),
    (rnc.JointCoupling("rocker", "crnk"), rnc.ModelError, "did you mean 'crank'"),
    (rnc.JointCoupling("crank", "crank"), rnc.ConstraintError, "coupled to itself"),
    (rnc.JointCoupling("rocker", "crank", 0.0), rnc.ConstraintError, "ratio other than zero"),
    (rnc.JointCoupling("rocker", "crank", 1.0, np.nan), rnc.ConstraintError, "finite offset"),
    (rnc.JointCoupling("rocker", "crank", 1e200), rnc.ConstraintError, "overflow|not finite"),
], lambda kind: rnc.NonholonomicSystem(four_bar_robot(), [kind]))  # fmt: skip


def geared(first, second, ratio, offset=0.0):
    """Two flywheels (2 and 0.5 kg m^2) of which the second follows the first; n = 2, r = 1."""
    model = pin.Model()
    for name, joint, inertia in (("motor", first, 2.0), ("wheel", second, 0.5)):
        add_body(model, name, joint, 1.0, moments=inertia)
    coupling = rnc.JointCoupling("wheel", "motor", ratio, offset)
    return rnc.NonholonomicSystem(rnc.Robot(model), [coupling], ["motor"]).reduce([rnc.JointPosition("motor")])


@pytest.mark.parametrize("first", [pin.JointModelRZ(), pin.JointModelRUBZ()], ids=["revolute", "continuous"])
@pytest.mark.parametrize("second", [pin.JointModelRZ(), pin.JointModelRUBZ()], ids=["revolute", "continuous"])
@pytest.mark.parametrize("ratio", [-3.0, 0.25])
def test_geared_flywheels_have_the_inertia_that_gears_reflect(first, second, ratio):
    reduced = geared(first, second, ratio, offset=0.4)
    q, v2 = random_states(reduced, 1)[0]
    assert reduced.at(q).H[0, 0] == pytest.approx(2.0 + ratio**2 * 0.5, rel=1e-12)
    assert reduced.forward_dynamics(q, v2, [1.0])[0] == pytest.approx(1.0 / (2.0 + ratio**2 * 0.5), rel=1e-12)
    np.testing.assert_allclose(reduced.at(q, v2).v, [v2[0], ratio * v2[0]], atol=1e-12)
    # Many turns under way, the position residual stays that of the gears.
    run = rnc.simulate(reduced, Idle(1), q, duration=2.0, dt=0.02, v2_0=np.array([9.0]))
    assert run.position_residual.max() < 1e-12
    motor, wheel = reduced.robot.model.joints[1], reduced.robot.model.joints[2]
    places = [run.q[:, joint.idx_q : joint.idx_q + joint.nq].T for joint in (motor, wheel)]
    angles = [np.unwrap(np.arctan2(each[1], each[0])) if len(each) == 2 else each[0] for each in places]
    moved = [angle - angle[0] for angle in angles]
    np.testing.assert_allclose(moved[0][-1], 18.0, atol=1e-9)
    np.testing.assert_allclose(moved[1], ratio * moved[0], atol=1e-9)


def test_a_coupling_that_full_turns_make_ambiguous_says_so():
    assert geared(pin.JointModelRZ(), pin.JointModelRUBZ(), np.sqrt(2)).constraints.holonomic == (True,)
    reduced = geared(pin.JointModelRUBZ(), pin.JointModelRUBZ(), np.sqrt(2))
    assert (reduced.constraints.holonomic, reduced.assembly.size) == ((False,), 0)


def test_assembling_can_hold_joints():
    reduced = four_bar()
    q = reduced.assembled(np.array([0.8, 0.3, 1.5]), hold=["crank"])
    assert q[0] == 0.8
    assert min(abs(turn(q[2] - closed_form(0.8, branch)[0])) for branch in (-1, 1)) < ROUNDING
    np.testing.assert_array_equal(reduced.assembled(q), q)


def test_initial_configurations_that_violate_a_row_are_refused_and_rounding_is_not():
    reduced = leaning_wheel()
    q0 = reduced.robot.configuration({"root_joint": [0, 0, 0.31, 0, 0, 0, 1]})
    with pytest.raises(rnc.InputError, match=r"violates vertical\(disk\) by 0.01 .*assembled\(q0\)"):
        rnc.simulate(reduced, Idle(3), q0, 0.01)
    q0[2] = 0.30001
    run = rnc.simulate(reduced, Idle(3), q0, 0.01)
    assert run.position_residual.max() < 1e-13
    assert run.q[0, 2] == pytest.approx(0.3, abs=1e-14)


def test_closing_a_loop_is_quadratic(generator):
    reduced = four_bar()
    closed = reduced.assembled(reduced.robot.configuration({"crank": 1.0, "coupler": -0.4, "rocker": 1.5}))
    for _ in range(5):
        found, *_, satisfied = reduced.assembly._closest(closed + generator.uniform(-0.3, 0.3, 3), steps=8)
        assert satisfied
        assert np.abs(reduced.assembly.residual(found)).max() < 1e-11
