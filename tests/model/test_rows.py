"""Rows, stacks of them and systems: what they hold, what they refuse, and in which words."""

from types import SimpleNamespace

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.model.admission import Admission, check_finite, spread, vector
from rnc_pin.model.coupling import CouplingRow, mimic_row
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.row_stack import OutputStack, RowStack
from rnc_pin.model.rows import Rows, check_defined
from rnc_pin.robots.sources.description import Mimic
from systems import rolling_base, sleigh
from textbook_systems import Bound, Flat, coupling, sliders

# ---------------------------------------------------------------------- rows, stacks and couplings


def test_a_stack_of_some_rows_is_what_its_blocks_say_one_by_one():
    """Rows that vary and rows that do not, kept in part and out of line, of one state and of many."""
    robot = rnc.Robot(rolling_base({"left": (0.1, 0.3), "right": (0.0, -0.3)}, 0.1))
    wheels = [rnc.RollingWheel(name, 0.1).bind(robot) for name in ("left", "right")]
    fixed = Flat(np.arange(10.0).reshape(2, 5), ["p", "q"], units=("N", "kg"), holonomic=(False, True))
    blocks, kinematics = [wheels[0], fixed, wheels[1]], Kinematics(robot)
    generator = np.random.default_rng(5)
    q = np.stack([[robot.random_configuration(generator) for _ in range(3)] for _ in range(2)])
    v = generator.normal(size=(2, 3, 5))
    for kept in (None, [0, 2, 4, 6], [3, 5, 7], [1, 2, 3], [4], []):
        stack, chosen = RowStack(blocks, kept), list(range(8)) if kept is None else kept
        names = [name for block in blocks for name in block.names]
        assert stack.names == tuple(names[row] for row in chosen)
        assert stack.size == len(chosen)
        joined = RowStack.joined(RowStack([fixed]), stack, RowStack([wheels[0]], [1]))
        assert joined.names == ("p", "q", *stack.names, names[1])
        assert joined.units == ("N", "kg", *stack.units, "m/s")
        assert joined.holonomic == (False, True, *stack.holonomic, False)
        for state, speed in ((q, v), (q[0], v[0]), (q[1, 2], v[1, 2])):
            motion = kinematics.position(state).with_velocity(speed)
            rates = motion.rates()
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


