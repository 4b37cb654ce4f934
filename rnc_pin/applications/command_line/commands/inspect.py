"""``rnc-pin inspect``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
from rich.console import Console, Group, RenderableType
from rich.table import Table

from rnc_pin.analysis import Boundedness, LimitEffect, Redundancy, Report, Singularity, analyze, limit_effects
from rnc_pin.applications.command_line.messages import print_json, warn
from rnc_pin.applications.scenario.builder import Experiment
from rnc_pin.applications.scenario.controllers.whole_body import WholeBodySettings
from rnc_pin.applications.scenario.files import parse_options
from rnc_pin.applications.scenario.plant_builder import start_findings, warnings_of
from rnc_pin.applications.scenario.saved_run import load_run
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control import ComputedTorque, InverseDynamicsQP, VelocityQP, VelocityTracker
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.model import Phrases, ReducedModel, Task
from rnc_pin.printing import counted
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


def inspect_system(
    system: str, options: tuple[str, ...], samples: int, seed: int, details: bool, as_json: bool, run: Path | None
) -> None:
    """Print the analysis of a system."""
    scenario = Scenario.load(system, parse_options(options))
    reduced, task = scenario.model.reduced, scenario.task
    report = analyze(reduced, task.primary_names, task.redundant_names, samples, seed, task.vertical_names)
    limits = examine_limits(scenario, run)
    found: tuple[Finding, ...] = ()
    with suppress(RncError):  # a start that cannot be assembled is an error of a run
        found = start_findings(scenario.content, reduced, scenario.q0)
    for message in warnings_of(found):
        warn(message)
    if not as_json:
        print_report(system, reduced, task, report, details)
        for line in sentences_of(limits):
            click.echo(line)
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
            "limit_effects": [asdict(each) for each in limits.effects],
            "limits_not_examined": limits.problem,
            "findings": [each.to_json() for each in found],
        }
    )


# ------------------------------------------------------------------ report


def print_report(system: str, reduced: ReducedModel, task: Task, report: Report, details: bool = False) -> None:
    """Print the analysis of a system: three sentences and a table.

    Args:
        system: name of the system as the user typed it.
        reduced: reduced model of the system.
        task: primary and redundant outputs.
        report: result of ``analyze``.
        details: print the quantities of the paper, too: blocks of A*, condition of E, Lemma 1.
    """
    console = Console(markup=False, emoji=False)
    for sentence in sentences(reduced, report):
        console.print(sentence, highlight=False)
    console.print()
    title = f"{system} ({reduced.robot.name})"
    table = Table(show_header=False, title=title, title_justify="left", title_style="bold", show_lines=True)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    n, rank, r = report.n, report.rank, report.r
    less = counted(rank, "independent constraint row")
    table.add_row("motion", f"{n} degrees of freedom less {less} leave {r}:\n{_list(reduced.reducing.names)}")
    table.add_row("constraint rows", _constraint_rows(report))
    growth = report.growth_vector
    least = "" if report.growth_evidence.decided else "at least "
    reach = report.full_reach if report.completely_nonholonomic else f"motion reaches {least}{growth[-1]} of {n}"
    vector = f"({', '.join(map(str, growth))}): {reach}\n{report.growth_evidence}"
    table.add_row("reach", vector if details or not report.growth_evidence.decided else reach)
    table.add_row("actuators", _actuation(reduced.actuation.names, report, details))
    table.add_row("redundancy", _redundancy(task, report.redundancy, details))
    table.add_row("singular", _singular(report, details))
    if details:
        lemma = ", ".join(f"{name} {value:.1e}" for name, value in report.lemma1.items())
        holds = "holds" if report.lemma1_holds else "DOES NOT HOLD"
        table.add_row("Lemma 1", f"{holds}: {lemma}\n{_bounds(report.lemma1_bounds)}")
    elif not report.lemma1_holds:
        table.add_row("Lemma 1", "DOES NOT HOLD: --details has the residuals")
    console.print(table, highlight=False)


def _list(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"


def _constraint_rows(report: Report) -> RenderableType:
    rows = Table.grid(padding=(0, 2))
    for name in report.kept_rows:
        rows.add_row(name, "integrable" if name in report.integrable_rows else "nonholonomic")
    for row in report.dropped_rows:
        rows.add_row(row.name, f"dropped: {row.reason}", style="dim")
    combinations = report.integrable_combinations
    if not report.kept_rows:
        return "none"
    if not combinations:
        return Group(rows, "no combination of rows is integrable")
    count = counted(len(combinations), "integrable combination")
    return Group(rows, *(f"{count if k == 0 else ' ' * len(count)}  {each}" for k, each in enumerate(combinations)))


def _actuation(actuators: Sequence[str], report: Report, details: bool) -> str:
    rank, r = report.actuation_rank, report.r
    short = f"not every reduced force can be realised: {_list(report.unactuated)} not fully actuated"
    verdict = short if rank < r else "every reduced force can be realised"
    verdict += f" (rank of R^T B: {rank} of {r})" if details else ""
    spare = report.p - rank
    return f"{_list(actuators)}\n{verdict}" + (f", with {spare} actuators to spare" if spare else "")


def _redundancy(task: Task, found: Redundancy, details: bool) -> RenderableType:
    parts = Table.grid(padding=(0, 2))
    for symbol, what, names in (
        ("x21", "primary motions", task.primary_names),
        ("x22", "redundant motions", task.redundant_names),
        ("x11", "outputs that the redundant motions can steer", found.tracked),
        ("x12", "outputs that follow from the primary motions", found.driven),
    ):
        parts.add_row(f"{symbol} {what}" if details else what, _list(names))
    verdict = f"class {found.redundancy_class}" if found.redundancy_class else "no redundancy class"
    if not details:
        return Group(verdict, parts)
    verdict = f"{verdict}: {found.reason}"
    if found.evidence is None:
        return Group(verdict, parts)
    blocks = Table(box=None, padding=(0, 1, 0, 0))
    for heading in ("block", "size", "largest", "smallest singular value"):
        blocks.add_column(heading, no_wrap=True)
    for block in found.evidence.blocks:
        if block.largest_entry is not None and block.smallest_singular_value is not None:
            size, largest = " x ".join(map(str, block.shape)), _figure(block.largest_entry)
            spread = asdict(block.smallest_singular_value)
            blocks.add_row(block.name, size, largest, _spread(spread) if block.largest_entry else "0")
    return Group(verdict, parts, blocks)


def _spread(values: dict[str, float]) -> str:
    return f"{_figure(values['min'])} to {_figure(values['max'])}, median {_figure(values['median'])}"


def _figure(value: float) -> str:
    return "0" if abs(value) < 1e-12 else f"{value:.3g}"


def _singular(report: Report, details: bool) -> str:
    lines = [f"{report.singular_samples} of {report.samples} samples singular"]
    if details:
        lines[0] = f"condition of E {_spread(report.condition)}; {lines[0]}"
    for each in report.singularities:
        rows, several = _list(each.rows), len(each.rows) > 1
        if each.matrix == "E":
            what = f"{rows} depend on each other"
        else:
            what = f"redundant motions cannot move {rows}" + (" independently" if several else "")
        if each.located:
            matrix = f"{each.matrix} is " if details else ""
            lines.append(f"{matrix}singular where {what}{_where(each.configuration)}")
        elif details:
            size = _figure(each.smallest_singular_value)
            lines.append(f"{each.matrix}: not singular in any sample; smallest singular value {size} ({rows})")
    return "\n".join(lines)


def _bounds(found: Boundedness) -> str:
    """Describe the norms of H and V, and the configurations near which they are unbounded."""
    lines = [f"|H| {_spread(asdict(found.H))}; |V| at unit rates {_spread(asdict(found.V))}"]
    if found.everywhere:
        lines.append("bounded in all samples")
    for each in found.approaches:
        if not each.bounded:
            what = f"|H| grows as d^-{each.H_order:.1f} and |V| as d^-{each.V_order:.1f}"
            lines.append(f"at a distance d from where {_list(each.rows)} depend on each other {what}")
    return "\n".join(lines)


def _where(configuration: Mapping[str, float | list[float]]) -> str:
    """Describe a configuration in words; empty for robots with many joints."""
    if len(configuration) > 6:
        return ""
    values = {
        name: f"({', '.join(map(_figure, value))})" if isinstance(value, list) else _figure(value)
        for name, value in configuration.items()
    }
    return ", e.g. at " + ", ".join(f"{name} = {value}" for name, value in values.items())


_STATES = 21


class ExaminedLimits(NamedTuple):
    """Effects of the limits of a scenario's program.

    Attributes:
        effects: effect at each state; empty without a program.
        problem: reason for which the program could not be examined; None if there is none.
    """

    effects: tuple[LimitEffect, ...]
    problem: str | None


def examine_limits(scenario: Scenario, run: Path | None) -> ExaminedLimits:
    """Return the effects of limits at the start of a scenario, or at 21 states of a run.

    Args:
        scenario: the scenario.
        run: folder of a run, or its trajectory; None for the start.

    Raises:
        RncError: the run cannot be read, or does not belong to the scenario.
    """
    if not isinstance(scenario.content.controller, WholeBodySettings):
        if run is not None:
            raise ConfigurationError("--run: the controller of the scenario is no program with limits, as 'qp' is")
        return ExaminedLimits((), None)
    try:
        experiment = scenario.experiment
    except RncError as error:
        return ExaminedLimits((), f"the controller cannot be built: {error}")
    states = [(0.0, experiment.q0, experiment.v2_0)] if run is None else _along(run, experiment)
    reduced = experiment.reduced
    try:
        return ExaminedLimits(limit_effects(_program(experiment), states, reduced.robot.nq, reduced.r), None)
    except RncError as error:
        return ExaminedLimits((), str(error))


def _program(experiment: Experiment) -> VelocityQP:
    """Program at velocity level with the tasks and limits of the controller, for the interval of the simulation."""
    controller: object = experiment.controller
    if isinstance(controller, VelocityTracker | ComputedTorque):
        controller = controller.target
    if not isinstance(controller, VelocityQP | InverseDynamicsQP):
        raise ConfigurationError(f"limits of {type(controller).__name__} are not examined")
    damping = controller.damping if isinstance(controller, VelocityQP) else 0.0
    dt = experiment.simulation.dt
    return VelocityQP(experiment.reduced, controller.tasks, controller.limits, dt=dt, damping=damping)


def _along(source: Path, experiment: Experiment) -> list[tuple[float, np.ndarray, np.ndarray]]:
    run = load_run(source).trajectory
    expected = experiment.reduced.robot.nq, experiment.reduced.r
    if (run.q.shape[1], run.v2.shape[1]) != expected:
        raise ConfigurationError(
            f"--run: {source} has nq, r = {run.q.shape[1]}, {run.v2.shape[1]}, expected {expected}"
        )
    places = np.unique(np.linspace(0, len(run.time) - 1, _STATES).round().astype(int)).tolist()
    return [(float(run.time[k]), run.q[k], run.v2[k]) for k in places]


def sentences_of(found: ExaminedLimits) -> tuple[str, ...]:
    """Return the effects in words, a line for each state at which limits are active."""
    if found.problem is not None:
        return (f"limits: not examined, {found.problem}",)
    lines = []
    for effect in found.effects:
        if effect.active or effect.exceeded:
            worst = max(effect.task_error, key=lambda name: abs(effect.task_error[name]))
            lines.append(
                f"limits at t = {effect.time:.3g} s: {', '.join(effect.active)}; they leave {effect.freedom} motions; "
                f"largest change of a task: {worst} by {effect.task_error[worst]:.3g}"
            )
            if effect.exceeded:
                gave = ", ".join(f"{name} by {value:.3g}" for name, value in effect.exceeded.items())
                lines.append(f"limits that gave way: {gave}")
    if found.effects and not lines:
        lines.append(f"limits: none is active at the {len(found.effects)} states examined")
    return tuple(lines)
