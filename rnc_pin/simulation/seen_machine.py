"""A machine as a simulation sees it: what is true beside what sensors say."""

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
    """Any machine, looked at through the outputs of a model.

    Of what a machine may say besides, this is read: ``actual()``, configuration and velocity where ``read()`` gives
    what sensors say; ``applied``, the inputs that act; ``work`` done so far; ``friction_used()``, of ``wheel_names``;
    ``reduced``, the model that moves, where it is one; ``external``, generalized forces beside the inputs.

    Args:
        machine: that moves.
        reduced: the model.
    """

    def __init__(self, machine: Machine, reduced: ReducedModel) -> None:
        self.machine, self._reduced = machine, reduced
        self._exact = machine if isinstance(machine, ReducedPlant) and machine.reduced is reduced else None
        self._sensed: tuple[np.ndarray, np.ndarray] = (_NOTHING, _NOTHING)
        self.friction_names: tuple[str, ...] = tuple(getattr(machine, "wheel_names", ()))

    def look(self) -> StateEvaluation:
        """The state as it is; once a sample, for sensors are read.

        Raises:
            DivergenceError: it has left all bounds.
        """
        if self._exact is not None:
            return self._exact.state
        self._sensed = self.machine.read()
        q, v = self.machine.actual() if hasattr(self.machine, "actual") else self._sensed
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise DivergenceError("the machine's state has no bound")
        return self._reduced.at(q, v=v)

    def decide(self, loop: ControlLoop, t: float) -> np.ndarray:
        """What a loop makes of what was seen."""
        if self._exact is not None:
            return loop.decide(t, self._exact.state, self._exact.integrals)
        return loop.step(t, *self._sensed)

    def act(self, loop: ControlLoop, T: np.ndarray) -> np.ndarray:
        """Give the machine inputs; those that act, which the loop is told as well."""
        self.machine.apply(T)
        acting: np.ndarray = getattr(self.machine, "applied", T)
        loop.acted(acting)
        return acting

    @property
    def v_measured(self) -> np.ndarray:
        """What sensors say, (nv,); none where they are exact."""
        return self._sensed[1]

    @property
    def work(self) -> float:
        """Done so far [J]; NaN where the machine does not say."""
        return float(getattr(self.machine, "work", np.nan))

    @property
    def model(self) -> ReducedModel | None:
        """The reduced model that moves; None where the machine is none."""
        return self._reduced if self._exact is not None else getattr(self.machine, "reduced", None)

    @property
    def external(self) -> np.ndarray | None:
        """Generalized forces (nv,) beside the inputs; None where there are none."""
        return getattr(self.machine, "external", None)

    @property
    def friction_used(self) -> np.ndarray:
        """Share of the grip that each contact uses, (w,)."""
        tell = getattr(self.machine, "friction_used", None)
        return _NOTHING if tell is None or not self.friction_names else np.asarray(tell())
