"""Ways that runs seldom take, and small wrongs that nothing else noticed (``python -m benchmarks.mutation``)."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from controlled_tasks import TASK
from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.analysis.differences import gradient
from rnc_pin.analysis.redundancy import _decide
from rnc_pin.control import (
    ChainedStabilizer,
    MomentumRegressor,
    RedundancyController,
    SlitheringReference,
    SteeringController,
    UnknownMass,
    VelocityGains,
    VelocityTracker,
)
from rnc_pin.control.path_fit import PathPoint, chord_end_fitted
from rnc_pin.control.slithering import DrivenPath
from rnc_pin.model.independence import _candidates, _choose
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduction_data import row_scales
from rnc_pin.model.row_stack import OutputStack, RowStack
from rnc_pin.outputs import FrameOrientation
from rnc_pin.planning import Hold
from rnc_pin.planning.car_planner import _BEARINGS, _DISTANCES, _moves
from rnc_pin.planning.leg import best_legs
from rnc_pin.scenario.run import plan
from systems import fire_truck, free_flying_panda, mobile_manipulator, random_states, rolling_base, sleigh, space_robot


def test_an_effort_of_zero_in_a_file_says_nothing():
    model = rnc.Robot.from_urdf("space_robot.urdf").model
    model.upperEffortLimit[:] = [0.0, 0.0, 5.0, 0.5]
    robot = rnc.Robot(model)
    system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
    assert system.reduce().actuation.limits.tolist() == [np.inf, 5.0, 0.5]


def test_derivatives_know_actuators_that_are_a_function():
    """Of the configuration: forces of a thruster on the sleigh, by hand."""
    robot = sleigh().robot

    def thruster(q):
        c, s = q[2], q[3]  # of the heading, as a planar joint has it
        return np.array([[1.0, 0.2 * c], [0.0, 0.3 * s], [0.1 * q[0], 1.0]])

    reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], thruster).reduce()
    T = np.array([0.7, -0.4])
    for q, v2 in random_states(reduced, 2):
        found = state_derivatives(reduced, q, v2, T)
        wanted = gradient(robot.model, lambda p, v2=v2: reduced.forward_dynamics(p, v2, T), q, 1e-3)
        np.testing.assert_allclose(found.v2_dot_q, wanted, atol=1e-7)
        assert 0 < found.difference_error < 1e-9


def test_loads_take_casters_among_the_supports():
    """Two wheels and one caster are three supports: their loads follow from the centre of mass alone."""
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
    wheels = [rnc.RollingWheel(f"{side}_wheel", 0.1) for side in ("left", "right")]
    model = robot.model
    model.addFrame(pin.Frame("caster", 1, 0, pin.SE3(np.eye(3), np.array([0.5, 0.1, 0.0])), pin.FrameType.OP_FRAME))
    robot = rnc.Robot(model)
    reduced = rnc.NonholonomicSystem(robot, [*wheels, rnc.Caster("caster", 0.05)]).reduce()
    q = robot.configuration({"root_joint": (1.0, 2.0, 0.7)})
    grip = rnc.Grip(reduced, 0.5)
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    pin.updateFramePlacements(model, data)
    places = [data.oMf[model.getFrameId(name)].translation[:2] for name in ("left_wheel", "right_wheel", "caster")]
    weight = -pin.computeTotalMass(model) * model.gravity.linear[2]
    centre = pin.centerOfMass(model, data, q)[:2]
    expected = np.linalg.solve(np.vstack([np.transpose(places), np.ones(3)]), np.append(centre, 1.0)) * weight
    assert grip.names == ("left_wheel", "right_wheel")
    np.testing.assert_allclose(grip.loads(q, np.zeros(reduced.r), np.zeros(reduced.p)), expected[:2], rtol=1e-9)


@pytest.mark.parametrize(("aside", "turned"), [(0.0, 0.0), (0.2, 0.1), (-0.3, -0.2)])
def test_a_trailer_that_backs_up_beyond_its_oldest_place_goes_straight_on(aside, turned):
    """The path is one place, and its chord is longer than the way to it: by the right triangle that it makes."""
    reduced = fire_truck()
    reference = SlitheringReference(reduced, rnc.Task.of(reduced, *TASK), "tractor", "rear_axle")
    q = reduced.robot.configuration({"root_joint": [0.01, aside, turned], "hitch": -turned})
    measurement = reduced.measure(q, np.zeros(3))
    path = np.array([[0.0, 0.0, 0.0, 0.0]])
    point, state = reference.step(measurement, np.zeros(3), DrivenPath(path, 0.0))
    assert reference.length == 1.0
    np.testing.assert_allclose(point.position, [np.arcsin(aside)], atol=1e-12)
    assert np.isnan(point.jerk).tolist() == [True]
    assert len(state.path) == 1


def bend(x):
    """A polynomial of the path's degree: place, heading and curvature."""
    y, slope, bent = 0.3 * x**2 - 0.2 * x**3 + 0.1 * x**5, 0.6 * x - 0.6 * x**2 + 0.5 * x**4, 0.6 - 1.2 * x + 2.0 * x**3
    return y, np.arctan(slope), bent / (1 + slope**2) ** 1.5


