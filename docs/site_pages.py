"""Sphinx extension: pages of the root, the reference, the search, and links that hold on GitHub and on the site.

A page links to ``../README.md`` or to a source file as GitHub wants it. Here the link leads to the copy of the page in
``project/``, or offers the file.
"""

from __future__ import annotations

import builtins
import collections.abc
import inspect
import json
import os
import re
import shutil
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from make_reference import reference_pages
from sphinx import addnodes
from sphinx.application import Sphinx

DOCS = Path(__file__).parent.resolve()
ROOT = DOCS.parent
SCORER = "project/search_scorer.js"
AT_THE_TOP = {
    "README.md": "project/readme.md",
    "CONTRIBUTING.md": "project/contributing.md",
    "CHANGELOG.md": "project/changelog.md",
    "SECURITY.md": "project/security.md",
    "LICENSE": "project/license.md",
}
GUIDES = {
    "First run": ["project/readme", "tutorials/index", "tutorials/01_your_robot", "drive"],
    "My robot": ["own_robot", "tutorials/02_wheels_slip_momentum", "tutorials/10_writing_a_constraint"],
    "Which redundancy": ["redundancy", "tutorials/03_choosing_outputs", "tutorials/04_redundancy"],
    "A controller": ["tutorials/13_your_controller", "tutorials/05_adaptive_control"],
    "Limits and obstacles": ["whole_body", "tutorials/06_limits_obstacles"],
    "A plan": [
        "optimal",
        "ways",
        "tutorials/07_planning_tracking",
        "tutorials/16_drive_there_and_stop",
        "tutorials/17_from_here_to_there",
    ],
    "A loop of mine": ["tutorials/08_control_loop", "tutorials/14_your_loop_from_yaml", "tutorials/11_cmd_vel"],
    "My figure": ["tutorials/12_my_figure"],
    "My log": ["logs", "tutorials/15_my_robot_does_not_move_like_my_file", "tutorials/18_what_does_the_arm_weigh"],
    "Many runs": ["sweeps", "tutorials/09_many_runs"],
}
"""Guides in the order of a user's day."""
ORDER = ("Guide", "Reference", "Explanation", "Record")
"""Kinds of pages, as the third line of each page states them, in the order of the table of contents."""
KINDS_AT_THE_TOP = {"project/readme": "Guide", "project/changelog": "Record"}
"""Kinds of pages that state none; all others of the root, and those of the code, are reference."""
MOST_WORDS = 900
"""Words of a guide, at most."""
RANKS = {"Record": -100, "Reference": -2}
"""What the search adds to the score of a page: guides come before pages to look things up, and records come last."""
SYNONYMS = {
    "answers": [
        "accelerometer",
        "armature",
        "cable",
        "curb",
        "finger",
        "gripper",
        "IMU",
        "mimic",
        "rope",
        "rotor inertia",
        "suspension",
        "tire",
        "tyre",
        "voltage",
    ],
    "collisions": ["obstacle", "distance"],
    "commands": ["video", "extras"],
    "limits": ["what it cannot do"],
    "logs": ["bag", "calibration", "ROS"],
    "own_robot": ["differential", "MJCF", "trailer", "URDF", "xacro"],
    "python": ["balance", "LQR", "linearisation"],
    "redundancy": ["null space", "nullspace"],
    "tutorials/07_planning_tracking": ["cusp"],
    "tutorials/11_cmd_vel": ["cmd_vel", "odometry", "twist"],
    "optimal": ["MPC", "parking"],
    "ways": ["door", "map", "path planning"],
    "verdicts": ["chatter", "jitter"],
    "whole_body": ["joint limits", "task priority", "torque limit"],
}
"""Words of readers that lead to a page before all others: main entries of Sphinx's index."""
ELSEWHERE = {*dir(builtins), *typing.__all__, *collections.abc.__all__, "Array", "ndarray", "Float", "Path"}
"""Types in annotations that the site does not document."""
_LINK = re.compile(r"(\]\()(?![a-z]+:|#|/)([^)\s#]+)(#[^)\s]*)?(\))")


def site_links(text: str, folder: Path) -> str:
    """Return the text of a page in ``folder``; its links to pages of the root and to source files suit the site."""

    def moved(match: re.Match[str]) -> str:
        target = (folder / match[2]).resolve()
        if not target.is_relative_to(ROOT):
            return match[0]
        name = target.relative_to(ROOT).as_posix()
        if name in AT_THE_TOP:
            place = "/" + AT_THE_TOP[name]
        elif target.is_relative_to(DOCS):
            place = "/" + target.relative_to(DOCS).as_posix()
        else:
            place = "/" + os.path.relpath(target, DOCS)
        return f"{match[1]}{place}{match[3] or ''}{match[4]}"

    return _LINK.sub(moved, text)


def kind(page: str) -> str:
    """Return the kind that a page states in its third line, or "" if it states none."""
    if page.startswith(("project/", "reference/")):
        return KINDS_AT_THE_TOP.get(page, "Reference")
    found = re.match(r"# .*\n\n\*(\w+)\.\*\n", (DOCS / f"{page}.md").read_text())
    return found[1] if found else ""


