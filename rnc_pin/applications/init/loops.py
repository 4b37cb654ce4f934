"""Loops of a robot: closures of its file, coupled joints, and how far they move until a loop ends."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from rnc_pin.applications.init.base_assumptions import BENT, Entry
from rnc_pin.applications.init.joint_properties import joint_limits
from rnc_pin.applications.init.output_selection import ChosenOutputs
from rnc_pin.applications.scenario.loading import constraint_of
from rnc_pin.errors import RncError
from rnc_pin.io import Json
from rnc_pin.model import Kinematics, NonholonomicSystem, ReducedModel
from rnc_pin.robots import Robot

_COUPLED = 1e-9  # smallest entry of a constraint row that couples a joint
_STEPS = 20  # number of steps in which a loop is followed
_FASTER = 3.0  # growth of the fastest rate of a loop that counts as its dead centre
_BESIDE = 0.3  # largest correction of a step that follows a loop, as a share of the step: beyond, it jumps
_OF_REACH = 0.8  # share of the reach of a loop that a reference uses


def loop_closures(robot: Robot) -> list[tuple[Entry, str]]:
    """Return constraints for the loops of a file, with a remark on each; a loop within one body needs none."""
    entries: list[tuple[Entry, str]] = []
    for closure in robot.closures:
        joints = {robot.model.frames[robot.frame_id(name)].parentJoint for name in closure[:2]}
        if len(joints) > 1:
            said = {key: list(value) if isinstance(value, tuple) else value for key, value in closure._asdict().items()}
            entry: dict[str, Json] = {key: value for key, value in said.items() if value != [0.0, 0.0, 0.0]}
            entries.append(({"loop_closure": entry}, "closed by an equality of the file"))
    return entries


def uncoupled_joints(
    joints: Iterable[str], constraints: Iterable[tuple[Entry, str]], robot: Robot, start: Mapping[str, float]
) -> list[str]:
    """Return the joints that no constraint couples to others; momentum conservation, which couples all, is ignored.

    Args:
        joints: joints with one degree of freedom.
        constraints: constraint entries, with a remark on each.
        robot: the robot.
        start: values of its joints with one degree of freedom.
    """
    position = Kinematics(robot).position(robot.configuration(start))
    coupled = np.zeros(robot.nv, dtype=bool)
    kept: set[object] = set()
    for entry, _ in constraints:
        if isinstance(entry, Mapping) and "momentum" in entry:
            kept.add(entry["momentum"])
            continue
        coupled |= np.abs(constraint_of(entry).bind(robot).jacobian(position)).max(axis=0, initial=0.0) > _COUPLED
    return [name for name in joints if name not in kept and not coupled[robot.velocity_indices(name)].any()]


# ---------------------------------------------------------------------- motion of loops


def keep_within_loops(
    chosen: ChosenOutputs, system: NonholonomicSystem, q: np.ndarray, coupled: Collection[str]
) -> list[str]:
    """Reduce the references of joints that constraints couple to others, or turn them, to what the loops permit.

    A loop ends at its dead centre, near which other joints move much faster than at the start, or at a joint limit.

    Args:
        chosen: the outputs; their steps change.
        system: the robot with its constraints.
        q: start (nq,).
        coupled: joints in loops.

    Returns:
        A line on each joint whose reference is smaller than usual.
    """
    notes = []
    reduced: ReducedModel | None = None
    for row, name in enumerate(chosen.names):
        usual = chosen.steps[row]
        if name not in coupled or not usual:
            continue
        reduced = reduced or system.reduce(chosen.kinds)
        step, found = usual, _reach(reduced, q, row, usual)
        if found.end:
            other = _reach(reduced, q, row, -usual)
            step, found = (-usual, other) if other.share > found.share else (usual, found)
        chosen.steps[row] = round(step * (_OF_REACH * found.share if found.end else 1.0), 4)
        if found.end:
            notes.append(f"{name} moves by {chosen.steps[row]:g} only: its loop ends {found.end}")
    return notes


def off_dead_centre(chosen: ChosenOutputs, system: NonholonomicSystem, q: np.ndarray, joint: str) -> np.ndarray:
    """Return a configuration (nq,) where the motor of a loop moves it, if one of its other joints moves from a start.

    Args:
        chosen: the outputs; one of them is the other joint.
        system: the robot with its constraints.
        q: start (nq,), a dead centre.
        joint: name of the other joint.
    """
    reduced, row = system.reduce(chosen.kinds), chosen.names.index(joint)
    usual = abs(chosen.steps[row]) or BENT
    return max((_reach(reduced, q, row, step) for step in (usual, -usual)), key=lambda each: each.share).q


@dataclass(frozen=True)
class _Reach:
    """Reach of an output that moves alone.

    Attributes:
        share: share of the step that it makes.
        q: configuration there (nq,).
        end: what ends it: "at a limit of ...", "at a dead centre", or nothing.
    """

    share: float
    q: np.ndarray
    end: str = ""


def _reach(reduced: ReducedModel, q: np.ndarray, row: int, step: float) -> _Reach:
    """Follow an output that makes a step alone, while the loops stay closed, to its end or to the end of the loop."""
    robot, rate = reduced.robot, step * np.eye(reduced.r)[row] / _STEPS
    joints = [name for name in robot.joint_names if np.isfinite(np.diff(joint_limits(robot, name))).all()]
    limits = [(name, robot.model.joints[robot.joint_id(name)].idx_q, joint_limits(robot, name)) for name in joints]
    slowest = np.inf
    start, column = q, robot.velocity_indices(reduced.reducing.names[row]).start
    for _ in range(_STEPS):
        moved = float(pin.difference(robot.model, start, q)[column])  # less than asked for near a dead centre
        here = _Reach(max(moved / step, 0.0), q, "at a dead centre")
        try:
            v = reduced.at(q).velocity(rate)
            ahead = pin.integrate(robot.model, q, v)
            q = reduced.assembled(ahead)
        except RncError:
            return here
        fastest = float(np.abs(v).max())
        slowest = min(slowest, fastest)
        if fastest > _FASTER * slowest or np.abs(pin.difference(robot.model, ahead, q)).max() > _BESIDE * fastest:
            return here
        for name, place, (low, high) in limits:
            if not low <= q[place] <= high:
                return replace(here, end=f"at a limit of {name}")
    return _Reach(1.0, q)
