"""Metadata of a run: names, units, origin and outcome; and their JSON form, stored under ``meta`` in the file of a run.

The keys of the JSON form are fixed, because other programs read the files too. None values are omitted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from enum import StrEnum
from functools import cache
from typing import TYPE_CHECKING, Annotated, TypeVar, cast

from rnc_pin.control.loop.loop_state import LateTicks
from rnc_pin.errors import ConfigurationError, printable
from rnc_pin.io.json import Json, to_json_mapping
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.printing import printed
from rnc_pin.verdict import Finding, Verdict

_Record = TypeVar("_Record", bound="DataclassInstance")
_Schema = dict[str, object]
FORCE_UNITS = {"m/s": "N", "rad/s": "N m", "kg m/s": "m/s^2", "N m s": "rad/s^2"}
"""Unit of the multiplier of a row by the unit of its rate, or of its momentum."""
RATE_UNITS = {force: rate for rate, force in FORCE_UNITS.items()}
"""The inverse: unit of the slip of a row by the unit of its multiplier."""


class _Strict:
    """Annotation for pydantic: convert no value of another type, such as text to a number."""

    def __get_pydantic_core_schema__(self, source: object, handler: Callable[[object], _Schema]) -> _Schema:
        return {**handler(source), "strict": True}


if TYPE_CHECKING:
    from _typeshed import DataclassInstance
    from pydantic import TypeAdapter

    Content = Mapping[str, Json]
else:
    Content = Mapping  # pydantic resolves no recursive alias
Flag = Annotated[bool, _Strict()]
Whole = Annotated[int, _Strict()]
Number = Annotated[float, _Strict()]
Pose = tuple[Number, Number, Number]
"""Position x, y [m] and heading [rad]."""


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
    """An error, or the safe command to the end; a verdict can fail for other reasons."""


@printed()
@dataclass(frozen=True)
class Columns:
    """Metadata of the columns of an array; outputs have kinds of coordinates, too.

    Attributes:
        names, units: names and units; "-" for numbers, "" if unknown. A quasi-velocity has the unit of its integral.
        angular: True for angles.
        rotations: first columns of rotation vectors.
        quasi: True for integrals of quasi-velocities; empty if there are none.
    """

    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    angular: tuple[Flag, ...] = ()
    rotations: tuple[Whole, ...] = ()
    quasi: tuple[Flag, ...] = ()

    @property
    def coordinates(self) -> Coordinates:
        """Coordinate types of the outputs, such as angles and rotation vectors."""
        return Coordinates(self.angular, self.rotations)

    def is_integral(self, column: int) -> bool:
        """True if an output is the integral of a quasi-velocity.

        Args:
            column: index of the output.
        """
        return bool(self.quasi) and self.quasi[column]


@printed()
@dataclass(frozen=True)
class OutputNames:
    """Names of the columns of a run's arrays. Files have the names in the order of the fields.

    Attributes:
        x1, x2: vertical and reducing outputs.
        T: actuators.
        multipliers: kept constraint rows.
        contact_forces: all constraint rows.
        q: entries of the configuration.
        v: velocities of the robot.
        friction_used: contacts with friction.
        ground_poses: bodies that move on the ground; they have no units.
        normal_forces: contacts with a normal force.
    """

    x1: Columns = Columns()
    x2: Columns = Columns()
    T: Columns = Columns()
    multipliers: Columns = Columns()
    contact_forces: Columns = Columns()
    q: Columns = Columns()
    v: Columns = Columns()
    friction_used: Columns = Columns()
    ground_poses: Columns = Columns()
    normal_forces: Columns = Columns()

    def of(self, kind: str) -> Columns:
        """Columns of "x1" or "x2".

        Args:
            kind: "x1" or "x2".
        """
        return {"x1": self.x1, "x2": self.x2}[kind]

    def find(self, name: str) -> tuple[str, int] | None:
        """Kind ("x1" or "x2") and column of an output; None if no output has this name.

        Args:
            name: name of an output.
        """
        for kind in ("x2", "x1"):
            if name in self.of(kind).names:
                return kind, self.of(kind).names.index(name)
        return None


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
        poses: poses of the frame.
        heights: heights of the frame at the poses [m]; empty for a path on the ground.
    """

    frame: str
    poses: tuple[Pose, ...] = ()
    heights: tuple[float, ...] = ()


