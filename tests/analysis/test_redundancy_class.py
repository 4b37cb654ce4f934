"""Classes and reports of systems written down row by row, beside what they have to be."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.analysis import classify
from textbook_systems import prismatic, sliders_with_rows


@pytest.mark.parametrize(("A", "redundant", "expected", "tracked", "reason"), [
    ([[5, 2]], "1", "1", "2", "A4 has full row rank"),
    ([[5, 2, 3]], "12", "1", "3", "A4 has full row rank (more redundant than vertical outputs: some freedom is left)"),
    ([[5, 2], [4, 3]], "1", None, "23", "2 vertical outputs moved by 1 redundant one: too few to steer them all"),
    ([[5, 1, 2], [4, 2, 4]], "12", None, "34",
        "2 vertical outputs moved by 2 redundant ones, but A4 has not full row rank"),
    ([[5, 1, 2], [4, 0, 0]], "12", None, "3",
        "1 vertical output moved by 2 redundant ones: class 2 needs as many of both"),
    ([[3, 5], [2, 0]], "0", None, "23", "2 vertical outputs moved by 1 redundant one: too few to steer them all"),
    ([[5, 0], [4, 3]], "1", "2", "3", "A6 = 0, A4 nonsingular and A5 independent of x22"),
    ([[5, 0], [4, 0]], "1", None, "", "A4 = 0, and the values of x22 do not steer A3 v21 either"),
])  # fmt: skip
def test_a_class_of_constant_blocks(A, redundant, expected, tracked, reason):
    A, free = np.array(A, float), [int(k) for k in redundant]
    k, r = A.shape
    reduced = sliders_with_rows(lambda q: A)
    task = rnc.Task.of(reduced, [f"s{i}" for i in range(r) if i not in free], [f"s{i}" for i in free])
    found = classify(reduced, task, np.random.default_rng(0).normal(size=(5, r + k)))
    A3, A4 = np.delete(A, free, axis=1), A[:, free]
    moved, vertical = A4.any(axis=1), [f"s{r + i}" for i in range(k)]
    names = tuple(f"s{r + i}" for i in range(k) if moved[i])
    assert names == tuple(f"s{i}" for i in tracked)
    assert (found.redundancy_class, found.reason) == (expected, reason)
    assert (found.tracked, found.driven) == (names, tuple(name for name in vertical if name not in names))
    evidence = found.evidence
    np.testing.assert_allclose(evidence.A3, np.abs(A3).max())
    values = np.linalg.svd(A4[moved], compute_uv=False) if moved.any() else np.zeros(2)
    np.testing.assert_allclose(evidence.A4_singular_values, (values.min(), values.max()), atol=1e-12)
    np.testing.assert_allclose((evidence.A6, evidence.A5_along_x22), 0.0, atol=1e-12)
    assert evidence.steering == (None if moved.any() else 0.0)


def test_figures_are_those_of_the_columns_and_rows_of_the_task():
    def A(q):
        return [[1.5 + np.sin(q[1]), 7.0, 0.0], [0.0, 0.3 * q[2], -4.0]]

    def A_dot(q, v):
        return [[np.cos(q[1]) * v[1], 0.0, 0.0], [0.0, 0.3 * v[2], 0.0]]

    reduced = sliders_with_rows(A, A_dot)
    task = rnc.Task.of(reduced, ["s2", "s1"], ["s0"], ["s4", "s3"])
    configurations = np.random.default_rng(1).normal(size=(5, 5))
    found = classify(reduced, task, configurations)
    assert (found.redundancy_class, found.tracked, found.driven) == ("2", ("s3",), ("s4",))
    A4 = 1.5 + np.sin(configurations[:, 1])
    np.testing.assert_allclose(found.evidence.A4_singular_values, (A4.min(), A4.max()))
    np.testing.assert_allclose(found.evidence.A3, 7.0)


def test_what_only_the_value_of_an_output_steers():
    """``x11dot = sin(x22) s0dot``: its derivative is the cosine, times a speed of about one."""
    reduced = sliders_with_rows(lambda q: [[np.sin(q[1]), 0], [3, 0]], lambda q, v: [[np.cos(q[1]) * v[1], 0], [0, 0]])
    task = rnc.Task.of(reduced, ["s0"], ["s1"])
    configurations = np.random.default_rng(1).uniform(-1, 1, size=(5, 4))
    found = classify(reduced, task, configurations)
    assert (found.redundancy_class, found.tracked, found.driven) == ("2s", ("s2",), ("s3",))
    assert 0.5 < found.evidence.steering / np.cos(configurations[:, 1]).max() < 1.5
    assert found.evidence.A4_singular_values == (0.0, 0.0)
    np.testing.assert_allclose(found.evidence.A3, 3.0)


def test_how_a5_depends_on_x22_is_its_partial_derivative():
    along = np.array([0.3, -0.4, 0.7, 1.1])
    reduced = prismatic(lambda q: 1 + 0.5 * np.sin(along @ q), lambda q: 0.5 * np.cos(along @ q) * along)
    configurations = np.random.default_rng(1).uniform(-1, 1, size=(5, 4))
    found = classify(reduced, rnc.Task.of(reduced, ["x21"], ["x22"]), configurations)
    assert found.reason == "1 vertical output moved by 1 redundant one, but A5 depends on x22"
    assert found.evidence.A5_along_x22 == pytest.approx(0.5 * 1.1 * np.abs(np.cos(configurations @ along)).max())


@pytest.mark.parametrize(("along", "expected"), [
    ((0, 0, 0, 0), "2"),
    ((0, 0, 1, 0), "2"),  # on x21
    ((0, 1, 0, 0), "2"),  # on x12
    ((1, 0, 0, 0), "2"),  # on x11, which x22 moves: the paper asks for A5(x11, x12, x21)
    ((0, 0, 0, 1), None),  # on x22
    ((1, 0, 0, -1), None),  # on x11 - x22, which x22 does not change under the constraints
    ((1, 1, 1, 0.2), None),
])  # fmt: skip
def test_class_2_asks_for_an_A5_without_x22_and_lets_it_depend_on_all_else(along, expected):
    along = np.array(along, dtype=float)
    reduced = prismatic(lambda q: 1 + 0.5 * np.sin(along @ q), lambda q: 0.5 * np.cos(along @ q) * along)
    found = rnc.analyze(reduced, ["x21"], ["x22"], samples=16).redundancy
    assert found.redundancy_class == expected
    assert (found.tracked, found.driven) == (("x11",), ("x12",))
    assert (found.evidence.A5_along_x22 > 0.01 * abs(along[3])) == (along[3] != 0)
    assert ("A5 depends on x22" in found.reason) == (expected is None)
