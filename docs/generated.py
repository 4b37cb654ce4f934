"""Sphinx extension: what commands generate stands in the pages of the site, and not in git.

A line ``<!-- generated: NAME WORD... -->`` of a page stands for what the function NAME of :data:`GENERATORS` returns.
``python docs/generated.py PAGE`` prints a page as the site has it.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

DOCS = Path(__file__).parent.resolve()
sys.path.insert(0, str(DOCS))
sys.path.append(str(DOCS.parent))  # last: the installed rnc_pin has the compiled kernel

import error_messages  # noqa: E402
import gallery_page  # noqa: E402
import scenario_keys  # noqa: E402

from benchmarks import recording  # noqa: E402
from tools import tables  # noqa: E402

if TYPE_CHECKING:
    from sphinx.application import Sphinx


def table(name: str, key: str) -> str:
    """Return one table of ``docs/data/NAME.json``."""
    return tables.markdown(tables.read(name)[key])


GENERATORS: dict[str, Callable[..., str]] = {
    "gallery": gallery_page.gallery,
    "keys": scenario_keys.keys,
    "messages": error_messages.family,
    "results": recording.sections,
    "table": table,
}
_MARK = re.compile(r"^<!-- generated: (\w+)((?: [^ \n]+)*) -->$", re.MULTILINE)


@cache
def part(name: str, *words: str) -> str:
    """Return what stands at a mark."""
    return GENERATORS[name](*words)


def filled(text: str) -> str:
    """Return the text of a page with all that is generated."""
    return _MARK.sub(lambda mark: f"{mark[0]}\n\n{part(mark[1], *mark[2].split())}", text)


def prepare(app: Sphinx) -> None:
    """Make all parts before autodoc reads a page: it replaces default values of functions, which schemas show."""
    for page in DOCS.glob("*.md"):
        filled(page.read_text(encoding="utf-8"))


def fill(app: Sphinx, name: str, source: list[str]) -> None:
    """Fill one page of the site."""
    source[0] = filled(source[0])


def outdated(app: Sphinx, *_: object) -> list[str]:
    """Return the pages to read again, although their files are unchanged: what they show may be new."""
    pages = [Path(app.env.doc2path(name)) for name in app.env.found_docs]
    return [app.env.path2doc(page) for page in pages if page.suffix == ".md" and _MARK.search(page.read_text())]


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", prepare)
    app.connect("source-read", fill, priority=400)  # before the links of the page are made
    app.connect("env-get-outdated", outdated)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    print(filled((DOCS / f"{sys.argv[1]}.md").read_text(encoding="utf-8")))
