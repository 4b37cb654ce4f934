"""Scenario: one object between a scenario file and Python."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml

from rnc_pin.applications.scenario import builder
from rnc_pin.applications.scenario.builder import Experiment
from rnc_pin.applications.scenario.controllers import without_foreign_gains
from rnc_pin.applications.scenario.files import find_scenario, is_built_in, read_yaml, with_options
from rnc_pin.applications.scenario.plan_builder import Plans
from rnc_pin.applications.scenario.schema import ScenarioFile
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.applications.scenario.schema.world import absolute_files, build_obstacles
from rnc_pin.applications.scenario.simulated_run import judged_summary
from rnc_pin.collision import Obstacle
from rnc_pin.control import Controller
from rnc_pin.errors import RncError, check_unique
from rnc_pin.interruption import nothing_to_keep
from rnc_pin.io import Json
from rnc_pin.model import NonholonomicSystem, ReducedModel, Task
from rnc_pin.motion.planning import Reference
from rnc_pin.plants import Plant
from rnc_pin.printing import ObjectSummary, SummaryMixin, items
from rnc_pin.robots import Robot
from rnc_pin.simulation import Observer, SimulationOptions, Trajectory, simulate


class BuiltModel(NamedTuple):
    """System of a scenario, its reduced model, and the warnings about them."""

    system: NonholonomicSystem
    reduced: ReducedModel
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Scenario(SummaryMixin):
    """Scenario: robot, constraints, outputs, controller and simulation, and the objects that they make.

    ``load`` reads and checks the file. Each object is built when it is first asked for, and then kept. A file without
    outputs gets those that ``NonholonomicSystem.reduce`` chooses. A run needs ``controller`` and ``simulation``.

    >>> scenario = rnc.Scenario.load("space-robot", {"simulation.duration": 0.1})
    >>> scenario.reduced.reducing.names
    ('tip_x', 'tip_y', 'joint_1')
    >>> run = scenario.run()
    >>> len(run.time)
    51

    Attributes:
        name: name of the scenario.
        raw: mapping of the scenario file, with options.
        folder: base of relative paths in the scenario.
        built_in: True for a scenario of the package; its record contains no folder of this computer.
        source: name of the scenario in errors.
        show_warnings: True to show warnings about the model, beside keeping them.
    """

    name: str
    raw: dict[str, Json]
    folder: Path
    built_in: bool = False
    source: str = ""
    show_warnings: bool = True

    @classmethod
    def load(cls, scenario: str | PathLike[str], options: Mapping[str, Json] | None = None) -> Scenario:
        """Read a scenario and check it.

        Args:
            scenario: a built-in name or a file.
            options: dotted keys and values to replace, such as ``{"simulation.duration": 5.0}``.

        Raises:
            ConfigurationError: the scenario is invalid; the first error with file, key, and what is expected.
        """
        made = cls.read(scenario).with_options(options or {})
        _ = made.content  # checked now, where a user reads the message
        return made

    @classmethod
    def read(cls, scenario: str | PathLike[str]) -> Scenario:
        """Read a scenario as the file has it: its variants and presets are not applied, and nothing is checked.

        Args:
            scenario: a built-in name or a file.

        Raises:
            ConfigurationError: there is no such scenario, or the file cannot be read.
        """
        said = str(scenario)
        path = find_scenario(said).resolve()
        source = said if said == path.stem else path.name  # no folders of this computer in messages
        return cls(path.stem, read_yaml(path), path.parent, is_built_in(path), source)

    def with_options(self, options: Mapping[str, Json]) -> Scenario:
        """Return this scenario with other values, its variant and its preset. Nothing is built or checked yet.

        Args:
            options: dotted keys and values to replace.
        """
        return replace(self, raw=_applied(self.raw, options))

    def built_with(
        self, content: ScenarioFile | None = None, model: BuiltModel | None = None, experiment: Experiment | None = None
    ) -> Scenario:
        """Return this scenario with objects that exist already. Objects that are built later use them.

        Args:
            content, model, experiment: values of these properties; None for those that are built later.
        """
        made = copy.copy(self)  # ``replace`` would drop what is built
        given = {"content": content, "model": model, "experiment": experiment}
        made.__dict__.update({name: value for name, value in given.items() if value is not None})
        return made

    def build(self) -> Scenario:
        """Build all objects of the run and of its comparisons now, and return the scenario.

        Raises:
            RncError: a part of the scenario does not fit the robot.
        """
        for each in (self, *self.comparisons.values()):
            _ = each.experiment
        return self

    # ------------------------------------------------------------------ objects

    @cached_property
    def content(self) -> ScenarioFile:
        """Checked content of the file."""
        return validate(absolute_files(self.raw, self.folder), self._label)

    @cached_property
    @nothing_to_keep()
    def model(self) -> BuiltModel:
        """System and reduced model, with the warnings about them."""
        content = self.content  # its errors have the label already
        with RncError.at(self._label), builder.collected_model_warnings(self.show_warnings) as told:
            system = builder.build_system(content, self.folder)
            reduced = content.reduced(system)
        return BuiltModel(system, reduced, tuple(told))

    @cached_property
    @nothing_to_keep()
    def experiment(self) -> Experiment:
        """Objects of the run."""
        model = self.model
        with RncError.at(self._label), builder.collected_model_warnings(self.show_warnings) as told:
            made = builder.build_experiment(self.content, self.folder, self._plans, model.reduced)
        return replace(made, model_warnings=tuple(dict.fromkeys((*model.warnings, *told))))

    @cached_property
    def comparisons(self) -> dict[str, Scenario]:
        """Variants that the scenario compares its own run with, by name.

        They may fail on purpose, to show the difference. Their preflight therefore only warns.
        """
        found: dict[str, Scenario] = {}
        compared = self.content.compared
        with RncError.at(self._label):  # "a b" and "a_b" would write one trajectory_a_b.npz
            check_unique([slug(name) for name in compared], "comparisons: two labels give one file name")
        for name, changes in compared.items():
            raw = _varied(self.raw, {"preflight": "warn", **changes})
            found[name] = replace(self, raw=raw, source=f"{self._label}: comparisons.{name}")
            vars(found[name])["_plans"] = self._plans  # equal problems are solved once
        return found

    @property
    def title(self) -> str:
        """Title of the file, or the name of the scenario."""
        return self.content.title or self.name

    @property
    def system(self) -> NonholonomicSystem:
        """System of robot, constraints and actuators."""
        return self.model.system

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.reduced.robot

    @property
    def reduced(self) -> ReducedModel:
        """Reduced model."""
        return self.model.reduced

    @property
    def task(self) -> Task:
        """Task; by default all reducing outputs are primary."""
        return builder.build_task(self.content, self.reduced)

    @property
    def controller(self) -> Controller:
        """Controller."""
        return self.experiment.controller

    @property
    def plant(self) -> Plant:
        """Simulated plant, with its faults."""
        return self.experiment.plant

    @property
    def references(self) -> Mapping[str, Reference]:
        """References of the task by role: ``primary``, ``redundant``, ``vertical``; empty without a controller."""
        return self.experiment.references

    @cached_property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """Bodies in the world."""
        with RncError.at(self._label):
            return build_obstacles(self.content.obstacles, self.folder)

    @property
    def q0(self) -> np.ndarray:
        """Initial configuration (nq,)."""
        return self._start[0]

    @property
    def v2_0(self) -> np.ndarray:
        """Initial reduced velocity (r,)."""
        return self._start[1]

    @property
    def duration(self) -> float:
        """Simulated time of the run [s]."""
        return self.experiment.simulation.seconds

    @property
    def dt(self) -> float:
        """Sampling period [s]."""
        return self.experiment.simulation.dt

    @property
    def total_duration(self) -> float:
        """Simulated time of the run and its comparisons [s]."""
        return self.duration + sum(each.duration for each in self.comparisons.values())

    @cached_property
    def _start(self) -> tuple[np.ndarray, np.ndarray]:
        with RncError.at(self._label):
            return builder.start_of(self.content, self.reduced)

    @cached_property
    def _plans(self) -> Plans:
        return {}

    @property
    def _label(self) -> str:
        """Name of the scenario in errors."""
        return self.source or self.name

    # ------------------------------------------------------------------ runs

    def run(self, observer: Observer | None = None) -> Trajectory:
        """Simulate the run, without its comparisons. ``verdict`` of the trajectory tells whether it succeeded.

        Args:
            observer: called with every ``Sample``.

        Raises:
            RncError: the scenario cannot be built, or the run failed; ``trajectory`` of the error has what it reached.
        """
        with np.errstate(over="ignore", invalid="ignore"):  # diverged values
            run, error = self.simulated(observer)
            run, *_ = judged_summary(self.experiment, run)
        if error is not None:
            error.trajectory = run
            raise error
        return run

    def simulated(self, observer: Observer | None = None) -> tuple[Trajectory, RncError | None]:
        """Simulate the run. Return its motion, and the error that ended it early.

        Args:
            observer: called with every ``Sample``.
        """
        made, options = self.experiment, self.options(observer)
        given = made.reduced, made.controller, made.q0, self.duration, self.dt
        # A run that failed is a result, as far as it went; an error before its first sample is none.
        try:
            return simulate(*given, v2_0=made.v2_0, plant=made.plant, options=options), None
        except RncError as failure:
            if not isinstance(failure.trajectory, Trajectory):
                raise
            return failure.trajectory, failure

    def options(self, observer: Observer | None = None) -> SimulationOptions:
        """Options of the run, with its provenance.

        Args:
            observer: called with every ``Sample``.
        """
        experiment = self.experiment
        provenance = replace(
            experiment.provenance,
            scenario=self.name,
            seed=experiment.scenario.seed,
            config=self.raw,
            folder=None if self.built_in else str(self.folder),
        )
        stop, stated = experiment.simulation.stop, experiment.scenario.loop
        loop = {} if stated is None else stated.options
        return SimulationOptions(stop=stop, loop=loop, observer=observer, meta=provenance)

    # ------------------------------------------------------------------ files

    def save(self, path: str | PathLike[str]) -> None:
        """Write the scenario with its options as a file, which runs from any folder of this computer.

        Args:
            path: path of the file.

        Raises:
            OSError: the file cannot be written.
        """
        portable = absolute_files(self.raw, self.folder, ("urdf", "mjcf", "csv", "file"))
        Path(path).write_text(yaml.safe_dump(portable, sort_keys=False), encoding="utf-8")

    def _summary(self) -> ObjectSummary:
        content = self.content
        controller = "none" if content.controller is None else content.controller.type
        settings = content.simulation
        time = "none" if settings is None else f"{settings.duration} s, dt {settings.dt:g} s"
        title = f"Scenario '{self.name}'" + (f": {content.title}" if content.title else "")
        said = content.robot.urdf or content.robot.mjcf or content.robot.example
        lines = [("robot", items([str(said)])), ("controller", items([controller]))]
        lines += [("simulation", items([time.replace("plan s", "its plan")])), ("keys", items(list(self.raw)))]
        return ObjectSummary(title, lines)


def slug(label: str) -> str:
    """Return a label in the form of a part of a file name.

    Args:
        label: the label.
    """
    return "".join(letter if letter.isalnum() else "_" for letter in label)


def _applied(raw: Mapping[str, Json], options: Mapping[str, Json]) -> dict[str, Json]:
    """Return a scenario with its ``variant``, the ``presets`` of its controller's preset, and options.

    Each of them overrides those before it. The result runs as it is: it chooses no variant, and has no ``presets``.
    """
    # Options may choose the variant and the preset, so they are applied first to see, and last to count.
    applied = with_options(raw, options)
    variant = _choice(applied.get("variants"), applied.get("variant"))
    if variant is not None:
        raw, options = ({key: each[key] for key in each if key != "variant"} for each in (raw, options))
        raw = _varied(raw, variant)
        applied = with_options(raw, options)
    controller = applied.get("controller")
    preset = _choice(applied.get("presets"), controller.get("preset") if isinstance(controller, dict) else None)
    if preset is None:
        return applied
    applied = with_options(with_options(raw, preset), options)
    return {key: value for key, value in applied.items() if key != "presets"}


def _varied(raw: Mapping[str, Json], variant: Mapping[str, Json]) -> dict[str, Json]:
    """Return a scenario with the values of a variant, which may change the type of the controller alone."""
    return with_options(without_foreign_gains(raw, variant), variant)


def _choice(choices: object, name: object) -> dict[str, Json] | None:
    found = choices.get(name) if isinstance(choices, dict) and isinstance(name, str) else None
    return found if isinstance(found, dict) else None
