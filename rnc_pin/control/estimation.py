"""Common parts of estimators of uncertain kinematics: a linear regression, and a model with estimated parameters.

Paper (14)-(21), for any constraint that is affine in its unknown parameters p: ``A_known(q) v + Y(q, v) p = 0``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import pinocchio as pin
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.control.dead_zone import apply_dead_zone
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.reduction_data import ReductionData, row_scales
from rnc_pin.model.row_stack import RowStack
from rnc_pin.robots.robot import Robot

_SAMPLES = 12


class Regressor(Protocol):
    """Constraints that are affine in unknown parameters p, without their true values.

    Attributes:
        names: of the parameters (s,).
        predicted: names of the entries of the prediction error (e,).
        units: of the parameters (s,).
        predicted_units: units of the entries of the prediction error (e,).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    predicted: tuple[str, ...]
    predicted_units: tuple[str, ...]

    def regress(self, q: Array, v: Array) -> tuple[Float[Array, " e"], Float[Array, "e s"]]:
        """Return y and Y at a measured q (nq,) and v (nv,): ``y = Y p`` at the true parameters p."""

    def estimated(self, reduced: ReducedModel) -> EstimatedModel:
        """Return a model with the outputs of ``reduced``, and estimates in place of the unknown parameters."""


class EstimatedModel:
    """Model with the same outputs and actuators, under constraints with estimated parameters.

    Bound rows refer to joints and frames by index only. So rows without unknown parameters are shared.

    Args:
        reduced: the model with the true constraints.
        model: a copy of its Pinocchio model; parameters change it.
        rows: all its constraint rows, with copies of those that parameters change.
        believe: function that writes parameters (s,) into the copies.
    """

    def __init__(
        self, reduced: ReducedModel, model: pin.Model, rows: RowStack, believe: Callable[[Array], None]
    ) -> None:
        self._believe = believe
        known, robot = reduced.reduction_data, Robot(model)
        generator = np.random.default_rng(0)
        samples = np.stack([robot.random_configuration(generator) for _ in range(_SAMPLES)])
        parts = ReductionData(
            robot,
            rows,
            known.kept,
            known.actuation,
            known.reducing,
            known.vertical,
            known.singularity_limit,
            row_scales(robot, rows, known.reducing, samples),  # the scales of the true rows are unknown
        )
        self._reduced = ReducedModel(parts, reduced.assembly)

    def at(self, p: Float[Array, " s"]) -> ReducedModel:
        """Return the model for these parameters; always the same object, which the next call changes."""
        self._believe(p)
        return self._reduced


def adapt(
    p: np.ndarray,
    W: np.ndarray,
    error: np.ndarray,
    gain: float,
    elapsed: float,
    low: np.ndarray,
    high: np.ndarray,
    dead_zone: float | np.ndarray = 0.0,
) -> np.ndarray:
    """Return the parameters after one sample of ``pdot = alpha W^T E`` (20), kept within bounds.

    The step is bounded as in the trackers: it never corrects more than the measured error, so ``|p - phat|`` does not
    grow (Lemma 4). With noise within the dead zone it does not grow for small steps, because the law ignores such
    errors (``control.dead_zone``). Clipping to a box that contains p does not make it grow either.
    """
    step = gain * elapsed
    correction = W.T @ np.linalg.solve(np.eye(len(error)) + step * W @ W.T, step * apply_dead_zone(error, dead_zone))
    return np.clip(p + correction, low, high)
