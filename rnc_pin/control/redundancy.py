"""Class 1: redundant outputs control the vertical outputs. Paper (12)."""

from __future__ import annotations

import numpy as np

from rnc_pin.control.controller import (
    DescribedMixin,
    Description,
    VelocityTarget,
    check_size,
    describe,
    goals_at,
    listed,
)
from rnc_pin.control.feedback import Feedback
from rnc_pin.control.gain_design import DEFAULT_OUTER_GAINS
from rnc_pin.control.secondary import Secondary
from rnc_pin.errors import ConfigurationError, SingularityError, short_text
from rnc_pin.math.linear_algebra import apply, as_slice, condition_number, solve
from rnc_pin.model.reduced_kinematics import Measurement
from rnc_pin.model.task import Task
from rnc_pin.planning.references import Reference, ReferencePoint

_LIMIT = 1e8


_Secondary = tuple[np.ndarray | None, np.ndarray | None]
"""Secondary rates of the redundant outputs and their rates, (..., c) each; None without an objective."""
_NONE: _Secondary = (None, None)


def check_freedom(task: Task) -> None:
    """Raise an error for a secondary objective if A4 is square."""
    if len(task.redundant) <= len(task.vertical):
        raise ConfigurationError(
            "a secondary objective has no freedom left: needs more redundant than vertical outputs, found "
            f"{len(task.redundant)} ({', '.join(task.redundant_names) or 'none'}) and {len(task.vertical)} "
            f"({', '.join(task.vertical_names) or 'none'})"
        )


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
        weights: cost of the rate of each redundant output, if there are more redundant than vertical outputs.
        secondary: secondary objective for the remaining freedom, from ``control.secondary``; by default the redundant
            outputs stay slow.

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
        weights: np.ndarray | None = None,
        secondary: Secondary | None = None,
    ) -> None:
        if not isinstance(task, Task):
            raise ConfigurationError(f"task: expected a Task, see rnc.Task.of, found {short_text(task)}")
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
        self._weights = np.ones(len(task.redundant)) if weights is None else np.asarray(weights, dtype=float)
        if self._weights.shape != (len(task.redundant),) or not ((self._weights > 0) & (self._weights < np.inf)).all():
            raise ConfigurationError(f"weights have to be {len(task.redundant)} positive numbers")
        self._cheap = 1.0 / self._weights
        self._x1, self._x21, self._x22 = map(as_slice, (task.vertical, task.primary, task.redundant))
        if secondary is not None:
            check_freedom(task)
        self.secondary = secondary

    def describe(self) -> Description:
        """Return the gains; for a wide A4 also the weights and the secondary objective."""
        wide = len(self.task.redundant) > len(self.task.vertical)
        weights = {"weights": listed(self._weights)} if wide else {}
        secondary = {} if self.secondary is None else {"secondary": describe(self.secondary)}
        return {**super().describe(), **weights, **secondary}

    def initial_state(self, measurement: Measurement) -> None:
        """Return None: the controller has no state."""

    def step(self, t: float, measurement: Measurement, state: None = None) -> tuple[VelocityTarget, None]:
        x21d, x1d = self.primary.at(t), self.vertical.at(t)
        secondary = _NONE if self.secondary is None else self.secondary(t, measurement)
        return self._target(x21d, x1d, secondary, measurement), None

    def _target(
        self, x21d: ReferencePoint, x1d: ReferencePoint, secondary: _Secondary, m: Measurement
    ) -> VelocityTarget:
        task = self.task
        v21, v21_dot = self._follow_primary(x21d, m.x2[..., self._x21], m.v2[..., self._x21])
        wanted, wanted_dot = self._follow_vertical(x1d, m.x1[..., self._x1], m.v1[..., self._x1])
        if m.v1_offset is not None:  # rates of the vertical outputs at v2 = 0
            wanted = wanted - m.v1_offset[..., self._x1]
        if m.v1_offset_dot is not None:
            wanted_dot = wanted_dot - m.v1_offset_dot[..., self._x1]
        v2, v2_dot = self._solved((v21, v21_dot), (wanted, wanted_dot), secondary, m)
        batch = v2.shape[:-1]
        return VelocityTarget(
            v2=v2,
            v2_dot=v2_dot,
            x1=goals_at(x1d.position, self._x1, (*batch, m.x1.shape[-1])),
            x2=goals_at(x21d.position, self._x21, (*batch, task.r)),
        )

    def _solved(
        self,
        primary: tuple[np.ndarray, np.ndarray],
        vertical: tuple[np.ndarray, np.ndarray],
        secondary: _Secondary,
        m: Measurement,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Rates v2 and v2_dot (..., r), from the wanted rates of the outputs and their derivatives, (..., k) each.

        Those of the vertical outputs do not contain their rates at ``v2 = 0``.
        """
        task, (v21, v21_dot), (wanted, wanted_dot), (z, z_dot) = self.task, primary, vertical, secondary
        A, A_dot = m.A_star[..., self._x1, :], m.A_star_dot[..., self._x1, :]
        A3, A4 = A[..., self._x21], A[..., self._x22]
        A3_dot, A4_dot = A_dot[..., self._x21], A_dot[..., self._x22]
        wanted = wanted - apply(A3, v21)
        wanted_dot = wanted_dot - apply(A3_dot, v21) - apply(A3, v21_dot)
        if len(task.redundant) == len(task.vertical):
            v22 = self._solve(A4, wanted, m)
            v22_dot = self._solve(A4, wanted_dot - apply(A4_dot, v22), m)
        else:
            nothing = np.zeros(len(task.redundant))
            z, z_dot = (nothing, nothing) if z is None or z_dot is None else (z, z_dot)
            v22, v22_dot = self._spread_out(A4, A4_dot, wanted, wanted_dot, z, z_dot, m)
        return self._merge(v21, v22), self._merge(v21_dot, v22_dot)

    def _merge(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        whole = np.empty((*second.shape[:-1], self.task.r))
        whole[..., self._x21], whole[..., self._x22] = first, second
        return whole

    def _spread_out(
        self,
        A4: np.ndarray,
        A4_dot: np.ndarray,
        wanted: np.ndarray,
        wanted_dot: np.ndarray,
        z: np.ndarray,
        z_dot: np.ndarray,
        m: Measurement,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Solution v22 of ``A4 v22 = wanted`` with least cost of ``v22 - z``, and its exact rate; z is secondary.

        ``v22 = z + W^-1 A4^T y`` with ``S y = wanted - A4 z`` and ``S = A4 W^-1 A4^T``.
        """
        back = self._cheap[:, None] * A4.mT  # W^-1 A4^T
        back_dot = self._cheap[:, None] * A4_dot.mT
        S = A4 @ back
        y = self._solve(S, wanted - apply(A4, z), m)
        S_dot = A4_dot @ back + A4 @ back_dot
        y_dot = self._solve(S, wanted_dot - apply(A4_dot, z) - apply(A4, z_dot) - apply(S_dot, y), m)
        return z + apply(back, y), z_dot + apply(back_dot, y) + apply(back, y_dot)

    def _solve(self, A4: np.ndarray, right: np.ndarray, measurement: Measurement) -> np.ndarray:
        solution = solve(A4, right)
        sizes = np.abs(solution)
        if sizes.max() < _LIMIT:
            return solution
        fine = sizes.max(axis=-1) < _LIMIT * (1 + np.abs(right).max(axis=-1))
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
