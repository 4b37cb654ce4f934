"""Make pictures and recordings of the documentation; look at them.

    python docs/make_pictures.py gallery [SCENARIO...]    pictures of the gallery, and docs/data/gallery.json
    python docs/make_pictures.py moving                   the moving picture of the README
    python docs/make_pictures.py drive                    the page of ``rnc-pin drive``
    python docs/make_pictures.py scenes [SCENARIO...]     recordings in docs/_scenes, which the site embeds

It needs Chromium and Playwright (``pip install '.[test]'``), but for the recordings. ``all`` names all scenarios.
"""

from __future__ import annotations

import argparse
import io
import json
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin
from PIL import Image

from rnc_pin.applications.drive.page import DrivePage
from rnc_pin.applications.drive.preparation import prepare_drive, read_source
from rnc_pin.applications.drive.run import CommandQueue, RealTimeClock, drive
from rnc_pin.applications.scenario.execution import Result, draw_pictures, execute, write, write_animation
from rnc_pin.applications.scenario.files import built_in_names
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.visualization.recording import Recording, browser, take_pictures

DOCS = Path(__file__).parent
IMAGES = DOCS / "images"
FACTS = DOCS / "data" / "gallery.json"
SCENES = DOCS / "_scenes"
SHORT = ("space-robot", "tiago-doorway", "parallel-parking", "free-flying-arm", "docking", "rattleback")
"""Scenarios that take seconds, one of each kind of robot."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("scenarios", nargs="*", help="built-in names, or all")
    arguments = parser.parse_args()
    KINDS[arguments.kind](built_in_names() if arguments.scenarios == ["all"] else arguments.scenarios)


# ---------------------------------------------------------------------- gallery


def gallery(names: Iterable[str]) -> None:
    """Run scenarios, plot them, photograph their animations."""
    facts = json.loads(FACTS.read_text())
    for name in names or built_in_names():
        prepared = Scenario.load(name).build()
        facts[name] = picture(prepared, execute(prepared))
        print(f"{name}: {facts[name]}", flush=True)
    facts = {name: facts[name] for name in built_in_names() if name in facts}
    FACTS.write_text(json.dumps(facts, indent=1) + "\n")


def picture(prepared: Scenario, result: Result) -> dict:
    """Write what shows one scenario, and say what the page needs to know."""
    name, scenario = prepared.name, prepared.experiment.scenario
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write(prepared, result, folder)
        draw_pictures(prepared, result, folder)
        plots = [f"{plot}.png" for plot in scenario.plots]
        for plot in plots:
            shrink(Image.open(folder / plot), IMAGES / plot, colors=128)
        if (folder / "top_view.png").is_file():
            plots.append(f"{name.replace('-', '_')}_top_view.png")
            shrink(Image.open(folder / "top_view.png"), IMAGES / plots[-1], colors=128)
        animation_size = (folder / "animation.html").stat().st_size
    run, title = result.trajectory, scenario.title or name
    recording = Recording(prepared.experiment.drawn_model, run, scenario.view, title)
    for shot in take_pictures(recording, [telling_moment(prepared, result)], (1000, 600)):
        shrink(Image.open(io.BytesIO(shot)), IMAGES / f"{name.replace('-', '_')}.png")
    errors = {key: float(f"{value:.2g}") for key, value in result.summary["final_error"].items()}
    return {
        "title": title,
        "outcome": str(run.outcome),
        "size": round(animation_size / 1e6, 1),
        "plots": plots,
        "error": errors,
    }


def telling_moment(prepared: Scenario, result: Result) -> float:
    """When the robot has come half of its way [s]."""
    model, q = prepared.experiment.reduced.robot.model, result.trajectory.q
    steps = [
        np.linalg.norm(pin.difference(model, one, other)) for one, other in zip(q[:-10:10], q[10::10], strict=False)
    ]
    way = np.cumsum(steps)
    return float(result.trajectory.time[10 * int(np.searchsorted(way, 0.5 * way[-1]))])


def shrink(image: Image.Image, path: Path, colors: int | None = None) -> None:
    """Write a PNG of at most 1000 pixels across; a plot needs no more than 128 colours."""
    image = image.convert("RGB")
    image.thumbnail((1000, 1000), Image.Resampling.LANCZOS)
    if colors is not None:
        image = image.quantize(colors, dither=Image.Dither.NONE)
    image.save(path, optimize=True)


# ---------------------------------------------------------------------- moving picture


def moving(names: Iterable[str]) -> None:
    """Write the moving picture of the README. WebP takes a quarter of the size of a GIF."""
    frames, seconds, shown = 72, 6.0, (800, 480)
    prepared = Scenario.load("tiago-doorway").build()
    run, scenario = execute(prepared).trajectory, prepared.experiment.scenario
    recording = Recording(prepared.experiment.drawn_model, run, scenario.view, scenario.title or prepared.name)
    images = [
        Image.open(io.BytesIO(shot)).convert("RGB").resize(shown, Image.Resampling.LANCZOS)
        for shot in take_pictures(recording, np.linspace(0.0, run.time[-1], frames), (1280, 768))
    ]
    durations = [round(1000 * seconds / frames)] * (frames - 1) + [1000]
    images[0].save(
        IMAGES / "moving.webp",
        save_all=True,
        append_images=images[1:],
        duration=durations,
        loop=0,
        quality=60,
        method=6,
    )


# ---------------------------------------------------------------------- drive

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


def drive_page(names: Iterable[str]) -> None:
    """Drive TIAGo by a script: its hand reaches for a point inside a ball, which limits the arm."""
    prepared = prepare_drive(read_source("tiago", OPTIONS), OPTIONS)
    queue = CommandQueue(prepared.controls)
    page = DrivePage(prepared, queue, OPTIONS["title"], open_browser=False)
    loop = threading.Thread(target=drive, args=(prepared, queue, None, RealTimeClock(), page))
    loop.start()
    try:
        with browser() as launched:
            shown = launched.new_page(viewport={"width": 1280, "height": 760})
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
            shown.screenshot(path=str(IMAGES / "drive.png"), timeout=PATIENCE)
    finally:
        queue.put({"kind": "end"})
        loop.join()
        page.live.close()


# ---------------------------------------------------------------------- scenes


def scenes(names: Iterable[str]) -> None:
    """Record scenarios, a page of 1 to 8 MB each, under the name of their picture."""
    SCENES.mkdir(exist_ok=True)
    for name in names or SHORT:
        prepared = Scenario.load(name).build()
        path = SCENES / f"{name.replace('-', '_')}.html"
        write_animation(prepared, execute(prepared), path)
        print(path, flush=True)


KINDS: dict[str, Callable[[list[str]], None]] = {
    "gallery": gallery,
    "moving": moving,
    "drive": drive_page,
    "scenes": scenes,
}

if __name__ == "__main__":
    main()
