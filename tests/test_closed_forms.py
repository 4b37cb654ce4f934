"""Small things, each against a closed form or an independent difference: a small wrong in one shows nowhere else."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from controlled_tasks import estimating, truck_task
from rnc_pin.control import (
    PositionGains,
    PositionTracker,
)
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.row_stack import RowStack
from rnc_pin.planning import Hold, TaskReference
from rnc_pin.planning.leg import Leg, best_legs
from rnc_pin.simulation.summary import summarize
from simple_controllers import Inputs
from systems import bicycle, fire_truck, four_bar, random_states, space_robot, space_robot_in_joints
from textbook_systems import planar_model
from tolerances import FINITE_DIFFERENCE, ROUNDING

# ---------------------------------------------------------------------- model


def test_the_rate_of_actuation_on_frames():
    """A force and a torque on a hand that turns: B by differences along v, and not zero."""
    robot = rnc.Robot.from_urdf("floating_arm.urdf", base="free", gravity=(0, 0, 0))
    drives = [rnc.FrameForce("hand", "y"), "elbow", rnc.FrameTorque("hand", "x")]
    actuation, kinematics, h = rnc.NonholonomicSystem(robot, [], drives).reduce().actuation, Kinematics(robot), 1e-6
    generator = np.random.default_rng(2)
    for _ in range(3):
        q, v = robot.random_configuration(generator), generator.normal(size=robot.nv)
        ahead, behind = (
            actuation.matrix(kinematics.position(pin.integrate(robot.model, q, sign * h * v))) for sign in (1, -1)
        )
        rate = actuation.matrix_rate(kinematics.position(q).with_velocity(v).rates())
        np.testing.assert_allclose(rate, (ahead - behind) / (2 * h), atol=FINITE_DIFFERENCE)
        assert (np.abs(rate).max(axis=0)[[0, 2]] > 0.01).all()


def test_rows_that_are_kept_in_part_keep_their_own_names_and_flags():
    robot = bicycle().robot
    blocks = [rnc.RollingBall("front", 0.3).bind(robot), rnc.RollingWheel("rear", 0.3).bind(robot)]
    whole = RowStack(blocks)
    assert whole.holonomic == (False, False, True) * 2
    for kept in ([0, 2, 5], [1, 2, 3, 4], [2, 3], [0, 1, 4, 5]):
        some = RowStack(blocks, kept)
        assert some.names == tuple(whole.names[row] for row in kept)
        assert some.units == tuple(whole.units[row] for row in kept)
        assert some.holonomic == tuple(whole.holonomic[row] for row in kept)
        at = Kinematics(robot).position(bicycle().robot.configuration())
        np.testing.assert_array_equal(some.jacobian(at), whole.jacobian(at)[kept])


@pytest.mark.parametrize(
    ("turn", "rows"),
    [(0.0, {"tip_x"}), (np.pi / 2, {"tip_y"}), (np.pi / 4, {"tip_x", "tip_y"})],
)
def test_a_straight_arm_names_the_rows_that_are_dependent_and_no_others(turn, rows):
    """Along x it cannot move in x, along y not in y; half way between both rows say the same."""
    reduced = space_robot()
    with pytest.raises(rnc.SingularityError) as caught:
        reduced.terms(reduced.robot.configuration({"platform": turn}), np.zeros(3))
    assert set(caught.value.rows) == rows


def sliders(B):
    """Three of them, at right angles, that actuators push by the columns of B."""
    model = pin.Model()
    model.name = "sliders"
    for axis, kind in zip("xyz", (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ), strict=True):
        joint = model.addJoint(model.njoints - 1, kind(), pin.SE3.Identity(), axis)
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    return rnc.NonholonomicSystem(rnc.Robot(model), [], B).reduce()


@pytest.mark.parametrize("seed", range(20))
def test_actuators_that_are_dependent_but_for_rounding_are_refused(seed):
    """The inverse of B is finite, and what comes of it is rubbish, which may hit the force by chance."""
    rng = np.random.default_rng(seed)
    start, steps = rng.integers(1, 9, 3) / 10, rng.integers(1, 9, 2) / 10
    B = np.array([start + steps[0] * i + steps[1] * np.arange(3) for i in range(3)])  # columns in progression
    reduced = sliders(B)
    for F in (*np.eye(3), np.ones(3), *rng.normal(size=(20, 3))):
        with pytest.raises(rnc.ConstraintError, match=r"reach rank [12] of the 3"):
            reduced.allocate(np.zeros(3), F)


@pytest.mark.parametrize("unit", [1e-15, 1e12])
def test_units_of_actuators_make_them_no_less_independent(unit):
    B = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, -0.9]]) * [unit, 1.0, 1.0]
    T = sliders(B).allocate(np.zeros(3), B @ [1.0 / unit, 2.0, 3.0])
    np.testing.assert_allclose(T * [unit, 1.0, 1.0], [1.0, 2.0, 3.0], rtol=1e-12)


def test_a_roll_out_keeps_loops_closed():
    """Steps so coarse that the integrator alone would leave the loop open by more than this."""
    reduced = four_bar()
    q0 = reduced.assembled(reduced.robot.configuration({"crank": 0.3, "coupler": 0.5, "rocker": 1.5}))
    crank = reduced.outputs(q0)[1]

    class Turn:
        def initial_state(self, measurement):
            return None

        def step(self, t, measurement, state):
            return rnc.control.VelocityTarget(v2=np.array([4.0]), v2_dot=np.zeros(1)), None

    _, path = rnc.kinematic_rollout(reduced, Turn(), q0, 1.2, 0.1)
    assert abs(reduced.outputs(path[-1])[1] - crank) > 1.0
    assert np.abs(reduced.position_residual(path)).max() < 1e-10


# ---------------------------------------------------------------------- analysis


def test_class_2_is_denied_where_a5_depends_on_the_redundant_output():
    """A slide that goes as ``sin(turret)`` times the speed: the turret moves no position, but says where it goes."""
    model, joint = planar_model("slide")
    turret = model.addJoint(joint, pin.JointModelRZ(), pin.SE3.Identity(), "turret")
    slide = model.addJoint(joint, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    for each in (turret, slide):
        model.appendBodyToJoint(each, pin.Inertia(0.5, np.zeros(3), 0.1 * np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("gun", turret, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))

    def follows(share):
        """The slide's rate is ``share + sin(turret)`` of the speed, or the share alone."""
        alone = share > 0
        return rnc.Pfaffian(
            lambda q: np.array([[share + (0 if alone else np.sin(q[4])), 0, 0, 0, -1.0]]),
            lambda q, v: np.array([[0 if alone else np.cos(q[4]) * v[3], 0, 0, 0, 0.0]]),
            ["follows"],
        )

    found = {}
    for share in (0.0, 0.7):
        system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("body"), follows(share)])
        reduced = system.reduce(
            [rnc.FrameSpeed("body"), rnc.FrameYaw("body"), rnc.JointPosition("turret")],
            [rnc.JointPosition("slide"), rnc.FrameYaw("gun")],
        )
        found[share] = rnc.analyze(reduced, redundant=["turret"], samples=8).redundancy
    assert found[0.7].redundancy_class == "2"
    assert found[0.0].redundancy_class is None
    assert "A5 depends on x22" in found[0.0].reason


