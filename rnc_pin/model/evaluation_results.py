"""Results of evaluations: all matrices at a state, a regressor, a state derivative, and measurements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, cast

from rnc_pin.array_shapes import Array, Float
from rnc_pin.printing import printed

_ABSENT = cast(Array, None)  # a field may be absent if the controller does not read it


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
@dataclass(frozen=True)
class ReducedRegressor:
    """Columns of the reduced dynamics ``F = matrix @ p`` at states, for parameters p of the bodies.

    The multipliers of all constraints are absent, because ``A R = 0``: those of wheels and of closed loops alike.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> reduced = rnc.NonholonomicSystem(robot, (), robot.joint_names[1:]).reduce()
        >>> q, v2, v2_dot = robot.configuration({"joint_2": 1.0}), np.ones(4), np.zeros(4)
        >>> regressor = reduced.regressor(q, v2, v2_dot)
        >>> regressor.names[:2], regressor.matrix.shape
        (('m of platform', 'm x of platform'), (4, 40))
        >>> np.allclose(regressor.matrix @ regressor.parameters, reduced.inverse_dynamics(q, v2, v2_dot))
        True
    """

    matrix: Float[Array, "*batch r columns"]
    """Derivative of the reduced forces F with respect to the parameters."""
    names: tuple[str, ...]
    """Names of the columns: ten of each body, e.g. ``I_zz of joint_1``, then the motor inertias that the robot has.

    Moments are about the origin of the body's joint, in its axes. A motor inertia is Pinocchio's ``armature``.
    """
    parameters: Float[Array, " columns"]
    """Values of the parameters in the robot."""


@printed()
class StateDerivative(NamedTuple):
    """Time derivative of a state, with the power of all forces."""

    v: Array  # (..., nv), full velocity
    v2_dot: Array  # (..., r), reduced acceleration
    power: Array | float  # (...,), power of actuators, damping and moving constraints [W]


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
