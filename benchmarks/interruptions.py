"""Whatever ends a run or a sweep early, what it has reached is kept: each kind of ending once, in processes of its own.

python -m benchmarks.interruptions
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import rnc_pin as rnc
from benchmarks.processes import alive, children

PATIENCE = 120.0  # [s]; for a process to start and to end on a busy machine
SHORT = ["--set", "comparisons={}", "--set", "plots={}", "--set", "simulation.duration=0.1"]
LONG = [*SHORT[:4], "--set", "simulation.duration=1000"]
ALL = {".rnc_pin", "trajectory.npz", "summary.json", "scenario.yaml"}

_MAIN = "\nfrom rnc_pin.applications.command_line.cli import main\nmain()\n"
_EACH_CONTROLLER = """
from rnc_pin.control import ComputedTorque, Command, VelocityTracker
def spoil(kind):
    usual = kind.step
    def step(self, t, measurement, state):
        command, state = usual(self, t, measurement, state)
        return (spoiled(command) if t > 0.05 else command), state
    kind.step = step
for kind in (ComputedTorque, VelocityTracker):
    spoil(kind)
"""
_INTERRUPT = "import signal\ndef interrupt(*_, **__): signal.raise_signal(signal.SIGINT)\n"


class Run:
    """A command in a process of its own, as a context that leaves none behind."""

    def __init__(self, *arguments: object, before: str = "") -> None:
        command = [sys.executable, *(("-c", before + _MAIN) if before else ("-m", "rnc_pin")), *map(str, arguments)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.error = ""

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()

    def send(self, *numbers: signal.Signals) -> None:
        for number in numbers:
            self.process.send_signal(number)
            time.sleep(0.02)

    def end(self) -> int:
        """Exit status; whatever it says is short, and no traceback."""
        _, self.error = self.process.communicate(timeout=PATIENCE)
        check("Traceback" not in self.error, self.error)
        return self.process.returncode

    def line(self) -> str:
        """The last line of what it says is wrong."""
        return self.error.splitlines()[-1] if self.error else ""


def check(true: bool, otherwise: object = "") -> None:
    if not true:
        raise AssertionError(str(otherwise)[-600:])


def wait(true: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not true():
        check(time.monotonic() < end, "it did not come to that")
        time.sleep(0.02)


def computed(pid: int) -> float:
    """Seconds that a process has computed."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return int(fields[11]) / os.sysconf("SC_CLK_TCK")


def under_way(run: Run, out: Path) -> None:
    """Wait until a run has steps behind it."""
    wait((out / ".rnc_pin").exists)
    begun = computed(run.process.pid)
    wait(lambda: computed(run.process.pid) > begun + 0.5)


def kept(out: Path, outcome: rnc.Outcome) -> str:
    run = rnc.Trajectory.load(out / "trajectory.npz")
    check(run.outcome is outcome, run.outcome)
    check(len(run.time) > 1, "no samples")
    names = {path.name for path in out.iterdir()}
    check(names >= ALL, names)
    check(not [name for name in names if name.startswith(".rnc_pin_")], names)
    return f"the run so far ({run.outcome.value}, {len(run.time)} samples)"


def asked_to_end(out: Path, *signals: signal.Signals) -> str:
    with Run("run", "space-robot", *LONG, "--out", out) as run:
        under_way(run, out)
        run.send(*signals)
        check(run.end() == 1, run.error)
        line = run.line()
        check(line.startswith("rnc-pin: error: interrupted at t = "), run.error)
        check(line.endswith(f" s; results so far are in {out}"), run.error)
    return kept(out, rnc.Outcome.INTERRUPTED)


def ctrl_c_while_importing(out: Path) -> str:
    for moment in (0.15, 0.6):
        with Run("run", "space-robot", *SHORT, "--out", out) as run:
            wait(lambda run=run, moment=moment: computed(run.process.pid) > moment)
            run.send(signal.SIGINT)
            check(run.end() == 1, run.error)
            check(run.error == "rnc-pin: error: interrupted\n", run.error)
    check(not out.exists(), "a folder")
    return "nothing was there to keep; no folder is left"