def test_preflight_watches_the_smallest_singular_value_of_a_square_a4():
    """Two joints of three move the tip: A4 is the Jacobian of an arm of two links of 1 m, known in closed form."""
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce(
        [rnc.JointPosition(name) for name in robot.joint_names], [rnc.FramePosition("tip", "xy")]
    )
    task = rnc.Task.of(reduced, ["platform", "joint_1"], ["joint_2", "joint_3"])
    q0 = robot.configuration({"joint_1": 0.2, "joint_2": 0.4, "joint_3": 0.9})
    x1, x2 = reduced.outputs(q0)
    margins = rnc.preflight(reduced, task, TaskReference(Hold(x2[:2]), Hold(x1)), q0, 0.1)
    c, s = np.cos(0.9), np.sin(0.9)
    J = np.array([[-s, -s], [1 + c, c]])  # in axes along the first of the two links
    trace, determinant = np.sum(J**2), s**2
    smallest = np.sqrt((trace - np.sqrt(trace**2 - 4 * determinant)) / 2)
    assert margins.A4.value == pytest.approx(smallest, abs=1e-9)


# ---------------------------------------------------------------------- figures of a run


def test_drift_is_the_energy_that_no_work_explains():
    reduced = space_robot_in_joints()
    q0, push = reduced.robot.configuration({"joint_2": 1.0}), Inputs(lambda t: np.array([1.0, 0.5, -0.4]))
    run = rnc.simulate(reduced, push, q0, duration=0.5, dt=0.01)
    exchanged = np.ptp(run.energy)
    assert exchanged > 1e-3
    assert summarize(run)["energy_drift"] < 1e-9  # though its energy is not what it was
    lost = 0.25 * exchanged * np.linspace(0, 1, len(run.time)) ** 2
    assert summarize(replace(run, work=run.work + lost))["energy_drift"] == pytest.approx(0.25, abs=1e-9)
    idle = replace(run, work=np.zeros_like(run.work))
    assert summarize(idle)["energy_drift"] == pytest.approx(1.0)


