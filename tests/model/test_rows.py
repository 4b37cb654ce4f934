"""Rows, stacks of them and systems, their mechanisms: what they hold, what they refuse, in which words."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import ConstantRows, FrameAnchor, GroundContact, JointCoupler, Rows, RowStack, check_defined
from systems import rolling_base
from textbook_systems import Bound, Flat, sliders


def test_a_stack_of_some_rows_is_what_its_blocks_say_one_by_one(generator):
    """Rows that vary and rows that do not, kept in part and out of line, of one state and of many."""
    robot = rnc.Robot(rolling_base({"left": (0.1, 0.3), "right": (0.0, -0.3)}, 0.1))
    wheels = [rnc.RollingWheel(name, 0.1).bind(robot) for name in ("left", "right")]
    fixed = Flat(np.arange(10.0).reshape(2, 5), ["p", "q"], units=("N", "kg"), holonomic=(False, True))
    blocks, kinematics = [wheels[0], fixed, wheels[1]], Kinematics(robot)
    q = np.stack([[robot.random_configuration(generator) for _ in range(3)] for _ in range(2)])
    v = generator.normal(size=(2, 3, 5))
    for kept in (None, [0, 2, 4, 6], [3, 5, 7], [1, 2, 3], [4], []):
        stack, chosen = RowStack(blocks, kept), list(range(8)) if kept is None else kept
        names = [name for block in blocks for name in block.names]
        assert (stack.names, stack.size) == (tuple(names[row] for row in chosen), len(chosen))
        stacks = RowStack([fixed]), stack, RowStack([wheels[0]], [1])
        joined = RowStack.of(place for each in stacks for place in each.places)
        assert joined.names == ("p", "q", *stack.names, names[1])
        assert joined.units == ("N", "kg", *stack.units, "m/s")
        assert joined.holonomic == (False, True, *stack.holonomic, False)
        for state, speed in ((q, v), (q[0], v[0]), (q[1, 2], v[1, 2])):
            motion = kinematics.position(state).with_velocity(speed)
            rates = motion
            for values, of, axis in (
                (stack.jacobian(motion), lambda block, at=motion: block.jacobian(at), -2),
                (stack.bias_acceleration(motion), lambda block, at=motion: block.bias_acceleration(at), -1),
                (stack.jacobian_dot(rates), lambda block, at=rates: block.jacobian_dot(at), -2),
                (stack.rate(motion), lambda block, at=motion: block.rate(at), -1),
                (stack.rate_dot(rates), lambda block, at=rates: block.rate_dot(at), -1),
            ):
                expected = np.take(np.concatenate([of(block) for block in blocks], axis=axis), chosen, axis=axis)
                np.testing.assert_array_equal(values, expected)
            both = joined.jacobian(motion)
            np.testing.assert_array_equal(both[..., 2:-1, :], stack.jacobian(motion))
            np.testing.assert_array_equal(both[..., -1, :], wheels[0].jacobian(motion)[..., 1, :])
            np.testing.assert_array_equal(both[..., :2, :], fixed.jacobian(motion))
            points, directions = stack.lines_of_action(motion)
            assert points.shape == directions.shape == (*state.shape[:-1], len(chosen), 3)
            for place, row in enumerate(chosen):
                if row in (3, 4):  # that act nowhere
                    assert np.isnan(points[..., place, :]).all()
                    assert np.isnan(directions[..., place, :]).all()
                else:
                    where, along = wheels[row > 4].lines_of_action(motion)
                    np.testing.assert_array_equal(points[..., place, :], where[..., row % 5, :])
                    np.testing.assert_array_equal(directions[..., place, :], along[..., row % 5, :])


def test_rows_say_nothing_of_what_they_have_not():
    robot, rows = sliders(), Flat(np.eye(3)[:2], ["a", "b"])
    at = Kinematics(robot).position(np.zeros((4, 5, 3)))
    for values in (rows.rate(at), rows.rate_dot(at), Rows.residual(rows, at), rows.bias_acceleration(at)):
        assert values.shape == (4, 5, 2)
        assert not values.any()
    assert rows.lines_of_action(at) is None
    assert Rows.bias_acceleration_gradient(rows, None) is None
    assert (Rows.conserved, Rows.affine, Rows.holonomic, Rows.on_ground, Rows.kind) == (None, False, (), False, None)
    check_defined("small", at.q, 0.5, 0.5, ("row",))  # the limit itself will do
    with pytest.raises(rnc.SingularityError) as told:
        check_defined("small", at.q, np.nextafter(0.5, 0.0), 0.5, ("row",))
    assert (told.value.condition, told.value.q.shape) == (pytest.approx(2.0), (3,))


def tilted(angle):
    """A body whose own x axis stands up, but for an angle."""
    model = pin.Model()
    add_body(model, "body", "Spherical", 1.0, frame="top")
    q = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, angle - np.pi / 2, 0.7)).coeffs()
    return rnc.Robot(model), q


def apart(distance):
    model = pin.Model()
    add_body(model, "slide", "PX", 1.0, frame="end")
    return rnc.Robot(model), np.array([distance])


KINDS = {
    "yaw": (rnc.FrameYaw("top"), tilted, 1e-6, "a yaw is not defined for a vertical axis"),
    "tilt": (rnc.FrameTilt("top", "x"), tilted, 1e-6, "the tilt of a vertical axis has no rate"),
    "wheel": (rnc.RollingWheel("top", 0.1, axis="x"), tilted, 1e-6, "a wheel lies flat on the ground"),
    "distance": (rnc.Distance("universe", "end"), apart, 1e-9, "a distance has no rate where it is zero"),
}


@pytest.mark.parametrize(("kind", "robot_at", "limit", "words"), KINDS.values(), ids=KINDS)
def test_rates_are_right_down_to_a_limit(kind, robot_at, limit, words):
    """Beside differences of the value where there is one; below the limit they are refused, with its share."""
    robot, q = robot_at(10 * limit)
    rows = kind.bind(robot)
    found = rows.jacobian(Kinematics(robot).position(q))
    if hasattr(rows, "value"):
        for axis, column in zip(np.eye(robot.nv), found.T, strict=True):
            step = limit * axis
            moved = (pin.integrate(robot.model, q, sign * step) for sign in (1, -1))
            ahead, behind = (rows.value(Kinematics(robot).position(each)) for each in moved)
            np.testing.assert_allclose((ahead - behind) / (2 * limit), column, rtol=0.02, atol=1e-3)
    robot, q = robot_at(0.2 * limit)
    with pytest.raises(rnc.SingularityError, match=words) as told:
        kind.bind(robot).jacobian(Kinematics(robot).position(q))
    assert told.value.condition == pytest.approx(5.0 / limit, rel=1e-3)
    np.testing.assert_array_equal(told.value.q, q)


class _DriftingRow(ConstantRows):
    """A runner of a user that glides at an angle of 0.2 rad to its frame's x axis; velocities are in body axes."""

    names, units = ("drift(sleigh)",), ("m/s",)
    matrix = np.array([[-np.sin(0.2), np.cos(0.2), 0.0]])

    def mechanisms(self):
        return (GroundContact("sleigh", axle=self.matrix[0], friction="lateral"),)


