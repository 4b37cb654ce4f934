"""Seeded draws, and runs of a scenario with drawn options.

Values of a run are independent of the other runs and of where it is computed. What draws do not change is built once in
each process.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import cast

import numpy as np

from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import apply_options, find_scenario, read_yaml
from rnc_pin.applications.scenario.scenario import BuiltModel, Scenario
from rnc_pin.applications.scenario.schema.run_settings import ChoiceDistribution, Distribution, Distributions
from rnc_pin.applications.scenario.schema.scenario import admitted, validate
from rnc_pin.applications.sweep.rows import (
    Draw,
    Numbered,
    Row,
    refused,
    results_of,
    save_trajectory,
    with_options_of_sweeps,
)
from rnc_pin.errors import ConfigurationError, InfeasibleError, RncError, SingularityError
from rnc_pin.io import Json, to_json_mapping


@dataclass(frozen=True)
class Draws:
    """Seeded draws that ``sweep`` is asked for.

    Attributes:
        runs: number of runs.
        distributions: distribution by name, in the form of ``sweep`` in scenario files, such as ``[minimum, maximum]``
            or ``{"normal": {"mean": 0.0, "std": 0.1}}``. A scenario has its own by default.
        seed: seed of the draws; by default 0, or that of the scenario.

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

        Raises:
            ConfigurationError: a distribution is invalid.
        """
        return cls(admitted(Distributions, to_json_mapping(distributions, "distributions"), "distributions").root, seed)

    def of_run(self, run: int) -> Iterator[dict[str, Json]]:
        """Yield the values of a run, then replacements for them."""
        generator = np.random.default_rng([self.seed, run])
        while True:
            yield {key: each.draw(generator) for key, each in self.distributions.items()}

    def examples(self, name: str) -> list[Json]:
        """Values that decide the type of a drawn value: all of a choice, the ends of others."""
        distribution = self.distributions[name]
        values = list(distribution.examples())
        return values if isinstance(distribution, ChoiceDistribution) else [distribution.draw(np.random.default_rng(0))]

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
    path = find_scenario(scenario)
    raw = read_yaml(path)
    checked = validate(apply_options(raw, options), path.name)
    if not checked.sweep:
        raise ConfigurationError(
            f"{path.name}: sweep: is missing; give dotted keys and ranges, e.g. initial.q.joint: [0, 1]"
        )
    for key, distribution in checked.sweep.items():
        for value in distribution.examples():
            validate(apply_options(raw, {**options, key: value}), f"{path.name}: sweep.{key}")
    return SeededDraws(checked.sweep, checked.seed)


# ------------------------------------------------------------------ runs

MOST_DRAWS = 20
"""Largest number of draws for one run; then its outcome is "infeasible"."""
_STRUCTURE = ("robot", "constraints", "ground", "mimic", "actuators", "forces", "outputs")
_MOST_MODELS = 8  # models that a process keeps


class ScenarioRuns:
    """Runs of a scenario with drawn options.

    A draw is repeated if preflight refuses it, no gains fit, or it has no plan; ``redrawn`` counts.

    Args:
        scenario: a built-in name or a file.
        options: dotted keys and values that all runs share.
        draws: seeded draws; None if every run gets its values.
        seed: seed of the scenario. A run with faults has its own seed, which follows from this one and its number.
        trajectories: folder of the sweep, for trajectories; None writes none.
    """

    def __init__(
        self,
        scenario: str,
        options: Mapping[str, Json],
        draws: SeededDraws | None,
        seed: int,
        trajectories: str | None = None,
    ) -> None:
        self._file = replace(Scenario.read(scenario), show_warnings=False)
        self._options, self._draws, self._seed, self._trajectories = dict(options), draws, seed, trajectories
        self._models: dict[str, BuiltModel] = {}

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "_models": {}}

    def rows(self, batch: Sequence[Numbered]) -> list[Row]:
        """Simulate the runs one after the other and return their rows."""
        return [self.row(run, draw) for run, draw in batch]

    def row(self, run: int, draw: Draw | None = None) -> Row:
        """Simulate a run and return its row."""
        start = time.perf_counter()
        found, scenario = self._prepared(run, draw)
        if scenario is not None:
            found |= self._results(run, scenario)
        return {"run": run, **found, "wall_time": time.perf_counter() - start}

    def options_of(self, run: int, drawn: Draw) -> dict[str, Json]:
        """Options of a run with drawn values, which ``rnc-pin run`` takes too."""
        options: dict[str, Json] = {
            **with_options_of_sweeps(self._options),
            "seed": self._seed,
            **cast(Mapping[str, Json], drawn),
        }
        parts = {*self._file.raw, *(key.partition(".")[0] for key in options)}
        if "seed" not in drawn and "faults" in parts:
            options["seed"] = int(np.random.SeedSequence([self._seed, run]).generate_state(1)[0])
        return options

    def _prepared(self, run: int, draw: Draw | None) -> tuple[Row, Scenario | None]:
        """Drawn values of a run and its scenario; without one also the results of a run that cannot start."""
        draws: Iterable[Draw]
        if draw is None:
            assert self._draws is not None
            draws = islice(self._draws.of_run(run), MOST_DRAWS)
        else:
            draws = (draw,)
        for redrawn, drawn in enumerate(draws):
            options = self.options_of(run, drawn)
            row = {"redrawn": redrawn, **drawn, "seed": options["seed"]}
            try:
                scenario = self._scenario(options)
                told = (*scenario.experiment.model_warnings, *scenario.experiment.warnings)
                return {**row, "warnings": "; ".join(told)}, scenario
            except (InfeasibleError, SingularityError) as error:
                failure: RncError = error
            except RncError as error:
                return {**row, **refused("refused", error)}, None
        return {**row, **refused("infeasible", failure)}, None

    def _results(self, run: int, scenario: Scenario) -> Row:
        """Simulate a run and return its columns of results."""
        try:
            result = execute(scenario)
        except RncError as error:
            return refused("refused", error)
        if result.interrupted:
            raise KeyboardInterrupt
        save_trajectory(result.trajectory, self._trajectories, run)
        return results_of(result.summary)

    def _scenario(self, options: Mapping[str, Json]) -> Scenario:
        """Build the objects of a run. Runs of this process with the same system and outputs share their model."""
        made = self._file.with_options(options)
        model = None if made.content.phases else self._model(made)
        return made.built_with(model=model, comparisons={}).build()

    def _model(self, scenario: Scenario) -> BuiltModel:
        key = json.dumps([scenario.raw.get(each) for each in _STRUCTURE], default=repr)
        if key not in self._models:
            if len(self._models) >= _MOST_MODELS:
                self._models.pop(next(iter(self._models)))
            self._models[key] = scenario.model
        return self._models[key]
