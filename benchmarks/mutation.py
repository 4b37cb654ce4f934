"""Mutation score: ``python -m benchmarks.mutation --sample 400 rnc_pin/control ...``.

Cosmic Ray makes the mutants, of a copy of the tree. The tests are run once as they are, which says how long each takes
and which lines it goes through (pytest-cov); then each mutant of a line meets the tests that go through it, those of
its module by turns with the shortest of each file, until one fails or ``--patience`` is over, in a fork of a process
that has the libraries loaded. All mutants of six packages would take a day on two cores: of the modules that are given
as many are drawn as ``--sample`` says, with a seed. Survivors are printed as differences, to be killed by an assertion
or found equivalent by a reader.
"""

from __future__ import annotations

import argparse
import difflib
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

from cosmic_ray.commands.init import init
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec
from coverage import CoverageData
from rich.console import Console
from rich.table import Table

from benchmarks.covered_lines import ROOT, TESTS, Lines, TimedTest, lowest, modules
from benchmarks.forked_tests import Trial, survivors

COPIED = ("rnc_pin", "tests", "urdf", "benchmarks", "pyproject.toml", "docs", "README.md", "examples", "CHANGELOG.md")
PACKAGES = ("model", "constraints", "outputs", "control", "planning", "analysis")
SAME = "core/ReplaceBinaryOperator_BitOr_"  # of annotations, which nobody evaluates


def mutants(paths: list[Path]) -> list[MutationSpec]:
    """All of them that could make a difference, in the order of the text."""
    with use_db(":memory:", WorkDB.Mode.create) as session:
        init(paths, session, {})
        made = [item.mutations[0] for item in session.work_items]
    made = [each for each in made if not each.operator_name.startswith(SAME)]
    return sorted(made, key=lambda each: (each.module_path, each.start_pos, each.operator_name, each.occurrence))


def run_once(tree: Path, files: list[str], jobs: int) -> None:
    """The tests as they are, with what they go through."""
    command = "-q -x -p no:cacheprovider --cov=rnc_pin --cov-context=test --cov-report= --junitxml=tests.xml"
    workers = ["-n", str(jobs)] if jobs > 1 else []
    ran = subprocess.run([sys.executable, "-m", "pytest", *command.split(), *workers, *files], cwd=tree, check=False)
    if ran.returncode:
        raise SystemExit("the tests fail without a mutant")


def trial(mutant: MutationSpec, tests: list[TimedTest], patience: float) -> Trial:
    """A mutant, and as many of its tests as are over in time."""
    chosen, total = [], 0.0
    for test in tests:
        total += test.seconds
        if chosen and total > patience:
            break
        chosen.append(test.name)
    operator = get_operator(mutant.operator_name)(**(mutant.operator_args or {}))
    text = mutate_code(mutant.module_path.read_text(), operator, mutant.occurrence)
    return Trial(mutant.module_path, text, chosen, 3.0 * min(total, patience) + 60.0)


def difference(made: Trial) -> str:
    """The mutated lines, as in a patch."""
    texts = [each.splitlines() for each in (made.module.read_text(), made.text)]
    return "\n".join(difflib.unified_diff(*texts, str(made.module), str(made.module), n=1, lineterm=""))


def main() -> None:
    parser = argparse.ArgumentParser(description="How many small wrongs the tests notice.")
    parser.add_argument("paths", nargs="*", default=[f"rnc_pin/{name}" for name in PACKAGES])
    parser.add_argument("--sample", type=int, help="how many mutants are drawn; all by default")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--patience", type=float, default=60.0, help="of tests that a mutant meets [s]")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--tests", nargs="*", default=TESTS, help="files or folders")
    given = parser.parse_args()
    paths = list(modules(given.paths))
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder).resolve()
        for name in COPIED:
            source = ROOT / name
            (shutil.copytree if source.is_dir() else shutil.copy2)(source, tree / name)
        os.environ.update({"PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"})
        os.chdir(tree)
        sys.path.insert(0, str(tree))
        run_once(tree, list(given.tests), given.jobs)
        data = CoverageData(str(tree / ".coverage"))
        data.read()
        lines, every = Lines(tree, data.contexts_by_lineno), mutants(paths)
        drawn = random.Random(given.seed).sample(every, min(given.sample or len(every), len(every)))
        score: defaultdict[str, list[int]] = defaultdict(lambda: [0, 0])
        trials = (trial(each, lines.through(each.module_path, each.start_pos[0]), given.patience) for each in drawn)
        for ended, (made, survived) in enumerate(survivors(trials, given.jobs), 1):
            done = score[made.module.parent.name]
            done[0], done[1] = done[0] + (not survived), done[1] + 1
            if survived:
                print(f"survives {len(made.tests)} tests:\n{difference(made)}\n", flush=True)
            print(f"{ended} of {len(drawn)}: {sum(each[0] for each in score.values())} killed", file=sys.stderr)
    table = Table("package", "mutants drawn", "killed", "share", title=f"of {len(every)} mutants")
    for name, (killed, count) in [*sorted(score.items()), ("all", [sum(x) for x in zip(*score.values(), strict=True)])]:
        table.add_row(name, str(count), str(killed), f"{100 * killed / count:.1f} %")
    Console().print(table)
    print(f"with 95 % confidence at least {100 * lowest(killed, count):.1f} % of all")


if __name__ == "__main__":
    main()
