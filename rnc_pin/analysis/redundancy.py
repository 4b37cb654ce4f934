"""Which kind of redundancy a task has: paper (11) and its subclasses, decided on sampled configurations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import Task

_ZERO = 1e-9


@dataclass(frozen=True)
class Redundancy:
    """The class, the partition of x1 that it needs, and the figures that decided.

    Attributes:
        redundancy_class: "1", "2", "2s" or None.
        tracked: vertical outputs x11 that the redundant outputs can steer.
        driven: vertical outputs x12 that only the primary outputs move.
        evidence: figures and the reason in words; ``blocks`` describes A3 to A6 as this partition has them.
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
    names = task.vertical_names
    if not len(task.redundant) or not names:
        reason = "no redundant output" if names else "no vertical output"
        return Redundancy(None, (), names, {"reason": reason})
    A = reduced.at(configurations).A_star[:, task.vertical]
    # Derivatives of A_star along the motion of each redundant output alone, (count, k, r, r2).
    A_along = reduced.kinematic_gradient(configurations, task.redundant)[:, task.vertical]
    zero = _ZERO * max(1.0, float(np.abs(A).max()))
    A3, A4 = A[..., task.primary], A[..., task.redundant]
    A3_along = A_along[:, :, task.primary]  # (count, k, r1, r2)
    v21 = np.random.default_rng(seed).uniform(0.5, 1.5, len(task.primary))
    steering = np.einsum("nkij,i->nkj", A3_along, v21)

    moved = np.abs(A4).max(axis=(0, 2)) > zero
    steered = np.abs(steering).max(axis=(0, 2)) > zero
    tracked = moved if moved.any() else steered
    A5_depends = _largest(A3_along[:, ~tracked]) > zero
    redundancy_class, reason = _decide(A4[:, moved], steering[:, steered], moved, A5_depends)
    if redundancy_class != "2s":
        tracked = moved

    above, below = (tuple(np.array(names)[flags].tolist()) for flags in (tracked, ~tracked))
    blocks = [
        _described("A3", A3[:, tracked], above, task.primary_names),
        _described("A4", A4[:, tracked], above, task.redundant_names),
        _described("A5", A3[:, ~tracked], below, task.primary_names),
        _described("A6", A4[:, ~tracked], below, task.redundant_names),
    ]
    evidence: dict[str, Any] = {
        "A3": _largest(A3),
        "A4_singular_values": _smallest_largest(A4[:, moved]) if moved.any() else [0.0, 0.0],
        "A6": _largest(A4[:, ~moved]),
        "A5_along_x22": _largest(A3_along[:, ~tracked]),
    }
    if not moved.any():
        evidence["d(A3 v21)/dx22"] = _largest(steering)
        blocks.append(_described("d(A3 v21)/dx22", steering[:, tracked], above, task.redundant_names))
    return Redundancy(redundancy_class, above, below, {**evidence, "blocks": blocks, "reason": reason})


def _decide(A4: np.ndarray, steering: np.ndarray, moved: np.ndarray, A5_depends: bool) -> tuple[str | None, str]:
    """The class and the reason, from the rows of A4 and of ``d(A3 v21)/dx22`` that are not zero."""
    _, rows, columns = A4.shape
    moves = f"{rows} vertical output{'s'[: rows != 1]} moved by {columns} redundant one{'s'[: columns != 1]}"
    if not rows:
        if steering.shape[1] == columns and _full_row_rank(steering):
            return "2s", "A4 = 0: the rates of x22 move no vertical output, but its value steers A3 v21"
        return None, "A4 = 0, and the values of x22 do not steer A3 v21 either"
    if rows > columns:
        return None, f"{moves}: too few to steer them all"
    if not _full_row_rank(A4):
        return None, f"{moves}, but A4 has not full row rank"
    if moved.all():
        wide = " (more redundant than vertical outputs: some freedom is left)" if columns > rows else ""
        return "1", f"A4 has full row rank{wide}"
    if rows < columns:
        return None, f"{moves}: class 2 needs as many of both"
    if A5_depends:
        return None, f"{moves}, but A5 depends on x22"
    return "2", "A6 = 0, A4 nonsingular and A5 independent of x22"


def _described(name: str, block: np.ndarray, rows: tuple[str, ...], columns: tuple[str, ...]) -> dict[str, Any]:
    """A block (count, k, l) in figures: its largest entry, and the spread of its singular values over the samples."""
    content: dict[str, Any] = {"name": name, "rows": list(rows), "columns": list(columns), "shape": [*block.shape[1:]]}
    if not block.size:
        return content
    smallest = np.linalg.svd(block, compute_uv=False)[:, -1]
    spread = {"min": float(smallest.min()), "median": float(np.median(smallest)), "max": float(smallest.max())}
    return {**content, "largest_entry": _largest(block), "smallest_singular_value": spread}


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
