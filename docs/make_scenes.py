"""Record scenarios as interactive scenes of the documentation site: ``python docs/make_scenes.py [SCENARIO...]``.

Each run writes a page of 1 to 8 MB into ``docs/_scenes``, which git ignores. The site shows it behind the picture of
the same scenario. ``--out FOLDER`` writes elsewhere, and ``--all`` records every built-in scenario.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import built_in_names
from rnc_pin.applications.scenario.saved_run import write_animation
from rnc_pin.applications.scenario.scenario import Scenario

SCENES = Path(__file__).parent / "_scenes"
SHORT = ("space-robot", "tiago-doorway", "parallel-parking", "free-flying-arm", "docking", "rattleback")
"""Scenarios that take seconds, one of each kind of robot."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenarios", nargs="*", default=SHORT, help=f"built-in names; {', '.join(SHORT)} by default")
    parser.add_argument("--all", action="store_true", help="record all built-in scenarios")
    parser.add_argument("--out", type=Path, default=SCENES, help="folder of the pages")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in built_in_names() if arguments.all else arguments.scenarios:
        print(record(name, arguments.out), flush=True)


def record(name: str, folder: Path) -> Path:
    """Run a scenario and write its page under the name of its picture in ``docs/images``."""
    prepared = Scenario.load(name).build()
    path = folder / f"{name.replace('-', '_')}.html"
    if not write_animation(prepared, execute(prepared), path):
        raise SystemExit(f"{name}: the robot has nothing to draw")
    return path


if __name__ == "__main__":
    main()