# ---------------------------------------------------------------------- control


def test_scaled_position_gains_are_those_of_the_closed_form():
    """``omega^2 = kappa1 gamma^4 + kappa2 gamma^2 = gamma / dt``, and ``rate = 2 kappa2 gamma^3 / omega^2``."""
    inertia, dt, gamma, rate = 7.0, 0.002, 8.0, 3.0
    gains = PositionGains.scaled(np.array([[[inertia]]]), dt, gamma, rate)
    kappa1, kappa2 = float(gains.k1[0]) / inertia, float(gains.k2[0]) / inertia
    square = kappa1 * gamma**4 + kappa2 * gamma**2
    assert square == pytest.approx(gamma / dt)
    assert 2 * kappa2 * gamma**3 / square == pytest.approx(rate)
    np.testing.assert_allclose(gains.beta, inertia)


def test_what_is_learnt_starts_at_zero_under_a_reference_that_moves_already():
    """B and A too: the first force is ``k2 gamma^2 e`` alone, whatever the reference's rates."""
    e = np.array([0.7, -0.2])

    def moving(t):
        return SimpleNamespace(
            position=e, velocity=np.array([3.0, 1.0]), acceleration=np.array([-2.0, 5.0]), jerk=np.array([1.0, 4.0])
        )

    tracker = PositionTracker(SimpleNamespace(size=2, duration=1.0, at=moving), PositionGains.paper())
    measured = rnc.Measurement(x2=np.zeros(2))
    command, _ = tracker.step(0.0, measured, tracker.initial_state(measured))
    np.testing.assert_allclose(command.F, 10.0 * 4.0 * e, atol=ROUNDING)


