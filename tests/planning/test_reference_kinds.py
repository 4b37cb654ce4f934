"""References from a start that is not known yet."""

import numpy as np
import pytest

from rnc_pin.model.coordinates import Coordinates
from rnc_pin.planning.reference_kinds import RelativeHarmonic, RelativeHold, RelativeMinimumJerk, RelativeViaPoints

START, LINES = np.array([0.4, -1.0]), Coordinates([False, False])


@pytest.mark.parametrize(("relative", "end"), [
    (RelativeMinimumJerk(to=[1.0, 2.0], duration=2.0), [1.0, 2.0]),
    (RelativeMinimumJerk(by=[1.0, 2.0], duration=2.0), [1.4, 1.0]),
    (RelativeViaPoints([1.0, 2.0], [[3.0, 0.0], [1.0, 2.0]]), [1.0, 2.0]),
    (RelativeHarmonic([0.3, 0.2], frequency=0.5, phase=np.pi / 2, ramp=1.0), [0.7, -0.8]),
    (RelativeHarmonic([0.3, 0.2], frequency=0.5, phase=np.pi / 2, center=[1.0, 1.0]), [1.3, 1.2]),
    (RelativeHold(), START),
    (RelativeHold([1.0, 2.0]), [1.0, 2.0]),
])  # fmt: skip
def test_a_reference_ends_where_it_says(relative, end):
    reference = relative.from_start(START, LINES)
    np.testing.assert_allclose(reference.at(2.0).position, end, rtol=1e-12)
    first = getattr(relative, "center", None) or getattr(relative, "value", None) or START.tolist()
    np.testing.assert_allclose(reference.at(0.0).position, first, rtol=1e-12)
