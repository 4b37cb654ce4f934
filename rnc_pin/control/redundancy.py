"""Redundant outputs control the vertical outputs: by their rates in class 1, paper (12), or by steering in class 2s."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rnc_pin.control.controller import DescribedMixin, Description, VelocityTarget, check_size, describe, goals_at
from rnc_pin.control.feedback import Feedback
from rnc_pin.control.gain_design import DEFAULT_OUTER_GAINS, OuterGains
from rnc_pin.control.slithering import DrivenPath, SlitheringReference
from rnc_pin.errors import ConfigurationError, InputError, SingularityError
from rnc_pin.math.linear_algebra import apply, apply_transposed, as_slice, clipped, solve, unit_rows
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import kinematic_gradient
from rnc_pin.model.task import Task
from rnc_pin.references.reference import Reference, ReferencePoint

Secondary = Callable[[float, Measurement], tuple[np.ndarray, np.ndarray]]
"""Function that returns desired rates z of the redundant outputs (..., r2), and the derivative of z."""


class RedundancyController(DescribedMixin):
    """``v22d = A4^-1 (x1d_dot + k3 (x1d - x1) - A3 v21d)``, paper (12), with its exact rate.

    The rate of the redundant outputs lets the vertical outputs follow their reference, while the primary outputs follow
    theirs. The paper uses feedforward only, ``v21d = x21d_dot``. Then x21 drifts with the errors of the inner loop;
    ``k21`` closes that loop (0 is the paper).

    Default gains come from ``gain_design.OuterGains``. ``simulation.preflight`` rolls the law out with them, while
    scenario files choose their own (``scenario/controllers/tracking.py``). ``simulation.batch`` calls ``step`` with a
    leading axis of runs.

    Reads from the measurement: ``x1, x2, v1, v2, A_star, A_star_dot``, and ``v1_offset`` with affine constraints.

    Args:
        task: the outputs; at least as many redundant as vertical.
        primary: reference of x21.
        vertical: reference of x1.
        k3: [1/s], of the vertical outputs; a number or one for each.
        k21: [1/s], of the primary outputs; a number or one for each.
        secondary: desired rates for the remaining freedom, such as a ``Posture``; by default the redundant outputs stay
            slow.

    Raises:
        ConfigurationError: the task has fewer redundant than vertical outputs, a reference has another size than
            its outputs, or a secondary objective has no freedom left.
        SingularityError: A4 is singular at a sample.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce(
        ...     [rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")], [rnc.JointPosition("platform")])
        >>> task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
        >>> measurement = reduced.at(robot.configuration({"joint_2": 1.8}), np.zeros(3)).measure()
        >>> here = rnc.planning.Hold(measurement.x2[:2])
        >>> controller = rnc.control.RedundancyController(task, here, rnc.planning.Hold([0.1]), k3=2.0)
        >>> target, state = controller.step(0.0, measurement, controller.initial_state(measurement))
        >>> (measurement.A_star @ target.v2).round(6)  # the platform turns at k3 times its error
        array([0.2])
    """

    described = ("k3", "k21")

    def __init__(
        self,
        task: Task,
        primary: Reference,
        vertical: Reference,
        k3: float | np.ndarray = DEFAULT_OUTER_GAINS.k3,
        k21: float | np.ndarray = DEFAULT_OUTER_GAINS.k21,
        secondary: Secondary | None = None,
    ) -> None:
        # (12) solves for v22: with fewer redundant than vertical outputs it has no solution.
        outputs = task.redundant_names, task.vertical_names
        counts = " and ".join(f"{len(names)} ({', '.join(names) or 'none'})" for names in outputs)
        if not 0 < len(task.vertical) <= len(task.redundant):
            raise ConfigurationError(
                f"the class-1 controller needs as many redundant as vertical outputs, found {counts}"
            )
        check_size(primary, len(task.primary), "primary")
        check_size(vertical, len(task.vertical), "vertical")
        self.task, self.primary, self.vertical = task, primary, vertical
        self.k3, self.k21 = k3, k21
        self._follow_primary = Feedback(task.primary_coordinates, k21)
        self._follow_vertical = Feedback(task.vertical_coordinates, k3)
        self._x1, self._x21, self._x22 = map(as_slice, (task.vertical, task.primary, task.redundant))
        # A square A4 leaves nothing to choose.
        if secondary is not None and len(task.redundant) <= len(task.vertical):
            raise ConfigurationError(
                f"a secondary objective has no freedom left: needs more redundant than vertical outputs, found {counts}"
            )
        self.secondary = secondary

    def describe(self) -> Description:
        """Return the gains, and the secondary objective if there is one."""
        secondary = {} if self.secondary is None else {"secondary": describe(self.secondary)}
        return {**super().describe(), **secondary}

    def initial_state(self, measurement: Measurement) -> None:
        """Return None: the controller has no state.

        Args:
            measurement: first measurement.
        """

    def step(self, t: float, measurement: Measurement, state: None = None) -> tuple[VelocityTarget, None]:
        m, x21d, x1d = measurement, self.primary.at(t), self.vertical.at(t)
        v21, v21_dot = self._follow_primary(x21d, m.x2[..., self._x21], m.v2[..., self._x21])
        wanted, wanted_dot = self._follow_vertical(x1d, m.x1[..., self._x1], m.v1[..., self._x1])
        if m.v1_offset is not None:  # rates of the vertical outputs at v2 = 0
            wanted = wanted - m.v1_offset[..., self._x1]
        if m.v1_offset_dot is not None:
            wanted_dot = wanted_dot - m.v1_offset_dot[..., self._x1]
        A3, A3_dot = (each[..., self._x1, :][..., self._x21] for each in (m.A_star, m.A_star_dot))
        # Vertical rates are A3 v21 + A4 v22: what primary motions cause is left to no redundant one.
        wanted = wanted - apply(A3, v21)
        wanted_dot = wanted_dot - apply(A3_dot, v21) - apply(A3, v21_dot)
        v22, v22_dot = self._redundant_rates(t, wanted, wanted_dot, m)
        v2, v2_dot = np.empty((2, *v22.shape[:-1], self.task.r))
        v2[..., self._x21], v2[..., self._x22] = v21, v22
        v2_dot[..., self._x21], v2_dot[..., self._x22] = v21_dot, v22_dot
        x1 = goals_at(x1d.position, self._x1, (*v2.shape[:-1], m.x1.shape[-1]))
        return VelocityTarget(v2, v2_dot, x1, goals_at(x21d.position, self._x21, v2.shape)), None

    def _redundant_rates(
        self, t: float, wanted: np.ndarray, wanted_dot: np.ndarray, m: Measurement
    ) -> tuple[np.ndarray, np.ndarray]:
        """Solution v22 of ``A4 v22 = wanted``, and its exact rate.

        For a wide A4 it is the nearest to the secondary rates z: ``v22 = z + A4^T y``, ``A4 A4^T y = wanted - A4 z``.
        """
        A4, A4_dot = (each[..., self._x1, :][..., self._x22] for each in (m.A_star, m.A_star_dot))
        if len(self.task.redundant) == len(self.task.vertical):
            v22 = self._solve(A4, wanted, m)
            # The derivative of A4 v22 = wanted has the same matrix.
            return v22, self._solve(A4, wanted_dot - apply(A4_dot, v22), m)
        z = z_dot = np.zeros(len(self.task.redundant))
        if self.secondary is not None:
            z, z_dot = self.secondary(t, m)
        # The least change of the secondary rates: a pseudo-inverse with a rate in closed form.
        S = A4 @ A4.mT
        y = self._solve(S, wanted - apply(A4, z), m)
        S_dot = A4_dot @ A4.mT + A4 @ A4_dot.mT
        y_dot = self._solve(S, wanted_dot - apply(A4_dot, z) - apply(A4, z_dot) - apply(S_dot, y), m)
        return z + apply(A4.mT, y), z_dot + apply(A4_dot.mT, y) + apply(A4.mT, y_dot)

    def _solve(self, A4: np.ndarray, right: np.ndarray, measurement: Measurement) -> np.ndarray:
        solution = solve(A4, right)
        sizes = np.abs(solution)
        largest_rate = 1e8  # beside the right side: A4 is singular to rounding where a solution exceeds it
        # One comparison for all runs on the usual way.
        if sizes.max() < largest_rate:
            return solution
        fine = sizes.max(axis=-1) < largest_rate * (1 + np.abs(right).max(axis=-1))
        if fine.all():
            return solution
        run = np.unravel_index(np.argmin(fine), fine.shape)
        A4 = A4[run]
        raise SingularityError(
            "redundant outputs cannot move the vertical ones (A4 is singular)",
            q=np.zeros(0) if measurement.q is None else np.array(measurement.q[run]),
            # A single number has the condition number 1, which says nothing: its inverse does.
            condition=float(np.linalg.cond(unit_rows(A4)) if len(A4) > 1 else 1 / max(np.abs(A4).min(), 1e-300)),
            rows=(*self.task.vertical_names, *self.task.redundant_names),
        )


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

    def __init__(self, task: Task, reference: Reference, k: float | Sequence[float] | np.ndarray = 1.0) -> None:
        check_size(reference, len(task.redundant), "redundant")
        size = len(task.redundant)
        self._task, self.reference, self.k = task, reference, np.asarray(k, dtype=float)
        # A negative gain would drive the outputs away from their reference.
        if self.k.shape not in ((), (size,)) or not (self.k >= 0).all():
            raise ConfigurationError(f"k of a posture has to be a number or {size}, not negative, found {k}")
        self._follow = Feedback(task.redundant_coordinates, self.k)

    def __call__(self, t: float, measurement: Measurement) -> tuple[np.ndarray, np.ndarray]:
        redundant = self._task.redundant
        x22, v22 = measurement.x2[..., redundant], measurement.v2[..., redundant]
        return self._follow(self.reference.at(t), x22, v22)


class SteeringController(DescribedMixin):
    """Class 2s: backstepping for ``x11dot = A3(x, x22) v21``. As A4 = 0, the angles of x22, not their rates, move x11.

    The paper puts its fire truck into class 2, but there (13) has no matrix to invert: A4 = 0. The desired rate is
    ``w = x11d_dot + k3 (x11d - x11)``. The redundant outputs move so that the error ``w - A3 v21`` decays at ``k4``,

        N v22 = wdot + k4 (w - A3 v21) - (A3 v21)dot at rest of x22,      N = d(A3 v21)/dx22,

    with N from the exact gradient of A_star. N vanishes with v21, because a standing vehicle cannot be steered. Near
    v21 = 0 the inverse is damped, and x22 rests.

    Redundant rates stay below 4 rad/s. The gain from noise of the vertical outputs to them is at most
    ``k3 k4 / 0.2``.

    Reads from the measurement: ``q, v2, v1, x1, x2, A_star, A_star_dot``.

    Args:
        reduced: model that provides the kinematics.
        task: task with as many redundant as vertical outputs; the latter are x11.
        primary: reference of x21.
        vertical: reference of x11 in time, or a ``SlitheringReference``.
        gains: ``k3`` of the vertical outputs, ``k4`` of their rates, ``k21`` of the primary outputs [1/s].
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

    described = ("k3", "k4", "k21")

    def __init__(
        self,
        reduced: ReducedModel,
        task: Task,
        primary: Reference,
        vertical: Reference | SlitheringReference,
        gains: OuterGains = DEFAULT_OUTER_GAINS,
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
        self.k3, self.k4, self.k21 = gains.k3, gains.k4, gains.k21
        self.monitored = monitored
        self._follow_primary = Feedback(task.primary_coordinates, gains.k21)
        self._follow_vertical = Feedback(task.vertical_coordinates, gains.k3)

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
        gradient = kinematic_gradient(self._reduced.at(m.q), task.redundant)
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
        v2[..., task.redundant] = self._redundant_rates(m, gradient, v21d_dot, x11d)
        x1 = goals_at(x11d.position, task.vertical, m.x1.shape)
        if self.monitored is not None:
            x1[..., self.monitored[0]] = self.monitored[1].at(t).position
        return VelocityTarget(v2=v2, v2_dot=v2_dot, x1=x1, x2=goals_at(x21d.position, task.primary, m.x2.shape)), state

    def _redundant_rates(
        self, m: Measurement, gradient: np.ndarray, v21d_dot: np.ndarray, x11d: ReferencePoint
    ) -> np.ndarray:
        """Redundant rates (..., a)."""
        task = self.task
        v21, v22_now = m.v2[..., task.primary], m.v2[..., task.redundant]
        A3, A3_dot = (each[..., task.vertical, :][..., task.primary] for each in (m.A_star, m.A_star_dot))
        # By exact slopes of A_star: difference quotients would cost evaluations and digits.
        N = apply_transposed(gradient[..., task.vertical, :, :][..., task.primary, :], v21[..., None, :])
        rate = apply(A3, v21)
        wanted, wanted_dot = self._follow_vertical(x11d, m.x1[..., task.vertical], rate)
        # The rate of A3 v21 contains N v22 at the present steering rates. It is taken out: v22 is solved for.
        without = apply(A3_dot, v21) - apply(N, v22_now) + apply(A3, v21d_dot)
        right = wanted_dot + self.k4 * (wanted - rate) - without
        # Damped least squares: where N vanishes, at rest, the rates vanish instead of growing. For a single output they
        # are N / (N^2 + damping^2) times the right side: at most 1 / (2 damping), at N = damping.
        damping = 0.1
        v22 = solve(N.mT @ N + damping**2 * np.eye(len(task.redundant)), apply_transposed(N, right))
        largest = 4.0  # [rad/s or m/s]: near rest, the damped rates may still be larger than actuators give
        return clipped(v22, largest)
