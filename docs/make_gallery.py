"""Make docs/gallery.md and the pictures of the documentation: run scenarios, plot them, photograph their animations.

Needs Chromium and Playwright (``pip install '.[test]'``). ``python docs/make_gallery.py`` does all built-in scenarios,
``python docs/make_gallery.py car tiago`` some again, ``--page`` none: it writes the page from ``gallery.json``. With
``--recordings FOLDER`` it keeps the animations, too.
"""

import argparse
import io
import itertools
import json
import re
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin
from PIL import Image

from rnc_pin.applications.scenario.execution import Result, execute, write
from rnc_pin.applications.scenario.files import built_in_names, find_scenario
from rnc_pin.applications.scenario.pictures import draw_pictures
from rnc_pin.applications.scenario.saved_run import drawn_run
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.visualization.recording import Recording, take_pictures

DOCS = Path(__file__).parent
IMAGES = DOCS / "images"
FACTS, PAGE = DOCS / "gallery.json", DOCS / "gallery.md"
ACROSS = 4
"""Thumbnails in a row."""
SIZE = (1000, 600)
HEAD = """# Gallery

This page shows every built-in scenario, as `rnc-pin run NAME` draws it. `python docs/make_gallery.py` writes the page.
Each run also writes an animation, which plays offline in any browser. On the documentation site, pictures with a button
show their animation in place, if `python docs/make_scenes.py` recorded it before the build.

| in the pictures | meaning |
|---|---|
| dashed or dotted black line | planned path or reference |
| solid line | path of the robot |
| grey line | wheel track |
| orange arrow | constraint force |
| ball above the hand or axle | singularity margin: blue far from a singularity, red near one |
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenarios", nargs="*", help="built-in names; all by default")
    parser.add_argument("--recordings", type=Path, help="keep the animations in this folder")
    parser.add_argument("--page", action="store_true", help="run nothing; write the page from the last runs")
    arguments = parser.parse_args()
    IMAGES.mkdir(exist_ok=True)
    facts = json.loads(FACTS.read_text()) if FACTS.is_file() else {}
    for name in [] if arguments.page else arguments.scenarios or built_in_names():
        prepared = Scenario.load(name).build()
        result = execute(prepared)
        facts[name] = picture(prepared, result, arguments.recordings)
        print(f"{name}: {facts[name]}", flush=True)
    facts = {name: facts[name] for name in built_in_names() if name in facts}
    FACTS.write_text(json.dumps(facts, indent=1) + "\n")
    PAGE.write_text(page(facts))


def picture(prepared: Scenario, result: Result, recordings: Path | None) -> dict:
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
        animation = (folder / "animation.html").read_bytes()
    if recordings is not None:
        recordings.mkdir(parents=True, exist_ok=True)
        (recordings / f"{name}.html").write_bytes(animation)
    run, title = result.trajectory, scenario.title or name
    recording = Recording(drawn_run(prepared.experiment.drawn_model, scenario, run), run, scenario.view, title)
    for shot in take_pictures(recording, [telling_moment(prepared, result)], SIZE):
        shrink(Image.open(io.BytesIO(shot)), IMAGES / f"{name.replace('-', '_')}.png")
    errors = {key: float(f"{value:.2g}") for key, value in result.summary["final_error"].items()}
    return {
        "title": title,
        "outcome": str(run.outcome),
        "size": round(len(animation) / 1e6, 1),
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


def explanation(name: str) -> str:
    """Return the comment at the head of a scenario file."""
    head = itertools.takewhile(lambda line: line.startswith("#"), find_scenario(name).read_text().splitlines())
    return " ".join(line.removeprefix("#").strip() for line in head)


def thumbnails(facts: dict) -> Iterator[str]:
    """A table of pictures that link to their sections: GitHub and the site show the same."""
    cells = [
        f"[![{fact['title']}](images/{name.replace('-', '_')}.png)](#{anchor(fact['title'])})"
        for name, fact in facts.items()
    ]
    cells += [" "] * (-len(cells) % ACROSS)
    rows = [cells[k : k + ACROSS] for k in range(0, len(cells), ACROSS)]
    yield "|" + " |" * ACROSS
    yield "|" + "---|" * ACROSS
    yield from (f"|{'|'.join(row)}|" for row in rows)
    yield ""


def anchor(title: str) -> str:
    """Return GitHub's anchor of a heading."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def page(facts: dict) -> str:
    """Return the page: thumbnails, then scenario by scenario."""
    return "\n".join([HEAD, *thumbnails(facts), *sections(facts)])


def sections(facts: dict) -> Iterator[str]:
    for name, fact in facts.items():
        yield f"## {fact['title']}\n"
        yield f"![{fact['title']}](images/{name.replace('-', '_')}.png)\n"
        yield f"{explanation(name)}\n"
        errors = "; ".join(f"{key.replace('_', ' ')} {value:g}" for key, value in fact["error"].items())
        told = f"Final errors [m, rad]: {errors}." if errors else ""
        yield f"    rnc-pin run {name}\n"
        yield f"{told} The animation is a file of {fact['size']:g} MB.\n".lstrip()
        if fact["plots"]:
            yield " ".join(f"![{plot.removesuffix('.png')}](images/{plot})" for plot in fact["plots"]) + "\n"


if __name__ == "__main__":
    main()
