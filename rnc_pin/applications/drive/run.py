"""Loop of a driven run: commands, a sample, a step of the plant, the wait for the clock, and the status of its page.

Simulated time follows real time, and falls behind visibly if samples take too long.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from itertools import count
from typing import NamedTuple

import numpy as np

from rnc_pin.applications.drive import commands
from rnc_pin.applications.drive.commands import DriveCommand, DriveGoals
from rnc_pin.applications.drive.controller import drive_state_of
from rnc_pin.applications.drive.controls import DriveControls
from rnc_pin.applications.drive.preparation import PreparedDrive
from rnc_pin.applications.scenario.execution import Result
from rnc_pin.applications.scenario.simulated_run import judged_summary
from rnc_pin.errors import RncError, printable
from rnc_pin.motion.whole_body import LimitReport
from rnc_pin.simulation import RunArguments, Sample, Trajectory
from rnc_pin.simulation.sampled_run import Progress, SampledRun, complete_run

_WAITING = 200  # targets that one sample can set


class CommandQueue:
    """Queue from the threads of a page to the loop. A later command replaces an earlier one with the same target.

    So neither a fast nor a hostile page can fill the memory or delay a sample.

    Args:
        controls: what a user may set.

    Attributes:
        refused: last message that was refused, with the reason; empty if there is none.
    """

    def __init__(self, controls: DriveControls) -> None:
        self._controls, self._lock = controls, threading.Lock()
        self._waiting: dict[tuple[str, str], DriveCommand] = {}
        self.refused = ""

    def put(self, message: object) -> bool:
        """Check a message and put its command into the queue. Return False if it is refused."""
        try:
            command = commands.parse_command(message, self._controls)
        except RncError as error:
            self.refused = printable(str(error))
            return False
        target = commands.command_target(command)
        with self._lock:
            if target not in self._waiting and len(self._waiting) >= _WAITING:
                self.refused = "too many commands in one sample"
                return False
            # Removed first, so that the later command also comes later in the order.
            self._waiting.pop(target, None)
            self._waiting[target] = command
        self.refused = ""
        return True

    def take(self) -> list[DriveCommand]:
        """Return the commands that wait, in order, and empty the queue."""
        with self._lock:
            found = list(self._waiting.values())
            self._waiting.clear()
        return found


class DriveStatus(NamedTuple):
    """Status at one sample."""

    factor: float
    """Simulated time over real time."""
    goals: DriveGoals
    report: LimitReport
    distances: Mapping[str, float]
    """Distances of goals that are not reached [m]."""
    refused: str
    """Last command that was refused; empty if there is none."""
    places: Mapping[str, np.ndarray]
    """Positions of the frames of the controls and of the base (3,) [m]."""

    @property
    def limits(self) -> list[str]:
        """Lines that name limits: those that gave way first. One line counts accelerations: every start needs them."""
        exceeded = {name: amount for name, amount in self.report.exceeded.items() if not _soft(name)}
        lines = [f"{name}: exceeded by {amount:.2g}" for name, amount in exceeded.items()]
        lines += [name for name in self.report.active if name not in exceeded and not _soft(name)]
        # Each start and stop of a motion is at its acceleration: names would only flicker.
        soft = sum(_soft(name) for name in {*self.report.active, *self.report.exceeded})
        return lines + ([f"acceleration of {soft} motion{'s' * (soft > 1)}"] if soft else [])

    @property
    def messages(self) -> list[str]:
        """Lines about goals and commands."""
        away = [f"{frame}: {distance:.2f} m from its goal" for frame, distance in self.distances.items()]
        return [*away, *([f"refused: {self.refused}"] if self.refused else [])]


def goal_distances(controls: DriveControls, goals: DriveGoals, points: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Distances [m] of the goals that are not reached, along the axes in which each frame can move.

    Args:
        controls: what a user may set.
        goals: present goals.
        points: positions of the frames and of the base (3,) [m].
    """
    # Along the axes that the frame has: a planar arm cannot reach the height of a click.
    away = {name: (points[name] - goal.position)[list(controls.frames[name])] for name, goal in goals.frames.items()}
    if controls.base is not None and goals.base_goal is not None:
        away[controls.base.frame] = points[controls.base.frame][:2] - goals.base_goal
    near = 0.01  # distance from a goal that counts as reached [m]
    distances = {name: float(np.linalg.norm(each)) for name, each in away.items()}
    return {name: distance for name, distance in distances.items() if distance > near}


def _soft(name: str) -> bool:
    return name.endswith(" acceleration")


