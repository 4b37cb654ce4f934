"""Picture of the page of ``rnc-pin drive``: ``python docs/make_drive_picture.py``. It needs Chromium and Playwright.

TIAGo reaches for a point inside a ball. The picture is taken when the ball limits the arm.
"""

from __future__ import annotations

import threading
from pathlib import Path

from rnc_pin.applications.drive.page import DrivePage
from rnc_pin.applications.drive.preparation import prepare_drive, read_source
from rnc_pin.applications.drive.run import CommandQueue, RealTimeClock, drive
from rnc_pin.visualization.recording import browser

IMAGE = Path(__file__).parent / "images" / "drive.png"
SIZE = {"width": 1280, "height": 760}
PATIENCE = 120_000  # [ms]
OPTIONS = {
    "title": "TIAGo: the ball does not let the hand reach its goal",
    "obstacles": [{"sphere": {"name": "ball", "radius": 0.13, "position": [1.0, 0.5, 0.85]}}],
    "view.camera": [3.0, -1.9, 1.9],
    "view.target": [0.55, 0.15, 0.55],
}
COMMANDS = [
    {"kind": "base_goal", "x": 0.5, "y": -0.25},
    {"kind": "frame_goal", "frame": "arm_tool_link", "position": [1.0, 0.5, 0.85]},
]


def main() -> None:
    """Drive TIAGo by a script and take the picture."""
    prepared = prepare_drive(read_source("tiago", OPTIONS), OPTIONS)
    queue = CommandQueue(prepared.controls)
    page = DrivePage(prepared, queue, OPTIONS["title"], open_browser=False)
    loop = threading.Thread(target=drive, args=(prepared, queue, None, RealTimeClock(), page))
    loop.start()
    try:
        with browser() as launched:
            shown = launched.new_page(viewport=SIZE)
            shown.goto(page.live.url)
            shown.wait_for_selector("#drive button.stop", timeout=PATIENCE)
            shown.wait_for_function("document.querySelectorAll('#overlay tr').length > 1", timeout=PATIENCE)
            for command in COMMANDS:
                queue.put(command)
            near = "[...document.querySelectorAll('#limits li')].some(each => each.textContent.includes('/ ball'))"
            shown.wait_for_function(near, timeout=PATIENCE)
            shown.wait_for_function("document.querySelector('#messages li')", timeout=PATIENCE)
            shown.wait_for_timeout(500)
            shown.evaluate("document.querySelector('.dg').style.display = 'none'")
            shown.screenshot(path=str(IMAGE), timeout=PATIENCE)
    finally:
        queue.put({"kind": "end"})
        loop.join()
        page.live.close()
    print(f"wrote {IMAGE}")


if __name__ == "__main__":
    main()
