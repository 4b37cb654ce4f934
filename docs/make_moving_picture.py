"""Write the moving picture of the README from a recording: ``python docs/make_moving_picture.py``.

It needs Chromium and Playwright (``pip install '.[test]'``). WebP takes a quarter of the size of a GIF.
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path

import numpy as np
from PIL import Image

from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.visualization.recording import Recording, take_pictures

IMAGE = Path(__file__).parent / "images" / "moving.webp"
SCENARIO = "tiago-doorway"
CAPTURED, SHOWN = (1280, 768), (800, 480)  # [pixels]
FRAMES, SECONDS = 72, 6.0
LARGEST = 1_500_000  # [bytes]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario", nargs="?", default=SCENARIO)
    parser.add_argument("--out", type=Path, default=IMAGE)
    arguments = parser.parse_args()
    prepared = Scenario.load(arguments.scenario).build()
    run, scenario = execute(prepared).trajectory, prepared.experiment.scenario
    recording = Recording(prepared.experiment.drawn_model, run, scenario.view, scenario.title or prepared.name)
    times = np.linspace(0.0, run.time[-1], FRAMES)
    frames = [
        Image.open(io.BytesIO(shot)).convert("RGB").resize(SHOWN, Image.Resampling.LANCZOS)
        for shot in take_pictures(recording, times, CAPTURED)
    ]
    shown = round(1000 * SECONDS / FRAMES)
    durations = [shown] * (FRAMES - 1) + [1000]
    frames[0].save(
        arguments.out, save_all=True, append_images=frames[1:], duration=durations, loop=0, quality=60, method=6
    )
    size = arguments.out.stat().st_size
    if size > LARGEST:
        raise SystemExit(f"{arguments.out}: {size} bytes; expected at most {LARGEST}")
    print(f"{arguments.out}: {size} bytes")


if __name__ == "__main__":
    main()
