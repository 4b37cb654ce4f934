"""Visitors of all kinds, the same ones each time: the short form of ``python -m benchmarks.connections``."""

import pytest

from benchmarks import connections


@pytest.mark.parametrize("screen", connections.SCREENS)
def test_visitors_cost_nothing_that_stays(screen):
    if screen == "viser":
        pytest.importorskip("viser", reason="viser is an optional extra and not installed")
    counts, faults, _ = connections.visit(screen, 60)
    assert faults == []
    assert len(counts) == len(connections.VISITORS)