def sections(pages: set[str]) -> dict[str, list[str]]:
    """Return the pages by part of the table of contents: the guides of a day, then the other kinds."""
    parts = {caption: [name for name in names if name in pages] for caption, names in GUIDES.items()}
    for each in ORDER[1:]:
        parts[each] = sorted(name for name in pages if kind(name) == each and not name.startswith("reference/"))
    parts["Reference"] += ["reference/index"] if "reference/index" in pages else []
    return parts


def faults_of_kinds(pages: set[str]) -> Iterator[str]:
    """Return pages without a kind, guides that are too long, and guides without a place in the day of a user."""
    day = {name for names in GUIDES.values() for name in names}
    for page in sorted(pages - {"index"}):
        if kind(page) not in ORDER:
            yield f"{page}: the third line has to be one of {', '.join(f'*{each}.*' for each in ORDER)}"
        elif (kind(page) == "Guide") != (page in day):
            yield f"{page}: a guide has a place in GUIDES, and no other page has one"
        elif page in day and (words := len((DOCS / f"{page}.md").read_text().split())) > MOST_WORDS:
            yield f"{page}: {words} words, and a guide has {MOST_WORDS} at most"
    yield from (f"{page}: GUIDES has no such page" for page in sorted(day - pages))


def table_of_contents(pages: set[str]) -> str:
    """Return the hidden table of contents: guides first, records last."""
    parts = []
    for caption, names in sections(pages).items():
        lines = "\n".join(f"/{name}" for name in names)
        title = {"Reference": "Reference", "Explanation": "Explanation", "Record": "Records"}.get(caption, caption)
        parts.append(f"```{{toctree}}\n:caption: {title}\n:hidden:\n\n{lines}\n```\n")
    return "\n".join(parts)


def project_pages() -> dict[str, str]:
    """Return the pages of the repository root by their place on the site."""
    pages = {}
    for name, place in AT_THE_TOP.items():
        text = (ROOT / name).read_text()
        pages[place] = f"# License\n\n```text\n{text}```\n" if name == "LICENSE" else site_links(text, ROOT)
    return pages


def search_scorer() -> str:
    """Return the scores of Sphinx's search, those of ``searchtools.js`` with :data:`RANKS`."""
    written = [path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")]
    pages = {name.removesuffix(".md") for name in (*written, *AT_THE_TOP.values()) if not name.startswith("reference/")}
    ranks = {page: RANKS[kind(page)] for page in sorted(pages) if kind(page) in RANKS}
    return f"""const ranks = {json.dumps(ranks)};
var Scorer = {{
  score: ([page, , , , score]) => score + (ranks[page] ?? (page.startsWith("reference/") ? -2 : 0)),
  objNameMatch: 11, objPartialMatch: 6, objPrio: {{0: 15, 1: 5, 2: -5}}, objPrioDefault: 0,
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
}};
"""


def write_pages(app: Sphinx, config: Any) -> None:
    """Write all generated pages; an unchanged one keeps its time, so that Sphinx does not read it again."""
    pages = {**project_pages(), **reference_pages(), SCORER: search_scorer()}
    for place, text in pages.items():
        path = DOCS / place
        path.parent.mkdir(exist_ok=True)
        if not path.is_file() or path.read_text() != text:
            path.write_text(text)
    for folder in ("project", "reference"):
        for path in (DOCS / folder).iterdir():
            if f"{folder}/{path.name}" not in pages:
                path.unlink()


def relink(app: Sphinx, name: str, source: list[str]) -> None:
    """Make the links of one page for the site."""
    path = Path(app.env.doc2path(name))
    if path.suffix == ".md":
        source[0] = site_links(source[0], path.parent)
    if words := SYNONYMS.get(name):
        title, _, rest = source[0].partition("\n")
        source[0] = f"{title}\n\n```{{index}} {', '.join(f'! {word}' for word in words)}\n```\n{rest}"
    if name == "index":
        source[0] += "\n" + table_of_contents(app.env.found_docs)


def plain_annotations(app: Sphinx, doctree: nodes.document) -> None:
    """Make plain text of dimensions in signatures, ``Float[Array, p]``, and of types that the site does not document.

    Letters name no object, and Sphinx would search all objects for each ``float``.
    """
    for reference in list(doctree.findall(addnodes.pending_xref)):
        target = reference.get("reftarget", "")
        dimension = target.isidentifier() and target.islower() and len(target) < 3
        if reference.get("refdomain") == "py" and (dimension or target.rpartition(".")[2] in ELSEWHERE):
            reference.replace_self(reference.children)


def skip_fields(app: Sphinx, what: str, name: str, thing: object, skip: bool, options: object) -> bool | None:
    """Leave out the fields of named tuples: their classes describe them."""
    return True if (inspect.getdoc(thing) or "").startswith("Alias for field number") else None


def copy_mathjax(app: Sphinx, error: Exception | None) -> None:
    """Put the one script of MathJax into the site."""
    if error is None and app.builder.format == "html":
        folder = Path(app.outdir) / "_static" / "mathjax"
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copy(app.config.mathjax_folder / "tex-svg.js", folder)


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_config_value("mathjax_folder", None, "", [])
    app.connect("config-inited", write_pages)
    app.connect("source-read", relink)
    app.connect("doctree-read", plain_annotations)
    app.connect("autodoc-skip-member", skip_fields)
    app.connect("build-finished", copy_mathjax)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
