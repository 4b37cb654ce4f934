"""Gradients of the kinematics along the motions of single reducing outputs."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.model.configuration_evaluation import ConfigurationEvaluation
from rnc_pin.model.evaluator import solved_for_q
from rnc_pin.model.state_evaluation import StateEvaluation


def kinematic_gradient(here: ConfigurationEvaluation, along: Sequence[int] | Array) -> Float[Array, "*batch k r s"]:
    """Derivatives of ``A_star`` with respect to single reducing outputs, along their motions at unit rate.

    Args:
        here: evaluation at configurations.
        along: indices in x2, (s,).
    """
    return np.moveaxis(output_slopes(here, along), 0, -1)


@solved_for_q
def output_slopes(here: ConfigurationEvaluation, along: Sequence[int] | Array) -> Float[Array, "s *batch k r"]:
    """Rates of ``A_star`` in the motions of single reducing outputs at unit rate, by their indices in x2, (s,)."""
    return _single_motions(here, along, lambda state: state.A_star_dot)


def log_determinant_gradient(here: ConfigurationEvaluation, along: Sequence[int] | Array) -> Float[Array, "*batch s"]:
    """Derivatives ``tr(E^-1 Edot)`` of ``log |det E|`` along the motions of single reducing outputs.

    Args:
        here: evaluation at configurations.
        along: indices in x2, (s,).
    """
    traces = _single_motions(here, along, lambda state: np.einsum("...ij,...ji->...", state.E_inverse, state.E_dot))
    return np.moveaxis(traces, 0, -1)


def _single_motions(
    here: ConfigurationEvaluation, along: Sequence[int] | Array, quantity: Callable[[StateEvaluation], Array]
) -> Array:
    """Quantity (s, ...) at the states in which one reducing output moves at unit rate and the others rest."""
    each = [quantity(StateEvaluation(here, v=here.R[..., j])) for j in along]
    return np.stack(each) if each else np.zeros((0, *quantity(StateEvaluation(here, v=here.R[..., 0])).shape))