def ctrl_c_while_writing(out: Path) -> str:
    before = _INTERRUPT + (
        "from rnc_pin import Trajectory\nusual = Trajectory.save\n"
        "def save(self, path):\n    interrupt()\n    usual(self, path)\n    interrupt()\n"
        "Trajectory.save = save\n"
    )
    with Run("run", "space-robot", *SHORT, "--out", out, before=before) as run:
        check(run.end() == 1, run.error)
    return kept(out, rnc.Outcome.COMPLETED)


def ctrl_c_while_drawing(out: Path) -> str:
    before = _INTERRUPT + "from rnc_pin.simulation import run_figure\nrun_figure.plot_run = interrupt\n"
    with Run("run", "space-robot", *SHORT, "--out", out, before=before) as run:
        check(run.end() == 1, run.error)
    return kept(out, rnc.Outcome.COMPLETED) + ", without pictures"


def run_killed(out: Path) -> str:
    complete(out)
    before = contents(out)
    with Run("run", "space-robot", *LONG, "--out", out) as run:
        wait(lambda: bool(list(out.glob(".rnc_pin_*"))))
        time.sleep(1.0)
        run.send(signal.SIGKILL)
        run.process.wait()
    check(contents(out) == before, "what was there is changed")
    complete(out)
    check({path.name for path in out.iterdir()} >= ALL and not list(out.glob(".rnc_pin_*")), "leftovers")
    return "the results from before; the next run clears up"


def swept(out: Path, whom: Callable[[Run, list[int]], int], number: signal.Signals, survives: bool = False) -> str:
    command = ["sweep", "space-robot", "--set", "simulation.duration=0.2", "--runs", 200, "--jobs", 2, "--out", out]
    with Run(*command) as run:
        wait(lambda: len(rows(out)) >= 3)
        workers = children(run.process.pid)
        os.kill(whom(run, workers), number)
        status = run.end()
        check((status == 0) == survives, f"status {status}")
        table = rows(out)
    wait(lambda: not any(map(alive, workers)))
    check(len(table) >= 3, table)
    with Run(*command) as run:
        check(run.end() == 0, run.error)
    complete_table = rows(out)
    check([row["run"] for row in complete_table] == list(range(200)), "runs are missing")
    check(all(row == complete_table[row["run"]] for row in table), "a run was repeated")  # its wall time would differ
    return f"the runs so far ({len(table)}); the same command does the others; no worker goes on"


def rows(out: Path) -> list[dict[str, Any]]:
    try:
        return list(rnc.load_sweep(out).rows())
    except rnc.ConfigurationError:  # not yet
        return []


def complete(out: Path) -> None:
    with Run("run", "space-robot", *SHORT, "--out", out) as run:
        check(run.end() == 0, run.error)


def contents(out: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}


def full_disk(out: Path) -> str:
    complete(out)
    before = contents(out)
    limit = "import resource, signal, sys\nsys.dont_write_bytecode = True\n"
    limit += "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
    limit += "resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))\n"
    with Run("run", "space-robot", *SHORT, "--out", out, before=limit) as run:
        check(run.end() == 1, run.error)
        check(run.line().startswith(f"rnc-pin: error: --out {out}: cannot be written: "), run.error)
    check(contents(out) == before, "what was there is changed")
    check(not list(out.glob(".rnc_pin_*")), "leftovers")
    return "the results from before; nothing half-written"


def folder_removed(out: Path) -> str:
    with Run("run", "space-robot", *LONG, "--out", out) as run:
        under_way(run, out)
        shutil.rmtree(out)
        run.send(signal.SIGINT)
        check(run.end() == 1, run.error)
    return kept(out, rnc.Outcome.INTERRUPTED) + "; the folder is made again"


def spoiled(out: Path, how: str, words: str) -> str:
    before = f"def spoiled(command): {how}\n{_EACH_CONTROLLER}"
    with Run("run", "space-robot", *SHORT, "--out", out, before=before) as run:
        check(run.end() == 1, run.error)
        check(words in run.line() and f"results so far are in {out}" in run.line(), run.error)
    return kept(out, rnc.Outcome.FAILED)


