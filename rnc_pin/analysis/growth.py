"""Complete nonholonomy: span(R) under Lie brackets, its growth vector and its involutive closure.

Dimensions are lower semicontinuous: at a singular configuration some are smaller, and none is ever larger than the
generic one. So the generic growth vector is the largest dimension of each level over configurations, provided that no
error counts as a direction. A singular value counts if it exceeds every value taken for zero by a stated margin.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.analysis.lie_brackets import FLOW_TIMES, BracketJets, Jets
from rnc_pin.errors import ConstraintError, InfeasibleError, InputError, SingularityError
from rnc_pin.model.input_validation import is_count
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import printed

MARGIN = 1e3  # smallest ratio of a direction's singular value to the error and to the rejected singular values
_SMALLEST = 1e-8  # relative singular value below which no direction counts
DEEPEST = 12
"""Default limit of the number of levels after the first brackets."""
_FEWEST = 8  # samples that are taken at least, if there are so many


@dataclass(frozen=True)
class Growth:
    """Filtration of a distribution at a configuration."""

    vector: tuple[int, ...]
    """Dimensions of span(R), with first brackets, with second brackets, ... until they stop growing."""
    closure: np.ndarray
    """Orthonormal basis (nv, dimension) of the last level: the reachable directions."""
    margin: float
    """Smallest singular value that counts as a direction, over the largest that might be an error."""
    doubtful: bool
    """True if a direction is neither clearly present nor clearly absent, as next to singular configurations."""
    cut: bool = False
    """True if the search ended at the deepest brackets, with directions missing that other configurations have."""


@printed()
@dataclass(frozen=True)
class GrowthEvidence:
    """Growth vectors of sampled configurations, and their margins over errors.

    Attributes:
        samples: configurations at which the growth vector was computed.
        agreeing: number of samples with the generic growth vector.
        doubtful: number of samples at which a direction is neither clearly present nor clearly absent.
        others: other growth vectors, each with its number of samples.
        margin: at the agreeing samples, the smallest singular value that counts as a direction over the largest that
            might be an error; at least 1000.
        decided: True if at least one agreeing sample is not doubtful; else the true dimensions may be larger.
    """

    samples: int
    agreeing: int
    doubtful: int
    others: tuple[tuple[tuple[int, ...], int], ...]
    margin: float
    decided: bool

    def __str__(self) -> str:
        text = f"{self.agreeing} of {self.samples} samples agree"
        if self.others:
            text += ", others: " + ", ".join(f"({', '.join(map(str, vector))}) at {k}" for vector, k in self.others)
        if self.doubtful:
            text += f"; at {self.doubtful} a direction is in doubt"
        return text


def regular_samples(
    reduced: ReducedModel, samples: int, seed: int = 0, region: Mapping[str, tuple[float, float]] | None = None
) -> np.ndarray:
    """Return regular seeded random configurations (count, nq), at most ``samples``.

    Args:
        reduced: the model.
        samples: number of configurations that are drawn.
        seed: of the random configurations.
        region: ranges (smallest, largest) of joints, by name [rad or m]; by default the limits, within half a turn.

    Raises:
        ConstraintError: no configuration can be assembled.
        InputError: ``samples`` is not a positive integer, or a range of ``region`` is wrong.
        SingularityError: every configuration is singular.
    """
    if not is_count(samples, 1):
        raise InputError(f"samples: expected an integer of at least 1, found {samples!r}")
    generator, found, ranges = np.random.default_rng(seed), [], region or {}
    failures = list[ConstraintError | SingularityError]()
    joints = [reduced.robot.single_joint(name, "a region needs one") for name in ranges]
    for name, ends in ranges.items():
        if not (len(ends) == 2 and np.isfinite(ends).all() and ends[0] <= ends[1]):
            raise InputError(f"region: joint '{name}': expected (smallest, largest), found {ends!r}")
    for _ in range(samples):
        q = reduced.random_configuration(generator)
        try:
            for joint, ends in zip(joints, ranges.values(), strict=True):
                joint.put(q, np.array(generator.uniform(*ends)))
            q = reduced.assembled(q, list(ranges)) if joints else q
            _ = reduced.at(q).R
            found.append(q)
        # Samples that do not close or are singular are left out; only if all are does the caller learn why.
        except (ConstraintError, SingularityError) as error:
            failures.append(error)
    if not found:
        raise failures[-1]
    return np.stack(found)


def growth_vector(reduced: ReducedModel, q: np.ndarray, *, deepest: int = DEEPEST) -> tuple[int, ...]:
    """Dimensions of span(R), with first brackets, with second brackets, ... at a configuration, singular ones included.

    At singular configurations a level may add nothing, and a deeper one something: (2, 3, 4, 4, 5). The search ends at
    the dimension that configurations nearby reach. If the dimension is n, the length of the vector is the degree of
    nonholonomy (Jean, ESAIM: Control, Optimisation and Calculus of Variations 1, 1996).

    Args:
        reduced: the model.
        q: a configuration (nq,).
        deepest: largest number of levels after the first brackets.

    Raises:
        SingularityError: q is singular.
        InfeasibleError: the search ended at ``deepest``, or the precision is not sufficient.
        InputError: ``deepest`` is not a positive integer.
    """
    return filtration(reduced, q, deepest).vector


def filtration(reduced: ReducedModel, q: np.ndarray, deepest: int = DEEPEST) -> Growth:
    """Return the filtration at a configuration, singular ones included, with the errors of ``growth_vector``.

    Args:
        reduced: the model.
        q: a configuration (nq,).
        deepest: largest number of levels after the first brackets.
    """
    if not is_count(deepest, 1):
        raise InputError(f"deepest: expected a positive integer, found {deepest!r}")
    found = grow(reduced, q, _generic_dimension(reduced, q), int(deepest))
    if found.cut:
        raise InfeasibleError(
            f"growth vector: brackets up to depth {deepest + 1} give the dimensions {found.vector}, and generic "
            "configurations reach more: the others are deeper (raise 'deepest'), or too small for the precision"
        )
    return found


def _generic_dimension(reduced: ReducedModel, q: np.ndarray) -> int:
    """Largest dimension that all brackets reach at configurations near q and at random ones."""
    generator, R = np.random.default_rng(0), reduced.at(q).R
    nearby, away = 3, 0.3  # configurations near q, and their distance from it [rad or m]
    # Admissible steps: they stay on the leaf of the distribution through q.
    steps = [R @ generator.normal(size=reduced.r) for _ in range(nearby)]
    near = (pin.integrate(reduced.robot.model, q, away * step / np.linalg.norm(step)) for step in steps)
    chosen = [*map(reduced.assembled, near)]
    spread = 0.8  # of random configurations [rad or m]
    chosen += [reduced.random_configuration(generator, spread) for _ in range(_FEWEST)]
    reached = 0
    for each in chosen:
        with suppress(SingularityError):
            reached = max(reached, grow(reduced, each).vector[-1])
        if reached == reduced.n:
            break
    return reached


def generic_growth(
    reduced: ReducedModel, configurations: Sequence[np.ndarray] | np.ndarray
) -> tuple[GrowthEvidence, list[tuple[Growth, np.ndarray]]]:
    """Return evidence for the generic growth vector, and the samples that have it, with their configurations.

    Takes configurations (count, nq) in turn until three agree on the largest dimensions: at least 8 if available, at
    most 32.

    Args:
        reduced: the model.
        configurations: regular configurations, in the order in which they are taken.
    """
    found: list[tuple[Growth, np.ndarray]] = []
    generic: tuple[int, ...] = ()
    most, enough = 32, 3  # samples that are taken at most, and that have to agree to stop
    for q in configurations[:most]:
        found.append((grow(reduced, q), q))
        generic = _largest([growth.vector for growth, _ in found])
        if len(found) >= _FEWEST and sum(growth.vector == generic for growth, _ in found) >= enough:
            break
    agreeing = [each for each in found if each[0].vector == generic]
    # The largest dimensions may come from several samples, even if no sample has all of them.
    shown = agreeing or [each for each in found if each[0].vector[-1] == generic[-1]]
    others = Counter(growth.vector for growth, _ in found if growth.vector != generic)
    doubtful, margin = sum(growth.doubtful for growth, _ in found), min(growth.margin for growth, _ in shown)
    decided = any(not growth.doubtful for growth, _ in agreeing)
    counts = len(found), len(agreeing), doubtful
    evidence = GrowthEvidence(*counts, tuple(others.most_common()), margin, decided)
    whole = [(Growth(generic, growth.closure, growth.margin, growth.doubtful), q) for growth, q in shown]
    return evidence, whole


def _largest(vectors: Sequence[tuple[int, ...]]) -> tuple[int, ...]:
    """Largest dimension of each level, up to the level after which it stops growing."""
    depth = max(map(len, vectors))
    whole = [max(vector[min(level, len(vector) - 1)] for vector in vectors) for level in range(depth)]
    return tuple(whole[: whole.index(whole[-1]) + 1])


def grow(reduced: ReducedModel, q: np.ndarray, reach: int = 0, limit: int = DEEPEST) -> Growth:
    """Return the filtration of span(R) at q, and its involutive closure.

    Vector fields are written in the tangent space at q. There the moving frames of planar, spherical and free-flying
    joints have a bracket of their own. Brackets of the columns of R are exact; deeper brackets are jets along flows
    (``lie_brackets``).

    For affine constraints, ``v = R v2 + b``, brackets with the given motion b are left out. So the result is a lower
    bound: span(R) reaches these directions, and b may reach more.

    Args:
        reduced: the model.
        q: a configuration (nq,).
        reach: dimension up to which levels that add nothing do not end the search; by default the first one does.
        limit: largest number of levels after the first brackets.

    Raises:
        ConstraintError: a joint type has no known bracket.
        SingularityError: q is singular.
    """
    jets = BracketJets(reduced, q)
    basis, margin, rejected = _with_first_brackets(scipy.linalg.orth(jets.generators), jets.pairs())
    first = (reduced.r, basis.shape[1])
    deepest = limit if reach > first[1] else min(reduced.n - first[1], limit)
    if first[1] >= reach and (first[0] == first[1] or not deepest):
        doubtful = first[1] < reduced.n and rejected > _SMALLEST
        return Growth(first[: 1 + (first[1] > first[0])], basis, margin, doubtful)
    found = None
    shallow = 3  # order that is sufficient for most systems: deeper fits lose digits
    # From shallow to deep: most systems end early, and deep fits lose digits.
    for order in sorted({min(shallow, deepest), min(2 * shallow, deepest) if reach else deepest, deepest}):
        found = _deeper(jets, basis, order, rejected, reach)
        if len(found.vector) < order or found.vector[-1] in (reduced.n, reach):
            break
    assert found is not None
    vector = (*first, *found.vector)
    longest = len(found.vector) == limit
    last = vector.index(vector[-1]) + 1  # the levels after it add nothing
    doubtful, cut = found.doubtful or (longest and vector[-1] < reduced.n), longest and vector[-1] < reach
    return Growth(vector[: max(last, 1)], found.closure, min(margin, found.margin), doubtful, cut)


def _deeper(jets: BracketJets, basis: np.ndarray, order: int, rejected: float, reach: int) -> Growth:
    """Levels after the first brackets, from the first accurate flow time, or else from the most accurate one."""
    tried = list[tuple[float, Growth]]()
    failures = list[SingularityError]()
    fades = 0.2  # smallest ratio of the sizes of two successive levels, over the flow time
    accurate = 1e-8  # relative error of a level below which no shorter time is tried
    for time in FLOW_TIMES:
        generator = np.random.default_rng(0)
        try:
            drawn, crowded = list[Jets](), True
            # As many directions as functions: more functions show whether there are more directions.
            while crowded and len(drawn) < basis.shape[0]:
                drawn.append(jets.draw(order, time, generator))
                found, error, crowded = _levels(drawn, basis, rejected, fades * time, reach)
        except SingularityError as singular:  # the flow reaches a singular configuration
            failures.append(singular)
            continue
        tried.append((error, found))
        if error < accurate:
            break
    if not tried:
        raise failures[-1]
    return min(tried, key=lambda each: each[0])[1]


def _levels(
    drawn: Sequence[Jets], start: np.ndarray, rejected: float, fading: float, reach: int
) -> tuple[Growth, float, bool]:
    """Levels from jets: their dimensions, with a margin over errors and over the values ``rejected`` so far.

    Also return the error of their coefficients, and True if a level has as many directions as there are functions.

    Singular values are relative to the size of a level, or to ``fading`` times the size of the level before. If hardly
    anything depends on q, a level consists of rounding errors only.
    """
    fine, coarse = (np.concatenate(each, axis=-1) for each in zip(*drawn, strict=True))
    bases = [start, start]
    dimensions: list[int] = []
    margin, doubtful, error, crowded = np.inf, False, 0.0, False
    size = float(np.linalg.norm(fine[0], 2))
    clear = 10.0  # ratio to the same values below which a singular value is clearly zero
    nothing = 1e-11  # relative singular value that counts as zero
    for level in range(1, len(fine)):
        size = max(float(np.linalg.norm(fine[level], 2)), fading * size, 1e-300)
        rests = [_rest(basis, each[level] / size) for basis, each in zip(bases, (fine, coarse), strict=True)]
        left, values, _ = np.linalg.svd(rests[0], full_matrices=False)
        other_left = np.linalg.svd(rests[1], full_matrices=False)[0]
        # Two fits of different degree: their difference bounds the error of the coefficients.
        wrong = float(np.linalg.norm(rests[0] - rests[1], 2))
        error = max(error, wrong)
        # No more directions than the space leaves: further singular values are rounding.
        room = start.shape[0] - bases[0].shape[1]
        values = values[:room]
        # A value that an earlier level rejected is an error of this size, or a direction in doubt: it bounds both.
        floor = max(wrong, rejected, np.finfo(float).eps)
        # Directions exceed the rounding of a file's numbers; the limit falls by ten a level, as deeper brackets may.
        rounded = 1e-5 * 0.1 ** (level - 1)
        count = int((values > max(MARGIN * floor, _SMALLEST, rounded)).sum())
        none = values[count:].max(initial=0.0)
        doubtful = doubtful or bool(none > max(clear * floor, nothing))
        rejected = max(rejected, none)
        if not count:
            if bases[0].shape[1] >= reach:
                break
            dimensions.append(bases[0].shape[1])
            continue
        # Ratio of the smallest accepted value to the largest rejected one: the decision is clear if it is large.
        margin = min(margin, float(values[count - 1] / max(floor, none)))
        crowded = crowded or count == fine.shape[-1] < room
        bases = [np.column_stack([basis, u[:, :count]]) for basis, u in zip(bases, (left, other_left), strict=True)]
        dimensions.append(bases[0].shape[1])
        if count == room:
            break
    return Growth(tuple(dimensions), bases[0], margin, doubtful), error, crowded


def _with_first_brackets(basis: np.ndarray, vectors: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Basis with the brackets (nv, pairs) of two generators, margin of the smallest, and largest rejected value."""
    lengths = np.linalg.norm(vectors, axis=0)
    shortest = 1e-5  # bracket of unit generators; shorter ones are rounding errors of a file
    # A weak coupling makes one pair's bracket small beside another's: each bracket is judged on its own.
    long = lengths > shortest
    rejected = float(lengths[~long].max(initial=0.0))
    if not long.any():
        return basis, np.inf, rejected
    # Pivoted QR takes the clearest bracket first, so its diagonal falls and shows a gap.
    units = _rest(basis, vectors[:, long] / lengths[long])
    Q, triangle, _ = scipy.linalg.qr(units, mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    count = int((diagonal > shortest).sum())
    rejected = max(rejected, float(diagonal[count:].max(initial=0.0)))
    if not count:
        return basis, np.inf, rejected
    return np.column_stack([basis, Q[:, :count]]), float(diagonal[count - 1] / max(rejected, 1e-15)), rejected


def _rest(basis: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Components of vectors (n, k) orthogonal to an orthonormal basis."""
    for _ in range(2):  # the second pass removes rounding errors
        vectors = vectors - basis @ (basis.T @ vectors)
    return vectors
