"""Description of a system in three sentences: robot type, motions, and limits with singularities."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from rnc_pin.analysis import Report, Singularity
from rnc_pin.model import Phrases, ReducedModel

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
        noun = f"a vehicle on {_and([_count(number, support) for support, number in supports.items()])}"
    joints = _count(model.njoints - 1 - sum(map(bool, roots)), "joint")
    loose = len(roots) > 1 and any(roots)  # joints that start at a fixed base are connected by it
    stance = f"no joint connects its {len(roots)} parts" if loose else f"its base {roots[0] or 'is fixed'}"
    return f"'{robot.name}' is {noun}: {stance}, and it has {joints} and {_count(reduced.p, 'actuator')}."


def _motions(report: Report, names: Sequence[str]) -> str:
    n, r, reach = report.n, report.r, report.growth_vector[-1]
    said = f"It has {_count(r, 'independent motion')} ({_and(names)}) in {_count(n, 'degree')} of freedom"
    if r == n:
        return f"{said}, because no constraint takes one away."
    if reach == n:
        return f"{said}, and together they still lead to every configuration nearby."
    if reach == r:
        return f"{said}, and its constraints keep it on the configurations that these motions reach."
    return f"{said}, and together they lead to only {reach} of the {n} dimensions of its configurations."


def _limits(reduced: ReducedModel, prevented: Sequence[str], report: Report) -> str:
    undriven = f"no actuator drives {_and(report.unactuated)}" if report.actuation_rank < report.r else ""
    cannot = f"It cannot {_or(prevented)}" if prevented else "No constraint keeps it from any motion"
    return f"{cannot}; {undriven + ', and ' if undriven else ''}{_singular(reduced, report)}."


def _prevented(phrases: Sequence[Phrases]) -> list[str]:
    """Describe the motions that the constraints prevent."""
    found: dict[str, list[str]] = {}
    for each in phrases:
        if each.prevents:
            found.setdefault(each.prevents, []).extend([each.where] if each.where else [])
    return [f"{words} {_and(names)}" if names else words for words, names in found.items()]


def _singular(reduced: ReducedModel, report: Report) -> str:
    located = [each for each in report.singularities if each.located]
    if not located and report.singular_samples:
        return f"{report.singular_samples} of {report.samples} sampled configurations are singular"
    if not located:
        return f"no singular configuration was found between {report.samples} samples"
    return _where(located[0], reduced)


def _where(found: Singularity, reduced: ReducedModel) -> str:
    if found.matrix == "E":
        names = [name for name in found.rows if name in reduced.reducing.names]
        return f"it becomes singular where its constraints leave no free choice of {_and(names) if names else 'motion'}"
    return f"it becomes singular where its redundant motions cannot move {_and(found.rows)}"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s'[: number != 1]}" if number else f"no {noun}s"


def _and(names: Sequence[str]) -> str:
    return _listed(names, "and")


def _or(names: Sequence[str]) -> str:
    return _listed(names, "or")


def _listed(names: Sequence[str], word: str) -> str:
    """Join names in a sentence; a long list is shortened to its first names."""
    shown = list(names)
    if len(shown) > _FEW:
        shown = [*shown[: _FEW - 1], f"{len(shown) - _FEW + 1} more"]
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} {word} {shown[-1]}"
