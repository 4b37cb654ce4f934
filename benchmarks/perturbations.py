"""Drafts of changed URDFs that mean the same robot: is the kind of the base kept?

``python -m benchmarks.perturbations [ROBOT ...] [--draws N] [--meshes]``

Each robot is drafted by ``rnc-pin init`` as it is, and after each change of ``tests/support/perturbed_urdf.py``: noise
on all placements, random names, another order, no drives, a tenth and ten times the size, the mirror image. Where the
wheels of a base stand on several axles, further drafts drive the wheels of the rear axle, and of each other one instead
(*drives moved*).

A trial *keeps* the kind if base, family, and numbers of trailers, wheels and inputs of the base are equal. It *says why
not* if a remark of the draft names what is different. The last output is a table in Markdown. Meshes are hidden, as in
``docs/zoo.md``; ``--meshes`` shows them.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from rnc_pin.applications.init import DraftOptions, draft
from rnc_pin.errors import RncError
from rnc_pin.io.safe_read import parse_tree
from rnc_pin.robots.robot_files import example_urdfs, find_example, shipped_directory
from rnc_pin.robots.sources.description_files import Packages
from rnc_pin.robots.sources.urdf import parse_urdf

sys.path.append(str(Path(__file__).parents[1] / "tests" / "support"))

import published
import urdf_parts
from base_kind import BaseKind, base_kind, base_parts, explanation, wheel_axles
from patience import ending_within
from perturbed_urdf import DRAWN, PERTURBATIONS, new_names, with_drives
from places import DIRT

LIMIT = 300  # processor time of a draft [s]
MOVED = "drives moved"
KEPT, EXPLAINED, CHANGED, REFUSED = "kept", "says why not", "changed", "refused"
_FAMILIES = """
    balancer car_with_steering_wheel flywheels mecanum_named mecanum_with_rollers own_planar_base raked_fork rigid_drone
    satellite skid_off_center sliding_caster three_omni_wheels toed_wheels truck_and_trailer wide_wheels
"""


@dataclass(frozen=True)
class Description:
    """A URDF without macros, with the name of its file."""

    file: str
    urdf: str


@dataclass(frozen=True)
class Drafted:
    """Draft of a description: its text, or the reason why there is none."""

    description: Description
    text: str
    refusal: str

    @property
    def kind(self) -> BaseKind:
        return base_kind(self.text, self.description.urdf)


@dataclass(frozen=True)
class Trial:
    """Result of one perturbation of one robot.

    Attributes:
        robot, perturbation, draw: what was drafted.
        outcome: "kept", "says why not", "changed" or "refused".
        before: kind of the robot as it is.
        after: kind of the perturbed robot, or the refusal.
        why: remark of the draft that explains a difference.
        seconds: processor time of the draft [s].
    """

    robot: str
    perturbation: str
    draw: int
    outcome: str
    before: str
    after: str
    why: str
    seconds: float

    def __str__(self) -> str:
        said = f"{self.robot}, {self.perturbation} {self.draw}: {self.outcome}"
        changed = "" if self.outcome == KEPT else f": {self.before} -> {self.after}"
        return f"{said}{changed}{f' ({self.why})' if self.why else ''} [{self.seconds:.1f} s]"


def sources() -> dict[str, Path | str]:
    """Path of each robot's file, or its text, by name: shipped, of example-robot-data, published, and of the tests."""
    installed = {name: robot.file() for name, robot in published.ROBOTS.items() if robot.installed}
    shipped = {path.stem: path for path in sorted(shipped_directory().glob("*.urdf"))}
    tests = {f"dirt/{name}": DIRT / f"{name}.urdf" for name in _FAMILIES.split()}
    made = {
        "snake": urdf_parts.snake(),
        "drawn_snake": urdf_parts.snake(6, forward=1, drawn=True),
        "ball": urdf_parts.ball(),
        "six_wheels": urdf_parts.cart(front=0.3, middle=0.0, rear=-0.3),
    }
    return {**shipped, **made, **tests, **installed, **example_urdfs()}


def described(name: str, source: Path | str, *, meshes: bool = False) -> Description:
    """A robot's description; its meshes are files with absolute paths, or not found."""
    if isinstance(source, str):
        return Description(f"{name}.urdf", source)
    folders = [find_example(name)[1]] if name in example_urdfs() else []
    packages = Packages(source.parent, folders)
    robot = parse_urdf(source, None, packages)
    for each in robot.iter():  # published files have commas between numbers, and more than three of them
        for key in {"xyz", "rpy", "scale"} & set(each.attrib):
            each.set(key, " ".join(each.attrib[key].replace(",", " ").split()[:3]))
    for mesh in robot.iter("mesh"):
        said = mesh.get("filename", "")
        file = packages.file(said) if meshes else None
        mesh.set("filename", f"package://gone/{said.rpartition('/')[2]}" if file is None else str(file))
    file = source.name.partition(".")[0] + ".urdf"
    return Description(file, ElementTree.tostring(robot, encoding="unicode"))


def drafted(description: Description, original: Description | None = None) -> Drafted:
    """Draft a description in a folder of its own; meshes that its perturbation named anew are copied from the original.

    A refusal, and a draft that takes longer than LIMIT, have a reason in place of a text.
    """
    with tempfile.TemporaryDirectory() as temporary, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        folder = Path(temporary)
        files = [each.get("filename", "") for each in parse_tree(description.urdf).iter("mesh")]
        if original is not None:
            before = [each.get("filename", "") for each in parse_tree(original.urdf).iter("mesh")]
            for old, new in zip(before, files, strict=True) if len(before) == len(files) else ():
                # A new name is a bare one, in this folder. In another order, absolute paths differ too: the installed
                # meshes themselves, which nothing may overwrite.
                if new == Path(new).name and Path(old).is_absolute() and Path(old).is_file():
                    shutil.copyfile(old, folder / new)
        known = sorted({Path(each).parent for each in files if Path(each).is_absolute()})
        path = folder / description.file
        path.write_text(description.urdf)
        try:
            with ending_within(LIMIT):
                return Drafted(description, draft(str(path), folder, DraftOptions(package_dirs=known)), "")
        except RncError as error:
            return Drafted(description, "", str(error).replace(f"{folder}/", ""))
        except pytest.fail.Exception:
            return Drafted(description, "", f"longer than {LIMIT} s")