def test_a_fitted_path_is_the_polynomial_that_it_is_of():
    """A chord from beside a bend ends on it, at its length; where places end before or after, nothing is fitted."""
    x = np.linspace(-0.4, 0.4, 33)
    y, heading, _ = bend(x)
    driven = np.r_[0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y)))]
    path, window = np.column_stack([x, y, heading, driven]), 0.15
    older = 16  # at x = 0, along which the axes of the fit are then
    near = PathPoint(0.0, 0.0, 0.0, 0.0)
    end = (0.003, *bend(0.003)[:2])
    px, py = 0.5, 0.3
    L = float(np.hypot(px - end[0], py - end[1]))
    found = chord_end_fitted(path, older, near, px, py, L, window)
    np.testing.assert_allclose(found, [*end, bend(0.003)[2]], atol=1e-9)
    assert chord_end_fitted(path, len(path) - 1, near, px, py, L, window) is near
    assert chord_end_fitted(path, older, near, px, py, L, 0.01) is near
    for last in range(8, len(path) - 1):  # of which no place is ahead
        there = PathPoint(*path[last, :3], 0.0)
        assert chord_end_fitted(path[: last + 1], last, there, px, py, L, window) is there


def test_rows_that_vanish_everywhere_have_no_length():
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
    wheel = rnc.RollingWheel("left_wheel", 0.1).bind(robot)
    lengths = row_scales(
        robot,
        RowStack([wheel, rnc.Caster("nose", 0.1).bind(robot)]),
        OutputStack([]),
        np.array([robot.random_configuration(np.random.default_rng(k)) for k in range(5)]),
    )
    assert lengths[-1] == 0.0
    # Forwards 1 m/s of the base, 0.2 m of its turning and 0.1 m of the wheel's; sideways the base alone.
    assert (lengths[:2] >= 1.0).all()


def test_a_long_sample_learns_what_the_leak_leaves_of_it():
    """With ``e`` held, ``gdot = -sigma g + beta e`` has the closed form; without a leak it is a straight line."""
    reduced = sleigh()
    q, still = reduced.robot.configuration(), rnc.planning.Hold([0.3, 0.0])
    measured = reduced.measured(q, np.zeros(3), np.zeros(2))
    for sigma, time in ((2.0, 1.5), (0.0, 1.5)):
        target = rnc.control.ReducingOutputController(reduced, still)
        tracker = VelocityTracker(target, VelocityGains(k=1e9, beta=4.0, sigma=sigma))  # k: the step is not bounded
        state = tracker.initial_state(measured)._replace(time=0.0)
        command, state = tracker.step(time, measured, state)
        whole = (1.0 - np.exp(-sigma * time)) / sigma if sigma else time
        np.testing.assert_allclose(state.g, whole * 4.0 * command.v2_desired, rtol=1e-6)


def test_nothing_is_left_of_rows_that_are_not_there():
    reduced = sleigh()
    assert reduced.position_residual(reduced.robot.configuration()).shape == (0,)
    assert reduced.position_residual(np.tile(reduced.robot.configuration(), (2, 3, 1))).shape == (2, 3, 0)


