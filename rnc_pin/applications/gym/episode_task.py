"""Episodes of a scenario: their model, random starts, goals, duration and limits."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rnc_pin.applications.scenario.builder import start_of
from rnc_pin.applications.scenario.controllers.context import MIN_SINGULAR_VALUE
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import with_options
from rnc_pin.applications.scenario.reference_builder import OutputReference, output_references
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.schema import ScenarioFile, SimulationSettings
from rnc_pin.applications.scenario.schema.motions import References
from rnc_pin.applications.scenario.schema.run_settings import Distribution, Distributions
from rnc_pin.applications.scenario.schema.scenario import Initial, admitted
from rnc_pin.collision import CollisionDistances, PairSelection
from rnc_pin.errors import ConfigurationError, InfeasibleError, InputError, RncError, SingularityError
from rnc_pin.io import Json, to_json_mapping
from rnc_pin.model import ReducedModel
from rnc_pin.simulation import assembled_start, sample_count

_MOST_DRAWS = 20  # largest number of draws for one start
_DRAWN = ("initial", "reference")
_SAMPLES = 10  # samples of the scenario in one step of the environment, by default
_WHOLE = 1e-6  # largest deviation of a number of samples from a whole number
_INPUT, _SPEED, _OUTPUT = 2.0, 10.0, 2.0  # multiples of what the scenario's own run needs
_SMALLEST = 0.1  # smallest limit relative to the largest one of the same unit


@dataclass(frozen=True)
class EpisodeLimits:
    """Symmetric limits of an environment; None for the default of each.

    A default comes from the model where it has effort limits. The others come from one run of the scenario with its
    own controller: twice its largest inputs and outputs, and ten times its largest velocities. Of quantities with the
    same unit, no limit is below a tenth of the largest one. A limit that is still zero becomes one unit.

    Args:
        input: largest actuator inputs (p,) [N or N m], or one number: the action space. The effort limits of
            the model hold too.
        speed: largest reduced velocities (r,), or one number; a larger one ends the episode as diverged.
        output: largest outputs x1 and x2 (k + r,), or one number; larger observations are clipped. Angles have pi.
        singular_value: smallest singular value of ``E = [A; J2]`` with scaled rows; below it the episode ends.

    Example:
        >>> rnc.gym.EpisodeLimits(input=20.0, speed=4.0, output=[1.0, 1.0, 3.0]).speed
        4.0
    """

    input: ArrayLike | None = None
    speed: ArrayLike | None = None
    output: ArrayLike | None = None
    singular_value: float = MIN_SINGULAR_VALUE

    def completed(self, reduced: ReducedModel, scenario: str, options: Mapping[str, Json]) -> SpaceBounds:
        """Return all limits as arrays; a run of the scenario gives the missing ones.

        Args:
            reduced: model of the scenario.
            scenario: a built-in name or a file.
            options: dotted keys and values to replace.

        Raises:
            InputError: a limit has the wrong size or is not positive.
            RncError: a limit is missing, and the scenario cannot run.
        """
        effort = reduced.actuation.limits
        x1, x2 = reduced.vertical, reduced.reducing
        sizes = {"input": reduced.p, "speed": reduced.r, "output": x1.size + x2.size}
        limits = {name: _admitted(name, getattr(self, name), size) for name, size in sizes.items()}
        if limits["input"] is None and np.isfinite(effort).all():
            limits["input"] = np.array(effort)
        if any(limit is None for limit in limits.values()):
            run = execute(Scenario.load(scenario, {**options, "comparisons": {}})).trajectory
            position_units = tuple(unit.removesuffix("/s") for unit in (*x1.units, *x2.units))
            needed = {
                "input": _INPUT * _largest(run.T, reduced.actuation.units),
                "speed": _SPEED * _largest(run.v2, x2.units),
                "output": _OUTPUT * _largest(np.hstack([run.x1, run.x2]), position_units),
            }
            needed["input"] = np.where(np.isfinite(effort), effort, needed["input"])
            limits = {name: needed[name] if limit is None else limit for name, limit in limits.items()}
        largest = np.minimum(np.array(limits["input"]), effort)
        output = np.array(limits["output"])
        output[np.concatenate([x1.coordinates.kinds, x2.coordinates.kinds]) > 0] = np.pi  # angles, rotation vectors
        return SpaceBounds(largest, np.array(limits["speed"]), output)


@dataclass(frozen=True)
class SpaceBounds:
    """Completed limits.

    Attributes:
        input: largest inputs (p,).
        speed: largest reduced velocities (r,).
        output: largest outputs x1 and x2 (k + r,).
    """

    input: np.ndarray
    speed: np.ndarray
    output: np.ndarray


def _admitted(name: str, value: ArrayLike | None, size: int) -> np.ndarray | None:
    if value is None:
        return None
    try:
        limit = np.array(np.broadcast_to(np.asarray(value, dtype=float), (size,)))
    except (TypeError, ValueError):
        raise InputError(f"limits.{name}: expected a number or {size} numbers, found {value!r}") from None
    if not (limit > 0).all() or not np.isfinite(limit).all():
        raise InputError(f"limits.{name}: expected positive finite numbers, found {value!r}")
    return limit


def _largest(series: np.ndarray, units: tuple[str, ...]) -> np.ndarray:
    """Largest magnitude of each column of a series (N, size)."""
    largest = np.nan_to_num(np.abs(series)).max(axis=0, initial=0.0)
    for unit in set(units):
        same = np.array([each == unit for each in units])
        largest[same] = np.maximum(largest[same], _SMALLEST * largest[same].max())
    return np.where(largest > 0, largest, 1.0)


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
