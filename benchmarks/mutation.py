"""Mutation score.

Cosmic Ray makes the mutants, in copies of the tree. One run without a mutant measures the duration of each test and the
lines that it executes (pytest-cov); tests that fail in it are left out. Each mutant meets the tests that execute its
line: first those of its module, then those of its package, the shortest first, for at most ``--patience`` seconds. They
run in a child of a process that has imported the libraries. A second stage tries the survivors again: with tests of
five times this duration, with and without the compiled kernel. What survives both is printed as differences. Assertions
should kill it, unless a reader finds it equivalent.
"""

from __future__ import annotations

import argparse
import difflib
import math
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from importlib import import_module
from pathlib import Path
from xml.etree import ElementTree

import pytest
from cosmic_ray.commands.init import init
from cosmic_ray.mutating import use_mutation
from cosmic_ray.plugins import get_operator
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec
from coverage import CoverageData

ROOT = Path(__file__).parents[1]
COPIED = ("rnc_pin", "tests", "urdf", "benchmarks", "pyproject.toml", "docs", "README.md", "examples", "CHANGELOG.md")
PACKAGES = (
    "model", "constraints", "control", "references", "motion/whole_body", "motion/planning", "analysis",
)  # fmt: skip
DECLARED = ("tests/test_vocabulary.py", "tests/test_printing.py")  # promises of declarations, which an import executes
# Tests of these packages. Those of commands, browsers and readers take minutes and execute few of their lines.
TESTS = (
    *(f"tests/{name}" for name in PACKAGES), "tests/test_outputs.py", "tests/test_forces.py",
    "tests/simulation/test_simulate.py", "tests/simulation/test_batch.py",
    "tests/motion/optimal/test_plan_feedback.py", "tests/motion/optimal/test_predictive_control.py",
    "tests/system/test_single_joint.py", "tests/robots/test_robot.py", "tests/system/test_copies.py",
    "tests/system/test_regular_motion.py", "tests/system/test_wheel_rows.py",
    "tests/system/test_uncertain_wheels.py", *DECLARED, "tests/visualization/test_scene_bodies.py",
)  # fmt: skip
IN_ANNOTATIONS = "core/ReplaceBinaryOperator_BitOr_"  # nothing evaluates these
LIBRARIES = ("hypothesis", "pinocchio", "scipy.integrate", "scipy.optimize", "scipy.spatial", "yaml")
START_UP = 60.0  # [s] that pytest and its imports may take
MORE = 5.0  # times the patience, for survivors of the first stage


def modules(paths: list[str]) -> list[Path]:
    """Python files below the paths, relative to the root."""
    found = [sorted((ROOT / path).rglob("*.py")) if (ROOT / path).is_dir() else [ROOT / path] for path in paths]
    return [each.relative_to(ROOT) for group in found for each in group if each.name != "__init__.py"]


def mutants(paths: list[Path]) -> list[MutationSpec]:
    """All mutants of the modules that can make a difference, in the order of the text."""
    with use_db(":memory:", WorkDB.Mode.create) as session:
        init(paths, session, {})
        made = [item.mutations[0] for item in session.work_items]
    made = [each for each in made if not each.operator_name.startswith(IN_ANNOTATIONS)]
    return sorted(made, key=lambda each: (each.module_path, each.start_pos, each.operator_name, each.occurrence))


def durations(report: Path) -> dict[str, float]:
    """Duration of each test [s], from a JUnit report."""
    return {
        f"{case.attrib['classname'].replace('.', '/')}.py::{case.attrib['name']}": float(case.attrib["time"])
        for case in ElementTree.parse(report).iter("testcase")
    }


