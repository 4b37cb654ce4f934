"""Make the pictures of the gallery: run scenarios, plot them, photograph their animations.

Needs Chromium and Playwright (``pip install '.[test]'``). ``python docs/make_gallery.py`` does all built-in scenarios,
``python docs/make_gallery.py car tiago`` some again. ``docs/data/gallery.json`` has what the page tells of the runs.
"""

import argparse
import io
import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin
from PIL import Image

from rnc_pin.applications.scenario.execution import Result, execute, write
from rnc_pin.applications.scenario.files import built_in_names
from rnc_pin.applications.scenario.pictures import draw_pictures
from rnc_pin.applications.scenario.saved_run import drawn_run
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.visualization.recording import Recording, take_pictures

DOCS = Path(__file__).parent
IMAGES = DOCS / "images"
FACTS = DOCS / "data" / "gallery.json"
SIZE = (1000, 600)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenarios", nargs="*", help="built-in names; all by default")
    arguments = parser.parse_args()
    IMAGES.mkdir(exist_ok=True)
    facts = json.loads(FACTS.read_text()) if FACTS.is_file() else {}
    for name in arguments.scenarios or built_in_names():
        prepared = Scenario.load(name).build()
        result = execute(prepared)
        facts[name] = picture(prepared, result)
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
    recording = Recording(drawn_run(prepared.experiment.drawn_model, scenario, run), run, scenario.view, title)
    for shot in take_pictures(recording, [telling_moment(prepared, result)], SIZE):
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


if __name__ == "__main__":
    main()
