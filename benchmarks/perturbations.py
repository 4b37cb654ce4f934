"""Drafts of changed URDFs that mean the same robot: is the kind of the base kept?

``python -m benchmarks.perturbations [ROBOT ...] [--draws N]``

Each robot is drafted by ``rnc-pin init`` as it is, and after each change of ``tests/support/perturbed_urdf.py``: noise
on all placements, random names, another order, no drives, the mirror image, gaps that exporters leave.

A trial *keeps* the kind if base, family, and numbers of trailers, wheels and inputs of the base are equal. Meshes are
hidden, as in ``docs/zoo.md``. Drafts are run for 0.1 s, which takes a third of the time of whole runs.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch
from xml.etree import ElementTree

import numpy as np
import pytest

from rnc_pin.applications.init import DraftOptions, draft, scenario_candidate
from rnc_pin.errors import RncError
from rnc_pin.robots.robot_files import Packages, example_urdfs, find_example, shipped_directory
from rnc_pin.robots.sources.urdf import parse_urdf

sys.path.append(str(Path(__file__).parents[1] / "tests" / "support"))

import published
import urdf_parts
from base_kind import base_kind
from patience import ending_within
from perturbed_urdf import DRAWN, PERTURBATIONS
from places import DIRT

LIMIT = 300  # processor time of a draft [s]
_FAMILIES = """
    balancer car_with_steering_wheel flywheels mecanum_named mecanum_with_rollers own_planar_base raked_fork rigid_drone
    satellite skid_off_center sliding_caster three_omni_wheels toed_wheels truck_and_trailer wide_wheels
"""


@dataclass(frozen=True)
class Trial:
    """Result of one perturbation of one robot.

    Attributes:
        robot, perturbation, draw: what was drafted.
        before: kind of the robot as it is.
        after: kind of the perturbed robot, or the refusal.
        seconds: processor time of the draft [s].
    """

    robot: str
    perturbation: str
    draw: int
    before: str
    after: str
    seconds: float

    @property
    def kept(self) -> bool:
        return self.before == self.after

    def __str__(self) -> str:
        said = "kept" if self.kept else f"{self.before} -> {self.after}"
        return f"{self.robot}, {self.perturbation} {self.draw}: {said} [{self.seconds:.1f} s]"


def sources() -> dict[str, Path | str]:
    """Path of each robot's file, or its text, by name: shipped, of example-robot-data, published, and of the tests."""
    installed = {name: robot.file() for name, robot in published.ROBOTS.items() if robot.installed}
    shipped = {path.stem: path for path in sorted(shipped_directory().glob("*.urdf"))}
    tests = {f"dirt/{name}": DIRT / f"{name}.urdf" for name in _FAMILIES.split()}
    made = {"six_wheels": urdf_parts.cart(front=0.3, middle=0.0, rear=-0.3)}
    return {**shipped, **made, **tests, **installed, **example_urdfs()}


def described(source: Path | str, folders: Sequence[Path]) -> str:
    """A robot as a URDF without macros, whose meshes are not found."""
    if isinstance(source, str):
        return source
    robot = parse_urdf(source, None, Packages(source.parent, folders))
    for each in robot.iter():  # published files have commas between numbers, and more than three of them
        for key in {"xyz", "rpy", "scale"} & set(each.attrib):
            each.set(key, " ".join(each.attrib[key].replace(",", " ").split()[:3]))
    for mesh in robot.iter("mesh"):
        mesh.set("filename", f"package://gone/{mesh.get('filename', '').rpartition('/')[2]}")
    return ElementTree.tostring(robot, encoding="unicode")


@patch.object(scenario_candidate, "_PATIENCE", 0.0)
def drafted(file: str, urdf: str) -> str:
    """Kind of the base of a draft, made in a folder of its own.

    Raises:
        RncError: the robot is refused.
        pytest.fail.Exception: the draft takes longer than LIMIT.
    """
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(action="ignore"), ending_within(LIMIT):
        (Path(folder) / file).write_text(urdf)
        return str(base_kind(draft(f"{folder}/{file}", Path(folder), DraftOptions()), urdf))


def trials(name: str, draws: int = 1) -> Iterator[Trial]:
    """Yield the trials of a robot; none if its draft is refused as it is.

    Raises:
        RncError: its file cannot be read.
    """
    source = sources()[name]
    original = described(source, [find_example(name)[1]] if name in example_urdfs() else [])
    file = f"{name}.urdf" if isinstance(source, str) else f"{source.name.partition('.')[0]}.urdf"
    try:
        before = drafted(file, original)
    except (RncError, pytest.fail.Exception):
        return
    for perturbation, change in PERTURBATIONS.items():
        for draw in range(draws if perturbation in DRAWN else 1):
            urdf, begun = change(original, draw), time.process_time()
            if urdf is None:
                continue
            try:
                after = drafted("robot.urdf" if perturbation == "names" else file, urdf)
            except RncError as error:
                after = f"refused: {error}"
            except pytest.fail.Exception:
                after = f"longer than {LIMIT} s"
            yield Trial(name, perturbation, draw, before, after, time.process_time() - begun)


def share(found: Sequence[Trial]) -> float:
    """Share of trials that keep the kind."""
    return float(np.mean([each.kept for each in found]))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    known = sources()
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help="names of robots; all of them by default")
    parser.add_argument("--draws", type=int, default=1, help="seeds for each perturbation that is drawn")
    asked = parser.parse_args(arguments)
    for unknown in set(asked.robots) - set(known):
        parser.error(f"no robot '{unknown}'; expected some of: {', '.join(known)}")
    found: list[Trial] = []
    for name in asked.robots or known:
        own: list[Trial] = []
        try:
            for trial in trials(name, asked.draws):
                print(trial, flush=True)
                own.append(trial)
        except RncError as error:
            print(f"{name}: not read: {error}", flush=True)
        else:
            if not own:
                print(f"{name}: refused as it is", flush=True)
        found += own
    if found:
        print(f"\n{100 * share(found):.1f} % of {len(found)} keep the kind")


if __name__ == "__main__":
    main()
