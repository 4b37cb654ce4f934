"""Tasks on several processors: the same results to the bit, and no helper is left behind."""

import os
import signal
import subprocess
import sys
import time
import warnings

import pytest

from patience import eventually
from processes import alive, children
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.pictures import Artists, draw_pictures, picture_names
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.shared_tasks import SharedTasks, processor_count
from rnc_pin.simulation import Outcome
from same_runs import check_same

PARENT = os.getpid()
QUICK = {"simulation.duration": 0.1}


@pytest.fixture(autouse=True)
def no_helper_is_left():
    """Tests before this one may have left other processes, such as the resource tracker of ``multiprocessing``."""
    before = set(children(PARENT))
    yield
    assert set(children(PARENT)) <= before


def ignored(number, value):
    """Progress that nobody watches."""


def results(run, helpers, count=6, **options):
    with SharedTasks(run, range(count), helpers, **options) as tasks:
        tasks.begin(7)
        return tasks.results(ignored)


class Meeting:
    """Wait in the first task of a process until this process and a helper are both at work, however slow they start."""

    def __init__(self):
        self._parent, self._helper = os.pipe(), os.pipe()
        self._met = False

    def __call__(self):
        own, other = (self._parent, self._helper) if os.getpid() == PARENT else (self._helper, self._parent)
        if not self._met:
            self._met = True
            os.write(own[1], b"...")  # one for each helper
            os.read(other[0], 1)


@pytest.mark.parametrize("helpers", [0, 1, 3])
def test_results_are_in_order_whoever_finds_them(helpers):
    meet = Meeting()

    def square(number, common, report):
        meet() if helpers else None
        return number * common, os.getpid()

    found = results(square, helpers)
    assert [value for value, _ in found.values()] == [0, 7, 14, 21, 28, 35]
    assert list(found) == list(range(6))
    assert {process == PARENT for _, process in found.values()} == ({True, False} if helpers else {True})


def test_progress_of_helpers_arrives():
    meet = Meeting()

    def task(number, common, report):
        meet()
        report(number, 0.5)

    seen = []
    with SharedTasks(task, range(4), 1) as tasks:
        tasks.begin(None)
        tasks.results(lambda number, value: seen.append((number, value)))
    assert sorted(seen) == [(number, 0.5) for number in range(4)]


def test_the_task_of_a_helper_that_dies_is_done_here():
    meet = Meeting()

    def task(number, common, report):
        meet()
        if os.getpid() != PARENT:
            os.kill(os.getpid(), signal.SIGKILL)
        return number

    assert results(task, 2) == {number: number for number in range(6)}


def test_an_input_that_cannot_be_pickled_stays_here():
    with SharedTasks(lambda number, common, report: common(number), range(3), 2) as tasks:
        tasks.begin(lambda number: -number)
        assert tasks.results(ignored) == {0: 0, 1: -1, 2: -2}


def test_errors_and_warnings_of_helpers_arrive():
    meet = Meeting()

    def task(number, common, report):
        meet()
        if os.getpid() != PARENT:
            warnings.warn("seen there", UserWarning, stacklevel=1)
            raise ValueError("wrong there")

    with pytest.warns(UserWarning, match="seen there"), pytest.raises(ValueError, match="wrong there"):
        results(task, 1)


def test_ctrl_c_ends_tasks_early_and_no_other_starts():
    meet = Meeting()

    def task(number, common, report):
        try:
            meet()
            if os.getpid() == PARENT:
                signal.raise_signal(signal.SIGINT)
            time.sleep(60.0)
        except KeyboardInterrupt:
            return "interrupted"
        return "completed"

    found = results(task, 1, ended_early=lambda result: result == "interrupted")
    assert found == {0: "interrupted", 1: "interrupted"}


def test_helpers_end_with_a_parent_that_is_killed(tmp_path):
    code = (
        "import time; from rnc_pin.applications.scenario.shared_tasks import SharedTasks\n"
        "tasks = SharedTasks(lambda *_: time.sleep(600), range(4), 2); tasks.begin(None); tasks.results(print)"
    )
    with subprocess.Popen([sys.executable, "-c", code]) as process:
        assert eventually(lambda: len(children(process.pid)) == 2)
        helpers = children(process.pid)
        process.kill()
    assert eventually(lambda: not any(map(alive, helpers)))


def test_no_processes_are_forked_beside_threads_that_simulate():
    assert processor_count() == len(os.sched_getaffinity(0))
    seen = []
    import threading

    thread = threading.Thread(target=lambda: seen.append(processor_count()))
    thread.start()
    thread.join()
    assert seen == [1]


# ---------------------------------------------------------------------- runs and pictures


@pytest.fixture(scope="module")
def alone():
    return execute(Scenario.load("space-robot", QUICK))


def test_comparisons_beside_the_run_are_the_same_to_the_bit(alone):
    shown = []
    prepared = Scenario.load("space-robot", QUICK).build()
    both = execute(prepared, progress=lambda done, _: shown.append(done), processes=2)
    assert both.comparisons.keys() == alone.comparisons.keys()
    for label, run in {"": alone.trajectory, **alone.comparisons}.items():
        check_same(run, both.comparisons.get(label, both.trajectory))
    assert both.summary["comparisons"] == alone.summary["comparisons"]
    assert shown == sorted(shown)
    assert shown[-1] == pytest.approx(prepared.total_duration)


def test_pictures_of_several_processes_are_the_same_to_the_byte(alone, tmp_path):
    prepared = Scenario.load("space-robot", {**QUICK, "plots": {}}).build()
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    one = draw_pictures(prepared, alone, tmp_path / "one")
    two = draw_pictures(prepared, alone, tmp_path / "two", artists=Artists(prepared, 2))
    assert one == two
    assert one.written == [name for name in picture_names(prepared) if name in one.written]
    plots = [name for name in one.written if name.endswith(".png")]
    assert plots
    for name in plots:  # objects of a page have random names
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    assert not list(tmp_path.glob("*/.rnc_pin*"))


def test_a_run_that_fails_ends_its_comparisons():
    far = {"reference.primary": {"minimum_jerk": {"to": [4, 0], "duration": 1}}, "simulation.duration": 2}
    result = execute(Scenario.load("space-robot", {**far, "controller.preset": "paper"}), processes=2)
    assert result.error is not None
    assert result.trajectory.outcome is not Outcome.COMPLETED
    assert not result.comparisons