def test_orientations_of_many_states_are_those_of_each():
    reduced = free_flying_panda()
    states = [q for q, _ in random_states(reduced, 4)]
    hand = FrameOrientation("panda_hand").bind(reduced.robot)
    kinematics = Kinematics(reduced.robot)
    each = [hand.value(kinematics.position(q)) for q in states]
    together = hand.value(kinematics.position(np.reshape(states, (2, 2, -1))))
    np.testing.assert_allclose(together, np.reshape(each, (2, 2, 3)), atol=1e-12)


def test_a_warning_points_at_the_line_that_made_the_system():
    model = rolling_base({"left": (0.0, 0.3), "right": (0.0, -0.3)}, 0.1)
    joint = model.getJointId("right_spin")
    model.jointPlacements[joint] = model.jointPlacements[joint] * pin.SE3(
        pin.rpy.rpyToMatrix(0.0, 0.0, 3e-4), np.zeros(3)
    )
    robot = rnc.Robot(model)
    with pytest.warns(rnc.ModelWarning, match="nearly dependent|rounded angles") as caught:
        rnc.NonholonomicSystem(robot, [rnc.RollingWheel("left", 0.1), rnc.RollingWheel("right", 0.1)])
    assert {each.filename for each in caught} == {__file__}


@pytest.mark.parametrize("forward_only", [True, False])
def test_the_planner_tries_poses_round_about_the_cheapest_first(forward_only):
    moves = _moves(forward_only)
    distance, bearing = np.hypot(*moves[:, :2].T), np.arctan2(moves[:, 1], np.abs(moves[:, 0]))
    assert np.isclose(distance[:, None], _DISTANCES, atol=1e-12).any(axis=1).all()
    assert np.isclose(bearing[:, None], _BEARINGS, atol=1e-12).any(axis=1).all()
    assert (moves[:, 0] < -1e-12).any() == (not forward_only)
    assert (np.diff(best_legs(np.zeros_like(moves), moves, 1.0, forward_only)[0]) >= 0).all()


def test_a_wheel_grips_along_and_across():
    """By the names of its rows."""
    made = plan("wheels-uncertain", {"comparisons": {}}).experiment
    reduced, names = made.reduced, made.reduced.all_constraints.names
    grip = rnc.Grip(reduced, 0.6)
    for q, v2 in random_states(reduced, 3):
        T = np.array([0.3, -0.2, 0.1, 0.4])[: reduced.p]
        multipliers = dict(zip(names, reduced.contact_forces(q, v2, T), strict=True))
        for wheel, force in zip(grip.names, grip.forces(q, v2, T), strict=True):
            own = [value for name, value in multipliers.items() if f"({wheel}" in name and "vertical" not in name]
            assert len(own) == 2
            np.testing.assert_allclose(force, np.hypot(*own), rtol=1e-12)


def test_of_rows_that_are_never_well_independent_the_best_at_its_worst_are_kept():
    generator = np.random.default_rng(5)
    for _ in range(5):
        matrices = np.array([1.0, 0.0, 0.0]) + 0.001 * generator.normal(size=(3, 4, 3))  # nearly parallel
        matrices /= np.linalg.norm(matrices, axis=-1, keepdims=True)

        def worst(kept, matrices=matrices):
            return min(np.linalg.svd(matrix[kept], compute_uv=False)[-1] for matrix in matrices)

        tried = [worst(kept) for kept in _candidates(matrices, 3, 1e-9) if len(kept) == 3]
        assert len(set(tried)) > 1
        assert max(tried) < 1e-3
        np.testing.assert_allclose(worst(_choose(matrices, 3, 1e-9)), max(tried))


def test_batches_that_do_not_go_together_are_refused():
    reduced = sleigh()
    q = np.tile(reduced.robot.configuration(), (2, 3, 1))
    with pytest.raises(rnc.InputError, match=r"q of shape \(2, 3, 4\) and v2 of shape \(2, 2\) do not broadcast"):
        reduced.at(q, np.zeros((2, 2)))


ONES, TALL, WIDE = np.ones((3, 1, 1)), np.ones((3, 2, 1)), np.ones((3, 1, 2))
NONE = np.zeros((3, 0, 1))


