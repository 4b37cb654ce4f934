"""Changes of a robot that the model of the controller does not contain."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.constraints import Pfaffian
from rnc_pin.model.parameter_types import NotNegative, Positive
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class MassErrors:
    """Relative errors of the inertias of all bodies.

    Attributes:
        largest: largest relative error, as a fraction.
        seed: seed of the errors.
    """

    largest: float
    seed: int

    def change(self, robot: Robot) -> list[Pfaffian]:
        """Multiply the inertias of a robot, which has no other users."""
        generator = np.random.default_rng([self.seed, 1])
        for joint, inertia in enumerate(robot.model.inertias):
            factor = 1.0 + self.largest * generator.uniform(-1.0, 1.0)
            robot.model.inertias[joint] = pin.Inertia(factor * inertia.mass, inertia.lever, factor * inertia.inertia)
        return []


class TimedChange(ABC):
    """Family of the changes that happen at a time during the run."""

    time: NotNegative

    @abstractmethod
    def change(self, robot: Robot) -> list[Pfaffian]:
        """Change a robot, which has no other users, and return further constraints.

        Raises:
            ModelError: a frame or joint is unknown.
        """


@dataclass(frozen=True)
class Payload(TimedChange):
    """Point mass that the robot picks up."""

    frame: str
    """Frame that carries the mass at its origin."""
    mass: Positive
    """Mass [kg]."""
    time: NotNegative = 0.0
    """Time of the pick-up [s]."""

    def change(self, robot: Robot) -> list[Pfaffian]:
        place = robot.model.frames[robot.frame_id(self.frame)]
        robot.model.inertias[place.parentJoint] += pin.Inertia(self.mass, place.placement.translation, np.zeros((3, 3)))
        return []


@dataclass(frozen=True)
class StuckJoint(TimedChange):
    """Joint that locks during the run."""

    joint: str
    """Name of the joint."""
    time: NotNegative = 0.0
    """Time at which the joint locks [s]."""

    def change(self, robot: Robot) -> list[Pfaffian]:
        rows = np.eye(robot.nv)[robot.velocity_indices(self.joint)]
        zeros = np.zeros_like(rows)
        return [Pfaffian(lambda q: rows, lambda q, v: zeros, [f"stuck({self.joint})"] if len(rows) == 1 else None)]
