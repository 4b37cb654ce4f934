"""Adapter between a plant and a simulation: true state and measured state."""

from __future__ import annotations

import numpy as np

from rnc_pin.errors import DivergenceError
from rnc_pin.loop import ControlLoop, LoopOptions
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants import ContactEvent, Plant, ReducedPlant
from rnc_pin.plants.plant import takes_velocities
from rnc_pin.plants.reduced import Checkpoint
from rnc_pin.simulation.run_info import PhaseInfo

_EMPTY = np.zeros(0)
_ROUNDING = 1e-6  # of a time, in sampling periods


class PlantAdapter:
    """Adapter of a plant: its state in the outputs of a model.

    These attributes of a plant are optional:

    * ``actual()``: true configuration and velocity, if ``read()`` returns sensor values,
    * ``applied``: applied inputs,
    * ``work``: work since the start,
    * ``friction_used()``: friction use of the contacts ``wheel_names``,
    * ``reduced``: reduced model of the plant,
    * ``external``: generalized forces in addition to the inputs,
    * ``contact_events``: contacts that opened and closed since the start,
    * ``takes_velocities`` and ``effort``: see ``Plant``.

    Args:
        plant: the plant.
        reduced: reduced model of the controller.
    """

    def __init__(self, plant: Plant, reduced: ReducedModel) -> None:
        self.plant, self._reduced = plant, reduced
        self._exact = plant if isinstance(plant, ReducedPlant) and plant.reduced is reduced else None
        self._measured: tuple[np.ndarray, np.ndarray] = (_EMPTY, _EMPTY)
        self.friction_names: tuple[str, ...] = tuple(getattr(plant, "wheel_names", ()))

    @property
    def loop_options(self) -> LoopOptions:
        """Default options of the control loop on this plant."""
        if self._exact is None:
            return {"fallback": "zero" if takes_velocities(self.plant) else "hold", "limits": False}
        return {"fallback": "raise", "limits": self._exact.actuator_limits}

    def read_state(self, t: float) -> StateEvaluation:
        """Read the sensors at time t [s] and return the true state. Call it once per sample.

        Raises:
            DivergenceError: the state is not finite.
        """
        if self._exact is not None:
            return self._exact.state
        self._measured = self.plant.read()
        q, v = self.plant.actual() if hasattr(self.plant, "actual") else self._measured
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise DivergenceError("plant state is not finite")
        return self._reduced.at(q, v=v, t=t)

    def restore(self, checkpoint: Checkpoint) -> None:
        """Return a ``ReducedPlant`` of the controller's model to the state of a checkpoint."""
        assert self._exact is not None
        self._exact.rollback(checkpoint)

    def compute_input(self, loop: ControlLoop, t: float) -> np.ndarray:
        """Return the inputs (p,) of a loop for the last measurement."""
        if self._exact is not None:
            return loop.compute_input(t, self._exact.state, self._exact.integrals)
        return loop.step(t, *self._measured)

    def apply(self, loop: ControlLoop, T: np.ndarray) -> np.ndarray:
        """Apply inputs to the plant, report the applied ones to the loop, and return them; of servos their efforts."""
        self.plant.apply(T)
        if takes_velocities(self.plant):
            effort: np.ndarray = self.plant.effort  # type: ignore[attr-defined]
            return effort
        applied: np.ndarray = getattr(self.plant, "applied", T)
        loop.report_applied_input(applied)
        return applied

    @property
    def v_measured(self) -> np.ndarray:
        """Measured velocity (nv,); empty if measurements are exact."""
        return self._measured[1]

    @property
    def work(self) -> float:
        """Work since the start [J]; NaN if the plant does not provide it."""
        return float(getattr(self.plant, "work", np.nan))

    @property
    def model(self) -> ReducedModel | None:
        """Reduced model of the plant; None if it has none."""
        return self._reduced if self._exact is not None else getattr(self.plant, "reduced", None)

    @property
    def external(self) -> np.ndarray | None:
        """Generalized forces (nv,) in addition to the inputs; None without them."""
        return getattr(self.plant, "external", None)

    def phases(self, start: float, dt: float) -> tuple[PhaseInfo, ...]:
        """Intervals between the contact events of the plant, as phases of a run; empty if its contacts do not switch.

        Args:
            start: time of the first sample [s].
            dt: sampling period [s].
        """
        events: tuple[ContactEvent, ...] = getattr(self.plant, "contact_events", ())
        ends = [*(event.cause for event in events[1:]), None]
        return tuple(
            PhaseInfo(
                " + ".join(event.closed) or "flight",
                int(np.ceil(event.time / dt - _ROUNDING)),
                start + event.time,
                dict(event.impulses),
                event.energy_loss,
                end,
            )
            for event, end in zip(events, ends[: len(events)], strict=True)
        )

    @property
    def friction_used(self) -> np.ndarray:
        """Friction use (w,) of the contacts: friction force over its limit."""
        friction_used = getattr(self.plant, "friction_used", None)
        return _EMPTY if friction_used is None or not self.friction_names else np.asarray(friction_used())
