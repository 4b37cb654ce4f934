"""How many small wrongs the tests notice: ``python -m benchmarks.mutation --sample 400 rnc_pin/control ...``.

Cosmic Ray makes the mutants, on a copy of the tree. The tests are run once as they are, which says how long each takes
and which lines it goes through (pytest-cov); then each mutant of a line meets the tests that go through it, of each
file in turn the shortest, until one fails or ``--patience`` is over. All mutants of six packages would take days on
two cores: of the modules that are given as many are drawn as ``--sample`` says, with a seed. Survivors are printed as
differences, to be killed by an assertion or found equivalent by a reader.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

from cosmic_ray.commands.init import init
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec, TestOutcome
from coverage import CoverageData
from rich.console import Console
from rich.table import Table

from benchmarks.covered_lines import ROOT, TESTS, Lines, TimedTest, lowest, modules

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


def run_once(tree: Path, files: list[str]) -> None:
    """The tests as they are, with what they go through."""
    command = "-q -x -p no:cacheprovider --cov=rnc_pin --cov-context=test --cov-report= --junitxml=tests.xml"
    ran = subprocess.run([sys.executable, "-m", "pytest", *command.split(), *files], cwd=tree, check=False)
    if ran.returncode:
        raise SystemExit("the tests fail without a mutant")


def meets(mutant: MutationSpec, tests: list[TimedTest], patience: float) -> tuple[bool, str]:
    """Whether a mutant is killed, and its difference."""
    chosen, sum_of = [], 0.0
    for test in tests:
        sum_of += test.seconds
        if chosen and sum_of > patience:
            break
        chosen.append(test.name)
    Path("tests.txt").write_text("\n".join(chosen))
    command = f"{sys.executable} -m pytest -q -x --no-header -p no:cacheprovider"
    # Of a line that no test goes through nothing has to be run to know that nothing notices.
    command = f"{command} @tests.txt" if chosen else f"{sys.executable} --version"
    result = mutate_and_test([mutant], command, 3.0 * min(sum_of, patience) + 30.0)
    return result.test_outcome != TestOutcome.SURVIVED, result.diff or str(result.output)


def main() -> None:
    parser = argparse.ArgumentParser(description="How many small wrongs the tests notice.")
    parser.add_argument("paths", nargs="*", default=[f"rnc_pin/{name}" for name in PACKAGES])
    parser.add_argument("--sample", type=int, help="how many mutants are drawn; all by default")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--patience", type=float, default=60.0, help="of tests that a mutant meets [s]")
    parser.add_argument("--tests", nargs="*", default=TESTS, help="files, without test_")
    given = parser.parse_args()
    paths = list(modules(given.paths))
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder).resolve()
        for name in COPIED:
            source = ROOT / name
            (shutil.copytree if source.is_dir() else shutil.copy2)(source, tree / name)
        os.environ.update({"PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"})
        os.chdir(tree)
        run_once(tree, [f"tests/test_{name}.py" for name in given.tests])
        data = CoverageData(str(tree / ".coverage"))
        data.read()
        lines, made = Lines(tree, data.contexts_by_lineno), mutants(paths)
        drawn = random.Random(given.seed).sample(made, min(given.sample or len(made), len(made)))
        score: defaultdict[str, list[int]] = defaultdict(lambda: [0, 0])
        for number, mutant in enumerate(drawn, 1):
            tests = lines.through(mutant.module_path, mutant.start_pos[0])
            killed, difference = meets(mutant, tests, given.patience)
            done = score[mutant.module_path.parent.name]
            done[0], done[1] = done[0] + killed, done[1] + 1
            if not killed:
                print(f"survives {len(tests)} tests, {mutant.operator_name}:\n{difference}\n", flush=True)
            print(f"{number} of {len(drawn)}: {sum(each[0] for each in score.values())} killed", file=sys.stderr)
    table = Table("package", "mutants drawn", "killed", "share", title=f"of {len(made)} mutants")
    for name, (killed, count) in [*sorted(score.items()), ("all", [sum(x) for x in zip(*score.values(), strict=True)])]:
        table.add_row(name, str(count), str(killed), f"{100 * killed / count:.1f} %")
    Console().print(table)
    print(f"with 95 % confidence at least {100 * lowest(killed, count):.1f} % of all")


if __name__ == "__main__":
    main()
