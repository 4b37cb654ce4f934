"""Linear-quadratic regulator."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
import scipy.linalg

from rnc_pin.analysis import Linearization, equilibrium, linearize, lqr
from rnc_pin.control import StateFeedback
from rnc_pin.errors import InfeasibleError, RncError
from rnc_pin.planning import Joined, Reference
from rnc_pin.scenario.schema.base import Numbers
from rnc_pin.scenario.schema.controllers.base import Built, Context, ControllerSettings, reduced_velocity
from rnc_pin.scenario.schema.outputs import OutputItem

_THIN = 0.01  # smallest singular value below which a warning is given


class StateFeedbackSettings(ControllerSettings):
    """Linear-quadratic regulator about the equilibrium or steady motion nearest to the initial configuration."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary", "redundant"})

    type: Literal["state_feedback"]
    """Linear-quadratic regulator, for systems with fewer actuators than velocities. It uses the model."""
    coordinates: list[str | OutputItem] | None = None
    """States that describe the configuration: names of entries of v, or outputs; by default all entries of v."""
    rates: list[str] | None = None
    """Reducing outputs whose rates are states; all by default."""
    state_cost: float | Numbers | dict[str, float]
    """Weights of the states: one number, one for each, or a mapping by name. Names of rates end in ``_dot``."""
    input_cost: float | Numbers | dict[str, float] = 1.0
    """Weights of the actuators' inputs: one number, one for each, or a mapping by name."""
    v2: dict[str, float] | None = None
    """Rates of reducing outputs in the steady motion, by name; the initial rates by default."""
    hold: list[str] = []
    """Joints whose equilibrium position is their initial position."""
    cyclic: list[str] = []
    """Joints that may move in the steady motion although the dynamics depend on them, such as an unbalanced wheel."""

    def make(self, context: Context) -> Built:
        reduced = context.reduced
        v2 = context.v2_0 if self.v2 is None else reduced_velocity(reduced, self.v2, "controller.v2")
        try:
            found = equilibrium(reduced, context.q0, self.hold, v2, self.cyclic)
            linear = linearize(reduced, found.q, v2, found.T, self.coordinates, self.rates)
            K = lqr(linear, self.state_cost, self.input_cost)
        except RncError as error:
            raise type(error)(f"controller: {error}") from None
        _check_sampling(linear, K, context.simulation.dt)
        parts: list[Reference] = []
        names: list[str] = []
        for which in context.given:
            parts.append(getattr(context, which))
            names += getattr(context.task, f"{which}_names")
        reference = Joined(parts) if parts else None
        smallest = float(np.min(reduced.smallest_singular_value(np.stack([context.q0, found.q]))))
        near = f"start is near a singular configuration: smallest singular value {smallest:.2g}, limit {_THIN:g}"
        complaints = () if smallest > _THIN else (near,)
        if complaints and context.preflight == "refuse":
            raise InfeasibleError(complaints[0])
        return Built(StateFeedback(linear, K, reference, names), complaints)


def _check_sampling(linear: Linearization, K: np.ndarray, dt: float) -> None:
    """Refuse gains that are unstable in discrete time, with inputs constant over a sampling period.

    Raises:
        InfeasibleError: the closed loop is unstable; the message gives its rate.
    """
    s, p = linear.B.shape
    held = scipy.linalg.expm(np.block([[linear.A, linear.B], [np.zeros((p, s + p))]]) * dt)
    if np.abs(np.linalg.eigvals(held[:s, :s] - held[:s, s:] @ K)).max(initial=0.0) >= 1.0:
        fastest = float(np.abs(np.linalg.eigvals(linear.A - linear.B @ K)).max())
        raise InfeasibleError(
            f"controller: the closed loop is unstable in discrete time: its fastest eigenvalue is {fastest:.3g}/s "
            f"and the sampling period {dt:g} s; reduce simulation.dt or raise input_cost"
        )
