"""The linear-quadratic regulator of a linearised system."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy
from numpy import ndarray as Array

from rnc_pin.analysis.linearization import Linearization
from rnc_pin.array_shapes import Float
from rnc_pin.errors import ConfigurationError, ConstraintError, InfeasibleError, nearest

Cost = float | Sequence[float] | Mapping[str, float] | Array

_SLOW = 1e-5  # real part, relative to the size of A, above which a mode counts as not stable
_UNREACHED = 1e-6  # zero limit, relative to the sizes of A and B, or of the cost


def lqr(linear: Linearization, state_cost: Cost, input_cost: Cost = 1.0) -> Float[Array, "p s"]:
    """Return the gain K of the feedback ``T = T_0 - K x`` that minimises the integral of ``x^T Q x + u^T R u``.

    Args:
        linear: the linearised system.
        state_cost: Q: weights by state name, zero for the others; or one number, one for each state, or a matrix
            (s, s).
        input_cost: R: weights in the same forms, by input name; every input needs a positive weight.

    Raises:
        ConstraintError: a mode that is not stable is not controllable, or has no cost; the message names the states
            that it moves.
        ConfigurationError: a weight is not valid, or names an unknown state or input.

    Example:
        >>> robot = rnc.Robot.from_urdf("wheeled_pendulum.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, ["left_axle", "right_axle"])
        >>> reduced = system.reduce([rnc.FrameSpeed("base"), rnc.JointPosition("pitch"), rnc.FrameYaw("base")])
        >>> upright = robot.configuration()
        >>> linear = rnc.linearize(reduced, upright, coordinates=["pitch"], rates=["base_speed_x", "pitch"])
        >>> K = rnc.lqr(linear, {"pitch": 10.0, "base_speed_x": 1.0})
        >>> K.shape, bool(np.linalg.eigvals(linear.A - linear.B @ K).real.max() < 0)
        ((2, 3), True)
    """
    A, B = linear.A, linear.B
    Q = _cost(state_cost, linear.state_names, "state_cost")
    R = _cost(input_cost, linear.input_names, "input_cost")
    if np.linalg.eigvalsh(Q).min() < -1e-12 * np.abs(Q).max():
        raise ConfigurationError("state_cost: no weight may be negative")
    if not len(R):
        raise ConstraintError("a regulator needs at least one actuator, found none")
    if not np.linalg.eigvalsh(R).min() > 0:
        raise ConfigurationError("input_cost: every input needs a positive weight")
    # Scale each input so that its weight is 1: the result must not depend on units.
    unit = 1.0 / np.sqrt(np.diag(R))
    B, R = B * unit, unit[:, None] * R * unit
    size = float(np.abs(A).max(initial=1.0))
    for mode in np.linalg.eigvals(A):
        if mode.real < -_SLOW * size:
            continue
        shifted = A - mode * np.eye(len(A))
        left, values, _ = np.linalg.svd(np.hstack([shifted / size, B / max(np.abs(B).max(), 1e-300)]))
        if values[-1] < _UNREACHED:
            names = _moved(left[:, -1], linear.state_names)
            raise ConstraintError(
                f"the actuators {', '.join(linear.input_names)} do not control a mode that is not stable: "
                f"it moves {names}"
            )
        _, values, right = np.linalg.svd(np.vstack([shifted / size, Q / max(np.abs(Q).max(), 1e-300)]))
        if values[-1] < _UNREACHED and abs(mode.real) <= _SLOW * size:
            names = _moved(right[-1], linear.state_names)
            raise ConstraintError(f"state_cost: a mode that is not stable has zero cost: it moves {names}")
    try:
        P = scipy.linalg.solve_continuous_are(A, B, Q, R)
    except np.linalg.LinAlgError as error:
        raise ConstraintError(f"no regulator was found: {error}") from None
    K: Array = np.linalg.solve(R, B.T @ P)
    slowest = float(np.linalg.eigvals(A - B @ K).real.max())
    if not slowest < 0:
        raise ConstraintError(f"no regulator was found: with the best gain a mode still grows at {slowest:.3g}/s")
    return unit[:, None] * K


def check_sampling(linear: Linearization, K: Float[Array, "p s"], dt: float) -> None:
    """Refuse gains that are unstable in discrete time, with inputs constant over a sampling period.

    Args:
        linear: the linearised system.
        K: gain of the feedback ``T = T_0 - K x``.
        dt: sampling period [s].

    Raises:
        InfeasibleError: the closed loop is unstable; the message gives its rate.
    """
    s, p = linear.B.shape
    held = scipy.linalg.expm(np.block([[linear.A, linear.B], [np.zeros((p, s + p))]]) * dt)
    if np.abs(np.linalg.eigvals(held[:s, :s] - held[:s, s:] @ K)).max(initial=0.0) >= 1.0:
        fastest = float(np.abs(np.linalg.eigvals(linear.A - linear.B @ K)).max())
        raise InfeasibleError(
            f"the closed loop is unstable in discrete time: its fastest eigenvalue is {fastest:.3g}/s "
            f"and the sampling period {dt:g} s; reduce the sampling period (simulation.dt) or raise input_cost"
        )


def _moved(vector: Array, names: Sequence[str]) -> str:
    weights = np.abs(vector)
    return ", ".join(name for name, weight in zip(names, weights, strict=True) if weight > 0.1 * weights.max())


def _cost(given: Cost, names: Sequence[str], what: str) -> Array:
    size = len(names)
    if isinstance(given, Mapping):
        for name in given:
            if name not in names:
                raise ConfigurationError(f"{what}: no '{name}'{nearest(str(name), names)}")
        given = [given.get(name, 0.0) for name in names]
    try:
        weights = np.asarray(given, float)
    except (TypeError, ValueError):
        raise ConfigurationError(f"{what}: expected numbers, found {given!r}") from None
    if weights.shape in ((), (size,)):
        weights = np.diag(np.broadcast_to(weights, size))
    if weights.shape != (size, size) or not np.isfinite(weights).all() or not np.allclose(weights, weights.T):
        raise ConfigurationError(
            f"{what}: expected a number, one for each of {', '.join(names)}, or a symmetric matrix, found {given!r}"
        )
    return weights
