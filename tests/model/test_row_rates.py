"""Rates of the rows of every kind beside differences, whether the rows hold or not; many states are as each."""

import inspect

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.model.kinematics import Kinematics
from rolling import slope
from row_kinds import drawn, robots
from tolerances import FINITE_DIFFERENCE, ROUNDING

ROWS = {name: (robot, kind) for robot, kinds in robots() for name, kind in kinds.items()}
LOGARITHMIC = ("frames", "frame of the world", "fixed orientation")
"""Rows whose residual is a logarithm: its rate is that of the rows only where it is zero."""


@pytest.mark.parametrize("name", ROWS)
def test_rates_are_those_of_differences(name):
    """Of positions, of the Jacobian, of the right-hand side and, over the configuration, of the bias acceleration."""
    robot, kind = ROWS[name]
    rows, kinematics = kind.bind(robot), Kinematics(robot)
    assert len(rows.names) == len(rows.units) == len(rows.holonomic or rows.names)
    for seed in range(3):
        q, v = drawn(robot, seed)
        if name == "no momentum":  # whose bias acceleration is that of velocities that satisfy the rows
            J = rows.jacobian(kinematics.position(q))
            v = v - np.linalg.pinv(J) @ (J @ v)

        def along(what, direction=v, q=q):
            return slope(robot.model, lambda p: what(kinematics.position(p)), q, direction)

        def drift(position, v=v):
            motion = position.with_velocity(v)
            return rows.jacobian_dot(motion) @ v - rows.rate_dot(motion)

        at = kinematics.position(q).with_velocity(v)
        J, J_dot = rows.jacobian(at), rows.jacobian_dot(at)
        size = 1 + np.abs(J_dot).max()
        assert J.shape == J_dot.shape == (len(rows.names), robot.nv)
        moved = J @ v - rows.rate(at)
        kept = np.array(rows.holonomic or [False] * len(rows.names))
        assert not rows.residual(at)[~kept].any()
        if kept.any() and name not in LOGARITHMIC:
            np.testing.assert_allclose(along(rows.residual)[kept], moved[kept], atol=FINITE_DIFFERENCE)
        if isinstance(kind, rnc.FrameOrientation):  # a rotation vector, whose rate is an angular velocity
            h = 1e-6
            moved_to = (pin.integrate(robot.model, q, sign * h * v) for sign in (1, -1))
            ahead, behind = (pin.exp3(rows.value(kinematics.position(each))) for each in moved_to)
            np.testing.assert_allclose(pin.log3(ahead @ behind.T) / (2 * h), moved, atol=FINITE_DIFFERENCE)
        elif hasattr(rows, "value") and not rows.quasi:
            np.testing.assert_allclose(along(rows.value), moved, atol=FINITE_DIFFERENCE)
        np.testing.assert_allclose(J_dot, along(rows.jacobian), atol=1e-8 * size)
        np.testing.assert_allclose(rows.rate_dot(at), along(rows.rate), atol=FINITE_DIFFERENCE)
        np.testing.assert_allclose(rows.bias_acceleration(at), drift(at), atol=1e-11 * size)
        gradient = rows.bias_acceleration_gradient(at)
        expected = np.transpose([along(drift, each) for each in np.eye(robot.nv)])
        np.testing.assert_allclose(gradient, expected, atol=1e-6 * (1 + np.abs(expected).max()))


@pytest.mark.parametrize("name", ROWS)
def test_many_states_are_as_each(name):
    robot, kind = ROWS[name]
    rows, kinematics = kind.bind(robot), Kinematics(robot)
    q, v = (np.stack(each) for each in zip(*(drawn(robot, seed) for seed in range(3)), strict=True))
    many = kinematics.position(q).with_velocity(v)
    methods = [rows.jacobian, rows.jacobian_dot, rows.rate, rows.rate_dot, rows.bias_acceleration, rows.residual]
    methods += [rows.lines_of_action, *([rows.value] if hasattr(rows, "value") else [])]
    for method in methods:
        together = method(many)
        for i in range(3):
            alone = method(kinematics.position(q[i]).with_velocity(v[i]))
            pairs = zip(together, alone, strict=True) if isinstance(alone, tuple) else [(together, alone)]
            for one, other in () if alone is None else pairs:
                np.testing.assert_allclose(one[i], other, atol=10 * ROUNDING)


def test_every_kind_has_rows_here():
    """A user's own rows are in ``test_user_functions.py``, motions over time in ``test_kept_outputs.py``."""
    public = [getattr(room, name) for room in (rnc.constraints, rnc.outputs) for name in room.__all__]
    kinds = {each for each in public if inspect.isclass(each) and hasattr(each, "bind")}
    written_down = {"Pfaffian", "Output", "PrescribedMotion"}
    assert {each.__name__ for each in kinds - {type(kind) for _, kind in ROWS.values()}} == written_down
