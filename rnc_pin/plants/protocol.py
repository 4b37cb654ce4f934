"""What a loop needs of whatever it controls."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array


@runtime_checkable
class Machine(Protocol):
    """Something that moves: our reduced model integrated, another simulator, or hardware.

    Configurations and velocities are those of the loaded robot, in Pinocchio's order and conventions, whatever the
    machine keeps inside. Velocities are as the machine has them: they need not satisfy the constraints.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> isinstance(rnc.simulation.ReducedPlant(reduced), rnc.plants.Machine)
        True
    """

    def reset(self, q: Float[Array, " nq"], v: Float[Array, " nv"]) -> None:
        """Start again, at time zero and with no inputs."""

    def read(self) -> tuple[Float[Array, " nq"], Float[Array, " nv"]]:
        """Configuration and velocity now; arrays of their own."""

    def apply(self, T: Float[Array, " p"]) -> None:
        """Hold these actuator inputs from now on."""

    def advance(self, dt: float) -> None:
        """Let time pass [s]."""


def energy_less_work(machine: Machine) -> float:
    """The energy of a plant that is a reduced model, less the work done on it [J]; NaN where it does not say."""
    reduced, work = getattr(machine, "reduced", None), getattr(machine, "work", np.nan)
    if reduced is None:
        return np.nan
    q, v = machine.read()
    return float(reduced.at(q, v=v).energy) - float(work)
