"""Changes of what a robot is, from the start or from a time on, and the plant that switches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.model.input_validation import NotNegative
from rnc_pin.model.rows import ConstantRows, ConstraintKind, Rows
from rnc_pin.plants.plant import Plant, PlantReport, report_of, takes_velocities
from rnc_pin.plants.reduced.reduced_plant import ReducedPlant
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

    def change(self, robot: Robot) -> None:
        """Multiply the inertias of a robot, which has no other users."""
        generator = np.random.default_rng([self.seed, 1])
        for joint, inertia in enumerate(robot.model.inertias):
            factor = 1.0 + self.largest * generator.uniform(-1.0, 1.0)
            robot.model.inertias[joint] = pin.Inertia(factor * inertia.mass, inertia.lever, factor * inertia.inertia)


@dataclass(frozen=True)
class StuckJoint:
    """Joint that locks during the run."""

    joint: str
    """Name of the joint."""
    time: NotNegative = 0.0
    """Time at which the joint locks [s]."""

    def rows(self, robot: Robot) -> ConstraintKind:
        """Rows that hold the joint where it is.

        Raises:
            ModelError: the joint is unknown.
        """
        return _LockedRows(robot, self.joint)


class _LockedRows(ConstantRows):
    """Rows that hold a joint where it is."""

    def __init__(self, robot: Robot, joint: str) -> None:
        entries = robot.velocity_indices(joint)
        self.matrix = np.eye(robot.nv)[entries]
        self.names = tuple(f"stuck({robot.velocity_names[entry]})" for entry in np.arange(robot.nv)[entries])
        self.units = tuple(robot.velocity_units[entry] for entry in np.arange(robot.nv)[entries])

    def bind(self, robot: Robot) -> Rows:
        return self


class ChangingPlant:
    """Plant that switches from one plant to another at a given time, at the same state.

    Args:
        before, after: plants with the same configurations and actuators. Velocity that violates the constraints of
            ``after`` vanishes at the switch, as in an inelastic impact.
        time: time of the switch [s].

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> sliding = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> locked = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh"), rnc.NoSideSlip("sleigh", axis="x")])
        >>> plants = [rnc.ReducedPlant(each) for each in (sliding, locked.reduce())]
        >>> plant = rnc.plants.ChangingPlant(*plants, time=0.1)
        >>> plant.reset(robot.configuration(), np.array([1.0, 0.0, 0.0]))
        >>> plant.advance(0.1), plant.advance(0.1)
        (None, None)
        >>> plant.read()[0][0].round(3)  # a metre a second, for a tenth of a second
        np.float64(0.1)
    """

    def __init__(self, before: Plant, after: Plant, time: float) -> None:
        self._before, self._after, self._switch_time = before, after, time
        self._current, self._time, self._switch_energy = before, 0.0, 0.0
        self._T: np.ndarray | None = None

    def reset(self, q: np.ndarray, v: np.ndarray) -> None:
        """Restart with the first plant."""
        self._current, self._time, self._T, self._switch_energy = self._before, 0.0, None, 0.0
        self._current.reset(q, v)
        self._switch_if_due()

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Return configuration (nq,) and velocity (nv,)."""
        return self._current.read()

    def apply(self, T: np.ndarray) -> None:
        """Apply inputs (p,) until the next call."""
        self._T = T
        self._current.apply(T)

    def advance(self, dt: float) -> None:
        """Advance the time by dt [s]. The switch happens at the end of the step that reaches its time."""
        self._current.advance(dt)
        self._time += dt
        self._switch_if_due()

    @property
    def takes_velocities(self) -> bool:
        """True if the inputs are velocities."""
        return takes_velocities(self._current)

    def report(self) -> PlantReport:
        """Return the report of the current plant; its work includes the switch, since an impact removes energy."""
        found = report_of(self._current)
        return found._replace(work=found.work + self._switch_energy)

    def _switch_if_due(self) -> None:
        if self._current is self._before and self._time >= self._switch_time - 1e-9:
            q, v = self._current.read()
            balance = _energy_minus_work(self._current)
            self._current = self._after
            self._after.reset(q, v)
            if isinstance(self._before, ReducedPlant) and isinstance(self._after, ReducedPlant):
                self._after.keep_errors(self._before.errors)
            if self._T is not None:
                self._current.apply(self._T)
            self._switch_energy += _energy_minus_work(self._current) - balance


def _energy_minus_work(plant: Plant) -> float:
    """Energy of a plant minus the work done on it [J]; NaN if it is unknown."""
    report = report_of(plant)
    q, v = plant.read()
    return np.nan if report.reduced is None else float(report.reduced.at(q, v=v).energy) - report.work
