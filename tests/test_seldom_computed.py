"""Values that few robots ask for: each beside a closed form, or the same by another way."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from controlled_tasks import estimating
from rnc_pin.analysis.boundedness import _approach, _order
from rnc_pin.analysis.differences import directional_derivative
from rnc_pin.analysis.frame_bracket import frame_bracket
from rnc_pin.analysis.linearization import Linearization
from rnc_pin.analysis.redundancy import _full_row_rank
from rnc_pin.analysis.singularities import Singularity
from rnc_pin.control import (
    ChainedStabilizer,
    MomentumRegressor,
    PositionGains,
    PositionTracker,
    UnknownMass,
    UnknownRadius,
    UnknownTrack,
    WheelRegressor,
)
from rnc_pin.control.path_fit import PathPoint, chord_end_between, chord_end_fitted
from rnc_pin.model import assembly
from rnc_pin.model.assembly import _out_of_reach
from rnc_pin.model.configuration_evaluation import ConfigurationEvaluation
from rnc_pin.model.independence import _choose
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import check_defined
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.planning import CarPath, Hold
from systems import fire_truck, four_bar, four_bar_robot, random_states, sleigh, space_robot

DRIVE = ("left_wheel", "right_wheel")


def differential_drive():
    return rnc.Robot.from_urdf("differential_drive.urdf", base="planar")


def test_a_coupling_that_a_rounded_row_implies_is_met_to_its_rounding():
    """The same ratio twice, once as a row for rates in fewer digits: of the two the first is kept."""
    robot = rnc.Robot(four_bar_robot().model)
    row = np.zeros((1, robot.nv))
    row[0, :2] = -2.0000002, 1.0
    rates = rnc.Pfaffian(lambda q: row, lambda q, v: 0 * row, ["ratio"])
    couplings = [rnc.JointCoupling("coupler", "crank", 2.0), rnc.JointCoupling("rocker", "crank", 1.5)]
    with pytest.warns(rnc.ModelWarning, match="except for rounding"):
        system = rnc.NonholonomicSystem(robot, [rates, *couplings])
    (dropped,) = system.dropped_rows
    assert dropped.name == "coupling(coupler, crank)"
    assert 0 < dropped.rounding < 1e-6
    assert system.assembly.following == ("coupling(coupler, crank)",)


def test_joints_that_turn_without_end_have_no_place_to_be_coupled_at():
    """A third of a full turn has a value only up to 120 degrees: rates are coupled, nothing is assembled."""
    model = pin.Model()
    for name in ("a", "b"):
        joint = model.addJoint(0, pin.JointModelRUBZ(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    robot = rnc.Robot(model)
    reduced = rnc.NonholonomicSystem(robot, [rnc.JointCoupling("a", "b", 0.3217)]).reduce()
    assert not reduced.constraints.holonomic[0]
    q = robot.configuration({"a": 1.0, "b": -2.0})
    assert reduced.all_constraints.places[0].block.residual(Kinematics(robot).position(q)).tolist() == [0.0]
    np.testing.assert_allclose(reduced.velocity(q, [1.0]) / reduced.velocity(q, [1.0])[1], [0.3217, 1.0])


def test_rows_that_are_constant_do_not_drift():
    robot = four_bar_robot()
    block = rnc.JointCoupling("coupler", "crank", 2.0).bind(robot)
    kinematics = Kinematics(robot)
    for shape in ((), (3,), (2, 3)):
        q = np.broadcast_to(robot.configuration(), (*shape, robot.nq)).copy()
        motion = kinematics.position(q).with_velocity(np.ones((*shape, robot.nv)))
        assert block.bias_acceleration(motion).shape == (*shape, 1)
        assert not block.bias_acceleration(motion).any()
    assert block.bias_acceleration_gradient(None).tolist() == [[0.0] * robot.nv]


def test_what_is_not_a_number_is_not_called_singular():
    """It has an error of its own, where it comes from."""
    robot = sleigh().robot
    here = Kinematics(robot).position(np.stack([robot.configuration()] * 2))
    check_defined("small", here, np.array([np.nan, 1.0]), 0.5, ("row",))
    with pytest.raises(rnc.SingularityError, match="small"):
        check_defined("small", here, np.array([1.0, 0.1]), 0.5, ("row",))


def test_of_many_states_the_first_that_is_singular_is_told():
    """With its size and the names of its rows."""
    robot = sleigh().robot
    generator = np.random.default_rng(0)
    q = np.stack([[robot.random_configuration(generator) for _ in range(3)] for _ in range(2)])
    sizes = np.array([[1.0, 2.0, 1.0], [1.0, 0.25, 0.1]])
    with pytest.raises(rnc.SingularityError) as told:
        check_defined("small", Kinematics(robot).position(q), sizes, 0.5, ("row",))
    assert told.value.q.tolist() == q[1, 1].tolist()
    assert told.value.condition == 4.0
    assert told.value.rows == ("row",)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_a_momentum_of_grams_is_no_nearer_to_zero(scale):
    """Rows are compared at one length each: units of mass change nothing."""
    reduced = space_robot()
    model = reduced.robot.model.copy()
    for joint, inertia in enumerate(model.inertias):
        model.inertias[joint] = pin.Inertia(scale * inertia.mass, inertia.lever, scale * inertia.inertia)
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.MomentumConservation("platform")])
    scaled = system.reduce([rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")])
    for q, _ in random_states(reduced, 4):
        np.testing.assert_allclose(scaled.at(q).scaled_stack, reduced.at(q).scaled_stack, atol=1e-12)


def test_closing_a_loop_is_quadratic(monkeypatch):
    """Some steps of at most half a radian, then each doubles the digits."""
    reduced = four_bar()
    closed = reduced.assembled(reduced.robot.configuration({"crank": 1.0, "coupler": -0.4, "rocker": 1.5}))
    monkeypatch.setattr(assembly, "_STEPS", 8)
    generator = np.random.default_rng(4)
    for _ in range(5):
        found = reduced.assembled(closed + generator.uniform(-0.3, 0.3, 3))
        assert np.abs(reduced.position_residual(found)).max() < 1e-11


def test_rows_that_take_turns_move_at_their_own_rates():
    """A belt drags the sleigh's runner sideways; each of two rows says so over half of the floor only."""
    robot = sleigh().robot
    speed = 0.7

    def across(q):
        return np.array([0.0, 1.0, 0.3])

    def rows(q):
        return np.stack([np.cos(q[0]) * across(q), np.sin(q[0]) * across(q)])

    def rows_dot(q, v):
        x_dot = q[2] * v[0] - q[3] * v[1]
        return np.stack([-np.sin(q[0]) * x_dot * across(q), np.cos(q[0]) * x_dot * across(q)])

    def rate(q):
        return speed * np.array([np.cos(q[0]), np.sin(q[0])])

    def rate_dot(q, v):
        x_dot = q[2] * v[0] - q[3] * v[1]
        return speed * x_dot * np.array([-np.sin(q[0]), np.cos(q[0])])

    belt = rnc.Pfaffian(rows, rows_dot, ["near", "far"], rate, rate_dot)
    reduced = rnc.NonholonomicSystem(robot, [belt]).reduce()
    for x in (0.0, 0.4, np.pi / 2, 2.0, np.pi):
        q = robot.configuration({"root_joint": (x, 0.3, 0.5)})
        moving = reduced.at(q, [0.2, -0.6])
        np.testing.assert_allclose(across(q) @ moving.v, speed, atol=1e-12)
        # And keeps moving at it: the row is constant along its motion.
        np.testing.assert_allclose(across(q) @ moving.v_dot(np.array([0.4, 0.1])), 0.0, atol=1e-12)


