"""Steering angles for curvatures: closed forms of Ackermann's linkage."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, add_frame
from rnc_pin.errors import InfeasibleError
from textbook_systems import planar_model

WHEELBASE, TRACK, OFFSET, RADIUS = 0.8, 0.5, 0.06, 0.1


def vehicle(speed=None, steering="steer_left", limit=1.0):
    """A car with Ackermann's linkage; wheels stand beside their pivots, steering axes point down on the right."""
    model, base = planar_model()
    add_frame(model, "nose", base, (WHEELBASE, 0.0, 0.0))
    add_frame(model, "side", base, pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, np.pi / 2), np.zeros(3)))
    for side, sign in (("left", 1), ("right", -1)):
        turn = pin.rpy.rpyToMatrix(0.0 if sign > 0 else np.pi, 0.0, 0.0)
        down = pin.SE3(turn, np.array([WHEELBASE, sign * TRACK / 2, 0.0]))
        add_body(model, f"rear_{side}", "RY", 1.0, base, at=(0.0, sign * TRACK / 2, 0.0), frame=f"rear_{side}_link")
        pivot = add_body(model, f"steer_{side}", "RZ", 1.0, base, at=down)
        add_body(model, f"front_{side}", "RY", 1.0, pivot, at=(0.0, OFFSET, 0.0), frame=f"front_{side}_link")
        entry = model.joints[pivot].idx_q
        model.lowerPositionLimit[entry], model.upperPositionLimit[entry] = -limit, limit
    wheels = [rnc.RollingWheel(f"{end}_{side}_link", RADIUS) for end in ("rear", "front") for side in ("left", "right")]
    rows = [*wheels, rnc.AckermannSteering("steer_left", "steer_right", axle="body")]
    system = rnc.NonholonomicSystem(rnc.Robot(model), rows, ["rear_left", "rear_right", "steer_left"])
    return system.reduce([speed or rnc.FrameSpeed("body"), rnc.JointPosition(steering)])


def geometry(reduced, frame="body", largest=1.0):
    q = reduced.robot.configuration()
    return rnc.planning.SteeringGeometry(reduced, q, frame, speed=0, steering=1, largest=largest)


@pytest.mark.parametrize(("steering", "left"), [("steer_left", 1), ("steer_right", -1)])
def test_the_wheels_of_ackermanns_linkage(steering, left):
    """cot(angle) = cot(middle) -+ w / 2 / L, and the right axis points down."""
    curvatures = np.linspace(-1.0, 1.0, 41)
    angles, ratios = geometry(vehicle(steering=steering)).outputs(curvatures)
    across = WHEELBASE * curvatures / (1 - left * curvatures * TRACK / 2)
    np.testing.assert_allclose(angles, left * np.arctan(across), atol=1e-8)
    np.testing.assert_allclose(ratios, 1.0, atol=1e-9)


def test_the_speed_of_a_point_beside_the_middle():
    """The output is the rate of the left rear wheel's hub: it goes slower in a turn to the left."""
    reduced = vehicle(speed=rnc.JointPosition("rear_left"))
    curvatures = np.linspace(-0.8, 0.8, 17)
    _, ratios = geometry(reduced).outputs(curvatures)
    np.testing.assert_allclose(ratios, (1 - curvatures * TRACK / 2) / RADIUS, atol=1e-8)


@pytest.mark.parametrize(("frame", "why"), [("nose", "slips sideways"), ("side", "does not move along its x axis")])
def test_a_frame_that_slips_is_refused(frame, why):
    with pytest.raises(rnc.ConfigurationError, match=f"frame '{frame}' cannot drive a path: it {why}"):
        geometry(vehicle(), frame)


def test_a_curvature_beyond_the_range_of_the_joint_is_refused():
    tight = geometry(vehicle(limit=0.3), largest=1.5)
    assert tight.range[1] < 1 / (WHEELBASE / np.tan(0.3))
    with pytest.raises(InfeasibleError, match=r"'steer_left' steers frame 'body' from .* give a smaller max_steering"):
        tight.outputs(np.array([0.1, 0.9]))


def test_the_table_ends_where_the_curvature_no_longer_grows():
    """A steering wheel at an angle a makes the path of curvature ``sin(a) / L``, at most 1 / L."""
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    model = robot.model.copy()
    add_body(model, "wheel", "RZ", 1.0, 1)
    still = np.zeros((1, 4))
    turning = rnc.Pfaffian(
        lambda q: np.array([[-np.sin(q[4]), 0.0, WHEELBASE, 0.0]]),
        lambda q, v: np.array([[-np.cos(q[4]) * v[3], 0.0, 0.0, 0.0]]) + still,
    )
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("sleigh"), turning])
    reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.JointPosition("wheel")])
    steering = geometry(reduced, "sleigh", largest=3.0)
    assert 0.99 / WHEELBASE < steering.range[1] <= 1 / WHEELBASE
    assert steering.range[0] == pytest.approx(-steering.range[1])
    curvatures = np.linspace(-0.9, 0.9, 7) / WHEELBASE
    np.testing.assert_allclose(steering.outputs(curvatures)[0], np.arcsin(WHEELBASE * curvatures), atol=1e-4)
