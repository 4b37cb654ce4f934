"""Class 1: redundant outputs control the vertical outputs. Paper (12)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rnc_pin.control.controller import DescribedMixin, Description, VelocityTarget, check_size, describe, goals_at
from rnc_pin.control.feedback import Feedback
from rnc_pin.control.gain_design import DEFAULT_OUTER_GAINS
from rnc_pin.errors import ConfigurationError, SingularityError
from rnc_pin.math.linear_algebra import apply, as_slice, condition_number, solve
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.task import Task
from rnc_pin.references.reference import Reference

Secondary = Callable[[float, Measurement], tuple[np.ndarray, np.ndarray]]
"""Function that returns desired rates z of the redundant outputs (..., r2), and the derivative of z."""


class RedundancyController(DescribedMixin):
    """``v22d = A4^-1 (x1d_dot + k3 (x1d - x1) - A3 v21d)``, paper (12), with its exact rate.

    The rate of the redundant outputs lets the vertical outputs follow their reference, while the primary outputs follow
    theirs. The paper uses feedforward only, ``v21d = x21d_dot``. Then x21 drifts with the errors of the inner loop;
    ``k21`` closes that loop (0 is the paper).

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
        if not 0 < len(task.vertical) <= len(task.redundant):
            raise ConfigurationError(
                f"the class-1 controller needs as many redundant as vertical outputs, found {len(task.redundant)} "
                f"({', '.join(task.redundant_names) or 'none'}) and {len(task.vertical)} "
                f"({', '.join(task.vertical_names) or 'none'})"
            )
        check_size(primary, len(task.primary), "primary")
        check_size(vertical, len(task.vertical), "vertical")
        self.task, self.primary, self.vertical = task, primary, vertical
        self.k3, self.k21 = k3, k21
        self._follow_primary = Feedback(task.primary_coordinates, k21)
        self._follow_vertical = Feedback(task.vertical_coordinates, k3)
        self._x1, self._x21, self._x22 = map(as_slice, (task.vertical, task.primary, task.redundant))
        if secondary is not None and len(task.redundant) <= len(task.vertical):
            raise ConfigurationError(
                "a secondary objective has no freedom left: needs more redundant than vertical outputs, found "
                f"{len(task.redundant)} ({', '.join(task.redundant_names) or 'none'}) and {len(task.vertical)} "
                f"({', '.join(task.vertical_names) or 'none'})"
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
            condition=float(condition_number(A4) if len(A4) > 1 else 1 / max(np.abs(A4).min(), 1e-300)),
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
        if self.k.shape not in ((), (size,)) or not (self.k >= 0).all():
            raise ConfigurationError(f"k of a posture has to be a number or {size}, not negative, found {k}")
        self._follow = Feedback(task.redundant_coordinates, self.k)

    def __call__(self, t: float, measurement: Measurement) -> tuple[np.ndarray, np.ndarray]:
        redundant = self._task.redundant
        x22, v22 = measurement.x2[..., redundant], measurement.v2[..., redundant]
        return self._follow(self.reference.at(t), x22, v22)
