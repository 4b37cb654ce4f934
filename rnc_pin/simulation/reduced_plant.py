"""Plant that integrates the reduced model."""

from __future__ import annotations

import numpy as np

from rnc_pin.errors import DivergenceError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.simulation.dissipative_step import DissipativeStep
from rnc_pin.simulation.dry_friction import DryFriction
from rnc_pin.simulation.lie_runge_kutta import LieRungeKutta4
from rnc_pin.simulation.moving_plant import MovingPlant
from rnc_pin.simulation.plant import NOTHING_BESIDE, Plant


class ReducedPlant:
    """Plant that satisfies its constraints exactly, with exact measurements.

    A fourth-order Lie-group integrator runs in charts of the constraints, which are regular if the constraints have
    constant rank. After each ``advance`` a projection removes the drift of holonomic rows, such as wheel height and
    loop closure. The correction has zero momentum along the admissible velocities.

    Args:
        reduced: reduced model.
        plant: effects that the model does not include.
        substeps: integration steps per call of ``advance``.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> push = [rnc.FrameForce("sleigh", "x")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], push)
        >>> plant = rnc.simulation.ReducedPlant(system.reduce())
        >>> plant.reset(robot.configuration(), np.zeros(3))
        >>> plant.apply(np.array([2.0]))
        >>> plant.advance(0.01)
        >>> bool(plant.read()[1][0] > 0)
        True
    """

    def __init__(self, reduced: ReducedModel, plant: Plant = NOTHING_BESIDE, substeps: int = 1) -> None:
        self.reduced = reduced
        self._moving, self._substeps = MovingPlant(reduced, plant), substeps
        self._integrator = LieRungeKutta4(reduced.robot)
        self._dissipative = DissipativeStep(self._moving, DryFriction(reduced, plant.joint_friction))
        self.applied = np.zeros(reduced.p)
        self._q: np.ndarray
        self._y: np.ndarray
        self._seen: StateEvaluation | None = None

    def reset(self, q: np.ndarray, v: np.ndarray) -> None:
        """Set the state; the part of v that violates the constraints is removed."""
        self._q, self._y = q, self._moving.start(q, v)
        self.applied, self._seen = np.zeros(self.reduced.p), None

    @property
    def state(self) -> StateEvaluation:
        """State in the reduction of the model.

        Raises:
            DivergenceError: the state is not finite.
        """
        if self._seen is None:
            if not np.isfinite(self._y).all():
                raise DivergenceError("plant velocities are not finite")
            self._seen, self._y = self._moving.settled(self._q, self._y)
        return self._seen

    @property
    def integrals(self) -> np.ndarray:
        """Integrals of the reducing velocities since the start, (r,)."""
        return self._moving.integrals(self._y)

    @property
    def work(self) -> float:
        """Work of actuators and rheonomic constraints, minus the dissipation of damping and friction [J]."""
        return float(self._y[-1])

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Configuration (nq,) and velocity (nv,)."""
        return self.state.q.copy(), self.state.v.copy()

    def apply(self, T: np.ndarray) -> None:
        """Hold the inputs (p,), clipped to the actuator limits; ``applied`` has the result."""
        self.applied = self._moving.saturate(T)

    def set_actuator_friction(self, limit: float) -> None:
        """Set the dry friction limit of every actuator [N or N m]; ``applied`` does not include it."""
        self._dissipative.friction.set_actuators(limit)

    @property
    def external(self) -> np.ndarray | None:
        """Current generalized forces (nv,) of damping and friction; None without them."""
        if not self._dissipative.needed:
            return None
        damped = self._moving.damping_force(self.state)
        force = np.zeros(self.reduced.n) if damped is None else damped
        if len(self._dissipative.friction.limits):
            force += self._dissipative.rubbing(self._q, self._y, self.applied)
        return force

    def advance(self, dt: float) -> None:
        """Integrate over a time dt [s].

        Raises:
            DivergenceError: velocities or accelerations are not finite.
        """
        state, q, y, h = self.state, self._q, self._y, dt / self._substeps
        if self._dissipative.needed:
            for _ in range(self._substeps):
                q, y = self._dissipative.advance(q, y, self.applied, h)
        else:
            rate, first = self._moving.rate(self.applied), self._moving.first_slope(state, self.applied)
            for substep in range(self._substeps):
                q, y = self._integrator.step(rate, q, y, h, None if substep else first)
        if self.reduced.assembly.size and np.isfinite(q).all():  # otherwise the next access to ``state`` raises
            q = self.reduced.assembly.project(q)
        self._q, self._y, self._seen = q, y, None
