"""Clients of all kinds, the same ones each time: the short form of ``python -m benchmarks.connections``."""

from benchmarks import connections


def test_clients_cost_nothing_that_stays():
    counts, faults, _ = connections.connect(60)
    assert faults == []
    assert len(counts) == len(connections.CLIENTS)
