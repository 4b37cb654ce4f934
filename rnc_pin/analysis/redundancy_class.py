"""Redundancy class of a task: paper (11) and its subclasses, decided on sampled configurations."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from rnc_pin.io.json import Json, to_json_mapping
from rnc_pin.model.configuration_evaluation import ConfigurationEvaluation
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation, kinematic_gradient
from rnc_pin.model.task import Task
from rnc_pin.printing import printed


@printed()
@dataclass(frozen=True)
class Evidence:
    """Numbers that decide on a class.

    Attributes:
        A3: largest entry in the rows of all vertical outputs.
        A4_singular_values: smallest and largest of the nonzero rows of A4; zeros if all rows are zero.
        A6: largest entry in the other rows.
        A5_along_x22: largest partial derivative of A5 with respect to a redundant output, all others fixed.
        steering: largest entry of ``d(A3 v21)/dx22``, if A4 is zero.
    """

    A3: float
    A4_singular_values: tuple[float, float]
    A6: float
    A5_along_x22: float
    steering: float | None

    def to_dict(self) -> dict[str, Json]:
        """Return lists, numbers and strings that JSON can store."""
        steering = "d(A3 v21)/dx22"
        known = {
            steering if name == "steering" else name: value for name, value in asdict(self).items() if value is not None
        }
        return to_json_mapping(known, "evidence")


@printed()
@dataclass(frozen=True)
class Redundancy:
    """Redundancy class of a task, its partition of x1, and the reason.

    Attributes:
        redundancy_class: "1", "2", "2s" or None.
        tracked: vertical outputs x11 that the redundant outputs can steer.
        driven: vertical outputs x12 that only the primary outputs move.
        reason: in words.
        evidence: the numbers that decided; None if there is nothing to decide.
    """

    redundancy_class: str | None
    tracked: tuple[str, ...]
    driven: tuple[str, ...]
    reason: str
    evidence: Evidence | None = None

    def to_dict(self) -> dict[str, Json]:
        """Return partition, numbers and reason as lists, numbers and strings that JSON can store."""
        figures = {} if self.evidence is None else self.evidence.to_dict()
        return {"tracked": list(self.tracked), "driven": list(self.driven), **figures, "reason": self.reason}


def classify(reduced: ReducedModel, task: Task, configurations: np.ndarray, seed: int = 0) -> Redundancy:
    """Sort a task into the classes of paper section 3.2, at configurations (count, nq).

    Class 1: A4 has full row rank. Class 2: A6 = 0, A4 nonsingular, A5 independent of x22. The last condition uses the
    partial derivative at fixed x21, x11 and x12. (Under the constraints, x11 moves with x22, and A5 may depend on x11.)
    Class 2s: x22 enters through A3 only, ``d(A3 v21)/dx22`` nonsingular.

    Args:
        reduced: the model.
        task: partition of the outputs.
        configurations: regular configurations; their number decides how sure the class is.
        seed: of the primary velocities.
    """
    names = task.vertical_names
    if not len(task.redundant) or not names:
        reason = "no redundant output" if names else "no vertical output"
        return Redundancy(None, (), names, reason)
    here = reduced.at(configurations)
    A = here.A_star[:, task.vertical]
    # Derivatives of A_star along the motion of each redundant output alone, (count, k, r, r2).
    A_along = kinematic_gradient(here, task.redundant)[:, task.vertical]
    part = 1e-9  # of the largest entry of A, at least 1: what is below is rounding
    zero = part * max(1.0, float(np.abs(A).max()))
    A3, A4 = A[..., task.primary], A[..., task.redundant]
    A3_along = A_along[:, :, task.primary]  # (count, k, r1, r2)
    # Away from zero, where nothing steers, and different for each output, so that effects do not cancel.
    v21 = np.random.default_rng(seed).uniform(0.5, 1.5, len(task.primary))
    steering = np.einsum("nkij,i->nkj", A3_along, v21)

    moved, steered = largest_entries(A4) > zero, largest_entries(steering) > zero
    tracked = moved if moved.any() else steered
    A5_along = _partial(reduced, task, configurations)[:, ~tracked]
    A5_depends = _largest(A5_along) > zero
    redundancy_class, reason = _decide(A4[:, moved], steering[:, steered], moved, A5_depends)
    if redundancy_class != "2s":
        tracked = moved

    above, below = (tuple(np.array(names)[flags].tolist()) for flags in (tracked, ~tracked))
    values = np.linalg.svd(A4[:, moved], compute_uv=False) if moved.any() else np.zeros(1)
    evidence = Evidence(
        A3=_largest(A3),
        A4_singular_values=(float(values.min()), float(values.max())),
        A6=_largest(A4[:, ~moved]),
        A5_along_x22=_largest(A5_along),
        steering=None if moved.any() else _largest(steering),
    )
    return Redundancy(redundancy_class, above, below, reason, evidence)


def _partial(reduced: ReducedModel, task: Task, configurations: np.ndarray) -> np.ndarray:
    """Partial derivatives (count, k, r1, r2) of ``A_star``'s columns of x21 with respect to x22.

    The paper's coordinates are (x1, x2): one redundant output moves while all other outputs of the task are fixed. The
    constraints forbid this motion, but a derivative allows it. Coordinates that are not outputs move as little as
    possible. If dependent outputs make this impossible, the result is the derivative under the constraints.
    """
    here = reduced.at(configurations)
    J1 = here.J1[:, task.vertical]
    J = np.concatenate([J1, here.J2], axis=1)
    ways = motions_alone(J, J1.shape[1] + task.redundant, here.R[..., task.redundant])
    return np.moveaxis(rates_along(here, ways), 1, -1)[:, task.vertical][:, :, task.primary]


def motions_alone(J: np.ndarray, moved: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    """Return the motions (count, nv, j) that move the j rows ``moved`` of J (count, k, nv), each alone.

    Args:
        J: Jacobians.
        moved: indices of the rows (j,).
        otherwise: motions (count, nv, j) in place of motions that dependent rows make impossible.
    """
    alone = np.eye(J.shape[1])[:, moved]
    least = 1e-9  # of the largest singular value of all outputs' Jacobian
    ways = np.linalg.pinv(J, rcond=least) @ alone
    possible_error = 1e-6  # largest motion of outputs that must not move
    possible = np.abs(J @ ways - alone).max(axis=1, keepdims=True) < possible_error
    return np.asarray(np.where(possible, ways, otherwise))


def rates_along(here: ConfigurationEvaluation, ways: np.ndarray) -> np.ndarray:
    """Return the derivatives (count, j, k, r) of ``A_star`` along motions (count, nv, j).

    Args:
        here: evaluation at configurations (count, nq).
        ways: the motions.
    """
    each = (StateEvaluation(here, v=np.ascontiguousarray(way)).A_star_dot for way in np.moveaxis(ways, -1, 0))
    return np.stack(list(each), axis=1)


def _decide(A4: np.ndarray, steering: np.ndarray, moved: np.ndarray, A5_depends: bool) -> tuple[str | None, str]:
    """Class and reason, from the nonzero rows of A4 and of ``d(A3 v21)/dx22``."""
    _, rows, columns = A4.shape
    moves = f"{rows} vertical output{'s'[: rows != 1]} moved by {columns} redundant one{'s'[: columns != 1]}"
    if not rows:
        if steering.shape[1] == columns and has_full_row_rank(steering):
            return "2s", "A4 = 0: the rates of x22 move no vertical output, but its value steers A3 v21"
        return None, "A4 = 0, and the values of x22 do not steer A3 v21 either"
    if rows > columns:
        return None, f"{moves}: too few to steer them all"
    if not has_full_row_rank(A4):
        return None, f"{moves}, but A4 has not full row rank"
    if moved.all():
        wide = " (more redundant than vertical outputs: some freedom is left)" if columns > rows else ""
        return "1", f"A4 has full row rank{wide}"
    if rows < columns:
        return None, f"{moves}: class 2 needs as many of both"
    if A5_depends:
        return None, f"{moves}, but A5 depends on x22"
    return "2", "A6 = 0, A4 nonsingular and A5 independent of x22"


def largest_entries(matrices: np.ndarray) -> np.ndarray:
    """Return the largest entry of each row (k,).

    Args:
        matrices: (count, k, l).
    """
    return np.asarray(np.abs(matrices).max(axis=(0, 2), initial=0.0))


def _largest(array: np.ndarray) -> float:
    return float(np.abs(array).max(initial=0.0))


def has_full_row_rank(matrices: np.ndarray) -> bool:
    """Return True if matrices have rank k at most samples: presumably at all but isolated configurations.

    Args:
        matrices: (count, k, l).
    """
    values = np.linalg.svd(matrices, compute_uv=False)
    if matrices.shape[-2] > matrices.shape[-1]:
        return False
    # A few samples may lie near a singular surface: nine of ten decide.
    good = values[:, -1] > 1e-6 * np.maximum(values[:, 0], 1e-12)
    return bool(good.mean() > 0.9)
