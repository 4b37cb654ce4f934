"""Plans against optima from other sources: Pontryagin's equations, and a published objective."""

import numpy as np
import pytest
import scipy

import rnc_pin as rnc
from rnc_pin.optimal import EffortCost, InputBound, OutputBound, SolverSettings

POSTURE, TURN = 1.2, 0.4  # angle of joint_2 at both ends, and turn of the platform [rad]
# Ends of the links of the two-link arm as combinations of both directions; point masses of 10 kg, as in the URDF.
ENDS = np.array([[1, 0], [1, 1], [1, 2]])
G = 10.0 * ENDS.T @ ENDS


def connection(angle):
    """Platform rate for each joint rate at zero momentum (2, n), and its derivative by joint_2. Platform: 10 kg m^2."""
    c, s = np.cos(angle), np.sin(angle)
    first, second = G[0, 0] + G[0, 1] * c, G[1, 1] + G[0, 1] * c
    inertia, change = 10.0 + first + second, -2 * G[0, 1] * s
    over = np.array([-(first + second), -second])
    over_change = np.array([2 * G[0, 1] * s, G[0, 1] * s])
    return over / inertia, (over_change * inertia - over * change) / inertia**2


def pontryagin(_, y):
    """State (platform, joint_1, joint_2) and costates, under the input that minimises the Hamiltonian."""
    A, A_change = connection(y[2])
    u = -(y[4:] + y[3] * A)
    still = np.zeros_like(y[0])
    return np.array([(A * u).sum(axis=0), *u, still, still, -y[3] * (A_change * u).sum(axis=0)])


@pytest.mark.parametrize("radius", [-0.6, -1.0])
def test_a_satellite_with_two_links_turns_as_pontryagins_equations_say(radius):
    """Least squared joint rates for a turn of the platform, with the arm back in its posture: two local optima."""
    robot = rnc.Robot.from_urdf("space_robot.urdf", lock={"joint_3": 0.0})
    system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], ["joint_1", "joint_2"])
    joints = [rnc.JointPosition("joint_1"), rnc.JointPosition("joint_2")]
    goal = dict(zip((rnc.JointPosition("platform"), *joints), (TURN, 0.0, POSTURE), strict=True))
    start = robot.configuration({"joint_2": POSTURE})
    phase = np.linspace(0.0, 2 * np.pi, 41)
    arm = radius * np.array([np.sin(phase), np.sign(radius) * (1 - np.cos(phase))])
    loop = np.column_stack([np.linspace(0.0, TURN, 41), arm[0], POSTURE + arm[1]])
    plan = rnc.optimal.plan(system.reduce(joints), start, goal, 1.0, form="kinematic", guess=loop, seeds=0)

    def ends(a, b):
        return np.array([a[0], a[1], a[2] - POSTURE, b[0] - TURN, b[1], b[2] - POSTURE])

    first = np.zeros((6, 41))
    first[:3], first[4:] = plan.q.T, -np.gradient(loop[:, 1:].T, phase / (2 * np.pi), axis=1)
    exact = scipy.integrate.solve_bvp(pontryagin, ends, plan.time, first, tol=1e-6)
    assert exact.success
    A, _ = connection(exact.y[2])
    rates = exact.y[4:] + exact.y[3] * A
    assert plan.info.cost == pytest.approx(0.5 * scipy.integrate.simpson((rates**2).sum(axis=0), x=exact.x), rel=2e-3)
    np.testing.assert_allclose(plan.q, exact.sol(plan.time)[:3].T, atol=1.5e-2)


CART_POLE = """<robot name="cart_pole"><link name="rail"/>
<link name="cart"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-10" upper="10" effort="100" velocity="100"/></joint>
<link name="pole"><inertial><origin xyz="0 0 -0.5"/><mass value="0.3"/>
<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="cart"/><child link="pole"/><axis xyz="0 -1 0"/>
<limit lower="-10" upper="10" effort="0" velocity="100"/></joint></robot>"""


def test_swing_up_of_the_cart_pole_has_the_published_objective(tmp_path):
    """58.8 N^2 s (Kelly, "An introduction to trajectory optimization", SIAM Review 59 (2017))."""
    (tmp_path / "cart_pole.urdf").write_text(CART_POLE)
    robot = rnc.Robot.from_urdf(tmp_path / "cart_pole.urdf")
    slide, hinge = rnc.JointPosition("slide"), rnc.JointPosition("hinge")
    reduced = rnc.NonholonomicSystem(robot, [], ["slide"]).reduce([slide, hinge])
    plan = rnc.optimal.plan(
        reduced, robot.configuration(), {slide: 1.0, hinge: np.pi}, 2.0, form="dynamic", costs=[EffortCost(2.0)],
        bounds=[InputBound(-20.0, 20.0), OutputBound(slide, -2.0, 2.0)], settings=SolverSettings(nodes=80),
    )  # fmt: skip
    assert plan.info.cost == pytest.approx(58.8, abs=0.15)
