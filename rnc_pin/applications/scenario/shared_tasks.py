"""Independent tasks on several processors: this process and forked copies of it take them one by one.

A forked copy has all objects of this process, also those that cannot be pickled. Only results are sent back. A task
computes the same bits in every process, so the number of processes changes nothing but the time.
"""

from __future__ import annotations

import ctypes
import os
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe, wait
from typing import Generic, Self, TypeVar

from rnc_pin.interruption import interruptible

P = TypeVar("P")
T = TypeVar("T")
Report = Callable[[int, float], None]
"""Callback that takes the number of a task and its progress."""

_PARENT_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2)
_TOKEN = 2  # bytes of a number in the queue


def processor_count() -> int:
    """Number of processors that this process may use; 1 where processes cannot be forked safely."""
    if not sys.platform.startswith("linux") or threading.current_thread() is not threading.main_thread():
        return 1
    return len(os.sched_getaffinity(0))


class SharedTasks(Generic[P, T]):
    """Numbered tasks, as a context; leaving it ends all helpers.

    If a helper dies, for example because memory runs out, this process does its task.

    Args:
        run: function of the number of a task, the common input of all tasks, and a progress callback.
        numbers: numbers of the tasks in the order of their start.
        helpers: number of forked copies; they start at once and wait for ``begin``.
        prepare: function that a helper calls while it waits, such as slow imports.
        ended_early: True for a result of an interrupted task: no other task starts after it. With it, Ctrl-C ends
            tasks under way early and keeps their results. Without it, Ctrl-C raises KeyboardInterrupt.

    Attributes:
        found: results so far by number of the task.
    """

    def __init__(
        self,
        run: Callable[[int, P, Report], T],
        numbers: Sequence[int],
        helpers: int,
        prepare: Callable[[], object] | None = None,
        ended_early: Callable[[T], bool] | None = None,
    ) -> None:
        self.found: dict[int, T] = {}
        self._run, self._numbers, self._ended_early = run, list(numbers), ended_early
        self._stopped = False
        self._parent = os.getpid()
        self._input = os.memfd_create("tasks") if helpers > 0 else -1
        self._queue, self._queue_end = os.pipe()
        self._helpers: dict[Connection, int] = {}
        for _ in range(min(helpers, len(numbers))):
            receiving, sending = Pipe(duplex=False)
            process = _fork()
            if not process:
                self._help(sending, prepare)
            sending.close()
            self._helpers[receiving] = process

    def begin(self, common: P) -> None:
        """Let all processes start.

        Args:
            common: input of all tasks. Helpers get a pickled copy.
        """
        self._common = common
        if self._helpers:
            try:
                with open(os.dup(self._input), "wb") as file:
                    pickle.dump(common, file, pickle.HIGHEST_PROTOCOL)
            except Exception:  # it cannot be pickled: all tasks are done here
                self._end_helpers()
        os.write(self._queue_end, b"".join(number.to_bytes(_TOKEN) for number in self._numbers))
        self._close_queue_end()

    def results(self, report: Report) -> dict[int, T]:
        """Do tasks here until there are none left, and return all results in order of their numbers.

        Args:
            report: called with the progress of each task, in order, also of those of helpers.

        Raises:
            Exception: the error of a task.
        """
        with_helpers = self.with_helpers(report)
        while (number := self._next()) is not None:
            self._keep(number, self._run(number, self._common, with_helpers))
            self.collect(report)
        self.collect(report, block=True)
        for number in self._numbers:
            if number not in self.found and not self._stopped:  # its helper died
                self._keep(number, self._run(number, self._common, report))
        return dict(sorted(self.found.items()))

    def with_helpers(self, report: Report) -> Report:
        """The same progress callback for a task in this process; each call shows first what helpers have sent."""

        def both(number: int, done: float) -> None:
            self.collect(report)
            report(number, done)

        return both

    def collect(self, report: Report, block: bool = False) -> None:
        """Receive what helpers have sent, or with ``block`` what they send until they end."""
        while self._helpers:
            try:
                if block:
                    with interruptible():
                        ready = wait([*self._helpers])
                else:
                    ready = wait([*self._helpers], 0)
            except KeyboardInterrupt:
                if self._ended_early is None:
                    raise
                self._stop()
                continue
            if not ready:
                return
            for channel in ready:
                assert isinstance(channel, Connection)
                self._receive(channel, report)

    def _receive(self, channel: Connection, report: Report) -> None:
        try:
            number, done, warned, result, error = channel.recv()
        except (EOFError, OSError, pickle.UnpicklingError):
            _end(self._helpers.pop(channel))
            channel.close()
            return
        for each in warned:
            warnings.warn_explicit(*each)
        if error is not None:
            raise error
        if done is not None:
            report(number, done)
        else:
            self._keep(number, result)

    def _keep(self, number: int, result: T) -> None:
        self.found[number] = result
        if self._ended_early is not None and self._ended_early(result):
            self._stop()

    def _next(self) -> int | None:
        token = os.read(self._queue, _TOKEN)
        return int.from_bytes(token) if token else None

    def _stop(self) -> None:
        """Take all tasks off the queue, and interrupt those of helpers."""
        if self._stopped:
            return
        self._stopped = True
        while self._next() is not None:
            pass
        ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        for process in self._helpers.values():
            os.kill(process, signal.SIGTERM if ignored else signal.SIGINT)

    # ------------------------------------------------------------------ in a helper

    def _help(self, channel: Connection, prepare: Callable[[], object] | None) -> None:
        """Do tasks until there are none left. Never returns."""
        code = 1
        try:
            ctypes.CDLL(None).prctl(_PARENT_DEATH_SIGNAL, signal.SIGKILL)
            if os.getppid() == self._parent:
                os.close(self._queue_end)
                for other in self._helpers:
                    other.close()
                if prepare is not None:
                    prepare()
                self._serve(channel)
                code = 0
        finally:
            os._exit(code)  # without the cleanup of the copied objects, which belong to the parent

    def _serve(self, channel: Connection) -> None:
        def report(number: int, done: float) -> None:
            channel.send((number, done, [], None, None))

        common: tuple[P] | None = None
        while (number := self._next()) is not None:
            if common is None:
                common = (pickle.loads(os.pread(self._input, os.fstat(self._input).st_size, 0)),)
            result, error = None, None
            with warnings.catch_warnings(record=True) as caught:
                try:
                    result = self._run(number, common[0], report)
                except Exception as raised:
                    error = raised
            warned = [(each.message, each.category, each.filename, each.lineno) for each in caught]
            channel.send((number, None, warned, result, error))
            if result is not None and self._ended_early is not None and self._ended_early(result):
                while self._next() is not None:
                    pass

    # ------------------------------------------------------------------ the end

    def _close_queue_end(self) -> None:
        if self._queue_end >= 0:
            os.close(self._queue_end)
            self._queue_end = -1

    def _end_helpers(self) -> None:
        while self._helpers:
            channel, process = self._helpers.popitem()
            _end(process)
            channel.close()

    def close(self) -> None:
        """End all helpers, and wait until they are gone."""
        self._close_queue_end()
        self._end_helpers()
        if self._queue >= 0:
            os.close(self._queue)
            self._queue = -1
            if self._input >= 0:
                os.close(self._input)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _fork() -> int:
    with warnings.catch_warnings():
        # Python 3.12 warns if there are threads: those of OpenBLAS, which expects forks, and of the progress bar, which
        # a helper does not use.
        warnings.simplefilter("ignore", DeprecationWarning)
        return os.fork()


def _end(process: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(process, signal.SIGKILL)
    with suppress(ChildProcessError):
        os.waitpid(process, 0)
