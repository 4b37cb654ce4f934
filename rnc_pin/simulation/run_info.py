"""What a run is a run of, beside its numbers. In a file it is JSON: see ``info_json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from rnc_pin.math.coordinates import Coordinates
from rnc_pin.plain import Json


class Outcome(StrEnum):
    """How a run ended.

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
    """The vertical or the reducing outputs of a run, column by column.

    Attributes:
        names, units: of the outputs; of a quasi-velocity the unit of its integral.
        angular: which are angles.
        rotations: columns in which a rotation vector begins.
        quasi: which are integrals of quasi-velocities; none in files of older versions.
    """

    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    angular: tuple[bool, ...] = ()
    rotations: tuple[int, ...] = ()
    quasi: tuple[bool, ...] = ()

    @property
    def coordinates(self) -> Coordinates:
        """What the outputs live on."""
        return Coordinates(self.angular, self.rotations)


@dataclass(frozen=True)
class OutputNames:
    """What the columns of a run's arrays are called.

    Attributes:
        x1, x2: vertical and reducing outputs.
        T: actuators.
        multipliers: kept constraint rows.
        contact_forces: all constraint rows.
        v: velocities of the robot.
        friction_used: contacts that grip by friction.
        normal_forces: contacts that carry.
        ground_poses: bodies that move on the ground.
        T_units: "N" or "N m" of each actuator, empty where it is not known; none in files of older versions.
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
        """Those of "x1" or of "x2"."""
        return {"x1": self.x1, "x2": self.x2}[kind]


@dataclass(frozen=True)
class TaskNames:
    """Reducing outputs that the task names, and those that it leaves free."""

    primary: tuple[str, ...] = ()
    redundant: tuple[str, ...] = ()


@dataclass(frozen=True)
class PlannedPath:
    """The path that was planned before a run.

    Attributes:
        frame: that was to drive it.
        trailer: frame that was to follow, if any.
        poses: x, y and heading [m, m, rad].
    """

    frame: str
    trailer: str | None
    poses: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class Provenance:
    """Where a run comes from, as whoever starts it says.

    Attributes:
        scenario: its name.
        seed: of whatever was drawn.
        config: the scenario as its file has it.
        folder: that paths in ``config`` are relative to; None for a scenario that is built in.
        controller: the controller and its gains.
        task: how the reducing outputs are divided.
        path: that was planned.
        estimates, predicted: units by name of what the controller learns, and of what it predicts.
        more: anything else worth keeping.
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
    """What a run is a run of, and how it ended.

    Attributes:
        outputs: names of the columns.
        goals: outputs that had a goal all the time, from when the controller first could measure.
        dt: sampling period [s].
        versions: of the software that the numbers depend on.
        provenance: where the run comes from.
        outcome: how it ended.
        message: why it ended early, if it did.
    """

    outputs: OutputNames = OutputNames()
    goals: tuple[str, ...] = ()
    dt: float | None = None
    versions: Mapping[str, str] = field(default_factory=dict)
    provenance: Provenance = Provenance()
    outcome: Outcome = Outcome.COMPLETED
    message: str | None = None
