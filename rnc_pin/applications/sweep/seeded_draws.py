"""Seeded draws: values of each run, independent of the other runs and of where it is computed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from rnc_pin.applications.scenario.files import apply_options, find_scenario, read_yaml
from rnc_pin.applications.scenario.schema.run_settings import ChoiceDistribution, Distribution, Distributions
from rnc_pin.applications.scenario.schema.scenario import admitted, validate
from rnc_pin.errors import ConfigurationError
from rnc_pin.io import Json, to_json_mapping

Draw: TypeAlias = Mapping[str, object]
"""Values of a run by name; in sweeps of a scenario, options by dotted key."""


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
