"""References from a start that is not known yet."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.references import reference as kinds

START, LINES = np.array([0.4, -1.0]), Coordinates([False, False], names=["x", "y"])


@pytest.mark.parametrize(("relative", "end"), [
    (kinds.RelativeMinimumJerk(to=[1.0, 2.0], duration=2.0), [1.0, 2.0]),
    (kinds.RelativeMinimumJerk(by=[1.0, 2.0], duration=2.0), [1.4, 1.0]),
    (kinds.RelativeViaPoints([1.0, 2.0], [[3.0, 0.0], [1.0, 2.0]]), [1.0, 2.0]),
    (kinds.RelativeHarmonic([0.3, 0.2], frequency=0.5, phase=np.pi / 2, ramp=1.0), [0.7, -0.8]),
    (kinds.RelativeHarmonic([0.3, 0.2], frequency=0.5, phase=np.pi / 2, center=[1.0, 1.0]), [1.3, 1.2]),
    (kinds.RelativeCircle(0.3, period=2.0), [0.7, -1.0]),
    (kinds.RelativeCircle(0.3, speed=0.075 * np.pi, plane=["y", "x"], ramp=0.5), [0.7, -1.0]),  # a quarter from y to x
    (kinds.RelativeHold(), START),
    (kinds.RelativeHold([1.0, 2.0]), [1.0, 2.0]),
])  # fmt: skip
def test_a_reference_ends_where_it_says(relative, end):
    reference = relative.from_start(START, LINES)
    np.testing.assert_allclose(reference.at(2.0).position, end, rtol=1e-12)
    first = getattr(relative, "center", None) or getattr(relative, "value", None) or START.tolist()
    np.testing.assert_allclose(reference.at(0.0).position, first, rtol=1e-12)


def test_a_table_is_followed_through_its_rows_and_rests_at_its_ends(tmp_path):
    (tmp_path / "way.csv").write_text("y, time, x\n0.5, 0, 1\n0.7, 1, 3\n\n0.1, 2, 2\n")
    reference = kinds.RelativeTable(str(tmp_path / "way.csv")).from_start(START, LINES)
    for time, *place in ((0, 1, 0.5), (1, 3, 0.7), (2, 2, 0.1)):
        np.testing.assert_allclose(reference.at(time).position, place, rtol=1e-12)
    np.testing.assert_allclose([reference.at(time).velocity for time in (0.0, 1.999999)], 0.0, atol=1e-4)


@pytest.mark.parametrize(("text", "words"), [
    ("time, y\n0, 1\n1, 2", "no column 'x'; expected one of: time, y"),
    ("time, x, y, yy\n0, 1, 2, 3", "no output 'yy'"),
    ("time, x, y\n0, 1", "expected a line of names, then numbers"),
    ("time, x, y\n0, 1, one", "expected a line of names, then numbers: could not convert"),
    ("time, x, y\n1, 0, 0\n1, 2, 2", "increasing times"),
    ("time, x, y\n0, 0, 0\n1, nan, 2", "has to be finite"),
])  # fmt: skip
def test_a_table_that_is_none_is_refused(text, words, tmp_path):
    (tmp_path / "way.csv").write_text(text)
    with pytest.raises(rnc.RncError, match=words):
        kinds.RelativeTable(str(tmp_path / "way.csv")).from_start(START, LINES)
