"""Description of a system in three sentences: robot type, motions, and limits with singularities."""

from __future__ import annotations

from collections.abc import Sequence

from rnc_pin.analysis import Report, Singularity
from rnc_pin.constraints import (
    AckermannSteering,
    Caster,
    JointCoupling,
    LoopClosure,
    MomentumConservation,
    NoSideSlip,
    RollingBall,
    RollingWheel,
)
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import ConstraintKind

_FEW = 4  # names listed in a sentence
_KNOWN = (
    *(RollingWheel, RollingBall, NoSideSlip, MomentumConservation),
    *(LoopClosure, JointCoupling, AckermannSteering, Caster),
)


def sentences(reduced: ReducedModel, report: Report) -> tuple[str, str, str]:
    """Describe a system in three sentences.

    Args:
        reduced: reduced model of the system.
        report: result of ``analyze``.
    """
    blocks = [place.block for place in reduced.all_constraints.places]
    kinds = [block.kind for block in blocks if block.kind is not None]
    # Rows without a kind are mimic couplings of the robot file.
    coupled = len(kinds) < len(blocks) or any(isinstance(each, JointCoupling | AckermannSteering) for each in kinds)
    barred = [*_barred(kinds), *(["move coupled joints by themselves"] if coupled else [])]
    return _kind(reduced, kinds), _motions(report, reduced.reducing.names), _limits(reduced, barred, report)


def _kind(reduced: ReducedModel, kinds: Sequence[ConstraintKind]) -> str:
    robot = reduced.robot
    first = robot.model.joints[1].shortname()
    base = {"JointModelPlanar": "moves in the plane", "JointModelFreeFlyer": "moves freely in space"}.get(first)
    stands = [
        _count(len(names), noun)
        for kind, noun in ((RollingWheel, "rolling wheel"), (NoSideSlip, "knife edge"), (RollingBall, "rolling ball"))
        if (names := _frames(kinds, kind))
    ]
    noun = "a robot"
    if stands:
        noun = f"a vehicle on {_and(stands)}"
    elif any(isinstance(kind, MomentumConservation) for kind in kinds):
        noun = "a robot whose momentum is conserved"
    elif any(isinstance(kind, LoopClosure) for kind in kinds):
        noun = "a mechanism with closed loops"
    joints = _count(robot.model.njoints - 1 - (base is not None), "joint")
    stance = f"its base {base}" if base else "its base is fixed"
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


def _limits(reduced: ReducedModel, barred: Sequence[str], report: Report) -> str:
    undriven = f"no actuator drives {_and(report.unactuated)}" if report.actuation_rank < report.r else ""
    cannot = f"It cannot {_or(barred)}" if barred else "No constraint keeps it from any motion"
    return f"{cannot}; {undriven + ', and ' if undriven else ''}{_singular(reduced, report)}."


def _barred(kinds: Sequence[ConstraintKind]) -> list[str]:
    """Describe the motions that the constraints prevent."""
    found = []
    skidding = [kind for kind in kinds if isinstance(kind, RollingWheel)]
    for kind, words in ((RollingWheel, "slip at"), (RollingBall, "slip at"), (NoSideSlip, "slide sideways at")):
        frames = _frames(kinds, kind)
        if frames and kind is RollingWheel and not all(wheel.lateral and wheel.roller is None for wheel in skidding):
            words = "roll without turning"
        found += [f"{words} {_and(frames)}"] if frames else []
    momenta = [kind.joint for kind in kinds if isinstance(kind, MomentumConservation)]
    found += [f"change its momentum about {_and(momenta)}"] if momenta else []
    found += ["open its loops"] if any(isinstance(kind, LoopClosure) for kind in kinds) else []
    found += ["break the rows of your own"] if any(not isinstance(kind, _KNOWN) for kind in kinds) else []
    return found


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


def _frames(kinds: Sequence[ConstraintKind], kind: type) -> list[str]:
    return [str(each.frame) for each in kinds if isinstance(each, kind)]  # type: ignore[attr-defined]


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
