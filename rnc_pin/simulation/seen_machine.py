"""Adapter between a plant and a simulation: true state and measured state."""

from __future__ import annotations

import numpy as np

from rnc_pin.errors import DivergenceError
from rnc_pin.loop import ControlLoop
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants import Machine
from rnc_pin.simulation.reduced_plant import ReducedPlant

_NOTHING = np.zeros(0)


class SeenMachine:
    """Adapter of a plant: its state in the outputs of a model.

    These attributes of a plant are optional:

    * ``actual()``: true configuration and velocity, if ``read()`` returns sensor values,
    * ``applied``: applied inputs,
    * ``work``: work since the start,
    * ``friction_used()``: friction use of the contacts ``wheel_names``,
    * ``reduced``: reduced model of the plant,
    * ``external``: generalized forces in addition to the inputs.

    Args:
        machine: the plant.
        reduced: reduced model of the controller.
    """

    def __init__(self, machine: Machine, reduced: ReducedModel) -> None:
        self.machine, self._reduced = machine, reduced
        self._exact = machine if isinstance(machine, ReducedPlant) and machine.reduced is reduced else None
        self._sensed: tuple[np.ndarray, np.ndarray] = (_NOTHING, _NOTHING)
        self.friction_names: tuple[str, ...] = tuple(getattr(machine, "wheel_names", ()))

    def look(self) -> StateEvaluation:
        """Read the sensors and return the true state. Call it once per sample.

        Raises:
            DivergenceError: the state is not finite.
        """
        if self._exact is not None:
            return self._exact.state
        self._sensed = self.machine.read()
        q, v = self.machine.actual() if hasattr(self.machine, "actual") else self._sensed
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise DivergenceError("plant state is not finite")
        return self._reduced.at(q, v=v)

    def decide(self, loop: ControlLoop, t: float) -> np.ndarray:
        """Return the inputs (p,) of a loop for the last measurement."""
        if self._exact is not None:
            return loop.compute_input(t, self._exact.state, self._exact.integrals)
        return loop.step(t, *self._sensed)

    def act(self, loop: ControlLoop, T: np.ndarray) -> np.ndarray:
        """Apply inputs to the plant, report the applied ones to the loop, and return them."""
        self.machine.apply(T)
        acting: np.ndarray = getattr(self.machine, "applied", T)
        loop.report_applied_input(acting)
        return acting

    @property
    def v_measured(self) -> np.ndarray:
        """Measured velocity (nv,); empty if measurements are exact."""
        return self._sensed[1]

    @property
    def work(self) -> float:
        """Work since the start [J]; NaN if the plant does not provide it."""
        return float(getattr(self.machine, "work", np.nan))

    @property
    def model(self) -> ReducedModel | None:
        """Reduced model of the plant; None if it has none."""
        return self._reduced if self._exact is not None else getattr(self.machine, "reduced", None)

    @property
    def external(self) -> np.ndarray | None:
        """Generalized forces (nv,) in addition to the inputs; None without them."""
        return getattr(self.machine, "external", None)

    @property
    def friction_used(self) -> np.ndarray:
        """Friction use (w,) of the contacts: friction force over its limit."""
        tell = getattr(self.machine, "friction_used", None)
        return _NOTHING if tell is None or not self.friction_names else np.asarray(tell())
