"""Commands that pages and messages tell people to type: each is understood, and each runs or says why it does not."""

import re
import shlex
import shutil
import subprocess
import sys
import tomllib

import click
import numpy as np
import pytest

from documented_commands import (
    EXPRESSIONS,
    LONG,
    NOT_HERE,
    PLACEHOLDERS,
    SHORTER,
    commands_of_messages,
    commands_of_pages,
    commands_of_text,
    documented_pages,
    inline_options,
    matching,
)
from places import ROOT
from rnc_pin.applications.command_line.cli import main
from rnc_pin.applications.command_line.usage import cli
from rnc_pin.applications.init import DraftOptions, draft, scenario_candidate

TABLES = "see the tables in tests/support/documented_commands.py"
COMMANDS = {}
for each in [*commands_of_pages(), *commands_of_messages()]:
    COMMANDS.setdefault(each.text, each)
RUN = {text: each for text, each in COMMANDS.items() if not matching(LONG, text) and not matching(NOT_HERE, text)}
SLOW = {text: each for text, each in COMMANDS.items() if matching(LONG, text) and not matching(NOT_HERE, text)}


def parametrized(commands):
    return pytest.mark.parametrize("command", commands.values(), ids=list(commands))


# ---------------------------------------------------------------------- every command is understood


def options_of_source(text):
    """Options that a script declares with argparse."""
    return set(re.findall(r"[\"'](--[\w-]+)[\"']", text))


def source_of(words):
    """File of a script or a module of this repository; None of other programs. ``benchmarks NAME`` runs ``NAME``."""
    name = words[2].replace(".", "/") if words[1] == "-m" else words[1]
    if name.split("/")[0] not in ("benchmarks", "docs", "tests", "tools"):
        return None
    names = [f"benchmarks/{words[3]}", name] if name == "benchmarks" and len(words) > 3 else [name]
    found = [path for each in names for path in (ROOT / each, ROOT / f"{each}.py", ROOT / each / "__main__.py")]
    return next((path for path in found if path.is_file()), found[0])


def with_help(command):
    """Arguments of rnc-pin. A mere name of a command, in a sentence, stands for its help."""
    arguments = list(command.words[1:])
    needed = [each for each in cli.commands.get(arguments[0], cli).params if each.required]
    interactive = arguments[0] == "drive"
    return [*arguments, "--help"] if command.inline and len(arguments) == 1 and (needed or interactive) else arguments


def check_rnc_pin(command):
    """Let Click parse the arguments, and run nothing."""
    arguments = with_help(command)
    if arguments[0].startswith("-"):
        return
    assert arguments[0] in cli.commands, f"{command.place}: no command '{arguments[0]}'"
    if "--help" not in arguments:
        cli.commands[arguments[0]].make_context(arguments[0], arguments[1:], parent=click.Context(cli))


def check_python(command):
    source = source_of(command.words)
    if source is None:
        assert matching(NOT_HERE, command.text), f"{command.place}: '{command.text}': {TABLES}"
        return
    assert source.is_file(), f"{command.place}: no file '{source.relative_to(ROOT)}'"
    given = {word.split("=")[0] for word in command.words if word.startswith("--")}
    assert given <= options_of_source(source.read_text()), f"{command.place}: {command.text}"


def check_pytest(command):
    for word in command.words[1:]:
        if "/" in word:
            assert (ROOT / word).exists(), f"{command.place}: no file '{word}'"


def check_pip(command):
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for extras in re.findall(r"^\.\[(.*)\]$", "\n".join(command.words), flags=re.MULTILINE):
        assert set(extras.split(",")) <= declared.keys(), f"{command.place}: {command.text}"


CHECKS = {"rnc-pin": check_rnc_pin, "python": check_python, "pytest": check_pytest, "pip": check_pip}


def check(command):
    program = command.words[0]
    known = program in CHECKS or matching(NOT_HERE, command.text) or matching(LONG, command.text)
    assert known, f"{command.place}: no test runs '{command.text}'; {TABLES}"
    if program in CHECKS:
        try:
            CHECKS[program](command)
        except click.UsageError as error:
            pytest.fail(f"{command.place}: {command.text}: {error.format_message()}; {TABLES}")


@parametrized(COMMANDS)
def test_command_is_understood(command, beside, monkeypatch):
    monkeypatch.chdir(beside)
    check(command)


@pytest.mark.parametrize("name", documented_pages())
def test_options_in_sentences_exist(name):
    """Options of rnc-pin, or of a script that the page names."""
    text = documented_pages()[name]
    known = {option for each in (cli, *cli.commands.values()) for one in each.params for option in one.opts}
    known |= {option for each in (cli, *cli.commands.values()) for one in each.params for option in one.secondary_opts}
    for command in commands_of_text(text, name):
        if command.words[0] == "python" and (source := source_of(command.words)) is not None and source.is_file():
            known |= options_of_source(source.read_text())
    assert set(inline_options(text)) <= known


def test_no_entry_of_a_table_is_left_over():
    texts = list(COMMANDS)
    for table in (LONG, NOT_HERE, SHORTER):
        assert [pattern for pattern in table if not any(re.match(pattern, text) for text in texts)] == []
    pages = "\n".join(documented_pages().values())
    assert [name for name in PLACEHOLDERS if name not in pages] == []
    sources = "\n".join(path.read_text() for path in (ROOT / "rnc_pin").rglob("*.py"))
    assert [name for name in EXPRESSIONS if f"{{{name}}}" not in sources] == []


# ---------------------------------------------------------------------- commands run


def type_in(line):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", shlex.split(line))
        with pytest.raises(SystemExit) as end:
            main()
    assert end.value.code == 0, line