def test_rows_of_a_sample_next_to_a_singular_configuration_are_not_chosen():
    good, bad = np.array([[1.0, 0.0], [0.0, 1.0], [0.6, 0.8]]), np.array([[0.0, 0.0], [0.0, 1.0], [0.0, 0.8]])
    assert _choose(np.stack([bad, good]), 2, 1e-9) == _choose(np.stack([good]), 2, 1e-9) == [0, 1]


def test_velocities_of_joints_for_many_states():
    robot = fire_truck().robot
    kinematics, data = Kinematics(robot), robot.model.createData()
    generator = np.random.default_rng(2)
    q = np.stack([[robot.random_configuration(generator) for _ in range(3)] for _ in range(2)])
    v = generator.normal(size=(2, 3, robot.nv))
    found = kinematics.position(q).with_velocity(v).joint_velocity(3)
    assert found.shape == (2, 3, 6)
    for i in np.ndindex(2, 3):
        pin.forwardKinematics(robot.model, data, q[i], v[i])
        np.testing.assert_allclose(found[i], data.v[3].vector, atol=1e-14)


def test_cached_and_forwarded_properties_are_documented_on_their_classes():
    assert ConfigurationEvaluation.R.__doc__.startswith("Null-space basis")
    assert StateEvaluation.R.__doc__ == ConfigurationEvaluation.R.__doc__


