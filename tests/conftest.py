"""Shapes in annotations are checked while tests run; slow tests are listed; fixtures that many files share."""

import gc
import os
import signal
import sys
from collections import Counter
from pathlib import Path

# Threads of OpenBLAS spin while they wait for each other: beside other work, tests with large matrices take three times
# as long. NumPy reads this when it is imported; the plugin of jaxtyping, which imports it, is not loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from jaxtyping import install_import_hook

import shape_checker

# For benchmarks.validation; last, so that it is the installed rnc_pin that is tested.
sys.path.append(str(Path(__file__).parent.parent))

# A job in the background of a script ignores Ctrl-C, and one of nohup a closed terminal. So would every process that is
# sent such a signal here.
for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, handler)

# Before anything imports rnc_pin: from here on what annotates shapes checks what it returns. Code that runs once a
# sample and annotates none is left out, because a checked call costs several times an unchecked one.
install_import_hook("rnc_pin.model.reduced_model", "shape_checker.check")


SLOW = Path(__file__).parent / "slow.txt"
LONGEST = 0.2  # [s] of a quick test


def pytest_addoption(parser):
    parser.addoption("--write-slow", action="store_true", help="run all tests, and list those over 0.2 s in slow.txt")


def pytest_configure(config):
    if not config.option.markexpr:
        # `pytest` alone runs the quick tests, `pytest FILE` all tests of a file.
        named = config.args_source is pytest.Config.ArgsSource.ARGS
        quick = "" if named or config.option.write_slow else " and not slow"
        config.option.markexpr = f"not published and not long{quick}"
    if config.option.write_slow and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Durations(config))


@pytest.hookimpl(tryfirst=True)  # before -m chooses
def pytest_collection_modifyitems(items):
    slow = set(SLOW.read_text(encoding="utf-8").splitlines())
    for item in items:
        if item.nodeid in slow:
            item.add_marker("slow")


class Durations:
    """Durations of tests, which decide who is listed in slow.txt. Tests that did not run keep their lines."""

    def __init__(self, config):
        self._whole = config.args_source is not pytest.Config.ArgsSource.ARGS
        self._seconds = Counter()

    def pytest_runtest_logreport(self, report):
        self._seconds[report.nodeid] += report.duration

    def pytest_sessionfinish(self):
        listed = () if self._whole else SLOW.read_text(encoding="utf-8").splitlines()
        slow = {name for name in listed if name not in self._seconds}
        slow |= {name for name, seconds in self._seconds.items() if seconds > LONGEST}
        SLOW.write_text("".join(f"{name}\n" for name in sorted(slow)), encoding="utf-8")


gc.disable()  # until all tests are collected: hardly anything that collection creates is garbage


def pytest_collection_finish():
    gc.freeze()  # every full collection of garbage would visit thousands of tests and their modules
    gc.set_threshold(100_000, 50, 100)  # of short-lived objects there are many: a sixth of the time
    gc.enable()


def pytest_unconfigure():
    gc.unfreeze()  # else the types of OMPL outlive the interpreter, and its bindings print 40 lines of leaks


def pytest_runtest_setup():
    shape_checker.start_again()


@pytest.fixture
def generator():
    """Random numbers, the same for each test."""
    import numpy as np

    return np.random.default_rng(0)


@pytest.fixture
def robot():
    """The space robot, a new one for each test; a file may have another one."""
    import rnc_pin as rnc

    return rnc.Robot.from_urdf("space_robot.urdf")


@pytest.fixture
def call(monkeypatch, capfd):
    """Run rnc-pin in this process, which is faster: (status, stdout, stderr), with what libraries in C print."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["rnc-pin", *map(str, arguments)])
        from rnc_pin.applications.command_line.cli import main

        with pytest.raises(SystemExit) as end:
            main()
        return end.value.code, *capfd.readouterr()

    return run


@pytest.fixture
def brief(monkeypatch):
    """Drafts are tried out for a moment, and motions are checked at few places."""
    monkeypatch.setattr("rnc_pin.applications.init.scenario_candidate._PATIENCE", 0.0)
    monkeypatch.setattr("rnc_pin.applications.init.scenario_candidate._SHORT", 0.02)  # [s]
    monkeypatch.setattr("rnc_pin.applications.scenario.controllers.base._ROLLOUT_STEP", 0.25)  # [s]


@pytest.fixture(scope="module")
def browser():
    """A browser, or a skip without one."""
    from browsing import opened

    with opened() as launched:
        yield launched


@pytest.fixture
def no_pictures(monkeypatch):
    """Runs of the command line without pictures, which cost more than a short simulation."""
    from rnc_pin.applications.scenario.execution import Drawn

    monkeypatch.setattr("rnc_pin.applications.command_line.report.draw_pictures", lambda *_: Drawn())
