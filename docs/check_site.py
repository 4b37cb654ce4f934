"""Check a built site: no page loads anything from another host, every local file that a page names exists, words of
readers lead to their page first, and every page has a kind.

``python docs/check_site.py OUT`` prints what is wrong, and then ends with status 1. Links that a reader may follow are
not loaded; ``python -m sphinx -b linkcheck docs OUT`` follows them.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADED = {"src", "srcset", "poster", "data"}
"""Attributes whose address a browser loads without a click; of ``<link>`` also ``href``."""
NOT_LOADED = {"canonical", "next", "prev", "index", "search", "author", "license"}
_IN_STYLE = re.compile(r"""(?:@import\s+|url\()\s*["']?((?:https?:)?//[^"')\s]+)""")


class LoadedAddresses(HTMLParser):
    """Addresses that a page loads, and text of its style elements."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.styles: list[str] = []
        self._in_style = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {key: value or "" for key, value in attrs}
        self._in_style = tag == "style"
        self.styles.append(given.get("style", ""))
        self.addresses += [value for key, value in given.items() if key in LOADED]
        if tag == "link" and not NOT_LOADED & set(given.get("rel", "").split()):
            self.addresses.append(given.get("href", ""))

    def handle_data(self, data: str) -> None:
        if self._in_style:
            self.styles.append(data)


def faults_of_page(text: str, folder: Path) -> Iterator[str]:
    """Return the addresses of another host, and the missing files, that a page in ``folder`` loads."""
    parser = LoadedAddresses()
    parser.feed(text)
    for address in parser.addresses:
        parts = urlsplit(address)
        if parts.netloc or parts.scheme in ("http", "https"):
            yield f"loads {address}"
        elif parts.path and not parts.scheme and not (folder / unquote(parts.path)).exists():
            yield f"has no file {address}"
    for style in parser.styles:
        yield from faults_of_style(style)


def faults_of_style(text: str) -> Iterator[str]:
    """Return the addresses of another host that a style sheet loads."""
    for address in _IN_STYLE.findall(text):
        yield f"loads {address}"


def faults_of_site(site: Path) -> Iterator[str]:
    """Return what is wrong, page by page; recorded scenes are pages of the site, too."""
    pages = sorted(site.rglob("*.html"))
    if not pages:
        yield f"{site}: no page"
    for path in pages:
        yield from (f"{path.relative_to(site)}: {fault}" for fault in faults_of_page(path.read_text(), path.parent))
    for path in sorted(site.rglob("*.css")):
        yield from (f"{path.relative_to(site)}: {fault}" for fault in faults_of_style(path.read_text()))


def faults_of_search(site: Path, synonyms: dict[str, list[str]]) -> Iterator[str]:
    """Return the words whose first result of the search is another page, by the scores of ``searchtools.js``.

    A main entry of the index that is the word itself has 100 points, a title 15 at most.
    """
    text = (site / "searchindex.js").read_text()
    index = json.loads(text[text.index("{") : text.rindex("}") + 1])
    for page, words in synonyms.items():
        for word in words:
            found = index["indexentries"].get(word.lower(), [])
            if [index["docnames"][number] for number, _, main in found if main] != [page]:
                yield f"a search for '{word}' does not begin with {page}"


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))
    from site_pages import SYNONYMS, faults_of_kinds

    site = Path(sys.argv[1])
    pages = {path.relative_to(site).with_suffix("").as_posix() for path in site.rglob("*.html")}
    pages = {page for page in pages if (Path(__file__).parent / f"{page}.md").is_file()}
    found = [*faults_of_site(site), *faults_of_search(site, SYNONYMS), *faults_of_kinds(pages)]
    print("\n".join(found) or "nothing comes from another host, words of readers lead to their page, pages have kinds")
    sys.exit(bool(found))
