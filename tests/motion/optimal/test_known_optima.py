"""A plan against a published optimum."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.motion.optimal import EffortCost, InputBound, OutputBound, SolverSettings

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