def test_what_is_learnt_describes_itself():
    _, law, regressor, controller = estimating(0.5, (1.6, 0.4, 1.5))
    said = controller.describe()
    assert said["type"] == "UncertainRedundancyController"
    assert said["alpha"] == 0.5
    assert said["initial"] == dict(zip(regressor.names, (1.6, 0.4, 1.5), strict=True))
    assert {**law.describe(), **said} == said | {}
    chained = ChainedStabilizer(4, k=0.4, rate=1.2, max_input=9.0)
    assert chained.describe() == {"type": "ChainedStabilizer", "n": 4, "k": 0.4, "rate": 1.2, "max_input": 9.0}
    robot = space_robot().robot
    units = MomentumRegressor(robot, "platform", [UnknownMass("joint_1"), UnknownMass("joint_2", unit=10.0)]).units
    assert units == ("kg", "10 kg")


def test_a_chord_across_the_path_is_left_to_the_caller():
    """Its end would move along the path without coming nearer."""
    across = chord_end_between([0.0, 0.0, 0.0, 0.0], (1.0, 0.0, 0.0), -1.0, 0.5, 0.2)
    assert across == pytest.approx((0.0, 0.0, 0.0, 0.0))
    x = np.linspace(-0.4, 0.4, 33)
    path, near = np.column_stack([x, 0 * x, 0 * x, x + 0.4]), PathPoint(0.0, 0.0, 0.0, 0.0)
    assert chord_end_fitted(path, 16, near, -1.0, 0.5, 0.2, 0.15) is near
    # Or beyond what was fitted.
    assert chord_end_fitted(path, 16, near, 1.0, 0.0, 0.2, 0.15) is near
    assert chord_end_fitted(path, 16, near, 1.0, 0.0, 0.9, 0.15) == pytest.approx((0.1, 0.0, 0.0, 0.0))


def test_a_track_alone_is_learnt_from_wheels_that_are_known():
    """``y = Y p`` at the true one, for any motion that the wheels allow."""
    robot = differential_drive()
    wheels = [rnc.RollingWheel(wheel, 0.1) for wheel in DRIVE]
    reduced = rnc.NonholonomicSystem(robot, wheels).reduce()
    alone, with_radius = (
        WheelRegressor(reduced, [*more, UnknownTrack(DRIVE)]) for more in ((), (UnknownRadius(DRIVE),))
    )
    assert alone.names == ("track of left_wheel, right_wheel",)
    for q, v2 in random_states(reduced, 4):
        v = reduced.velocity(q, v2)
        y, Y = alone.regress(q, v)
        np.testing.assert_allclose(Y @ [0.4], y, atol=1e-12)
        y_also, Y_also = with_radius.regress(q, v)
        np.testing.assert_allclose(y, y_also - 0.1 * Y_also[:, 0], atol=1e-12)


def test_a_distance_from_a_path_that_is_straight():
    path = CarPath((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), 4.0, 0.5)
    points = np.array([[1.0, 0.3], [0.2, -0.1], [-1.0, 0.2], [1.5, 0.0]])
    np.testing.assert_allclose(path.distance(points), [0.3, 0.1, 0.2, 0.0], atol=1e-9)


def test_powers_of_a_distance():
    distances = 10.0 ** np.linspace(-1, -3, 7)
    assert _order(distances, list(5.0 * distances**-1.5)) == pytest.approx(1.5)
    assert _order(distances, [0.0] * 7) == 0.0
    # Of the nearer half: what was before does not count.
    assert _order(distances, [1e9, 1e5, 1e3, *(2.0 * distances[3:] ** -1)]) == pytest.approx(1.0)


