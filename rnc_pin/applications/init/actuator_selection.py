"""Actuators of a draft: those of the file, and further ones if these cannot produce every reduced force."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from rnc_pin.applications.init.base_assumptions import BaseAssumptions, Entry
from rnc_pin.applications.init.decision import LIKELY, SURE, Alternative, DraftDecision
from rnc_pin.applications.init.drive_evidence import DriveEvidence
from rnc_pin.applications.init.joint_properties import effort_limit
from rnc_pin.applications.init.tolerances import DRIVEN
from rnc_pin.applications.scenario.loading import constraint_of
from rnc_pin.errors import ConstraintError, few
from rnc_pin.math import unit_rows
from rnc_pin.robots import Robot

_UNPOWERED = "effort 0 in the file, driven without a limit: CHECK"
_PASSIVE = "driven, although it is usually passive: CHECK"
_UNTOLD = "in place of actuators that the file does not describe: CHECK"


@dataclass(frozen=True)
class ActuatorCandidates:
    """Candidate actuator entries, one input each, with a remark on each.

    Attributes:
        sure: actuators of the base and of joints with an effort limit.
        joints: joints without effort and passive joints, driven only if the sure actuators are not enough.
        forces: forces and torques on the base, in place of actuators that the file does not describe.
        wheels: those of ``joints`` that the base needs, e.g. wheels with effort 0 in the file.
    """

    sure: list[tuple[Entry, str]]
    joints: list[tuple[Entry, str]]
    forces: list[tuple[Entry, str]]
    wheels: list[tuple[Entry, str]]

    @property
    def named(self) -> list[tuple[Entry, str]]:
        """Entries of a base with a controller of its own, with or without effort in the file."""
        return [*self.sure, *self.wheels]

    @property
    def all(self) -> list[tuple[Entry, str]]:
        """All entries, the most likely first."""
        return [*self.sure, *self.joints, *self.forces]

    def enough(self, input_matrix: np.ndarray) -> list[tuple[Entry, str]]:
        """Return the sure entries, and each further entry, in order, that raises the rank of the reduced forces.

        If a wheel without effort is among them, all such wheels are: their efforts are placeholders.

        Args:
            input_matrix: reduced forces for unit inputs of all entries (r, p).
        """
        columns = list(range(len(self.sure)))
        for column in range(len(self.sure), len(self.all)):
            if _rank(input_matrix[:, [*columns, column]]) > _rank(input_matrix[:, columns]):
                columns.append(column)
        chosen = [self.all[column] for column in columns]
        alike = self.wheels if any(wheel in chosen for wheel in self.wheels) else []
        return [each for each in self.all if each in chosen or each in alike]


def actuator_candidates(
    mobility: BaseAssumptions, robot: Robot, start: Iterable[str], undriven: Collection[str] = ()
) -> ActuatorCandidates:
    """Return the candidate actuators of a robot with one kind of base.

    Args:
        mobility: assumptions about the base.
        robot: the robot with that base.
        start: its joints with one degree of freedom.
        undriven: joints without an actuator in a file that names the actuators of other joints.
    """
    joints = [name for name in start if name not in undriven]
    driving = [
        (entry, remark) for entry, remark in mobility.actuators if not (isinstance(entry, str) and entry in undriven)
    ]
    named = {entry for entry, _ in driving if isinstance(entry, str)}
    conserved = {entry.get("momentum") for entry, _ in mobility.constraints if isinstance(entry, dict)}
    followers = {mimic.joint for mimic in robot.mimics}
    weak = mobility.without_effort - conserved - followers
    sure = [name for name in joints if name not in named | mobility.passive | conserved]
    wheels = [name for name in joints if name in weak & named]
    unpowered = [name for name in joints if name in weak - named]
    passive = [name for name in joints if name in mobility.passive - conserved - named - followers - weak]
    given = [entry for entry, _ in driving]
    remarked: dict[str, tuple[Entry, str]] = {name: (name, _UNPOWERED) for name in (*wheels, *unpowered)}
    return ActuatorCandidates(
        [*(each for each in driving if each[0] not in wheels), *((name, "") for name in sure)],
        [*remarked.values(), *((name, _PASSIVE) for name in passive)],
        [(force, _UNTOLD) for force in _forces(mobility) if force not in given],
        [remarked[name] for name in wheels],
    )


def _forces(mobility: BaseAssumptions) -> list[Entry]:
    """Forces and torques on the base; none if its momentum is conserved."""
    if mobility.weightless or mobility.base == "fixed":
        return []
    kinds = [("force", "xy"), ("torque", "z")] if mobility.base == "planar" else [("torque", "xyz")]
    return [{kind: {"frame": mobility.frame, "axis": axis}} for kind, axes in kinds for axis in axes]


def _rank(input_matrix: np.ndarray) -> int:
    """Number of independent reduced forces of actuators."""
    return int(np.linalg.matrix_rank(unit_rows(input_matrix), tol=DRIVEN)) if input_matrix.size else 0


# ---------------------------------------------------------------------- joints without a motor


def assume_motors(
    mobility: BaseAssumptions, robot: Robot, start: Collection[str], drives: DriveEvidence, *, is_mjcf: bool
) -> list[str]:
    """Mark joints without a motor as passive: those with effort 0, and those that a list of motors leaves out.

    Args:
        mobility: assumptions about the base; its passive joints, decisions and notes are extended.
        robot: the robot with that base.
        start: its joints with one degree of freedom.
        drives: evidence for which joints have a motor.
        is_mjcf: True for an MJCF, whose joints without an actuator have effort 0.

    Returns:
        Joints that the file or an option leaves without a motor.
    """
    limits = {name: effort_limit(robot, name) for name in start}
    weak = [name for name, limit in limits.items() if limit == 0 and name not in mobility.passive]
    powered = any(limit for name, limit in limits.items() if name not in mobility.passive)
    of_base = {entry for entry, _ in mobility.actuators if isinstance(entry, str)} | mobility.passive
    others = [name for name in start if name not in of_base]
    undriven = drives.unlisted([*start] if drives.is_complete else others)
    idle = [name for name in others if name in undriven]
    if idle:
        mobility.decisions.append(_decision_on_others(idle, drives))
    named = [name for name in weak if drives.says(name)]
    if powered:
        mobility.without_effort = set(weak) - set(named)
        if mobility.travel:  # beside driven wheels, a loose joint without an effort is held
            undriven += [name for name in weak if name not in {*named, *of_base, *undriven}]
        mobility.passive |= mobility.without_effort
        if named:
            said = "effort 0 in the file, which names them as driven all the same: driven without a limit"
            mobility.notes.append(f"{said}: {', '.join(named)}")
    elif weak and not is_mjcf:
        mobility.notes.append("the file states no effort: 0 for every joint, so that they are driven without a limit")
    return undriven


def _decision_on_others(idle: Sequence[str], drives: DriveEvidence) -> DraftDecision:
    """Decision on the joints beside the base that have no motor."""
    asked = all(name in drives.passive for name in idle)
    sources = list(dict.fromkeys(drives.named.values()))
    evidence = "by an option" if asked else f"not named by {few(sources)}, which name other joints"
    sure = SURE if asked or drives.is_complete else LIKELY
    others = tuple(Alternative(f"{name} is driven", ("--driven", name)) for name in idle[:2])
    return DraftDecision("Which joints beside the base have no motor?", few(idle), sure, evidence, others)


def conserve_momentum_of_free_joints(mobility: BaseAssumptions, robot: Robot) -> None:
    """Add conservation of momentum for joints without effort that turn on the ground, if nothing else acts on them."""
    if mobility.base != "fixed" or mobility.constraints:
        return
    for name in robot.joint_names:
        if name in mobility.without_effort and robot.model.parents[robot.joint_id(name)] == 0:
            entry = {"momentum": name}
            with suppress(ConstraintError):
                constraint_of(entry).bind(robot)
                mobility.constraints.append((entry, "turns freely, and the robot starts at rest"))
                mobility.vertical.append({"joint": name})
