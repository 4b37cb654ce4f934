"""The Riccati recursion against dense solves, and solutions of the subproblem against another solver."""

import daqp
import numpy as np
import pytest

from kernel_calls import positive
from rnc_pin import _kernel
from rnc_pin.errors import SimulationError
from rnc_pin.motion.optimal.interior_point import InteriorPointSolver, LinearQuadratic, RiccatiFactors


def subproblem(limit, end=None, seed=0, N=12, nx=4, nu=2):
    """Random subproblem with bounded inputs, and equations at the end."""
    generator = np.random.default_rng(seed)
    A = np.eye(nx) + 0.1 * generator.normal(size=(N, nx, nx))
    AB = np.concatenate([A, 0.3 * generator.normal(size=(N, nx, nu))], axis=2)
    H = np.tile(np.diag([0.1] * nx + [1.0] * nu), (N, 1, 1))
    equations = 0 if end is None else len(end)
    k = nu + equations
    G = np.zeros((N + 1, k, nx + nu))
    lower, upper = np.full((N + 1, k), -np.inf), np.full((N + 1, k), np.inf)
    G[:-1, :nu, nx:], lower[:-1, :nu], upper[:-1, :nu] = np.eye(nu), -limit, limit
    if equations:
        G[-1, nu:] = np.eye(nx + nu)[:equations]
        lower[-1, nu:] = upper[-1, nu:] = end
    g, gap = generator.normal(size=(N, nx + nu)), 0.1 * generator.normal(size=(N, nx))
    rows = G, lower, upper, np.zeros((N, nu, nx))
    return LinearQuadratic(AB, gap, H, g, np.eye(nx), generator.normal(size=nx), *rows)


def dense_solution(p):
    """Inputs (N nu,) from daqp, with the states eliminated."""
    A, B = np.split(p.AB, [p.AB.shape[1]], axis=2)
    N, nx, nu = B.shape
    S, c = np.zeros((N + 1, nx, N * nu)), np.zeros((N + 1, nx))
    for k in range(N):
        S[k + 1], c[k + 1] = A[k] @ S[k], A[k] @ c[k] + p.gap[k]
        S[k + 1][:, k * nu : (k + 1) * nu] += B[k]
    U = np.eye(N * nu).reshape(N, nu, N * nu)
    Z = np.concatenate([S[:-1], U], axis=1)
    z = np.concatenate([c[:-1], np.zeros((N, nu))], axis=1)
    H = np.einsum("nia,nij,njb->ab", Z, p.H, Z) + S[-1].T @ p.H_end @ S[-1]
    g = np.einsum("nia,ni->a", Z, np.einsum("nij,nj->ni", p.H, z) + p.g) + S[-1].T @ (p.H_end @ c[-1] + p.g_end)
    rows = np.einsum("nkx,nxa->nka", p.G[:, :, :nx], S)
    rows[:-1] += np.einsum("nku,nua->nka", p.G[:-1, :, nx:], U)
    offset, real = np.einsum("nkx,nx->nk", p.G[:, :, :nx], c), np.isfinite(p.upper)
    G, low, high = rows[real], (p.lower - offset)[real], (p.upper - offset)[real]
    sense = np.where(low == high, 5, 0).astype(np.int32)
    x, _, flag, _ = daqp.solve(H, g, np.ascontiguousarray(G), high, low, sense)
    assert flag == 1
    return x


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("limit", [0.5, 2.0, 100.0])
def test_solution_is_that_of_a_dense_program(limit, seed):
    problem = subproblem(limit, end=[0.2, -0.1], seed=seed)
    found = InteriorPointSolver().solve(problem, damping=0.0, weight=1e5)
    np.testing.assert_allclose(found.u.ravel(), dense_solution(problem), atol=2e-4)


def test_without_active_bounds_one_factorization_is_enough():
    problem = subproblem(100.0, end=[0.2, -0.1])
    assert InteriorPointSolver().solve(problem, damping=0.0, weight=1e5).iterations == 0


def test_an_end_out_of_reach_is_approached_within_the_bounds():
    problem = subproblem(0.01, end=[50.0])
    found = InteriorPointSolver().solve(problem, damping=0.0, weight=1e6)
    assert np.abs(found.u).max() <= 0.01 * (1 + 1e-3)
    assert problem.G[-1, 2, :4] @ found.x[-1] < 50.0
    costates = np.einsum("nxu,nx->nu", problem.AB[:, :, 4:], found.costate[1:])
    np.testing.assert_array_equal(np.sign(found.u), -np.sign(costates))  # every input gives its most towards the end


def test_multipliers_of_the_last_subproblem_shorten_the_next_one():
    solver, cold, warm = InteriorPointSolver(), [], []
    for step in range(4):
        problem = subproblem(0.5, end=[0.2, -0.1])
        problem.g[:] *= 1.0 + 1e-3 * step
        found = solver.solve(problem, damping=0.0, weight=1e5)
        np.testing.assert_allclose(found.u.ravel(), dense_solution(problem), atol=2e-4)
        warm.append(found.iterations)
        cold.append(InteriorPointSolver().solve(problem, damping=0.0, weight=1e5).iterations)
    assert warm[0] == cold[0]
    assert sum(warm[1:]) < 0.55 * sum(cold[1:])
    for seed, weight in ((7, 1e5), (8, 10.0), (9, 1e8)):  # other bounds, and a weight too small for the multipliers
        other = subproblem(0.5, end=[0.2, -0.1], seed=seed)
        expected, found = (each.solve(other, damping=0.0, weight=weight) for each in (InteriorPointSolver(), solver))
        np.testing.assert_allclose(found.u, expected.u, atol=2e-4)


def test_far_from_the_optimum_a_subproblem_is_solved_less_precisely():
    """The dynamics still hold, and the inputs err by no more than the part of the step that the next one corrects."""
    problem = subproblem(0.5, end=[0.2, -0.1])
    exact, early = (InteriorPointSolver().solve(problem, 0.0, 1e5, change) for change in (None, 1.0))
    assert early.iterations < exact.iterations
    after = np.matvec(problem.AB, np.concatenate([early.x[:-1], early.u], axis=1)) + problem.gap
    np.testing.assert_allclose(early.x[1:], after, atol=1e-2 * np.abs(problem.gap).max())
    np.testing.assert_allclose(early.u, exact.u, atol=0.05)


N, NX, NU, M = 5, 3, 2, 2


def test_solution_is_that_of_the_dense_equations(generator):
    """The whole problem in one matrix: costs of all stages, and multipliers of the dynamics."""
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
def test_a_problem_that_is_not_convex_is_refused(library, monkeypatch, generator):
    monkeypatch.setattr(_kernel, "library", library)
    H = positive(generator, N, NX + NU)
    H[2, NX:, NX:] -= 100 * np.eye(NU)
    with pytest.raises(SimulationError, match="not convex"):
        RiccatiFactors(generator.normal(size=(N, NX, NX + NU)), H, np.eye(NX))
