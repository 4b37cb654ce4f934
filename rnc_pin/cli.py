"""The command line: thin, one line for whatever is wrong."""

from __future__ import annotations

import sys
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from rnc_pin.console import ProgressBar, print_json, print_report, print_spread, print_summary
from rnc_pin.errors import ConfigurationError, ModelWarning, RncError

_DONE, _FAILED, _USAGE = 0, 1, 2

_options = click.option("--set", "options", metavar="A.B=C", multiple=True, help="Replace a value of the scenario.")
_json = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of tables.")
_force = click.option("--force", is_flag=True, help="Write into a folder that rnc-pin did not make.")
_debug = click.option("--debug", is_flag=True, expose_value=False, help="Show a traceback with an error.")


def main() -> None:
    """Entry point: exit status 0 done, 1 the run failed, 2 wrong usage or input."""
    try:
        with _told_warnings():
            status = cli.main(standalone_mode=False)
    except click.exceptions.Abort:
        _complain("interrupted")
        sys.exit(_FAILED)
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx else "rnc-pin"
        _complain(f"{' '.join(error.format_message().split()).rstrip('.')} (see '{command} --help')")
        sys.exit(_USAGE)
    except click.ClickException as error:
        _complain(error.format_message())
        sys.exit(_USAGE)
    except RncError as error:
        if "--debug" in sys.argv:
            traceback.print_exc()
        _complain(str(error))
        sys.exit(_USAGE)
    except BrokenPipeError:  # the reader of a pipe has seen enough
        sys.stderr.close()
        sys.exit(_FAILED)
    except Exception as error:
        if "--debug" in sys.argv:
            traceback.print_exc()
        _complain(f"unexpected {type(error).__name__}: {' '.join(str(error).split())} (--debug shows where)")
        sys.exit(_FAILED)
    sys.exit(status if isinstance(status, int) else _DONE)


@click.group(context_settings={"help_option_names": ["-h", "--help"]}, invoke_without_command=True)
@click.version_option(package_name="rnc_pin", prog_name="rnc-pin")
@_debug
@click.pass_context
def cli(context: click.Context) -> None:
    """Dynamics, redundancy and control of nonholonomic mechanical systems from a URDF."""
    if context.invoked_subcommand is None:
        raise click.UsageError(f"expected a command: {', '.join(cli.commands)}", context)


@cli.command("list")
@_json
@_debug
def list_scenarios(as_json: bool) -> None:
    """List the built-in scenarios."""
    from rnc_pin.scenario.loading import built_in_names, find_scenario, read_yaml

    titles = {name: read_yaml(find_scenario(name)).get("title") or "" for name in built_in_names()}
    if as_json:
        print_json(titles)
        return
    table = Table(box=None, pad_edge=False)
    table.add_column("scenario", style="bold")
    table.add_column("what it shows")
    for name, title in titles.items():
        table.add_row(name, title)
    Console().print(table)


@cli.command()
@click.argument("scenario")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for results; runs/SCENARIO by default.")
@_options
@click.option("--show", is_flag=True, help="Show the robot in the browser while it runs, in real time.")
@click.option("--speed", type=click.FloatRange(min=0), default=1.0, help="With --show: times real time; 0 for no wait.")
@click.option("--browser/--no-browser", default=True, help="With --show: open the browser, or only print the address.")
@_json
@_force
@_debug
def run(
    scenario: str,
    out: Path | None,
    options: tuple[str, ...],
    show: bool,
    speed: float,
    browser: bool,
    as_json: bool,
    force: bool,
) -> int:
    """Run a SCENARIO: a built-in name or a YAML file."""
    from rnc_pin.scenario.output import OutputFolder
    from rnc_pin.scenario.run import execute, plan, write

    prepared = plan(scenario, _parsed(options))
    folder = OutputFolder(out or Path("runs") / prepared.name, force)
    notes = Console(stderr=True)
    for warning in prepared.experiment.warnings:
        notes.print(f"rnc-pin: warning: {warning}", markup=False, highlight=False, soft_wrap=True)
    live = _live_view(prepared, speed, browser) if show else None
    try:
        with ProgressBar(notes, prepared.total_duration, f"{prepared.name}", quiet=as_json) as advance:
            result = execute(prepared, live, advance)
    finally:
        if live is not None:
            live.close()
    written = write(prepared, result, folder)
    result.summary["files"] = [path.name for path in written]
    if as_json:
        print_json(result.summary)
    else:
        print_summary(result.summary, folder.path)
    if result.summary["outcome"] != "completed":
        _complain(f"{result.error or 'interrupted'}; results so far are in {folder.path}")
    return _DONE if result.summary["outcome"] == "completed" else _FAILED


