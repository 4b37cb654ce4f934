"""Outputs are divided into primary and redundant ones by name."""

from types import SimpleNamespace

import pytest

import rnc_pin as rnc
from rnc_pin.model.row_stack import OutputStack
from textbook_systems import sliders


def test_outputs_are_divided_by_name():
    robot = sliders("XXXX", (2.0, 3.0, 5.0, 7.0))
    outputs = [rnc.JointPosition(name) for name in "dabc"]
    reduced = SimpleNamespace(
        reducing=OutputStack([each.bind(robot) for each in outputs[:3]]),
        vertical=OutputStack([each.bind(robot) for each in (*outputs[3:], *outputs[:2])]),
        r=3,
    )
    task = rnc.Task.of(reduced, ["b", "d"], ["a"], ["a", "c"])
    assert (task.primary.tolist(), task.redundant.tolist(), task.vertical.tolist()) == ([2, 0], [1], [2, 0])
    assert (task.primary_names, task.redundant_names, task.vertical_names) == (("b", "d"), ("a",), ("a", "c"))
    assert task.r == 3
    everything = rnc.Task.of(reduced, ["b", "d", "a"], [])
    assert everything.vertical.tolist() == [0, 1, 2]
    assert everything.redundant.dtype == int
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
