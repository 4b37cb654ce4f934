"""``rnc-pin calibrate``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import click
import yaml
from rich.console import Console

from rnc_pin.applications.command_line.commands.compare import MeasuredLog, print_path_errors
from rnc_pin.applications.command_line.messages import print_json
from rnc_pin.applications.command_line.tables import print_table
from rnc_pin.applications.scenario.files import parse_options, urdf_path, with_options
from rnc_pin.applications.scenario.output_folder import OutputFolder
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.errors import ConfigurationError
from rnc_pin.identification import Calibration, calibrate, compare, named_numbers
from rnc_pin.identification.logs import LogMapping
from rnc_pin.io import Json, dump_json

_SCENARIO, _URDF, _MAPPING, _REPORT = "scenario.yaml", "robot.urdf", "mapping.yaml", "calibration.json"


@dataclass(frozen=True)
class CalibrationChoice:
    """Numbers to estimate, and the folder for the result."""

    estimate: tuple[str, ...]
    held_out: float
    out: Path | None
    force: bool


def calibrate_log(
    system: str,
    measured: MeasuredLog,
    heading: bool,
    options: tuple[str, ...],
    choice: CalibrationChoice,
    as_json: bool,
) -> None:
    """Print the calibration of a scenario's robot, and write the scenario with the new numbers."""
    scenario = Scenario.load(system, parse_options(options))
    log, sensor, given = measured.log, measured.sensor, scenario.model.system
    names = choice.estimate or [each.name for each in compare(given, log, sensor, heading=heading).suspects]
    if not names:
        raise ConfigurationError(
            f"{measured.path}: no number explains the difference from {system}; name what to estimate: --estimate NAME"
        )
    unknown = named_numbers(names, given, log, sensor)
    found = calibrate(given, log, unknown, sensor, held_out=choice.held_out, heading=heading)
    content = _content(system, measured.path, found)
    written = None if choice.out is None else _write(scenario, measured, found, content, choice)
    if as_json:
        print_json({**content, "written": written})
        return
    _print(system, measured.path, found)
    if written is not None:
        click.echo(f"wrote {', '.join(written)} into {choice.out}")


def _content(system: str, log: Path, found: Calibration) -> dict[str, Json]:
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


def _write(
    scenario: Scenario, measured: MeasuredLog, found: Calibration, content: dict[str, Json], choice: CalibrationChoice
) -> list[str]:
    """Write the scenario and the files that it needs; return their names."""
    assert choice.out is not None
    with OutputFolder(choice.out, choice.force, (_SCENARIO, _URDF, _MAPPING, _REPORT)) as folder:
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


# ---------------------------------------------------------------------- text


def _print(system: str, log: Path, found: Calibration) -> None:
    console = Console(markup=False, emoji=False)
    click.echo(f"{system} calibrated with {log}\n")
    rows = []
    for name, unit, *values in zip(found.names, found.units, found.nominal, found.values, found.std, strict=True):
        figures = zip(values, (6, 6, 2), strict=True)
        rows.append((name, *(f"{each:.{digits}g} {unit}".strip() for each, digits in figures)))
    print_table(console, "numbers", ("number", "file", "estimate", "standard deviation"), rows)
    print_path_errors(console, "with", found.errors)
    words, deviation = found.combinations[0]
    click.echo(f"worst known: {words}, standard deviation {deviation:.2g} of its size")
    if len(found.outliers):
        click.echo(f"{len(found.outliers)} poses are more than five standard deviations away")
    if found.unused_rows:
        click.echo(f"rows of joints that are not measured: {', '.join(found.unused_rows)}")
