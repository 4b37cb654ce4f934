"""Scenario content from Python objects: what has a form in a file, and what has none."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, replace
from pathlib import Path
from types import UnionType
from typing import NamedTuple, Union, cast, get_args, get_origin

import coal
import numpy as np

from rnc_pin.applications.scenario.builder import Experiment, build_task
from rnc_pin.applications.scenario.plant_builder import build_plant, start_findings, warnings_of
from rnc_pin.applications.scenario.schema import ScenarioFile
from rnc_pin.applications.scenario.schema.derived import Entry, ReadAs
from rnc_pin.applications.scenario.schema.kinds import ActuatorItem, ConstraintItem, ForceItem, OutputItem, Outputs
from rnc_pin.applications.scenario.schema.motions import ReferenceItem
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.applications.scenario.schema.world import RobotSource
from rnc_pin.collision import Obstacle, check_ignored_links
from rnc_pin.control import Controller, describe
from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.io import Json
from rnc_pin.model import ReducedModel, Task, vector
from rnc_pin.planning import Reference, RelativeReference
from rnc_pin.plants import Plant
from rnc_pin.robots import Robot
from rnc_pin.simulation import TaskNames, provenance_of

ROLES = ("primary", "redundant", "vertical")

FileForm = Mapping[str, Json]
"""Part of a scenario in the form of a file."""


@dataclass(frozen=True)
class RunObjects:
    """Objects of a run, for ``Scenario.of``. A mapping gives the form of a scenario file instead.

    Attributes:
        reduced: the reduced model, from ``NonholonomicSystem.reduce``.
        controller: a controller, or its mapping: ``{"type": "reducing_outputs", "preset": "scaled"}``.
        q0: initial configuration (nq,).
        v2_0: initial reduced velocity (r,) [rad/s or m/s]; at rest by default.
        references: references by role, ``primary``, ``redundant`` and ``vertical``. A controller in a mapping needs
            relative ones, such as ``RelativeMinimumJerk``.
        task: roles of the outputs; by default all reducing outputs are primary.
        plant: a plant, or its mapping; by default the integrated reduced model.
        obstacles: bodies in the world.

    Raises:
        InputError: wrong shapes.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> objects = rnc.RunObjects(reduced, {"type": "none"}, robot.configuration(), v2_0=[1.0, 0.5])
        >>> print(rnc.Scenario.of(objects, 0.1).run().outcome)
        completed
    """

    reduced: ReducedModel
    controller: Controller | FileForm
    q0: np.ndarray
    v2_0: np.ndarray | None = None
    references: Mapping[str, Reference | RelativeReference | FileForm] = field(default_factory=dict)
    task: Task | None = None
    plant: Plant | FileForm | None = None
    obstacles: Sequence[Obstacle] = ()

    def __post_init__(self) -> None:
        for name, size in (("q0", self.reduced.robot.nq), ("v2_0", self.reduced.r)):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, vector(np.asarray(value), size, name))


class FileContent(NamedTuple):
    """Content of a scenario from objects."""

    raw: dict[str, Json]
    """Mapping of the scenario file, without the parts that have no form."""
    content: ScenarioFile
    """Checked content, with the objects of the parts that have no form in a file."""
    without_form: dict[str, str]
    """Parts that have no form in a file, by key, and why."""


def content_of(given: RunObjects, settings: Mapping[str, Json], name: str) -> FileContent:
    """Return the content of a scenario from objects.

    Args:
        given: the objects.
        settings: other keys of a scenario file, ``simulation`` among them.
        name: name of the scenario in errors.

    Raises:
        ConfigurationError: a role is not known, settings are not valid, or a controller in the form of a file has
            references or obstacles without such a form.
    """
    for role in given.references:
        if role not in ROLES:
            raise ConfigurationError(f"references: no role '{role}'{nearest(role, ROLES)}")
    raw: dict[str, Json] = {}
    without_form: dict[str, str] = {}

    def put(key: str, form: Callable[[], Json]) -> None:
        """Put a part into the mapping if it has a form."""
        try:
            raw[key] = form()
        except ConfigurationError as error:
            without_form[key] = str(error)

    robot, parts = given.reduced.robot, given.reduced.given
    if (source := _source(robot)) is None:
        without_form["robot"] = "it is not as a file has it"
    else:
        raw["robot"] = source
    put("constraints", lambda: _all_spelled(ConstraintItem, parts.constraints))
    if isinstance(actuators := parts.actuators, Sequence):
        put("actuators", lambda: _all_spelled(ActuatorItem, actuators))
    else:
        without_form["actuators"] = "a matrix has no form in a file"
    put("forces", lambda: _all_spelled(ForceItem, parts.forces))
    raw["mimic"] = parts.mimic
    if (reducing := parts.reducing) is not None:
        put(
            "outputs",
            lambda: {
                "reducing": _all_spelled(OutputItem, reducing),
                "vertical": _all_spelled(OutputItem, parts.vertical),
            },
        )
    if given.task is not None:
        roles = {role: list(getattr(given.task, f"{role}_names")) for role in ROLES}
        raw["task"] = cast(Json, roles)
    raw["initial"] = _initial(given)
    for role, reference in given.references.items():
        try:
            form = reference if isinstance(reference, Mapping) else spelled(ReferenceItem, reference)
            raw["reference"] = {**cast(FileForm, raw.get("reference", {})), role: form}
        except ConfigurationError:
            without_form[f"reference.{role}"] = f"a {type(reference).__name__} has no form in a file"
    put("obstacles", lambda: [_obstacle(each) for each in given.obstacles])
    for key, value in (("controller", given.controller), ("plant", given.plant)):
        if isinstance(value, Mapping):
            raw[key] = dict(value)
        elif value is not None:
            without_form[key] = f"a {type(value).__name__} has no form in a file; its settings in a mapping have one"
    if "controller" in raw:
        for key in without_form:
            if key.startswith(("reference", "obstacles")):
                said = "a controller in the form of a file needs it in this form, too"
                raise ConfigurationError(f"{name}: {key}: {without_form[key]}; {said}")
    raw = {key: value for key, value in raw.items() if value not in ({}, [])} | dict(settings)
    content = validate({"robot": {"urdf": robot.name or "robot"}, **raw}, name)
    return FileContent(raw, _with_objects(content, given), without_form)


def experiment_of(content: ScenarioFile, given: RunObjects) -> Experiment:
    """Return the objects of a run whose controller is an object.

    Args:
        content: content of the scenario.
        given: the objects.
    """
    reduced, controller, plant = given.reduced, given.controller, given.plant
    assert not isinstance(controller, Mapping)
    assert content.simulation is not None
    check_ignored_links(given.obstacles, reduced.robot)
    found, task = start_findings(content, reduced, given.q0), build_task(content, reduced)
    return Experiment(
        scenario=content,
        reduced=reduced,
        controller=controller,
        plant=build_plant(content, reduced, given.q0) if plant is None or isinstance(plant, Mapping) else plant,
        q0=given.q0,
        v2_0=np.zeros(reduced.r) if given.v2_0 is None else given.v2_0,
        simulation=content.simulation,
        warnings=warnings_of(found),
        start_findings=found,
        provenance=replace(
            provenance_of(None),
            controller=describe(controller),
            task=TaskNames(tuple(task.primary_names), tuple(task.redundant_names)),
        ),
        obstacles=tuple(given.obstacles),
        references={role: each for role, each in given.references.items() if isinstance(each, Reference)},
    )


def _source(robot: Robot) -> dict[str, Json] | None:
    """Entry ``robot`` of a file; None if the robot has none, or has changed since it was loaded."""
    if robot.source is None:
        return None
    return robot.source if RobotSource.model_validate(robot.source).build(Path()).model == robot.model else None


def _initial(given: RunObjects) -> dict[str, Json]:
    initial: dict[str, Json] = {"q": given.reduced.robot.joint_values(given.q0)}
    if given.v2_0 is not None:
        initial["v2"] = dict(zip(given.reduced.reducing.names, given.v2_0.tolist(), strict=True))
    return initial


def _obstacle(obstacle: Obstacle) -> Json:
    """Entry of ``obstacles`` in a file."""
    shape = obstacle.shape
    if isinstance(shape, coal.Box):
        kind, size = "box", {"size": (2.0 * np.ravel(shape.halfSide)).tolist()}
    elif isinstance(shape, coal.Sphere):
        kind, size = "sphere", {"radius": float(shape.radius)}
    elif isinstance(shape, coal.Cylinder | coal.Capsule):
        kind = type(shape).__name__.lower()
        size = {"radius": float(shape.radius), "length": 2.0 * float(shape.halfLength)}
    elif isinstance(shape, coal.Halfspace) and np.array_equal(np.ravel(shape.n), [0.0, 0.0, 1.0]) and not shape.d:
        kind, size = "ground", {}
    else:
        raise ConfigurationError(f"the {type(shape).__name__} of '{obstacle.name}' has no form in a file")
    if obstacle.motion is not None:
        raise ConfigurationError(f"the {type(obstacle.motion).__name__} of '{obstacle.name}' has no form in a file")
    angles = {name: value for name in ("roll", "pitch", "yaw") if (value := float(getattr(obstacle, name)))}
    ignored = {"ignored_links": list(obstacle.ignored_links)} if obstacle.ignored_links else {}
    position = np.asarray(obstacle.position, dtype=float).tolist()
    return {kind: {**size, "name": obstacle.name, "position": position, **angles, **ignored}}


def _with_objects(content: ScenarioFile, given: RunObjects) -> ScenarioFile:
    """Content with the parts of the model that it lacks, because they have no form in a file."""
    parts = given.reduced.given
    objects: dict[str, object] = {"constraints": list(parts.constraints), "forces": list(parts.forces)}
    if isinstance(parts.actuators, Sequence):
        objects["actuators"] = list(parts.actuators)
    if content.outputs is None and parts.reducing is not None:
        objects["outputs"] = Outputs.model_construct(reducing=list(parts.reducing), vertical=list(parts.vertical))
    return content.model_copy(update=objects)


def spelled(item: object, value: object) -> Json:
    """Return the form of a value in a file.

    Args:
        item: annotation of the reader, such as ``ConstraintItem``; None for numbers, text and lists.
        value: the value.

    Raises:
        ConfigurationError: the value has no form in a file.
    """
    kinds = get_args(item) if get_origin(item) in (Union, UnionType) else (item,)
    for reader in (part for kind in kinds for part in (*get_args(kind), kind)):
        entries: dict[str | None, Entry[object]] = {None: reader} if isinstance(reader, Entry) else {}
        if isinstance(reader, ReadAs):
            entries.update(reader.entries)
        for key, entry in entries.items():
            if type(value) is entry.kind:
                return _spelled_by(entry, value) if key is None else {key: _spelled_by(entry, value)}
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return cast(Json, value.tolist())
    if isinstance(value, list | tuple):
        return [spelled(None, each) for each in value]
    raise ConfigurationError(f"a {type(value).__name__} has no form in a file")


def _all_spelled(item: object, values: Iterable[object]) -> list[Json]:
    return [spelled(item, each) for each in values]


def _spelled_by(entry: Entry[object], value: object) -> Json:
    """Mapping of an object, without the parameters that have their defaults."""
    if entry.only is not None:
        return spelled(None, getattr(value, entry.only))
    found: dict[str, Json] = {}
    for each in entry.parameters:
        part = getattr(value, each.name)
        if each.name in entry.required or not _same(part, each.default):
            found[entry.key(each.name)] = spelled(entry.forms.get(each.name), part)
    return found


def _same(value: object, default: object) -> bool:
    if value is default:
        return True
    plain = (bool, int, float, str, list, tuple, np.ndarray)
    if default is MISSING or not (isinstance(value, plain) and isinstance(default, plain)):
        return False
    return bool(np.array_equal(cast(np.ndarray, value), cast(np.ndarray, default)))
