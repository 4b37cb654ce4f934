"""Sphinx extension: recordings that ``docs/make_pictures.py`` wrote become interactive scenes behind their pictures.

A picture ``images/NAME.png`` has the scene ``_scenes/NAME.html``. The site loads a scene only at a click. A picture
without a scene stays a picture.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from sphinx.application import Sphinx

SCENES = Path(__file__).parent / "_scenes"


def copy_scenes(app: Sphinx, error: Exception | None) -> None:
    """Copy the recordings into the site, and write the list of their names for the script of the pages."""
    if error is not None or app.builder.format != "html":
        return
    found = sorted(SCENES.glob("*.html"))
    folder = Path(app.outdir) / "scenes"
    folder.mkdir(exist_ok=True)
    for path in found:
        shutil.copy(path, folder)
    names = json.dumps([path.stem for path in found])
    (Path(app.outdir) / "_static" / "scene_names.js").write_text(f"window.sceneNames = {names};\n")


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_js_file("scene_names.js", priority=100)
    app.add_js_file("scenes.js", priority=200, loading_method="defer")
    app.connect("build-finished", copy_scenes)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
