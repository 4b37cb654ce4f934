"""What the real machine has and the controllers are not told: damping and limits."""

from __future__ import annotations

import numpy as np

from rnc_pin.errors import ConstraintError
from rnc_pin.model.reduction import ReducedModel
from rnc_pin.simulation.lie_runge_kutta import Rate


class Plant:
    """The reduced model, with what the URDF says of joint damping, effort and position limits switched on or off.

    Args:
        reduced: the model.
        joint_damping: let viscous joint damping act.
        actuator_limits: clip actuator inputs to their limits.
        position_limits: end the run where a joint leaves its range.

    Raises:
        ConstraintError: damping would act on a momentum that is said to be conserved.
    """

    def __init__(
        self,
        reduced: ReducedModel,
        joint_damping: bool = False,
        actuator_limits: bool = False,
        position_limits: bool = False,
    ) -> None:
        self.reduced = reduced
        model = reduced.robot.model
        self._limits = reduced.actuation.limits if actuator_limits else None
        self._damping: np.ndarray | None = None
        if joint_damping and np.any(model.damping):
            self._damping = np.array(model.damping)
            for block, *_ in reduced.constraints.places:
                if block.conserved is not None and self._damping[block.conserved].any():
                    raise ConstraintError(f"joint damping acts on {block.names[0]}, which is said to be conserved")
        self._ranges: list[tuple[str, int, float, float]] = []
        if position_limits:
            for name, joint in zip(reduced.robot.joint_names, list(model.joints)[1:], strict=True):
                if joint.nq == 1:
                    low, high = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
                    if low < high:
                        self._ranges.append((name, joint.idx_q, low, high))
        self._r = reduced.r

    def saturate(self, T: np.ndarray) -> np.ndarray:
        """Inputs that the actuators can give."""
        return T if self._limits is None else np.clip(T, -self._limits, self._limits)

    def rate(self, T: np.ndarray) -> Rate:
        """The rate of ``y = [v2, integrals of v2, work]`` under constant inputs, for an integrator."""
        flow, damping, r = self.reduced.flow, self._damping, self._r

        def rate(q: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            v2 = y[:r]
            v, v2_dot, power = flow(q, v2, T, damping)
            y_dot = np.empty_like(y)
            y_dot[:r], y_dot[r : 2 * r], y_dot[2 * r] = v2_dot, v2, power
            return v, y_dot

        return rate

    def joint_beyond_range(self, q: np.ndarray) -> str | None:
        """A joint that left its range, in words."""
        for name, index, low, high in self._ranges:
            if not low <= q[index] <= high:
                return f"joint '{name}' left its range [{low:g}, {high:g}]: {q[index]:.4g}"
        return None
