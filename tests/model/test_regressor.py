"""The regressor gives the forces of inverse dynamics, for the masses of the robot and for others."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from systems import ALL, differential_drive, random_states
from tolerances import ROUNDING


@pytest.mark.parametrize("name", ALL)
def test_times_the_parameters_it_is_the_reduced_force(name):
    reduced = ALL[name]()
    for q, v2 in random_states(reduced, 2):
        v2_dot = np.linspace(-1.0, 1.0, reduced.r)
        regressor = reduced.regressor(q, v2, v2_dot, t=0.3)
        F = reduced.inverse_dynamics(q, v2, v2_dot, t=0.3)
        state = reduced.at(q, v2, t=0.3)
        expected = F + state.R.T @ state.passive_force
        rounding = ROUNDING * max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(regressor.matrix @ regressor.parameters, expected, atol=rounding)


def test_its_columns_are_those_of_any_inertia():
    """On wheels; motor inertias have columns where the robot has some."""
    wheels = [rnc.RollingWheel(f"{side}_wheel", 0.2) for side in ("left", "right")]

    def reduced_of(robot):
        return rnc.NonholonomicSystem(robot, wheels).reduce([rnc.JointPosition(f"{w.frame}_joint") for w in wheels])

    file, other = (rnc.Robot.from_urdf("differential_drive.urdf", base="planar") for _ in range(2))
    other.model.armature = np.array([0.0, 0.0, 0.0, 0.3, 0.4])
    for k in range(1, other.model.njoints):
        other.model.inertias[k] = pin.Inertia.Random()
    state = file.configuration({"root_joint": [0.1, 0.2, 0.3]}), np.array([1.0, -2.0]), np.array([3.0, 0.5])
    before, after = (reduced_of(robot).regressor(*state) for robot in (file, other))
    size = len(before.names)
    assert after.names == (*before.names, "motor inertia of left_wheel_joint", "motor inertia of right_wheel_joint")
    np.testing.assert_allclose(after.matrix[:, :size], before.matrix, atol=ROUNDING)
    F = reduced_of(other).inverse_dynamics(*state)
    np.testing.assert_allclose(after.matrix @ after.parameters, F, atol=ROUNDING * np.abs(F).max())


def test_states_have_leading_axes():
    reduced, draw = differential_drive(), np.random.default_rng(0)
    v2, v2_dot = draw.normal(size=(2, 3, 4, reduced.r))
    q = reduced.robot.configuration()
    found = reduced.regressor(q, v2, v2_dot).matrix
    assert found.shape[:-1] == (3, 4, reduced.r)
    np.testing.assert_allclose(found[1, 2], reduced.regressor(q, v2[1, 2], v2_dot[1, 2]).matrix, atol=ROUNDING)
