"""Tests of a mutated module in forks of one process, which has the libraries loaded, but nothing of the project."""

from __future__ import annotations

import importlib
import os
import resource
import sys
from collections.abc import Iterable, Iterator
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from types import CodeType
from typing import NamedTuple

import pytest

LIBRARIES = ("numpy", "scipy.interpolate", "scipy.linalg", "scipy.optimize", "scipy.signal", "scipy.spatial",
             "pinocchio", "pydantic", "yaml", "rich.console", "hypothesis", "sympy", "jaxtyping")  # fmt: skip
"""What most tests import."""
FIRST = 8
"""Tests that a mutant meets before those of all other files are imported: most do not outlive them."""


class Trial(NamedTuple):
    """A mutated module, and what it meets."""

    module: Path
    text: str
    tests: list[str]
    seconds: float
    """Of processor time, after which a mutant that is still running counts as noticed."""


class _Mutant(SourceFileLoader):
    """Loads one module from a text; the others, of which it knows nothing, as ever."""

    def __init__(self, trial: Trial) -> None:
        super().__init__(".".join(trial.module.with_suffix("").parts), str(trial.module.resolve()))
        self._text = trial.text

    def get_code(self, fullname: str) -> CodeType:
        return compile(self._text, self.path, "exec", dont_inherit=True)

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        return spec_from_file_location(name, self.path, loader=self) if name == self.name else None


def survivors(trials: Iterable[Trial], jobs: int) -> Iterator[tuple[Trial, bool]]:
    """Trials, as they end, and whether no test noticed; ``jobs`` at a time."""
    for library in LIBRARIES:
        importlib.import_module(library)
    assert "rnc_pin" not in sys.modules
    running: dict[int, Trial] = {}
    for trial in trials:
        if len(running) == jobs:
            yield _ended(running)
        running[_start(trial)] = trial
    while running:
        yield _ended(running)


def _ended(running: dict[int, Trial]) -> tuple[Trial, bool]:
    process, status = os.wait()
    return running.pop(process), status == 0


def _start(trial: Trial) -> int:
    process = os.fork()
    if process:
        return process
    code = 1
    try:
        resource.setrlimit(resource.RLIMIT_CPU, (int(trial.seconds),) * 2)
        for stream in (1, 2):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
        sys.dont_write_bytecode = True
        os.environ.pop("PYTEST_ADDOPTS", None)  # workers of its own would load what is in the files
        sys.meta_path.insert(0, _Mutant(trial))
        options = ["-q", "-x", "-p", "no:cacheprovider", "-p", "no:cov"]
        code = 0
        for chosen in (trial.tests[:FIRST], trial.tests[FIRST:]):
            code = code or (int(pytest.main([*options, *chosen])) if chosen else 0)
    finally:
        os._exit(code)
