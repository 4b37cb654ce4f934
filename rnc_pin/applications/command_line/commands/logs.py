"""``rnc-pin compare`` and ``rnc-pin calibrate``.

The first puts a measured log beside a model, in numbers, plots, and a page with the robot as a ghost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import click
import numpy as np
import yaml
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rnc_pin.applications.command_line.messages import print_json
from rnc_pin.applications.command_line.report import print_object
from rnc_pin.applications.scenario.files import parse_options, urdf_path, with_options
from rnc_pin.applications.scenario.output_folder import OutputFolder
from rnc_pin.applications.scenario.pictures import ANIMATION
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.errors import ConfigurationError
from rnc_pin.figures import (
    MAX_LINES,
    GroundPath,
    GroundPaths,
    Labels,
    LegendEntry,
    Panel,
    PlaneView,
    Series,
    Sheet,
    Size,
    draw_paths,
    panel_figure,
    save,
)
from rnc_pin.identification import Calibration, Comparison, calibrate, compare, named_numbers
from rnc_pin.identification.logs import Log, LogMapping
from rnc_pin.io import Json, dump_json
from rnc_pin.simulation import Trajectory
from rnc_pin.visualization import Recording

_NAME = "comparison"


@dataclass(frozen=True)
class MeasuredLog:
    """Measured log of the command line.

    Attributes:
        path: the file or folder.
        mapping: its mapping; None for a file of ``Log.save``.
        log: the log.
        sensor: frame whose pose is measured.
        heading: True if the sensor measures its heading.
    """

    path: Path
    mapping: Path | None
    log: Log
    sensor: str
    heading: bool


def read_measured(path: Path, mapping: Path | None, sensor: str | None, heading: bool) -> MeasuredLog:
    """Read a log; its sensor is the only frame with poses if none is named."""
    log = _read(path, mapping)
    frames = log.names("pose")
    if sensor is None and len(frames) != 1:
        found = ", ".join(frames) or "none"
        raise ConfigurationError(f"{path}: expected the pose of one frame, found {found}; choose one: --sensor FRAME")
    return MeasuredLog(path, mapping, log, sensor or frames[0], heading)


def _read(path: Path, mapping: Path | None) -> Log:
    saved = path.suffix.lower() == ".npz"
    if mapping is not None:
        keys = LogMapping.of(mapping)
        only_corrections = not (keys.joints or keys.frames or keys.topics)
        return Log.load(path).corrected(keys.corrections) if saved and only_corrections else Log.read(path, keys)
    if saved:
        return Log.load(path)
    raise ConfigurationError(f"{path}: give the columns or topics of joints and frames: --mapping FILE")


def _tell(
    found: Calibration | Comparison,
    title: str,
    content: dict[str, Json],
    written: list[str] | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Print a result as JSON, or as a table, and the names of its files."""
    if as_json:
        print_json({**content, "written": written})
        return
    print_object(found, title)
    if written is not None:
        click.echo(f"wrote {', '.join(written)} into {out}")