@cli.command()
@click.argument("system")
@_options
@click.option("--samples", type=click.IntRange(min=1), default=64, help="Sampled configurations.")
@click.option("--seed", type=int, default=0, help="Of the sampled configurations.")
@_json
@_debug
def inspect(system: str, options: tuple[str, ...], samples: int, seed: int, as_json: bool) -> None:
    """Say what a SYSTEM can do: rows, rank, actuation, redundancy class, Lemma 1."""
    from rnc_pin.analysis import analyze
    from rnc_pin.scenario.builder import build_reduced, build_task
    from rnc_pin.scenario.loading import find_scenario, read_yaml, validate, with_options

    path = find_scenario(system)
    checked = validate(with_options(read_yaml(path), _parsed(options)), path.name)
    built, reduced = build_reduced(checked, path.parent)
    task = build_task(checked, reduced)
    report = analyze(reduced, task.primary_names, task.redundant_names, samples, seed, task.vertical_names)
    content = {
        "system": system,
        "robot": built.robot.name,
        "joints": list(built.robot.joint_names),
        "reducing": list(reduced.reducing.names),
        "vertical": list(reduced.vertical.names),
        "actuators": list(reduced.actuation.names),
        "primary": list(task.primary_names),
        "redundant": list(task.redundant_names),
        **report.to_dict(),
    }
    if as_json:
        print_json(content)
    else:
        print_report(content)


@cli.command()
@click.argument("robot")
@click.option("--out", type=click.Path(path_type=Path), help="File to write; ROBOT.yaml in this folder by default.")
@click.option("--base", type=click.Choice(["fixed", "planar", "free"]), help="Instead of a guess.")
@click.option("--arg", "arguments", metavar="A=B", multiple=True, help="Argument of a xacro file.")
@click.option("--force", is_flag=True, help="Replace a file that exists.")
@_debug
def init(robot: str, out: Path | None, base: str | None, arguments: tuple[str, ...], force: bool) -> None:
    """Draft a scenario for a ROBOT: a URDF, xacro or MJCF file, or the name of an example."""
    from rnc_pin.scenario.draft import draft

    path = out or Path(Path(robot).name.split(".")[0] + ".yaml")
    if path.is_dir():
        raise ConfigurationError(f"--out {path}: is a folder, expected a file")
    own = path.exists() and path.resolve() == Path(robot).resolve()
    if path.exists() and not force and not own:
        raise ConfigurationError(f"--out {path}: exists; choose another name or add --force")
    if not path.absolute().parent.is_dir():
        raise ConfigurationError(f"--out {path}: there is no folder {path.absolute().parent}")
    text = draft(robot, path.parent, base, _parsed(arguments))
    if own:
        raise ConfigurationError(f"--out {path}: is the robot's own file; choose another name")
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"--out {path}: cannot be written: {error.strerror}") from None
    click.echo(f"wrote {path}: read it, then try: rnc-pin inspect {path}; rnc-pin run {path}")


@cli.command()
def schema() -> None:
    """Print the JSON Schema of scenario files, for editors."""
    from rnc_pin.scenario.json_schema import schema_text

    click.echo(schema_text(), nl=False)


@cli.command()
@click.argument("source", type=click.Path(path_type=Path))
@click.option("--show", is_flag=True, help="Play it in the browser.")
@click.option("--html", type=click.Path(path_type=Path), help="Write it as one HTML file.")
@click.option("--speed", type=click.FloatRange(min=0.01), default=1.0, help="With --show: times real time.")
@click.option("--browser/--no-browser", default=True, help="With --show: open the browser, or only print the address.")
@_force
@_debug
def replay(source: Path, show: bool, html: Path | None, speed: float, browser: bool, force: bool) -> None:
    """Play a run again: a folder that run wrote, or its trajectory.npz."""
    from rnc_pin.scenario.builder import build_system
    from rnc_pin.scenario.loading import validate
    from rnc_pin.simulation import Trajectory, summarize

    trajectory = Trajectory.load(source / "trajectory.npz" if source.is_dir() else source)
    if "config" not in trajectory.meta:
        raise ConfigurationError(f"{source}: has no scenario in it, so the robot is not known")
    scenario = validate(trajectory.meta["config"], str(source))
    robot = build_system(scenario, Path(str(trajectory.meta.get("folder", ".")))).robot
    if trajectory.q.shape[1] != robot.nq:
        raise ConfigurationError(f"{source}: configurations have {trajectory.q.shape[1]} entries, its robot {robot.nq}")
    if len(trajectory.time) < 2:
        raise ConfigurationError(f"{source}: holds {len(trajectory.time)} samples, nothing to play")
    view = scenario.view
    if html is not None:
        from rnc_pin.visualization.recording import record_html

        if html.is_dir() or not html.name:
            raise ConfigurationError(f"--html {html}: is a folder, expected a file")
        if html.exists() and not force:
            raise ConfigurationError(f"--html {html}: exists; choose another name or add --force")
        if not html.absolute().parent.is_dir():
            raise ConfigurationError(f"--html {html}: there is no folder {html.absolute().parent}")
        title = scenario.title or str(trajectory.meta.get("scenario"))
        try:
            record_html(robot, trajectory, html, view.trail, view.camera, view.target, view.ground, title)
        except OSError as error:
            raise ConfigurationError(f"--html {html}: cannot be written: {error.strerror}") from None
        click.echo(f"wrote {html}")
    if show:
        from rnc_pin.visualization.live import LiveView

        live = LiveView(robot, view.trail, view.camera, view.target, view.ground, speed, browser)
        click.echo(f"showing on {live.url}", err=True)
        live.wait_for_browser(10.0)
        try:
            for t, q in zip(trajectory.time, trajectory.q, strict=True):
                live(float(t), q)
        except KeyboardInterrupt:
            pass
        finally:
            live.close()
    if not show and html is None:
        print_summary(summarize(trajectory), source)


