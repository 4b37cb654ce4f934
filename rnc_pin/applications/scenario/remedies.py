"""Remedies for a motion that a controller cannot make: each is an edit of the scenario, tried by a run.

A refusal names what was tried, with its result. A remedy that runs is an edit that the user can make.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from rnc_pin.applications.scenario.controllers import read_by
from rnc_pin.applications.scenario.controllers.base import ControllerSettings
from rnc_pin.applications.scenario.controllers.tracking import RedundancySettings, VelocityTrackerSettings
from rnc_pin.applications.scenario.files import mapping_of, with_options
from rnc_pin.applications.scenario.schema.scenario import output_of
from rnc_pin.errors import InfeasibleError, RncError, SimulationError, SingularityError, few, short_text
from rnc_pin.io import Json
from rnc_pin.model import NonholonomicSystem, Task
from rnc_pin.simulation import Observer, Outcome, Sample, Trajectory

_PATIENCE, _LONGEST = 20.0, 10.0  # processor time of all trials, after which no other begins, and of one run [s]
_SLOWER = 2.0  # factor of a slower reference
_NEARER = 0.5  # part of the way to a nearer goal
_TIMES = {"duration": 1.0, "begin": 1.0, "times": 1.0, "ramp": 1.0, "frequency": -1.0}  # key to the power of the factor
_SWAPS = 2  # largest number of other outputs that are tried
_BESIDE_THE_RUN = ("comparisons", "plots", "sweep", "view", "variants", "presets")  # parts that a trial omits

Options = dict[str, Json]
Run = Callable[[Mapping[str, Json], Observer], Trajectory]


class Remedy(NamedTuple):
    """Edit of a scenario: what it is in words, and the keys that it changes."""

    words: str
    options: Options


class Refused(NamedTuple):
    """Scenario whose motion was refused.

    Attributes:
        raw: mapping of the scenario file.
        controller: settings of its controller.
        system, task: system and task of the run.
        starts: initial values of the task's outputs by role: ``primary``, ``redundant``, ``vertical``.
        error: the refusal.
    """

    raw: Mapping[str, Json]
    controller: ControllerSettings
    system: NonholonomicSystem
    task: Task
    starts: Mapping[str, np.ndarray]
    error: InfeasibleError


def try_remedies(refused: Refused, run: Run) -> InfeasibleError:
    """Try remedies for a refused motion. Return the refusal with their results, those that succeed first.

    Args:
        refused: the scenario and its refusal.
        run: simulates the mapping of a scenario with an observer; the result has its verdict.
    """
    raw = {key: value for key, value in refused.raw.items() if key not in _BESIDE_THE_RUN}
    begin = time.process_time()
    helpful: list[str] = []
    useless: list[str] = []
    left: list[str] = []
    for remedy in remedies_of(refused):
        if time.process_time() - begin > _PATIENCE:
            left.append(remedy.words)
            continue
        succeeded, result = _result(run, with_options(raw, remedy.options))
        (helpful if succeeded else useless).append(f"{remedy.words}: {result}")
    error = refused.error
    words = [str(error)]
    words += [f"tried with success: {each}" for each in helpful] + [f"tried in vain: {each}" for each in useless]
    words += [f"not tried for lack of time: {', '.join(left)}"] if left else []
    error.args = ("; ".join(words),)
    return error


def remedies_of(refused: Refused) -> Iterator[Remedy]:
    """Remedies that fit a scenario, the smallest edits first."""
    controller = refused.controller
    if isinstance(controller, VelocityTrackerSettings) and controller.tracker == "adaptive":
        edit: Options = {"controller.tracker": "computed_torque"}
        if controller.gravity_compensation is not None:
            edit["controller.gravity_compensation"] = None
        yield Remedy("controller.tracker=computed_torque", edit)
    if controller.type == "qp":
        given, kind = mapping_of(refused.raw["controller"]), "inverse_dynamics"
        yield Remedy(f"controller.type={kind}", {"controller": {**read_by(kind, given), "type": kind}})
    redundant, vertical = len(refused.task.redundant), len(refused.task.vertical)
    if isinstance(controller, RedundancySettings) and controller.secondary is None and redundant > vertical:
        yield Remedy("controller.secondary={singularity: {}}", {"controller.secondary": {"singularity": {}}})
    yield from _slower(refused.raw)
    yield from _nearer(refused)
    yield from _other_outputs(refused)


def _slower(raw: Mapping[str, Json]) -> Iterator[Remedy]:
    """The same motion in more time."""
    simulation, timed = raw.get("simulation"), _timed(raw)
    if not timed or not isinstance(simulation, Mapping):
        return
    options: Options = {key: _scaled(value, _SLOWER ** _TIMES[key.rpartition(".")[2]]) for key, value in timed.items()}
    longer = _scaled(simulation.get("duration", 0.0), _SLOWER)
    yield Remedy(f"references and simulation {_SLOWER:g} times slower", {**options, "simulation.duration": longer})


def _timed(raw: Mapping[str, Json]) -> Options:
    """Times in the references of a scenario and of its tasks, by their keys."""
    found: Options = {}

    def search(value: Json, key: str) -> None:
        if isinstance(value, Mapping):
            for name, below in value.items():
                if name in _TIMES:
                    found[f"{key}.{name}"] = below
                else:
                    search(below, f"{key}.{name}")
        elif isinstance(value, list):
            for index, below in enumerate(value):
                search(below, f"{key}.{index}")

    search(raw.get("reference"), "reference")
    search(mapping_of(raw.get("controller")).get("tasks"), "controller.tasks")
    return found


def _nearer(refused: Refused) -> Iterator[Remedy]:
    """A part of the way to the goals of the references."""
    options: Options = {}
    for role, reference in mapping_of(refused.raw.get("reference")).items():
        motion = mapping_of(reference).get("minimum_jerk")
        if not isinstance(motion, Mapping):
            return  # the part of another motion is not defined
        start, key = refused.starts[role], f"reference.{role}.minimum_jerk"
        for name, origin in (("by", 0.0 * start), ("to", start)):
            if name in motion:
                goal = np.asarray(motion[name], dtype=float)
                options[f"{key}.{name}"] = (origin + _NEARER * (goal - origin)).round(6).tolist()
    if options:
        yield Remedy(f"goals at {_NEARER:g} of the way", options)


def _scaled(value: Json, factor: float) -> Json:
    if isinstance(value, list):
        return [_scaled(each, factor) for each in value]
    return value * factor if isinstance(value, int | float) else value


def _other_outputs(refused: Refused) -> Iterator[Remedy]:
    """Other joints in place of a redundant one: those that keep E farthest from singular where the motion was refused.

    Primary and vertical outputs have goals, so they stay.
    """
    q, task = refused.error.q, refused.task
    entries = mapping_of(refused.raw.get("outputs")).get("reducing")
    if q is None or not isinstance(entries, list):
        return
    joints = [each.get("joint") if isinstance(each, Mapping) else None for each in entries]
    robot = refused.system.robot
    others = [name for name in robot.joint_names if name not in joints and name not in task.vertical_names]
    found: list[tuple[float, Remedy]] = []
    for index, old in enumerate(joints):
        if old not in task.redundant_names:
            continue
        for new in others:
            changed = [*entries[:index], {"joint": new}, *entries[index + 1 :]]
            value = _margin(refused.system, changed, q)
            if value > (refused.error.singular_value or 0.0):
                names: list[Json] = [new if each == old else each for each in task.redundant_names]
                edit: Options = {"outputs.reducing": changed, "task.redundant": names}
                found.append((value, Remedy(f"joint {new} instead of {old} among the reducing outputs", edit)))
    for _, remedy in sorted(found, key=lambda each: -each[0])[:_SWAPS]:
        yield remedy


def _margin(system: NonholonomicSystem, entries: list[Json], q: np.ndarray) -> float:
    """Smallest singular value of E for outputs of the form of a file; 0 if they do not reduce the system."""
    try:
        return float(system.reduce([output_of(each) for each in entries]).at(q).smallest_singular_value)  # type: ignore[arg-type]
    except RncError:
        return 0.0


def _result(run: Run, raw: Mapping[str, Json]) -> tuple[bool, str]:
    """Run a scenario. Return whether it succeeded, and its result in words."""
    begin = time.process_time()

    def watch(sample: Sample) -> None:
        if time.process_time() - begin > _LONGEST:
            raise SimulationError(f"stopped after {_LONGEST:g} s of computing, at t = {sample.time:.2f} s")

    try:
        trajectory = run(raw, watch)
    except InfeasibleError as error:
        if error.singular_value is None or not error.near_singular:
            return False, f"still refused, {_short(error)}"
        when = "" if error.time is None else f" at t = {error.time:.2f} s"
        value = f"smallest singular value {error.singular_value:.2g}"
        return False, f"still refused{when}, {value} ({few(error.rows, 4)})"
    except SingularityError as error:
        when = "" if error.time is None else f" at t = {error.time:.2f} s"
        return False, f"the run becomes singular{when} ({few(error.rows, 4)})"
    except RncError as error:
        return False, _short(error)
    if trajectory.outcome is not Outcome.COMPLETED:
        return False, f"the run ends early ({trajectory.outcome.value})"
    first = trajectory.verdict.first
    if not trajectory.verdict.succeeded:
        return False, f"the run fails: {first}"
    return True, "the run succeeds" if first is None else f"the run succeeds; {first}"


def _short(error: RncError) -> str:
    """First part of a message."""
    return short_text(str(error).partition(";")[0]).strip("'\"")
