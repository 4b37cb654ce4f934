"""Class 2s: redundant outputs that steer. As A4 = 0, their angle, not their rate, moves the vertical outputs."""

from __future__ import annotations

import numpy as np

from rnc_pin.control.controller import DescribedMixin, VelocityTarget, check_size, goals_at
from rnc_pin.control.feedback import Feedback
from rnc_pin.control.gain_design import DEFAULT_OUTER_GAINS, OuterGains
from rnc_pin.control.slithering import DrivenPath, SlitheringReference
from rnc_pin.errors import ConfigurationError, InputError, SingularityError
from rnc_pin.math.linear_algebra import apply, apply_transposed, clipped, solve
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import Task
from rnc_pin.references.reference import Reference, ReferencePoint


class SteeringController(DescribedMixin):
    """Backstepping for ``x11dot = A3(x, x22) v21``.

    The paper puts its fire truck into class 2, but there (13) has no matrix to invert: A4 = 0. The desired rate is
    ``w = x11d_dot + k3 (x11d - x11)``. The redundant outputs move so that the error ``w - A3 v21`` decays at ``k4``,

        N v22 = wdot + k4 (w - A3 v21) - (A3 v21)dot at rest of x22,      N = d(A3 v21)/dx22,

    with N from the exact gradient of A_star. N vanishes with v21, because a standing vehicle cannot be steered. Near
    v21 = 0 the inverse is damped, and x22 rests.

    Reads from the measurement: ``q, v2, v1, x1, x2, A_star, A_star_dot``.

    Args:
        reduced: model that provides the kinematics.
        task: task with as many redundant as vertical outputs; the latter are x11.
        primary: reference of x21.
        vertical: reference of x11 in time, or a ``SlitheringReference``.
        gains: ``k3`` of the vertical outputs, ``k4`` of their rates, ``k21`` of the primary outputs [1/s].
        damping: value of N below which steering fades out. The gain from noise of the vertical outputs to rates of the
            redundant outputs is at most ``k3 k4 / (2 damping)``.
        max_rate: largest rate of the redundant outputs.
        monitored: indices in x1 and reference of vertical outputs, driven by the primary outputs only (x12);
            for the record only.

    Raises:
        ConfigurationError: the numbers of redundant and vertical outputs differ, A4 is not zero, or the constraints are
            affine.

    Example:
        >>> robot = rnc.Robot.from_urdf("fire_truck.urdf", base="planar")
        >>> axles, joints = ("front_axle", "tractor_axle", "rear_axle"), ["front_steering", "rear_steering"]
        >>> constraints, actuators = [rnc.NoSideSlip(axle) for axle in axles], [rnc.FrameForce("tractor", "x"), *joints]
        >>> inputs = [rnc.FrameSpeed("tractor"), *(rnc.JointPosition(joint) for joint in joints)]
        >>> reduced = rnc.NonholonomicSystem(robot, constraints, actuators).reduce(inputs, [rnc.FrameYaw("trailer")])
        >>> task = rnc.Task.of(reduced, ["tractor_speed_x", "front_steering"], ["rear_steering"])
        >>> controller = rnc.control.SteeringController(
        ...     reduced, task, rnc.planning.Hold([1.0, 0.0]), rnc.planning.Hold([0.1]), rnc.control.OuterGains(k21=2.0))
        >>> measurement = reduced.at(robot.configuration(), np.zeros(3)).measure(np.zeros(3))
        >>> target, state = controller.step(0.0, measurement, controller.initial_state(measurement))
        >>> target.v2.round(6) + 0.0  # it drives off before it can steer
        array([2., 0., 0.])
    """

    described = ("k3", "k4", "k21", "damping", "max_rate")

    def __init__(
        self,
        reduced: ReducedModel,
        task: Task,
        primary: Reference,
        vertical: Reference | SlitheringReference,
        gains: OuterGains = DEFAULT_OUTER_GAINS,
        damping: float = 0.1,
        max_rate: float = 4.0,
        monitored: tuple[np.ndarray, Reference] | None = None,
    ) -> None:
        if len(task.redundant) != len(task.vertical) or not len(task.redundant):
            raise ConfigurationError(
                f"steering needs as many redundant as vertical outputs, found {len(task.redundant)} "
                f"and {len(task.vertical)}"
            )
        if reduced.affine:
            raise ConfigurationError("steering assumes A v = 0, and these constraints are affine (A v = mu)")
        check_size(primary, len(task.primary), "primary")
        check_size(vertical, len(task.vertical), "vertical")
        self._reduced, self.task, self.primary, self.vertical = reduced, task, primary, vertical
        self.k3, self.k4, self.k21, self.damping, self.max_rate = gains.k3, gains.k4, gains.k21, damping, max_rate
        self.monitored = monitored
        self._follow_primary = Feedback(task.primary_coordinates, gains.k21)
        self._follow_vertical = Feedback(task.vertical_coordinates, gains.k3)
        self._damped = damping**2 * np.eye(len(task.redundant))
        self._redundant = np.array(task.redundant, dtype=np.int64)

    def initial_state(self, measurement: Measurement) -> DrivenPath | None:
        """Return the state of the vertical reference, if any; raise an error if redundant rates move x11.

        Args:
            measurement: first measurement.
        """
        A4 = measurement.A_star[..., self.task.vertical, :][..., self.task.redundant]
        zero = 1e-9  # entries of A4 of the size of rounding
        if np.abs(A4).max() > zero:
            raise ConfigurationError(
                f"rates of {', '.join(self.task.redundant_names)} move {', '.join(self.task.vertical_names)} directly "
                "(A4 is not zero): use the class-1 controller"
            )
        return self.vertical.initial_state(measurement) if isinstance(self.vertical, SlitheringReference) else None

    def step(
        self, t: float, measurement: Measurement, state: DrivenPath | None = None
    ) -> tuple[VelocityTarget, DrivenPath | None]:
        task, m = self.task, measurement
        slopes = self._reduced.evaluator.output_slopes(m.q, self._redundant)
        if state is None and isinstance(self.vertical, SlitheringReference):
            raise InputError("steering along the driven path needs the last step's state, at first initial_state's")
        x21d = self.primary.at(t)
        v21d, v21d_dot = self._follow_primary(x21d, m.x2[..., task.primary], m.v2[..., task.primary])
        v2_dot = np.zeros(m.v2.shape)  # unknown for steering rates: it needs third derivatives of the references
        v2_dot[..., task.primary] = v21d_dot
        if isinstance(self.vertical, SlitheringReference):
            assert state is not None
            x11d, state = self.vertical.step(m, v2_dot, state)
        else:
            x11d = self.vertical.at(t)
        v2 = np.empty(m.v2.shape)
        v2[..., task.primary] = v21d
        v2[..., task.redundant] = self._redundant_rates(m, slopes, v21d_dot, x11d)
        x1 = goals_at(x11d.position, task.vertical, m.x1.shape)
        if self.monitored is not None:
            x1[..., self.monitored[0]] = self.monitored[1].at(t).position
        return VelocityTarget(v2=v2, v2_dot=v2_dot, x1=x1, x2=goals_at(x21d.position, task.primary, m.x2.shape)), state

    def _redundant_rates(
        self, m: Measurement, slopes: np.ndarray, v21d_dot: np.ndarray, x11d: ReferencePoint
    ) -> np.ndarray:
        """Redundant rates (..., a)."""
        task = self.task
        v21, v22_now = m.v2[..., task.primary], m.v2[..., task.redundant]
        A3, A3_dot = (each[..., task.vertical, :][..., task.primary] for each in (m.A_star, m.A_star_dot))
        N = apply(slopes[..., task.vertical, :][..., task.primary], v21[..., None, :]).mT
        rate = apply(A3, v21)
        wanted, wanted_dot = self._follow_vertical(x11d, m.x1[..., task.vertical], rate)
        without = apply(A3_dot, v21) - apply(N, v22_now) + apply(A3, v21d_dot)
        right = wanted_dot + self.k4 * (wanted - rate) - without
        # Damped least squares: where N vanishes, at rest, the rates vanish instead of growing.
        v22 = solve(N.mT @ N + self._damped, apply_transposed(N, right))
        fine = np.isfinite(v22).all(axis=-1)
        if not fine.all():
            run = np.unravel_index(np.argmin(fine), fine.shape)
            raise SingularityError(
                f"{', '.join(task.redundant_names)} cannot steer {', '.join(task.vertical_names)}: N is singular",
                q=np.array(m.q[run]),
                condition=np.inf,
                rows=(*task.vertical_names, *task.redundant_names),
            )
        # Near rest, N is small and the damped rates may still be larger than actuators give.
        return clipped(v22, self.max_rate)
