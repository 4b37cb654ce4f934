"""``rnc-pin inspect``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress

from rich.console import Console

from rnc_pin.analysis import Report, Singularity, analyze
from rnc_pin.applications.command_line.messages import print_json, warn
from rnc_pin.applications.command_line.report import print_object
from rnc_pin.applications.scenario.files import parse_options
from rnc_pin.applications.scenario.plant_builder import start_findings, warnings_of
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.errors import RncError
from rnc_pin.model import Phrases, ReducedModel, Task
from rnc_pin.printing import counted, items
from rnc_pin.verdict import Finding

_BASES = {"JointModelPlanar": "moves in the plane", "JointModelFreeFlyer": "moves freely in space"}
_FEW = 4  # names listed in a sentence


def sentences(reduced: ReducedModel, report: Report) -> tuple[str, str, str]:
    """Describe a system in three sentences.

    Args:
        reduced: reduced model of the system.
        report: result of ``analyze``.
    """
    phrases = [place.block.phrases() for place in reduced.all_constraints.places]
    motions = _motions(report, reduced.reducing.names)
    return _kind(reduced, phrases), motions, _limits(reduced, _prevented(phrases), report)


def _kind(reduced: ReducedModel, phrases: Sequence[Phrases]) -> str:
    robot, model = reduced.robot, reduced.robot.model
    roots = [_BASES.get(model.joints[k].shortname(), "") for k in range(1, model.njoints) if model.parents[k] == 0]
    supports = Counter(each.support for each in phrases if each.support)
    noun = next((each.robot for each in phrases if each.robot), "a robot")
    if supports:
        noun = f"a vehicle on {_listed([_count(number, support) for support, number in supports.items()])}"
    joints = _count(model.njoints - 1 - sum(map(bool, roots)), "joint")
    loose = len(roots) > 1 and any(roots)  # joints that start at a fixed base are connected by it
    stance = f"no joint connects its {len(roots)} parts" if loose else f"its base {roots[0] or 'is fixed'}"
    return f"'{robot.name}' is {noun}: {stance}, and it has {joints} and {_count(reduced.p, 'actuator')}."


def _motions(report: Report, names: Sequence[str]) -> str:
    n, r, reach = report.n, report.r, report.growth_vector[-1]
    said = f"It has {_count(r, 'independent motion')} ({_listed(names)}) in {_count(n, 'degree')} of freedom"
    if r == n:
        return f"{said}, because no constraint takes one away."
    if reach == n:
        return f"{said}, and together they still lead to every configuration nearby."
    if reach == r:
        return f"{said}, and its constraints keep it on the configurations that these motions reach."
    return f"{said}, and together they lead to only {reach} of the {n} dimensions of its configurations."


def _limits(reduced: ReducedModel, prevented: Sequence[str], report: Report) -> str:
    lacking = report.r - report.actuation_rank
    drive = "no actuator drives" if lacking == len(report.unactuated) else "too few actuators drive"
    undriven = f"{drive} {_listed(report.unactuated)}" if lacking else ""
    cannot = f"It cannot {_listed(prevented, 'or')}" if prevented else "No constraint keeps it from any motion"
    return f"{cannot}; {undriven + ', and ' if undriven else ''}{_reach_of_singularities(reduced, report)}."


def _prevented(phrases: Sequence[Phrases]) -> list[str]:
    """Describe the motions that the constraints prevent."""
    found: dict[str, list[str]] = {}
    for each in phrases:
        if each.prevents:
            found.setdefault(each.prevents, []).extend([each.where] if each.where else [])
    return [f"{words} {_listed(names)}" if names else words for words, names in found.items()]


def _reach_of_singularities(reduced: ReducedModel, report: Report) -> str:
    located = [each for each in report.singularities if each.located]
    if not located and report.singular_samples:
        return f"{report.singular_samples} of {report.samples} sampled configurations are singular"
    if not located:
        return f"no singular configuration was found between {report.samples} samples"
    return _place_of(located[0], reduced)


def _place_of(found: Singularity, reduced: ReducedModel) -> str:
    if found.matrix == "E":
        names = [name for name in found.rows if name in reduced.reducing.names]
        return (
            f"it becomes singular where its constraints leave no free choice of {_listed(names) if names else 'motion'}"
        )
    return f"it becomes singular where its redundant motions cannot move {_listed(found.rows)}"


def _count(number: int, noun: str) -> str:
    return counted(number, noun) if number else f"no {noun}s"


def _listed(names: Sequence[str], word: str = "and") -> str:
    """Join names in a sentence; a long list is shortened to its first names."""
    shown = list(names)
    if len(shown) > _FEW:
        shown = [*shown[: _FEW - 1], f"{len(shown) - _FEW + 1} more"]
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} {word} {shown[-1]}"


def inspect_system(system: str, options: tuple[str, ...], samples: int, seed: int, as_json: bool) -> None:
    """Print the analysis of a system."""
    scenario = Scenario.load(system, parse_options(options))
    reduced, task = scenario.model.reduced, scenario.task
    report = analyze(reduced, task.primary_names, task.redundant_names, samples, seed, task.vertical_names)
    found: tuple[Finding, ...] = ()
    with suppress(RncError):  # a start that cannot be assembled is an error of a run
        found = start_findings(scenario.content, reduced, scenario.q0)
    for message in warnings_of(found):
        warn(message)
    if not as_json:
        print_report(system, reduced, task, report)
        return
    print_json(
        {
            "system": system,
            "sentences": list(sentences(reduced, report)),
            "robot": reduced.robot.name,
            "joints": list(reduced.robot.joint_names),
            "reducing": list(reduced.reducing.names),
            "vertical": list(reduced.vertical.names),
            "actuators": list(reduced.actuation.names),
            "primary": list(task.primary_names),
            "redundant": list(task.redundant_names),
            **report.to_dict(),
            "findings": [each.to_json() for each in found],
        }
    )


def print_report(system: str, reduced: ReducedModel, task: Task, report: Report) -> None:
    """Print the analysis of a system: three sentences and a table.

    Args:
        system: name of the system as the user typed it.
        reduced: reduced model of the system.
        task: primary and redundant outputs.
        report: result of ``analyze``.
    """
    console = Console(markup=False, emoji=False)
    for sentence in sentences(reduced, report):
        console.print(sentence, highlight=False)
    console.print()
    names = {
        "primary motions": task.primary_names,
        "redundant motions": task.redundant_names,
        "actuators": reduced.actuation.names,
    }
    lines = [(label, items(listed or ["none"])) for label, listed in names.items()]
    print_object(report, f"{system} ({reduced.robot.name})", lines)