@pytest.fixture(scope="module")
def beside(tmp_path_factory):
    """Files that the pages assume: a robot and its draft, runs, and the commands of a drive."""
    folder = tmp_path_factory.mktemp("beside")
    robot = (ROOT / "urdf" / "mobile_manipulator.urdf").read_text().replace('"tip"', '"tool_link"')
    (folder / "my_robot.urdf").write_text(robot)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        without_waiting(patch)
        (folder / "my_robot.yaml").write_text(draft("my_robot.urdf", folder, DraftOptions()))
        short = "--set simulation.duration=0.02 --set comparisons={}"
        type_in(f"rnc-pin run space-robot {short}")
        type_in("rnc-pin drive mobile-manipulator --duration 0.1 --no-browser --out runs/tiago-drive")
    write_log(folder)
    for name in ("a", "b"):
        shutil.copytree(folder / "runs" / "space-robot", folder / "runs" / name)
    return folder


def write_log(folder):
    """Log of a differential drive on a circle, with its mapping: wheels of 0.1 m, 0.4 m apart."""
    lines = ["time,left,right,x,y,yaw"]
    for k in range(300):
        t = 0.02 * k
        turn = 0.1 * (6 - 4) * t / 0.4
        x, y = np.sin(turn), 1 - np.cos(turn)  # 0.5 m/s and 0.5 rad/s: a radius of 1 m
        lines.append(f"{t},{4 * t},{6 * t},{x},{y},{turn}")
    (folder / "log.csv").write_text("\n".join(lines))
    (folder / "log.yaml").write_text(
        "joints: {left_wheel_joint: {position: left}, right_wheel_joint: {position: right}}\n"
        "frames: {base: {x: x, y: y, yaw: yaw}}\n"
    )


def without_waiting(patch):
    """No pictures, no trial of a draft, and no wait for a browser that nobody opens."""
    from rnc_pin.applications.scenario.pictures import Drawn

    patch.setattr("rnc_pin.applications.command_line.report.draw_pictures", lambda *_: Drawn())
    patch.setattr("rnc_pin.applications.sweep.results.draw_distributions", lambda *_: None)
    patch.setattr("rnc_pin.visualization.live.LiveView.wait_for_browser", lambda *_: False)
    patch.setattr(scenario_candidate, "_PATIENCE", 0.0)


@parametrized({text: each for text, each in RUN.items() if each.words[0] == "rnc-pin"})
def test_command_runs(command, beside, call, tmp_path, monkeypatch):
    folder = tmp_path / "here"
    shutil.copytree(beside, folder)
    monkeypatch.chdir(folder)
    without_waiting(monkeypatch)
    arguments = with_help(command)
    if not {"--help", "--replay"} & set(arguments):
        arguments += [word for more in matching(SHORTER, command.text) for word in more.split()]
    status, out, error = call(*arguments)
    assert status == 0, f"{command.place}: {command.text}: {error}"
    assert out or error


def test_every_other_command_is_in_a_table():
    """Only commands of rnc-pin run in this process; others need a reason."""
    assert [text for text, each in RUN.items() if each.words[0] != "rnc-pin"] == []


@pytest.mark.long
@parametrized(SLOW)
def test_long_command_runs(command, beside, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".git", ".*_cache", "__pycache__", "site", "runs"))
    shutil.copytree(beside, copy, dirs_exist_ok=True)
    words = [sys.executable if word == "python" else word for word in command.words]
    if words[0] == "rnc-pin":
        words = [sys.executable, "-m", "rnc_pin", *words[1:]]
        if words[3] == "drive":
            words += ["--duration", "1", "--no-browser"]
    elif words[0] == "pytest":
        words = [sys.executable, "-m", *words]
    done = subprocess.run(words, cwd=copy, capture_output=True, text=True)
    assert done.returncode == 0, f"{command.place}: {command.text}: {done.stdout[-2000:]}{done.stderr[-2000:]}"


# ---------------------------------------------------------------------- what counts as a command


def found(text):
    return [(each.text, each.place, each.inline) for each in commands_of_text(text, "page.md")]


def test_commands_are_found_in_blocks_and_sentences():
    text = (
        "Type `rnc-pin run NAME` or `RNC_PIN_KERNEL=c pytest tests/model`, not `run` or ``rnc-pin nothing``.\n\n"
        "    pip install '.[qp]' && rnc-pin list  # all\n    F = m a\n\n"
        "```sh\nunknown --flag > file\n```\n\n```python\nrnc-pin = 1\n```\n"
    )
    assert found(text) == [
        ("rnc-pin run space-robot", "page.md:1", True),
        ("pytest tests/model", "page.md:1", True),
        ("pip install .[qp]", "page.md:3", False),
        ("rnc-pin list", "page.md:3", False),
        ("unknown --flag", "page.md:7", False),
    ]


@pytest.mark.parametrize(("line", "words"), [
    ("rnc-pin run nothing --sett a=1", "No such option"),
    ("rnc-pin replya runs/a", "no command 'replya'"),
    ("rnc-pin sweep space-robot", "Missing option"),
    ("python -m benchmarks.mutation --sampel 3", "benchmarks.mutation --sampel 3"),
    ("python -m benchmarks.nothing", "no file 'benchmarks/nothing'"),
    ("pytest tests/nothing.py", "no file 'tests/nothing.py'"),
    ("pip install '.[nothing]'", "pip install .[nothing]"),
    ("ffmpeg -i a", "no test runs 'ffmpeg -i a'"),
])  # fmt: skip
def test_a_command_that_cannot_work_is_told(line, words):
    (command,) = commands_of_text(f"```sh\n{line}\n```\n", "page.md")
    with pytest.raises((AssertionError, pytest.fail.Exception), match=re.escape(words)):
        check(command)
