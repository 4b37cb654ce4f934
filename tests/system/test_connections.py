"""Clients of all kinds, the same ones each time: the short form of ``python -m benchmarks.connections``."""

import pytest

from benchmarks import connections


@pytest.mark.parametrize("viewer", connections.VIEWERS)
def test_clients_cost_nothing_that_stays(viewer):
    if viewer == "viser":
        pytest.importorskip("viser", reason="viser is an optional extra and not installed")
    counts, faults, _ = connections.connect(viewer, 60)
    assert faults == []
    assert len(counts) == len(connections.CLIENTS)
