"""Size and shape of the code base: what a reader has to go through.

    python -m benchmarks.codebase              # this tree
    python -m benchmarks.codebase FOLDER       # another checkout
    python -m benchmarks.codebase --check      # fails if this tree is larger than the table of CONTRIBUTING.md allows

Lines without comments leave out blank lines, comments and docstrings, of attributes too.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import statistics
import subprocess
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy.sparse.csgraph
from rich.console import Console
from rich.table import Table

from rnc_pin.lazy_exports import listed_exports

MOST_PARAMETERS, MOST_LINES, LARGE_MODULE = 8, 60, 350
_SKIPPED = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
_QUESTIONS = re.compile(r"(What|Where|Whether|Who|Whose|Whoever|Which|How)\b")

Function = ast.FunctionDef | ast.AsyncFunctionDef


def code_lines(source: str) -> int:
    """Number of lines that hold code: no blank lines, comments or docstrings, those of attributes included."""
    # A string that stands alone is a docstring: of a module, class or function, or of the attribute above it.
    alone = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Expr))
    texts = [node for node in alone if isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)]
    docstrings = {line for text in texts for line in range(text.lineno, (text.end_lineno or 0) + 1)}
    found: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in _SKIPPED:
            found |= set(range(token.start[0], token.end[0] + 1))
    return len(found - docstrings)


def functions(tree: ast.AST) -> Iterator[Function]:
    """All functions and methods of a module."""
    return (node for node in ast.walk(tree) if isinstance(node, Function))


def parameters(function: Function) -> int:
    """Number of parameters, self and cls left out."""
    given = function.args
    names = [each.arg for each in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return len([name for name in names if name not in ("self", "cls")])


def imports(package: Path, trees: dict[Path, ast.Module]) -> set[tuple[str, str]]:
    """Imports among the modules of a package, as pairs: importer and imported.

    A name that a room exports is traced to its module by the stub of the room.
    """

    def dotted(path: Path) -> str:
        return ".".join(path.relative_to(package.parent).with_suffix("").parts).removesuffix(".__init__")

    modules = {dotted(path) for path in trees}
    exported = {
        (dotted(stub), name): origin
        for stub in package.rglob("__init__.pyi")
        for name, (origin, _) in listed_exports(stub, dotted(stub)).items()
    }
    pairs = {
        (dotted(path), whole if whole in modules else exported.get((node.module or "", each.name), node.module or ""))
        for path, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for each in node.names
        for whole in (f"{node.module}.{each.name}",)
    }
    return {(importer, module) for importer, module in pairs if module in modules and module != importer}


def room(module: str) -> str:
    """Room of a module: a folder of the package, or one of the applications; "" for modules of the package itself."""
    folders = module.split(".")[1:-1]
    return "/".join(folders[: 2 if folders[:1] == ["applications"] else 1])


def circles(pairs: set[tuple[str, str]]) -> int:
    """Number of circles of imports: strongly connected groups of more than one."""
    names = sorted({name for pair in pairs for name in pair})
    rows, columns = ([names.index(pair[k]) for pair in pairs] for k in (0, 1))
    graph = scipy.sparse.coo_array((np.ones(len(pairs)), (rows, columns)), shape=(len(names), len(names)))
    _, group = scipy.sparse.csgraph.connected_components(graph, connection="strong")
    return int(np.sum(np.bincount(group) > 1))


def measure(root: Path) -> dict[str, object]:
    """All figures of a checkout."""
    package = root / "rnc_pin"
    sources = {path: path.read_text() for path in sorted(package.rglob("*.py"))}
    trees = {path: ast.parse(text) for path, text in sources.items()}
    every = [function for tree in trees.values() for function in functions(tree)]
    lengths = [(each.end_lineno or each.lineno) - each.lineno + 1 for each in every]
    sizes = {path: len(text.splitlines()) for path, text in sources.items()}
    code = {path: code_lines(text) for path, text in sources.items()}
    docstrings = [
        text
        for tree in trees.values()
        for node in ast.walk(tree)
        if isinstance(node, Function | ast.ClassDef | ast.Module) and (text := ast.get_docstring(node))
    ]
    files = [path.name for path in sources if path.name != "__init__.py"]

    pairs = imports(package, trees)
    importers = Counter(module for _, module in pairs)
    between = {(room(importer), room(module)) for importer, module in pairs}
    arrows = {(first, second) for first, second in between if first and second and first != second}

    percentile = sorted(lengths)[len(lengths) * 95 // 100]
    return {
        "modules": len(sources),
        "rooms, arrows between them": f"{len({each for arrow in arrows for each in arrow})}, {len(arrows)}",
        "circles of modules, of rooms": f"{circles(pairs)}, {circles(arrows)}",
        "modules with one importer": sum(count == 1 for count in importers.values()),
        "lines": sum(sizes.values()),
        "lines without comments": sum(code.values()),
        "module, median and largest": f"{statistics.median(sizes.values()):.0f}, {max(sizes.values())}",
        f"modules over {LARGE_MODULE} lines": sum(size > LARGE_MODULE for size in sizes.values()),
        "function, median and 95th percentile": f"{statistics.median(lengths):.0f}, {percentile}",
        f"functions over {MOST_LINES} lines": sum(length > MOST_LINES for length in lengths),
        f"functions with more than {MOST_PARAMETERS} parameters": sum(
            parameters(each) > MOST_PARAMETERS for each in every
        ),
        "exported names": len(listed_exports(package / "__init__.pyi", package.name)),
        "uses of Any": sum(len(re.findall(r"\bAny\b", text)) for text in sources.values()),
        "docstrings": len(docstrings),
        "  that start with a question word": sum(bool(_QUESTIONS.match(text)) for text in docstrings),
        "file names used more than once": len({name for name in files if files.count(name) > 1}),
        "lines of tests": sum(len(path.read_text().splitlines()) for path in sorted((root / "tests").rglob("*.py"))),
        "words of the README": len((root / "README.md").read_text().split()),
    }


def sizes(root: Path) -> dict[str, int]:
    """Sizes that the table of CONTRIBUTING.md bounds. Files that git ignores do not count."""
    listed = subprocess.run(["git", "ls-files"], cwd=root, capture_output=True, text=True, check=False)
    every = [root / name for name in listed.stdout.splitlines()] if listed.returncode == 0 else root.rglob("*")
    texts = {
        path: path.read_text(encoding="utf-8")
        for path in every
        if path.suffix in (".py", ".c", ".h", ".md") and path.is_file() and "site" not in path.parts
    }

    def inside(folder: str, *suffixes: str) -> list[str]:
        return [text for path, text in texts.items() if path.is_relative_to(root / folder) and path.suffix in suffixes]

    def lines(found: list[str]) -> int:
        return sum(len(text.splitlines()) for text in found)

    code = inside("rnc_pin", ".py")
    return {
        "lines of Python without comments": sum(map(code_lines, code)),
        "modules": len(code),
        "lines of C": lines(inside("rnc_pin/_kernel", ".c", ".h")),
        "lines of tests": lines(inside("tests", ".py")),
        "lines of benchmarks": lines(inside("benchmarks", ".py")),
        "words of pages": sum(len(text.split()) for text in inside("", ".md")),
    }


def allowed(page: Path) -> dict[str, int]:
    """Sizes that the table of CONTRIBUTING.md allows."""
    rows = re.findall(r"^\| ([a-zA-Z ]+) \| ([\d,]+) \|$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {name: int(number.replace(",", "")) for name, number in rows}


def check(root: Path) -> list[str]:
    """One line for each size that is larger than the table allows, or that the table lacks."""
    page = root / "CONTRIBUTING.md"
    limits = allowed(page)
    return [
        f"{name}: {size:,}, and {page.name} allows {limits.get(name, 0):,}"
        for name, size in sizes(root).items()
        if size > limits.get(name, 0)
    ]


def main() -> None:
    """Print the figures of one or more checkouts side by side, or compare one with its limits."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("roots", nargs="*", type=Path, default=[Path(__file__).resolve().parent.parent])
    parser.add_argument("--check", action="store_true", help="compare with the table of CONTRIBUTING.md")
    given = parser.parse_args()
    roots = given.roots
    if given.check:
        for name, size in sizes(roots[0].resolve()).items():
            print(f"{name}: {size:,}")
        sys.exit("\n".join(check(roots[0].resolve())) or 0)
    table = Table(*("", *(root.resolve().name for root in roots)))
    measured = [measure(root) for root in roots]
    for name in measured[0]:
        table.add_row(name, *(str(each[name]) for each in measured))
    Console().print(table)


if __name__ == "__main__":
    main()
