"""Comparison of the compiled kernel with NumPy before a reduction uses it."""

from __future__ import annotations

import warnings
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
from numpy import ndarray as Array

from rnc_pin import _kernel
from rnc_pin.errors import SingularityError
from rnc_pin.model.compiled import CompiledReduction
from rnc_pin.model.compiled_states import CompiledState
from rnc_pin.model.kinematics import Kinematics, VelocityKinematics

if TYPE_CHECKING:
    from rnc_pin.model.reduction_data import ReductionData

_TOLERANCE = 1e-9  # largest relative difference of the two paths at the state that compares them
_TIME = 0.3  # of rows over time [s]
_ATTEMPTS = 8  # random states that may be singular


def compile_reduction(data: ReductionData, compare: bool = True) -> CompiledReduction | None:
    """Kernel of a reduction; None if NumPy has to evaluate it.

    Args:
        data: the reduction.
        compare: compare the kernel with NumPy at a random state. Rows that were compared in another
            reduction can omit it.
    """
    if _kernel.library is None:
        return None
    try:
        found = CompiledReduction(data)
        difference = _difference(found, data) if compare else 0.0
    except ValueError as error:
        _warn(str(error))
        return None
    if difference is not None and not difference < _TOLERANCE:
        _warn(f"it differs from NumPy by {difference:.1e} (relative), limit {_TOLERANCE:.0e}")
    return found if difference is not None and difference < _TOLERANCE else None


def _warn(why: str) -> None:
    warnings.warn(f"the compiled kernel is not used for this model: {why}", RuntimeWarning, stacklevel=2)


def _difference(found: CompiledReduction, data: ReductionData) -> float | None:
    """Largest relative difference at a random regular state; None if there is none."""
    generator, kinematics = np.random.default_rng(0), Kinematics(data.robot, data.kinematics.time)
    t = _TIME if data.rheonomic else None
    for _ in range(_ATTEMPTS):
        q, v = data.robot.random_configuration(generator), generator.uniform(-1.0, 1.0, data.n)
        rates = kinematics.position(q, t).with_velocity(v)
        with suppress(SingularityError, NotImplementedError):  # a row is undefined at q, or has no rate
            expected, computed = _by_numpy(data, rates), _by_kernel(found, data, rates, t)
            if computed is not None:
                return max(_relative(computed[name], value) for name, value in expected.items())
    return None


def _by_numpy(data: ReductionData, at: VelocityKinematics) -> dict[str, Array]:
    return {
        "passive": data.forces.sums(at).total,
        "mu": data.constraints.rate(at),
        "M": at.M,
        "E": data.stack.jacobian(at),
        "bias": at.bias,
        "gamma": data.stack.bias_acceleration(at),
        "E_dot": data.stack.jacobian_dot(at),
        "J1": data.vertical.jacobian(at),
        "J1_dot": data.vertical.jacobian_dot(at),
    }


def _by_kernel(
    found: CompiledReduction, data: ReductionData, at: VelocityKinematics, t: float | None
) -> dict[str, Array] | None:
    configuration = found.configuration(at.q, at)
    if configuration is None:
        return None
    state = CompiledState(configuration, at.v, at, t)
    if state.rates is None:
        return None
    records = configuration.kinematics, configuration.inverse, state.biases, state.rates
    moved = found.admissible_velocity(at.q, np.zeros(data.r), t) if data.affine else None
    passive = np.zeros(at.v.shape) if state.passive is None else state.passive[0]
    named = {name: each[name] for each in records for name in each.dtype.names or ()}
    # Constraint rates of the velocity at which the reducing outputs are at rest.
    mu = data.constraints.rate(at) if moved is None else data.constraints.jacobian(at) @ moved[0]
    return {**named, "passive": passive if found.fused else data.forces.sums(at).total, "mu": mu}


def _relative(found: Array, expected: Array) -> float:
    scale = max(float(np.abs(expected).max(initial=0.0)), 1e-3)
    return float(np.abs(found - expected).max(initial=0.0)) / scale