def test_a_way_that_is_singular_all_along_says_nothing():
    """In joint space the arm of the space robot stays stretched on its way."""
    reduced = space_robot()
    stretched = {"platform": 0.0, "joint_1": 0.0, "joint_2": 0.0, "joint_3": 0.0}
    singular = Singularity("E", ("tip_x",), 0.0, True, stretched)
    along = np.stack([reduced.robot.configuration({**stretched, "joint_1": 0.4})])
    assert _approach(reduced, along, singular) is None
    bent = np.stack([reduced.robot.configuration({**stretched, "joint_2": 1.0})])
    assert _approach(reduced, bent, singular).H_order == pytest.approx(2.0, abs=0.1)


def test_nothing_changes_along_no_way():
    model = sleigh().robot.model
    zero = directional_derivative(model, lambda q: np.outer(q, q), pin.neutral(model), np.zeros(3))
    assert zero.shape == (4, 4)
    assert not zero.any()


def test_brackets_of_a_spherical_joint_are_those_of_rotations():
    model = pin.Model()
    model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    generator = np.random.default_rng(1)
    x, y = generator.normal(size=(2, 5, 3))
    np.testing.assert_allclose(frame_bracket(model)(x, y), np.cross(x, y))
    composite = pin.JointModelComposite(pin.JointModelRUBX())
    composite.addJoint(pin.JointModelRUBY())
    model.addJoint(0, composite, pin.SE3.Identity(), "hinges")
    with pytest.raises(rnc.ConstraintError, match="no Lie bracket is known for a joint of type JointModelComp"):
        frame_bracket(model)


def test_more_rows_than_columns_have_no_full_row_rank():
    matrices = np.random.default_rng(0).normal(size=(5, 3, 2))
    assert not _full_row_rank(matrices)
    assert _full_row_rank(matrices.mT)


def linearization(A, B):
    """Of a system that is written down."""
    names = tuple(f"x{i}" for i in range(len(A)))
    return Linearization(A, B, names, ("u",), np.zeros(0), np.zeros(1), np.zeros(1), 0.0, (), None, None)


def test_a_cost_that_is_no_diagonal():
    """A double integrator with ``Q = [[1, c], [c, 2]]`` and R = 1: ``P12 = 1``, ``P22 = sqrt(2 + 2 P12 - ...)``."""
    linear = linearization(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]))
    cost = np.array([[1.0, -0.5], [-0.5, 2.5]])
    K = rnc.lqr(linear, cost)
    # P12^2 = Q11 and P22^2 = Q22 + 2 P12, from the corners of the Riccati equation; K = (P12, P22).
    np.testing.assert_allclose(K, [[1.0, np.sqrt(4.5)]], atol=1e-12)


def test_a_little_force_is_enough_for_little_dynamics():
    """What is reached by nanonewtons is reached."""
    linear = linearization(np.array([[1e-7, 1.0], [0.0, 1e-7]]), np.array([[0.0], [1e-9]]))
    K = rnc.lqr(linear, np.eye(2), 1e-18)
    assert np.linalg.eigvals(linear.A - linear.B @ K).real.max() < -0.5


def test_a_report_leaves_out_where_outputs_are_undefined():
    """To one side of a wall, or everywhere."""
    wall = -np.inf

    def coordinate(q):
        if q[0] < wall:
            raise rnc.SingularityError("behind the wall", q=q, condition=np.inf, rows=("ahead",))
        return q[:1]

    def rows(q):
        coordinate(q)
        return np.array([[q[2], -q[3], 0.0]])

    def rows_dot(q, v):
        return np.array([[-q[3] * v[2], -q[2] * v[2], 0.0]])

    ahead = rnc.Output(coordinate, rows, rows_dot, ["ahead"])
    reduced = rnc.NonholonomicSystem(sleigh().robot, [rnc.NoSideSlip("sleigh")]).reduce([ahead, rnc.FrameYaw("sleigh")])
    assert rnc.analyze(reduced, samples=16).growth_vector == (2, 3)
    wall = 0.0
    assert rnc.analyze(reduced, samples=16).growth_vector == (2, 3)
    wall = np.inf
    with pytest.raises(rnc.SingularityError, match="behind the wall"):
        rnc.analyze(reduced, samples=16)


