"""Protocol of plants: the methods that a control loop needs."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float

OF_INTEGRATION = ("errors", "tolerance", "keep_errors")
"""Attributes of plants that estimate their errors."""
OF_CONTACTS = ("friction_used", "slip_speed", "wheel_names", "normal_forces", "contact_forces", "contact_force_units")
"""Attributes of plants that state their contacts."""


@runtime_checkable
class Plant(Protocol):
    """Controlled system: the integrated reduced model, another simulator, or hardware.

    Configurations and velocities are those of the loaded robot, in Pinocchio's order and conventions. Velocities are
    those of the plant and need not satisfy the constraints. Any object with these four methods is a plant.

    A plant with velocity servos has two more attributes: ``takes_velocities`` is True, its inputs are then velocities
    ``u = B^T v`` of the actuators, and ``effort`` has the present efforts (p,) of the servos.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> isinstance(rnc.ReducedPlant(reduced), rnc.plants.Plant)
        True
    """

    def reset(self, q: Float[Array, " nq"], v: Float[Array, " nv"]) -> None:
        """Restart at time zero with zero inputs."""

    def read(self) -> tuple[Float[Array, " nq"], Float[Array, " nv"]]:
        """Return copies of the current configuration and velocity."""

    def apply(self, T: Float[Array, " p"]) -> None:
        """Apply actuator inputs until the next call."""

    def advance(self, dt: float) -> None:
        """Advance the time by dt [s]."""


def takes_velocities(plant: object) -> bool:
    """Return True if the inputs of a plant are velocities of its actuators."""
    return bool(getattr(plant, "takes_velocities", False))


def energy_minus_work(plant: Plant) -> float:
    """Return the energy of a plant minus the work done on it [J]; NaN if it is unknown."""
    reduced, work = getattr(plant, "reduced", None), getattr(plant, "work", np.nan)
    if reduced is None:
        return np.nan
    q, v = plant.read()
    return float(reduced.at(q, v=v).energy) - float(work)


def continue_plant(before: Plant, after: Plant, q: np.ndarray, v: np.ndarray) -> None:
    """Start a plant at a state in place of another one, with its estimated errors of the integration."""
    errors = getattr(before, "errors", None)
    after.reset(q, v)
    if errors is not None and hasattr(after, "keep_errors"):
        after.keep_errors(errors)
