"""Trees of propagated motions and the equations of Newton's method, beside dense ones."""

import numpy as np
import pytest
import scipy

from benchmarks.planned_models import tractor
from rnc_pin.motion.planning.way_propagation import PropagatedSearch
from rnc_pin.motion.planning.way_search import SearchBudget, WayTask


def search_of(count):
    """A search of a tractor with a trailer, and ``count`` configurations of it."""
    reduced, generator = tractor(1), np.random.default_rng(3)
    q = np.array([reduced.random_configuration(generator, 0.4) for _ in range(count)])
    area, every = np.array([[-9.0, -9.0, -9.0], [9.0, 9.0, 9.0]]), np.ones(5)
    return PropagatedSearch(WayTask(reduced, every > 0, None, q[0], q[1:2], area, SearchBudget(9.0))), q


@pytest.mark.parametrize("loose", [1.0, 7.0])
@pytest.mark.parametrize("open_directions", [5, 3])
def test_a_change_is_the_least_one_that_meets_the_nodes(loose, open_directions):
    """The dense least-norm solution of ``A_k dq_k + B_k du_k - dq_k+1 = missed_k``, with the start fixed."""
    search, nodes = search_of(4)
    generator = np.random.default_rng(1)
    inputs, wanted = generator.normal(size=(2, 3, 2))
    missed, turned = 0.1 * generator.normal(size=(3, 5)), scipy.linalg.qr(generator.normal(size=(5, 5)))[0]
    search._open, closed = np.split(turned, [open_directions], axis=1)
    shots = search._flow.shots(nodes[:-1], inputs, 5)
    A, B = shots.by_start, shots.by_input
    middle, size = np.sqrt(loose) * np.eye(5), 5 - open_directions
    rows = np.zeros((15, 6 + 10 + size))  # of du, dq_1 and dq_2 in units of sqrt(loose), and the closed part of dq_3
    for k in range(3):
        rows[5 * k : 5 * k + 5, 2 * k : 2 * k + 2] = B[k]
    rows[:5, 6:11], rows[5:10, 6:11] = -middle, A[1] @ middle
    rows[5:10, 11:16], rows[10:, 11:16], rows[10:, 16:] = -middle, A[2] @ middle, -closed
    rest = missed - np.einsum("kij,kj->ki", B, wanted)
    least = np.linalg.lstsq(rows, rest.ravel(), rcond=None)[0]
    places, changed = nodes.copy(), inputs.copy()
    search._change(places, changed, shots, missed, wanted, loose)
    np.testing.assert_allclose(changed - inputs - wanted, least[:6].reshape(3, 2), atol=1e-9)
    moved = search._flow.manifold.difference(nodes, places)
    expected = [np.zeros(5), *(least[6:16].reshape(2, 5) * np.sqrt(loose)), closed @ least[16:]]
    np.testing.assert_allclose(moved, expected, atol=1e-9)
