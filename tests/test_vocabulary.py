"""Rules of prose that a machine can check: docstrings are phrases or imperatives, sentences of the pages are short."""

import ast
import re
from collections import Counter
from functools import cache
from typing import NamedTuple

import pytest

from places import ROOT, pages

FOLDERS = ("rnc_pin", "benchmarks", "docs", "examples", "tests")
MODULES = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))
QUESTION = re.compile(r"(What|Where|Whether|Who|Whose|Whoever|Which|How)\b")
LONGEST_SENTENCE = 30  # words


class Facts(NamedTuple):
    """Facts about a module for these rules; its syntax tree would keep millions of objects alive."""

    docstrings: list[tuple[str, str]]
    imported: list[tuple[int, str]]
    defined: list[str]


@cache
def facts(path):
    nodes = statements(path)
    documented = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Module
    named = (
        (getattr(node, "name", "module"), ast.get_docstring(node)) for node in nodes if isinstance(node, documented)
    )
    imports = [node for node in nodes if isinstance(node, ast.Import | ast.ImportFrom)]
    modules = [(node.lineno, getattr(node, "module", None) or "") for node in imports]
    return Facts(
        [(name, text) for name, text in named if text],
        modules + [(node.lineno, each.name) for node in imports for each in node.names],
        [node.name for node in nodes[0].body if isinstance(node, ast.ClassDef | ast.FunctionDef)],
    )


def statements(path):
    """The module and the statements in it, in all depths; expressions hold no docstrings, imports or definitions."""
    found, left = [], [ast.parse(path.read_text())]
    while left:
        node = left.pop()
        found.append(node)
        for body in ("body", "orelse", "handlers", "finalbody", "cases"):
            children = getattr(node, body, ())
            left += [each for each in children if not isinstance(each, ast.expr)] if isinstance(children, list) else ()
    return found


def sentences(text):
    """Sentences outside code and formulas; items of lists and cells of tables are sentences of their own."""
    text = re.sub(r"```.*?```|\$\$.*?\$\$", "", text, flags=re.DOTALL)
    text = re.sub(r"^    .*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"\]\([^)]*\)", "]", text)
    text = re.sub(r"\n(?=[*#|-]|\d+\.|\n)|\|", "\n\n", text)
    for paragraph in text.split("\n\n"):
        yield from re.split(r"(?<=[.:;!?])\s+", " ".join(paragraph.split()))


def test_no_docstring_starts_with_a_question_word():
    asked = [
        f"{path.relative_to(ROOT)}: {name}: {text.splitlines()[0]}"
        for path in MODULES
        for name, text in facts(path).docstrings
        if QUESTION.match(text)
    ]
    assert not asked, "\n".join(asked)


@pytest.mark.parametrize("page", pages(), ids=lambda path: path.name)
def test_sentences_are_short(page):
    long = [each for each in sentences(page.read_text()) if len(each.split()) > LONGEST_SENTENCE]
    assert not long, "\n".join(long)


def test_no_test_file_imports_another():
    """Shared helpers are in ``tests/support``."""
    imported = [
        f"{path.name}:{line}"
        for path in (ROOT / "tests").rglob("*.py")
        for line, name in facts(path).imported
        if name.rpartition(".")[2].startswith("test_")
    ]
    assert not imported, ", ".join(imported)


def test_no_public_name_is_defined_twice():
    """Except by the command line, whose commands are named for what they call."""
    defined = Counter(
        name
        for path in (ROOT / "rnc_pin").rglob("*.py")
        if "command_line" not in path.relative_to(ROOT).parts
        for name in facts(path).defined
        if not name.startswith("_")
    )
    assert [name for name, count in defined.items() if count > 1] == []


def test_no_record_gives_up_a_promise_and_every_argument_has_a_name():
    given_up = re.compile(r"\b(frozen|kw_only)=False|\b(eq|repr)=True|^ +/,$", re.MULTILINE)
    assert not [path.name for path in (ROOT / "rnc_pin").rglob("*.py") if given_up.search(path.read_text())]