def masses_as_believed(p):
    """The space robot with other masses of its links, built anew: what the estimates mean."""
    model = rnc.Robot.from_urdf("space_robot.urdf").model
    for joint, value in zip((2, 3, 4), p, strict=True):
        model.inertias[joint] = pin.Inertia.FromDynamicParameters(value * model.inertias[joint].toDynamicParameters())
    names = [f"joint_{i}" for i in (1, 2, 3)]
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.MomentumConservation("platform")], names)
    return system.reduce(
        [rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")], [rnc.JointPosition("platform")]
    )


def test_the_uncertain_law_is_that_of_a_robot_with_the_masses_believed():
    """Rates included, to the last term: nothing of the true A_star and A_star_dot is left in it."""
    believed = (1.6, 0.4, 1.5)
    reduced, law, _, controller = estimating(0.0, believed)
    other = masses_as_believed(believed)
    for q, v2 in random_states(reduced, 4, condition=50.0):
        measured = reduced.measure(q, v2)
        guess = other.measure(q, v2)
        assert np.abs(guess.A_star_dot - measured.A_star_dot).max() > 1e-3
        seen = measured._replace(A_star=guess.A_star, A_star_dot=guess.A_star_dot)
        expected, _ = law.step(1.3, seen, None)
        target, _ = controller.step(1.3, measured, controller.initial_state(measured))
        np.testing.assert_allclose(target.v2, expected.v2, atol=ROUNDING * (1 + np.abs(expected.v2).max()))
        np.testing.assert_allclose(target.v2_dot, expected.v2_dot, atol=1e-9 * (1 + np.abs(expected.v2_dot).max()))


def test_estimates_move_at_the_rate_of_the_law_in_the_loop():
    """(20) between two steps of the controller itself: ``pdot = alpha W^T E``."""
    alpha, dt = 3.0, 1e-7
    reduced, _, regressor, controller = estimating(alpha, (1.6, 0.4, 1.5))
    for q, v2 in random_states(reduced, 3, condition=50.0):
        measured = reduced.measure(q, v2)
        _, first = controller.step(0.5, measured, controller.initial_state(measured))
        target, second = controller.step(0.5 + dt, measured, first)
        _, W = regressor.regress(measured.q, measured.v)
        moved = (second.p - first.p) / (alpha * dt)
        np.testing.assert_allclose(moved, W.T @ target.prediction_error, rtol=1e-4, atol=1e-6)
        assert np.abs(moved).max() > 1e-3


def test_the_vertical_error_is_driven_by_the_prediction_error_alone():
    """(17): ``e1_dot + k3 e1 = x1hat_dot - x1_dot`` under (16), where the rates are those asked for; k3 is 2."""
    believed = (1.6, 0.4, 1.5)
    reduced, law, _, controller = estimating(0.0, believed)
    other, t = masses_as_believed(believed), 1.3
    for q, v2 in random_states(reduced, 3, condition=50.0):
        measured = reduced.measure(q, v2)
        v2d = controller.step(t, measured, controller.initial_state(measured))[0].v2
        moved, predicted = reduced.measure(q, v2d).v1, other.measure(q, v2d).v1  # truth, and (15)
        wanted = law.vertical.at(t)
        error, error_rate = wanted.position - measured.x1, wanted.velocity - moved
        np.testing.assert_allclose(error_rate + 2.0 * error, predicted - moved, atol=1e-9 * (1 + np.abs(moved).max()))
        assert np.abs(predicted - moved).max() > 1e-3


def test_the_prediction_error_is_that_of_19_and_in_proportion_to_that_of_15():
    """``J E = (Ahat n) (x1_dot - x1hat_dot)``, the hat that of (15), n a turn of the base that leaves x2 alone."""
    believed = (1.6, 0.4, 1.5)
    reduced, _, _, controller = estimating(0.0, believed)
    other = masses_as_believed(believed)
    for q, v2 in random_states(reduced, 3, condition=50.0):
        measured = reduced.measure(q, v2)
        E = controller.step(0.0, measured, controller.initial_state(measured))[0].prediction_error
        alone = np.linalg.solve(np.vstack([np.eye(4)[0], reduced.at(q).J2]), np.eye(4)[0])
        momentum = other.at(q).A @ alone
        apart = measured.v1 - other.measure(q, v2).v1
        np.testing.assert_allclose(10.0 * E, momentum * apart, atol=1e-9 * (1 + np.abs(E).max()))
        assert np.abs(E).max() > 1e-3


def test_steering_asks_for_no_faster_a_rate_than_it_may():
    reduced, path, task, free, _ = truck_task(max_rate=1e3, damping=1e-6)
    *_, bounded, _ = truck_task(max_rate=0.05, damping=1e-6)
    point, signs = path.reference.at(3.0), []
    for steering in (-0.5, 0.5):
        q = fire_truck().robot.configuration({"root_joint": [-4.5, 1.9, -0.5], "rear_steering": steering})
        measured = reduced.measure(q, np.array([*point.velocity, 0.0]), np.array([*point.position, 0.0]))
        wanted = free.step(3.0, measured)[0].v2[task.redundant]
        assert np.abs(wanted).max() > 0.1
        np.testing.assert_array_equal(bounded.step(3.0, measured)[0].v2[task.redundant], np.sign(wanted) * 0.05)
        signs.append(float(np.sign(wanted[0])))
    assert signs == [1.0, -1.0]


# ---------------------------------------------------------------------- planning


def test_the_cost_of_a_leg_is_that_of_the_curve():
    """``integral of 1 + (radius curvature)^2`` over the curve as it is driven, curvature by differences of heading."""
    start, goal, radius = np.array([0.0, 0.0, 0.3]), np.array([6.0, 2.5, -0.2]), 1.2
    (cost,), (chart,) = best_legs(start[None], goal[None], radius)
    _, poses, _, steering = Leg(start, goal, chart).drive(4.0, 1.0, 40_001)
    lengths = np.array([np.hypot(*(b - a)[:2]) for a, b in pairwise(poses)])
    bent = lengths > 1e-7  # it starts and ends at rest
    curvature = np.diff(poses[:, 2])[bent] / lengths[bent]
    assert cost == pytest.approx(np.sum(lengths[bent] * (1 + (radius * curvature) ** 2)), rel=1e-3)
    assert cost > 1.05 * lengths.sum()
    middle = (0.5 * (steering[1:] + steering[:-1]))[bent]
    np.testing.assert_allclose(np.tan(middle), curvature, atol=1e-4)  # of a wheelbase of 1 m
