"""YAML text of a drafted scenario, with remarks."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping
from typing import NotRequired, TypedDict

import yaml

from rnc_pin.applications.init.base_assumptions import BaseAssumptions, Entry
from rnc_pin.applications.init.decision import DraftDecision
from rnc_pin.applications.init.trial import Trial
from rnc_pin.errors import printable
from rnc_pin.io import Json
from rnc_pin.verdict import Severity

_WIDTH = 118
_WORDS = {Severity.FAILS: "NOT CONFIRMED", Severity.DEGRADES: "CHECK", Severity.NOTE: "Note"}


class DraftedOutputs(TypedDict):
    """Entries of the outputs."""

    reducing: list[Mapping[str, Json]]
    vertical: list[Mapping[str, Json]]


class DraftedStart(TypedDict):
    """Values of joints and rates of outputs at the start."""

    q: dict[str, float | list[float]]
    v2: NotRequired[dict[str, float]]


class Drafted(TypedDict):
    """Parts of a drafted scenario; constraints and actuators have a remark each."""

    robot: Mapping[str, Json]
    constraints: list[tuple[Entry, str]]
    actuators: list[tuple[Entry, str]]
    outputs: DraftedOutputs
    task: Mapping[str, Json]
    initial: DraftedStart
    view: Mapping[str, Json]
    reference: NotRequired[Mapping[str, Json]]
    controller: NotRequired[Mapping[str, Json]]
    simulation: NotRequired[Mapping[str, Json]]


def write_draft(
    name: str,
    scenario: Drafted,
    remark: str,
    trial: Trial,
    mobility: BaseAssumptions,
    decisions: Iterable[DraftDecision],
) -> str:
    """Return the text of a scenario file.

    Args:
        name: name of the robot.
        scenario: parts of the scenario.
        remark: remark on the controller.
        trial: result of the trial run.
        mobility: assumptions about the base.
        decisions: decisions behind them.
    """
    outputs = scenario["outputs"]
    lines = [
        *_remark(f"First draft for {name}, guessed from its file by rnc-pin init: read it before you believe it."),
        *(line for each in trial.verdict.findings for line in _remark(f"{_WORDS[each.severity]}: {each}.")),
        *(line for each in decisions for line in _remark(f"{_label(each)}: {each}.")),
        *(line for note in mobility.notes for line in _remark(f"Assumed: {note}.")),
        f"title: {_flow(f'First draft for {name}')}",
        *_remark(f"base {mobility.base or 'as in the file'}: {mobility.kind}"),
        f"robot: {_flow(scenario['robot'])}",
        *_entries("constraints", scenario["constraints"], _of_rows(scenario["constraints"])),
        *_entries("actuators", scenario["actuators"], "# joint torques and forces"),
        *(f"  # - {joint}  # uncomment it if it has a motor" for joint in mobility.idle if scenario["actuators"]),
        "outputs:",
        *_remark("one row for each degree of freedom that the constraints leave; controllers move these", "  "),
        *_entries("reducing", [(each, "") for each in outputs["reducing"]], "", "  "),
    ]
    if outputs["vertical"]:
        lines += [
            *_remark("these follow from the reducing outputs, and are monitored", "  "),
            *_entries("vertical", [(each, "") for each in outputs["vertical"]], "", "  "),
        ]
    lines.append(f"task: {_flow(scenario['task'])}")
    if scenario["initial"]["q"] or scenario["initial"].get("v2"):
        lines += [
            *_remark(
                "joints start in the shape of the path"
                if mobility.pose
                else "joints start at zero, or in the middle of limits that do not contain zero; loops start closed"
                if any("loop_closure" in entry for entry, _ in scenario["constraints"])
                else "joints start at zero, or in the middle of limits that do not contain zero"
            ),
            f"initial: {_flow(scenario['initial'])}",
        ]
    if "reference" in scenario:
        words = "displacements in the order of task.primary: m along the ground or a slide, rad for angles"
        lines += [*_remark(f"a slow motion, {words}"), f"reference: {_flow(scenario['reference'])}"]
    lines += [
        *_remark(remark),
        f"controller: {_flow(scenario['controller'])}",
        *_remark(trial.words),
        f"simulation: {_flow(scenario['simulation'])}",
        f"view: {_flow(scenario['view'])}",
    ]
    return "\n".join(lines) + "\n"


def _of_rows(constraints: list[tuple[Entry, str]]) -> str:
    """Remark on the constraints."""
    wheels = [entry.get("rolling_wheel") for entry, _ in constraints if isinstance(entry, Mapping)]
    shares = any(isinstance(wheel, Mapping) and wheel.get("lateral") is False for wheel in wheels)
    return "# A(q) v = 0" + ("; wheels of one axle line share a lateral row" if shares else "")


def _label(decision: DraftDecision) -> str:
    return "QUESTION" if decision.is_open else "Decided"


def _entries(key: str, entries: list[tuple[Entry, str]], remark: str, indent: str = "") -> list[str]:
    if not entries:
        return [f"{indent}{key}: []"]
    head = f"{indent}{key}:" + (f"  {remark}" if remark else "")
    return [head, *(f"{indent}  - {_flow(each)}" + (f"  # {said}" if said else "") for each, said in entries)]


def _remark(text: str, indent: str = "") -> list[str]:
    text = printable(text, longest=len(text))  # names come from files, and YAML refuses control characters
    return textwrap.wrap(text, _WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# ")


def _flow(value: object) -> str:
    text = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=10**6, allow_unicode=True)
    return text.removesuffix("\n").removesuffix("\n...")
