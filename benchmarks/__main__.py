"""Benchmarks by name.

``python -m benchmarks`` lists them, ``python -m benchmarks NAME ...`` runs one, and ``--record NAME ...`` keeps its
output in ``benchmarks/results``, which the site shows.
"""

from __future__ import annotations

import ast
import runpy
import sys
from pathlib import Path

from benchmarks import recording
from rnc_pin.errors import nearest

FOLDER = Path(__file__).parent


def benchmarks() -> dict[str, str]:
    """First sentence of each benchmark, by name: modules and packages that run as programs."""
    found = {}
    for path in sorted(FOLDER.iterdir()):
        file = path / "__main__.py" if path.is_dir() else path
        if file.suffix != ".py" or not file.is_file() or path == Path(__file__):
            continue
        text = file.read_text(encoding="utf-8")
        if path.is_dir() or '__name__ == "__main__"' in text:
            said = ast.get_docstring(ast.parse(text)) or ""
            found[path.stem] = " ".join(said.split("\n\n")[0].split())
    return found


def _parses(name: str) -> bool:
    """True if a benchmark has options that it lists by itself."""
    path = FOLDER / name / "__main__.py" if (FOLDER / name).is_dir() else FOLDER / f"{name}.py"
    return "argparse" in path.read_text(encoding="utf-8")


def main() -> None:
    """List the benchmarks, or run the one that the command line names."""
    known = benchmarks()
    if len(sys.argv) < 2 or sys.argv[1] in ("-h", "--help"):
        print(__doc__, "\n")
        for name, said in known.items():
            print(f"{name:20} {said}")
        return
    recorded = sys.argv[1] == "--record"
    name, *arguments = sys.argv[1 + recorded :] or ["--record"]
    if name not in known:
        sys.exit(f"no benchmark '{name}'{nearest(name, known)}")
    if recorded:
        recording.record(name, arguments)
        return
    if {"-h", "--help"} & set(arguments) and not _parses(name):
        print(f"python -m benchmarks {name}: {known[name]}")
        return
    sys.argv[:2] = [f"python -m benchmarks.{name}"]
    runpy.run_module(f"benchmarks.{name}", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
