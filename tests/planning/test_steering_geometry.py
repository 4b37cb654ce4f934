"""Steering angles for curvatures: closed forms of Ackermann's linkage, and vehicles that arrive where a path goes."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.errors import InfeasibleError
from rnc_pin.planning import CarPath, SteeringGeometry

WHEELBASE, TRACK, OFFSET, RADIUS = 0.8, 0.5, 0.06, 0.1
INERTIA = '<inertial><mass value="{m}"/><inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial>'


def _link(name, mass=1.0):
    return f'<link name="{name}">{INERTIA.format(m=mass, i=0.02 * mass)}</link>'


def _joint(name, parent, child, at, axis, limit=""):
    kind = "revolute" if limit else "continuous"
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
        f'<axis xyz="{axis}"/>{limit}</joint>'
    )


def car_urdf(limit=1.0):
    """A car with Ackermann's linkage; wheels stand beside their pivots, steering axes point down on the right."""
    nose = '<joint name="nose" type="fixed"><parent link="base"/><child link="nose"/><origin xyz="0.8 0 0"/></joint>'
    parts = [_link("base", 10.0), '<link name="nose"/>', nose]
    bounds = f'<limit lower="-{limit}" upper="{limit}" effort="50" velocity="5"/>'
    for side, sign in (("left", 1), ("right", -1)):
        parts += [_link(f"rear_{side}_link"), _link(f"knuckle_{side}"), _link(f"front_{side}_link")]
        parts.append(_joint(f"rear_{side}", "base", f"rear_{side}_link", f"0 {sign * TRACK / 2} 0", "0 1 0"))
        pivot = f"{WHEELBASE} {sign * TRACK / 2} 0"
        parts.append(_joint(f"steer_{side}", "base", f"knuckle_{side}", pivot, f"0 0 {sign}", bounds))
        beside = f"0 {sign * OFFSET} 0"
        parts.append(_joint(f"front_{side}", f"knuckle_{side}", f"front_{side}_link", beside, "0 1 0"))
    return f'<robot name="ackermann">{"".join(parts)}</robot>'


def constraints():
    wheels = [rnc.RollingWheel(f"{end}_{side}_link", RADIUS) for end in ("rear", "front") for side in ("left", "right")]
    return [*wheels, rnc.AckermannSteering("steer_left", "steer_right", axle="base")]


def vehicle(folder, speed=None, steering="steer_left", limit=1.0):
    (folder / "car.urdf").write_text(car_urdf(limit))
    robot = rnc.Robot.from_urdf(folder / "car.urdf", base="planar")
    system = rnc.NonholonomicSystem(robot, constraints(), ["rear_left", "rear_right", "steer_left"])
    return system.reduce([speed or rnc.FrameSpeed("base"), rnc.JointPosition(steering)])


def geometry(reduced, frame="base", largest=1.0):
    q = reduced.robot.configuration()
    return SteeringGeometry(reduced, q, frame, speed=0, steering=1, largest=largest)


@pytest.mark.parametrize(("steering", "left"), [("steer_left", 1), ("steer_right", -1)])
def test_the_wheels_of_ackermanns_linkage(steering, left, tmp_path):
    """cot(angle) = cot(middle) -+ w / 2 / L, and the right axis points down."""
    curvatures = np.linspace(-1.0, 1.0, 41)
    angles, ratios = geometry(vehicle(tmp_path, steering=steering)).outputs(curvatures)
    across = WHEELBASE * curvatures / (1 - left * curvatures * TRACK / 2)
    np.testing.assert_allclose(angles, left * np.arctan(across), atol=1e-8)
    np.testing.assert_allclose(ratios, 1.0, atol=1e-9)


def test_the_speed_of_a_point_beside_the_middle(tmp_path):
    """The output is the rate of the left rear wheel's hub: it goes slower in a turn to the left."""
    reduced = vehicle(tmp_path, speed=rnc.JointPosition("rear_left"))
    curvatures = np.linspace(-0.8, 0.8, 17)
    _, ratios = geometry(reduced).outputs(curvatures)
    np.testing.assert_allclose(ratios, (1 - curvatures * TRACK / 2) / RADIUS, atol=1e-8)


def test_a_car_with_two_steered_wheels_arrives(tmp_path):
    """The constraints, driven by the reference, end at the goal; by the angle of a middle wheel they miss it."""
    reduced = vehicle(tmp_path)
    goal = np.array([4.0, 1.5, 0.4])
    misses = []
    for steering in (geometry(reduced, largest=np.tan(0.5) / WHEELBASE), None):
        path = CarPath((0, 0, 0), goal, 12.0, WHEELBASE, max_steering=0.5, geometry=steering)
        misses.append(np.abs(_driven(reduced, path.reference) - goal).max())
    assert misses[0] < 1e-4
    assert misses[1] > 0.05


def _driven(reduced, reference, steps=1000):
    """Pose at the end of a motion at the reference's rates, by the midpoint rule."""
    model, q, h = reduced.robot.model, reduced.robot.configuration(), reference.duration / steps
    for k in range(steps):
        middle = pin.integrate(model, q, h / 2 * reduced.at(q, reference.at(k * h).velocity).v)
        q = pin.integrate(model, q, h * reduced.at(middle, reference.at((k + 0.5) * h).velocity).v)
    return np.array(reduced.robot.joint_values(q)["root_joint"])


def test_a_frame_that_slips_is_refused(tmp_path):
    with pytest.raises(rnc.ConfigurationError, match="frame 'nose' cannot drive a path: it slips sideways"):
        geometry(vehicle(tmp_path), "nose")


def test_a_curvature_beyond_the_range_of_the_joint_is_refused(tmp_path):
    tight = geometry(vehicle(tmp_path, limit=0.3), largest=1.5)
    assert tight.range[1] < 1 / (WHEELBASE / np.tan(0.3))
    with pytest.raises(InfeasibleError, match=r"'steer_left' steers frame 'base' from .* give a smaller max_steering"):
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
    reduced = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("sleigh"), turning]).reduce(
        [rnc.FrameSpeed("sleigh"), rnc.JointPosition("wheel")]
    )
    steering = geometry(reduced, "sleigh", largest=3.0)
    assert 0.99 / WHEELBASE < steering.range[1] <= 1 / WHEELBASE
    assert steering.range[0] == pytest.approx(-steering.range[1])
    curvatures = np.linspace(-0.9, 0.9, 7) / WHEELBASE
    np.testing.assert_allclose(steering.outputs(curvatures)[0], np.arcsin(WHEELBASE * curvatures), atol=1e-4)
