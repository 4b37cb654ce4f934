"""Frames from a record of the kernel, beside Pinocchio's own."""

import numpy as np
import pytest

from plain_kinematics import Plain, near
from rnc_pin import _kernel
from rnc_pin.model.compiled_states import KnownKinematics
from rnc_pin.model.kinematics import OWN_AXES, WORLD_AXES
from systems import space_robot_in_joints, tiago

pytestmark = pytest.mark.skipif(_kernel.library is _kernel.NUMPY_ALONE, reason="NumPy evaluates: no record of a kernel")


@pytest.mark.parametrize("make", [tiago, space_robot_in_joints])
def test_frames_are_those_of_pinocchio(make):
    """Frames of all joints, the world's and the base's included: masks of other branches, and offsets of frames."""
    reduced = make()
    robot = reduced.robot
    q = robot.random_configuration(np.random.default_rng(2))
    state = reduced.at(q, np.ones(reduced.r))
    assert state.compiled_kinematics is not None
    here, plain = state.position, Plain(robot, q, np.zeros(robot.nv))
    assert isinstance(here, KnownKinematics)
    near(here.M, plain.M())
    for frame in range(0, robot.model.nframes, 3):
        near(here.placement(frame).rotation, plain.placement(frame).rotation)
        near(here.placement(frame).translation, plain.placement(frame).translation)
        for axes in (WORLD_AXES, OWN_AXES):
            near(here.jacobian(frame, axes), plain.jacobian(frame, axes))
        near(here.jacobian(frame, rows=[4, 1]), plain.jacobian(frame, WORLD_AXES)[[4, 1]])
    assert not here.jacobian(1).flags.writeable
    assert not here.placement(1).translation.flags.writeable


def test_the_rows_of_another_reduction_are_told_apart():
    """Vertical outputs leave E as it is; other velocities, rows or times do not."""
    data = tiago().reduction_data
    assert data.measuring(data.vertical).has_rows_of(data)
    entries = list(range(data.r))
    for other in (data.in_entries(entries), data.keeping(data.kept[:0]), data.frozen(1.0)):
        assert not other.has_rows_of(data)
