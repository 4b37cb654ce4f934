"""A Panda on a satellite: what is mounted moves as it does alone."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, frame_placement
from tolerances import ROUNDING


def test_a_mounted_robot_moves_as_it_does_alone(generator):
    satellite = rnc.Robot.from_urdf("satellite.urdf", base="free", gravity=(0, 0, 0))
    arm = rnc.Robot.from_example("panda")
    place = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 0.5), np.array([0.1, 0.2, 0.3]))
    both = satellite.attach(arm, "mount", place)
    assert both.nv == satellite.nv + arm.nv
    np.testing.assert_array_equal(both.model.gravity.linear, np.zeros(3))
    with_base = rnc.Robot.from_example("panda", base="free")  # a fixed base's own link has its mass, too
    total, *parts = (pin.computeTotalMass(each.model) for each in (both, satellite, with_base))
    assert total == pytest.approx(sum(parts))
    base, q = satellite.random_configuration(generator), arm.random_configuration(generator)
    mount, hand = (frame_placement(both, np.r_[base, q], name) for name in ("mount", "panda_hand"))
    assert (mount * place * frame_placement(arm, q, "panda_hand")).isApprox(hand, ROUNDING)
    shapes = len(satellite.visual_model.geometryObjects) + len(arm.visual_model.geometryObjects)
    assert len(both.visual_model.geometryObjects) == shapes


def test_what_cannot_be_mounted_is_refused():
    satellite = rnc.Robot.from_urdf("satellite.urdf", base="free")
    with pytest.raises(rnc.ModelError, match="both have a frame 'satellite'"):
        satellite.attach(rnc.Robot(*_renamed()), "mount")
    with pytest.raises(rnc.ModelError, match="has a moving base: load it with base='fixed'"):
        satellite.attach(rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar"), "mount")
    with pytest.raises(rnc.ModelError, match=r"no frame 'mout'.*'mount'"):
        satellite.attach(rnc.Robot.from_urdf("space_robot.urdf"), "mout")


def _renamed():
    model = pin.Model()
    model.name = "other"
    add_body(model, "turn", "RZ", 1.0, frame="satellite")
    return (model,)