def tests_of(
    module: Path, line: int, contexts: Mapping[int, list[str]], seconds: Mapping[str, float], patience: float
) -> list[str]:
    """Tests that execute a line, in the order in which a mutant meets them.

    Args:
        module: path of the module from the root.
        line: line of the module.
        contexts: tests of each executed line, as coverage.py records them; "" is the import of the module.
        seconds: duration of each test [s].
        patience: largest duration of all tests [s]; the first test may take longer.
    """
    # A statement of several lines is recorded at its first line.
    executed = max((each for each, names in contexts.items() if each <= line and names), default=0)
    found = {name.rpartition("|")[0] for name in contexts.get(executed, ())} - {""}
    if not found and "" in contexts.get(executed, ()):
        found = {name.rpartition("|")[0] for names in contexts.values() for name in names} - {""} or set(seconds)
        found |= {name for name in seconds if name.startswith(DECLARED)}
    package = module.parent.relative_to("rnc_pin") if module.parts[0] == "rnc_pin" else module.parent
    own = (f"tests/{package}/test_{module.stem}.py::", *DECLARED), f"tests/{package}/"

    def order(name: str) -> tuple[bool, bool, float]:
        return not name.startswith(own[0]), not name.startswith(own[1]), seconds.get(name, 1.0)

    chosen, total = [], 0.0
    for name in sorted(found, key=order):
        total += seconds.get(name, 1.0)
        if chosen and total > patience:
            break
        chosen.append(name)
    return chosen


Drawn = list[tuple[MutationSpec, list[str]]]
"""Mutants and the tests that each meets."""


Outcome = tuple[int | None, str]
"""Exit status of the tests, 0 if the mutant survives, and the difference."""


def outcomes(
    drawn: Drawn, tree: Path, timeout: float, jobs: int, kernel: str | None = None
) -> Iterator[tuple[MutationSpec, Outcome]]:
    """Test mutants, ``jobs`` at a time, each process in its own copy of the tree."""
    with ProcessPoolExecutor(jobs, initializer=_enter_copy, initargs=(tree, kernel)) as pool:
        running = {pool.submit(_test, mutant, tests, timeout): mutant for mutant, tests in drawn}
        for each in as_completed(running):
            yield running[each], each.result()


def survivors(drawn: Drawn, tree: Path, timeout: float, jobs: int) -> list[tuple[MutationSpec, Outcome]]:
    """Mutants that survive their tests with the compiled kernel and without it."""
    left: list[tuple[MutationSpec, Outcome]] = []
    for kernel in ("numpy", "c"):
        left = [each for each in outcomes(drawn, tree, timeout, jobs, kernel) if each[1][0] == 0]
        drawn = [(mutant, tests) for mutant, tests in drawn if any(mutant is other for other, _ in left)]
    return left


def _enter_copy(tree: Path, kernel: str | None) -> None:
    own = tree.parent / str(os.getpid())
    shutil.copytree(tree, own)
    os.chdir(own)
    os.environ["PYTHONPATH"] = str(own)
    sys.path[:] = [str(own), *(each for each in sys.path if Path(each).resolve() != ROOT)]
    os.environ.update({"RNC_PIN_KERNEL": kernel} if kernel else {})
    for each in LIBRARIES:
        import_module(each)


def _test(mutant: MutationSpec, tests: list[str], timeout: float) -> Outcome:
    operator = get_operator(mutant.operator_name)(**mutant.operator_args)
    with use_mutation(mutant.module_path, operator, mutant.occurrence) as texts:
        child = multiprocessing.get_context("fork").Process(target=_run, args=(tests,))
        child.start()
        child.join(timeout)
        child.kill()
        child.join()
    path, lines = str(mutant.module_path), (text.splitlines() for text in texts)
    return child.exitcode, "\n".join(difflib.unified_diff(*lines, path, path, lineterm=""))


def _run(tests: list[str]) -> None:
    sys.dont_write_bytecode = True  # of a mutant
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os._exit(pytest.main(["-q", "-x", "-n", "0", "-p", "no:cacheprovider", "-p", "no:cov", *tests]) if tests else 0)


