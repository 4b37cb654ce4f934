"""Page of a driven run in the viewer that ``PINOCCHIO_VIEWER`` names."""

from __future__ import annotations

from typing import Protocol

from rnc_pin.driving.drive_log import CommandQueue
from rnc_pin.driving.drive_plan import DrivePlan
from rnc_pin.driving.drive_run import DriveWatcher
from rnc_pin.driving.meshcat_page import MeshcatDrivePage
from rnc_pin.visualization.viewers import MeshcatViewer, selected_viewer


class DrivePage(DriveWatcher, Protocol):
    """Page that a browser can open."""

    url: str

    @property
    def problem(self) -> Exception | None: ...
    def wait_for_browser(self, timeout: float) -> bool: ...
    def close(self) -> None: ...


def drive_page(prepared: DrivePlan, queue: CommandQueue, title: str, open_browser: bool) -> DrivePage:
    """Serve a page on loopback.

    Raises:
        ConfigurationError: ``PINOCCHIO_VIEWER`` names no viewer, or one that is not installed.
    """
    if selected_viewer() is MeshcatViewer:
        return MeshcatDrivePage(prepared, queue, title, open_browser)
    from rnc_pin.driving.viser_page import ViserDrivePage

    return ViserDrivePage(prepared, queue, title, open_browser)
