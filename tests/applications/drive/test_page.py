"""Bodies that a page highlights, by the names of limits."""

import rnc_pin as rnc
from rnc_pin.applications.drive.page import LimitBodies


def test_names_of_limits_lead_to_bodies():
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    bodies = LimitBodies(robot, ["ball", "box 1"])
    link = frozenset({"link_1_0", "link_1_1", "link_1_2"})
    for name in ("joint_1 position", "joint_1 velocity", "link_1 x upper"):
        assert bodies.of([name]) == (link, frozenset()), name
    assert bodies.of(["link_1 / box 1 distance"]) == (link, frozenset({"box 1"}))
    tip, other = bodies.of(["tip / ball distance", "joint_1 velocity"])
    assert tip == link | {"tip_0", "tip_1", "tip_2"}  # shapes of the link, not of all that its joint moves
    assert other == {"ball"}
    assert bodies.of(["joint_1 acceleration", "unknown velocity"]) == (frozenset(), frozenset())
