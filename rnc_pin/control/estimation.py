"""What estimators of uncertain kinematics have in common: a linear regression, and a model that believes its result.

Paper (14)-(21), for any constraint that is affine in what is not known about it: ``A_known(q) v + Y(q, v) p = 0``.
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
        predicted: what each entry of the prediction error belongs to (e,).
        units: of the parameters (s,); of the prediction error (e,) in ``predicted_units``.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    predicted: tuple[str, ...]
    predicted_units: tuple[str, ...]

    def regress(self, q: Array, v: Array) -> tuple[Float[Array, " e"], Float[Array, "e s"]]:
        """Y and Y at a measured q (nq,) and v (nv,): ``y = Y p`` at the true p, whatever they are."""

    def estimated(self, reduced: ReducedModel) -> EstimatedModel:
        """A model with the outputs of ``reduced``, and estimates in the place of what is not known."""


class EstimatedModel:
    """The same outputs and actuators under constraints with estimated parameters.

    Bound rows know joints and frames by index alone, so those that no parameter enters are shared.

    Args:
        reduced: whose outputs and constraints they are.
        model: a copy of its model, to be changed.
        rows: all its constraint rows, or copies of them to be changed.
        believe: writes parameters (s,) into the copies.
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
            row_scales(robot, rows, known.reducing, samples),  # those of the true rows are not known
        )
        self._reduced = ReducedModel(parts, reduced.assembly)

    def at(self, p: Float[Array, " s"]) -> ReducedModel:
        """The model for these parameters: one and the same object, which the next call changes."""
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
    """One sample of ``pdot = alpha W^T E`` (20), kept within bounds.

    The step is bounded like that of the trackers: it never corrects more than the error that it sees, so that
    ``|p - phat|`` does not grow (Lemma 4). Nor does it for small steps where the error is measured with noise within
    the dead zone, of which nothing is learnt (``control.dead_zone``). Clipping to a box that holds p does not make it
    grow either.
    """
    step = gain * elapsed
    correction = W.T @ np.linalg.solve(np.eye(len(error)) + step * W @ W.T, step * apply_dead_zone(error, dead_zone))
    return np.clip(p + correction, low, high)
