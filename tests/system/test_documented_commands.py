"""Commands of pages are understood and run, or have an entry in ``PLACEHOLDERS`` or ``NOT_HERE``."""

import re
import shlex
import shutil
import sys
import tomllib
from typing import NamedTuple

import click
import pytest

from places import ROOT, pages
from rnc_pin.applications.command_line.cli import cli, main
from rnc_pin.applications.init import DraftOptions, draft, scenario_candidate

PROGRAMS = ("rnc-pin", "python", "python3", "pytest", "pip", "ruff", "mypy", "lint-imports", "bash", ".", "eval")
SHELLS = ("", "sh", "bash", "shell", "console")
FOLLOWED = ("tutorials", "explanation")  # test_tutorials runs the shell blocks of these folders, with their files

PLACEHOLDERS = {
    "A.B=C": "simulation.dt=0.002", "CHECKOUT": ".", "COMMAND": "run", "DIR...": "runs/sweep", "DIR": "runs/sweep",
    "MODULE...": "rnc_pin/control/feedback.py", "NAME": "space-robot", "[NAME...]": "systems",
    "[PAGE...]": "01_your_robot", "ROBOT": "my_robot.urdf", "--seed S": "--seed 0", "FOLDER": "runs/space-robot",
    "SCENARIO": "my_robot.yaml", "[SCENARIO...]": "space-robot", " N": " 2", " ...": " space-robot",
}  # fmt: skip
"""Text of a page, and what a reader could type instead. Longer texts are replaced first."""

SHORTER = {
    r"rnc-pin run ": "--set simulation.duration=0.02",
    r"rnc-pin sweep ": "--set simulation.duration=0.02 --runs 2 --jobs 1",
    r"rnc-pin drive ": "--duration 0.1 --no-browser",
    r"rnc-pin replay .*--show": "--no-browser --speed 0",
    r"rnc-pin init ": "--force",  # the draft of the page is there already
}
"""Options that make a command short; of an option that is given twice, the last value counts."""

NOT_HERE = {
    r"rnc-pin run (?!space-robot( |$)|my_robot|--help)": "a whole run; test_built_in_runs has short ones",
    r"rnc-pin drive tiago": "TIAGo takes a quarter of a minute to load and prepare",
    r"rnc-pin sweep .*--scheduler": "it needs a cluster; test_dask_cluster starts one",
    r"python -m (benchmarks|tools|tests)|python docs/": "it measures, draws or derives for minutes to hours",
    r"pytest|bash \.ci/run": "the suite that this test is part of",
    r"pip (install|download|wheel)": "pip reads package indexes over a network",
    r"(ruff|mypy|lint-imports|python -m sphinx)": "extras dev and docs; .ci/run calls it",
    r"python3 -m venv|(\.|eval) ": "it changes the reader's shell",
}
"""Commands that no test runs, and why."""


class Command(NamedTuple):
    """Command of a page; ``inline`` in a sentence, where it may be a mere name such as ``rnc-pin run``."""

    words: tuple[str, ...]
    place: str
    inline: bool

    @property
    def text(self) -> str:
        return " ".join(self.words)


def matching(table, text):
    return [value for pattern, value in table.items() if re.match(pattern, text)]


def filled(text):
    """The text of a page without placeholders."""
    for name in sorted(PLACEHOLDERS, key=len, reverse=True):
        begin, end = (r"(?<![\w./-])" if name[0].isalnum() else ""), (r"(?![\w|-])" if name[-1].isalnum() else "")
        text = re.sub(begin + re.escape(name) + end, PLACEHOLDERS[name], text)
    return re.sub(r"\[(--?[^\]]*)\]", r"\1", re.sub(r"(?<![^ ])\[?([\w./-]+)(\|[\w./-]+)+\]?(?![^ ])", r"\1", text))


def simple_commands(line):
    """Split a line of a shell at ``&&`` and ``;``, without comments, variables and redirections."""
    lexer = shlex.shlex(filled(line), posix=True, punctuation_chars="&;>")
    lexer.whitespace_split, lexer.commenters = True, "#"
    found, redirected = [[]], False
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


def commands_of_text(text, place, blocks=True):
    """Commands of a page: lines of shell blocks, indented lines, and code in sentences."""
    found, fence = [], None
    for number, line in enumerate(text.splitlines(), start=1):
        here = f"{place}:{number}"
        begin = re.match(r"\s*(?:```|~~~)(\S*)", line)
        if begin:
            fence = begin[1] if fence is None else None
        elif fence is not None:
            if fence in SHELLS and blocks:
                found += [Command(words, here, False) for words in simple_commands(line)]
        elif line.startswith("    ") and begins_with_program(line.strip()):
            found += [Command(words, here, False) for words in simple_commands(line)]
        else:
            for code in re.findall(r"(?<!`)`([^`]+)`(?!`)", line):
                if " " in code and begins_with_program(code):
                    found += [Command(words, here, True) for words in simple_commands(code)]
    return found


def begins_with_program(text):
    return re.sub(r"^([A-Z_]+=\S* )+", "", text).split(" ")[0] in PROGRAMS


