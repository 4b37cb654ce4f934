"""Metadata of a run: names, units, origin and outcome. In a file they are JSON: see ``info_json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from rnc_pin.io.json import Json
from rnc_pin.math.coordinates import Coordinates


class Outcome(StrEnum):
    """Outcome of a run.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> run = rnc.free_motion(reduced, robot.configuration(), [1.0, 0.5], duration=1.0)
        >>> run.outcome is rnc.Outcome.COMPLETED, str(run.outcome)
        (True, 'completed')
    """

    COMPLETED = "completed"
    INTERRUPTED = "interrupted"
    SINGULAR = "singular"
    DIVERGED = "diverged"
    LIMIT = "limit"
    FAILED = "failed"


@dataclass(frozen=True)
class Columns:
    """Metadata of the columns of the vertical or the reducing outputs.

    Attributes:
        names, units: names and units of the outputs; for a quasi-velocity, the unit of its integral.
        angular: True for angles.
        rotations: first columns of rotation vectors.
        quasi: True for integrals of quasi-velocities; empty in files of older versions.
    """

    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    angular: tuple[bool, ...] = ()
    rotations: tuple[int, ...] = ()
    quasi: tuple[bool, ...] = ()

    @property
    def coordinates(self) -> Coordinates:
        """Coordinate types of the outputs, such as angles and rotation vectors."""
        return Coordinates(self.angular, self.rotations)


@dataclass(frozen=True)
class OutputNames:
    """Names of the columns of a run's arrays.

    Attributes:
        x1, x2: vertical and reducing outputs.
        T: actuators.
        multipliers: kept constraint rows.
        contact_forces: all constraint rows.
        v: velocities of the robot.
        friction_used: contacts with friction.
        normal_forces: contacts with a normal force.
        ground_poses: bodies that move on the ground.
        T_units: "N" or "N m" per actuator, "" if unknown; the tuple is empty in files of older versions.
    """

    x1: Columns = Columns()
    x2: Columns = Columns()
    T: tuple[str, ...] = ()
    multipliers: tuple[str, ...] = ()
    contact_forces: tuple[str, ...] = ()
    v: tuple[str, ...] = ()
    friction_used: tuple[str, ...] = ()
    normal_forces: tuple[str, ...] = ()
    ground_poses: tuple[str, ...] = ()
    T_units: tuple[str, ...] = ()

    def of(self, kind: str) -> Columns:
        """Columns of "x1" or "x2"."""
        return {"x1": self.x1, "x2": self.x2}[kind]


@dataclass(frozen=True)
class TaskNames:
    """Names of the primary and the redundant outputs of a task."""

    primary: tuple[str, ...] = ()
    redundant: tuple[str, ...] = ()


@dataclass(frozen=True)
class PlannedPath:
    """Path that was planned before a run.

    Attributes:
        frame: frame that drives the path.
        trailer: frame of the trailer that follows, if any.
        poses: x, y and heading of each pose [m, m, rad].
    """

    frame: str
    trailer: str | None
    poses: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class Provenance:
    """Origin of a run, as given by its caller.

    Attributes:
        scenario: name of the scenario.
        seed: seed of the random numbers.
        config: content of the scenario file.
        folder: base folder of relative paths in ``config``; None for a built-in scenario.
        controller: controller and its gains.
        task: primary and redundant outputs.
        path: planned path.
        estimates, predicted: units by name, of the estimated parameters and of the predicted quantities.
        more: other data, under keys of the caller.
    """

    scenario: str | None = None
    seed: int | None = None
    config: Mapping[str, Json] | None = None
    folder: str | None = None
    controller: Mapping[str, Json] | None = None
    task: TaskNames | None = None
    path: PlannedPath | None = None
    estimates: Mapping[str, str] = field(default_factory=dict)
    predicted: Mapping[str, str] = field(default_factory=dict)
    more: Mapping[str, Json] = field(default_factory=dict)


@dataclass(frozen=True)
class RunInfo:
    """Metadata and outcome of a run.

    Attributes:
        outputs: names of the columns.
        goals: outputs with a goal at every sample, from the first valid measurement on.
        dt: sampling period [s].
        versions: versions of the software that the results depend on.
        provenance: origin of the run.
        outcome: outcome of the run.
        message: reason of an early end, if any.
    """

    outputs: OutputNames = OutputNames()
    goals: tuple[str, ...] = ()
    dt: float | None = None
    versions: Mapping[str, str] = field(default_factory=dict)
    provenance: Provenance = Provenance()
    outcome: Outcome = Outcome.COMPLETED
    message: str | None = None
