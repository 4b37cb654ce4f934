"""Outlines of a robot from above."""

import numpy as np
from matplotlib.figure import Figure

import rnc_pin as rnc
from rnc_pin.visualization.footprints import draw_footprints, footprints


def area(points):
    x, y = points.T
    return 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def test_outlines_move_with_the_robot_and_keep_their_area():
    robot = rnc.Robot.from_urdf("car.urdf", base="planar")
    at_origin = footprints(robot, robot.configuration())
    assert len(at_origin) == 2  # chassis and steered axle
    # Chassis with its wheels: 1.68 m long, 0.7 m wide at the wheels, 0.62 m elsewhere.
    assert np.ptp(at_origin[0], axis=0).round(3).tolist() == [1.68, 0.7]
    moved = footprints(robot, robot.configuration({"root_joint": [3.0, 1.0, np.pi / 2]}))
    for before, after in zip(at_origin, moved, strict=True):
        assert np.isclose(area(before), area(after))
    np.testing.assert_allclose(np.sort(moved[0][:, 1]), np.sort(at_origin[0][:, 0]) + 1.0, atol=1e-12)
    (entry,) = draw_footprints(Figure().subplots(), robot, np.repeat(robot.configuration()[None], 3, axis=0))
    assert entry.name == "robot"
