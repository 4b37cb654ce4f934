"""Data of a run: ``Record``, to which samples are added, and its signals and metadata, which a file holds.

``derive`` makes a ``Trajectory`` of a record: ``RunData`` that judges, plots and exports itself.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Self, cast

import numpy as np

from rnc_pin.array_shapes import Array, Float, Int
from rnc_pin.control.controller import Command, LimitedAcceleration, MissedGoal
from rnc_pin.errors import ConfigurationError, InputError, RncError, place_of
from rnc_pin.io.json import Json, atomic_file, dump_json
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants.plant import PlantReport
from rnc_pin.printing import ObjectSummary, SummaryMixin
from rnc_pin.simulation.run_info import FORCE_UNITS, RATE_UNITS, Columns, Outcome, OutputNames, RunInfo
from rnc_pin.verdict import Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rnc_pin.figures import Size
    from rnc_pin.simulation.summary import PrintedSummary

GOALS = ("v2_desired", "x1_desired", "x2_desired")
"""Arrays with the goals of a sample, NaN without one."""
_DEFAULTS = PlantReport._field_defaults.items()
_STATED = tuple(name for name, none in _DEFAULTS if isinstance(none, Mapping) and not name.endswith("_units"))
"""Fields of a report with numbers by name: each is an array of the run."""
_OPTIONAL = ("estimates", "prediction_error", "v_measured", *_STATED)
_SILENT = PlantReport()
_BLOCK = 1000  # largest number of samples in a block
_ROOM = 16e6  # memory for the matrices of a block [bytes]


class _Recorded(NamedTuple):
    """One sample of a record."""

    row: Array
    """Numbers that every sample has, in the order of the columns."""
    plant: ReducedModel | None
    """Model of the plant, if it is known."""
    external: Array | None
    """Generalized forces (nv,) in addition to the inputs."""
    optional: Mapping[str, Array]
    """Numbers that most plants and controllers do not tell, by name of their array."""


class Record:
    """Samples of a run, recorded one by one.

    Args:
        reduced: reduced model of the controller.
        carries: mask (r,) of the reducing outputs with a valid integral.
        report: what the plant tells at the start: contacts with friction, and forces that it states itself.

    Attributes:
        width: numbers of a sample.
        contacts: names of the contacts whose friction is recorded.
        own_forces: of "normal_forces" and "contact_forces", units by name of the forces that the plant states itself.
    """

    def __init__(self, reduced: ReducedModel, carries: Array, report: PlantReport = _SILENT) -> None:
        self.reduced, self.carries = reduced, carries
        self.contacts = tuple(report.friction_used)
        newtons = dict.fromkeys(report.normal_forces, "N")
        self.own_forces = {"normal_forces": newtons, "contact_forces": dict(report.contact_force_units)}
        k, r = reduced.vertical.size, reduced.r
        self._columns = {
            "time": 1, "work": 1, "q": reduced.robot.nq, "v": reduced.n, "v2": r, "x1": k, "x2": r, "v1": k,
            "T": reduced.p, "integrals": r, "v2_desired": r, "x1_desired": k, "x2_desired": r,
        }  # fmt: skip
        self.width = sum(self._columns.values())
        self._no_goals = tuple(np.full(size, np.nan) for size in (r, k, r))
        self._shapes: dict[str, tuple[int, ...]] = {}  # of the optional arrays in a sample
        self._samples: list[_Recorded] = []

    def take(self, rows: Array) -> None:
        """Take the rows (N, ``width``) of samples that somebody else has recorded, of a plant with the same model.

        Args:
            rows: rows (N, ``width``), in the order of the columns.
        """
        self._samples = [_Recorded(row, self.reduced, None, {}) for row in rows]

    def add(
        self,
        t: float,
        state: StateEvaluation,
        integrals: Array,
        command: Command,
        T: Array,
        report: PlantReport,
        outputs: tuple[Array, Array] | None = None,
        v_measured: Array | None = None,
    ) -> None:
        """Add one sample.

        Args:
            t: time [s].
            state: true state in the outputs of the controller's model.
            integrals: integrals (r,) of the reducing velocities.
            command: command of the controller, with its goals.
            T: applied inputs (p,).
            report: what the plant tells after they are applied.
            outputs: x1 and x2 of the state, if they are known.
            v_measured: measured velocity (nv,); None or empty if measurements are exact.

        Raises:
            InputError: a goal or an estimate of the command has another shape than before.
        """
        given = command.v2_desired, command.x1_desired, command.x2_desired
        goals = [
            none if goal is None else _expect(name, goal, none.shape)
            for name, goal, none in zip(GOALS, given, self._no_goals, strict=True)
        ]
        x1, x2 = state.outputs(integrals) if outputs is None else outputs
        # One call for all columns: samples are recorded while the loop waits.
        row = np.concatenate([(t, report.work), state.q, state.v, state.v2, x1, x2, state.v1, T, integrals, *goals])
        # None for an empty list: to ask NumPy for four sizes takes as long as recording the rest.
        stated = [[*getattr(report, name).values()] or None for name in _STATED]
        told = zip(_OPTIONAL, (command.estimates, command.prediction_error, v_measured, *stated), strict=True)
        optional = {
            name: np.array(_expect(name, value, self._shapes.setdefault(name, np.shape(value))))
            for name, value in told
            if value is not None and np.size(value)
        }
        external = None if report.external is None else np.array(report.external)
        # In one step: Ctrl-C may come between any two, and a sample is whole or missing.
        self._samples.append(_Recorded(row, report.reduced, external, optional))

    @property
    def signals(self) -> dict[str, Array]:
        """Contiguous arrays (N, ...) of the samples so far, by name."""
        rows = np.array([each.row for each in self._samples]).reshape(-1, self.width)
        ends = np.cumsum(list(self._columns.values()))[:-1]
        parts = zip(self._columns, np.split(rows, ends, axis=1), strict=True)
        found = {name: np.ascontiguousarray(part) for name, part in parts}
        # Series, where the others are matrices.
        found |= {name: found[name][:, 0] for name in ("time", "work")}
        for name in _OPTIONAL:
            # Runs in which nobody told it have an array without columns; samples without it have NaN.
            none = np.full(self._shapes.get(name, 0), np.nan)
            told = [each.optional.get(name, none) for each in self._samples]
            found[name] = np.array(told, dtype=float).reshape(len(told), -1 if len(told) else none.size)
        return found

    @property
    def external(self) -> Array | None:
        """Generalized forces (N, nv) in addition to the inputs; None without any."""
        if all(each.external is None for each in self._samples):
            return None
        none = np.zeros(self.reduced.n)  # a plant may begin to report forces in the middle of a run
        return np.array([none if each.external is None else each.external for each in self._samples])

    @property
    def plant_models(self) -> list[ReducedModel]:
        """Known models of the plant, in the order of their first samples."""
        return list(dict.fromkeys(each.plant for each in self._samples if each.plant is not None))

    def stretches(self) -> Iterator[tuple[int, int, ReducedModel]]:
        """Yield first sample, end and model of each interval with one plant; the controller's model for an unknown."""
        start = 0
        for _, group in groupby(self._samples, lambda each: id(each.plant)):
            (first, *others) = group
            end = start + 1 + len(others)
            yield start, end, self.reduced if first.plant is None else first.plant
            start = end


