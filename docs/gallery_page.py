"""Pictures and explanations of the built-in scenarios, for ``docs/gallery.md``.

The facts are those of ``docs/data/gallery.json``, which ``docs/make_pictures.py`` writes.
"""

import itertools
import json
import re
from collections.abc import Iterator
from pathlib import Path

from rnc_pin.applications.scenario.files import find_scenario

FACTS = Path(__file__).parent / "data" / "gallery.json"
ACROSS = 4
"""Thumbnails in a row."""


def explanation(name: str) -> str:
    """Return the comment at the head of a scenario file."""
    head = itertools.takewhile(lambda line: line.startswith("#"), find_scenario(name).read_text().splitlines())
    return " ".join(line.removeprefix("#").strip() for line in head)


def thumbnails(facts: dict) -> Iterator[str]:
    """A table of pictures that link to their sections."""
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
    """Return the anchor of a heading."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def facts() -> dict[str, dict]:
    """Titles, outcomes, errors and plots of the last runs, by scenario."""
    return json.loads(FACTS.read_text(encoding="utf-8"))


def gallery() -> str:
    """Thumbnails, then a section for each scenario."""
    return "\n".join([*thumbnails(facts()), *sections(facts())])


def sections(facts: dict) -> Iterator[str]:
    """A section for each scenario: picture, explanation, command and plots."""
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