def trials(name: str, draws: int = 1, *, meshes: bool = False) -> Iterator[Trial]:
    """Yield the trials of a robot; none if its draft is refused as it is.

    Raises:
        RncError: its file cannot be read.
    """
    original = described(name, sources()[name], meshes=meshes)
    first = drafted(original)
    if first.refusal:
        return
    for perturbation, change in PERTURBATIONS.items():
        for draw in range(draws if perturbation in DRAWN else 1):
            urdf = change(original.urdf, draw)
            if urdf is not None:
                file = "robot.urdf" if perturbation == "names" else original.file
                yield _trial(name, perturbation, draw, first, Description(file, urdf))
    axles, others = wheel_axles(first.text, original.urdf)
    if len(axles) > 1:
        outer, *inner = axles
        before = drafted(Description(original.file, with_drives(original.urdf, [*outer, *others])))
        for draw, axle in enumerate(inner if not before.refusal else ()):
            urdf = with_drives(original.urdf, [*axle, *others])
            yield _trial(name, MOVED, draw, before, Description(original.file, urdf))


def _trial(name: str, perturbation: str, draw: int, first: Drafted, changed: Description) -> Trial:
    begun = time.process_time()
    found = drafted(changed, first.description)
    seconds = time.process_time() - begun
    if found.refusal:
        return Trial(name, perturbation, draw, REFUSED, str(first.kind), found.refusal, "", seconds)
    before, after, why = first.kind, found.kind, ""
    if before != after:
        why = explanation(before, after, found.text, _concerned(first, found))
    outcome = KEPT if before == after else EXPLAINED if why else CHANGED
    return Trial(name, perturbation, draw, outcome, str(before), str(after), why, seconds)


def _concerned(first: Drafted, found: Drafted) -> set[str]:
    """Wheels that do not roll any more; in the same family, all wheels and actuators of one of the two drafts only."""
    names = new_names(first.description.urdf, found.description.urdf)
    old_parts = base_parts(first.text, first.description.urdf)
    old_wheels, old_actuators = ({names.get(each, each) for each in parts} for parts in old_parts)
    wheels, actuators = base_parts(found.text, found.description.urdf)
    if first.kind.family != found.kind.family:
        return old_wheels - wheels
    return (old_wheels ^ wheels) | (old_actuators ^ actuators)


def share(found: Iterable[Trial], *outcomes: str) -> float:
    """Share of trials with one of these outcomes."""
    return float(np.mean([each.outcome in outcomes for each in found]))


def table(found: Sequence[Trial]) -> str:
    """Table in Markdown: a row for each robot, a column for each perturbation, and the sums."""
    columns = [*PERTURBATIONS, MOVED]
    lines = ["| robot | kind | " + " | ".join(columns) + " |", "|---" * (len(columns) + 2) + "|"]
    for name in dict.fromkeys(each.robot for each in found):
        own = [each for each in found if each.robot == name]
        cells = [_cell([each for each in own if each.perturbation == column]) for column in columns]
        lines.append(f"| {name} | {own[0].before} | {' | '.join(cells)} |")
    sums = [_sum([each for each in found if each.perturbation == column]) for column in columns]
    lines.append(f"| **kept of tried** | {_sum(found)} | {' | '.join(sums)} |")
    return "\n".join(lines)


def _cell(found: Sequence[Trial]) -> str:
    worst = [each for each in found if each.outcome != KEPT]
    if not worst:
        return "kept" if found else ""
    first = worst[0]
    what = {CHANGED: first.after, EXPLAINED: f"says why not: {first.after}", REFUSED: "refused"}[first.outcome]
    return what if len(found) == 1 else f"{len(found) - len(worst)} of {len(found)}; {what}"


def _sum(found: Sequence[Trial]) -> str:
    kept, said = (sum(each.outcome == outcome for each in found) for outcome in (KEPT, EXPLAINED))
    return f"{kept}{f' + {said} that say why not' if said else ''} of {len(found)}"


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    known = sources()
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help="names of robots; all of them by default")
    parser.add_argument("--draws", type=int, default=1, help="seeds for each perturbation that is drawn")
    parser.add_argument("--meshes", action="store_true", help="show meshes, where their files are found")
    asked = parser.parse_args(arguments)
    for unknown in set(asked.robots) - set(known):
        parser.error(f"no robot '{unknown}'; expected some of: {', '.join(known)}")
    found: list[Trial] = []
    for name in asked.robots or known:
        own: list[Trial] = []
        try:
            for trial in trials(name, asked.draws, meshes=asked.meshes):
                print(trial, flush=True)
                own.append(trial)
        except RncError as error:
            print(f"{name}: not read: {error}", flush=True)
        else:
            if not own:
                print(f"{name}: refused as it is", flush=True)
        found += own
    print(f"\n{table(found)}")
    if found:
        kept, said = (100 * share(found, outcome) for outcome in (KEPT, EXPLAINED))
        print(f"\n{kept:.1f} % keep the kind, {said:.1f} % say why not")


if __name__ == "__main__":
    main()