def _expect(name: str, value: Array | list[float], shape: tuple[int, ...]) -> Array:
    """Return a value of a command with this shape; raise an error for another one."""
    value = np.asarray(value)
    if value.shape != shape:
        raise InputError(f"{name} of a command has shape {value.shape}, expected {shape}")
    return value


def blocks(samples: int, numbers: int) -> Iterator[slice]:
    """Yield blocks of samples, so that memory does not grow with the length of the run.

    Args:
        samples: number of samples.
        numbers: temporary numbers per sample.
    """
    # One sample at least, however large its matrices are.
    length = max(1, min(_BLOCK, int(_ROOM / (8 * max(numbers, 1)))))
    for start in range(0, samples, length):
        yield slice(start, min(start + length, samples))


# ------------------------------------------------------------------ signals and metadata

TOP_VIEW = "top_view"
PLOTTED_QUANTITIES = (
    TOP_VIEW, "rates", "outputs", "errors", "inputs", "estimates", "prediction_error", "normal_forces", "margin",
)  # fmt: skip
"""Names that ``Trajectory.plot`` takes besides those of outputs; drawing them is in ``run_figure``."""


class Grounds(NamedTuple):
    """Grounds of the verdict about a run, besides its samples. They are in no file.

    Attributes:
        reduced: model of the run, with the limits of the robot's file and of actuators.
        accelerations: limits of accelerations that the controller keeps.
        missed: goals of the controller that the run has missed at its end.
    """

    reduced: ReducedModel
    accelerations: tuple[LimitedAcceleration, ...] = ()
    missed: tuple[MissedGoal, ...] = ()