@cli.command()
@click.argument("scenario")
@click.option("--runs", type=click.IntRange(min=1), required=True, help="How many runs.")
@click.option("--jobs", type=int, default=1, help="Local processes; -1 for all cores.")
@click.option("--scheduler", metavar="ADDRESS", help="Dask scheduler to run on.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder for results.")
@_options
@_json
@_force
@_debug
def sweep(
    scenario: str,
    runs: int,
    jobs: int,
    scheduler: str | None,
    out: Path,
    options: tuple[str, ...],
    as_json: bool,
    force: bool,
) -> int:
    """Run a SCENARIO many times with values drawn from the ranges in its 'sweep'.

    A task that preflight speaks against is drawn again; '--set preflight=warn' runs it all the same.
    """
    from rnc_pin.scenario.output import OutputFolder
    from rnc_pin.scenario.sweep import drawn_keys, spread, write_table
    from rnc_pin.scenario.sweep import sweep as run_sweep

    if jobs == 0:
        raise ConfigurationError("--jobs 0: expected a number of processes, or -1 for all cores")
    parsed = _parsed(options)
    drawn_keys(scenario, parsed)
    folder = OutputFolder(out, force)
    rows: list[dict[str, Any]] = []
    with ProgressBar(Console(stderr=True), runs, f"{scenario} x {runs}", quiet=as_json) as advance:
        for row in run_sweep(scenario, parsed, runs, folder, jobs, scheduler):
            rows.append(row)
            advance(len(rows))
    write_table(rows, folder.file("sweep.csv"))
    summary = {"scenario": scenario, **spread(rows)}
    folder.write_json("sweep.json", summary)
    if as_json:
        print_json(summary)
    else:
        print_spread(summary, folder.path)
    return _DONE if summary["outcomes"].get("completed", 0) == runs else _FAILED


# ---------------------------------------------------------------------- what is shared


def _parsed(options: tuple[str, ...]) -> dict[str, Any]:
    from rnc_pin.scenario.loading import parse_option

    return dict(parse_option(option) for option in options)


def _live_view(prepared: Any, speed: float, browser: bool) -> Any:
    from rnc_pin.visualization.live import LiveView

    view = prepared.experiment.scenario.view
    robot = prepared.experiment.reduced.robot
    live = LiveView(robot, view.trail, view.camera, view.target, view.ground, speed, browser)
    click.echo(f"showing on {live.url}", err=True)
    live.wait_for_browser(10.0)
    return live


@contextmanager
def _told_warnings() -> Iterator[None]:
    """Say what a robot's file left open, once and in one line."""
    told: set[str] = set()
    with warnings.catch_warnings():
        usual = warnings.showwarning

        def tell(message: Any, category: Any, *rest: Any, **more: Any) -> None:
            if not issubclass(category, ModelWarning):
                usual(message, category, *rest, **more)
            elif str(message) not in told:
                told.add(str(message))
                click.echo(f"rnc-pin: warning: {' '.join(str(message).split())}", err=True)

        warnings.simplefilter("always", ModelWarning)
        warnings.showwarning = tell
        yield


def _complain(message: str) -> None:
    click.echo(f"rnc-pin: error: {' '.join(message.split())}", err=True)


if __name__ == "__main__":
    main()
