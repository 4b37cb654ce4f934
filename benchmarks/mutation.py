"""How many small wrongs the tests notice: ``python -m benchmarks.mutation rnc_pin/control/windup.py ...``.

Cosmic Ray makes every mutant of the modules, one after the other, and runs the tests that belong to them. That is done
on a copy of the tree, so that the one that is worked on stays as it is. Without arguments all modules of ``TESTS`` are
mutated, which takes days on two cores; name some. Survivors are printed as differences, to be killed by an assertion or
found equivalent by a reader.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
COPIED = ("rnc_pin", "tests", "urdf", "benchmarks", "pyproject.toml", "docs", "README.md")
TIMEOUT = 300.0  # [s], of the tests of one mutant

# Which tests know a module best, those of the longest path that it begins with; all others would be slow, not wrong.
TESTS = {
    "rnc_pin/model": "test_closed_forms test_reference_data test_lemma_1 test_systems test_evaluation",
    "rnc_pin/constraints": "test_strange_rows test_rolling test_loops test_affine test_systems",
    "rnc_pin/outputs": "test_strange_rows test_orientation test_systems",
    "rnc_pin/outputs/frame_tilt.py": "test_tilt_and_spin test_strange_rows",
    "rnc_pin/outputs/frame_spin.py": "test_tilt_and_spin",
    "rnc_pin/control": "test_closed_forms test_control test_position_tracker test_secondary",
    "rnc_pin/control/windup.py": "test_windup",
    "rnc_pin/control/uncertain_redundancy.py": "test_closed_forms test_uncertain_kinematics test_uncertain_wheels",
    "rnc_pin/control/steering.py": "test_closed_forms test_steering",
    "rnc_pin/control/slithering.py": "test_slithering",
    "rnc_pin/planning": "test_closed_forms test_references test_car_path test_chained_form",
    "rnc_pin/analysis": "test_closed_forms test_analysis test_linearization test_equilibrium",
}


def tests_of(module: str) -> str:
    """The command that runs them."""
    known = max((path for path in TESTS if module.startswith(path)), key=len, default=None)
    if known is None:
        raise SystemExit(f"no tests are listed for {module}: expected something in {', '.join(TESTS)}")
    files = " ".join(f"tests/{name}.py" for name in TESTS[known].split())
    return f"{sys.executable} -m pytest -q -x --no-header -p no:cacheprovider {files}"


def modules(paths: list[str]) -> Iterator[str]:
    """Python files below the paths, from the root."""
    for path in paths:
        found = sorted((ROOT / path).rglob("*.py")) if (ROOT / path).is_dir() else [ROOT / path]
        yield from (str(each.relative_to(ROOT)) for each in found if each.name != "__init__.py")


def mutate(module: str, tree: Path) -> tuple[int, int]:
    """How many mutants of a module there are, and how many survived."""
    settings, session = tree / "mutation.toml", tree / "mutation.sqlite"
    session.unlink(missing_ok=True)
    settings.write_text(
        f'[cosmic-ray]\nmodule-path = "{module}"\ntimeout = {TIMEOUT}\nexcluded-modules = []\n'
        f'test-command = "{tests_of(module)}"\n[cosmic-ray.distributor]\nname = "local"\n'
    )
    environment = {**os.environ, "PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"}

    def run(*command: str) -> str:
        done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"{' '.join(command)} failed: {done.stdout}{done.stderr}")
        return done.stdout

    run("cosmic-ray", "baseline", settings.name)
    run("cosmic-ray", "init", settings.name, session.name)
    run("cr-filter-pragma", session.name)
    run("cosmic-ray", "exec", settings.name, session.name)
    print(run("cr-report", "--show-diff", "--surviving-only", session.name), flush=True)
    report = run("cr-report", session.name)
    total = next(int(line.split()[-1]) for line in report.splitlines() if line.startswith("total jobs"))
    survived = next(int(line.split()[2]) for line in report.splitlines() if line.startswith("surviving mutants"))
    return total, survived


def main() -> None:
    score = {}
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder)
        for name in COPIED:
            source = ROOT / name
            (shutil.copytree if source.is_dir() else shutil.copy)(source, tree / name)
        for module in modules(sys.argv[1:] or [path for path in TESTS if not path.endswith(".py")]):
            score[module] = mutate(module, tree)
    for module, (total, survived) in score.items():
        share = f"{100 * (total - survived) / total:.0f} %" if total else "nothing to mutate"
        print(f"{module}: {total} mutants, {total - survived} killed: {share}")


if __name__ == "__main__":
    main()
