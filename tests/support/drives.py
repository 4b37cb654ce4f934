"""Driven runs for tests: prepared, with scripted commands."""

import threading
from contextlib import contextmanager

from patience import PATIENCE
from rnc_pin.applications.drive.commands import parse_command
from rnc_pin.applications.drive.log import LoggedCommand
from rnc_pin.applications.drive.preparation import prepare_drive, read_source
from rnc_pin.applications.drive.real_time import RealTimeClock
from rnc_pin.applications.drive.run import drive


def prepared(source, commands=(), frames=(), **options):
    """A driven run of a scenario or a robot; commands are pairs of a sample and a message."""
    given = {key.replace("__", "."): value for key, value in options.items()}
    scenario = read_source(source, given)
    drive = prepare_drive(scenario, given, frames)
    script(drive, commands)
    return drive


def script(drive, commands):
    """Put commands into the log of a run."""
    drive.log.commands += [LoggedCommand(at, parse_command(message, drive.controls)) for at, message in commands]


@contextmanager
def in_real_time(run, queue, page):
    """Drive beside this thread until the user ends the run; the list has its result at the end of the context."""
    results = []
    thread = threading.Thread(target=lambda: results.append(drive(run, queue, 20_000, RealTimeClock(), page)))
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
    import pinocchio as pin

    robot = reduced_of(drive).robot
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    return data.oMf[robot.frame_id(frame)].translation.copy()
