"""Live view of a driven run, in any viewer that can show its controls."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Protocol

from rnc_pin.driving.drive_log import CommandQueue
from rnc_pin.driving.drive_plan import DrivePlan
from rnc_pin.driving.drive_status import DriveStatus
from rnc_pin.scenario.saved_run import view_of
from rnc_pin.simulation import RunInfo, Sample
from rnc_pin.visualization.browser.access import LOOPBACK
from rnc_pin.visualization.drawn_model import DrawnModel
from rnc_pin.visualization.live import LiveView
from rnc_pin.visualization.view import View
from rnc_pin.visualization.viewers import Viewer


class DrivenViewer(Viewer, Protocol):
    """Viewer with the controls of a driven run.

    Attributes:
        status: latest status; the loop sets it, and the thread that draws reads it.
    """

    status: DriveStatus | None


class DrivenViewerKind(Protocol):
    """Class of a viewer with the controls of a driven run."""

    def __call__(
        self,
        prepared: DrivePlan,
        queue: CommandQueue,
        drawn: DrawnModel,
        view: View,
        info: RunInfo,
        host: str,
        title: str,
    ) -> DrivenViewer: ...


class LiveDrive:
    """Page of a driven run, as a watcher of ``drive``. A subclass names its viewer.

    Args:
        prepared: the run.
        queue: queue for the commands of the page.
        title: title of the page.
        open_browser: True to open the page immediately.
    """

    kind: ClassVar[DrivenViewerKind]

    def __init__(self, prepared: DrivePlan, queue: CommandQueue, title: str, open_browser: bool) -> None:
        experiment = prepared.plan.experiment
        reduced = experiment.reduced
        drawn = DrawnModel(reduced.robot, reduced, experiment.obstacles)
        info = RunInfo(drawn.outputs, tuple(reduced.vertical.names), provenance=experiment.provenance)
        view = view_of(experiment.scenario)
        view = replace(view, hide=[*view.hide, "reference", "constraint forces"])
        self._viewer: DrivenViewer

        def viewer(drawn: DrawnModel, view: View, info: RunInfo, host: str, title: str) -> DrivenViewer:
            self._viewer = type(self).kind(prepared, queue, drawn, view, info, host, title)
            return self._viewer

        self.live = LiveView(drawn, view, info, 0.0, open_browser, LOOPBACK, title, viewer)
        self.url = self.live.url

    def wait_for_browser(self, timeout: float) -> bool:
        """Wait up to ``timeout`` [s] for a browser. Return True if one is connected."""
        return self.live.wait_for_browser(timeout)

    def show(self, sample: Sample, status: DriveStatus | None) -> None:
        """Show a sample and, if there is one, a status."""
        if status is not None:
            self._viewer.status = status
        self.live(sample)

    @property
    def problem(self) -> Exception | None:
        """Error that stopped the page, but not the run."""
        return self.live.problem

    def close(self) -> None:
        """Draw the last sample, and stop serving."""
        self.live.close()
