"""Commands that pages and messages tell people to type, and the tables of how tests run them.

A new command of rnc-pin in a page needs no entry here: it runs as it is. An entry is needed for a new placeholder
(``PLACEHOLDERS``), for a command that takes long (``LONG``) and for one that cannot run in a test (``NOT_HERE``).
"""

import ast
import re
import shlex
from typing import NamedTuple

from places import ROOT, pages

PROGRAMS = ("rnc-pin", "python", "python3", "pytest", "pip", "ruff", "mypy", "lint-imports", "bash", ".", "eval")
SHELLS = ("", "sh", "bash", "shell", "console")
FOLLOWED = ("tutorials", "explanation")  # test_tutorials runs the shell blocks of these folders, with their files
UNCHECKED = ("CHANGELOG.md",)  # commands of former versions, too

PLACEHOLDERS = {
    "A.B=C": "simulation.dt=0.002", "CHECKOUT": ".", "COMMAND": "run", "DIR...": "runs/sweep", "DIR": "runs/sweep",
    "MODULE...": "rnc_pin/control/feedback.py", "NAME": "space-robot", "[NAME...]": "systems",
    "[PAGE...]": "01_your_robot", "ROBOT": "my_robot.urdf", "--seed S": "--seed 0", "FOLDER": "runs/space-robot",
    "SCENARIO": "my_robot.yaml", "[SCENARIO...]": "space-robot", " N": " 2", " ...": " space-robot",
}  # fmt: skip
"""Text of a page, and what a reader could type instead. Longer texts are replaced first."""

EXPRESSIONS = {
    "quoted": "my_robot.yaml",
    "shlex.quote(robot)": "my_robot.urdf",
    "shlex.quote(source)": "my_robot.yaml",
    "shlex.quote(self.specification['scenario'])": "space-robot",
    "' '.join(words)": "--set seed=1",
    "extra": "mujoco",
}
"""Expressions in the commands of messages, and a value of each."""

PROSE = ("did",)
"""Words behind "rnc-pin" in messages that are no command: "a folder that rnc-pin did not create"."""

SHORTER = {
    r"rnc-pin run ": "--set simulation.duration=0.02",
    r"rnc-pin sweep ": "--set simulation.duration=0.02 --runs 2 --jobs 1",
    r"rnc-pin drive ": "--duration 0.1 --no-browser",
    r"rnc-pin replay .*--show": "--no-browser --speed 0",
    r"rnc-pin init ": "--force",  # the draft of the page is there already
}
"""Options that make a command short; of an option that is given twice, the last value counts."""

_MEASURES = "it measures or draws for minutes to hours"
LONG = {
    r"rnc-pin run (?!space-robot( |$)|my_robot|--help)": "a whole run; test_built_in_runs has short ones",
    r"rnc-pin drive tiago": "TIAGo takes a quarter of a minute to load and prepare",
    r"python -m benchmarks": _MEASURES,
    r"python docs/generated": "it prints a page; test_documents makes all of them",
    r"python docs/make_(pictures|tutorial|zoo)": _MEASURES,
    r"python -m tools\.generate_rows": "it writes a file of the repository, which test_generated_rows compares",
    r"python -m tests\.derivations": "it derives equations for four minutes",
    r"pytest tests/\S+( -n 0)?$": "a part of this test suite, which runs anyway",
    r"pytest tests/\S+ -m": "a part of this test suite, which runs anyway",
}  # fmt: skip
"""Commands that run with ``-m long``, in a copy of the repository, and why."""

_SUITE = "it is the suite that this test is part of"
_NETWORK = "pip reads package indexes over a network; test_extras and the checks below compare extras and files"
NOT_HERE = {
    r"pytest( -m slow| --write-slow| -m long -s| -m published)?$": _SUITE,
    r"bash \.ci/run": _SUITE,
    r"pip (install|download|wheel)": _NETWORK,
    r"(ruff|mypy|lint-imports|python -m sphinx|python docs/check_site)": "extras dev and docs; .ci/run calls it",
    r"python3 -m venv": "a new environment",
    r"(\.|eval) ": "it changes the reader's shell",
    r"rnc-pin sweep .*--scheduler": "it needs a cluster; test_dask_cluster starts one",
    r"python docs/make_random_tasks": "it needs the folders of eight sweeps with 200 runs",
}
"""Commands that no test runs, and why."""


class Command(NamedTuple):
    """Command of a page or a message.

    Attributes:
        words: program and arguments.
        place: file and line.
        inline: True for code in a sentence, which may be a mere name such as ``rnc-pin run``.
    """

    words: tuple[str, ...]
    place: str
    inline: bool

    @property
    def text(self) -> str:
        return " ".join(self.words)


def matching(table: dict[str, str], text: str) -> list[str]:
    """Return the values of the patterns that match the beginning of a command."""
    return [value for pattern, value in table.items() if re.match(pattern, text)]


