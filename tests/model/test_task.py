"""Outputs are divided into primary and redundant ones by name."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import frame_placement
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import OutputStack
from rnc_pin.model.task import OutputTargets
from rnc_pin.model.user_functions import gradient
from textbook_systems import sliders


def test_outputs_are_divided_by_name():
    robot = sliders("XXXX", (2.0, 3.0, 5.0, 7.0))
    outputs = [rnc.JointPosition(name) for name in "dabc"]
    reducing, vertical = outputs[:3], (*outputs[3:], *outputs[:2])
    reducing, vertical = (OutputStack([each.bind(robot) for each in stack]) for stack in (reducing, vertical))
    reduced = SimpleNamespace(reducing=reducing, vertical=vertical, r=3)
    task = rnc.Task.of(reduced, ["b", "d"], ["a"], ["a", "c"])
    assert (task.primary.tolist(), task.redundant.tolist(), task.vertical.tolist()) == ([2, 0], [1], [2, 0])
    assert (task.primary_names, task.redundant_names, task.vertical_names) == (("b", "d"), ("a",), ("a", "c"))
    assert task.r == 3
    everything = rnc.Task.of(reduced, ["b", "d", "a"], [])
    assert (everything.vertical.tolist(), everything.redundant.dtype) == ([0, 1, 2], int)
    for given, words in (
        ((["b", "x"], ["a"]), "^no reducing output 'x'"),
        ((["b", "d"], ["a"], ["b"]), "^no vertical output 'b'"),
        ((["b", "d"], ["b"]), "^duplicate output in primary and redundant$"),
        ((["b", "b", "d"], ["a"]), "^duplicate output in primary and redundant$"),
        ((["b"], ["d"]), "^reducing output 'a' is neither primary nor redundant$"),
        (([], []), "^reducing output 'd' is neither primary nor redundant$"),
    ):
        with pytest.raises(rnc.ConfigurationError, match=words):
            rnc.Task.of(reduced, *given)


def test_targets_measure_what_is_left_to_them():
    """Of an output by name, which is not the first one, and of outputs of their own, a rotation behind a position."""
    robot = rnc.Robot.from_urdf("floating_arm.urdf", base="free")
    named = [rnc.FramePosition("satellite"), rnc.FrameTilt("hand", "z")]
    reduced = rnc.NonholonomicSystem(robot).reduce(vertical=named)
    goal = pin.exp3(np.array([0.3, -0.8, 0.5]))
    place, turn = rnc.FramePosition("hand", "zx"), rnc.FrameOrientation("hand")
    targets = OutputTargets(reduced, {place: [0.1, -0.2], "hand_tilt_z": 0.7, turn: goal, "satellite_y": 1.5})
    assert [(each.start, each.stop) for each in targets.places] == [(0, 2), (2, 3), (3, 6), (6, 7)]
    kinematics, generator = Kinematics(robot), np.random.default_rng(6)
    many = np.array([robot.random_configuration(generator) for _ in range(3)])
    errors = targets.error(kinematics.position(many), targets.goal)
    for q, error, J in zip(many, errors, targets.error_jacobian(kinematics.position(many), errors), strict=True):
        hand = frame_placement(robot, q, "hand")
        expected = [0.1 - hand.translation[2], -0.2 - hand.translation[0], 0.7 - np.arcsin(hand.rotation[2, 2])]
        y = frame_placement(robot, q, "satellite").translation[1]
        np.testing.assert_allclose(error, [*expected, *pin.log3(goal @ hand.rotation.T), 1.5 - y], atol=1e-12)
        slopes = gradient(robot.model, lambda p: targets.error(kinematics.position(p), targets.goal), q, 1e-3)
        np.testing.assert_allclose(J, -slopes, atol=1e-8)
        np.testing.assert_allclose(targets.error_jacobian(kinematics.position(q), error), J, atol=1e-14)
        lengths = [np.hypot(*expected[:2]), abs(expected[2]), pin.AngleAxis(goal @ hand.rotation.T).angle, abs(1.5 - y)]
        assert targets.residuals(kinematics.position(q)) == pytest.approx(
            dict(zip(targets.labels, lengths, strict=True)), abs=1e-12
        )
