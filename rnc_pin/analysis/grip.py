"""What wheels and blades would need of friction to hold the constraints that are taken for granted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.kinematics import Kinematics, over_states
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.row_stack import Place

_SMALL = 1e-9


class _Contact(NamedTuple):
    name: str
    along: list[int]
    """Rows along the ground, among all constraint rows."""
    up: int | None
    """Row that carries, if it does."""


class Grip:
    """Friction that constraints need: the size of their forces along the ground over ``friction`` times the load.

    A contact is whatever does not slip along the ground: ``NoSideSlip``, the wheels, balls. Its force is the multiplier
    of its rows (``ReducedModel.contact_forces``; rows that depend on each other share it evenly). Its load is the
    multiplier of its vertical row where the model has one that carries; on a base that moves in the plane it follows
    from statics, with casters among the supports: loads of least norm that add up to the weight and balance its moment
    as well as these supports can, none below zero. What accelerations shift of the weight is not in that.

    Args:
        reduced: the model.
        friction: coefficient of friction of the ground.
        loads: by name of the contact, where they are known [N].

    Attributes:
        names: of the contacts, (w,): of the frame.

    Raises:
        ConfigurationError: friction or a load that is not positive, no such contact, or nothing that grips.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators).reduce(
        ...     [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> grip = rnc.Grip(reduced, friction=0.5)
        >>> grip.names, grip.used(robot.configuration(), [1.0, 2.0], np.zeros(2)).round(2)
        (('sleigh',), array([0.3]))
    """

    def __init__(self, reduced: ReducedModel, friction: float, loads: Mapping[str, float] | None = None) -> None:
        if not 0 < friction < np.inf:
            raise ConfigurationError(f"friction of the ground has to be positive, found {friction}")
        self._reduced, self.friction = reduced, friction
        q = reduced.robot.configuration()
        self._kinematics, self._data = Kinematics(reduced.robot), reduced.robot.model.createData()
        points, _ = reduced.all_constraints.lines_of_action(self._kinematics.position(q))
        acting = np.isfinite(points).all(axis=1)
        found = [(place, _contact(place, acting)) for place in reduced.all_constraints.places]
        self._contacts = [contact for _, contact in found if contact is not None]
        self._carrying = [
            place.where.start + row
            for place, contact in found
            if contact is None and place.block.on_ground
            for row in range(len(place.block.names))
        ]
        self.names = tuple(each.name for each in self._contacts)
        if not self.names:
            raise ConfigurationError("nothing of this system grips the ground by friction")
        self._known = np.full(len(self.names), np.nan)
        for name, load in (loads or {}).items():
            if name not in self.names:
                raise ConfigurationError(f"loads: nothing grips at '{name}'{nearest(name, self.names)}")
            if not load > 0:
                raise ConfigurationError(f"load of '{name}' has to be positive, found {load}")
            self._known[self.names.index(name)] = load

    def forces(self, q: Array, v2: Array, T: Array) -> Float[Array, "*batch w"]:
        """Along the ground [N].

        Args:
            q: configurations (..., nq).
            v2: reduced velocities (..., r).
            T: inputs of the actuators (..., p).
        """
        return self._along(self._reduced.contact_forces(q, v2, T))

    def loads(self, q: Array, v2: Array, T: Array) -> Float[Array, "*batch w"]:
        """Upwards [N].

        Args:
            q: configurations (..., nq).
            v2: reduced velocities (..., r).
            T: inputs of the actuators (..., p).
        """
        return self._upwards(np.asarray(q, dtype=float), self._reduced.contact_forces(q, v2, T))

    def _along(self, multipliers: Array) -> Array:
        return np.stack([np.linalg.norm(multipliers[..., each.along], axis=-1) for each in self._contacts], axis=-1)

    def _upwards(self, q: Array, multipliers: Array) -> Array:
        rows = self._reduced.at(q).all_rows
        loads = over_states(self._static, (len(self.names),), q)
        for place, contact in enumerate(self._contacts):
            if contact.up is not None and np.abs(rows[..., contact.up, :]).max() > _SMALL:
                loads[..., place] = np.maximum(-multipliers[..., contact.up], 0.0)
        return np.where(np.isnan(self._known), loads, self._known)

    def used(self, q: Array, v2: Array, T: Array) -> Float[Array, "*batch w"]:
        """Share of the grip that every contact uses; more than 1 slips.

        Args:
            q: configurations (..., nq).
            v2: reduced velocities (..., r).
            T: inputs of the actuators (..., p).
        """
        multipliers = self._reduced.contact_forces(q, v2, T)
        forces = self._along(multipliers)
        allowed = self.friction * self._upwards(np.asarray(q, dtype=float), multipliers)
        return np.divide(forces, allowed, out=np.where(forces > _SMALL, np.inf, 0.0), where=allowed > 0)

    def used_by(self, q: Array, v2: Array, v2_dot: Array) -> Float[Array, "*batch w"]:
        """The same for accelerations instead of inputs.

        Args:
            q: configurations (..., nq).
            v2: reduced velocities (..., r).
            v2_dot: their rates (..., r).

        Raises:
            ConstraintError: no inputs give them.
        """
        reduced = self._reduced
        return self.used(q, v2, reduced.allocate(q, reduced.inverse_dynamics(q, v2, v2_dot)))

    def _static(self, q: Array) -> Float[Array, " w"]:
        """Loads at rest."""
        robot = self._reduced.robot
        points, _ = self._reduced.all_constraints.lines_of_action(self._kinematics.position(q))
        supports = [*(each.along[0] for each in self._contacts), *self._carrying]
        center = np.asarray(pin.centerOfMass(robot.model, self._data, q))[:2]
        weight = -pin.computeTotalMass(robot.model) * float(robot.model.gravity.linear[2])
        share = np.full(len(supports), 1.0 / len(supports))
        levers = (points[supports, :2] - center).T
        # From equal shares on, along directions that keep their sum.
        free = np.eye(len(supports)) - share
        share = share - apply(np.linalg.pinv(levers @ free, rcond=1e-9), apply(levers, share))
        share = np.maximum(share, 0.0)
        loads: np.ndarray = max(weight, 0.0) * share[: len(self._contacts)] / share.sum()
        return loads


def _contact(place: Place, acting: Array) -> _Contact | None:
    """What grips of a block's rows."""
    block, start = place.block, place.where.start
    holonomic = block.holonomic or (False,) * len(block.names)
    along = [start + row for row, fixed in enumerate(holonomic) if not fixed and acting[start + row]]
    if not along:
        return None
    up = next((start + row for row, fixed in enumerate(holonomic) if fixed and block.on_ground), None)
    name = getattr(block.kind, "frame", None)
    return _Contact(name if isinstance(name, str) else block.names[along[0] - start], along, up)
