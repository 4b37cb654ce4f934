"""Typical inertia of a region of configurations, to which gains are scaled, and the rates that sampling allows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.errors import InfeasibleError, few
from rnc_pin.math.linear_algebra import apply_transposed
from rnc_pin.model.reduced_model import ReducedModel

MAX_RATE_TIMES_PERIOD = 0.2
"""Largest product of a closed-loop rate and the sampling period that the sampled tracker tolerates."""
MAX_RATE_TIMES_DELAY = np.pi / 4
"""Largest product of a closed-loop rate and the age of the feedback signal: half of pi / 2."""
NEARLY_SINGULAR = 0.05
"""Smallest singular value of E with scaled rows below which a refusal names the singular configuration as its cause."""
AWAY_FROM_SINGULAR = "keep away from there: nearer goals, another start or path, or other outputs"


class TypicalInertia(NamedTuple):
    """Typical inertia ``modes diag(weights) modes^T`` of inertia matrices H, and their distance from it.

    Attributes:
        weights: inertia of each output or mode (k,).
        modes: matrix (k, k), whose columns are the directions of forces on single modes; None for single outputs.
        eigenvalues: of ``typical^-1 H``, ascending, (count, k).
    """

    weights: Float[Array, " k"]
    modes: Float[Array, "k k"] | None
    eigenvalues: Float[Array, "count k"]

    def window(self, slowest: float, fastest: float) -> tuple[float, float]:
        """Lowest and highest bandwidth for closed-loop rates between two limits [1/s].

        Args:
            slowest: lowest accepted rate.
            fastest: highest accepted rate.
        """
        return slowest * float(self.eigenvalues.max()), fastest * float(self.eigenvalues.min())


def inertia_of_outputs(H: np.ndarray) -> TypicalInertia:
    """Return the typical diagonal D (k,) of inertia matrices (count, k, k): the geometric mean of its extremes.

    Args:
        H: inertia matrices.
    """
    H = _symmetric(H)
    entries = np.einsum("...ii->...i", H).reshape(-1, H.shape[-1])
    # The geometric mean is as far from the least as from the largest, in ratios: the window is symmetric.
    diagonal = np.sqrt(entries.min(axis=0) * entries.max(axis=0))
    scale = np.sqrt(diagonal)
    return TypicalInertia(diagonal, None, np.linalg.eigvalsh(H / np.multiply.outer(scale, scale)))


def inertia_of_modes(H: np.ndarray) -> TypicalInertia:
    """Return the typical inertia with its modes: the geometric mean of the arithmetic and the harmonic mean of H.

    The geometric mean ``P # Q`` of two positive definite matrices solves ``X P^-1 X = Q``. For a single output it is
    the square root of their product.

    Args:
        H: inertia matrices (count, k, k).
    """
    # Means of matrices in kg and in kg m^2 would depend on units.
    scale = np.sqrt(inertia_of_outputs(H).weights)
    normal = _symmetric(H / np.multiply.outer(scale, scale))  # free of units
    arithmetic, harmonic = normal.mean(axis=0), np.linalg.inv(np.linalg.inv(normal).mean(axis=0))
    values, vectors = np.linalg.eigh(arithmetic)
    root = vectors * np.sqrt(values)
    inverse = vectors / np.sqrt(values)
    middle, turned = np.linalg.eigh(_symmetric(inverse.T @ harmonic @ inverse))
    half = root @ turned
    weights, modes = np.linalg.eigh(_symmetric((half * np.sqrt(middle)) @ half.T))
    whitened = modes / np.sqrt(weights)
    return TypicalInertia(weights, scale[:, None] * modes, np.linalg.eigvalsh(whitened.T @ normal @ whitened))


def fastest_rate(dt: float, delay: float) -> float:
    """Largest closed-loop rate [1/s] for a sampling period and a delay [s].

    Args:
        dt: sampling period.
        delay: time from a measurement to its force, without sampling.
    """
    return min(MAX_RATE_TIMES_PERIOD / dt, MAX_RATE_TIMES_DELAY / (delay + dt / 2))


def gravity_loads(reduced: ReducedModel, configurations: np.ndarray, outputs: np.ndarray | None = None) -> bool:
    """Return whether gravity loads outputs in a region.

    Args:
        reduced: the model.
        configurations: region, (count, nq).
        outputs: indices of the reducing outputs; all by default.
    """
    region = np.atleast_2d(configurations)
    count = 12  # of configurations at which gravity is computed: it changes slowly over a region
    some = region[np.unique(np.linspace(0, len(region) - 1, count).astype(int))]
    model = reduced.robot.model
    data = model.createData()
    weight = float(pin.computeTotalMass(model) * np.linalg.norm(model.gravity.linear))
    forces = np.array([pin.computeGeneralizedGravity(model, data, q) for q in some])
    loads = apply_transposed(reduced.at(some).R, forces)
    lever = 1e-4  # [m] of the robot's weight above which gravity loads an output; for a slide, part of the weight
    return bool(np.abs(loads if outputs is None else loads[:, outputs]).max(initial=0.0) > max(lever * weight, 1e-6))


def adaptation_rate(is_loaded: bool, dt: float, delay: float) -> float:
    """Return the default adaptation rate ``beta / k`` [1/s]: 1, or up to 20 where gravity loads the outputs.

    An adaptation rate a makes the loop ``rate (s + a) / s^2 exp(-age s)``, with ``age = delay + dt / 2``. With
    ``a <= 20/s`` and ``a age <= 0.1`` its phase margin is at least 20 degrees for rates from 4/s to ``fastest_rate``.

    Args:
        is_loaded: True if gravity loads the outputs.
        dt, delay: sampling period, and delay without sampling [s].
    """
    under_gravity = 20.0  # [1/s], with which a tracker follows the change of its gravity load
    largest_product = 0.1  # of the adaptation rate and the age of the feedback signal
    return max(1.0, min(under_gravity, largest_product / (delay + dt / 2))) if is_loaded else 1.0


def no_gains(
    reduced: ReducedModel,
    configurations: np.ndarray,
    times: np.ndarray | None,
    inertia: TypicalInertia,
    slowest: float,
    dt: float,
    delay: float,
) -> InfeasibleError:
    """Return the error that no velocity gains suit a region: where, which rows, and what would help.

    Args:
        reduced: the model.
        configurations, times: region (count, nq) and its times (count,) [s], if it is a motion.
        inertia: typical inertia, of modes unless gains are given for single outputs.
        slowest: lowest accepted closed-loop rate [1/s].
        dt, delay: sampling period, and delay without sampling [s].
    """
    at = reduced.at(np.atleast_2d(configurations))
    values = np.atleast_1d(at.smallest_singular_value)
    singular = bool(values.min() < NEARLY_SINGULAR)
    # The cause is told where it is worst.
    place = int(np.argmin(values) if singular else np.argmax(inertia.eigenvalues[:, -1]))
    time, rows = None if times is None else float(times[place]), at.dependent_rows(place)
    # The longest sampling period with gains [s]; 0 if the delay alone excludes them.
    where, rate = _place(time, at.q[place]), slowest * float(inertia.eigenvalues.max() / inertia.eigenvalues.min())
    period = max(0.0, min(MAX_RATE_TIMES_PERIOD / rate, 2.0 * (MAX_RATE_TIMES_DELAY / rate - delay)))
    if singular:
        cause = (
            f"the outputs are nearly singular{where}: rows {few(rows, 4)} are almost dependent, smallest singular "
            f"value of E = [A; J2] {values[place]:.2g}; {AWAY_FROM_SINGULAR}"
        )
    else:
        low, high = inertia.window(slowest, fastest_rate(dt, delay))
        least, most = inertia.eigenvalues[place, 0], inertia.eigenvalues[place, -1]
        cause = (
            f"rates of at least {slowest:g}/s need a bandwidth of {low:.3g} rad/s, sampling every {dt:g} s"
            f"{f' with a delay of {delay:g} s' if delay else ''} allows {high:.3g}; the inertia is most uneven{where}, "
            f"with {least:.3g} to {most:.3g} of its typical value"
        )
    error = InfeasibleError(f"no velocity gains suit this region: {cause}{_sampling(period)}")
    error.q, error.time, error.rows, error.singular_value = at.q[place].copy(), time, rows, float(values[place])
    return error


def _sampling(period: float) -> str:
    """Words on the effect of a shorter sampling period; none if no loop is that fast."""
    shortest = 1e-4  # [s]; control loops that sample faster are rare, so no message asks for it
    if period >= shortest:
        return f"; sample faster, at least every {period:.2g} s"
    return "" if period else "; the delay is too long for any sampling"


def _place(time: float | None, q: np.ndarray) -> str:
    when = "" if time is None else f" at t = {time:.2f} s"
    shown = 8  # positions in a message; the error has all
    return f"{when} at q = [{', '.join(f'{value:.3g}' for value in q[:shown])}{', ...' if len(q) > shown else ''}]"


def _symmetric(H: np.ndarray) -> np.ndarray:
    """Symmetric part: an effective inertia need not be symmetric."""
    return np.asarray(0.5 * (H + H.mT))