@dataclass(frozen=True, repr=False)
class RunData:
    """Record of a run sampled at N times: what happened, and nothing that judges or draws it.

    ``derive`` makes it from samples, ``judge``, ``summarize``, ``plot_run`` and ``export_run`` are functions of it, and
    ``Trajectory`` has them as methods. It never changes.
    """

    time: Float[Array, " N"]
    """Time [s]."""
    q: Float[Array, "N nq"]
    """Configurations."""
    v: Float[Array, "N nv"]
    """Full velocities."""
    v2: Float[Array, "N r"]
    """Rates of the reducing outputs."""
    v2_desired: Float[Array, "N r"]
    """NaN where the controller had no goal."""
    x1: Float[Array, "N k"]
    """Vertical outputs; angles are continuous (unwrapped)."""
    v1: Float[Array, "N k"]
    """Rates of the vertical outputs, ``J1 v``."""
    x1_desired: Float[Array, "N k"]
    """NaN where the controller had no goal."""
    x2: Float[Array, "N r"]
    """Reducing outputs; integrals of v2 for quasi-velocities. Angles are continuous (unwrapped)."""
    x2_desired: Float[Array, "N r"]
    """Desired reducing outputs; the integral of the desired rate if there is only a rate."""
    F: Float[Array, "N r"]
    """Applied reduced force."""
    T: Float[Array, "N p"]
    """Inputs that the plant applied, after it has clipped them."""
    multipliers: Float[Array, "N m"]
    """Multipliers of the kept constraint rows, minus their forces on the robot; NaN where other rows were needed."""
    contact_forces: Float[Array, "N c"]
    """Forces of all constraint rows on the robot, dropped rows included; of least norm if they are not unique."""
    energy: Float[Array, " N"]
    """Energy of the plant, with the plant's masses [J]."""
    work: Float[Array, " N"]
    """Work of actuators, rheonomic constraints and faults, minus the dissipation of damping and friction [J].

    ``energy - work`` is constant.
    """
    constraint_residual: Float[Array, " N"]
    """Largest absolute entry of ``A v - mu`` at the true velocity; for ``ReducedPlant`` of the order of rounding."""
    slip: Float[Array, "N m"]
    """``A v - mu`` of the kept constraint rows [m/s or rad/s]."""
    position_residual: Float[Array, " N"]
    """Largest violation of a holonomic row [m or rad]; zero without such rows."""
    singular_value: Float[Array, " N"]
    """Smallest singular value of the stack E, rows scaled by their typical length; it decides nothing."""
    estimates: Float[Array, "N s"]
    """Parameter estimates of the controller; no columns without named parameters."""
    prediction_error: Float[Array, "N e"]
    """Measured minus predicted rates of the vertical outputs, if the controller predicts them."""
    v_measured: Float[Array, "N w"]
    """Measured full velocities; no columns if measurements are exact."""
    friction_used: Float[Array, "N c2"]
    """Friction use of each contact: friction force over its limit, 1 during slip; no columns without friction."""
    slip_speed: Float[Array, "N c2"]
    """Largest speed at which each contact slid at its limit since the last sample [m/s]; NaN if a plant does not know.

    It is inf where a drive force without a wheel was cut.
    """
    normal_forces: Float[Array, "N c3"]
    """Normal force of the ground on each contact [N]. The model allows negative values; a real contact lifts off.

    No columns without such contacts, or if the plant is not a reduced model.
    """
    ground_poses: Float[Array, "N g"]
    """Position x, y [m] and heading [rad] of each body that moves on the ground; no columns without such bodies."""
    info: RunInfo
    """Names, units, scenario, versions, seed, outcome."""

    grounds: Grounds | None = field(default=None, repr=False, compare=False)
    """Grounds of the verdict besides the samples; None for a run from a file."""

    @property
    def arrays(self) -> dict[str, Array]:
        """All arrays by name, as in the file."""
        return {name: getattr(self, name) for name in _ARRAYS}

    def with_verdict(self, verdict: Verdict) -> Self:
        """Return this run with a verdict, which ``save`` writes.

        Args:
            verdict: findings about the run.
        """
        return replace(self, info=replace(self.info, verdict=verdict))

    @property
    def meta(self) -> dict[str, Json]:
        """Copy of ``info`` as JSON content with fixed keys, as in the file."""
        return self.info.to_json()

    @property
    def outcome(self) -> Outcome:
        """Outcome of the run."""
        return self.info.outcome

    @property
    def phase(self) -> Int[Array, " N"]:
        """Index of the interval between events of contacts of each sample; zero without such events."""
        index = np.zeros(len(self.time), dtype=int)
        for number, each in enumerate(self.info.phases):
            index[each.first_sample :] = number
        return index

    def coordinates(self, kind: str) -> Coordinates:
        """Coordinate types of the outputs of a kind, "x1" or "x2": angles and rotation vectors.

        Args:
            kind: "x1" or "x2".
        """
        return self.info.outputs.of(kind).coordinates

    @classmethod
    def load(cls, path: str | Path, largest: int | None = None) -> Self:
        """Read a file of ``save``.

        Args:
            path: path of the ``.npz`` file.
            largest: largest size of the arrays [bytes]; by default 256 MiB or 20 times the file, whichever is larger.

        Raises:
            ConfigurationError: the file does not exist, is not a trajectory, or is too large.
        """
        from rnc_pin.io.safe_npz import ArchiveError, read_npz  # a run that reads no file starts without it

        path = Path(path)
        names = [*_ARRAYS, "meta"]
        try:
            arrays = read_npz(path, names, text=["meta"], largest=largest)
            missing = [name for name in names if name not in arrays]
            if missing:
                raise ConfigurationError(f"it has no '{missing[0]}'")
            info = RunInfo.from_json(json.loads(str(arrays.pop("meta"))))
            _check(arrays, info.outputs)  # a file of a stranger: wrong shapes would fail later, and far from here
            return cls(info=info, grounds=None, **arrays)
        except FileNotFoundError:
            raise ConfigurationError(f"no file '{path}'") from None
        except json.JSONDecodeError as error:
            raise ConfigurationError(f"{path}: not a trajectory: 'meta' is not JSON: {error}") from None
        except (ConfigurationError, ArchiveError) as error:
            raise ConfigurationError(f"{path}: not a trajectory: {error}") from None
        except (MemoryError, RecursionError, ValueError):  # invalid content or encoding of ``meta``
            raise ConfigurationError(f"{path}: not a trajectory: 'meta' cannot be read") from None


