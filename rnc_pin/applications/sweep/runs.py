"""Runs of a sweep: their draws, their simulation, and the columns of their rows.

Values of a run are independent of the other runs and of where it is computed. What draws do not change is built once in
each process.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np

from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import find_scenario
from rnc_pin.applications.scenario.scenario import BuiltModel, Scenario
from rnc_pin.applications.scenario.schema.run_settings import Distribution, Distributions
from rnc_pin.applications.scenario.schema.scenario import admitted
from rnc_pin.errors import ConfigurationError, InfeasibleError, RncError, SingularityError
from rnc_pin.io import Json, open_regular, recorded_reads, to_json_mapping
from rnc_pin.simulation import Outcome, Summary, Trajectory, add_verdict, simulate, summarize

Draw: TypeAlias = Mapping[str, object]
"""Values of a run by name; in sweeps of a scenario, options by dotted key."""

Row: TypeAlias = dict[str, Any]
"""One run of a sweep: number, drawn values and results by column."""

Numbered: TypeAlias = tuple[int, Draw | None]
"""Number of a run, and its given values; None draws them by the number of the run."""

# ------------------------------------------------------------------ columns of results

ERRORS = ("final_error", "max_error", "rms_error")
"""Results by output; a column has the name of the output behind a point."""
LIMITS = "limit_excess"
"""Largest excess over joint limits, as a share of their range; a column has the kind of the limit behind a point."""
TEXTS = ("outcome", "verdict", "finding", "message")
"""Results that are texts, in the row of every run."""
_MEASURED = (
    "min_singular_value", "constraint_residual_max", "position_residual_max", "energy_drift", "off_tracking_max",
)  # fmt: skip
_DISTANCES = ("smallest_distance", "smallest_own_distance")
_NUMBERS = ("run", "redrawn", "duration", *_MEASURED, "goals_missed", "lowest_normal_force", *_DISTANCES, "wall_time")


def is_number_column(column: str) -> bool:
    """True for columns of results that are numbers.

    Args:
        column: name of a column of rows.
    """
    return column in _NUMBERS or column.partition(".")[0] in (*ERRORS, LIMITS)


def is_result_column(column: str) -> bool:
    """True for columns of results; False for drawn values.

    Args:
        column: name of a column of rows.
    """
    return column in TEXTS or column == "warnings" or is_number_column(column)


def drawn_values(row: Row) -> dict[str, Json]:
    """Drawn values of a row.

    Args:
        row: row of a run, with its results.
    """
    return {name: value for name, value in row.items() if value is not None and not is_result_column(name)}


def results_of(summary: Summary) -> Row:
    """Columns of results from the summary of a run.

    Args:
        summary: summary of the run, as ``rnc-pin run`` writes it.
    """
    found, lift_off = cast("Row", summary), summary["lift_off"]
    first = summary.get("first_finding", {"kind": "", "message": ""})
    return {
        "outcome": summary["outcome"],
        "verdict": summary["verdict"],
        "finding": first["kind"],
        "message": first["message"],
        "duration": summary["duration"],
        **{f"{kind}.{name}": value for kind in ERRORS for name, value in found[kind].items()},
        **{name: found[name] for name in _MEASURED if name in found},
        "goals_missed": len(summary.get("goals_missed", ())),
        "lowest_normal_force": None if lift_off is None else lift_off["lowest"],
        **{name: found[name]["distance"] if found.get(name) else None for name in _DISTANCES},
        **{f"{LIMITS}.{kind}": worst["excess"] for kind, worst in summary.get("joint_limits", {}).items()},
    }


def refused(outcome: str, error: RncError) -> Row:
    """Columns of results of a run that could not start.

    Args:
        outcome: kind of the refusal, such as "infeasible".
        error: its reason.
    """
    return {"outcome": outcome, "verdict": "failed", "finding": outcome, "message": str(error)}


# ------------------------------------------------------------------ draws


@dataclass(frozen=True)
class Draws:
    """Seeded draws that ``sweep`` is asked for.

    Attributes:
        runs: number of runs.
        distributions: distribution by name, in the form of ``sweep`` in scenario files, such as ``[minimum, maximum]``
            or ``{"normal": {"mean": 0.0, "std": 0.1}}``. A scenario has its own by default.
        seed: seed of the draws; by default 0, or the scenario's.

    Example:
        >>> rnc.Draws(20, {"speed": [0.5, 1.5]}, seed=1).runs
        20
    """

    runs: int
    distributions: Mapping[str, object] | None = None
    seed: int | None = None


@dataclass(frozen=True)
class SeededDraws:
    """Draws from distributions. Each run has its own random stream.

    Attributes:
        distributions: distributions by name; their order is part of the specification.
        seed: seed of all streams.
    """

    distributions: Mapping[str, Distribution]
    seed: int = 0

    @classmethod
    def of(cls, distributions: Mapping[str, object], seed: int = 0) -> SeededDraws:
        """Read distributions in the form of scenario files, such as ``{"mass": [1, 2]}``.

        Args:
            distributions: distribution by name.
            seed: seed of all streams.

        Raises:
            ConfigurationError: a distribution is invalid.
        """
        return cls(admitted(Distributions, to_json_mapping(distributions, "distributions"), "distributions").root, seed)

    def of_run(self, run: int) -> Iterator[dict[str, Json]]:
        """Yield the values of a run, then replacements for them.

        Args:
            run: number of the run.
        """
        # By number: a run draws the same values on any process, and when a sweep continues.
        generator = np.random.default_rng([self.seed, run])
        while True:
            yield {key: each.draw(generator) for key, each in self.distributions.items()}

    def describe(self) -> dict[str, Json]:
        """Seed and distributions as JSON content."""
        return {
            "seed": self.seed,
            "distributions": {key: each.model_dump(exclude_none=True) for key, each in self.distributions.items()},
        }


def draws_of(scenario: str, options: Mapping[str, Json]) -> SeededDraws:
    """Draws that the ``sweep`` and the ``seed`` of a scenario specify.

    Args:
        scenario: a built-in name or a file.
        options: dotted keys and values that all runs share.

    Raises:
        ConfigurationError: the scenario has no ``sweep``, or does not take the values that it may draw.
    """
    made = Scenario.read(scenario)
    checked = made.with_options(options).content
    if not checked.sweep:
        missing = "sweep: is missing; give dotted keys and ranges, e.g. initial.q.joint: [0, 1]"
        raise ConfigurationError(missing).within(made.source)
    for key, distribution in checked.sweep.items():
        drawing = replace(made, source=f"{made.source}: sweep.{key}")
        # A key or a type that does not fit is refused now, and not in each of a million runs.
        for value in distribution.examples():
            _ = drawing.with_options({**options, key: value}).content
    return SeededDraws(checked.sweep, checked.seed)


def check_names(draw: Draw) -> None:
    """Raise an error if a drawn value has the name of a result.

    Args:
        draw: values by name.
    """
    for name in draw:
        if not isinstance(name, str) or is_result_column(name):
            raise ConfigurationError(f"draws: {name!r} is the name of a result; choose another one")


# ------------------------------------------------------------------ runs


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


class Runs(ABC):
    """Source of the rows of a sweep. It is pickled for other processes.

    Args:
        draws: seeded draws; None if every run gets its values.
    """

    def __init__(self, draws: SeededDraws | None) -> None:
        self.draws = draws

    def row(self, run: int, draw: Draw | None = None) -> Row:
        """Simulate a run and return its row.

        Args:
            run: number of the run.
            draw: its given values; None draws them by the number of the run.
        """
        start = time.perf_counter()
        draws = iter([draw]) if draw is not None else cast(SeededDraws, self.draws).of_run(run)
        with np.errstate(over="ignore", invalid="ignore"):  # diverged values
            row = self._row(run, draws)
        return {"run": run, **row, "wall_time": time.perf_counter() - start}

    @abstractmethod
    def describe(self) -> dict[str, Json]:
        """Source of the runs, for the specification of their sweep."""

    @abstractmethod
    def _row(self, run: int, draws: Iterator[Draw]) -> Row:
        """Drawn values and results of a run, whose draws are tried one after the other."""


def _judged(trajectory: Trajectory, summary: Summary) -> Row:
    """Columns of results of a simulated run."""
    # An interrupted run is no result: the same command repeats it.
    if trajectory.outcome is Outcome.INTERRUPTED:
        raise KeyboardInterrupt
    return results_of(summary)


Build: TypeAlias = Callable[[Row], "Mapping[str, object] | Trajectory"]
"""Function of drawn values that returns the arguments of ``simulate`` by name, or a finished run."""


class FunctionRuns(Runs):
    """Runs that a function builds from drawn values.

    Args:
        build: function of the drawn values.
        draws: as for ``Runs``.
    """

    def __init__(self, build: Build, draws: SeededDraws | None) -> None:
        super().__init__(draws)
        self._build = build

    def describe(self) -> dict[str, Json]:
        """Name of the function and digest of its source, if it has one."""
        build = self._build
        name = f"{getattr(build, '__module__', '?')}.{getattr(build, '__qualname__', type(build).__qualname__)}"
        try:
            source = _digest(inspect.getsource(build).encode())
        # Functions of C, and those of a prompt, have no source.
        except (OSError, TypeError):
            source = ""
        return {"build": name, "source": source}

    def _row(self, run: int, draws: Iterator[Draw]) -> Row:
        draw = next(draws)
        row = to_json_mapping(draw, f"draws: run {run}")
        try:
            # A copy: the function may change it, and the row has what was drawn.
            trajectory = _simulated(self._build(dict(draw)))
        except RncError as error:
            if not isinstance(error.trajectory, Trajectory):
                return {**row, **refused("refused", error)}
            trajectory = error.trajectory
        summary = summarize(trajectory)
        add_verdict(summary, trajectory.verdict)
        return {**row, **_judged(trajectory, summary)}


def _simulated(built: object) -> Trajectory:
    if isinstance(built, Mapping):
        built = simulate(**built)
    if not isinstance(built, Trajectory):
        raise TypeError(
            f"build returned {type(built).__name__}, expected the arguments of rnc.simulate by name, or a Trajectory"
        )
    return built


def with_options_of_sweeps(options: Mapping[str, Json]) -> dict[str, Json]:
    """Options of every run of a sweep: no comparisons and plots, and preflight refuses instead of warning.

    Args:
        options: options that all runs share, by dotted key.
    """
    # Behind the options of a user: a row has no place for pictures; before them: 'warn' is a choice.
    return {"preflight": "refuse", **options, "comparisons": [], "plots": {}}


MOST_DRAWS = 20
"""Largest number of draws for one run; then its outcome is "infeasible"."""
_STRUCTURE = ("robot", "constraints", "ground", "mimic", "actuators", "forces", "outputs")


class ScenarioRuns(Runs):
    """Runs of a scenario with drawn options.

    A draw is repeated if preflight refuses it, no gains fit, or it has no plan; ``redrawn`` counts. A run with faults
    has its own seed, which follows from the scenario's seed and its number.

    Args:
        scenario: a built-in name or a file.
        options: dotted keys and values that all runs share.
        draws: as for ``Runs``.
    """

    def __init__(self, scenario: str, options: Mapping[str, Json], draws: SeededDraws | None = None) -> None:
        super().__init__(draws)
        # Warnings are a column of the rows.
        self._name, self._file = scenario, replace(Scenario.read(scenario), show_warnings=False)
        self._options = dict(options)
        self._seed = self._file.with_options(self._options).content.seed
        self._models: dict[str, BuiltModel] = {}

    def __getstate__(self) -> dict[str, object]:
        # Models are built anew in each process: they hold Pinocchio's data, and are larger than their description.
        return {**self.__dict__, "_models": {}}

    def describe(self) -> dict[str, Json]:
        """Name, options and digests of the scenario and of the files that are read for it."""
        folder, files = self._file.folder, dict[str, Json]()
        for each in sorted(self._files_read()):
            # Files of other folders by name: a package may be elsewhere on another computer.
            place = str(each.relative_to(folder)) if each.is_relative_to(folder) else each.name
            with open_regular(each) as file:
                files[place] = str(files.get(place, "")) + hashlib.file_digest(file, "sha256").hexdigest()[:16]
        name = self._name if self._file.built_in else str(find_scenario(self._name).resolve())
        content = _digest(json.dumps(self._file.raw, default=repr).encode())  # dates of YAML are no JSON
        return {"scenario": name, "options": self._options, "content": content, "files": files}

    def _files_read(self) -> set[Path]:
        """Files from which robots and obstacles are read: includes, meshes, pictures of maps, parts of an MJCF."""
        drawn = {} if self.draws is None else self.draws.distributions
        # Drawn parts of the robot read files as well.
        parts = {key: each for key, each in drawn.items() if key.partition(".")[0] in (*_STRUCTURE, "obstacles")}
        read: set[Path] = set()
        for options in ({}, *({key: value} for key, each in parts.items() for value in each.examples())):
            with recorded_reads() as found, suppress(RncError):  # runs tell what is wrong
                made = self._file.with_options({**self._options, **options})
                _ = self._model(made).reduced.robot.collision_model, made.obstacles
            read |= found
        return {path for path in read if path.name != "package.xml"}  # read once in a process

    def options_of(self, run: int, drawn: Draw) -> dict[str, Json]:
        """Options of a run with drawn values, which ``rnc-pin run`` takes too.

        Args:
            run: number of the run.
            drawn: its values.
        """
        values = cast("Mapping[str, Json]", drawn)
        options: dict[str, Json] = {**with_options_of_sweeps(self._options), "seed": self._seed, **values}
        parts = {*self._file.raw, *(key.partition(".")[0] for key in options)}
        if "seed" not in drawn and "faults" in parts:
            # From seed and number: noise differs between runs, and a repeated run has the same.
            options["seed"] = int(np.random.SeedSequence([self._seed, run]).generate_state(1)[0])
        return options

    def _row(self, run: int, draws: Iterator[Draw]) -> Row:
        for redrawn, drawn in enumerate(islice(draws, MOST_DRAWS)):
            options = self.options_of(run, drawn)
            row = {**drawn, "seed": options["seed"], "redrawn": redrawn}
            try:
                scenario = self._file.with_options(options)
                scenario = scenario.built_with(model=self._model(scenario)).build()
            except (InfeasibleError, SingularityError) as error:
                # What preflight, gains or a plan refuse is drawn again; any other error is a result.
                failure: RncError = error
                continue
            except RncError as error:
                return {**row, **refused("refused", error)}
            told = (*scenario.experiment.model_warnings, *scenario.experiment.warnings)
            try:
                result = execute(scenario)
            except RncError as error:
                return {**row, "warnings": "; ".join(told), **refused("refused", error)}
            return {**row, "warnings": "; ".join(told), **_judged(result.trajectory, result.summary)}
        return {**row, **refused("infeasible", failure)}

    def _model(self, scenario: Scenario) -> BuiltModel:
        """Model of a scenario, which runs of this process with the same system and outputs share."""
        # What changes the model; other options leave it as it is.
        key = json.dumps([scenario.raw.get(each) for each in _STRUCTURE], default=repr)
        most = 8  # models that a process keeps; structures of a sweep are few, but a model is large
        if key not in self._models:
            if len(self._models) >= most:
                # The oldest one.
                self._models.pop(next(iter(self._models)))
            self._models[key] = scenario.model
        return self._models[key]


def runs_of(build: Build | str | Path, draws: Draws | None, options: Mapping[str, object] | None) -> Runs:
    """Runs of a sweep.

    Args:
        build: function of the drawn values, or a scenario.
        draws: seeded draws; None if every run gets its values.
        options: options of a scenario.

    Raises:
        ConfigurationError: draws of a function without distributions, or a scenario without a sweep.
    """
    if not isinstance(build, str | Path):
        if options:
            raise ConfigurationError("options: those of a scenario; a function takes values from its draws")
        return FunctionRuns(build, None if draws is None else _stated(draws))
    scenario, shared = str(build), to_json_mapping(options or {}, "options")
    if draws is not None and draws.distributions is not None:
        shared["sweep"] = to_json_mapping(draws.distributions, "distributions")
    if draws is not None and draws.seed is not None:
        shared["seed"] = draws.seed
    return ScenarioRuns(scenario, shared, None if draws is None else draws_of(scenario, shared))


def _stated(draws: Draws) -> SeededDraws:
    """Draws of a function, which have to state their distributions."""
    if not draws.distributions:
        example = f"rnc.Draws({draws.runs}, {{'mass': [1, 2]}})"
        raise ConfigurationError(f"draws: {draws.runs} runs of a function need distributions, e.g. {example}")
    check_names(draws.distributions)
    return SeededDraws.of(draws.distributions, draws.seed or 0)
