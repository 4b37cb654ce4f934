"""A first scenario for a robot: base, wheels, actuators, outputs, a gentle motion and a controller."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rnc_pin.errors import ConfigurationError, ModelError, ModelWarning, RncError, nearest
from rnc_pin.plain import Json
from rnc_pin.robots.robot import Robot
from rnc_pin.robots.sources.description import parse_xml
from rnc_pin.robots.urdf_files import example_urdfs, is_file, shipped_directory
from rnc_pin.scenario.draft.attempt import Attempt, start_values
from rnc_pin.scenario.draft.balancing import balances, is_bicycle, on_a_bicycle, on_two_wheels
from rnc_pin.scenario.draft.chassis import chassis
from rnc_pin.scenario.draft.drawn_axles import find_drawn_axles
from rnc_pin.scenario.draft.mobility import Mobility
from rnc_pin.scenario.draft.on_rollers import has_rollers, in_any_direction, on_rollers
from rnc_pin.scenario.draft.on_wheels import on_drawn_axles, on_wheels
from rnc_pin.scenario.draft.site import Site
from rnc_pin.scenario.draft.wheels import find_wheels
from rnc_pin.scenario.draft.without_wheels import without_wheels
from rnc_pin.scenario.loading import admitted
from rnc_pin.scenario.schema.robot import RobotSource

Way = Callable[[], Mobility]


@dataclass(frozen=True)
class Wishes:
    """What the user says of a robot instead of leaving it to be guessed.

    Attributes:
        base: "fixed", "planar" or "free".
        xacro_arguments: values for the arguments of a xacro file.
        package_dirs: folders of packages.
        lock: joints to hold, and where.
    """

    base: str | None = None
    xacro_arguments: Mapping[str, Json] | None = None
    package_dirs: Sequence[Path] = ()
    lock: Mapping[str, float] | None = None


def draft(source: str, folder: Path, wishes: Wishes | None = None) -> str:
    """The text of a scenario that ``rnc-pin inspect`` and ``rnc-pin run`` accept as it is: it has been tried out.

    Args:
        source: a URDF, xacro or MJCF file, the name of a URDF shipped with rnc_pin or of a robot of example-robot-data.
        folder: where the scenario will be: paths in it are relative to that.
        wishes: what is not to be guessed.

    Raises:
        RncError: no such robot, or one of which no scenario can be made.
    """
    wishes = wishes or Wishes()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        text = _Draft(source, folder, wishes).text()
    for message in dict.fromkeys(str(each.message) for each in said if issubclass(each.category, ModelWarning)):
        warnings.warn(message, ModelWarning, stacklevel=2)
    return text


def _source(source: str, folder: Path) -> dict[str, Json]:
    path = Path(source).expanduser()
    if is_file(path):
        relative = os.path.relpath(path.resolve(), folder.resolve())
        if path.suffix == ".xacro" or parse_xml(path).tag != "mujoco":
            return {"urdf": relative}
        return {"mjcf": relative}
    if path.is_dir():
        raise ModelError(f"'{source}' is a folder, expected a robot's file")
    shipped = [each.name for each in shipped_directory().glob("*.urdf")]
    if source in shipped:
        return {"urdf": source}
    if source in example_urdfs():
        return {"example": source}
    valid = [*shipped, *example_urdfs()]
    raise ModelError(f"no robot '{source}': neither a file nor a name{nearest(source, valid)}")


class _Draft:
    def __init__(self, source: str, folder: Path, wishes: Wishes) -> None:
        self.folder, self.wishes = folder, wishes
        self.entry = _source(source, folder)
        if wishes.xacro_arguments:
            self.entry["xacro_arguments"] = dict(wishes.xacro_arguments)
        if wishes.package_dirs:
            self.entry["package_dirs"] = [
                os.path.relpath(each.resolve(), folder.resolve()) for each in wishes.package_dirs
            ]
        self.held = dict(wishes.lock or {})
        robot, is_rigid = self.lying()
        self.site = Site(robot, start_values(robot), Path(source).name, is_rigid)

    def lying(self) -> tuple[Robot, bool]:
        """The robot as its file has it; afloat where it is one rigid body, and whether it is."""
        if "mjcf" in self.entry:
            return self.load(None, self.held), False
        try:
            return self.load("fixed", self.held), False
        except ModelError as error:
            try:
                robot = self.load("free", self.held)
            except ModelError:
                raise error from None
            if robot.nv > 6:
                raise
            return robot, True

    def load(self, base: str | None, lock: Mapping[str, float]) -> Robot:
        raw = {**self.entry, **({} if base is None else {"base": base}), "lock": dict(lock)}
        return admitted(RobotSource, raw, "robot").build(self.folder)

    def text(self) -> str:
        failures: list[str] = []
        for way in self.ways():
            mobility = way()
            try:
                attempt = Attempt(mobility, self.entry, self.load, self.site.start, self.held, self.folder)
                mobility.notes += failures
                return attempt.text()
            except RncError as error:
                failures.append(f"not '{mobility.kind}', which does not run: {error}")
        raise ConfigurationError(f"no scenario can be drafted for '{self.site.robot.name}': {failures[0]}")

    def ways(self) -> Iterator[Way]:
        """How the robot may stand, the likeliest first; what the user asks for has no alternative."""
        site, asked = self.site, self.wishes.base
        if asked in (None, "planar"):
            wheels = find_wheels(site.robot, site.q, site.root)
            if wheels:
                yield from self.on_wheels(wheels)
                return
            axles = find_drawn_axles(site.robot, site.q)
            if axles and not site.own_base:
                yield lambda: on_drawn_axles(axles, site)
        yield lambda: without_wheels(site, asked, self.mass_of_base())
        if asked is None:
            yield lambda: without_wheels(site, "fixed", 0.0)

    def on_wheels(self, wheels: list) -> Iterator[Way]:
        site, asked = self.site, self.wishes.base
        sorted_out = chassis(wheels)
        if asked is None and balances(sorted_out, site):
            yield lambda: on_two_wheels(sorted_out, site)
        if asked is None and is_bicycle(sorted_out):
            yield lambda: on_a_bicycle(sorted_out, site)
        if has_rollers(sorted_out, site):
            yield lambda: on_rollers(sorted_out, site)
        elif sorted_out.fixed:
            yield lambda: on_wheels(sorted_out, site)
        why = "every wheel is steered by itself" if sorted_out.steered else "all wheels are casters"
        if sorted_out.fixed:
            why = "these wheels cannot roll together as they are read"
        yield lambda: in_any_direction(sorted_out, site, why)

    def mass_of_base(self) -> float:
        """Of the first link [kg]; a ground or world has none."""
        try:
            return float(self.load("free", self.held).model.inertias[1].mass)
        except ModelError:
            return 0.0
