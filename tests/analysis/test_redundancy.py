"""Classes and reports of systems written down row by row, beside what they have to be."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.analysis import boundedness, classify, lemma_1_residuals
from textbook_systems import planar_model, prismatic, rail_sliders, sliders_with_rows

# ---------------------------------------------------------------------- classes of redundancy


@pytest.mark.parametrize(
    ("A", "redundant", "expected", "tracked", "reason"),
    [
        ([[5, 2]], "1", "1", "2", "A4 has full row rank"),
        (
            [[5, 2, 3]],
            "12",
            "1",
            "3",
            "A4 has full row rank (more redundant than vertical outputs: some freedom is left)",
        ),
        ([[5, 2], [4, 3]], "1", None, "23", "2 vertical outputs moved by 1 redundant one: too few to steer them all"),
        (
            [[5, 1, 2], [4, 2, 4]],
            "12",
            None,
            "34",
            "2 vertical outputs moved by 2 redundant ones, but A4 has not full row rank",
        ),
        (
            [[5, 1, 2], [4, 0, 0]],
            "12",
            None,
            "3",
            "1 vertical output moved by 2 redundant ones: class 2 needs as many of both",
        ),
        ([[3, 5], [2, 0]], "0", None, "23", "2 vertical outputs moved by 1 redundant one: too few to steer them all"),
        ([[5, 0], [4, 3]], "1", "2", "3", "A6 = 0, A4 nonsingular and A5 independent of x22"),
        ([[5, 0], [4, 0]], "1", None, "", "A4 = 0, and the values of x22 do not steer A3 v21 either"),
    ],
)
def test_a_class_of_constant_blocks(A, redundant, expected, tracked, reason):
    """Names, words and figures."""
    A, free = np.array(A, float), [int(k) for k in redundant]
    k, r = A.shape
    reduced = sliders_with_rows(lambda q: A)
    task = rnc.Task.of(reduced, [f"s{i}" for i in range(r) if i not in free], [f"s{i}" for i in free])
    configurations = np.random.default_rng(0).normal(size=(5, r + k))
    found = classify(reduced, task, configurations)
    A3, A4 = np.delete(A, free, axis=1), A[:, free]
    moved = A4.any(axis=1)
    vertical = [f"s{r + i}" for i in range(k)]
    names = tuple(f"s{r + i}" for i in range(k) if moved[i])
    assert names == tuple(f"s{i}" for i in tracked)
    assert (found.redundancy_class, found.reason) == (expected, reason)
    assert (found.tracked, found.driven) == (names, tuple(name for name in vertical if name not in names))
    evidence = found.evidence
    np.testing.assert_allclose(evidence.A3, np.abs(A3).max())
    values = np.linalg.svd(A4[moved], compute_uv=False) if moved.any() else np.zeros(2)
    np.testing.assert_allclose(evidence.A4_singular_values, (values.min(), values.max()), atol=1e-12)
    np.testing.assert_allclose((evidence.A6, evidence.A5_along_x22), 0.0, atol=1e-12)
    spread = next(block.smallest_singular_value for block in evidence.blocks if block.name == "A4")
    if moved.any():
        np.testing.assert_allclose((spread.min, spread.max), values.min(), atol=1e-12)
    assert evidence.steering == (None if moved.any() else 0.0)
    shapes = {block.name: block.shape for block in evidence.blocks if block.name.startswith("A")}
    above, below = moved.sum(), k - moved.sum()
    assert shapes == {"A3": (above, r - len(free)), "A4": (above, len(free))} | {
        "A5": (below, r - len(free)),
        "A6": (below, len(free)),
    }


def test_figures_are_those_of_the_columns_and_rows_of_the_task():
    """The redundant output stands first, primary ones and vertical ones in another order than in the model."""

    def A(q):
        return [[1.5 + np.sin(q[1]), 7.0, 0.0], [0.0, 0.3 * q[2], -4.0]]

    def A_dot(q, v):
        return [[np.cos(q[1]) * v[1], 0.0, 0.0], [0.0, 0.3 * v[2], 0.0]]

    reduced = sliders_with_rows(A, A_dot)
    task = rnc.Task.of(reduced, ["s2", "s1"], ["s0"], ["s4", "s3"])
    configurations = np.random.default_rng(1).normal(size=(5, 5))
    found = classify(reduced, task, configurations)
    assert (found.redundancy_class, found.tracked, found.driven) == ("2", ("s3",), ("s4",))
    A4, A5 = 1.5 + np.sin(configurations[:, 1]), np.hypot(4.0, 0.3 * configurations[:, 2])
    np.testing.assert_allclose(found.evidence.A4_singular_values, (A4.min(), A4.max()))
    spreads = {block.name: block.smallest_singular_value for block in found.evidence.blocks if block.rows}
    for name, sizes in (("A3", np.full(5, 7.0)), ("A4", A4), ("A5", A5), ("A6", np.zeros(5))):
        expected = sizes.min(), np.median(sizes), sizes.max()
        np.testing.assert_allclose((spreads[name].min, spreads[name].median, spreads[name].max), expected, atol=1e-12)
    assert [block.largest_entry for block in found.evidence.blocks] == pytest.approx([7.0, A4.max(), 4.0, 0.0])
    assert found.evidence.blocks[2].columns == ("s2", "s1")
    np.testing.assert_allclose(found.evidence.A3, 7.0)


def test_what_only_the_value_of_an_output_steers():
    """``x11dot = sin(x22) s0dot``: its derivative is the cosine, times a speed of about one."""
    reduced = sliders_with_rows(
        lambda q: [[np.sin(q[1]), 0.0], [3.0, 0.0]], lambda q, v: [[np.cos(q[1]) * v[1], 0], [0, 0]]
    )
    task = rnc.Task.of(reduced, ["s0"], ["s1"])
    configurations = np.random.default_rng(1).uniform(-1, 1, size=(5, 4))
    found = classify(reduced, task, configurations)
    assert (found.redundancy_class, found.tracked, found.driven) == ("2s", ("s2",), ("s3",))
    rates = np.cos(configurations[:, 1])
    *_, block = found.evidence.blocks
    assert (block.name, block.shape, block.largest_entry) == ("d(A3 v21)/dx22", (1, 1), found.evidence.steering)
    spread = block.smallest_singular_value
    assert spread.min / spread.max == pytest.approx(rates.min() / rates.max())
    assert 0.5 < spread.max / rates.max() < 1.5
    assert found.evidence.A4_singular_values == (0.0, 0.0)
    np.testing.assert_allclose(found.evidence.A3, 3.0)


def test_how_a5_depends_on_x22_is_its_partial_derivative():
    along = np.array([0.3, -0.4, 0.7, 1.1])
    reduced = prismatic(lambda q: 1 + 0.5 * np.sin(along @ q), lambda q: 0.5 * np.cos(along @ q) * along)
    configurations = np.random.default_rng(1).uniform(-1, 1, size=(5, 4))
    found = classify(reduced, rnc.Task.of(reduced, ["x21"], ["x22"]), configurations)
    assert found.reason == "1 vertical output moved by 1 redundant one, but A5 depends on x22"
    assert found.evidence.A5_along_x22 == pytest.approx(0.5 * 1.1 * np.abs(np.cos(configurations @ along)).max())


# ---------------------------------------------------------------------- the report


@pytest.mark.parametrize(
    ("B", "rank", "missing"),
    [
        ([[1, 0, 0], [0, 1, 0], [0, 0, 1]], 3, ()),
        ([[1, 0], [0, 1], [0, 0]], 2, ("s2",)),
        ([[0, 0], [2, 0], [0, 3]], 2, ("s0",)),
        ([[1, 1], [1, 1], [0, 0]], 1, ("s0", "s1", "s2")),
        ([[1, 0], [1, 0], [0, 5]], 2, ("s0", "s1")),
        ([[0.0], [0.0], [0.0]], 0, ("s0", "s1", "s2")),
    ],
)
@pytest.mark.parametrize("unit", [1e-7, 1.0, 1e7])
def test_forces_that_are_missing(B, rank, missing, unit):
    """Where q1 is positive one more is, so that this is no worst sample."""
    B, more = unit * np.array(B, float), np.array([[3.0, 1.0, 0.0], [0.0, 2.0, 1.0], [1.0, 0.0, 1.0]])

    def drives(q):
        return np.hstack([B, unit * more * (q[1] > 0)])

    reduced = rnc.NonholonomicSystem(rail_sliders(3), [], drives).reduce([rnc.JointPosition(f"s{k}") for k in range(3)])
    report = rnc.analyze(reduced, samples=12)
    assert (report.actuation_rank, report.unactuated) == (rank, missing)


def test_a_report_is_of_the_samples_it_says():
    """Those that its seed draws; Lemma 1 and the class are judged on the better half."""
    wall = -0.5

    def coordinate(q):
        if q[0] < wall:
            raise rnc.SingularityError("behind the wall", q=q, condition=np.inf, rows=("ahead",))
        return q[:1]

    def rows(q):
        coordinate(q)
        return np.array([[q[2], -q[3], 0.0]])

    ahead = rnc.Output(coordinate, rows, lambda q, v: np.array([[-q[3] * v[2], -q[2] * v[2], 0.0]]), ["ahead"])
    model, _ = planar_model()
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("body")], np.eye(3)[:, :1])
    reduced = system.reduce([ahead, rnc.FrameYaw("body")], [rnc.FramePosition("body", "y")])
    seed, samples, generator = 5, 21, np.random.default_rng(5)
    drawn = np.stack([reduced.random_configuration(generator) for _ in range(samples)])
    regular = drawn[drawn[:, 0] >= wall]
    conditions = np.array([reduced.condition(q) for q in regular])
    good = regular[conditions <= np.median(conditions)]
    report = rnc.analyze(reduced, redundant=["body_yaw"], samples=samples, seed=seed)
    assert 0 < samples - len(regular) < samples
    assert (report.samples, report.singular_samples) == (samples, samples - len(regular))
    assert report.condition == pytest.approx(
        {"min": conditions.min(), "median": np.median(conditions), "max": conditions.max()}
    )
    assert report.lemma1 == pytest.approx(lemma_1_residuals(reduced, good, seed))
    assert report.lemma1_holds
    task = rnc.Task.of(reduced, ["ahead"], ["body_yaw"])
    assert report.redundancy == classify(reduced, task, good, seed)
    assert (report.n, report.r, report.p, report.rank) == (3, 2, 1, 1)
    assert (report.actuation_rank, report.unactuated) == (1, ("body_yaw",))
    assert report.completely_nonholonomic
    assert report.lemma1_bounds.H.max == pytest.approx(boundedness(reduced, regular).H.max)
