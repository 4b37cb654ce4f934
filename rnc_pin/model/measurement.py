"""Measurement: the input of controllers."""

from __future__ import annotations

from typing import NamedTuple, cast

from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.printing import printed

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
