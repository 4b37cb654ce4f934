"""Rows that only the digits of a file keep from being dependent, and rows that are nearly dependent."""

import warnings

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from places import DIRT
from systems import ALL

ROUNDED = 1.5708  # for pi / 2
CUT = 1.57


def toed_wheels(base=pin.JointModelPlanar, angle=ROUNDED):
    """Read by Pinocchio itself, which knows nothing of rounded angles."""
    text = (DIRT / "toed_wheels.urdf").read_text().replace("1.5708", str(angle))
    return rnc.Robot(pin.buildModelFromXML(text, base()))


WHEELS = [rnc.RollingWheel("left_wheel", 0.05), rnc.RollingWheel("right_wheel", 0.05)]
AXLES = ["left_axle", "right_axle"]


def test_toed_wheels_keep_their_yaw():
    with pytest.warns(rnc.ModelWarning) as said:
        system = rnc.NonholonomicSystem(toed_wheels(), WHEELS, AXLES)
    assert len(said) == 1
    assert "rows that depend on others except for rounding (1.8e-07) are dropped" in str(said[0].message)
    assert system.r == 2
    dropped = {row.name: row for row in system.dropped_rows}
    reason = "a combination of lateral(left_wheel) except for rounding (1.8e-07)"
    assert dropped["lateral(right_wheel)"].reason == reason
    assert dropped["vertical(left_wheel)"].rounding == 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        exact = rnc.NonholonomicSystem(toed_wheels(angle=repr(np.pi / 2)), WHEELS, AXLES)
    q, T = system.robot.configuration(), [0.3, 0.1]
    outputs = [rnc.FrameSpeed("base"), rnc.FrameYaw("base")]
    rounded, ideal = system.reduce(outputs), exact.reduce(outputs)
    accelerations = (each.forward_dynamics(q, [0.2, 0.5], T) for each in (rounded, ideal))
    np.testing.assert_allclose(*accelerations, rtol=1e-4)
    forces = (each.at(q, [0.2, 0.5]).contact_forces(T) for each in (rounded, ideal))
    np.testing.assert_allclose(*forces, rtol=1e-4, atol=1e-5)


def test_wheels_that_are_toed_more_are_warned_of():
    words = r"nearly dependent \(smallest singular value 0.00018 at best.* check for rounded angles of wheels"
    with pytest.warns(rnc.ModelWarning, match=words) as said:
        system = rnc.NonholonomicSystem(toed_wheels(angle=CUT), WHEELS, AXLES)
    assert len(said) == 1
    assert system.r == 1  # as the file says
    assert "lateral(left_wheel), lateral(right_wheel)" in str(said[0].message)


@pytest.mark.parametrize("name", ALL)
def test_good_systems_are_not_warned_of(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error", rnc.ModelWarning)
        assert ALL[name].__wrapped__().r
