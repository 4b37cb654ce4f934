"""Scenario: one object between a scenario file and Python."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml

from rnc_pin.applications.scenario.builder import Experiment, build_experiment, build_reduced, build_task, start_of
from rnc_pin.applications.scenario.controllers import without_foreign_gains
from rnc_pin.applications.scenario.files import (
    apply_options,
    find_scenario,
    is_built_in,
    mapping_of,
    read_yaml,
    with_options,
)
from rnc_pin.applications.scenario.from_objects import RunObjects, content_of, experiment_of
from rnc_pin.applications.scenario.phase_builder import build_phased
from rnc_pin.applications.scenario.plan_builder import Plans
from rnc_pin.applications.scenario.plant_builder import collected_model_warnings
from rnc_pin.applications.scenario.schema import ScenarioFile
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.applications.scenario.schema.world import build_obstacles
from rnc_pin.applications.scenario.simulated_run import Simulated, judged_summary, simulated
from rnc_pin.collision import Obstacle
from rnc_pin.control import Controller
from rnc_pin.errors import ConfigurationError, ModelWarning, RncError
from rnc_pin.io import Json
from rnc_pin.model import NonholonomicSystem, ReducedModel, Task
from rnc_pin.planning import Reference
from rnc_pin.plants import Plant
from rnc_pin.printing import ObjectSummary, SummaryMixin, items
from rnc_pin.robots import Robot
from rnc_pin.simulation import Observer, SimulationOptions, Trajectory


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
        without_form: parts of a scenario from objects that have no form in a file, by key, and why.
    """

    name: str
    raw: dict[str, Json]
    folder: Path
    built_in: bool = False
    source: str = ""
    show_warnings: bool = True
    without_form: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        objects: RunObjects,
        duration: float,
        dt: float = 0.002,
        *,
        settings: Mapping[str, Json] | None = None,
        name: str = "scenario",
    ) -> Scenario:
        """Make a scenario from Python objects, which runs, and can be saved if every part has a form in a file.

        Objects of this package have one, except controllers, references with an absolute start, and plants: give a
        mapping in the form of a scenario file in their place. Functions of your own have none.

        Args:
            objects: model, controller, start, references and what else the run needs.
            duration: simulated time [s].
            dt: sampling period [s].
            settings: other keys of a scenario file, such as ``{"goal_tolerance": 0.01}``.
            name: name of the scenario.

        Raises:
            ConfigurationError: a mapping is not valid, a role is not known, or a controller in a mapping has references
                or obstacles without a form in a file.

        Example:
            >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
            >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
            >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
            >>> reach = {"primary": rnc.planning.RelativeMinimumJerk(to=[0.5, 0.4, -0.3], duration=1.0)}
            >>> tracker = {"type": "reducing_outputs", "preset": "scaled"}
            >>> objects = rnc.RunObjects(reduced, tracker, robot.configuration(), references=reach)
            >>> scenario = rnc.Scenario.of(objects, 1.5)
            >>> scenario.run().verdict.word, dict(scenario.without_form)
            ('succeeded', {})
        """
        reduced, controller, plant = objects.reduced, objects.controller, objects.plant
        more = dict(settings or {})
        more["simulation"] = {**mapping_of(more.get("simulation")), "duration": duration, "dt": dt}
        raw, content, without_form = content_of(objects, more, name)
        made = cls(name, raw, Path.cwd(), source=name, without_form=without_form)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)  # the user has seen those of the system
            system = NonholonomicSystem(reduced.robot, *reduced.given[:4])
        made = made.built_with(content, BuiltModel(system, reduced, ()))
        if not isinstance(controller, Mapping):
            made.__dict__["obstacles"] = tuple(objects.obstacles)
            return made.built_with(experiment=experiment_of(content, objects))
        if plant is not None and not isinstance(plant, Mapping):
            return made.built_with(experiment=replace(made.experiment, plant=plant))
        return made

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
        _ = made.content
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
        source = said if said == path.stem else path.name
        return cls(path.stem, read_yaml(path), path.parent, is_built_in(path), source)

    def with_options(self, options: Mapping[str, Json]) -> Scenario:
        """Return this scenario with other values, its variant and its preset. Nothing is built or checked yet.

        Args:
            options: dotted keys and values to replace.

        Raises:
            ConfigurationError: a part has no form in a file, so that no option can change the scenario.
        """
        if options:
            self._check_form("options need the form of a file")
        return replace(self, raw=apply_options(self.raw, options))

    def built_with(
        self,
        content: ScenarioFile | None = None,
        model: BuiltModel | None = None,
        experiment: Experiment | None = None,
        comparisons: dict[str, Experiment] | None = None,
    ) -> Scenario:
        """Return this scenario with objects that exist already. Objects that are built later use them.

        Args:
            content, model, experiment, comparisons: values of these properties; None for those that are built later.
        """
        made = copy.copy(self)
        given = {"content": content, "model": model, "experiment": experiment, "comparisons": comparisons}
        made.__dict__.update({name: value for name, value in given.items() if value is not None})
        return made

    def build(self) -> Scenario:
        """Build all objects of the run and of its comparisons now, and return the scenario.

        Raises:
            RncError: a part of the scenario does not fit the robot.
        """
        _ = self.experiment
        _ = self.comparisons
        return self

    # ------------------------------------------------------------------ objects

    @cached_property
    def content(self) -> ScenarioFile:
        """Checked content of the file."""
        return validate(self.raw, self._label)

    @cached_property
    def model(self) -> BuiltModel:
        """System and reduced model of a scenario without phases, with the warnings about them."""
        with RncError.at(self._label), collected_model_warnings(self.show_warnings) as told:
            built = build_reduced(self.content, self.folder)
        return BuiltModel(*built, tuple(told))

    @cached_property
    def experiment(self) -> Experiment:
        """Objects of the run."""
        if self.content.phases:
            return self._experiment(self.content, None)
        made = self._experiment(self.content, self.model.reduced)
        return replace(made, model_warnings=tuple(dict.fromkeys((*self.model.warnings, *made.model_warnings))))

    @cached_property
    def comparisons(self) -> dict[str, Experiment]:
        """Objects of the runs that the scenario compares with its own, by label.

        Comparisons may fail on purpose, to show the difference. Their preflight therefore only warns.
        """
        found: dict[str, Experiment] = {}
        slugs: dict[str, str] = {}
        for label, changes in self.content.comparisons.items():
            where = f"comparisons.{label}"
            raw = with_options(without_foreign_gains(self.raw, changes), {"preflight": "warn", **changes})
            other = validate(raw, f"{self._label}: {where}")
            if slugs.setdefault(slug(label), label) != label:
                names = f"'{label}' and '{slugs[slug(label)]}'"
                raise ConfigurationError(f"comparisons: {names} give one file name").within(self._label)
            found[label] = self._experiment(other, None, where)
        return found

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
        """Reduced model; in a scenario with phases that of the first."""
        return self.experiment.reduced if self.content.phases else self.model.reduced

    @property
    def task(self) -> Task:
        """Task; by default all reducing outputs are primary."""
        return build_task(self.content, self.reduced)

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
        return self.experiment.simulation.duration

    @property
    def dt(self) -> float:
        """Sampling period [s]."""
        return self.experiment.simulation.dt

    @property
    def total_duration(self) -> float:
        """Simulated time of the run and its comparisons [s]."""
        return self.duration + sum(each.simulation.duration for each in self.comparisons.values())

    @cached_property
    def _start(self) -> tuple[np.ndarray, np.ndarray]:
        if self.content.phases:
            return self.experiment.q0, self.experiment.v2_0
        with RncError.at(self._label):
            return start_of(self.content, self.reduced)

    @cached_property
    def _plans(self) -> Plans:
        return Plans()

    def _experiment(self, content: ScenarioFile, reduced: ReducedModel | None, where: str = "") -> Experiment:
        with RncError.at(f"{self._label}: {where}" if where else self._label):
            with collected_model_warnings(self.show_warnings) as told:
                if content.phases:
                    experiment = build_phased(content, self.folder)
                else:
                    experiment = build_experiment(content, self.folder, self._plans, reduced)
            return replace(experiment, model_warnings=tuple(told))

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
            run = self.simulated(self.experiment, observer)
            judged_summary(self.experiment, run.trajectory, run.gave_way)
        if run.error is not None:
            raise run.error
        return run.trajectory

    def simulated(self, experiment: Experiment, observer: Observer | None = None) -> Simulated:
        """Simulate the run or one of its comparisons. An error that ends it early is part of the result.

        Args:
            experiment: objects of the run.
            observer: called with every ``Sample``.
        """
        return simulated(experiment, partial(self.options, experiment), observer)

    def options(self, experiment: Experiment, observer: Observer | None = None) -> SimulationOptions:
        """Options of the run or one of its comparisons, with its provenance.

        Args:
            experiment: objects of the run.
            observer: called with every ``Sample``.
        """
        provenance = replace(
            experiment.provenance,
            scenario=self.name,
            seed=experiment.scenario.seed,
            config=None if self.without_form else self.raw,
            folder=None if self.built_in else str(self.folder),
        )
        stop = experiment.simulation.stop
        return SimulationOptions(stop=stop, loop=experiment.loop, observer=observer, meta=provenance)

    # ------------------------------------------------------------------ files

    def save(self, path: str | PathLike[str]) -> None:
        """Write the scenario with its options as a file, which runs from any folder of this computer.

        Args:
            path: path of the file.

        Raises:
            ConfigurationError: a part of a scenario from objects has no form in a file.
            OSError: the file cannot be written.
        """
        self._check_form("it cannot be saved")
        Path(path).write_text(yaml.safe_dump(self._portable(), sort_keys=False), encoding="utf-8")

    def _check_form(self, consequence: str) -> None:
        if self.without_form:
            parts = "; ".join(f"{key}: {why}" for key, why in self.without_form.items())
            raise ConfigurationError(f"{self._label}: {consequence}: {parts}")

    def _portable(self) -> dict[str, Json]:
        source = self.raw.get("robot")
        if not isinstance(source, Mapping):
            return self.raw
        beside = self.folder / str(source.get("urdf"))
        if not beside.is_file():
            return self.raw
        return {**self.raw, "robot": {**source, "urdf": str(beside.resolve())}}

    def _summary(self) -> ObjectSummary:
        content = self.content
        made = "none" if "controller" not in self.without_form else type(self.controller).__name__
        controller = made if content.controller is None else content.controller.type
        settings = content.simulation
        time = "none" if settings is None else f"{settings.duration:g} s, dt {settings.dt:g} s"
        title = f"Scenario '{self.name}'" + (f": {content.title}" if content.title else "")
        said = content.robot.urdf or content.robot.mjcf or content.robot.example
        lines = [("robot", items([str(said)])), ("controller", items([controller])), ("simulation", items([time]))]
        lines.append(("keys", items(list(self.raw))))
        if self.without_form:
            lines.append(("without a form in a file", items(list(self.without_form))))
        return ObjectSummary(title, lines)


def slug(label: str) -> str:
    """Return a label in the form of a part of a file name."""
    return "".join(letter if letter.isalnum() else "_" for letter in label)