def test_gripping_knows_which_rows_act_behind_rows_that_do_not():
    """The same wheels, with a coupling of joints ahead of them or after them."""
    robot = differential_drive()
    wheels = [rnc.RollingWheel(wheel, 0.1) for wheel in DRIVE]
    coupling = rnc.JointCoupling("left_wheel_joint", "right_wheel_joint", 1.0)
    q = robot.configuration({"root_joint": (1.0, 2.0, 0.7)})
    found = []
    for rows in ([coupling, *wheels], [*wheels, coupling]):
        reduced = rnc.NonholonomicSystem(robot, rows, ["right_wheel_joint"]).reduce([rnc.FrameSpeed("base")])
        grip = rnc.Grip(reduced, 0.5, dict.fromkeys(DRIVE, 10.0))
        assert grip.names == DRIVE
        found.append(grip.forces(q, np.array([0.4]), np.array([2.0])))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9)
    assert found[0].max() > 0.1


def test_gains_that_nobody_asked_otherwise_fade_at_three_behind_a_filter_of_eight():
    """As ``PositionGains`` says of itself: omega^2 = gamma / dt, and the error at 2 kappa2 gamma^3 / omega^2 [1/s]."""
    inertia, dt = np.diag([2.0, 0.5]), 0.01
    gains = PositionGains.scaled(inertia, dt)
    kappa1, kappa2 = gains.k1 / np.diag(inertia), gains.k2 / np.diag(inertia)
    square = kappa1 * gains.gamma**4 + kappa2 * gains.gamma**2
    np.testing.assert_allclose(square, 8.0 / dt)
    np.testing.assert_allclose(2 * kappa2 * gains.gamma**3 / square, 3.0)
    assert (gains.gamma, gains.sigma) == (8.0, 0.1)


def test_a_loop_is_out_of_reach_where_most_tries_end_equally_far():
    """Twenty of them within a hundredth, and not next to zero."""
    far = [0.3] * 15 + [0.302] * 5
    assert _out_of_reach([*far, *np.linspace(0.31, 2.0, 5)])
    assert not _out_of_reach([*far[:-1], *np.linspace(0.31, 2.0, 6)])
    assert not _out_of_reach([each * 1e-3 for each in far])


def test_inputs_of_many_states_are_of_as_many():
    """The same everywhere, but one for each: B of a batch has its shape."""
    reduced = sleigh()
    q = np.tile(reduced.robot.configuration(), (2, 3, 1))
    assert reduced.at(q).B.shape == (2, 3, 3, 2)
    assert reduced.at(q[0, 0]).B.shape == (3, 2)


@pytest.mark.parametrize("elapsed", [0.01, 0.2])
def test_a_filter_is_exact_over_samples_of_any_length(elapsed):
    """``z' = -2 gamma (z + gamma^2 e)`` with e held: towards ``-gamma^2 e`` by ``exp(-2 gamma t)``."""
    reduced = space_robot()
    gains = PositionGains(k1=2.0, k2=3.0, gamma=4.0, beta=1.0, sigma=0.1)
    tracker = PositionTracker(Hold([1.0, 0.5]), gains, outputs=np.array([0, 1]))
    q = reduced.robot.configuration({"joint_1": 0.3, "joint_2": 1.0, "joint_3": 0.4})
    measured = reduced.measure(q, np.zeros(3))
    state = tracker.initial_state(measured)
    _, state = tracker.step(1.0, measured, state)
    state = state._replace(z=np.array([5.0, -3.0]))
    _, after = tracker.step(1.0 + elapsed, measured, state)
    rest = -(4.0**2) * (np.array([1.0, 0.5]) - measured.x2[:2])
    np.testing.assert_allclose(after.z, rest + np.exp(-8.0 * elapsed) * (state.z - rest), rtol=1e-12)


def test_a_loop_has_no_more_coordinates_than_freedoms():
    reduced = four_bar()
    found = rnc.equilibrium(reduced, reduced.assembled(reduced.robot.configuration({"crank": 1.0})), hold=["crank"])
    one = rnc.linearize(reduced, found.q, T=found.T, coordinates=["crank"])
    assert one.A.shape == (2, 2)
    with pytest.raises(rnc.ConstraintError, match="coordinates crank, rocker are not independent under"):
        rnc.linearize(reduced, found.q, T=found.T, coordinates=["crank", "rocker"])
