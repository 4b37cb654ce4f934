"""Margins that preflight watches along a reference."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.motion.planning import Hold, TaskReference
from rnc_pin.simulation.preflight import _least_time_scale


@pytest.mark.parametrize(("gravity", "inertia", "scale"), [(0.0, 4.0, 2.0), (0.5, 2.0, 2.0), (1.2, 1.0, np.inf)])
def test_slower_motions_need_the_share_of_gravity_and_less_of_inertia(gravity, inertia, scale):
    found = _least_time_scale(lambda s: gravity + inertia / s**2, np.sqrt(gravity + inertia))
    assert found == pytest.approx(scale, rel=1e-6)


def test_preflight_watches_the_smallest_singular_value_of_a_square_a4(robot):
    """Two joints of three move the tip: A4 is the Jacobian of an arm of two links of 1 m, known in closed form."""
    reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce(
        [rnc.JointPosition(name) for name in robot.joint_names], [rnc.FramePosition("tip", "xy")]
    )
    task = rnc.Task.of(reduced, ["platform", "joint_1"], ["joint_2", "joint_3"])
    q0 = robot.configuration({"joint_1": 0.2, "joint_2": 0.4, "joint_3": 0.9})
    x1, x2 = reduced.at(q0).outputs()
    margins = rnc.preflight(reduced, task, TaskReference(Hold(x2[:2]), Hold(x1)), q0, 0.1)
    c, s = np.cos(0.9), np.sin(0.9)
    J = np.array([[-s, -s], [1 + c, c]])  # in axes along the first of the two links
    trace, determinant = np.sum(J**2), s**2
    smallest = np.sqrt((trace - np.sqrt(trace**2 - 4 * determinant)) / 2)
    assert margins.A4.value == pytest.approx(smallest, abs=1e-9)