@printed()
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
    seed: Whole | None = None
    config: Content | None = None
    folder: str | None = None
    controller: Content | None = None
    task: TaskNames | None = None
    path: PlannedPath | None = None
    estimates: Mapping[str, str] = field(default_factory=dict)
    predicted: Mapping[str, str] = field(default_factory=dict)
    more: Content = field(default_factory=dict)

    def to_json(self) -> dict[str, Json]:
        """Return the JSON form."""
        known = {name: getattr(self, name) for name in _names(self) if name != "more"}
        # Empty mappings are left out of the file, as None is.
        known |= {"estimates": self.estimates or None, "predicted": self.predicted or None}
        known = {name: each for name, each in known.items() if each is not None}
        return to_json_mapping({**known, **self.more}, "meta")

    @classmethod
    def from_json(cls, content: Mapping[str, Json]) -> Provenance:
        """Read the JSON form of a provenance or of a whole run. Keys of the run itself, such as names, are ignored.

        Raises:
            ConfigurationError: a known key has a value of the wrong type.
        """
        # What is left over are the caller's own keys: they return to where they were.
        known = {*_names(cls), *_names(RunInfo), *_names(_ColumnNames)} - {"more", "outputs", "provenance"}
        return _read(cls, {**content, "more": {key: each for key, each in content.items() if key not in known}})


@dataclass(frozen=True)
class PhaseInfo:
    """Interval of a run between two events of its contacts, with the impact at its start.

    Attributes:
        name: contacts that are closed, or "flight".
        first_sample: index of its first sample.
        start: time of its first sample [s].
        impulses: impulse of each constraint row at its start [N s or N m s]; empty without an impact.
        energy_loss: kinetic energy that the impact removes [J].
        end: event that ended the interval; None if the run ended it.
    """

    name: str
    first_sample: Whole
    start: Number
    impulses: Mapping[str, float] = field(default_factory=dict)
    energy_loss: Number = 0.0
    end: str | None = None


@dataclass(frozen=True)
class FallbackUse:
    """Use of fallback commands by the control loop, because of invalid measurements or an error of the controller.

    Attributes:
        samples: number of samples with a fallback command.
        first: time of the first one [s].
        reason: reason at that time.
        at_the_end: True if the run ends in a stretch of such samples that is the longest one, or longer than the
            timeout of the loop.
    """

    samples: Whole
    first: Number
    reason: str
    at_the_end: Flag


@printed()
@dataclass(frozen=True)
class IntegrationAccuracy:
    """Estimated errors of the integration in the samples of a run.

    The error of a sample is that of its worst entry of configuration and velocity [m, rad, m/s or rad/s]. What becomes
    of it later is not estimated: an unstable motion lets it grow, and a tracker lets it fade.

    Attributes:
        tolerance: largest error per second that the plant allows.
        rate: largest error of a sample per second.
        total: sum of the errors of all samples.
        substeps: largest number of integration steps in a sample.
        enough: number that the tolerance asks for.
    """

    tolerance: float
    rate: float
    total: float
    substeps: int
    enough: int

    @property
    def is_kept(self) -> bool:
        """True if no sample exceeds the tolerance."""
        return self.rate <= self.tolerance


