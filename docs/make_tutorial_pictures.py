"""Follow tutorials word by word in an empty folder, and keep their pictures.

    python docs/make_tutorial_pictures.py [PAGE...]

A page is a sequence of steps: files that the reader saves, commands, and Python blocks in one namespace.
"""

from __future__ import annotations

import contextlib
import io
import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

PAGES = Path(__file__).parent / "tutorials"
PICTURES = Path(__file__).parent / "images" / "tutorials"
_STEP = re.compile(
    r"^(?:[^\n]*`([\w.-]+)`[^`\n]*:\n\n)?```(\w+)\n(.*?)^```$(?:\n\n((?:    [^\n]*\n)+))?", re.DOTALL | re.MULTILINE
)
_PICTURE = re.compile(r"!\[[^\]]+\]\(\.\./images/tutorials/([\w.-]+)\)")
_PREPARATION = ("python3 -m venv ", ". env/bin/activate", "pip install ", "mkdir ", "cd ")


class Step(NamedTuple):
    """Block of a page: its language, its text, the file that the reader saves, and what it prints, or ""."""

    language: str
    text: str
    file: str
    printed: str


def steps(page: Path) -> list[Step]:
    """Blocks of a page in their order."""
    found = _STEP.findall(page.read_text())
    return [Step(language, text, file, textwrap.dedent(printed)) for file, language, text, printed in found]


def pictures(page: Path) -> list[str]:
    """File names of the pictures that a page makes and shows."""
    return _PICTURE.findall(page.read_text())


def follow(page: Path, folder: Path, command: Callable[[str], object]) -> None:
    """Follow a page in a folder, which is the working directory; ``command`` runs a line that starts with rnc-pin.

    Raises:
        ValueError: a line of a shell block is neither such a command nor part of the preparation, or a Python block
            does not print what the page says.
    """
    namespace = {"__name__": "__main__"}
    for language, text, file, printed in steps(page):
        if file and language != "python":
            (folder / file).write_text(text)
        elif language == "python":
            with contextlib.redirect_stdout(io.StringIO()) as output:
                exec(compile(text, f"{page.name}, block", "exec"), namespace)
            if printed and output.getvalue() != printed:
                raise ValueError(f"{page.name}: printed\n{output.getvalue()}instead of\n{printed}")
        elif language == "bash":
            for line in text.splitlines():
                if line.startswith("rnc-pin "):
                    command(line)
                elif not line.startswith(_PREPARATION):
                    raise ValueError(f"{page.name}: {line!r} is no step that a reader can follow")


def expected_status(line: str) -> int:
    """Exit status of a command of the pages: the sweep has runs that diverge, which is its subject."""
    return 1 if line.startswith("rnc-pin sweep ") else 0


def _run(line: str) -> None:
    status = subprocess.run(line, shell=True).returncode
    if status != expected_status(line):
        raise ValueError(f"{line}: exit status {status}")


def _keep_pictures(page: Path) -> None:
    start = time.process_time()
    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        folder = Path(name)
        follow(page, folder, _run)
        for picture in pictures(page):
            found = max(folder.rglob(picture), key=lambda path: path.stat().st_mtime)  # of the last run
            shutil.copy(found, PICTURES / picture)
    print(f"{page.name}: {time.process_time() - start:.1f} s of processor time without the commands")


if __name__ == "__main__":
    for chosen in [PAGES / f"{name}.md" for name in sys.argv[1:]] or sorted(PAGES.glob("*.md")):
        _keep_pictures(chosen)
