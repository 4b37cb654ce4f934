"""Robots with one joint, and joints about any axis: Pinocchio stores and returns both unlike the others."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import frame_placement
from tolerances import ROUNDING
from urdf_parts import joint, link, read

pytestmark = pytest.mark.filterwarnings("error", "ignore:zmq.eventloop.ioloop is deprecated:DeprecationWarning")


@pytest.mark.parametrize("axis", ["0 1 0", "0 -1 0", "0.6 0 0.8", "-0.8 0 -0.6"])
@pytest.mark.parametrize("kind", ["revolute", "continuous"])
def test_one_joint_is_named_set_and_read(kind, axis, tmp_path):
    turns = joint("hinge", "base", "bob", axis=axis, kind=kind, limits=(-3, 2))
    robot = read(tmp_path / "strange.urdf", link("base"), link("bob", at="0 0 -0.4"), turns)
    reduced = rnc.NonholonomicSystem(robot).reduce([rnc.JointPosition("hinge")])
    assert (robot.velocity_names, robot.velocity_units) == (("hinge",), ("rad/s",))
    assert robot.velocity_indices("hinge") == slice(0, 1)
    for angle in (-2.9, 0.0, 1.7):
        q = robot.configuration({"hinge": angle})
        assert robot.joint_values(q) == pytest.approx({"hinge": angle}, abs=ROUNDING)
        assert reduced.at(q).outputs()[1] == pytest.approx([angle], abs=ROUNDING)
        turned = frame_placement(robot, q, "bob").rotation
        np.testing.assert_allclose(turned, pin.exp3(angle * np.array(axis.split(), float)), atol=ROUNDING)
    with pytest.raises(rnc.ModelError, match=r"joint 'hinge' takes 1 value, found 3$"):
        robot.configuration({"hinge": [1, 2, 3]})
