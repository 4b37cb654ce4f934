"""Entry point of ``rnc-pin``, and the Click definitions of its commands, arguments, options and help.

Help and shell completion need only this module, so it imports little besides Click. The other modules of its
room implement the commands. An error is one line and an exit status, and so is Ctrl-C during imports.
"""

import time

_STARTED = [time.perf_counter()]  # before anything else is imported

from rnc_pin.interruption import endings_as_ctrl_c, ignore_endings, interruptible_imports  # noqa: E402

with interruptible_imports():
    import gc
    import os
    import sys
    import traceback
    import warnings
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any, NoReturn, TypeAlias, TypeVar

    import click
    from click.shell_completion import CompletionItem

    from rnc_pin.applications import command_line as commands
    from rnc_pin.applications.command_line import messages
    from rnc_pin.applications.scenario.files import built_in_names, find_scenario, read_yaml
    from rnc_pin.errors import RncError

Given: TypeAlias = Any
"""Argument from Click; the functions of the commands declare the types."""


def _files(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    # The shell itself completes paths: it is only told to do so.
    return [CompletionItem(incomplete, type="file")]


def _scenarios(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    names = [CompletionItem(name) for name in built_in_names() if name.startswith(incomplete)]
    return [*_files(context, parameter, incomplete), *names]  # names last: bash drops entries before files


_scenario = click.argument("scenario", shell_complete=_scenarios)
_options = click.option("--set", "options", metavar="A.B=C", multiple=True, help="Replace a value of the scenario.")
_PATH = click.Path(path_type=Path)
_Command = TypeVar("_Command", bound=Callable[..., object])
_json = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of tables.")
_force = click.option("--force", is_flag=True, help="Write into a folder that rnc-pin did not create.")
_debug = click.option("--debug", is_flag=True, expose_value=False, help="Show a traceback with an error.")


def _imported(function: Callable[[], _Command]) -> _Command:
    """Return the function of a command, which is imported by its name."""
    with interruptible_imports():
        return function()


def _print_version(context: click.Context, parameter: click.Parameter, asked: bool) -> None:
    # Completion parses a line without running it.
    if asked and not context.resilient_parsing:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the line says it
            from rnc_pin._kernel import kernel, outdated
        from rnc_pin.version import __version__

        why = f" ({outdated})" if outdated else ""
        click.echo(f"rnc-pin, version {__version__}, kernel {kernel}{why}")
        context.exit()


def _all(*options: Callable[[_Command], _Command]) -> Callable[[_Command], _Command]:
    """Decorator that adds arguments and options in this order."""

    def add(command: _Command) -> _Command:
        # Decorators apply from the bottom up, and help lists options from the top down.
        for option in reversed(options):
            command = option(command)
        return command

    return add


_showing = _all(
    click.option("--show", is_flag=True, help="Show the robot in the browser, in real time."),
    click.option(
        "--speed", type=click.FloatRange(min=0), default=1.0, help="With --show: times real time; 0: no wait."
    ),
    click.option("--browser/--no-browser", default=True, help="With --show: open the browser, or print the address."),
    click.option("--host", default="127.0.0.1", help="With --show: listen address; a public one lets others watch."),
)
"""Options of the live view."""
_written = _all(_json, _force, _debug)
_robot = _all(
    click.option("--arg", "arguments", metavar="A=B", multiple=True, help="Argument of a xacro file."),
    click.option(
        "--package-dir",
        "package_dirs",
        metavar="FOLDER",
        multiple=True,
        type=click.Path(path_type=Path, exists=True, file_okay=False),
        help="Further folder for files of the robot: a package, a folder of packages, or any other.",
    ),
)
"""Options of a robot's file."""


_HELP = {"help_option_names": ["-h", "--help"]}
"""Settings of every command: Click keeps the first help option that it makes, with a parent or without."""


@click.group(context_settings=_HELP, invoke_without_command=True)
@click.option(
    "--version", is_flag=True, expose_value=False, is_eager=True, callback=_print_version, help="Show the version."
)
@_debug
@click.pass_context
def cli(context: click.Context) -> None:
    """Dynamics, redundancy and control of nonholonomic mechanical systems from a URDF."""
    # An error and not the help: a script that lost its command should notice.
    if context.invoked_subcommand is None:
        raise click.UsageError(f"expected a command: {', '.join(cli.commands)}", context)


@cli.command("list", context_settings=_HELP)
@_json
@_debug
def list_scenarios(as_json: bool) -> None:
    """List the built-in scenarios."""
    titles = {name: read_yaml(find_scenario(name)).get("title") or "" for name in built_in_names()}
    if as_json:
        messages.print_json(titles)
        return
    for name, title in titles.items():
        click.echo(f"{name:<{max(map(len, titles))}}  {title}")


@cli.command("run", context_settings=_HELP)
@_scenario
@click.option("--out", type=_PATH, help="Folder for results; runs/SCENARIO by default.")
@_options
@_showing
@_written
def run_command(**given: Given) -> int:
    """Run a SCENARIO: a built-in name or a YAML file."""
    find_scenario(given["scenario"])
    messages.announce(f"{given['scenario']}: reading the scenario", given["as_json"])
    return _imported(lambda: commands.run_scenario)(**given)


@cli.command(context_settings=_HELP)
@click.argument("source", metavar="SCENARIO|ROBOT", shell_complete=_scenarios)
@click.option("--out", type=_PATH, help="Folder for results; runs/SCENARIO-drive by default.")
@_options
@click.option(
    "--frame", "frames", metavar="FRAME", multiple=True, help="Frame that can have a goal; guessed by default."
)
@_robot
@click.option("--duration", type=click.FloatRange(min=0, min_open=True), help="End after this time [s].")
@click.option("--browser/--no-browser", default=True, help="Open the browser, or print the address only.")
@_written
def drive(**given: Given) -> int:
    """Drive a robot in real time from the browser: a SCENARIO or a ROBOT's file or name.

    Accelerations are those that the efforts and masses of the model allow, and links keep apart.

    Arrow keys or W A S D drive the base, a click on the ground sets a goal, and sliders move joints. Space stops.
    """
    # Before the imports, which take a second: the terminal is not silent.
    messages.announce(f"{given['source']}: preparing the drive", quiet=True)
    return _imported(lambda: commands.drive_robot)(**given)


@cli.command(context_settings=_HELP)
@click.argument("system", shell_complete=_scenarios)
@_options
@click.option("--samples", type=click.IntRange(min=1), default=64, help="Sampled configurations.")
@click.option("--seed", type=int, default=0, help="Random seed of the sampled configurations.")
@_json
@_debug
def inspect(**given: Given) -> None:
    """Analyze a SYSTEM: motions, constraint rows, actuation, redundancy and singularities."""
    find_scenario(given["system"])
    messages.announce(f"{given['system']}: analyzing the system", quiet=True)
    _imported(lambda: commands.inspect_system)(**given)


@cli.command(context_settings=_HELP)
@click.argument("system", shell_complete=_scenarios)
@_options
@click.option("--primary", metavar="A,B", help="Primary outputs; by default the scenario's own, then each tip.")
@click.option("--write", type=_PATH, metavar="FILE", help="Write the scenario of a row, after a trial run.")
@click.option("--row", type=click.IntRange(min=1), help="With --write: this row; the best one by default.")
@_json
@_debug
def explore(**given: Given) -> int | None:
    """Tell what the redundancy of a SYSTEM can do while its primary outputs rest, best use first."""
    find_scenario(given["system"])
    messages.announce(f"{given['system']}: exploring the redundancy", quiet=True)
    return _imported(lambda: commands.explore_system)(**given)


@cli.command(context_settings=_HELP)
@click.argument("robot", shell_complete=_files)
@click.option("--out", type=_PATH, help="File to write; ROBOT.yaml in this folder by default.")
@click.option("--base", type=click.Choice(["fixed", "planar", "free"]), help="Base type; guessed by default.")
@_robot
@click.option("--lock", metavar="JOINT[=VALUE]", multiple=True, help="Lock a joint at zero or at a value [rad or m].")
@click.option("--driven", metavar="JOINT", multiple=True, help="A joint with a motor.")
@click.option("--passive", metavar="JOINT", multiple=True, help="A joint without a motor.")
@click.option("--balance/--no-balance", default=None, help="Whether a base on two wheels balances.")
@click.option("--rollers/--no-rollers", default=None, help="Whether the wheels have rollers, such as Mecanum wheels.")
@click.option("--force", is_flag=True, help="Replace an existing file.")
@_debug
def init(**given: Given) -> None:
    """Draft a scenario for a ROBOT: a URDF, xacro or MJCF file, or the name of an example."""
    messages.announce(f"{given['robot']}: reading the robot and testing a scenario for it", quiet=True)
    _imported(lambda: commands.draft_scenario)(**given)


@cli.command(context_settings=_HELP)
def schema() -> None:
    """Print the JSON Schema of scenario files, for editors."""
    _imported(lambda: commands.print_schema)()


@cli.command(context_settings=_HELP)
@click.argument("sources", metavar="SOURCE...", nargs=-1, required=True, type=_PATH)
@_showing
@click.option("--html", type=_PATH, help="Write one HTML file that plays offline.")
@click.option("--video", type=_PATH, help="Write an .mp4 or .gif; needs ffmpeg.")
@click.option("--rate", type=click.FloatRange(1, 60), default=25.0, help="Frames per second of a video.")
@_force
@_debug
def replay(**given: Given) -> int:
    """Replay runs: folders of ``run``, or their trajectory.npz. Further runs are compared with the first."""
    messages.announce(f"{', '.join(map(str, given['sources']))}: reading", quiet=True)
    return _imported(lambda: commands.replay_runs)(**given)


@cli.command(context_settings=_HELP)
@click.argument("source", type=_PATH)
@click.argument("file", type=_PATH)
@click.option("--array", "arrays", metavar="NAME", multiple=True, help="An array, such as x2 or T; all by default.")
@click.option("--force", is_flag=True, help="Replace an existing file.")
@_debug
def export(**given: Given) -> None:
    """Write a run, a folder of ``run`` or its trajectory.npz, as a FILE.csv with names and units."""
    _imported(lambda: commands.export_file)(**given)


@cli.command(context_settings=_HELP)
@_scenario
@click.option("--runs", type=click.IntRange(min=1), required=True, help="Number of runs.")
@click.option("--jobs", type=int, default=1, help="Local processes; -1 for all cores.")
@click.option("--scheduler", metavar="ADDRESS", help="Dask scheduler to run on.")
@click.option("--out", type=_PATH, required=True, help="Folder for results.")
@_options
@_written
def sweep(**given: Given) -> int:
    """Run a SCENARIO many times with values drawn from the distributions in its 'sweep'.

    A task that fails preflight is drawn again; '--set preflight=warn' runs it anyway. If the command is killed, the
    same command continues.
    """
    find_scenario(given["scenario"])
    messages.announce(f"{given['scenario']}: reading the scenario", given["as_json"])
    # ``sweep`` takes either as ``jobs``; the command line has a number and an address.
    scheduler = given.pop("scheduler")
    return _imported(lambda: commands.sweep_scenario)(**{**given, "jobs": scheduler or given["jobs"]})


# ------------------------------------------------------------------ entry point


def main() -> None:
    """Run the command line. Exit status: 0 success, 1 failed run, 2 wrong usage or input."""
    # At a second call in one process the imports are done already.
    started = _STARTED.pop() if _STARTED else time.perf_counter()
    if sys.stdout is None:  # the next file that is opened would take its place
        _end(messages.USAGE, "standard output is closed: redirect it, e.g. to /dev/null")
    try:
        with endings_as_ctrl_c(), messages.told_warnings():
            # Not standalone: Click would print errors in its own form, and end the process itself.
            status = cli.main(standalone_mode=False, obj=started)
            sys.stdout.flush()
    except click.exceptions.Abort:
        _end(messages.FAILED, "interrupted")
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx else "rnc-pin"
        _end(messages.USAGE, f"{' '.join(error.format_message().split()).rstrip('.')} (see '{command} --help')")
    except click.ClickException as error:
        _end(messages.USAGE, error.format_message())
    except BrokenPipeError:  # the reader of the pipe has closed it
        sys.stderr.close()
        sys.exit(messages.FAILED)
    except Exception as error:
        if "--debug" in sys.argv:
            traceback.print_exc()
        if isinstance(error, RncError):
            _end(messages.USAGE, str(error))
        _end(messages.FAILED, _unexpected(error))
    sys.exit(status if isinstance(status, int) else messages.DONE)


def _end(status: int, message: str) -> NoReturn:
    messages.complain(message)
    sys.exit(status)


def _unexpected(error: Exception) -> str:
    """Message of an error that is none of the package, or of a standard output that is full."""
    try:
        if isinstance(error, OSError) and error.filename is None:
            print(flush=True)  # this fails again if standard output is full, and no file
    except OSError as full:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 (Python would write the rest at its end)
        return f"standard output cannot be written: {full.strerror}"
    return f"unexpected {type(error).__name__}: {' '.join(str(error).split())} (--debug shows where)"


def run() -> None:
    """Run the command line in a process of its own. A signal after the command does not change its status."""
    gc.set_threshold(200_000)  # what imports and runs make lives to the end: collections find little
    try:
        with endings_as_ctrl_c():  # until they are ignored
            try:
                main()
            finally:
                ignore_endings()
                if "ompl" not in sys.modules:  # its bindings print all that is left as leaked
                    gc.freeze()  # a collection at the exit would take as long as writing a run
    except KeyboardInterrupt:  # it came between the command and the end
        sys.exit(messages.FAILED)


if __name__ == "__main__":
    run()
