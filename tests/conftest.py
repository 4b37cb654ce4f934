"""Shapes in annotations are checked while tests run; the command line as a fixture."""

import gc
import os
import signal
import sys
from pathlib import Path

# Threads of OpenBLAS spin while they wait for each other: beside other work, tests with large matrices take three times
# as long. NumPy reads this when it is imported; the plugin of jaxtyping, which imports it, is not loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from jaxtyping import install_import_hook

import shape_checker

# For benchmarks.validation; last, so that it is the installed rnc_pin that is tested.
sys.path.append(str(Path(__file__).parent.parent))

# A job in the background of a script ignores Ctrl-C, and so would every process that is sent one here.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Before anything imports rnc_pin: from here on what annotates shapes checks what it returns. Code that runs once a
# sample and annotates none is left out, because a checked call costs several times an unchecked one.
install_import_hook(
    [f"rnc_pin.{module}" for module in ("model.reduced_model", "simulation.trajectory")],
    "shape_checker.check",
)


gc.disable()  # until all tests are collected: hardly anything that collection creates is garbage


def pytest_collection_finish():
    gc.freeze()  # every full collection of garbage would visit thousands of tests and their modules
    gc.set_threshold(100_000, 50, 100)  # of short-lived objects there are many: a sixth of the time
    gc.enable()


def pytest_runtest_setup():
    shape_checker.start_again()


@pytest.fixture
def call(monkeypatch, capsys):
    """Run rnc-pin in this process, which is faster: (status, stdout, stderr)."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["rnc-pin", *map(str, arguments)])
        from rnc_pin.applications.command_line.cli import main

        with pytest.raises(SystemExit) as end:
            main()
        return end.value.code, *capsys.readouterr()

    return run


@pytest.fixture
def brief(monkeypatch):
    """Drafts are tried out for a moment, and motions are checked at few places."""
    monkeypatch.setattr("rnc_pin.applications.init.scenario_candidate._PATIENCE", 0.0)
    monkeypatch.setattr("rnc_pin.applications.init.scenario_candidate._SHORT", 0.02)  # [s]
    monkeypatch.setattr("rnc_pin.applications.scenario.controllers.context._ROLLOUT_STEP", 0.25)  # [s]


@pytest.fixture(scope="module")
def browser():
    """A browser, or a skip without one."""
    from browsing import opened

    with opened() as launched:
        yield launched


@pytest.fixture
def no_pictures(monkeypatch):
    """Runs of the command line without pictures, which cost more than a short simulation."""
    from rnc_pin.applications.scenario.pictures import Drawn

    monkeypatch.setattr("rnc_pin.applications.command_line.report.draw_pictures", lambda *_: Drawn())
    monkeypatch.setattr("rnc_pin.applications.command_line.commands.run.processor_count", lambda: 1)
    monkeypatch.setattr("rnc_pin.applications.sweep.reports.draw_distributions", lambda *_: None)
