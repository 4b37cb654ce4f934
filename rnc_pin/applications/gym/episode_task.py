"""Episodes of a scenario: their model, random starts, goals and duration."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from rnc_pin.applications.scenario.builder import start_of
from rnc_pin.applications.scenario.files import with_options
from rnc_pin.applications.scenario.loading import admitted
from rnc_pin.applications.scenario.output_references import OutputReference, output_references
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.schema import ScenarioFile, SimulationSettings
from rnc_pin.applications.scenario.schema.reference_settings import References
from rnc_pin.applications.scenario.schema.scenario import Initial
from rnc_pin.applications.scenario.schema.sweep_settings import Distribution, Distributions
from rnc_pin.collision import CollisionDistances, PairSelection
from rnc_pin.errors import ConfigurationError, InfeasibleError, RncError, SingularityError
from rnc_pin.io import Json, to_json_mapping
from rnc_pin.simulation import assembled_start, sample_count

_MOST_DRAWS = 20  # largest number of draws for one start
_DRAWN = ("initial", "reference")
_SAMPLES = 10  # samples of the scenario in one step of the environment, by default
_WHOLE = 1e-6  # largest deviation of a number of samples from a whole number


class EpisodeStart(NamedTuple):
    """Start of one episode.

    Attributes:
        q: configuration (nq,).
        v: full velocity (nv,).
        references: goals over time.
    """

    q: np.ndarray
    v: np.ndarray
    references: tuple[OutputReference, ...]


class EpisodeTask:
    """Task of a scenario without its controller, which the agent replaces.

    Args:
        scenario: a built-in name or a file.
        options: dotted keys and values to replace.
        draws: dotted keys under ``initial`` or ``reference``, with ranges for random starts; None for the ``sweep`` of
            the scenario.
        period: time between two actions [s]; None for ten samples of the scenario.
        min_singular_value: smallest singular value of ``E = [A; J2]`` with scaled rows below which an episode ends.

    Attributes:
        reduced: the model.
        scenario: the validated scenario.
        period: time between two actions [s].
        samples: samples of the scenario in one period.
        steps: actions in an episode.

    Raises:
        RncError: the scenario is invalid, or has something that an environment does not support.
    """

    def __init__(
        self,
        scenario: str,
        options: Mapping[str, Json],
        draws: Mapping[str, object] | None,
        period: float | None,
        min_singular_value: float,
    ) -> None:
        given = Scenario.load(scenario, options)
        self._name, self.scenario = given.source, given.content
        settings = _supported(self.scenario, self._name)
        self.period = _SAMPLES * settings.dt if period is None else period
        self.samples = sample_count(self.period, settings.dt) - 1
        if abs(self.samples * settings.dt / self.period - 1.0) > _WHOLE:
            raise ConfigurationError(f"period {self.period:g} s is no multiple of simulation.dt, {settings.dt:g} s")
        self.steps = sample_count(settings.duration, self.period) - 1
        self.min_singular_value = min_singular_value
        self.reduced = given.reduced
        robot, obstacles = self.reduced.robot, given.obstacles
        shapes = robot.collision_model if obstacles else None
        self.distances = None
        """Distances of the links from the obstacles; None without either."""
        if shapes is not None and len(shapes.geometryObjects):
            self.distances = CollisionDistances(robot, obstacles, PairSelection(links=False))
        if not self.reduced.p:
            raise ConfigurationError(f"{self._name}: actuators: there are none, so there are no actions")
        self._task = given.task
        self._raw: dict[str, Json] = {key: given.raw.get(key) or {} for key in _DRAWN}
        self._draws = self._distributions(draws)
        self.nominal = self._start(self._raw)
        """Start without draws."""

    def start(self, generator: np.random.Generator) -> EpisodeStart:
        """Return a random start.

        Raises:
            ConfigurationError: no draw gives a start.
        """
        if not self._draws:
            return self.nominal
        for _ in range(_MOST_DRAWS):
            values: dict[str, Json] = {key: each.draw(generator) for key, each in self._draws.items()}
            try:
                return self._start(with_options(self._raw, values))
            except RncError as error:
                failure = error
        raise ConfigurationError(f"{self._name}: none of {_MOST_DRAWS} draws gives a start: {failure}")

    def _start(self, raw: Mapping[str, Json]) -> EpisodeStart:
        initial = admitted(Initial, _mapping(raw["initial"]), f"{self._name}: initial")
        reference = admitted(References, _mapping(raw["reference"]), f"{self._name}: reference")
        scenario = self.scenario.model_copy(update={"initial": initial, "reference": reference})
        reduced = self.reduced
        q0, v2_0 = start_of(scenario, reduced)
        state = reduced.at(assembled_start(reduced, q0), v2_0, t=0.0)
        if state.smallest_singular_value < self.min_singular_value:
            raise InfeasibleError(
                f"{self._name}: the start is nearly singular: smallest singular value "
                f"{state.smallest_singular_value:.2g}, limit {self.min_singular_value:g}"
            )
        return EpisodeStart(state.q, state.v, output_references(scenario, reduced, self._task, q0))

    def _distributions(self, draws: Mapping[str, object] | None) -> dict[str, Distribution]:
        """Admitted distributions. Those of the scenario's controller mean nothing to an agent."""
        given = (
            self.scenario.sweep
            if draws is None
            else admitted(Distributions, to_json_mapping(draws, "draws"), "draws").root
        )
        distributions = {}
        for key, distribution in given.items():
            part = key.partition(".")[0]
            if draws is None and part == "controller":
                continue
            if part not in _DRAWN:
                raise ConfigurationError(f"draws: '{key}': expected a key under 'initial' or 'reference'")
            distributions[key] = distribution
            with suppress(InfeasibleError, SingularityError):  # an unknown name is an error now, not at the first reset
                self._start(with_options(self._raw, {key: distribution.examples()[0]}))
        return distributions


def _mapping(raw: Json) -> Mapping[str, Json]:
    assert isinstance(raw, Mapping)  # the whole scenario is valid
    return raw


def _supported(scenario: ScenarioFile, name: str) -> SimulationSettings:
    """Return the simulation of a scenario that an environment supports.

    Raises:
        ConfigurationError: it does not.
    """
    settings, plant = scenario.simulation, scenario.plant
    if settings is None:
        raise ConfigurationError(f"{name}: simulation: is missing; an environment needs {{duration: ..., dt: ...}}")
    velocities = plant is not None and plant.settings.servo_time is not None
    refused = {
        "phases": bool(scenario.phases),
        "contacts": bool(scenario.contacts),
        "faults": scenario.faults is not None,
        "plant": plant is not None and plant.type != "reduced",
        "plant.servo_time": velocities,
        "simulation.on_lift_off": settings.on_lift_off != "ignore",
    }
    for key, found in refused.items():
        if found:
            raise ConfigurationError(f"{name}: {key}: environments do not support it")
    return settings