def filled(text: str) -> str:
    """Return the text of a page without placeholders."""
    for name in sorted(PLACEHOLDERS, key=len, reverse=True):
        begin, end = (r"(?<![\w./-])" if name[0].isalnum() else ""), (r"(?![\w|-])" if name[-1].isalnum() else "")
        text = re.sub(begin + re.escape(name) + end, PLACEHOLDERS[name], text)
    return re.sub(r"\[(--?[^\]]*)\]", r"\1", re.sub(r"(?<![^ ])\[?([\w./-]+)(\|[\w./-]+)+\]?(?![^ ])", r"\1", text))


def simple_commands(line: str) -> list[tuple[str, ...]]:
    """Split a line of a shell at ``&&`` and ``;``, without comments, variables and redirections."""
    lexer = shlex.shlex(filled(line), posix=True, punctuation_chars="&;>")
    lexer.whitespace_split, lexer.commenters = True, "#"
    found: list[list[str]] = [[]]
    redirected = False
    for word in lexer:
        if word in ("&&", ";"):
            found.append([])
        elif word == ">":
            redirected = True
        elif redirected:
            redirected = False
        elif found[-1] or not re.fullmatch(r"[A-Z_]+=\S*", word):
            found[-1].append(word)
    return [tuple(words) for words in found if words]


def commands_of_text(text: str, place: str, blocks: bool = True) -> list[Command]:
    """Commands of a page: lines of shell blocks, indented lines, and code in sentences.

    Args:
        text: the page, in Markdown.
        place: name of the page.
        blocks: False leaves out fenced blocks.
    """
    found: list[Command] = []
    fence: str | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        begin = re.match(r"\s*(?:```|~~~)(\S*)", line)
        if begin:
            fence = begin[1] if fence is None else None
            continue
        here = f"{place}:{number}"
        if fence is not None:
            if fence in SHELLS and blocks:
                found += [Command(words, here, False) for words in simple_commands(line)]
        elif line.startswith("    ") and _begins_with_program(line.strip()):
            found += [Command(words, here, False) for words in simple_commands(line)]
        else:
            for code in re.findall(r"(?<!`)`([^`]+)`(?!`)", line):
                if " " in code and _begins_with_program(code):
                    found += [Command(words, here, True) for words in simple_commands(code)]
    return found


def _begins_with_program(text: str) -> bool:
    return re.sub(r"^([A-Z_]+=\S* )+", "", text).split(" ")[0] in PROGRAMS


def inline_options(text: str) -> list[str]:
    """Return the options that stand alone in code of sentences, such as ``--set A.B=C``."""
    codes = re.findall(r"(?<!`)`(--[^`]+)`(?!`)", text)
    return [word for code in codes for word in re.findall(r"(?<!\S)--[\w-]+", code)]


def documented_pages() -> dict[str, str]:
    """Pages that state commands, by name."""
    return {page.relative_to(ROOT).as_posix(): page.read_text() for page in pages() if page.name not in UNCHECKED}


def commands_of_pages() -> list[Command]:
    """Commands of all pages."""
    return [
        command
        for name, text in documented_pages().items()
        for command in commands_of_text(text, name, blocks=not any(f"/{each}/" in name for each in FOLLOWED))
    ]


def commands_of_messages() -> list[Command]:
    """Commands in the strings of the package that are no docstrings.

    Raises:
        KeyError: an expression in such a string is not in ``EXPRESSIONS``.
    """
    found: list[Command] = []
    for path in sorted((ROOT / "rnc_pin").rglob("*.py")):
        source = path.read_text()
        if "rnc-pin " not in source and "pip install" not in source:
            continue
        for node in _strings(ast.parse(source)):
            for text in re.findall(r"(?:rnc-pin|pip install) [^;:\n]*", _value(node)):
                text = text.split(" in the folder")[0]
                quoted = text.split("'")[0] if text.startswith("rnc-pin") else text
                words = tuple(shlex.split(quoted))
                if words[1] not in PROSE:
                    found.append(Command(words, f"{path.relative_to(ROOT).as_posix()}:{node.lineno}", True))
    return found


def _strings(tree: ast.AST) -> list[ast.Constant | ast.JoinedStr]:
    """Strings that are used, not docstrings, and not parts of other strings."""
    passed = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    passed |= {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    strings = [node for node in ast.walk(tree) if isinstance(node, ast.Constant | ast.JoinedStr)]
    used = [node for node in strings if id(node) not in passed]
    return [node for node in used if re.search(r"rnc-pin |pip install ", ast.unparse(node))]


def _value(node: ast.Constant | ast.JoinedStr) -> str:
    """Text of a string in which each expression behind a command has a value."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    text = ""
    for part in node.values:
        if isinstance(part, ast.Constant):
            text += str(part.value)
        elif re.search(r"(rnc-pin [^;:'\n]*|pip install [^;:\n]*)$", text):
            text += EXPRESSIONS[ast.unparse(part.value)]
    return text
