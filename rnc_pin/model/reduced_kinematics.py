"""Kinematics of a reduced model at states (q, v): velocities, rates of R, gradients, and measurements; no inertia.

    Rdot = -E^-1 Edot R,   x1dot = A_star v2 + J1 b.

Affine constraints ``A v = mu(q)``, e.g. a momentum that is not zero, add a prescribed motion,

    bdot = E^-1 ([mudot; 0] - Edot b).

Paper (2)-(3). All quantities have leading batch axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.math.linear_algebra import apply, product
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.configuration_evaluation import ConfigurationEvaluation
from rnc_pin.model.evaluator import ArraysAtV
from rnc_pin.model.input_validation import ArrayInput
from rnc_pin.model.kinematics import VelocityKinematics
from rnc_pin.printing import ObjectSummary, described, printed

_ABSENT = cast(Array, None)  # a field may be absent if the controller does not read it


@printed()
class Measurement(NamedTuple):
    """Outputs, their rates and the kinematics between them, without inertia.

    ``ReducedModel.measure`` makes one from a state. In your own control loop, set the fields that the controller reads
    and omit the others. The docstring of each controller lists them.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> measurement = reduced.at(robot.configuration(), v=[0.5, 0.01, 0.1]).measure(np.zeros(2))
        >>> measurement.v2, measurement.residual  # the sleigh slips sideways
        (array([0.5, 0.1]), array([0.01]))
    """

    q: Float[Array, "*batch nq"] = _ABSENT
    """Configurations."""
    v: Float[Array, "*batch nv"] = _ABSENT
    """Full velocity, e.g. from joint encoders and a gyroscope on the base; it need not satisfy the constraints."""
    v2: Float[Array, "*batch r"] = _ABSENT
    """Rates of the reducing outputs."""
    x1: Float[Array, "*batch k"] = _ABSENT
    """Vertical outputs."""
    x2: Float[Array, "*batch r"] = _ABSENT
    """Reducing outputs; for quasi-velocities the integrals of v2, NaN if they are not given."""
    v1: Float[Array, "*batch k"] = _ABSENT
    """Rates of the vertical outputs, ``J1 v``; equal to ``A_star v2 + v1_offset`` if v satisfies the constraints."""
    A_star: Float[Array, "*batch k r"] = _ABSENT
    """Kinematics (3a), ``v1 = A_star v2``."""
    A_star_dot: Float[Array, "*batch k r"] = _ABSENT
    """Rate of ``A_star``."""
    v1_offset: Float[Array, "*batch k"] | None = None
    """Rates of the vertical outputs at ``v2 = 0``; None if the constraints are homogeneous."""
    v1_offset_dot: Float[Array, "*batch k"] | None = None
    """Rate of ``v1_offset``."""
    residual: Float[Array, "*batch m"] | None = None
    """Slip: ``A v - mu`` of the measured velocity; None if it is not computed."""
    force_deficit: Float[Array, "*batch r"] | None = None
    """Reduced force that saturation cut off at the last sample: requested minus applied force. None without saturation,
    or if it is not computed."""
    input_deficit: Float[Array, "*batch p"] | None = None
    """Actuator inputs that saturation cut off at the last sample: requested minus applied inputs."""


class ReducedKinematics(ConfigurationEvaluation):
    """Kinematics of a reduced model at states (q, v). Each quantity is computed once, on first use, and is read-only.

    Args:
        configuration: evaluation at the same configurations (..., nq).
        v2: validated reduced velocities (..., r).
        v: validated measured full velocities (..., nv), instead of v2.
        motion: kinematics at these configurations and full velocities, if known.
        arrays: arrays that the evaluator has filled for v; None if it fills them on first use.

    Raises (every quantity that needs R):
        SingularityError: the outputs do not parametrise the motion at q.
    """

    def __init__(
        self,
        configuration: ConfigurationEvaluation,
        v2: Array | None = None,
        v: Array | None = None,
        motion: VelocityKinematics | None = None,
        arrays: ArraysAtV | None = None,
    ) -> None:
        self.configuration: ConfigurationEvaluation = (
            configuration.configuration if isinstance(configuration, ReducedKinematics) else configuration
        )
        super().__init__(configuration._evaluator, configuration.q, self.configuration, configuration.t)
        self._check_time()
        self._v2, self._v, self._motion = v2, v, motion
        if arrays is not None:
            self.arrays_at_v = arrays

    # ------------------------------------------------------------------ velocities

    @cached_property
    def v2(self) -> Float[Array, "*batch r"]:
        """Rates of the reducing outputs."""
        return np.ascontiguousarray(self.row_velocities[..., self._data.m :]) if self._v2 is None else self._v2

    @cached_property
    def v(self) -> Float[Array, "*batch nv"]:
        """Full velocity: ``R v2 + b``, or the measured one."""
        return self.velocity(self.v2) if self._v is None else self._v

    @cached_property
    def motion(self) -> VelocityKinematics:
        """Kinematics at (q, v)."""
        if self._motion is None:
            self._motion = self.position.with_velocity(self.v)
        return self._motion

    @cached_property
    def arrays_at_v(self) -> ArraysAtV:
        """Arrays that the evaluator has filled for v."""
        return self._evaluator.fill_at_v(self, self.arrays_at_q)

    @cached_property
    def row_velocities(self) -> Float[Array, "*batch nv"]:
        """Rates ``E v`` of the constraint rows and of the reducing outputs."""
        if (filled := self.arrays_at_v.row_velocities) is not None:
            return filled
        return apply(self.E, self.v)

    @cached_property
    def gamma(self) -> Float[Array, "*batch nv"]:
        """Bias acceleration ``Edot v - [mudot; 0]`` of constraint rows and reducing outputs, at zero ``vdot``."""
        if (filled := self.arrays_at_v.gamma) is not None:
            return filled
        data = self._data
        if self.factorization.kept is None:
            return data.stack.bias_acceleration(self.motion)
        chosen = np.take_along_axis(data.rows.bias_acceleration(self.motion), self.kept_rows, axis=-1)
        return np.concatenate([chosen, data.reducing.bias_acceleration(self.motion)], axis=-1)

    @cached_property
    def residual(self) -> Float[Array, "*batch m"]:
        """Constraint residual ``A v - mu`` of the velocity."""
        residual = self.row_velocities[..., : self._data.m]
        return residual - self.mu if self._data.affine else residual

    @cached_property
    def v1(self) -> Float[Array, "*batch k"]:
        """Rates of the vertical outputs, ``J1 v``."""
        if (filled := self.arrays_at_v.v1) is not None:
            return filled
        return apply(self.J1, self.v)

    @cached_property
    def rates(self) -> VelocityKinematics:
        """Kinematics at (q, v) with rates along v."""
        return self.motion

    @cached_property
    def E_dot(self) -> Float[Array, "*batch nv nv"]:
        """Rate of E."""
        if (filled := self.arrays_at_v.E_dot) is not None:
            return filled
        data = self._data
        if self.factorization.kept is None:
            return data.stack.jacobian_dot(self.rates)
        kept = self.kept_rows[..., None]
        chosen = np.take_along_axis(data.rows.jacobian_dot(self.rates), kept, axis=-2)
        return np.concatenate([chosen, data.reducing.jacobian_dot(self.rates)], axis=-2)

    @cached_property
    def A_dot(self) -> Float[Array, "*batch m nv"]:
        """Rate of A."""
        return self.E_dot[..., : self._data.m, :]

    @cached_property
    def R_dot(self) -> Float[Array, "*batch nv r"]:
        """Rate ``-E^-1 Edot R`` of R."""
        if (filled := self.arrays_at_v.R_dot) is not None:
            return filled
        return -product(self.E_inverse, product(self.E_dot, self.R))

    @cached_property
    def J1_dot(self) -> Float[Array, "*batch k nv"]:
        """Rate of J1."""
        if (filled := self.arrays_at_v.J1_dot) is not None:
            return filled
        return self._data.vertical.jacobian_dot(self.rates)

    @cached_property
    def A_star(self) -> Float[Array, "*batch k r"]:
        """Kinematics of the vertical outputs, ``x1dot = A_star v2 + J1 b``."""
        if (filled := self.arrays_at_v.A_star) is not None:
            return filled
        return super().A_star

    @cached_property
    def A_star_dot(self) -> Float[Array, "*batch k r"]:
        """Rate of A_star."""
        if (filled := self.arrays_at_v.A_star_dot) is not None:
            return filled
        if not self.J1.shape[-2]:
            return self.A_star  # without outputs, no rate is needed, which may be unknown
        return self.J1_dot @ self.R + self.J1 @ self.R_dot

    @cached_property
    def b_dot(self) -> Float[Array, "*batch nv"]:
        """Rate of b."""
        data = self._data
        if not data.affine:
            return np.zeros_like(self.b)
        mu_dot = np.take_along_axis(data.rows.rate_dot(self.rates), self.kept_rows, axis=-1)
        return apply(self.E_inverse[data.multiplied], mu_dot) - apply(self.E_inverse, apply(self.E_dot, self.b))

    def _summary(self) -> ObjectSummary:
        title, lines = super()._summary()
        return ObjectSummary(title, [*lines, ("v2 [rad/s or m/s]", described(self.v2))])

    # ------------------------------------------------------------------ measurement

    def measure(self, integrals: ArrayInput | None = None) -> Measurement:
        """Measurement for controllers: outputs, rates and the kinematics between them, without inertia.

        Args:
            integrals: integrals of v2 over time (..., r), used as values of quasi-velocity outputs. Without them, these
                values are NaN, and a controller that needs one raises an error.
        """
        x1, x2 = self.outputs(integrals)
        if integrals is None and self._data.reducing.has_quasi:
            x2 = x2.copy()
            x2[..., self._data.reducing.quasi] = np.nan
        self._data.vertical.check(x1, self.A_star, self.A_star_dot)
        self._data.reducing.check(x2)
        offset = offset_dot = None
        if self._data.affine:
            offset = apply(self.J1, self.b)
            offset_dot = apply(self.J1_dot, self.b) + apply(self.J1, self.b_dot)
        fields = self.q, self.v, self.v2, x1, x2, self.v1, self.A_star, self.A_star_dot, offset, offset_dot
        return Measurement(*fields, self.residual)


# ------------------------------------------------------------------ gradients along reducing outputs


def kinematic_gradient(here: ConfigurationEvaluation, along: Sequence[int] | Array) -> Float[Array, "*batch k r s"]:
    """Derivatives of ``A_star`` with respect to single reducing outputs, along their motions at unit rate.

    Args:
        here: evaluation at configurations.
        along: indices in x2, (s,).
    """
    return np.moveaxis(output_slopes(here, along), 0, -1)


def output_slopes(here: ConfigurationEvaluation, along: Sequence[int] | Array) -> Float[Array, "s *batch k r"]:
    """Rates of ``A_star`` in the motions of single reducing outputs at unit rate, by their indices in x2, (s,)."""
    if (filled := here.arrays_at_q.output_slopes(along)) is not None:
        return filled
    each = [ReducedKinematics(here, v=here.R[..., j]).A_star_dot for j in along]
    return np.stack(each) if each else np.zeros((0, *here.A_star.shape))
