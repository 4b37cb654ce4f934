"""Smallest distances along motions against dense sampling, and against closed forms."""

import coal
import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.optimal.closest_approach import ClosestApproach

ARM = """<robot name="arm"><link name="base"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="one"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0.4 0 0"/><geometry><box size="0.8 0.05 0.1"/></geometry></collision></link>
<joint name="first" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" effort="9" velocity="9"/></joint>
<link name="two"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0.3 0 0"/><geometry><sphere radius="0.05"/></geometry></collision></link>
<joint name="second" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0.8 0 0"/>
<axis xyz="0 0.6 0.8"/><limit lower="-9" upper="9" effort="9" velocity="9"/></joint></robot>"""


@pytest.fixture
def arm(tmp_path):
    (tmp_path / "arm.urdf").write_text(ARM)
    return rnc.Robot.from_urdf(tmp_path / "arm.urdf", base="planar")


def dense(robot, distances, time, q, count):
    """Smallest distance of every pair, by a measurement at each of many times between the samples."""
    lowest = np.full(len(distances.pairs), np.inf)
    for k in range(len(time) - 1):
        for part in np.linspace(0.0, 1.0, count):
            now = pin.interpolate(robot.model, q[k], q[k + 1], part)
            found = distances.at(now, float(time[k] + part * (time[k + 1] - time[k])))
            lowest[found.pairs] = np.minimum(lowest[found.pairs], found.distance)
    return lowest


@pytest.mark.parametrize("seed", range(6))
def test_no_approach_between_samples_is_missed_and_none_is_invented(arm, seed):
    generator = np.random.default_rng(seed)
    time = np.linspace(0.0, 1.0, 6)
    q = [arm.configuration({"root_joint": generator.uniform(-1, 1, 3)})]
    for _ in time[1:]:
        q.append(pin.integrate(arm.model, q[-1], generator.normal(size=arm.nv) * [0.4, 0.4, 0.4, 0.6, 0.6]))
    ends = np.column_stack([generator.uniform(-1.5, 1.5, (2, 2)), [0.0, 0.0], generator.uniform(-2, 2, 2)])
    moving = rnc.planning.MinimumJerk(*ends, 1.0)
    obstacles = [
        rnc.collision.Obstacle(coal.Box(0.02, 1.0, 0.4), position=(*generator.uniform(-1, 1, 2), 0), name="plate"),
        rnc.collision.Obstacle(coal.Box(0.3, 0.1, 0.4), name="cart", motion=moving),
    ]
    distances = rnc.collision.CollisionDistances(arm, obstacles, rnc.collision.PairSelection(links=False))
    limit, tolerance = 1.5, 2e-3
    expected = dense(arm, distances, time, q, 300)
    found = {each.names: each for each in ClosestApproach(distances, limit, tolerance).along(time, np.array(q))}
    for pair, lowest in zip(distances.pairs, expected, strict=True):
        if pair.names in found:
            assert found[pair.names].distance == pytest.approx(lowest, abs=tolerance)
            assert found[pair.names].distance < limit
        else:
            assert lowest > limit - tolerance
    assert (expected < limit).any()  # the motions pass near something


def test_a_thin_plate_between_two_samples_is_found(arm):
    """The sphere at the tip passes a plate of 2 mm within one step: both samples are half a metre away."""
    plate = rnc.collision.Obstacle(coal.Box(0.002, 4.0, 1.0), position=(2.0, 0.0, 0.0), name="plate")
    distances = rnc.collision.CollisionDistances(arm, [plate], rnc.collision.PairSelection(links=False))
    q = np.array([arm.configuration({"root_joint": [x, 0.0, 0.0]}) for x in (0.349, 2.3)])
    assert min(distances.at(each).distance.min() for each in q) > 0.25
    found = ClosestApproach(distances, 0.0, 1e-4).along(np.array([0.0, 1.0]), q)
    assert {each.names for each in found} == {("two", "plate"), ("one", "plate")}
    assert found[0].distance < 0.0
    assert 0.0 < found[0].time < 1.0
