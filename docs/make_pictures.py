"""Make the pictures of the documentation again: run scenarios, copy their plots, photograph their animations.

Needs Chromium and Playwright (``pip install '.[test]'``). Run ``python docs/make_pictures.py``, for all of
them, or name scenarios after it.
"""

import shutil
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

from rnc_pin.scenario.output import OutputFolder
from rnc_pin.scenario.run import execute, plan, write

IMAGES = Path(__file__).parent / "images"
# scenario: plots to keep, and the time at which its animation is photographed [s]
PICTURES = {
    "space-robot": (["figure_4a.png", "figure_4b.png"], 4.0),
    "space-robot-fixed-platform": (["figure_5a.png", "figure_5b.png"], 5.0),
    "space-robot-uncertain": (["figure_6a.png", "figure_6b.png"], 9.0),
    "mobile-manipulator": (["hand.png", "distance.png"], 4.0),
    "mobile-manipulator-two-phase": (["figure_7a.png", "figure_7b.png"], 12.0),
    "wheels-uncertain": (["wheels_path.png", "wheels_estimates.png", "wheels_prediction.png"], 22.0),
    "fire-truck": (["figure_8a.png", "figure_8b.png"], 11.0),
    "tiago": (["tiago_hand.png"], 9.0),
    "tiago-two-phase": (["tiago_later.png"], 12.0),
    "free-flying-arm": (["free_flyer_attitude.png"], 12.0),
    "unicycle": (["unicycle_point.png"], 18.0),
    "car": (["car_path.png"], 20.0),
    "tractor-trailers": (["trailers_headings.png"], 11.0),
    "snakeboard": (["snakeboard_way.png"], 10.0),
}
CHROMIUM = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def main() -> None:
    IMAGES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=CHROMIUM)
        for name in sys.argv[1:] or PICTURES:
            plots, moment = PICTURES[name]
            prepared = plan(name)
            folder = OutputFolder(Path(scratch) / name)
            write(prepared, execute(prepared), folder)
            for plot in plots:
                shutil.copy(folder.path / plot, IMAGES / plot)
            page = browser.new_page(viewport={"width": 1000, "height": 600})
            page.goto((folder.path / "animation.html").as_uri())
            page.wait_for_timeout(moment * 1000)
            page.screenshot(path=IMAGES / f"{name.replace('-', '_')}.png")
            page.close()
        browser.close()


if __name__ == "__main__":
    main()