def observer_raises(out: Path) -> str:
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], [rnc.FrameForce("sleigh", "x")])

    def look(sample: rnc.simulation.Sample) -> None:
        if sample.time > 0.1:
            raise KeyError("figure")

    class Idle:
        def initial_state(self, measurement: rnc.Measurement) -> None:
            return None

        def step(self, t: float, measurement: rnc.Measurement, state: None) -> tuple[rnc.control.Command, None]:
            return rnc.control.Command(T=np.zeros(1)), state

    try:
        rnc.simulate(
            system.reduce(), Idle(), robot.configuration(), 1.0, dt=0.01, options=rnc.SimulationOptions(observer=look)
        )
    except rnc.SimulationError as error:
        check("the observer raised KeyError" in str(error), error)
        check(error.trajectory is not None and len(error.trajectory.time) > 10, "no run")
        return f"the run so far ({len(error.trajectory.time)} samples), with the error"
    raise AssertionError("as if nothing had been")


def second_run(out: Path) -> str:
    with Run("run", "space-robot", *LONG, "--out", out) as run:
        under_way(run, out)
        for _ in range(2):
            with Run("run", "space-robot", *SHORT, "--out", out) as other:
                check(other.end() == 2, other.error)
                check("another run is writing there" in other.line(), other.error)
        run.send(signal.SIGINT)
        check(run.end() == 1, run.error)
    return kept(out, rnc.Outcome.INTERRUPTED) + " of the first; the others are refused"


def browser_closed(out: Path) -> str:
    show = ["--show", "--no-browser", "--speed", "0"]
    with Run("run", "space-robot", *LONG, *show, "--out", out) as run:
        assert run.process.stderr is not None
        url = run.process.stderr.readline().split()[-1]
        port = int(url.split(":")[2].split("/")[0])
        host = f"localhost:{port}"
        request = f"GET / HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nUpgrade: websocket\r\n"
        request += "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
        with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as browser:
            browser.sendall((request + "\r\n").encode())
            check(browser.recv(4096).startswith(b"HTTP/1.1 101"), "not let in")
            under_way(run, out)
        begun = computed(run.process.pid)
        wait(lambda: computed(run.process.pid) > begun + 0.5)  # it goes on
        run.send(signal.SIGINT)
        check(run.end() == 1, run.error)
    return kept(out, rnc.Outcome.INTERRUPTED) + "; it went on without the browser"


KINDS: dict[str, Callable[[Path], str]] = {
    "Ctrl-C": lambda out: asked_to_end(out, signal.SIGINT),
    "Ctrl-C three times": lambda out: asked_to_end(out, *[signal.SIGINT] * 3),
    "Ctrl-C while modules are imported": ctrl_c_while_importing,
    "Ctrl-C while results are written": ctrl_c_while_writing,
    "Ctrl-C while pictures are drawn": ctrl_c_while_drawing,
    "SIGTERM": lambda out: asked_to_end(out, signal.SIGTERM),
    "terminal closed (SIGHUP)": lambda out: asked_to_end(out, signal.SIGHUP),
    "SIGKILL of a run": run_killed,
    "SIGKILL of a sweep": lambda out: swept(out, lambda run, workers: run.process.pid, signal.SIGKILL),
    "SIGTERM of a sweep": lambda out: swept(out, lambda run, workers: run.process.pid, signal.SIGTERM),
    "SIGKILL of a worker": lambda out: swept(
        out, lambda run, workers: max(workers, key=computed), signal.SIGKILL, survives=True
    ),
    "full disk": full_disk,
    "folder removed": folder_removed,
    "controller raises": lambda out: spoiled(
        out, "raise ZeroDivisionError('no gain')", "the controller raised ZeroDivisionError"
    ),
    "observer raises": observer_raises,
    "input of a wrong shape": lambda out: spoiled(
        out, "import numpy; return Command(T=numpy.ones((7, 1)))", "T of a command has shape (7, 1)"
    ),
    "second and third run in the folder": second_run,
    "browser closed in a live view": browser_closed,
}


def interrupt(kind: str) -> tuple[str, bool]:
    """End something in one way: what is kept, and whether that is what is promised."""
    with tempfile.TemporaryDirectory() as name:
        try:
            return KINDS[kind](Path(name) / "out"), True
        except Exception:
            return traceback.format_exc(limit=-3), False


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", choices=list(KINDS), action="append", help="all by default")
    options = parser.parse_args()
    wrong = 0
    for kind in options.kind or KINDS:
        words, good = interrupt(kind)
        print(f"{kind:36} {'kept: ' if good else 'LOST: '}{words}", flush=True)
        wrong += not good
    print(f"{len(options.kind or KINDS)} kinds, {wrong} faults")
    raise SystemExit(bool(wrong))


if __name__ == "__main__":
    main()
