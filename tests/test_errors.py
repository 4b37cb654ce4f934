"""Errors are one line with a place, and keep their data."""

import pickle

import numpy as np
import pytest

import rnc_pin as rnc

SINGULAR = rnc.SingularityError("no inverse", q=np.array([0.5]), condition=1e12, rows=["x"], time=0.25)


@pytest.mark.parametrize(("error", "words"), [
    (rnc.ModelError("no joint 'a'"), "controller: run 3: no joint 'a'"),
    (rnc.InputError("q has shape (3,)"), "controller: run 3: q has shape (3,)"),
    (rnc.DivergenceError("|v| > 5", time=0.25), "diverged at t = 0.250 s: controller: run 3: |v| > 5"),
    (SINGULAR, "controller: run 3: no inverse at t = 0.250 s: rows x are dependent (condition 1e+12) at q = [0.5]"),
], ids=lambda value: type(value).__name__)  # fmt: skip
def test_a_place_is_prepended_and_the_data_stay(error, words):
    error.trajectory = "the run so far"
    assert error.within("run 3").within("controller") is error
    assert str(error) == str(pickle.loads(pickle.dumps(error))) == words
    assert error.trajectory == "the run so far"
    if error is SINGULAR:
        assert (error.rows, error.time) == (("x",), 0.25)


def test_arguments_are_said_as_python_and_as_scenario_files_take_them():
    assert rnc.errors.argument("base", "free") == "base='free' (robot: {base: free})"
    assert rnc.errors.argument("snap", False) == "snap=False (robot: {snap: false})"
    assert rnc.errors.argument("masses", {"a": 0.1}) == "masses={'a': 0.1} (robot: {masses: {a: 0.1}})"
    robot = rnc.Robot.from_urdf("unicycle.urdf", base="planar")
    with pytest.raises(rnc.ModelError, match=r"load it with base='fixed' \(robot: \{base: fixed\}\) to mount it"):
        robot.attach(robot, "axle")
