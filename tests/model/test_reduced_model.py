"""The reduction against data derived symbolically from the Lagrangian, without Pinocchio (tests/data)."""

import json

import numpy as np
import pytest

from places import DATA
from systems import space_robot, space_robot_in_joints
from textbook_systems import SLEIGH, chaplygin_sleigh
from tolerances import REFERENCE

SPACE_ROBOT = json.loads((DATA / "space_robot.json").read_text())

# Bases of the data by name: S1a takes the joint angles as reducing outputs, S1b the tip and the first joint.
BASES = {"S1a": space_robot_in_joints, "S1b": space_robot}


def assert_matches(actual, expected):
    expected = np.asarray(expected)
    np.testing.assert_allclose(actual, expected, rtol=0, atol=REFERENCE * max(1.0, np.abs(expected).max(initial=0)))


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("state", SPACE_ROBOT["states"])
def test_space_robot(basis, state):
    reduced, expected = BASES[basis](), state["bases"][basis]
    q, v2, T = np.array(state["q"]), np.array(expected["v"]), np.array(state["T"])
    t, full = reduced.terms(q, v2), reduced.lagrangian_terms(q, v2)
    assert_matches(t.v, state["qd"])
    assert_matches(t.R, expected["R"])
    assert_matches(t.R_dot, expected["Rdot"])
    assert_matches(t.H, expected["H"])
    assert_matches(t.V + t.V.T, expected["Hdot"])
    assert_matches(t.V @ v2, expected["Vcc_v"])  # V itself depends on the choice of C*
    assert_matches(t.G, expected["G"])
    assert_matches(t.input_matrix, expected["RtM"])
    assert_matches(t.A, state["A"])
    assert_matches(t.A_dot, state["Adot"])
    assert_matches(t.A_star, expected["A_star"])
    assert_matches(t.A_star_dot, expected["A_star_dot"])
    assert_matches(full.H, state["H_star"])
    assert_matches(full.C @ t.v, state["C_star_qd"])
    assert_matches(full.g, state["G_star"])
    v2_dot = reduced.forward_dynamics(q, v2, T)
    assert_matches(v2_dot, expected["vdot"])
    assert_matches(t.R @ v2_dot + t.R_dot @ v2, state["qdd"])
    assert_matches(reduced.forward_dynamics(q, v2, np.zeros(3)), expected["vdot_zero_input"])
    assert_matches(-reduced.multipliers(q, v2, T), state["lambda"])  # the data have A^T lambda on the other side
    assert_matches(reduced.energy(q, v2), state["kinetic_energy"])
    measured = reduced.at(q, v2).measure()
    assert_matches(measured.x1, expected["x1"])
    assert_matches(measured.x2, expected["x2"])


@pytest.mark.parametrize("state", SLEIGH["states"])
def test_chaplygin_sleigh(state):
    reduced, expected = chaplygin_sleigh(), state["bases"]["S4"]
    x, y, theta = state["q"]
    q = reduced.robot.configuration({"root_joint": (x, y, theta)})
    v2, T = np.array(expected["v"]), np.array(state["T"])
    # The data use plain coordinate rates; Pinocchio's planar joint has its velocity in body axes.
    turn = np.array([[np.cos(theta), -np.sin(theta), 0], [np.sin(theta), np.cos(theta), 0], [0, 0, 1]])
    t = reduced.terms(q, v2)
    assert_matches(turn @ t.v, state["qd"])
    assert_matches(turn @ t.R, expected["R"])
    assert_matches(t.H, expected["H"])
    assert_matches(t.V + t.V.T, expected["Hdot"])
    assert_matches(t.V @ v2, expected["Vcc_v"])
    assert_matches(t.input_matrix, expected["RtM"])
    assert_matches(reduced.forward_dynamics(q, v2, T), expected["vdot"])
    assert_matches(reduced.forward_dynamics(q, v2, np.zeros(2)), expected["vdot_zero_input"])
    assert_matches(np.abs(reduced.multipliers(q, v2, T)), np.abs(state["lambda"]))  # rows are defined up to sign
    assert_matches(reduced.energy(q, v2), state["kinetic_energy"])


def test_what_a_model_is_made_of_is_read_only():
    with pytest.raises(AttributeError, match="'r' of a ReducedModel is read-only: reduce the system anew"):
        space_robot().r = 2
