"""Tests that execute a line, and the confidence bound of a sample."""

from __future__ import annotations

import ast
import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

ROOT = Path(__file__).parents[1]
_START = 0.1  # what any test takes besides itself [s]
# Folders and files that are about these packages; those of commands, browsers and readers take minutes and see little.
TESTS = (
    "tests/analysis", "tests/constraints", "tests/control", "tests/loop", "tests/model", "tests/outputs",
    "tests/planning",
    "tests/robots/test_single_joint.py", "tests/robots/test_vehicles.py", "tests/simulation/test_simulate.py",
    "tests/simulation/test_integrators.py", "tests/system/test_regular_motion.py", "tests/test_printing.py",
)  # fmt: skip


class TimedTest(NamedTuple):
    """One test as it is without a mutant."""

    seconds: float
    name: str


class Lines:
    """Tests that execute each line.

    Args:
        tree: that the tests ran in, with JUnit's report ``tests.xml``, which says how long they took.
        contexts: of each line of a file the tests that went through it, as coverage.py has them; "" for its import.
    """

    def __init__(self, tree: Path, contexts: Callable[[str], Mapping[int, list[str]]]) -> None:
        self._tree, self._contexts = tree, contexts
        self._seconds: dict[str, float] = {}
        for case in ElementTree.parse(tree / "tests.xml").iter("testcase"):
            file = case.attrib["classname"].replace(".", "/")
            self._seconds[f"{file}.py::{case.attrib['name']}"] = float(case.attrib["time"])

    def through(self, module: Path, line: int) -> list[TimedTest]:
        """Tests of a line, those first that are most likely to see what is wrong there.

        Of what runs at import those of the module, or all where the module is nothing else.

        By turns comes a test that goes through much of the module where few others do, for its time, and one of
        another file, the shortest first.
        """
        contexts = self._contexts(str(self._tree / module))
        tests_of = {number: {name.rpartition("|")[0] for name in names} for number, names in contexts.items()}
        found = {each for number in statement(self._tree / module, line) for each in tests_of.get(number, ())}
        if found == {""}:
            found = {each for names in tests_of.values() for each in names} - {""} or self._seconds.keys()
        tests = sorted(TimedTest(self._seconds.get(name, 1.0), name) for name in found - {""})
        seldom: defaultdict[str, float] = defaultdict(float)
        for names in tests_of.values():
            for name in names:
                seldom[name] += 1.0 / len(names)
        own = sorted(tests, key=lambda test: -seldom[test.name] / (test.seconds + _START))
        return list(dict.fromkeys(each for pair in zip(own, in_turn(tests), strict=True) for each in pair))


def in_turn(tests: list[TimedTest]) -> list[TimedTest]:
    """One of each file, then another of each: what one does not notice the next of its kind seldom does."""
    before: Counter[str] = Counter()
    rounds = []
    for test in tests:
        file = test.name.partition("::")[0]
        rounds.append((before[file], test))
        before[file] += 1
    return [test for _, test in sorted(rounds)]


def statement(path: Path, line: int) -> range:
    """Lines of the innermost statement around a line; of one that holds others its head."""
    inner = range(line, line + 1)
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.stmt):
            body = getattr(node, "body", None)
            start = min([node.lineno, *(each.lineno for each in getattr(node, "decorator_list", []))])
            end = max(start, body[0].lineno - 1 if body else node.end_lineno or node.lineno)
            if start <= line <= end:
                inner = range(start, end + 1)
    return inner


def modules(paths: list[str]) -> Iterator[Path]:
    """Python files below the paths, from the root."""
    for path in paths:
        found = sorted((ROOT / path).rglob("*.py")) if (ROOT / path).is_dir() else [ROOT / path]
        yield from (each.relative_to(ROOT) for each in found if each.name != "__init__.py")


def lowest(killed: int, drawn: int) -> float:
    """The share that the whole has at least, with a confidence of 95 % (Wilson)."""
    z, share = 1.645, killed / drawn
    middle = share + z * z / (2 * drawn)
    return (middle - z * math.sqrt(share * (1 - share) / drawn + z * z / (4 * drawn**2))) / (1 + z * z / drawn)
