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

from rnc_pin.app.console import ProgressBar, print_json, print_report, print_spread, print_summary
from rnc_pin.errors import ConfigurationError, ModelWarning, RncError

_DONE, _FAILED, _USAGE = 0, 1, 2

_options = click.option("--set", "options", metavar="A.B=C", multiple=True, help="Replace a value of the scenario.")
_json = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of tables.")
_force = click.option("--force", is_flag=True, help="Write into a folder that rnc-pin did not make.")
_debug = click.option("--debug", is_flag=True, expose_value=False, help="Show a traceback with an error.")


def _showing(command: Any) -> Any:
    """The options of whatever can be watched."""
    options = (
        click.option("--show", is_flag=True, help="Show the robot in the browser, in real time."),
        click.option(
            "--speed", type=click.FloatRange(min=0), default=1.0, help="With --show: times real time; 0: no wait."
        ),
        click.option(
            "--browser/--no-browser", default=True, help="With --show: open the browser, or print the address."
        ),
        click.option("--host", default="127.0.0.1", help="With --show: listen here, so that others can watch."),
    )
    for option in reversed(options):
        command = option(command)
    return command


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
@_showing
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
    host: str,
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
    live = None
    if show:
        from rnc_pin.scenario.replay import view_of

        experiment = prepared.experiment
        title = experiment.scenario.title or prepared.name
        live = _live_view(
            experiment.reduced, view_of(experiment.scenario), experiment.notes, title, speed, browser, host
        )
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
@click.argument("sources", metavar="SOURCE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@_showing
@click.option("--html", type=click.Path(path_type=Path), help="Write it as one HTML file that plays offline.")
@click.option("--frames", type=click.Path(path_type=Path), help="Write one PNG a frame into this folder.")
@click.option("--video", type=click.Path(path_type=Path), help="Write an .mp4 or .gif; needs ffmpeg.")
@click.option("--rate", type=click.FloatRange(1, 60), default=25.0, help="Of frames and videos, per second.")
@click.option("--plot", type=click.Path(path_type=Path), help="Write plots: .png, .pdf, .svg, or interactive .html.")
@click.option("--aside", is_flag=True, help="Set the runs beside each other, not into each other.")
@_force
@_debug
def replay(
    sources: tuple[Path, ...],
    show: bool,
    speed: float,
    browser: bool,
    host: str,
    html: Path | None,
    frames: Path | None,
    video: Path | None,
    rate: float,
    plot: Path | None,
    aside: bool,
    force: bool,
) -> None:
    """Play runs again: folders that run wrote, or their trajectory.npz. Further ones are compared with the first."""
    from rnc_pin.scenario.replay import compared, load_run, record, view_of
    from rnc_pin.simulation import summarize

    runs = [load_run(source) for source in sources]
    first = runs[0]
    others = compared(runs)
    files = {"--html": html, "--video": video, "--plot": plot}
    for option, path in files.items():
        _check_new_file(option, path, force)
    if frames is not None and frames.exists() and (not frames.is_dir() or any(frames.iterdir())) and not force:
        raise ConfigurationError(f"--frames {frames}: is there and not empty; choose another name or add --force")
    try:
        if html is not None or frames is not None or video is not None:
            recording = record(runs, aside)
        if html is not None:
            recording.save(html)
            click.echo(f"wrote {html} ({html.stat().st_size / 1e6:.1f} MB)")
        if frames is not None:
            from rnc_pin.visualization.capture import write_frames

            click.echo(f"wrote {len(write_frames(recording, frames, rate))} frames into {frames}")
        if video is not None:
            from rnc_pin.visualization.capture import write_video

            click.echo(f"wrote {write_video(recording, video, rate)} ({video.stat().st_size / 1e6:.1f} MB)")
        if plot is not None:
            from rnc_pin.visualization.interactive import write_plots

            click.echo(f"wrote {write_plots(first.trajectory, plot, first.title, others)}")
    except OSError as error:
        raise ConfigurationError(f"{error.filename}: cannot be written: {error.strerror}") from None
    if show:
        from rnc_pin.visualization.state import recorded_states

        live = _live_view(
            first.reduced, view_of(first.scenario), first.trajectory.meta, first.title, speed, browser, host
        )
        try:
            for state in recorded_states(first.reduced.robot, first.trajectory, rate=60.0):
                live(state)
        except KeyboardInterrupt:
            pass
        finally:
            live.close()
    if not show and frames is None and not any(files.values()):
        for run in runs:
            print_summary(summarize(run.trajectory), run.source)


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


def _live_view(reduced: Any, view: Any, meta: Any, title: str, speed: float, browser: bool, host: str) -> Any:
    from rnc_pin.visualization.live import LiveView
    from rnc_pin.visualization.scene_server import is_loopback
    from rnc_pin.visualization.screens import chosen_screen

    if not is_loopback(host):
        click.echo(f"rnc-pin: warning: --host {host}: whoever reaches this computer there can watch", err=True)
    live = LiveView(reduced, view, meta, speed, browser, host, title, chosen_screen())
    click.echo(f"showing on {live.url}", err=True)
    try:
        live.wait_for_browser(10.0)
    except BaseException:
        live.close()
        raise
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


def _check_new_file(option: str, path: Path | None, force: bool) -> None:
    if path is None:
        return
    if path.is_dir() or not path.name:
        raise ConfigurationError(f"{option} {path}: is a folder, expected a file")
    if path.exists() and not force:
        raise ConfigurationError(f"{option} {path}: exists; choose another name or add --force")
    if not path.absolute().parent.is_dir():
        raise ConfigurationError(f"{option} {path}: there is no folder {path.absolute().parent}")


def _complain(message: str) -> None:
    click.echo(f"rnc-pin: error: {' '.join(message.split())}", err=True)


if __name__ == "__main__":
    main()
