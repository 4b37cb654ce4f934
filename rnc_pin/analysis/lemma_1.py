"""Lemma 1: its residuals at sampled states, and the bounds of H, V and G."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.analysis.redundancy_class import Spread
from rnc_pin.analysis.singularities import Singularity
from rnc_pin.errors import ConstraintError, SingularityError
from rnc_pin.math.linear_algebra import unit_rows
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.printing import printed

_STEP = 5e-4  # of the finite differences, along the direction of the velocity
_SHARES = 10.0 ** np.linspace(-1.0, -3.0, 7)  # fractions of the way from a singular configuration to the nearest sample
_FLAT = 0.2  # growth order below which a quantity counts as bounded
_FEWEST = 3


def lemma_1_residuals(
    reduced: ReducedModel, configurations: np.ndarray, seed: int = 0, step: float = _STEP
) -> dict[str, float]:
    """Worst residuals at configurations (count, nq) with seeded random velocities.

    The residuals are: ``A R`` with unit rows and columns; ``H - H^T`` and ``Hdot - V - V^T`` relative to their size,
    with Hdot by fourth-order differences of this step; the smallest eigenvalue of H relative to its largest; and
    ``V(2 v2) - 2 V(v2)``.
    """
    count = len(configurations)
    v2 = np.random.default_rng(seed).uniform(-1, 1, (count, reduced.r))
    terms = reduced.terms(configurations, v2)
    speeds = np.linalg.norm(terms.v, axis=-1, keepdims=True)
    directions = terms.v / speeds
    far_behind, behind, ahead, far_ahead = (
        reduced.at(_moved(reduced, configurations, k * step * directions)).H for k in (-2, -1, 1, 2)
    )
    H_dot = (far_behind - 8 * behind + 8 * ahead - far_ahead) / (12 * step) * speeds[..., None]
    V = terms.V
    # With affine constraints V is affine in v2 instead of linear.
    resting = reduced.terms(configurations, 0 * v2).V
    doubled = reduced.terms(configurations, 2 * v2).V
    eigenvalues = np.linalg.eigvalsh(terms.H)
    size = np.abs(terms.H).max(axis=(1, 2)) * speeds[:, 0] + np.abs(V).max(axis=(1, 2))
    columns = terms.R / np.linalg.norm(terms.R, axis=-2, keepdims=True)
    return {
        "A R": _worst(np.abs(unit_rows(terms.A) @ columns)),
        "H - H^T": _worst(np.abs(terms.H - terms.H.mT).max(axis=(1, 2)) / np.abs(terms.H).max(axis=(1, 2))),
        "Hdot - V - V^T": _worst(np.abs(H_dot - V - V.mT).max(axis=(1, 2)) / size),
        "V linear": _worst(np.abs(doubled - 2 * V + resting).max(axis=(1, 2)) / size),
        "smallest eigenvalue of H": float((eigenvalues[:, 0] / eigenvalues[:, -1]).min()),
    }


def _moved(reduced: ReducedModel, configurations: np.ndarray, steps: np.ndarray) -> np.ndarray:
    model = reduced.robot.model
    return np.stack([pin.integrate(model, q, step) for q, step in zip(configurations, steps, strict=True)])


def _worst(array: np.ndarray) -> float:
    return float(array.max(initial=0.0))


@printed(distances="rad or m")
@dataclass(frozen=True)
class Approach:
    """Growth of H and V towards a configuration where E is singular.

    Attributes:
        rows: names of the rows of E that are linearly dependent at this configuration.
        distances: from this configuration, farthest first [rad, m].
        H, V: largest singular values at these distances; V for the worst unit reducing velocity along one output.
        H_order, V_order: order p of growth like ``distance^-p``; about zero if the matrix stays bounded.
        bounded: True if H and V both stay bounded.
    """

    rows: tuple[str, ...]
    distances: tuple[float, ...]
    H: tuple[float, ...]
    V: tuple[float, ...]
    H_order: float
    V_order: float
    bounded: bool


@printed()
@dataclass(frozen=True)
class Boundedness:
    """Norms of H, V and G over the samples, and their growth towards singular configurations.

    Attributes:
        H: largest singular value of H over the samples.
        V: largest singular value of V for the worst unit reducing velocity along one output; V is linear in v2.
        G: Euclidean norm of G.
        approaches: growth towards configurations where E is singular, one entry for each singular family.
        everywhere: True if H and V stay bounded towards every singular configuration that was found.
    """

    H: Spread
    V: Spread
    G: Spread
    approaches: tuple[Approach, ...]
    everywhere: bool


def boundedness(
    reduced: ReducedModel, configurations: np.ndarray, singularities: Sequence[Singularity] = ()
) -> Boundedness:
    """Return the norms of H, V and G at regular configurations (count, nq), and on the way to singular ones.

    On a compact set where E is regular, H, V and G are continuous and so bounded. Towards a configuration where E is
    singular, ``R = E^-1 [0; I]`` grows without bound. So do H and V, unless the growing columns carry no inertia.
    """
    H, V, G = _sizes(reduced, configurations)
    located = [each for each in singularities if each.matrix == "E" and each.located]
    found = [_approach(reduced, configurations, each) for each in located]
    approaches = tuple(each for each in found if each is not None)
    return Boundedness(
        Spread.over(H), Spread.over(V), Spread.over(G), approaches, all(each.bounded for each in approaches)
    )


def _sizes(reduced: ReducedModel, configurations: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Norms of H, V and G at configurations (count, nq), (count,) each."""
    rest = np.zeros(reduced.r)
    still = reduced.at(configurations, rest)
    moved = [reduced.at(configurations, unit).V - still.V for unit in np.eye(reduced.r)]
    largest = np.max([np.linalg.norm(each, 2, axis=(-2, -1)) for each in moved], axis=0)
    return np.linalg.norm(still.H, 2, axis=(-2, -1)), largest, np.linalg.norm(still.G, axis=-1)


def _approach(reduced: ReducedModel, configurations: np.ndarray, singularity: Singularity) -> Approach | None:
    """Growth on the way from the nearest sample to a singularity; None if too few points are regular."""
    model = reduced.robot.model
    there = reduced.robot.configuration(singularity.configuration)
    start = min(configurations, key=lambda q: float(pin.distance(model, there, q)))
    distances, sizes = [], []
    for share in _SHARES:
        try:
            q = reduced.assembly.project(pin.interpolate(model, there, start, float(share)))
            H, V, _ = _sizes(reduced, q[None])
        except (SingularityError, ConstraintError):
            continue
        distances.append(float(np.linalg.norm(pin.difference(model, there, q))))
        sizes.append((float(H[0]), float(V[0])))
    if len(distances) < _FEWEST:
        return None
    H_order, V_order = (_order(distances, column) for column in zip(*sizes, strict=True))
    return Approach(
        rows=singularity.rows,
        distances=tuple(distances),
        H=tuple(size for size, _ in sizes),
        V=tuple(size for _, size in sizes),
        H_order=H_order,
        V_order=V_order,
        bounded=max(H_order, V_order) < _FLAT,
    )


def _order(distances: Sequence[float], sizes: Sequence[float]) -> float:
    """Order p of ``size ~ distance^-p``, fitted over the nearer half of the way; 0.0 if a size is zero."""
    nearer = max(_FEWEST, (len(distances) + 1) // 2)
    last = np.array(sizes)[-nearer:]
    if not (last > 0).all():
        return 0.0
    slope, _ = np.polyfit(np.log(np.array(distances)[-nearer:]), np.log(last), 1)
    return float(-slope)
