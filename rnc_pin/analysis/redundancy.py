"""Which kind of redundancy a task has: paper (11) and its subclasses, decided on sampled configurations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rnc_pin.reduction import ReducedModel
from rnc_pin.task import Task

_ZERO = 1e-9


@dataclass(frozen=True)
class Redundancy:
    """The class, the partition of x1 that it needs, and the figures that decided.

    Attributes:
        redundancy_class: "1", "2", "2s" or None.
        tracked: vertical outputs x11 that the redundant outputs can steer.
        driven: vertical outputs x12 that only the primary outputs move.
        evidence: figures and the reason in words.
    """

    redundancy_class: str | None
    tracked: tuple[str, ...]
    driven: tuple[str, ...]
    evidence: dict[str, Any]


def classify(reduced: ReducedModel, task: Task, configurations: np.ndarray, seed: int = 0) -> Redundancy:
    """Sort a task into the classes of paper section 3.2, at configurations (count, nq).

    Class 1: A4 has full row rank. Class 2: A6 = 0, A4 nonsingular, A5 independent of x22.
    Class 2s: x22 enters through A3 only, ``d(A3 v21)/dx22`` nonsingular.
    """
    names, count = task.vertical_names, len(configurations)
    if not len(task.redundant) or not names:
        reason = "no redundant output" if names else "no vertical output"
        return Redundancy(None, (), names, {"reason": reason})
    A = reduced.terms(configurations, np.zeros((count, reduced.r))).A_star[:, task.vertical]
    # Derivatives of A_star along the motion of each redundant output alone, (count, k, r, r2).
    A_along = np.stack(
        [reduced.terms(configurations, np.tile(np.eye(reduced.r)[j], (count, 1))).A_star_dot for j in task.redundant],
        axis=-1,
    )[:, task.vertical]
    scale = max(1.0, float(np.abs(A).max()))
    A4 = A[..., task.redundant]
    moved = np.abs(A4).max(axis=(0, 2)) > _ZERO * scale
    primary_along = A_along[:, :, task.primary]  # (count, k, r1, r2)
    rows, columns = int(moved.sum()), len(task.redundant)
    evidence: dict[str, Any] = {
        "A3": _largest(A[..., task.primary]),
        "A4_singular_values": _smallest_largest(A4[:, moved]) if rows else [0.0, 0.0],
        "A6": _largest(A4[:, ~moved]),
        "A5_along_x22": _largest(primary_along[:, ~moved]),
    }
    tracked = tuple(name for name, flag in zip(names, moved, strict=True) if flag)
    driven = tuple(name for name, flag in zip(names, moved, strict=True) if not flag)
    if rows and _full_row_rank(A4[:, moved]) and rows <= columns:
        if not driven:
            wide = " (more redundant than vertical outputs: some freedom is left)" if columns > rows else ""
            return Redundancy("1", tracked, driven, {**evidence, "reason": f"A4 has full row rank{wide}"})
        if evidence["A5_along_x22"] <= _ZERO * scale and rows == columns:
            reason = "A6 = 0, A4 nonsingular and A5 independent of x22"
            return Redundancy("2", tracked, driven, {**evidence, "reason": reason})
    if not rows:
        v21 = np.random.default_rng(seed).uniform(0.5, 1.5, len(task.primary))
        steering = np.einsum("nkij,i->nkj", primary_along, v21)
        evidence["d(A3 v21)/dx22"] = _largest(steering)
        steered = np.abs(steering).max(axis=(0, 2)) > _ZERO * scale
        if steered.sum() == columns and _full_row_rank(steering[:, steered]):
            reason = "A4 = 0: the rates of x22 move no vertical output, but its value steers A3 v21"
            tracked = tuple(name for name, flag in zip(names, steered, strict=True) if flag)
            driven = tuple(name for name, flag in zip(names, steered, strict=True) if not flag)
            evidence["A5_along_x22"] = _largest(primary_along[:, ~steered])
            return Redundancy("2s", tracked, driven, {**evidence, "reason": reason})
    reason = f"{rows} vertical outputs are moved by {columns} redundant ones, and no partition fits class 1, 2 or 2s"
    return Redundancy(None, tracked, driven, {**evidence, "reason": reason})


def _largest(array: np.ndarray) -> float:
    return float(np.abs(array).max(initial=0.0))


def _smallest_largest(matrices: np.ndarray) -> list[float]:
    values = np.linalg.svd(matrices, compute_uv=False)
    return [float(values.min()), float(values.max())]


def _full_row_rank(matrices: np.ndarray) -> bool:
    """Whether (count, k, l) has rank k at most configurations: at all but isolated ones, as far as samples tell."""
    values = np.linalg.svd(matrices, compute_uv=False)
    if matrices.shape[-2] > matrices.shape[-1]:
        return False
    good = values[:, -1] > 1e-6 * np.maximum(values[:, 0], 1e-12)
    return bool(good.mean() > 0.9)
