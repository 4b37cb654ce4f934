"""Whatever ends a run or a sweep early: what it has reached is kept, and nothing goes on behind its back."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import rnc_pin as rnc
from patience import PATIENCE, eventually
from processes import alive, children
from rnc_pin.control import Command
from rnc_pin.interruption import interruptible, uninterrupted
from rnc_pin.simulation.sampled_run import SampledRun
from simple_controllers import Memoryless
from systems import sleigh
from terminal import UNDRAWN

RUN = ["run", "space-robot", "--set", "comparisons={}", "--set", "plots={}"]


def pushing(then, until=0.1):
    """Return a controller that pushes until a time, and then does something else."""
    return Memoryless(lambda t, _: then() if t > until else Command(T=np.array([1.0, 0.5])))


def fault():
    raise ZeroDivisionError("division\nby zero")


def out_of_memory():
    raise MemoryError


THEN = {
    "raises": (fault, ZeroDivisionError, "the controller raised ZeroDivisionError at t = 0.110 s: division by zero"),
    "without a word": (out_of_memory, MemoryError, "the controller raised MemoryError at t = 0.110 s"),
    "one input of two": (lambda: Command(T=np.ones(1)), None, "T of a command has shape (1,), expected (2,)"),
    "inputs as a matrix": (lambda: Command(T=np.ones((2, 1))), None, "T of a command has shape (2, 1), expected (2,)"),
    "text": (lambda: Command(T="full ahead"), None, "the T of a command is not an array of numbers: 'full ahead'"),
    "nothing": (lambda: None, None, "step of a controller has to return a Command and its state, found None"),
    "one aim of two": (
        lambda: Command(T=np.ones(2), v2_desired=np.ones(1)), None, "v2_desired of a command has shape (1,)"
    ),
    "three forces": (lambda: Command(F=np.ones(3)), None, "expected (..., 2)"),
}  # fmt: skip


@pytest.mark.parametrize(("then", "cause", "words"), THEN.values(), ids=THEN)
def test_whatever_a_controller_does_the_run_so_far_is_kept(then, cause, words):
    reduced = sleigh()
    with pytest.raises(rnc.RncError) as caught:
        rnc.simulate(reduced, pushing(then), reduced.robot.configuration(), 1.0, dt=0.01)
    error = caught.value
    assert words in str(error)
    assert len(str(error).splitlines()) == 1
    assert (cause is None and error.__cause__ is None) or isinstance(error.__cause__, cause)
    run = error.trajectory
    assert run.outcome is rnc.Outcome.FAILED
    assert (run.info.message, len(run.time)) == (str(error), 11)
    assert np.isfinite(run.energy).all()


def figure_missing(t):
    if t > 0.5:
        raise KeyError("figure")


def observed(reduced, q0):
    options = rnc.SimulationOptions(observer=lambda sample: figure_missing(sample.time))
    rnc.simulate(reduced, pushing(fault, np.inf), q0, 1.0, dt=0.01, options=options)


def fed_back(reduced, q0):
    rnc.free_motion(reduced, q0, [1.0, 0.5], 1.0, 0.01, lambda t, q, v2: figure_missing(t) or np.ones(2))


def rolled_out(reduced, q0):
    hold = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([0.0, 0.0]))
    target = Memoryless(lambda t, measurement: figure_missing(t) or hold.step(t, measurement, None)[0])
    rnc.kinematic_rollout(reduced, target, q0, 1.0)


@pytest.mark.parametrize(("motion", "who"), [(observed, "observer"), (fed_back, "feedback"), (rolled_out, "target")])
def test_a_function_of_a_user_that_raises_does_not_lose_the_motion(motion, who):
    reduced = sleigh()
    with pytest.raises(rnc.SimulationError, match=rf"the {who} raised KeyError at t = 0\.\d+ s: 'figure'") as caught:
        motion(reduced, reduced.robot.configuration())
    assert isinstance(caught.value.__cause__, KeyError)
    assert caught.value.trajectory.time[-1] > 0.3


def test_interruptions_wait_until_nothing_is_lost_by_them():
    order = []

    def interrupted():
        with uninterrupted():
            signal.raise_signal(signal.SIGINT)
            order.append("not yet")
            with interruptible():
                order.append("never")

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert order == ["not yet"]
    with uninterrupted():
        with pytest.raises(KeyboardInterrupt), interruptible():
            signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        order.append("kept")
    assert order == ["not yet", "kept"]
    with pytest.raises(KeyboardInterrupt), uninterrupted():  # nobody took it
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_three_interruptions_keep_the_run_in_a_program_of_ones_own(monkeypatch):
    reduced, finish = sleigh(), SampledRun.finish

    def impatient(*arguments):
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        return finish(*arguments)

    monkeypatch.setattr(SampledRun, "finish", impatient)
    then = pushing(lambda: signal.raise_signal(signal.SIGINT))
    run = rnc.simulate(reduced, then, reduced.robot.configuration(), 1.0, dt=0.01)
    assert run.outcome is rnc.Outcome.INTERRUPTED
    assert len(run.time) == 11


def processor_time(pid):
    """Seconds that a process has computed; a busy machine gives it less of them than the clock shows."""
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11]) / os.sysconf("SC_CLK_TCK")


def started(*arguments, **options):
    command = [*UNDRAWN, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def test_a_run_that_is_asked_to_end_keeps_its_results(tmp_path):
    """By Ctrl-C, and by an impatient user; SIGTERM ends the sweep below by the same handler."""
    out = tmp_path / "out"
    command = [sys.executable, "-m", "rnc_pin", *RUN, "--set", "simulation.duration=100", "--out", str(out)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert any("simulating" in line for line in process.stdout)
        begun = processor_time(process.pid)
        assert eventually(lambda: processor_time(process.pid) > begun + 0.3)
        while process.poll() is None:  # until the end, also while the interpreter leaves
            process.send_signal(signal.SIGINT)
            time.sleep(0.02)
        _, error = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1
    assert error.splitlines()[-1].startswith("rnc-pin: error: interrupted at t = ")
    assert error.splitlines()[-1].endswith(f" s; results so far are in {out}")
    assert "Traceback" not in error
    run = rnc.Trajectory.load(out / "trajectory.npz")
    assert run.outcome is rnc.Outcome.INTERRUPTED
    assert len(run.time) > 10
    summary = json.loads((out / "summary.json").read_text())
    assert summary["outcome"] == "interrupted"
    assert 0 < summary["duration"] == run.time[-1] < 100
    assert summary["samples"] == len(run.time)
    assert {path.name for path in out.iterdir()} == {".rnc_pin", "trajectory.npz", "summary.json", "scenario.yaml"}


def test_ctrl_c_while_pictures_are_drawn_costs_pictures_alone(tmp_path, call, monkeypatch):
    monkeypatch.setattr(rnc.simulation, "plot_run", lambda *arguments: signal.raise_signal(signal.SIGINT))
    arguments = [*RUN, "--set", "simulation.duration=0.02", "--out", tmp_path]
    for _ in range(2):  # the second time there is something to replace
        status, _, error = call(*arguments)
        assert status == 1
        assert error.splitlines()[-1] == f"rnc-pin: error: interrupted; results so far are in {tmp_path}"
        names = {path.name for path in tmp_path.iterdir()}
        assert names == {".rnc_pin", "trajectory.npz", "summary.json", "scenario.yaml"}


SWALLOWS = """
import signal, sys
from rnc_pin.interruption import endings_as_ctrl_c, interruptible, nothing_to_keep, uninterrupted
class Left:
    def __del__(self):  # Python prints an exception in a finalizer, and continues
        signal.raise_signal(signal.SIGTERM)