class Trajectory(RunData, SummaryMixin):
    """Run sampled at N times, with the same arrays as the file of ``save``.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> run = rnc.free_motion(reduced, robot.configuration(), [1.0, 0.5], duration=1.0, dt=0.1)
        >>> run
        Trajectory: succeeded, 1 s in 11 samples
        >>> run.q.shape, run.time[-1].item()
        ((11, 4), 1.0)
        >>> bool(np.ptp(run.energy) < 1e-9 * run.energy[0])  # no input, so energy is constant
        True
    """

    @cached_property
    def verdict(self) -> Verdict:
        """Findings about the run: it succeeded only if none fails. Computed at its first use.

        Runs of ``simulate`` and ``free_motion`` are judged by the limits of the robot's file, by distances between its
        links, by contacts and by the commands of the loop. Runs of scenarios are also judged by their goals and
        obstacles, by ``judged_summary`` in ``applications/scenario/simulated_run.py``. ``save`` writes it too.

        Raises:
            ConfigurationError: the run is from a file, and nothing could judge it before it was saved.
        """
        from rnc_pin.simulation.judgement import verdict_of  # a run alone starts without it

        return verdict_of(self)

    def save(self, path: str | Path) -> None:
        """Write a ``.npz`` file with the verdict, for ``load``. An error leaves no partial file.

        Args:
            path: path of the file; an existing one is replaced.
        """
        path = Path(path)
        run: RunData = self
        with suppress(RncError):  # samples that nothing can judge are kept too
            run = self.with_verdict(self.verdict)  # in the file, because it cannot be judged without the robot
        with atomic_file(path) as partial, partial.open("wb") as file:
            np.savez(file, allow_pickle=False, meta=np.array(dump_json(run.meta)), **run.arrays)

    def plot(
        self,
        outputs: Sequence[str] | str | None = None,
        *,
        title: str | None = None,
        comparisons: Mapping[str, Trajectory] | None = None,
        size: Size | None = None,
        labels: Mapping[str, str] | None = None,
        name: str | None = None,
        file: str | Path | None = None,
    ) -> Figure:
        """Plot the run: paths from above, and outputs, errors, inputs and distance from singularity over time.

        Args:
            outputs: names of outputs and of quantities, in the order of the panels; all by default. Quantities are
                "top_view", "rates", "outputs", "errors", "inputs", "estimates", "prediction_error", "normal_forces"
                and "margin".
            title: title above the plots.
            comparisons: other runs by label, dashed.
            size: "column" or "page" of a paper (3.4 and 7 inches wide), or width and height [inches]. Text has 8
                points on these. By default the figure is for the screen, and its size follows from its panels.
            labels: text by name of an output, an input, a run or an axis, such as ``{"joint_1": r"$\\theta_1$"}``.
            name: legend entry of this run beside others; the name of its scenario by default.
            file: file to write: .png, .pdf or .svg. An existing one is replaced.

        Returns:
            Matplotlib figure.

        Raises:
            InputError: the run has fewer than two samples, a name is unknown, or the panels do not fit the size.
            ConfigurationError: the file has another ending.
        """
        from rnc_pin.figures.style import save  # Matplotlib takes a second to import
        from rnc_pin.simulation.run_figure import plot_run

        figure = plot_run(self, outputs, title, comparisons or {}, size, labels or {}, name)
        if file is not None:
            save(figure, file)
        return figure

    def export(self, file: str | Path, arrays: Sequence[str] | None = None) -> None:
        """Write the run as a table for other programs. An existing file is replaced.

        There is one header per column, such as ``x2.tip_x [m]``: array, name and unit. ``save`` writes arrays.

        Args:
            file: name that ends in .csv.
            arrays: names of the arrays, such as ``["x2", "T"]``; ``time`` is always written. All by default.

        Raises:
            ConfigurationError: the file has another ending.
            InputError: unknown array.
        """
        export_run(self, file, arrays)

    def _summary(self) -> ObjectSummary:
        from rnc_pin.simulation.summary import add_verdict, summarize  # a run alone starts without it

        found = summarize(self)
        with suppress(RncError):  # samples that nothing can judge print their outcome
            add_verdict(found, self.verdict)
        return cast("PrintedSummary", found).summary_of("Trajectory")