def commands_of_pages():
    found = {}
    for page in pages():
        name = page.relative_to(ROOT).as_posix()
        if name != "CHANGELOG.md":  # commands of former versions, too
            for each in commands_of_text(page.read_text(), name, not any(f"/{one}/" in name for one in FOLLOWED)):
                found.setdefault(each.text, each)
    return found


COMMANDS = commands_of_pages()
RUN = {text: each for text, each in COMMANDS.items() if not matching(NOT_HERE, text)}


def source_of(words):
    """File of a script or a module of this repository; None of other programs. ``benchmarks NAME`` runs ``NAME``."""
    name = words[2].replace(".", "/") if words[1] == "-m" else words[1]
    if name.split("/")[0] not in ("benchmarks", "docs", "tests", "tools"):
        return None
    names = [f"benchmarks/{words[3]}", name] if name == "benchmarks" and len(words) > 3 else [name]
    found = [ROOT / f"{each}{end}" for each in names for end in (".py", "/__main__.py", "")]
    found = [path for path in found if path.is_file()]
    assert found, f"no file '{name}'"
    return found[0]


def with_help(command):
    """Arguments of rnc-pin. A mere name of a command, in a sentence, stands for its help."""
    arguments = list(command.words[1:])
    needed = [each for each in cli.commands.get(arguments[0], cli).params if each.required]
    interactive = arguments[0] == "drive"
    return [*arguments, "--help"] if command.inline and len(arguments) == 1 and (needed or interactive) else arguments


def check(command):
    program, *arguments = command.words
    if program == "rnc-pin":
        arguments = with_help(command)
        if "--help" not in arguments and not arguments[0].startswith("-"):
            assert arguments[0] in cli.commands, f"no command '{arguments[0]}'"
            cli.commands[arguments[0]].make_context(arguments[0], arguments[1:], parent=click.Context(cli))
    else:
        assert matching(NOT_HERE, command.text), f"no test runs '{command.text}'"
    if program == "python" and (source := source_of(command.words)) is not None:
        options = {word.split("=")[0] for word in arguments if word.startswith("--")}
        assert options <= set(re.findall(r"[\"'](--[\w-]+)[\"']", source.read_text())), command.text
    elif program == "pytest":
        assert [word for word in arguments if "/" in word and not (ROOT / word).exists()] == []
    elif program == "pip":
        declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
        for extras in re.findall(r"^\.\[(.*)\]$", "\n".join(arguments), flags=re.MULTILINE):
            assert set(extras.split(",")) <= declared.keys(), command.text


@pytest.mark.parametrize("command", COMMANDS.values(), ids=list(COMMANDS))
def test_command_is_understood(command, beside, monkeypatch):
    monkeypatch.chdir(beside)
    try:
        check(command)
    except click.UsageError as error:
        pytest.fail(f"{command.place}: {command.text}: {error.format_message()}; see the tables above")


def type_in(line):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", shlex.split(line))
        with pytest.raises(SystemExit) as end:
            main()
    assert end.value.code == 0, line


@pytest.fixture(scope="module")
def beside(tmp_path_factory):
    """Files that the pages assume: a robot, its draft, and runs."""
    folder = tmp_path_factory.mktemp("beside")
    robot = (ROOT / "urdf" / "mobile_manipulator.urdf").read_text().replace('"tip"', '"tool_link"')
    (folder / "my_robot.urdf").write_text(robot)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        without_waiting(patch)
        (folder / "my_robot.yaml").write_text(draft("my_robot.urdf", folder, DraftOptions()))
        type_in("rnc-pin run space-robot --set simulation.duration=0.02 --set comparisons={}")
    for name in ("a", "b"):
        shutil.copytree(folder / "runs" / "space-robot", folder / "runs" / name)
    return folder


def without_waiting(patch):
    """No pictures, no trial of a draft, and no wait for a browser that nobody opens."""
    from rnc_pin.applications.scenario.execution import Drawn

    patch.setattr("rnc_pin.applications.command_line.report.draw_pictures", lambda *_: Drawn())
    patch.setattr("rnc_pin.visualization.loop_view.LiveView.wait_for_browser", lambda *_: False)
    patch.setattr(scenario_candidate, "_PATIENCE", 0.0)


@pytest.mark.parametrize("command", RUN.values(), ids=list(RUN))
def test_command_runs(command, beside, call, tmp_path, monkeypatch):
    folder = tmp_path / "here"
    shutil.copytree(beside, folder)
    monkeypatch.chdir(folder)
    without_waiting(monkeypatch)
    arguments = with_help(command)
    if "--help" not in arguments:
        arguments += [word for more in matching(SHORTER, command.text) for word in more.split()]
    status, out, error = call(*arguments)
    assert status == 0, f"{command.place}: {command.text}: {error}"
    assert out or error


def test_commands_are_found_in_blocks_and_sentences():
    text = "Type `rnc-pin run NAME`, not `run` or ``rnc-pin nothing``.\n\n"
    text += "    pip install '.[dask]' && rnc-pin list  # x\n"
    text += "    F = m a\n\n```sh\nunknown --flag > file\n```\n\n```python\nrnc-pin = 1\n```\n"
    expected = ["rnc-pin run space-robot", "pip install .[dask]", "rnc-pin list", "unknown --flag"]
    assert [each.text for each in commands_of_text(text, "page.md")] == expected
