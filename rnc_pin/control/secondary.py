"""Secondary objectives for the remaining freedom, if there are more redundant than vertical outputs.

A secondary objective gives desired rates z of the redundant outputs. ``RedundancyController`` follows them as far as
the vertical outputs allow (A. Liegeois, IEEE Trans. SMC 7(12), 1977, for a fixed arm). The gradients here are steepest
for equal weights of that controller. For weights w choose k proportional to 1/w.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated

import numpy as np
import pinocchio as pin
from annotated_types import Gt, Le, Len

from rnc_pin.control.controller import DescribedMixin, Description, check_size, describe, listed
from rnc_pin.control.feedback import Feedback
from rnc_pin.control.whole_body.limits.joint_limits import limited_positions
from rnc_pin.errors import ConfigurationError, SingularityError
from rnc_pin.math.linear_algebra import apply_transposed
from rnc_pin.model.kinematics import over_states
from rnc_pin.model.reduced_kinematics import Measurement, kinematic_gradient, log_determinant_gradient
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import Task
from rnc_pin.planning.references import Reference
from rnc_pin.printing import ReprMixin

_STEP = 2e-5  # [rad or m]; step of a central difference along the motion

Secondary = Callable[[float, Measurement], tuple[np.ndarray, np.ndarray]]
"""Function that returns desired rates z of the redundant outputs (..., r2), and the derivative of z."""


class Combined(ReprMixin):
    """Sum of several objectives; their gains are the weights.

    Args:
        parts: the objectives.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce(
        ...     [rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")], [rnc.JointPosition("platform")])
        >>> task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
        >>> posture = rnc.control.Posture(task, rnc.planning.Hold([0.5]), k=2.0)
        >>> both = rnc.control.Combined([posture, posture])
        >>> measurement = reduced.at(robot.configuration({"joint_2": 1.8}), np.zeros(3)).measure()
        >>> z, z_dot = both(0.0, measurement)
        >>> z  # twice k times the error
        array([2.])
    """

    def __init__(self, parts: Sequence[Secondary]) -> None:
        if not parts:
            raise ConfigurationError("name at least one secondary objective")
        self.parts = tuple(parts)

    def describe(self) -> Description:
        """Return the descriptions of the objectives."""
        return {"type": type(self).__name__, "parts": [describe(part) for part in self.parts]}

    def __call__(self, t: float, measurement: Measurement) -> tuple[np.ndarray, np.ndarray]:
        each = [part(t, measurement) for part in self.parts]
        return sum(z for z, _ in each[1:]) + each[0][0], sum(z_dot for _, z_dot in each[1:]) + each[0][1]


class Posture(DescribedMixin):
    """Objective that keeps redundant outputs near a reference: ``z = x22d_dot + k (x22d - x22)``.

    Reads from the measurement: ``x2, v2``.

    Args:
        task: task that defines the redundant outputs.
        reference: of x22.
        k: gain [1/s]; a number or one for each output. 0 for outputs without a desired position.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce(
        ...     [rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")], [rnc.JointPosition("platform")])
        >>> task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
        >>> posture = rnc.control.Posture(task, rnc.planning.Hold([0.5]), k=2.0)
        >>> measurement = reduced.at(robot.configuration({"joint_2": 1.8}), np.zeros(3)).measure()
        >>> z, z_dot = posture(0.0, measurement)
        >>> z, z_dot + 0.0  # k times the error, and its rate at rest
        (array([1.]), array([0.]))
    """

    described = ("k",)

    def __init__(self, task: Task, reference: Reference, k: float | np.ndarray = 1.0) -> None:
        check_size(reference, len(task.redundant), "redundant")
        self._task, self.reference, self.k = task, reference, _one_each(k, task)
        self._follow = Feedback(task.redundant_coordinates, self.k)

    def __call__(self, t: float, measurement: Measurement) -> tuple[np.ndarray, np.ndarray]:
        redundant = self._task.redundant
        x22, v22 = measurement.x2[..., redundant], measurement.v2[..., redundant]
        return self._follow(self.reference.at(t), x22, v22)


class JointLimits(DescribedMixin):
    """Objective that keeps joints away from their limits: descent on a potential that rises towards each limit.

    In a zone of width delta at each end the potential of a joint is ``s^3 / 3``. s is 0 at the start of the zone, 1 at
    the limit and larger beyond it. The potential is finite everywhere, twice differentiable, and the same for revolute
    and prismatic joints. Joints need not be outputs. With ``v = R v2`` and R22 the redundant columns of R,

        z = -k R22^T grad,        z_dot = -k (R22_dot^T grad + R22^T hess v),        both exact.

    A redundant output that is a joint leaves its own limit at the rate ``k / delta``. Its loop there has the rate
    ``2 k / delta^2``. This rate times the sampling interval has to stay below about 0.2. So give joints of short range
    a small k, or omit them from ``joints``.

    Reads from the measurement: ``q, v``.

    Args:
        reduced: the system.
        task: task that defines the redundant outputs.
        k: gain [m^2/s or rad^2/s]; a number or one for each redundant output.
        margin: width of the zone at each end as a share of the joint's range, up to 0.5.
        joints: names of joints; by default every joint with limits.

    Raises:
        ModelError: unknown joint.
        ConfigurationError: a named joint has no limits, no joint has limits, or k has the wrong size.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce(
        ...     [rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")], [rnc.JointPosition("platform")])
        >>> task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
        >>> limits = rnc.control.JointLimits(reduced, task, k=0.1, margin=0.1)
        >>> middle, end = (robot.configuration({"joint_1": angle, "joint_2": 1.8}) for angle in (0.0, 62.0))
        >>> measured = [reduced.at(q, np.zeros(3)).measure() for q in (middle, end)]
        >>> [bool(limits(0.0, each)[0] < 0) for each in measured]  # joint_1 leaves its limit of 62.8 rad
        [False, True]
    """

    described = ("k",)

    def __init__(
        self,
        reduced: ReducedModel,
        task: Task,
        k: float | np.ndarray = 0.1,
        margin: Annotated[float, Gt(0), Le(0.5)] = 0.1,
        joints: Annotated[Sequence[str], Len(1)] | None = None,
    ) -> None:
        if not 0 < margin <= 0.5:
            raise ConfigurationError(f"margin of joint limits has to be a share of the range, 0 to 0.5, found {margin}")
        limited = limited_positions(reduced.robot, joints)
        if not limited.q:
            raise ConfigurationError(f"no joint of robot '{reduced.robot.name}' has position limits")
        self._q, self._v = limited.q, limited.v
        self._reduced, self._redundant, self.k = reduced, task.redundant, _one_each(k, task)
        self._zone = margin * (limited.upper - limited.lower)
        self._begin_low, self._begin_high = limited.lower + self._zone, limited.upper - self._zone

    def describe(self) -> Description:
        """Return the gain, and the widths of the zones [rad or m]."""
        return {**super().describe(), "zone": listed(self._zone)}

    def __call__(self, t: float, measurement: Measurement) -> tuple[np.ndarray, np.ndarray]:
        q, v = measurement.q[..., self._q], measurement.v[..., self._v]
        over = np.maximum(q - self._begin_high, 0.0) / self._zone
        under = np.maximum(self._begin_low - q, 0.0) / self._zone
        gradient, hessian = (over**2 - under**2) / self._zone, 2.0 * (over + under) / self._zone**2
        state = self._reduced.at(measurement.q, v=measurement.v, t=t)
        J, J_dot = (each[..., self._v, :][..., self._redundant] for each in (state.R, state.R_dot))
        z_dot = apply_transposed(J_dot, gradient) + apply_transposed(J, hessian * v)
        return -self.k * apply_transposed(J, gradient), -self.k * z_dot


class SingularityDistance(DescribedMixin):
    """Objective that avoids singular configurations: ascent on ``w = log |det E| + log det(A4 A4^T) / 2``.

    First derivatives along the motion of each redundant output i are exact,

        dw/dx_i = tr(E^-1 E_i) + tr((A4 A4^T)^-1 A4_i A4^T),

    with ``E_i`` and ``A4_i`` the derivatives of E and A4 along column i of R, and ``z = k dw/dx22``. The manipulability
    of T. Yoshikawa, Int. J. Robotics Research 4(2), 1985, is ``sqrt(det(A4 A4^T))``. The rate of z needs second
    derivatives, which Pinocchio does not provide. So it is a central difference along the measured motion.

    Reads from the measurement: ``q, v``.

    Args:
        reduced: the system.
        task: its vertical and redundant outputs.
        k: gain [m^2/s or rad^2/s]; a number or one for each redundant output.

    Raises:
        SingularityError: the configuration at a sample is singular, so w has no gradient.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce(
        ...     [rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")], [rnc.JointPosition("platform")])
        >>> task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
        >>> away = rnc.control.SingularityDistance(reduced, task, k=0.1)
        >>> measurement = reduced.at(robot.configuration({"joint_2": 1.8}), np.zeros(3)).measure()
        >>> z, z_dot = away(0.0, measurement)
        >>> z.shape, (z_dot + 0.0).round(6)  # at rest the objective does not change
        ((1,), array([0.]))
    """

    described = ("k",)

    def __init__(self, reduced: ReducedModel, task: Task, k: float | np.ndarray = 0.1) -> None:
        self._reduced, self._task, self.k = reduced, task, _one_each(k, task)

    def gradient(self, q: np.ndarray) -> np.ndarray:
        """Return dw/dx22 (..., r2) at configurations (..., nq)."""
        here, task = self._reduced.at(q), self._task
        A4 = here.A_star[..., task.vertical, :][..., task.redundant]
        along = kinematic_gradient(here, task.redundant)[..., task.vertical, :, :][..., task.redundant, :]
        try:
            weights = np.linalg.solve(A4 @ A4.mT, A4)
        except np.linalg.LinAlgError:
            raise SingularityError(
                "redundant outputs cannot move the vertical ones (A4 is singular)",
                q=q[(0,) * (q.ndim - 1)],
                condition=np.inf,
                rows=(*task.vertical_names, *task.redundant_names),
            ) from None
        return log_determinant_gradient(here, task.redundant) + np.einsum("...kr,...krs->...s", weights, along)

    def __call__(self, t: float, measurement: Measurement) -> tuple[np.ndarray, np.ndarray]:
        q, v = measurement.q, measurement.v
        h = _STEP / (1.0 + np.abs(v).max())
        ahead, behind = (self.gradient(self._moved(q, sign * h * v)) for sign in (1.0, -1.0))
        return self.k * self.gradient(q), self.k * (ahead - behind) / (2 * h)

    def _moved(self, q: np.ndarray, step: np.ndarray) -> np.ndarray:
        return over_states(partial(pin.integrate, self._reduced.robot.model), q.shape[-1:], q, step)


def _one_each(k: float | np.ndarray, task: Task) -> np.ndarray:
    gains, size = np.asarray(k, dtype=float), len(task.redundant)
    if gains.shape not in ((), (size,)) or not (gains >= 0).all():
        raise ConfigurationError(f"k of a secondary objective has to be a number or {size}, not negative, found {k}")
    return gains