def test_a_kind_of_a_user_glides_along_its_own_heading_in_mujoco():
    pytest.importorskip("mujoco")
    from rnc_pin.lab.mujoco import MuJoCoPlant

    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    reduced = rnc.NonholonomicSystem(robot, [Bound(_DriftingRow())]).reduce()
    plant, q = MuJoCoPlant(reduced), robot.configuration()
    plant.reset(q, reduced.at(q, np.array([1.0, 0.0])).v)
    plant.advance(0.2)
    _, v = plant.read()
    assert abs(_DriftingRow.matrix[0, :2] @ v[:2]) < 0.02
    assert v[0] > 0.9


def test_built_in_kinds_say_which_mechanism_enforces_them():
    """Those of the ground, of joints and of loops; a user's rows and a momentum have none."""
    arm = rnc.Robot.from_urdf("space_robot.urdf")
    rows = rnc.Pfaffian(lambda q: np.eye(4)[:1], lambda q, v: np.zeros((1, 4))).bind(arm)
    assert (rows.mechanisms(), rnc.MomentumConservation("platform").bind(arm).mechanisms()) == ((), ())
    (coupler,) = rnc.JointCoupling("joint_2", "joint_1", ratio=-0.5).bind(arm).mechanisms()
    assert coupler == JointCoupler("joint_2", "joint_1", -0.5)
    (anchor,) = rnc.LoopClosure("platform_body", "tip", "point", offset_b=(0.1, 0.0, 0.0)).bind(arm).mechanisms()
    assert isinstance(anchor, FrameAnchor)
    assert anchor.frames == ("platform_body", "tip")
    assert anchor.point
    np.testing.assert_array_equal(anchor.placements[1].translation, [0.1, 0.0, 0.0])


@pytest.mark.parametrize(("options", "friction"), [
    ({}, "all"),
    ({"lateral": False}, "longitudinal"),
    ({"roller": 0.0}, "longitudinal"),
    ({"roller": 0.7854}, "oblique"),
])  # fmt: skip
def test_a_wheel_has_friction_along_its_rows(options, friction):
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
    rows = rnc.RollingWheel("left_wheel", 0.1, **options).bind(robot)
    (contact,) = rows.mechanisms()
    assert (contact.frame, contact.radius, contact.friction) == ("left_wheel", 0.1, friction)
