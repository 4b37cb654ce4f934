"""What a controller may see."""

from __future__ import annotations

from typing import Any, NamedTuple

from jaxtyping import Float
from numpy import ndarray as Array

_ABSENT: Any = None  # a loop that leaves a field out has a controller that does not read it


class Measurement(NamedTuple):
    """Outputs, their rates and the kinematics that connects them; nothing of the inertia.

    ``ReducedModel.measure`` makes one from a state. In a loop of your own, fill in what the controller
    reads and leave the rest: each says in its docstring what that is.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> measurement = reduced.measured(robot.configuration(), v=[0.5, 0.01, 0.1], integrals=np.zeros(2))
        >>> measurement.v2, measurement.residual  # the sleigh slips sideways
        (array([0.5, 0.1]), array([0.01]))
    """

    q: Float[Array, "*batch nq"] = _ABSENT
    """Configuration."""
    v: Float[Array, "*batch nv"] = _ABSENT
    """Full velocity, as joint encoders and a gyroscope on the base give it; it need not satisfy the constraints."""
    v2: Float[Array, "*batch r"] = _ABSENT
    """Rates of the reducing outputs."""
    x1: Float[Array, "*batch k"] = _ABSENT
    """Vertical outputs."""
    x2: Float[Array, "*batch r"] = _ABSENT
    """Reducing outputs; integrals of v2 where they are quasi-velocities, NaN where nobody gave them."""
    v1: Float[Array, "*batch k"] = _ABSENT
    """Rates of the vertical outputs, ``J1 v``; ``A_star v2 + v1_offset`` where v satisfies the constraints."""
    A_star: Float[Array, "*batch k r"] = _ABSENT
    """Kinematics (3a), ``v1 = A_star v2``."""
    A_star_dot: Float[Array, "*batch k r"] = _ABSENT
    """Its rate."""
    v1_offset: Float[Array, "*batch k"] | None = None
    """Rates of the vertical outputs at ``v2 = 0``; None where the constraints are homogeneous."""
    v1_offset_dot: Float[Array, "*batch k"] | None = None
    """Their rate."""
    residual: Float[Array, "*batch m"] | None = None
    """``A v - mu`` of the velocity as it was measured: slip. None where nobody looked."""
    excess: Float[Array, "*batch r"] | None = None
    """Reduced force that was asked for at the last sample and that the actuators could not give: asked less given. None
    where they gave all of it, or nobody looked."""
    missing: Float[Array, "*batch p"] | None = None
    """The same as inputs of the actuators."""