def tracking_errors(trajectory: RunData) -> dict[str, np.ndarray]:
    """Desired minus actual value over time, (N,) per output with a goal; NaN before the first goal.

    Args:
        trajectory: the run.
    """
    errors: dict[str, np.ndarray] = {}
    for kind in ("x2", "x1"):
        desired, actual = getattr(trajectory, f"{kind}_desired"), getattr(trajectory, kind)
        # On the manifold of the outputs: an angle of 359 degrees is 1 degree from zero.
        difference = trajectory.coordinates(kind).difference(desired, actual)
        for column, name in enumerate(trajectory.info.outputs.of(kind).names):
            if name in trajectory.info.goals:
                errors[name] = difference[:, column]
    return errors


SERIES_UNITS = {
    "time": "s", "energy": "J", "work": "J", "constraint_residual": "m/s or rad/s", "position_residual": "m or rad",
    "singular_value": "-",
}  # fmt: skip
"""Arrays of one number a sample, and their units."""
_ARRAYS = tuple(each.name for each in fields(RunData) if each.name not in ("info", "grounds"))


def _check(arrays: dict[str, np.ndarray], outputs: OutputNames) -> None:
    for name, array in arrays.items():
        # Wrong types too: text or integers in place of floats fail in NumPy, with other words.
        depth = 1 if name in SERIES_UNITS else 2
        if array.dtype.kind != "f" or array.ndim != depth or len(array) != arrays["time"].size:
            raise ConfigurationError(f"'{name}' has shape {array.shape}")
    for kind in (each.name for each in fields(OutputNames)):
        columns: Columns = getattr(outputs, kind)
        count, width = len(columns.names), arrays[kind].shape[1]
        is_output, per_name = kind in ("x1", "x2"), 3 if kind == "ground_poses" else 1
        # Others may have no names, but inputs and bodies are looked up by them.
        named = per_name * count == width or (count == 0 and kind not in ("x1", "x2", "T", "ground_poses"))
        if not named or (is_output and not len(columns.units) == len(columns.angular) == width):
            raise ConfigurationError(f"'meta' does not name the columns of '{kind}'")
        # None of them: a file of a run without quasi-velocities leaves the flags out.
        if not {len(columns.units), len(columns.quasi)} <= {0, count}:
            raise ConfigurationError(f"'meta' does not have units or kinds of all columns of '{kind}'")
    # All other arrays may have NaN, where a plant or a controller does not know a value.
    if not all(np.isfinite(arrays[name]).all() for name in ("time", "q", "v2")):
        raise ConfigurationError("it holds values that are not finite")
    if (np.diff(arrays["time"]) < 0).any():
        raise ConfigurationError("its time runs backwards")