def compare_log(
    system: str,
    measured: MeasuredLog,
    speeds: bool,
    options: tuple[str, ...],
    out: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Print a measured log beside the model of a scenario, and write its plots and page."""
    scenario = Scenario.load(system, parse_options(options))
    found = compare(scenario.model.system, measured.log, measured.sensor, heading=measured.heading, speeds=speeds)
    content = _comparison_content(system, measured.path, found)
    written = None if out is None else _write_comparison(scenario, found, content, out, force)
    _tell(found, f"{measured.path} beside {system}: {found.conclusion}", content, written, out, as_json)


# ---------------------------------------------------------------------- files


def _write_comparison(
    scenario: Scenario, found: Comparison, content: dict[str, Json], out: Path, force: bool
) -> list[str]:
    """Write the report, the plots and the page; return their names."""
    figures = scenario.content.figures
    plots = [f"{_NAME}.{each}" for each in figures.formats]
    with OutputFolder(out, force, (f"{_NAME}.json", *plots, ANIMATION)) as folder:
        with folder.writing() as fresh:
            (fresh / f"{_NAME}.json").write_text(dump_json(content) + "\n", encoding="utf-8")
            figure = _plot(found, figures.size, Labels(figures.labels))
            for name in plots:
                save(figure, fresh / name)
            names = [f"{_NAME}.json", *plots]
            if scenario.robot.drawn_geometry is not None:
                _record(scenario, found).save(fresh / ANIMATION)
                names.append(ANIMATION)
        folder.keep()
    return names


def _comparison_content(system: str, log: Path, found: Comparison) -> dict[str, Json]:
    return {
        "system": system,
        "log": str(log),
        "conclusion": found.conclusion,
        "errors": [
            {"window": None if np.isinf(duration) else duration, **asdict(error)}
            for duration, error in found.errors.items()
        ],
        "slip": dict(found.slip),
        "assumption": found.first.assumption if found.first else None,
        "suspects": [{**asdict(each), "assumption": each.assumption} for each in found.suspects],
        "unused_rows": list(found.unused_rows),
    }


def _plot(found: Comparison, size: Size | None, labels: Labels) -> Figure:
    """Plot paths from above, their distance, and slip of the rows."""
    replay = found.replay
    paths = GroundPaths(
        [GroundPath("base", replay.predicted[:, :2])],
        compared={"measured": [GroundPath("base", replay.measured[:, :2])]},
    )

    def draw(axes: Axes) -> Sequence[LegendEntry]:
        return draw_paths(axes, paths, labels, "predicted")

    slip = [Series(name, values, time=time) for name, (time, values) in replay.slip.items() if name in found.slip]
    panels = [Panel("distance", "m", (Series("distance", replay.error),), bottom=0.0)]
    panels += [Panel("slip", "m/s", tuple(slip[k : k + MAX_LINES]), zero=True) for k in range(0, len(slip), MAX_LINES)]
    view = PlaneView(draw, paths.aspect())
    return panel_figure(panels, replay.time, Sheet.of(size), title=found.conclusion, labels=labels, view=view)


def _record(scenario: Scenario, found: Comparison) -> Recording:
    """Return the animation of the predicted motion, with the measured robot as a ghost."""
    title = f"{scenario.content.title or scenario.name}: prediction of the model"
    replay, robot, options = found.replay, scenario.robot, scenario.content.view
    model = robot.model
    base, measured = model.joints[1].idx_q, replay.q.copy()
    x, y, heading = replay.measured.T
    measured[:, base : base + 4] = np.column_stack([x, y, np.cos(heading), np.sin(heading)])
    predicted, ghost = (
        Trajectory.of_motion(robot, replay.time - replay.time[0], motion) for motion in (replay.q, measured)
    )
    bodies = (each.name for each in model.frames if each.parentJoint == 1 and each.name != "root_joint")
    options = replace(options, trail=options.trail or [*bodies][:1])
    return Recording(robot, predicted, options, title, {"measured": ghost})


_SCENARIO, _URDF, _MAPPING, _REPORT = "scenario.yaml", "robot.urdf", "mapping.yaml", "calibration.json"


def calibrate_log(
    system: str,
    measured: MeasuredLog,
    estimate: tuple[str, ...],
    held_out: float,
    options: tuple[str, ...],
    out: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Print the calibration of a scenario's robot, and write the scenario with the new numbers."""
    scenario = Scenario.load(system, parse_options(options))
    log, sensor, heading, given = measured.log, measured.sensor, measured.heading, scenario.model.system
    names = estimate or [each.name for each in compare(given, log, sensor, heading=heading).suspects]
    if not names:
        raise ConfigurationError(
            f"{measured.path}: no number explains the difference from {system}; name what to estimate: --estimate NAME"
        )
    unknown = named_numbers(names, given, log, sensor)
    found = calibrate(given, log, unknown, sensor, held_out=held_out, heading=heading)
    content = _calibration_content(system, measured.path, found)
    written = None if out is None else _write_calibration(scenario, measured, found, content, out, force)
    _tell(found, f"{system} calibrated with {measured.path}", content, written, out, as_json)


def _calibration_content(system: str, log: Path, found: Calibration) -> dict[str, Json]:
    return {
        "system": system,
        "log": str(log),
        "parameters": [
            {"name": name, "unit": unit, "file": before, "value": value, "std": std}
            for name, unit, before, value, std in zip(
                found.names, found.units, found.nominal.tolist(), found.values.tolist(), found.std.tolist(), strict=True
            )
        ],
        "covariance": found.covariance.tolist(),
        "errors": {name: asdict(error) for name, error in found.errors.items()},
        "combinations": [{"words": words, "std": std} for words, std in found.combinations],
        "outliers": found.outliers.tolist(),
        "unused_rows": list(found.unused_rows),
    }


# ---------------------------------------------------------------------- files


def _write_calibration(
    scenario: Scenario, measured: MeasuredLog, found: Calibration, content: dict[str, Json], out: Path, force: bool
) -> list[str]:
    """Write the scenario and the files that it needs; return their names."""
    with OutputFolder(out, force, (_SCENARIO, _URDF, _MAPPING, _REPORT)) as folder:
        with folder.writing() as fresh:
            raw = with_options(scenario.raw, _new_radii(scenario, found))
            if found.has_new_places:
                source = _writable_urdf(scenario)
                found.write_urdf(source, fresh / _URDF)
                kept = {key: value for key, value in _entry(raw).items() if key not in ("urdf", "example")}
                packages = [*_packages(scenario), str(source.parent)]
                raw["robot"] = {"urdf": _URDF, **kept, "package_dirs": list(dict.fromkeys(packages))}
            elif "urdf" in _entry(raw):
                raw["robot"] = {**_entry(raw), "urdf": str(urdf_path(_entry(raw), scenario.folder))}
            (fresh / _SCENARIO).write_text(yaml.safe_dump(raw, sort_keys=False), encoding="utf-8")
            if found.corrections:
                text = yaml.safe_dump(_mapping(measured, found), sort_keys=False)
                (fresh / _MAPPING).write_text(text, encoding="utf-8")
            (fresh / _REPORT).write_text(dump_json(content) + "\n", encoding="utf-8")
            names = sorted(each.name for each in fresh.iterdir() if not each.name.startswith("."))
        folder.keep()
    return names


def _new_radii(scenario: Scenario, found: Calibration) -> dict[str, Json]:
    """Options with the radii that a calibration changed."""
    constraints = scenario.raw.get("constraints")
    entries = constraints if isinstance(constraints, list) else []
    before, after = scenario.model.system.kinds, found.system.kinds
    changed: dict[str, Json] = {}
    for index, (old, new) in enumerate(zip(before, after, strict=True)):
        radius = getattr(new, "radius", None)
        if radius is not None and radius != getattr(old, "radius", None):
            entry = entries[index] if index < len(entries) else None
            if not isinstance(entry, Mapping) or len(entry) != 1:
                raise ConfigurationError(f"constraints.{index}: expected one kind with a radius, found {entry!r}")
            changed[f"constraints.{index}.{next(iter(entry))}.radius"] = float(radius)
    return changed


def _entry(raw: Mapping[str, Json]) -> dict[str, Json]:
    robot = raw["robot"]
    assert isinstance(robot, dict)
    return robot


def _packages(scenario: Scenario) -> list[str]:
    return [str((scenario.folder / each).resolve()) for each in scenario.content.robot.package_dirs]


def _writable_urdf(scenario: Scenario) -> Path:
    """URDF of a scenario's robot."""
    path, robot = urdf_path(_entry(scenario.raw), scenario.folder), scenario.content.robot
    if path is None or path.suffix == ".xacro":
        raise ConfigurationError(
            f"{robot.mjcf or robot.urdf}: places of joints can be written into a URDF only; remove --out, "
            "and put the printed numbers into the file"
        )
    return path


def _mapping(measured: MeasuredLog, found: Calibration) -> dict[str, Json]:
    """Keys of the log's mapping, with the corrections of the calibration after those that it has."""
    keys = LogMapping() if measured.mapping is None else LogMapping.of(measured.mapping)
    corrections = dict(keys.corrections)
    for name, each in found.corrections.items():
        corrections[name] = each.after(corrections[name]) if name in corrections else each
    content: dict[str, Json] = keys.model_dump(mode="json", exclude_unset=True)
    said = {name: each.model_dump(exclude_defaults=True) for name, each in corrections.items()}
    return {**content, "corrections": {name: each for name, each in said.items() if each}}
