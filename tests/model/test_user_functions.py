"""Rates of user-defined functions: derived, or checked."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.model.user_functions import check_rate, derived_rate
from simple_controllers import Inputs


def sleigh(q):
    """Knife edge on a planar base, in the coordinates of a fixed frame, with tenths of a metre."""
    return np.array([[-np.sin(3 * q[0]) * np.exp(q[1]), np.cos(q[2]) / (2 + q[0] ** 2), 0.1 * q[1], q[3] ** 3]])


def test_a_derived_rate_is_that_of_the_closed_form(generator, robot):
    rate = derived_rate(robot, sleigh, "rows(q)")
    q, v = generator.uniform(-1, 1, 4), generator.normal(size=4)
    exact = [
        -3 * v[0] * np.cos(3 * q[0]) * np.exp(q[1]) - np.sin(3 * q[0]) * np.exp(q[1]) * v[1],
        -np.sin(q[2]) * v[2] / (2 + q[0] ** 2) - np.cos(q[2]) * 2 * q[0] * v[0] / (2 + q[0] ** 2) ** 2,
        0.1 * v[1],
        3 * q[3] ** 2 * v[3],
    ]
    np.testing.assert_allclose(rate(q, v)[0], exact, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(rate(q, 0 * v), 0 * rate(q, v))


def test_functions_may_return_the_same_memory_each_time(generator, robot):
    memory = np.zeros((1, 4))

    def turning(q):
        return np.array([[1.0, np.sin(float(q[1])), 0.0, float(q[3])]])

    def in_place(q):
        memory[:] = turning(q)
        return memory

    def system(rows):
        own = rnc.Pfaffian(rows, names=["own"], rate=lambda q: 0.1 * rows(q)[0, 1:2])
        return rnc.NonholonomicSystem(robot, [own], robot.joint_names[1:]).reduce()

    systems = [system(turning), system(in_place)]
    q, v2, T = robot.random_configuration(generator), generator.normal(size=3), generator.normal(size=3)
    expected, found = (each.forward_dynamics(q, v2, T) for each in systems)
    np.testing.assert_array_equal(found, expected)
    assert np.abs(systems[1].at(q, v2).A_dot).max() > 0.1


@pytest.mark.parametrize(("factor", "what"), [(1.0, None), (1.4, "is 1.4"), (-1.0, "differences give -1")])
def test_a_residual_has_the_rate_of_its_rows(factor, what, robot):
    row = np.array([[0.0, 1.0, 0.0, 0.0]])
    kept = rnc.Pfaffian(lambda q: abs(factor) * row, names=["kept"], residual=lambda q: np.sign(factor) * q[1:2] - 0.3)
    if what is None:
        assert rnc.NonholonomicSystem(robot, [kept], []).reduce().r == 3
        return
    with pytest.raises(rnc.ConstraintError, match=r"rows\(q\) v .* is not the rate of residual\(q\): row 'kept'"):
        rnc.NonholonomicSystem(robot, [kept], [])


def bend(q):
    return np.array([[1.0, np.sin(q[1]), 0.0, 0.0], [0.0, 0.0, 1.0, q[3] ** 2]])


def bend_rate(q, v, sign=1.0):
    return np.array([[0.0, np.cos(q[1]) * v[1], 0.0, 0.0], [0.0, 0.0, 0.0, sign * 2 * q[3] * v[3]]])


@pytest.mark.parametrize(("kind", "words"), [
    (rnc.Pfaffian(bend, bend_rate), None),
    (rnc.Pfaffian(bend, lambda q, v: bend_rate(q, v, -1.0), ["high", "low"]),
        r"rows_dot\(q, v\).*row 'low', entry 3 is (\S+), differences give -\1 "),
    (rnc.Output(None, bend, lambda q, v: bend_rate(q, v, -1.0), ["x", "y"]),
        r"jacobian_dot\(q, v\) of output .* row 'y', entry 3"),
    (rnc.Output(lambda q: np.sin(q[:1]), lambda q: np.array([[-np.cos(q[0]), 0, 0, 0]]), names=["a"]),
        r"jacobian\(q\) v of output .* is not the rate of value\(q\): row 'a' is"),
    (rnc.Pfaffian(lambda q: np.eye(4)[:1], rate=lambda q: np.sin(q[:1]),
        rate_dot=lambda q, v: np.cos(q[:1]) * v[:1] * 1.001), r"rate_dot\(q, v\).*'row\[0\]'.*differences give"),
])  # fmt: skip
def test_a_wrong_rate_is_refused_with_row_entry_and_both_values(kind, words, robot):
    if words is None:
        kind.bind(robot)
    else:
        with pytest.raises(rnc.ConstraintError, match=words):
            kind.bind(robot)


def test_a_rate_that_is_right_at_one_state_by_chance_is_refused(robot):
    states = []

    def rate(q, v):
        states.append(q)
        return bend_rate(q, v, 1.0 if len(states) == 1 else -1.0)

    with pytest.raises(rnc.ConstraintError, match="differences give"):
        check_rate(robot, bend, rate, ("rows(q)", "rows_dot(q, v)"), ["a", "b"])
    assert len(states) == 2


def test_no_rate_is_checked_next_to_where_a_function_is_undefined(robot):
    """It is undefined between a twentieth and a fifth of the way from the first random state along its velocity."""
    states = []
    check_rate(robot, bend, lambda q, v: states.append((q, v)) or bend_rate(q, v), ("", ""), ["a", "b"])
    (first, along), beside = states

    def partial(q):
        share = along @ (q - first) / (along @ along)
        return bend(q) if not 0.05 < share < 0.2 or abs(q - first - share * along).max() > 1e-6 else bend(q) + np.nan

    states.clear()
    check_rate(robot, partial, lambda q, v: states.append((q, v)) or bend_rate(q, v), ("", ""), ["a", "b"])
    np.testing.assert_array_equal(states[0], beside)
    assert len(states) == 2


def test_the_rate_of_an_angle_is_checked_where_it_jumps_by_a_turn(robot):

    def angle(q):
        return np.remainder(9.0 * q[:1], 2 * np.pi)

    def jacobian(q):
        return np.array([[9.0, 0.0, 0.0, 0.0]])

    rnc.Output(angle, jacobian, names=["angle"], angular=True).bind(robot)
    states = []
    check = (lambda q, v: states.append(q) or jacobian(q) @ v), ("value(q)", "jacobian(q) v"), ["angle"]
    check_rate(robot, angle, *check, angular=True)
    jumping = lambda q: angle(q - states[0])  # noqa: E731 - at the first state that is checked
    assert jumping(states[0] - 1e-9) - jumping(states[0] + 1e-9) > 6.0
    check_rate(robot, jumping, *check, angular=True)
    unsteady = lambda q, v: (1 + (q == states[0]).all()) * jacobian(q) @ v  # noqa: E731
    with pytest.raises(rnc.ConstraintError, match="differences give"):
        check_rate(robot, jumping, unsteady, *check[1:], angular=True)


def test_a_rate_over_time_includes_its_flow(generator, robot):
    rate = derived_rate(robot, lambda q, t: np.array([np.sin(q[1] * t), q[0] * t**2]), "target(q, t)", timed=True)
    (q, v), t = generator.normal(size=(2, 4)), 0.7
    exact = [np.cos(q[1] * t) * (v[1] * t + q[1]), v[0] * t**2 + 2 * q[0] * t]
    np.testing.assert_allclose(rate(q, v, t), exact, atol=1e-10)


def test_rows_that_jump_have_no_rate_to_derive(robot):
    with pytest.raises(rnc.ConstraintError, match="has no rate that differences can find"):
        rnc.Pfaffian(lambda q: np.array([[1.0, np.floor(1e4 * q[1]), 0.0, 0.0]])).bind(robot)


LEVEL, RATE = np.array([[0.0, 0.0, 1.0, 1.0]]), np.zeros((1, 4))


@pytest.mark.parametrize("bad", [np.zeros((1, 3)), np.zeros((2, 4)), None, "x", [[1, 2], [3]]])
def test_what_is_no_row_while_differences_are_taken_is_refused_with_its_shape(bad, robot):
    """The first configuration, by which the number of rows is known, is the neutral one."""
    jacobian, value = (lambda q, good=good: bad if q.any() else good for good in (LEVEL, np.zeros(1)))
    for build in (
        lambda: rnc.Pfaffian(jacobian),
        lambda: rnc.Pfaffian(lambda q: LEVEL, lambda q, v: RATE, residual=value),
        lambda: rnc.FixedOutput(rnc.Output(value, lambda q: LEVEL, names=["y"]), 0.0),
        lambda: rnc.FixedOutput(rnc.Output(lambda q: LEVEL @ q, jacobian, names=["y"]), 0.0),
    ):
        with pytest.raises(rnc.InputError, match=r"\(q\).* returned .*, expected"):
            rnc.NonholonomicSystem(robot, [build()], robot.joint_names).reduce()


@pytest.mark.parametrize("where", ["rows", "rows_dot", "force", "B", "value", "reducing", "jacobian", "jacobian_dot"])
def test_a_function_that_is_not_finite_in_mid_run_is_named(where, robot):
    begun = []

    def until(name, good):
        lost = np.nan if name == where else 0.0
        return lambda q, *v: (good(q) if callable(good) else good) + (lost if begun and q[0] >= 0.03 else 0.0)

    rows = until("rows", LEVEL * [0, 0, 0, 1]), until("rows_dot", RATE)
    value = until(where if where == "reducing" else "value", lambda q: LEVEL @ q)
    output = rnc.Output(value, until("jacobian", LEVEL), until("jacobian_dot", RATE), names=["level"])
    forces = [rnc.forces.ForceFunction(until("force", np.zeros(4)), "drag")] if where == "force" else []
    actuation = until("B", np.eye(4)) if where == "B" else robot.joint_names
    system = rnc.NonholonomicSystem(robot, [rnc.Pfaffian(*rows, names=["row"])], actuation, forces=forces)
    outputs = [output, *map(rnc.JointPosition, robot.joint_names[:2])]
    reduced = system.reduce(outputs) if where == "reducing" else system.reduce(vertical=[output])
    begun.append(True)
    name = {"rows": "'row'", "rows_dot": "'row'", "force": "'drag'", "B": r"B\(q\)"}.get(where, "output 'level'")
    with pytest.raises(rnc.DivergenceError, match=f"at t = 0.*{name} is not finite"):
        rnc.simulate(reduced, Inputs(lambda t: [5.0, 0.0, 0.0, 0.0]), robot.configuration(), 1.0, 0.01)


def test_joints_that_are_added_after_reduction_are_refused_in_one_line(robot):
    system, q, v = rnc.NonholonomicSystem(robot), robot.configuration(), np.zeros(4)
    reduced = system.reduce()
    robot.model.addJoint(4, pin.JointModelRX(), pin.SE3.Identity(), "new")
    for call in (
        lambda: reduced.at(q, v), lambda: reduced.terms(q, v), lambda: reduced.forward_dynamics(q, v, np.zeros(0)),
        system.reduce, lambda: rnc.NonholonomicSystem(robot), lambda: rnc.free_motion(reduced, q, v, 1.0),
        lambda: rnc.analysis.NormalForces(reduced),
    ):  # fmt: skip
        with pytest.raises(rnc.ModelError, match="joints were added to the model of robot 'space_robot'"):
            call()
