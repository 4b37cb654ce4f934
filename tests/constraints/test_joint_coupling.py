"""Coupled joints: gaps, ratios, and joints that are locked."""

from types import SimpleNamespace

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.relative_rows import CouplingRow, mimic_row
from rnc_pin.robots.sources.description import Mimic
from systems import sleigh
from textbook_systems import sliders


@pytest.mark.parametrize("ratio", [2.0, -0.5, 2 / 3, -1.25])
@pytest.mark.parametrize("kinds", ["RR", "UR", "RU", "UU", "XX"])
def test_a_gap_of_a_coupling_forgets_the_turns_that_its_joints_forget(kinds, ratio):
    """Whole turns of continuous joints: none of it for joints with ends, and the least of what is left."""
    robot, offset = sliders(kinds, chain=False), 0.2
    row = CouplingRow(robot, "a", "b", ratio, offset)
    assert (row.units, row.holonomic) == (("m/s" if kinds == "XX" else "rad/s",), (True,))
    np.testing.assert_array_equal(row.matrix, [[1.0, -ratio]])
    turns = np.arange(-12, 13)
    generator, kinematics = np.random.default_rng(7), Kinematics(robot)
    for _ in range(6):
        a, b = generator.uniform(-3, 3, 2)
        q, alike = robot.configuration({"a": a, "b": b}), a - ratio * b - offset
        mine = 2 * np.pi * turns if kinds[0] == "U" else np.zeros(1)
        drivers = 2 * np.pi * ratio * turns if kinds[1] == "U" else np.zeros(1)
        gaps = (alike + mine[:, None] + drivers).ravel()
        np.testing.assert_allclose(row.residual(kinematics.position(q)), [gaps[np.argmin(np.abs(gaps))]], atol=1e-9)
        assert row.residual(kinematics.position(np.stack([q, q]))).shape == (2, 1)


def test_a_ratio_that_is_no_fraction_couples_rates_alone():
    """Of two continuous joints: fractions of numbers up to a thousand have a period, others none."""
    robot = sliders("UU", chain=False)
    for ratio, holonomic in ((1 / 1000, True), (1 / 1001, False), (0.1 + 0.2, True), (2**0.5, False)):
        assert CouplingRow(robot, "a", "b", ratio, 0.1).holonomic == (holonomic,)
    held = CouplingRow(robot, "b", None, 1.0, 0.1)
    assert (held.names, held.pair) == (("coupling(b, None)",), {"b", None})
    np.testing.assert_array_equal(held.matrix, [[0.0, 1.0]])
    q = robot.configuration({"a": 2.0, "b": 0.1 - 3.1})
    np.testing.assert_allclose(held.residual(Kinematics(robot).position(q)), [-3.1], atol=1e-12)
    with pytest.raises(rnc.ModelError, match="joint 'root_joint' has 3 degrees of freedom: only joints with one"):
        CouplingRow(sleigh().robot, "root_joint", None, 1.0, 0.0)


def test_what_a_file_couples_to_a_joint_that_is_locked_is_held():
    """``joint = multiplier of + offset``, solved for whichever of the two moves."""
    robot = sliders("RRR", chain=False)
    known = {name: getattr(robot, name) for name in ("model", "nv", "joint_id", "single_joint")}
    locked = SimpleNamespace(**known, joint_names=["a", "b"], locked={"c": 0.4})
    for given, name, matrix, held in (
        (Mimic("a", "b", -2.0, 0.3), "coupling(a, b)", [1.0, 2.0], None),
        (Mimic("a", "c", -2.0, 0.3), "coupling(a, c)", [1.0, 0.0], -0.5),
        (Mimic("c", "b", -2.0, 0.3), "coupling(c, b)", [0.0, 1.0], -0.05),
        (Mimic("a", "b", 0.0, 0.3), "coupling(a, b)", [1.0, 0.0], 0.3),
    ):
        row = mimic_row(locked, given)
        assert row.names == (name,)
        np.testing.assert_array_equal(row.matrix, [[*matrix, 0.0]])
        if held is not None:
            assert row.offset == pytest.approx(held)
            assert row.driver is None
    assert mimic_row(locked, Mimic("c", "b", 0.0, 0.3)) is None
    assert mimic_row(sleigh().robot, Mimic("root_joint", "root_joint", 1.0, 0.0)) is None  # it has no single position
