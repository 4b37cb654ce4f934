"""The Riccati recursion of the subproblem against dense solves."""

import numpy as np
import pytest

from rnc_pin import _kernel
from rnc_pin.errors import SimulationError
from rnc_pin.optimal.linear_quadratic import RiccatiFactors

N, NX, NU, M = 5, 3, 2, 2


def positive(generator, *shape):
    root = generator.normal(size=(*shape, shape[-1]))
    return root @ root.mT + 0.1 * np.eye(shape[-1])


def test_solution_is_that_of_the_dense_equations():
    """The whole problem in one matrix: costs of all stages, and multipliers of the dynamics."""
    generator = np.random.default_rng(0)
    AB, H, end = generator.normal(size=(N, NX, NX + NU)), positive(generator, N, NX + NU), positive(generator, NX)
    g, g_end, gap = (generator.normal(size=shape) for shape in ((N, NX + NU, M), (NX, M), (N, NX, M)))
    z, last, costate = RiccatiFactors(AB, H, end).solve(g, g_end, gap)

    size, count = NX + NU, N * (NX + NU) + NX
    W, right, E = np.zeros((count, count)), np.zeros((count, M)), np.zeros((NX * (N + 1), count))
    E[:NX, :NX] = np.eye(NX)
    for k in range(N):
        at = slice(k * size, (k + 1) * size)
        W[at, at], right[at] = H[k], g[k]
        E[(k + 1) * NX : (k + 2) * NX, at] = AB[k]
        E[(k + 1) * NX : (k + 2) * NX, (k + 1) * size : (k + 1) * size + NX] = -np.eye(NX)
    W[-NX:, -NX:], right[-NX:] = end, g_end
    whole = np.block([[W, E.T], [E, np.zeros((len(E), len(E)))]])
    found = np.linalg.solve(whole, -np.concatenate([right, np.zeros((NX, M)), gap.reshape(-1, M)]))
    np.testing.assert_allclose(np.concatenate([z.reshape(-1, M), last]), found[:count], atol=1e-10)
    np.testing.assert_allclose(costate[1:].reshape(-1, M), found[count + NX :], atol=1e-9)


@pytest.mark.parametrize("library", [_kernel.library, _kernel.NUMPY_ALONE])
def test_a_problem_that_is_not_convex_is_refused(library, monkeypatch):
    monkeypatch.setattr(_kernel, "library", library)
    generator = np.random.default_rng(0)
    H = positive(generator, N, NX + NU)
    H[2, NX:, NX:] -= 100 * np.eye(NU)
    with pytest.raises(SimulationError, match="not convex"):
        RiccatiFactors(generator.normal(size=(N, NX, NX + NU)), H, np.eye(NX))
