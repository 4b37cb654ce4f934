"""A plan against a published optimum."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.motion.optimal import EffortCost, InputBound, OutputBound, SolverSettings
from urdf_parts import joint, link, read


def test_swing_up_of_the_cart_pole_has_the_published_objective(tmp_path):
    """58.8 N^2 s (Kelly, "An introduction to trajectory optimization", SIAM Review 59 (2017))."""
    parts = [link("rail"), link("cart"), link("pole", 0.3, at="0 0 -0.5", moment=0)]
    parts += [joint("slide", "rail", "cart", axis="1 0 0", kind="prismatic", effort=100, limits=(-10, 10), speed=100)]
    parts += [joint("hinge", "cart", "pole", axis="0 -1 0", kind="revolute", effort=0, limits=(-10, 10), speed=100)]
    robot = read(tmp_path / "cart_pole.urdf", *parts)
    slide, hinge = rnc.JointPosition("slide"), rnc.JointPosition("hinge")
    reduced = rnc.NonholonomicSystem(robot, [], ["slide"]).reduce([slide, hinge])
    plan = rnc.optimal.plan(
        reduced, robot.configuration(), {slide: 1.0, hinge: np.pi}, 2.0, form="dynamic", costs=[EffortCost(2.0)],
        bounds=[InputBound(-20.0, 20.0), OutputBound(slide, -2.0, 2.0)], settings=SolverSettings(nodes=80),
    )  # fmt: skip
    assert plan.info.cost == pytest.approx(58.8, abs=0.15)