@pytest.mark.parametrize(
    ("A4", "steering", "moved", "A5_depends", "expected"),
    [
        (NONE, ONES, [], False, ("2s", "its value steers")),
        (NONE, TALL, [], False, (None, "do not steer A3 v21 either")),
        (NONE, 0 * ONES, [], False, (None, "do not steer A3 v21 either")),
        (TALL, ONES, [True, True], False, (None, "2 vertical outputs moved by 1 redundant one: too few")),
        (0 * ONES, ONES, [True], False, (None, "A4 has not full row rank")),
        (ONES, ONES, [True], True, ("1", "A4 has full row rank")),
        (WIDE, ONES, [True], True, ("1", "some freedom is left")),
        (WIDE, ONES, [True, False], False, (None, "1 vertical output moved by 2 redundant ones: class 2")),
        (ONES, ONES, [True, False], True, (None, "A5 depends on x22")),
        (ONES, ONES, [True, False], False, ("2", "A5 independent of x22")),
    ],
)
def test_a_class_is_what_its_blocks_say(A4, steering, moved, A5_depends, expected):
    found, reason = _decide(A4, steering, np.array(moved, dtype=bool), A5_depends)
    assert found == expected[0]
    assert expected[1] in reason


def refusals():
    truck, manipulator, robot = fire_truck(), mobile_manipulator(), rnc.Robot.from_urdf("space_robot.urdf")
    of_truck = rnc.Task.of(truck, *TASK)
    of_two = rnc.Task.of(truck, TASK[0], TASK[1], ["trailer_yaw", "tractor_yaw"])
    of_robot = rnc.Task.of(space_robot(), ["tip_x", "tip_y"], ["joint_1"], ["platform"])
    light = robot.model.copy()
    light.inertias[3] = pin.Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
    flat = rnc.Robot(pin.buildSampleModelManipulator())

    def two(q):
        return np.zeros((2, flat.nv))

    return {
        "stabiliser without motion": (lambda: ChainedStabilizer(3, max_input=0.0), "positive largest input, found 0"),
        "no unknown body": (lambda: MomentumRegressor(robot, "platform", []), "name at least one body of unknown mass"),
        "unknown body without mass": (
            lambda: MomentumRegressor(rnc.Robot(light), "platform", [UnknownMass("joint_2")]),
            "body behind joint 'joint_2' has no mass",
        ),
        "weights of the wrong number": (
            lambda: RedundancyController(of_robot, Hold([0.0, 0.0]), Hold([0.0]), weights=[1.0, 2.0]),
            "weights have to be 1 positive numbers",
        ),
        "steering two by one": (
            lambda: SteeringController(truck, of_two, Hold([0.0, 0.0]), Hold([0.0, 0.0])),
            "as many redundant as vertical outputs, found 1 and 2",
        ),
        "two headings of a trailer": (
            lambda: SlitheringReference(truck, of_two, "tractor", "rear_axle"),
            "slithers by one vertical output, its yaw; the task has trailer_yaw, tractor_yaw",
        ),
        "no place of the trailer": (
            lambda: SlitheringReference(truck, of_truck, "tractor", "rear_axle", kingpin="tractor", spacing=-1.0),
            "spacing of a slithering reference has to be positive",
        ),
        "too few names": (
            lambda: rnc.NonholonomicSystem(flat, [rnc.Pfaffian(two, two, ["one"])]),
            "1 names for 2 Pfaffian rows",
        ),
        "names in one word": (
            lambda: rnc.NonholonomicSystem(flat, []).reduce([rnc.Output(lambda q: q, two, two, "both")]),
            "names of a user-defined output have to be a list of strings, found 'both'",
        ),
        "position of a ball": (
            lambda: rnc.NonholonomicSystem(manipulator.robot, []).reduce([rnc.JointPosition("root_joint")]),
            "joint 'root_joint' has 3 degrees of freedom: use outputs of a frame",
        ),
        "force on a ball": (
            lambda: rnc.NonholonomicSystem(manipulator.robot, [], ["root_joint"]),
            "actuator 'root_joint' is a joint of several degrees of freedom",
        ),
    }  # fmt: skip


REFUSED = refusals()


@pytest.mark.parametrize(("call", "words"), REFUSED.values(), ids=REFUSED)
def test_what_is_refused_is_said(call, words):
    with pytest.raises(rnc.RncError) as caught:
        call()
    assert words in str(caught.value)
