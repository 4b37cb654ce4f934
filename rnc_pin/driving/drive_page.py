"""Page of a driven run in the viewer that ``PINOCCHIO_VIEWER`` names."""

from __future__ import annotations

from typing import Protocol

from rnc_pin.driving.drive_log import CommandQueue
from rnc_pin.driving.drive_plan import DrivePlan
from rnc_pin.driving.drive_run import DriveWatcher
from rnc_pin.driving.meshcat_page import MeshcatDrivePage


class DrivePage(DriveWatcher, Protocol):
    """Page that a browser can open."""

    url: str

    @property
    def problem(self) -> Exception | None: ...
    def wait_for_browser(self, timeout: float) -> bool: ...
    def close(self) -> None: ...


def drive_page(prepared: DrivePlan, queue: CommandQueue, title: str, open_browser: bool) -> DrivePage:
    """Serve a page on loopback."""
    return MeshcatDrivePage(prepared, queue, title, open_browser)