with endings_as_ctrl_c():
    with {}:
        Left()
sys.exit(0)
"""


@pytest.mark.parametrize("where", ["nothing_to_keep()", "uninterrupted(), interruptible()"])
def test_an_interruption_that_is_swallowed_counts(where):
    code = [sys.executable, "-c", SWALLOWS.format(where)]
    assert subprocess.run(code, capture_output=True, check=False, timeout=PATIENCE).returncode in (1, -2)


AT_ITS_END = 0.3
"""[s] of processor time that a run which has finished takes to end."""


def test_a_run_ends_with_status_1_at_any_moment(tmp_path):
    """From the imports to the last picture; a picture that was not finished does not stay."""
    command = [sys.executable, "-m", "rnc_pin", "run", "space-robot", "--set", "simulation.duration=1", "--out"]
    for out in ("first", "whole"):  # the first one compiles modules
        with subprocess.Popen([*command, tmp_path / out], stdout=subprocess.DEVNULL) as process:
            used = os.wait4(process.pid, 0)[2]
    for k, share in enumerate((0.1, 0.35, 0.55, 0.75)):
        out, before = tmp_path / str(k), resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        with subprocess.Popen([*command, out], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            wanted = share * used.ru_utime
            assert eventually(lambda p=process, w=wanted: p.poll() is not None or processor_time(p.pid) > w)
            finished = process.returncode is not None  # this machine is faster now
            process.send_signal((signal.SIGTERM, signal.SIGHUP, signal.SIGINT)[k % 3])
            _, error = process.communicate(timeout=PATIENCE)
        went_on = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before - wanted
        assert process.returncode == 0 if finished else process.returncode == 1 or went_on < AT_ITS_END, error
        assert not [*out.rglob(".rnc_pin_*")]


def rows(out):
    try:
        return list(rnc.load_sweep(out).rows())
    except rnc.ConfigurationError:  # not yet
        return []


@pytest.mark.parametrize("end", [signal.SIGTERM, pytest.param(signal.SIGKILL, marks=pytest.mark.long)], ids=str)
def test_a_sweep_that_is_ended_keeps_its_runs_and_its_workers_end(end, tmp_path):
    out = tmp_path / "out"
    command = ["sweep", "space-robot", "--set", "simulation.duration=0.2", "--jobs", 2, "--out", out, "--runs"]
    with started(*command, 2000) as process:
        assert eventually(lambda: len(rows(out)) >= 3)
        workers = children(process.pid)
        assert workers
        process.send_signal(end)
        _, error = process.communicate(timeout=PATIENCE)
    assert eventually(lambda: not any(map(alive, workers)))
    table = rows(out)
    assert len(table) >= 3
    assert all(row["outcome"] == "completed" for row in table)
    if end == signal.SIGTERM:
        assert process.returncode == 1
        assert error.splitlines()[-1].startswith(f"rnc-pin: error: interrupted after {len(table)} of 2000 runs")
        assert {path.name for path in out.iterdir()} == {"specification.json", "runs.jsonl"}
