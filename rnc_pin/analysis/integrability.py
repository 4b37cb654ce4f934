"""Integrability of constraint rows: integrable (holonomic in disguise) or nonholonomic.

By Frobenius' theorem, motion stays on leaves whose tangent space is the involutive closure of span(R). A row that
vanishes on the closure, not only on span(R), is the differential of a function up to a factor, given the other rows.
The m rows have ``n - dim(closure)`` such combinations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from rnc_pin.analysis.growth import Growth, GrowthEvidence, generic_growth
from rnc_pin.math.linear_algebra import unit_rows
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import printed

_TOLERANCE = 1e-5  # for unit rows; the closure is as accurate as the brackets
_TAKES_PART = 1e-3  # share of the largest entries below which those of a row are too small for a pivot
_CLEAR = 1e6  # margin above which a closure is accurate enough to judge rows


@dataclass(frozen=True)
class Combination:
    """A combination of constraint rows that is integrable.

    Attributes:
        coefficients: by row name, the largest is 1 or -1, the first is positive; at one configuration if they vary.
        constant: True if the coefficients are the same at every sampled configuration.
    """

    coefficients: dict[str, float]
    constant: bool

    def __str__(self) -> str:
        if not self.constant:
            return f"a combination of {', '.join(self.coefficients)} whose coefficients vary"
        text = ""
        for name, value in self.coefficients.items():
            size = "" if abs(abs(value) - 1) < _TOLERANCE else f"{abs(value):.4g} "
            text += f"{(' - ' if value < 0 else ' + ') if text else ''}{size}{name}"
        return text


@printed()
@dataclass(frozen=True)
class Integrability:
    """Integrable and nonholonomic constraint rows, with the growth vector.

    Attributes:
        growth_vector: dimensions of span(R) and its brackets, level by level.
        integrable: rows that vanish on the involutive closure.
        nonholonomic: the others.
        combinations: all ``n - growth_vector[-1]`` independent integrable combinations, single rows among them.
        evidence: number of configurations with this growth vector, and its margin.
    """

    growth_vector: tuple[int, ...]
    integrable: tuple[str, ...]
    nonholonomic: tuple[str, ...]
    combinations: tuple[Combination, ...]
    evidence: GrowthEvidence


def integrability(reduced: ReducedModel, configurations: Sequence[np.ndarray] | np.ndarray) -> Integrability:
    """Sort the kept constraint rows into integrable and nonholonomic, at configurations of generic growth vector.

    Args:
        reduced: the model.
        configurations: regular configurations (count, nq); ``generic_growth`` uses as many as it needs.
    """
    evidence, growths = generic_growth(reduced, configurations)
    generic = growths[0][0].vector
    clearest = max(growth.margin for growth, _ in growths)
    growths = [(growth, q) for growth, q in growths if growth.margin >= min(_CLEAR, clearest)]
    names = reduced.constraints.names
    rows = [reduced.at(q).A for _, q in growths]
    leftover = np.array(
        [np.linalg.norm(unit_rows(A) @ growth.closure, axis=1) for A, (growth, _) in zip(rows, growths, strict=True)]
    ).max(axis=0)
    flat = leftover < _TOLERANCE
    return Integrability(
        growth_vector=generic,
        integrable=tuple(name for name, each in zip(names, flat, strict=True) if each),
        nonholonomic=tuple(name for name, each in zip(names, flat, strict=True) if not each),
        combinations=_combinations(
            rows, [growth for growth, _ in growths], np.argsort(leftover), names, reduced.n - generic[-1]
        ),
        evidence=evidence,
    )


def _combinations(
    rows: Sequence[np.ndarray], growths: Sequence[Growth], order: np.ndarray, names: Sequence[str], count: int
) -> tuple[Combination, ...]:
    """Sparse basis of the ``count`` combinations c with ``c^T A`` zero on the closure; single rows come first."""
    if not count:
        return ()
    spaces = [
        np.linalg.svd(unit_rows(A) @ growth.closure)[0][:, -count:] for A, growth in zip(rows, growths, strict=True)
    ]
    pivots = _pivots(spaces[0], order, count)
    spaces = [space / np.linalg.norm(A, axis=1)[:, None] for A, space in zip(rows, spaces, strict=True)]
    reduced = np.stack([space @ np.linalg.pinv(space[pivots]) for space in spaces])  # (samples, m, count)
    reduced[np.abs(reduced) < _TOLERANCE * np.abs(reduced).max(axis=1, keepdims=True)] = 0.0
    result = []
    for k in range(count):
        taking_part = np.flatnonzero(reduced[:, :, k].any(axis=0))
        parts = reduced[:, taking_part, k]
        here = parts[np.argmax(np.abs(parts[:, 0]))]
        constant = bool(np.abs(parts - parts[:, :1] * (here / here[0])).max() < _TOLERANCE * np.abs(parts).max())
        scaled = here / (np.sign(here[0]) * np.abs(here).max())
        coefficients = {names[int(row)]: float(value) for row, value in zip(taking_part, scaled, strict=True)}
        result.append(Combination(coefficients, constant))
    return tuple(result)


def _pivots(space: np.ndarray, order: np.ndarray, count: int) -> list[int]:
    """Pivot rows of a basis (m, count), in order of preference; their entries form a regular matrix.

    Rows that hardly take part in any combination are no pivots: their entries are rounding, and directions of rounding.
    """
    sizes = np.linalg.norm(space, axis=1)
    chosen: list[int] = []
    for row in order[sizes[order] > _TAKES_PART * sizes.max()]:
        if len(chosen) < count and scipy.linalg.svdvals(unit_rows(space[[*chosen, row]]))[-1] > 1e-3:
            chosen.append(int(row))
    return chosen
