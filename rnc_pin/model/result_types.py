"""Result types of a reduced model. The fields give the shapes; batch axes lead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.printing import printed


@printed()
@dataclass(frozen=True)
class ReducedTerms:
    """All matrices of the reduced system at a state; batch axes lead."""

    R: Float[Array, "*batch nv r"]
    """Null-space basis, ``v = R v2 + b``."""
    R_dot: Float[Array, "*batch nv r"]
    H: Float[Array, "*batch r r"]
    """Reduced inertia matrix."""
    V: Float[Array, "*batch r r"]
    """Reduced Coriolis matrix, with ``Hdot = V + V^T``."""
    G: Float[Array, "*batch r"]
    """Reduced gravity forces; affine constraints add forces of the motion b: ``R^T (g* + H* b_dot + C* b)``."""
    input_matrix: Float[Array, "*batch r p"]
    """``R^T B``, so that ``F = input_matrix @ T``."""
    A: Float[Array, "*batch m nv"]
    """Independent constraint rows."""
    A_dot: Float[Array, "*batch m nv"]
    A_star: Float[Array, "*batch k r"]
    """Kinematics of the vertical outputs, ``x1dot = A_star v2 + J1 b``."""
    A_star_dot: Float[Array, "*batch k r"]
    v: Float[Array, "*batch nv"]
    """Full velocity ``R v2 + b``."""
    b: Float[Array, "*batch nv"]
    """Velocity at ``v2 = 0``: zero unless constraints are affine."""
    b_dot: Float[Array, "*batch nv"]


@printed()
@dataclass(frozen=True)
class LagrangianTerms:
    """Matrices of the system before reduction, paper (1)."""

    H: Float[Array, "*batch nv nv"]
    C: Float[Array, "*batch nv nv"]
    g: Float[Array, "*batch nv"]
    B: Float[Array, "*batch nv p"]


@printed()
class StateDerivative(NamedTuple):
    """Time derivative of a state, with the power of all forces."""

    v: Array  # (..., nv), full velocity
    v2_dot: Array  # (..., r), reduced acceleration
    power: Array | float  # (...,), power of actuators, damping and moving constraints [W]