def test_outputs_know_which_are_angles_and_which_have_no_value():
    robot = sleigh().robot
    kinds = [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh"), rnc.FramePosition("sleigh", "xy")]
    outputs = OutputStack([kind.bind(robot) for kind in kinds])
    assert outputs.angular.tolist() == [False, True, False, False]
    assert outputs.quasi.tolist() == [True, False, False, False]
    q = np.stack([robot.configuration({"root_joint": (x, 0.3, 0.5)}) for x in (1.0, 2.0)])
    values = outputs.value(Kinematics(robot).position(q))
    np.testing.assert_allclose(values, [[0.0, 0.5, 1.0, 0.3], [0.0, 0.5, 2.0, 0.3]], atol=1e-12)


def test_rows_say_nothing_of_what_they_have_not():
    robot = sliders()
    rows = Flat(np.eye(3)[:2], ["a", "b"])
    at = Kinematics(robot).position(np.zeros((4, 5, 3)))
    for values in (rows.rate(at), rows.rate_dot(at), Rows.residual(rows, at), rows.bias_acceleration(at)):
        assert values.shape == (4, 5, 2)
        assert not values.any()
    assert rows.lines_of_action(at) is None
    assert Rows.bias_acceleration_gradient(rows, None) is None
    assert (Rows.conserved, Rows.affine, Rows.holonomic, Rows.on_ground, Rows.kind) == (None, False, (), False, None)
    check_defined("small", at, 0.5, 0.5, ("row",))  # the limit itself will do
    with pytest.raises(rnc.SingularityError) as told:
        check_defined("small", at, np.nextafter(0.5, 0.0), 0.5, ("row",))
    assert (told.value.condition, told.value.q.shape) == (pytest.approx(2.0), (3,))


@pytest.mark.parametrize("ratio", [2.0, -0.5, 2 / 3, -1.25])
@pytest.mark.parametrize("kinds", ["RR", "UR", "RU", "UU", "XX"])
def test_a_gap_of_a_coupling_forgets_the_turns_that_its_joints_forget(kinds, ratio):
    """Whole turns of continuous joints: none of it for joints with ends, and the least of what is left."""
    robot, offset = sliders(kinds, chain=False), 0.2
    row = CouplingRow(robot, "a", "b", ratio, offset)
    assert row.units == ("m/s" if kinds == "XX" else "rad/s",)
    assert row.holonomic == (True,)
    np.testing.assert_array_equal(row.matrix, [[1.0, -ratio]])
    turns = np.arange(-12, 13)
    generator, kinematics = np.random.default_rng(7), Kinematics(robot)
    for _ in range(6):
        a, b = generator.uniform(-3, 3, 2)
        q = robot.configuration({"a": a, "b": b})
        alike = a - ratio * b - offset
        mine = 2 * np.pi * turns if kinds[0] == "U" else np.zeros(1)
        drivers = 2 * np.pi * ratio * turns if kinds[1] == "U" else np.zeros(1)
        gaps = (alike + mine[:, None] + drivers).ravel()
        np.testing.assert_allclose(row.residual(kinematics.position(q)), [gaps[np.argmin(np.abs(gaps))]], atol=1e-9)
        many = kinematics.position(np.stack([q, q]))
        assert row.residual(many).shape == (2, 1)


def test_a_ratio_that_is_no_fraction_couples_rates_alone():
    """Of two continuous joints: fractions of numbers up to a thousand have a period, others none."""
    robot = sliders("UU", chain=False)
    for ratio, holonomic in ((1 / 1000, True), (1 / 1001, False), (997 / 999, True), (2**0.5, False)):
        assert CouplingRow(robot, "a", "b", ratio, 0.1).holonomic == (holonomic,)
    held = CouplingRow(robot, "b", None, 1.0, 0.1)
    assert held.names == ("coupling(b, None)",)
    assert held.pair == {"b", None}
    np.testing.assert_array_equal(held.matrix, [[0.0, 1.0]])
    q = robot.configuration({"a": 2.0, "b": 0.1 - 3.1})
    np.testing.assert_allclose(held.residual(Kinematics(robot).position(q)), [-3.1], atol=1e-12)
    with pytest.raises(rnc.ModelError, match="joint 'root_joint' has 3 degrees of freedom: only joints with one"):
        CouplingRow(sleigh().robot, "root_joint", None, 1.0, 0.0)


def test_what_a_file_couples_to_a_joint_that_is_locked_is_held():
    """``joint = multiplier of + offset``, solved for whichever of the two moves."""
    robot = sliders("RRR", chain=False)
    locked = SimpleNamespace(
        **{name: getattr(robot, name) for name in ("model", "nv", "joint_id")},
        joint_names=["a", "b"],
        locked={"c": 0.4},
    )
    for given, name, matrix, held in (
        (Mimic("a", "b", -2.0, 0.3), "coupling(a, b)", [1.0, 2.0], None),
        (Mimic("a", "c", -2.0, 0.3), "coupling(a, c)", [1.0, 0.0], -0.5),
        (Mimic("c", "b", -2.0, 0.3), "coupling(c, b)", [0.0, 1.0], -0.05),
        (Mimic("a", "b", 0.0, 0.3), "coupling(a, b)", [1.0, 0.0], 0.3),
    ):
        row = mimic_row(locked, given)
        assert row.names == (name,)
        np.testing.assert_array_equal(row.matrix, [[*matrix, 0.0]])
        if held is not None:
            assert row.offset == pytest.approx(held)
            assert row.driver is None
    assert mimic_row(locked, Mimic("c", "b", 0.0, 0.3)) is None


# ---------------------------------------------------------------------- admission and systems


def test_configurations_are_admitted_by_shape_number_and_length():
    flat, turning = Admission(sliders()), Admission(sliders("UXX"))
    given = np.array([1.0, 2.0, 3.0])
    admitted = flat.configuration(given)
    given[0] = 9.0
    assert admitted.tolist() == [1.0, 2.0, 3.0]
    assert flat.configuration(np.ones((2, 4, 3))).shape == (2, 4, 3)
    unit = np.array([0.6, 0.8, 5.0, 6.0])
    for q in (unit, np.stack([unit, unit])):
        np.testing.assert_array_equal(
            turning.configuration(q * [1 + 1e-9, 1 + 1e-9, 1, 1]), q * [1 + 1e-9, 1 + 1e-9, 1, 1]
        )
        longer = q * np.where(np.arange(q.size) >= q.size - 4, [1.001, 1.001, 1, 1] * (q.size // 4), 1.0).reshape(
            q.shape
        )
        with pytest.raises(rnc.InputError, match="not of unit length"):
            turning.configuration(longer)
    for wrong, words in (
        (1.0, r"q has shape \(\), expected \(..., 3\)"),
        (np.ones((3, 2)), r"q has shape \(3, 2\), expected \(..., 3\)"),
        ([1.0, np.inf, 0.0], r"q holds values that are not finite: \[ 1., inf,  ?0.\]"),
    ):
        with pytest.raises(rnc.InputError, match=words):
            flat.configuration(wrong)
    batch = np.zeros((2, 3, 3))
    batch[1, 0, 2] = np.nan
    for call in (lambda: flat.configuration(batch), lambda: vector(batch, 3, "q"), lambda: check_finite("q", batch)):
        with pytest.raises(
            rnc.InputError, match=r"q holds values that are not finite at state 1, 0: \[ 0., +0., nan\]"
        ):
            call()
    assert vector([1, 2], 2, "v").tolist() == [1.0, 2.0]
    assert vector(np.ones((5, 2)), 2, "v").shape == (5, 2)
    for wrong in (1.0, np.ones((2, 3))):
        with pytest.raises(rnc.InputError, match=r"v has shape .*, expected \(..., 2\)"):
            vector(wrong, 2, "v")
    with pytest.raises(rnc.InputError, match=r"v holds values that are not finite: \[nan, +1.\]"):
        vector([np.nan, 1.0], 2, "v")


def test_one_configuration_goes_with_many_velocities():
    q, v = np.arange(3.0), np.arange(8.0).reshape(4, 2)
    wide, same = spread(q, v, "v")
    np.testing.assert_array_equal(wide, np.tile(q, (4, 1)))
    np.testing.assert_array_equal(same, v)
    many, wide = spread(np.ones((2, 4, 3)), v, "v")
    assert many.shape == (2, 4, 3)
    np.testing.assert_array_equal(wide, np.stack([v, v]))
    with pytest.raises(rnc.InputError, match=r"q of shape \(3, 3\) and v of shape \(4, 2\) do not broadcast"):
        spread(np.ones((3, 3)), v, "v")


def test_a_system_says_what_there_is_too_much_or_too_little_of():
    robot = sliders()
    free = rnc.NonholonomicSystem(robot, [coupling("b", "a")], ["a"])
    assert (free.n, free.m, free.p, free.r) == (3, 1, 1, 2)
    base = rnc.Robot(rolling_base({"left": (0.0, 0.3), "right": (0.0, -0.3)}, 0.1))
    rolling = rnc.NonholonomicSystem(base, [rnc.RollingWheel(name, 0.1) for name in ("left", "right")])
    assert (rolling.n, rolling.m, rolling.p, rolling.r) == (5, 3, 0, 2)
    joints = [rnc.JointPosition(name) for name in "abc"]
    for outputs, words in (
        (joints, r"3 reducing outputs \(a, b, c\), expected 2: 3 degrees of freedom less 1 of the constraints"),
        ([], r"0 reducing outputs \(none\), expected 2"),
        (joints[:1] * 2, "duplicate output 'a'"),
        (joints[:2], "the reducing outputs do not parametrise the motion: at every sampled configuration the rows"),
    ):
        with pytest.raises(rnc.ConstraintError, match=words):
            free.reduce(outputs)
    with pytest.raises(rnc.ConstraintError, match="duplicate output 'c'"):
        free.reduce([joints[0], joints[2]], [joints[2]])
    assert free.reduce([joints[0], joints[2]], [joints[1]]).r == 2
    with pytest.raises(
        rnc.ConstraintError, match=r"^1 independent constraint rows leave no motion of 1 degrees of freed"
    ):
        rnc.NonholonomicSystem(sliders("X"), [Bound(Flat([[1.0]], ["stop"]))])
    for row in ([1.0, 0, 0], [1e-9, 0, 0]):
        with pytest.raises(rnc.ConstraintError, match=r"drives .*, which is declared as conserved"):
            rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("a")], np.array([row]).T)
    unmoved = np.array([[1e-14], [0], [1.0]])
    assert rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("a")], unmoved).r == 2