@printed()
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
        phases: intervals between events of contacts; empty if the plant has none that open and close.
        fallback: use of fallback commands; None if there was none.
        findings: findings of the controller about its own steps, such as programs that were not solved.
        integration: estimated errors of the integration; None if the plant does not estimate it.
        verdict: findings about the run, if it was judged.
        late: samples whose computation took longer than the sampling period; in no file, print or comparison.
    """

    outputs: OutputNames = OutputNames()
    goals: tuple[str, ...] = ()
    dt: Number | None = None
    versions: Mapping[str, str] = field(default_factory=dict)
    provenance: Provenance = Provenance()
    outcome: Outcome = Outcome.COMPLETED
    message: str | None = None
    phases: tuple[PhaseInfo, ...] = ()
    fallback: FallbackUse | None = None
    findings: tuple[Finding, ...] = ()
    integration: IntegrationAccuracy | None = None
    verdict: Verdict | None = None
    late: LateTicks | None = field(default=None, repr=False, compare=False)

    def to_json(self) -> dict[str, Json]:
        """Return the JSON form."""
        # Names of all arrays share one mapping in a file, and so do their units; only outputs have more.
        arrays = {part: _names(OutputNames) if part in ("names", "units") else ["x1", "x2"] for part in _names(Columns)}
        content: dict[str, object] = {
            **{part: {each: getattr(getattr(self.outputs, each), part) for each in arrays[part]} for part in arrays},
            "goals": self.goals,
            "dt": self.dt,
            "versions": self.versions,
            **self.provenance.to_json(),
            "outcome": str(self.outcome),
            "message": self.message,
            "phases": [asdict(each) for each in self.phases] or None,
            "findings": [each.to_json() for each in self.findings] or None,
            "fallback": self.fallback and asdict(self.fallback),
            "integration": self.integration and asdict(self.integration),
            "verdict": self.verdict and self.verdict.to_json(),
        }
        return to_json_mapping({name: part for name, part in content.items() if part is not None}, "meta")

    @classmethod
    def from_json(cls, content: Json) -> RunInfo:
        """Read the JSON form.

        Raises:
            ConfigurationError: the names of the outputs are missing, or a value has the wrong type.
        """
        needed = ("names", "units", "angular")
        if not isinstance(content, Mapping) or not all(isinstance(content.get(part), Mapping) for part in needed):
            raise ConfigurationError("'meta' does not name the outputs")
        parts = _read(_ColumnNames, content)
        outputs = OutputNames(*(
            Columns(*(getattr(parts, part).get(array, ()) for part in _names(Columns)))
            for array in _names(OutputNames)
        ))  # fmt: skip
        return _read(cls, {**content, "outputs": outputs, "provenance": Provenance.from_json(content)})


@dataclass(frozen=True)
class _ColumnNames:
    """Names of the columns in their JSON form: the tuples of ``Columns`` by array."""

    names: Mapping[str, tuple[str, ...]]
    units: Mapping[str, tuple[str, ...]]
    angular: Mapping[str, tuple[Flag, ...]]
    rotations: Mapping[str, tuple[Whole, ...]] = field(default_factory=dict)
    quasi: Mapping[str, tuple[Flag, ...]] = field(default_factory=dict)


def provenance_of(meta: Provenance | Mapping[str, Json] | None) -> Provenance:
    """Return the origin of a run from the argument ``meta`` of a simulation; also from ``meta`` of another run.

    Args:
        meta: origin of a run, or its JSON form with other keys of the caller.

    Raises:
        ConfigurationError: the argument or a value under a known key has the wrong type.
        InputError: a value cannot be written as JSON.
    """
    if meta is None:
        return Provenance()
    if isinstance(meta, Provenance):
        return meta
    if not isinstance(meta, Mapping):
        raise ConfigurationError(f"meta: expected a Provenance or a mapping, found {type(meta).__name__}")
    # First to JSON: what could not be written would be found only after the run.
    return Provenance.from_json(to_json_mapping(meta, "meta"))


def _names(record: DataclassInstance | type[DataclassInstance]) -> list[str]:
    return [each.name for each in fields(record)]


@cache
def _adapter(kind: type) -> TypeAdapter[object]:
    """Reader of a kind of record; making it takes longer than a short run."""
    from pydantic import TypeAdapter

    return TypeAdapter(kind)


def _read(kind: type[_Record], content: Mapping[str, object]) -> _Record:
    """Read the fields of a record. Other keys and None values are ignored.

    Raises:
        ConfigurationError: names the key, the value and the expected type.
    """
    from pydantic import ValidationError  # simulations that read no file start without it

    found = {name: content[name] for name in _names(kind) if content.get(name) is not None}
    try:
        return cast(_Record, _adapter(kind).validate_python(found))
    except ValidationError as error:
        wrong = error.errors(include_url=False)[0]
    key = "".join(f"[{each}]" if isinstance(each, int) else f".{each}" for each in wrong["loc"]).removeprefix(".")
    if wrong["type"] == "missing":
        raise ConfigurationError(printable(f"'meta' has no '{key}'"))
    value = repr(wrong["input"])
    # A line of a terminal: a value may be a whole file.
    value = value if len(value) < 40 else value[:37] + "..."
    problem = _EXPECTED.get(wrong["type"]) or wrong["msg"].replace("Input should be", "expected")
    raise ConfigurationError(printable(f"'meta' has {value} as '{key}', {problem}"))


_EXPECTED = {"dict_type": "expected a mapping", "dataclass_type": "expected a mapping", "tuple_type": "expected a list"}