_STATUS = 0.1  # period of the status [s]


class RealTimeClock:
    """Clock that waits for the real time of a sample.

    A sample that is late is never skipped. The clock does not catch up either: lost time stays lost, so that the robot
    never moves faster than in reality.

    Args:
        now: monotonic clock [s].
        sleep: function that waits [s].
    """

    def __init__(
        self, now: Callable[[], float] = time.monotonic, sleep: Callable[[float], object] = time.sleep
    ) -> None:
        self._now, self._sleep = now, sleep
        self._start: float | None = None
        self._window: deque[tuple[float, float]] = deque()

    def wait(self, t: float) -> None:
        """Wait until simulated time t [s] is due."""
        now = self._now()
        if self._start is None:
            self._start = now - t
        early = self._start + t - now
        if early > 0:
            self._sleep(early)
            # Not read again: a sleep that takes longer makes the next sample late, and is lost there.
            now += early
        else:
            self._start -= early  # lost time stays lost
        self._window.append((now, t))
        window = 1.0  # [s] of real time over which the factor is measured
        while len(self._window) > 2 and self._window[1][0] < now - window:
            self._window.popleft()

    @property
    def factor(self) -> float:
        """Simulated time over real time in the last second; 1 at the start."""
        (first, begin), (last, end) = self._window[0], self._window[-1]
        return (end - begin) / (last - first) if last > first else 1.0


def drive(
    prepared: PreparedDrive,
    queue: CommandQueue | None = None,
    samples: int | None = None,
    clock: RealTimeClock | None = None,
    watcher: Callable[[Sample, DriveStatus | None], object] | None = None,
) -> Result:
    """Run until a command, Ctrl-C or a number of samples ends it.

    Args:
        prepared: the run; its log is extended by the commands of the queue.
        queue: commands of a user; None for those of the log alone.
        samples: number of samples; None for no end.
        clock: clock to follow; None does not wait.
        watcher: function that shows each sample, and a status ten times per second.

    Returns:
        The result; a run that failed keeps what it reached, with ``error`` set.
    """
    started = time.perf_counter()
    experiment, settings = prepared.scenario.experiment, prepared.scenario.experiment.simulation
    given = experiment.reduced, experiment.controller, experiment.q0, settings.dt, samples or 0
    arguments = RunArguments(*given, plant=experiment.plant, options=prepared.scenario.options())
    error: RncError | None = None
    with np.errstate(over="ignore", invalid="ignore"):  # values of diverged runs overflow
        run = SampledRun(arguments)

        def advance(progress: Progress) -> str | None:
            due = 0.0
            for sample in count():
                if clock is not None:
                    clock.wait(run.time)
                new = [] if queue is None else queue.take()
                prepared.log.extend(commands.LoggedCommand(sample, command) for command in new)
                found = run.sample(progress)
                if watcher is not None:
                    # Not in each sample: a status costs kinematics, and nobody reads a hundred in a second.
                    is_due = found.time >= due
                    due = found.time + _STATUS if is_due else due
                    watcher(found, _status(prepared, run, found, queue, clock) if is_due else None)
                # Before the plant moves: the record ends at the sample of the command.
                if any(isinstance(each, commands.EndRun) for each in new) or sample + 1 == samples:
                    break
                run.advance()
            return run.failure

        try:
            trajectory = complete_run(advance, run.finish)
        except RncError as failure:
            if not isinstance(failure.trajectory, Trajectory):
                raise
            # What the run reached is kept, as of any run that fails.
            trajectory, error = failure.trajectory, failure
        wall_time = time.perf_counter() - started
        trajectory, summary, limits = judged_summary(experiment, trajectory, wall_time=wall_time, goals=False)
    return Result(trajectory, summary, error, {}, limits)


def _status(
    prepared: PreparedDrive, run: SampledRun, sample: Sample, queue: CommandQueue | None, clock: RealTimeClock | None
) -> DriveStatus:
    """Status of a run at its last sample."""
    controls, reduced = prepared.controls, prepared.scenario.experiment.reduced
    state = drive_state_of(run.loop.state.controller)
    position = reduced.at(sample.measurement.q).position
    names = [*controls.frames, *(() if controls.base is None else (controls.base.frame,))]
    places = {name: np.array(position.placement(reduced.robot.frame_id(name)).translation) for name in names}
    factor, refused = 1.0 if clock is None else clock.factor, "" if queue is None else queue.refused
    report, distances = prepared.controller.program.report(state.program), goal_distances(controls, state.goals, places)
    return DriveStatus(factor, state.goals, report, distances, refused, places)
