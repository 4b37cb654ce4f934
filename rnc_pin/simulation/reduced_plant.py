"""The reduced model as a machine."""

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
    """A machine that obeys its constraints exactly, and is measured exactly.

    It moves by a fourth-order Lie-group integrator in charts of its own, regular wherever the constraints have constant
    rank. What the integrator lets holonomic rows drift, wheels off the ground or loops apart, is removed whenever time
    has passed, along a correction that has no momentum in the motion that is left.

    Args:
        reduced: the model.
        plant: what takes part beside it.
        substeps: integration steps each time that ``advance`` is called.

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
        """Start again; of v what violates the constraints is left out."""
        self._q, self._y = q, self._moving.start(q, v)
        self.applied, self._seen = np.zeros(self.reduced.p), None

    @property
    def state(self) -> StateEvaluation:
        """The state as the model's outputs see it.

        Raises:
            DivergenceError: it has left all bounds.
        """
        if self._seen is None:
            if not np.isfinite(self._y).all():
                raise DivergenceError("velocities have no bound")
            self._seen, self._y = self._moving.settled(self._q, self._y)
        return self._seen

    @property
    def integrals(self) -> np.ndarray:
        """Integrals of the reducing velocities since the start, (r,)."""
        return self._moving.integrals(self._y)

    @property
    def work(self) -> float:
        """Work of actuators and of constraints that move, less what damping and friction took [J]."""
        return float(self._y[-1])

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Configuration (nq,) and velocity (nv,)."""
        return self.state.q.copy(), self.state.v.copy()

    def apply(self, T: np.ndarray) -> None:
        """Hold these inputs (p,), or what the actuators can give of them: ``applied``."""
        self.applied = self._moving.saturate(T)

    def set_actuator_friction(self, limit: float) -> None:
        """Let dry friction of this size work against every actuator [N or N m]; ``applied`` does not count it."""
        self._dissipative.friction.set_actuators(limit)

    @property
    def external(self) -> np.ndarray | None:
        """Generalized forces (nv,) of damping and friction now; None where nothing dissipates."""
        if not self._dissipative.needed:
            return None
        damped = self._moving.damping_force(self.state)
        force = np.zeros(self.reduced.n) if damped is None else damped
        if len(self._dissipative.friction.limits):
            force += self._dissipative.rubbing(self._q, self._y, self.applied)
        return force

    def advance(self, dt: float) -> None:
        """Let time pass [s].

        Raises:
            DivergenceError: velocities or accelerations have no bound.
        """
        state, q, y, h = self.state, self._q, self._y, dt / self._substeps
        if self._dissipative.needed:
            for _ in range(self._substeps):
                q, y = self._dissipative.advance(q, y, self.applied, h)
        else:
            rate, first = self._moving.rate(self.applied), self._moving.first_slope(state, self.applied)
            for substep in range(self._substeps):
                q, y = self._integrator.step(rate, q, y, h, None if substep else first)
        if self.reduced.assembly.size and np.isfinite(q).all():  # else diverged, which the next look says
            q = self.reduced.assembly.project(q)
        self._q, self._y, self._seen = q, y, None
