"""Driven runs for tests: prepared, with scripted commands."""

import threading
from contextlib import contextmanager

import numpy as np

from bodies import frame_placement
from patience import PATIENCE
from rnc_pin.applications.drive.commands import LoggedCommand, parse_command
from rnc_pin.applications.drive.preparation import prepare_drive, read_source
from rnc_pin.applications.drive.run import RealTimeClock, drive


def prepared(source, commands=(), frames=(), **options):
    """A driven run of a scenario or a robot; commands are pairs of a sample and a message."""
    given = {key.replace("__", "."): value for key, value in options.items()}
    drive = prepare_drive(read_source(source, given), given, frames)
    script(drive, commands)
    return drive


class Watcher:
    """Page of a driven run that keeps the statuses that it is shown."""

    def __init__(self):
        self.statuses = []

    def __call__(self, sample, status):
        if status is not None:
            self.statuses.append(status)

    @property
    def active(self):
        """Names of all limits that were active."""
        return {name for each in self.statuses for name in each.report.active}


def script(drive, commands):
    """Put commands into the log of a run."""
    drive.log.extend(LoggedCommand(at, parse_command(message, drive.controls)) for at, message in commands)


@contextmanager
def in_real_time(run, queue, page):
    """Drive beside this thread until the user ends the run; the list has its result at the end of the context."""
    results = []
    thread = threading.Thread(target=lambda: results.append(drive(run, queue, 20_000, RealTimeClock(), page.show)))
    thread.start()
    try:
        yield results
        thread.join(timeout=PATIENCE)
        assert not thread.is_alive()
    finally:
        queue.put({"kind": "end"})
        thread.join(timeout=PATIENCE)
        page.close()


def reduced_of(drive):
    return drive.scenario.experiment.reduced


def point_of(drive, q, frame):
    """Position of a frame (3,) by Pinocchio itself."""
    return frame_placement(reduced_of(drive).robot, q, frame).translation


def pose_of(drive, q):
    """Place of the base (2,) and its heading, by Pinocchio itself."""
    placed = frame_placement(reduced_of(drive).robot, q, drive.controls.base.frame)
    return np.append(placed.translation[:2], np.arctan2(placed.rotation[1, 0], placed.rotation[0, 0]))