# ------------------------------------------------------------------ names and units of columns


class Column(NamedTuple):
    """Name and unit of a column of an array; the unit is "-" for numbers and "" if it is unknown."""

    name: str
    unit: str


def columns_of_array(run: RunData, array: str) -> list[Column]:
    """Names and units of the columns of an array, one per column; the name is "" for an array of one dimension.

    Args:
        run: the run.
        array: name of an array, such as "q".
    """
    values, info = getattr(run, array), run.info
    if values.ndim == 1:
        return [Column("", SERIES_UNITS[array])]
    found = _named(info, array)
    # A run that was made by hand may have no names.
    return found if len(found) == values.shape[1] else [Column(str(k), "") for k in range(values.shape[1])]


def _named(info: RunInfo, array: str) -> list[Column]:
    """Columns of an array with two dimensions; none without names."""
    origin = info.provenance
    if array in ("estimates", "prediction_error"):
        named = origin.estimates if array == "estimates" else origin.predicted
        return [Column(name, unit or "-") for name, unit in named.items()]
    source = _NAMED_AS.get(array, array)
    columns: Columns = getattr(info.outputs, source)
    if array == "ground_poses":
        parts = (("x", "m"), ("y", "m"), ("heading", "rad"))
        return [Column(f"{name}.{part}", unit) for name in columns.names for part, unit in parts]
    units = list(columns.units or [""] * len(columns.names))
    if source in ("x1", "x2"):
        units = [unit or "-" for unit in units]
    if array in ("v1", "v2", "v2_desired"):
        units = [f"{'1' if unit == '-' else unit}/s" for unit in units]
    elif array == "F":
        units = [FORCE_UNITS.get(f"{unit}/s", "") for unit in units]
    elif array == "slip":
        units = [RATE_UNITS.get(unit, "") for unit in units]
    elif array == "slip_speed":
        units = ["m/s"] * len(units)
    return [Column(*pair) for pair in zip(columns.names, units, strict=True)]


_NAMED_AS = {
    "x1_desired": "x1", "v1": "x1", "x2_desired": "x2", "v2": "x2", "v2_desired": "x2", "F": "x2", "v_measured": "v",
    "slip": "multipliers", "slip_speed": "friction_used",
}  # fmt: skip
"""Arrays whose columns have the names of another array."""


def export_run(run: RunData, path: str | Path, arrays: Sequence[str] | None = None, replace: bool = True) -> Path:
    """Write the arrays of a run as ``Trajectory.export`` does. An error leaves no partial file.

    Args:
        run: the run.
        path: name of the file.
        arrays: names of the arrays; all by default.
        replace: True replaces an existing file.

    Raises:
        ConfigurationError: the name has another ending than .csv.
        InputError: unknown array.
        OSError: the file cannot be written.
    """
    path = Path(path)
    if path.suffix != ".csv":
        raise ConfigurationError(f"{path}: expected a name that ends in .csv")
    known = list(run.arrays)
    chosen = known if arrays is None else ["time", *(name for name in arrays if name != "time")]
    for name in chosen:
        place_of(name, known, "arrays: the run has no", InputError)
    headers = [
        f"{name}{each.name and '.' + each.name}{each.unit and f' [{each.unit}]'}"
        for name in chosen
        for each in columns_of_array(run, name)
    ]
    with atomic_file(path, replace) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        # By the library: names of a user's outputs may have commas and quotes.
        csv.writer(file, lineterminator="\n").writerow(headers)
        # 17 digits give every float back to the bit.
        np.savetxt(file, np.column_stack([getattr(run, name) for name in chosen]), fmt="%.17g", delimiter=",")
    return path
