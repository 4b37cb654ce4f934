"""Former names work for one version, and say what replaces them."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.model.rows import Rows
from systems import random_states, space_robot


def test_former_names_warn_and_work():
    reduced = space_robot()
    (q, v2), *_ = random_states(reduced, 1)
    state = reduced.at(q, v2)
    with pytest.warns(DeprecationWarning, match="use 'reduction_data'"):
        assert reduced.parts is reduced.reduction_data
    with pytest.warns(DeprecationWarning, match="use 'with_basis_at'"):
        assert reduced.settled_at(q).r == reduced.r
    with pytest.warns(DeprecationWarning, match="use 'with_velocity'"):
        np.testing.assert_array_equal(state.moving(np.zeros(4)).v, 0.0)
    with pytest.warns(DeprecationWarning, match="use 'in_reduction'"):
        np.testing.assert_array_equal(state.as_seen_by(reduced.reduction_data).v, state.v)


def test_rows_with_former_names_are_rows():
    with pytest.warns(DeprecationWarning, match=r"Fixed\.drift: renamed, use 'bias_acceleration'"):

        class Fixed(Rows):
            names, units = ("fixed",), ("rad/s",)

            def jacobian(self, at):
                return np.eye(4)[:1]

            def jacobian_dot(self, at):
                return np.zeros((1, 4))

            def drift(self, at):
                return np.zeros(1)

    class Kind:
        def bind(self, robot):
            return Fixed()

    robot = rnc.Robot.from_urdf("space_robot.urdf")
    reduced = rnc.NonholonomicSystem(robot, [Kind()], robot.joint_names[1:]).reduce()
    assert reduced.forward_dynamics(robot.configuration(), np.ones(3), np.zeros(3)).shape == (3,)
