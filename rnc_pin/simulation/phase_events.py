"""Events that end a phase: functions of the state and the inputs that cross zero."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np

from rnc_pin.analysis import NormalForces
from rnc_pin.errors import ConfigurationError, LimitError, nearest
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.row_stack import OutputStack
from rnc_pin.model.rows import OutputKind
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants.reduced.events import Direction
from rnc_pin.simulation.stop import Stop

_ROUNDING = 1e-6  # share of all forces below which a force counts as zero

Value = Callable[[StateEvaluation, np.ndarray, np.ndarray | None], float]
"""Function of state, inputs (p,) and external generalized forces (nv,), if any."""


@dataclass(frozen=True)
class BoundEvent:
    """Event of a model.

    Attributes:
        name: description for messages and records.
        value: function that crosses zero.
        direction: direction of the crossing that counts.
        from_start: True if a value at or below zero ends a phase at once, at its start too.
    """

    name: str
    value: Value
    direction: Direction = "falling"
    from_start: bool = False


@runtime_checkable
class Event(Protocol):
    """Description of an event that can be bound to a model."""

    def bind_event(self, reduced: ReducedModel) -> BoundEvent:
        """Return the event for a model."""
        ...


@dataclass(frozen=True)
class OutputCrossing:
    """An output crosses a value.

    Args:
        output: output with one row, such as ``rnc.Distance("hand", "handle")``.
        value: value to cross [m or rad].
        direction: "falling", "rising" or "either".

    Raises (when a phase starts):
        ConfigurationError: unknown direction, or an output that has no value or more than one.

    Example:
        >>> near = rnc.OutputCrossing(rnc.Distance("hand", "handle"), value=0.05)
        >>> near.direction
        'falling'
    """

    output: OutputKind
    value: float = 0.0
    direction: Direction = "falling"

    def bind_event(self, reduced: ReducedModel) -> BoundEvent:
        """Return the event for a model.

        Args:
            reduced: model of the phase.
        """
        directions = ("falling", "rising", "either")
        if self.direction not in directions:
            raise ConfigurationError(f"direction '{self.direction}' is not known{nearest(self.direction, directions)}")
        stack = OutputStack([self.output.bind(reduced.robot)])
        if stack.size != 1 or stack.has_quasi:
            raise ConfigurationError(f"event: expected an output with one value, found {', '.join(stack.names)}")
        name = f"{stack.names[0]} = {self.value:g}"

        def value(state: StateEvaluation, T: np.ndarray, external: np.ndarray | None) -> float:
            return float(stack.value(state.position)[0]) - self.value

        return BoundEvent(name, value, self.direction)


@dataclass(frozen=True)
class ContactLoss:
    """A contact, or a row that only pushes, has no force left.

    Args:
        contact: name of a contact with a normal force (``rnc.analysis.NormalForces``), or of a constraint row.
        push: for a row: 1 if it can push along the velocity that it prevents, -1 for the opposite direction.

    Example:
        >>> rnc.ContactLoss("left_wheel").push
        1
    """

    contact: str
    push: Literal[1, -1] = 1

    def bind_event(self, reduced: ReducedModel) -> BoundEvent:
        """Return the event for a model.

        Args:
            reduced: model of the phase.
        """
        if self.push not in (1, -1):
            raise ConfigurationError(f"push of '{self.contact}': expected 1 or -1, found {self.push!r}")
        forces = PushingForces(reduced, {self.contact: self.push})
        column = forces.names.index(self.contact)

        def value(state: StateEvaluation, T: np.ndarray, external: np.ndarray | None) -> float:
            return float(_with_margin(forces.at(state, T, external))[column])

        return BoundEvent(f"no force of {self.contact}", value, from_start=True)


class PushingForces:
    """Forces that cannot be negative: normal forces of contacts, and forces of rows by request.

    Args:
        reduced: the model.
        rows: constraint rows that only push, in addition to all contacts: 1 along the row's velocity, -1 against it.

    Attributes:
        names: names of contacts and rows, (c,).

    Raises:
        ConfigurationError: unknown row or contact.
    """

    def __init__(self, reduced: ReducedModel, rows: Mapping[str, int] | None = None) -> None:
        self._normal = NormalForces(reduced)
        known = reduced.all_constraints.names
        given = {name: sign for name, sign in (rows or {}).items() if name not in self._normal.names}
        for name in given:
            if name not in known:
                valid = (*self._normal.names, *known)
                raise ConfigurationError(f"no contact or constraint row '{name}'{nearest(str(name), valid)}")
        self._rows, self._signs = [known.index(name) for name in given], np.array(list(given.values()), dtype=float)
        self.names = (*self._normal.names, *given)
        self.reduced = reduced

    @property
    def constraint_rows(self) -> dict[str, tuple[str, int]]:
        """Constraint row and sign of each force that is the multiplier of a row, by name of contact or row."""
        rows = self.reduced.all_constraints.names
        contacts = zip(self._normal.contacts, self._normal.carried_by_row, strict=True)
        found = {each.name: (rows[each.up], 1) for each, carried in contacts if carried and each.up is not None}
        given = zip(self.names[len(self._normal.names) :], self._rows, self._signs, strict=True)
        return found | {name: (rows[row], int(sign)) for name, row, sign in given}

    def at(self, state: StateEvaluation, T: np.ndarray, external: np.ndarray | None) -> np.ndarray:
        """Forces (c,) [N] at one state under inputs T (p,); a real contact would not give a negative one."""
        forces = self._normal.at(state, T, external)
        if not self._rows:
            return forces
        return np.concatenate([forces, self._signs * state.contact_forces(T, external)[self._rows]])


class LiftOffMonitor:
    """Check that no contact pulls.

    Args:
        forces: forces that cannot be negative.
        other: True if the states to check are those of another model, such as that of the controller.
    """

    def __init__(self, forces: PushingForces, other: bool = False) -> None:
        self._forces, self._other = forces, other

    def check(self, t: float, state: StateEvaluation, T: np.ndarray, external: np.ndarray | None) -> None:
        """Raise an error if a contact pulls.

        Raises:
            LimitError: names the contact, the time and the force.
        """
        if self._other:
            state = self._forces.reduced.at(state.q, v=state.v)
        forces = self._forces.at(state, T, external)
        for name, force, raised in zip(self._forces.names, forces, _with_margin(forces), strict=True):
            if raised < 0:
                raise LimitError(
                    f"contact '{name}' lifts off at t = {t:.3f} s: the model pulls with {-force:.3g} N, and "
                    "the contact can only push"
                )

    def event(self) -> BoundEvent:
        """Event at which the first contact pulls."""

        def value(state: StateEvaluation, T: np.ndarray, external: np.ndarray | None) -> float:
            return float(_with_margin(self._forces.at(state, T, external)).min(initial=np.inf))

        return BoundEvent("lift-off", value, from_start=True)


def lift_off_monitor(stop: Stop, model: ReducedModel | None, reduced: ReducedModel) -> LiftOffMonitor | None:
    """Monitor for a stop condition; None if it is not asked for.

    Args:
        stop: stop conditions.
        model: reduced model of the plant; None if it is unknown.
        reduced: model of the states to check.

    Raises:
        ConfigurationError: the plant has no model, or the model has no contact with a normal force.
    """
    if not stop.lift_off:
        return None
    if model is None:
        raise ConfigurationError(
            "lift_off of a Stop: normal forces need the reduced model of the plant; in MuJoCo, contacts lift off"
        )
    forces = PushingForces(model)
    if not forces.names:
        raise ConfigurationError("lift_off of a Stop: the model has no contact with a normal force")
    return LiftOffMonitor(forces, model is not reduced)


def _with_margin(forces: np.ndarray) -> np.ndarray:
    """Forces (c,), negative only if they pull by more than rounding: contacts that share a force may have zero."""
    return forces + _ROUNDING * max(float(np.abs(forces).sum()), _ROUNDING)