def measure(tree: Path, tests: Iterable[str], jobs: int) -> None:
    """Copy this tree, enter the copy, and run tests without a mutant: tests.xml and .coverage are written there.

    Raises:
        SystemExit: the tests cannot be run.
    """
    for name in COPIED:
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (shutil.copytree if (ROOT / name).is_dir() else shutil.copy2)(ROOT / name, tree / name)
    os.environ.update({"PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"})
    os.chdir(tree)
    options = "-q -p no:cacheprovider --cov=rnc_pin --cov-context=test --cov-report= --junitxml=tests.xml"
    workers = ["-n", str(jobs)]  # without a worker, pytest-cov records no test with its lines
    command = [sys.executable, "-m", "pytest", *options.split(), *workers, *tests]
    if subprocess.run(command, check=False).returncode not in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
        raise SystemExit("the tests cannot be run")


def lower_bound(killed: int, drawn: int) -> float:
    """Smallest score of all mutants, with a confidence of 95 % (Wilson)."""
    z, share = 1.645, killed / drawn
    middle = share + z * z / (2 * drawn)
    return (middle - z * math.sqrt(share * (1 - share) / drawn + z * z / (4 * drawn**2))) / (1 + z * z / drawn)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("paths", nargs="*", default=["rnc_pin/outputs.py", *(f"rnc_pin/{name}" for name in PACKAGES)])
    parser.add_argument("--sample", type=int, help="number of random mutants; all by default")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--patience", type=float, default=60.0, help="duration of the tests of one mutant [s]")
    parser.add_argument("--timeout", type=float, help="duration that kills a mutant [s]; 60 s + 3 patience by default")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--tests", nargs="*", default=TESTS, help="files and folders of tests")
    given = parser.parse_args()
    paths = modules(given.paths)
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder).resolve() / "tree"
        measure(tree, given.tests, given.jobs)
        seconds, data, every = durations(tree / "tests.xml"), CoverageData(str(tree / ".coverage")), mutants(paths)
        data.read()
        contexts = {path: data.contexts_by_lineno(str(tree / path)) for path in paths}

        def meeting(some: Iterable[MutationSpec], patience: float) -> Drawn:
            """Mutants with their tests."""
            places = ((each, each.module_path, each.start_pos[0]) for each in some)
            return [(each, tests_of(path, line, contexts[path], seconds, patience)) for each, path, line in places]

        sample = random.Random(given.seed).sample(every, min(given.sample or len(every), len(every)))
        score: defaultdict[str, list[int]] = defaultdict(lambda: [0, 0])
        endless, tried_again = [], []
        timeout = given.timeout or 3.0 * given.patience + START_UP
        for mutant, (status, diff) in outcomes(meeting(sample, given.patience), tree, timeout, given.jobs):
            for name in (mutant.module_path.parent.name, "all"):
                score[name][0] += status != 0
                score[name][1] += 1
            if status == -signal.SIGKILL:
                endless.append(f"{mutant.module_path}:{mutant.start_pos[0]} ({mutant.operator_name})")
            if status == 0:
                tried_again.append(mutant)
                print(f"survives the first stage:\n{diff}\n", file=sys.stderr)
            print("{} of {} killed".format(*score["all"]), file=sys.stderr)
        first = score["all"][0]
        more = meeting(tried_again, MORE * given.patience)
        left = survivors(more, tree, timeout + 3.0 * (MORE - 1.0) * given.patience, given.jobs) if more else []
        for mutant in tried_again:
            for name in (mutant.module_path.parent.name, "all"):
                score[name][0] += not any(mutant is other for other, _ in left)
        for _, (_, diff) in left:
            print(f"survives:\n{diff}\n", flush=True)
        print(f"first stage: {first} of {len(sample)} killed; second stage: {len(tried_again) - len(left)} more")
    for name, (killed, count) in sorted(score.items()):
        print(f"{name}: {killed} of {count} killed, {100 * killed / count:.1f} %")
    print(f"of these, {len(endless)} by the timeout:", *sorted(endless), sep="\n  ")
    print(f"all {len(every)} mutants: at least {100 * lower_bound(*score['all']):.1f} %, with 95 % confidence")


if __name__ == "__main__":
    main()
