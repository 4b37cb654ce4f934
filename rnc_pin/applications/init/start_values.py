"""Start values of joints: within limits, with closed loops, a regular inertia matrix, and loads within the efforts."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress

import numpy as np
import pinocchio as pin

from rnc_pin.applications.init.assumptions import ChosenOutputs
from rnc_pin.applications.init.evidence import effort_limit, joint_limits, joint_range
from rnc_pin.applications.scenario.schema.scenario import constraint_of, output_of
from rnc_pin.errors import RncError
from rnc_pin.io import Json
from rnc_pin.math import unit_diagonal
from rnc_pin.model import Kinematics, NonholonomicSystem, ReducedModel
from rnc_pin.motion.planning import OutputTarget, solve_ik
from rnc_pin.robots import Robot

_STEPS = 20  # number of steps in which a loop is followed


def loop_closures(robot: Robot) -> list[tuple[Mapping[str, Json], str]]:
    """Return constraints for the loops of a file, with a remark on each; a loop within one body needs none.

    Args:
        robot: the robot.
    """
    entries: list[tuple[Mapping[str, Json], str]] = []
    for closure in robot.closures:
        joints = {robot.model.frames[robot.frame_id(name)].parentJoint for name in closure[:2]}
        if len(joints) > 1:
            said = {key: list(value) if isinstance(value, tuple) else value for key, value in closure._asdict().items()}
            entry: dict[str, Json] = {key: value for key, value in said.items() if value != [0.0, 0.0, 0.0]}
            entries.append(({"loop_closure": entry}, "closed by an equality of the file"))
    return entries


def uncoupled_joints(
    constraints: Iterable[tuple[Mapping[str, Json], str]], robot: Robot, start: Mapping[str, float]
) -> list[str]:
    """Return the joints that no constraint couples to others; momentum conservation, which couples all, is ignored.

    Args:
        constraints: constraint entries, with a remark on each.
        robot: the robot.
        start: values of its joints with one degree of freedom.
    """
    # At the start: a row may be zero for a joint elsewhere, but rows of wheels and loops are not zero by chance here.
    position = Kinematics(robot).position(robot.configuration(start))
    coupled = np.zeros(robot.nv, dtype=bool)
    kept = [entry["momentum"] for entry, _ in constraints if "momentum" in entry]
    least = 1e-9  # smallest entry of a constraint row that couples a joint
    for entry in (each for each, _ in constraints if "momentum" not in each):
        coupled |= np.abs(constraint_of(entry).bind(robot).jacobian(position)).max(axis=0, initial=0.0) > least
    return [name for name in start if name not in kept and not coupled[robot.velocity_indices(name)].any()]


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
    of_reach = 0.8  # share of the reach of a loop that a reference uses
    for row, name in enumerate(chosen.names):
        usual = chosen.steps[row]
        if name not in coupled or not usual:  # limits of other joints are kept by their own step
            continue
        # Most robots have no loop: the model is reduced for the first one.
        reduced = reduced or system.reduce(chosen.kinds)
        step, (share, end) = usual, _reach(reduced, q, row, usual)
        # Beside a dead centre on one side, there is often room on the other.
        if end and (other := _reach(reduced, q, row, -usual))[0] > share:
            step, (share, end) = -usual, other
        chosen.steps[row] = round(step * (of_reach * share if end else 1.0), 4)
        if end:
            notes.append(f"{name} moves by {chosen.steps[row]:g} only: its loop ends {end}")
    return notes


def _reach(reduced: ReducedModel, q: np.ndarray, row: int, step: float) -> tuple[float, str]:
    """Follow an output that makes a step alone, while the loops stay closed, to its end or to the end of the loop.

    Returns:
        Share of the step that it makes, and what ends it: "at a limit of ...", "at a dead centre", or nothing.
    """
    robot, rate = reduced.robot, step * np.eye(reduced.r)[row] / _STEPS
    places = [(name, robot.model.joints[robot.joint_id(name)].idx_q) for name in robot.joint_names]
    limits = [(name, place, joint_limits(robot, name)) for name, place in places]
    slowest = np.inf
    start, column = q, robot.velocity_indices(reduced.reducing.names[row]).start
    # Rates of a loop grow about as 1 / sin of the angle to its dead centre: a factor 3 is 20 degrees away from it.
    faster = 3.0  # growth of the fastest rate of a loop that counts as its dead centre
    beside = 0.3  # largest correction of a step that follows a loop, as a share of the step: beyond, it jumps
    for _ in range(_STEPS):
        moved = float(pin.difference(robot.model, start, q)[column])  # less than asked for near a dead centre
        share = max(moved / step, 0.0)
        try:
            v = reduced.at(q).velocity(rate)
            ahead = pin.integrate(robot.model, q, v)
            # A step along a velocity leaves the loop by an error of second order: the assembly closes it again.
            q = reduced.assembled(ahead)
        except RncError:
            return share, "at a dead centre"
        fastest = float(np.abs(v).max())
        slowest = min(slowest, fastest)
        if fastest > faster * slowest or np.abs(pin.difference(robot.model, ahead, q)).max() > beside * fastest:
            return share, "at a dead centre"
        for name, place, (low, high) in limits:
            if not low <= q[place] <= high:
                return share, f"at a limit of {name}"
    return 1.0, ""


_Values = dict[str, float]


def start_values(robot: Robot) -> _Values:
    """Start values of joints with one degree of freedom [rad or m].

    A joint starts at zero if its limits admit that, else in their middle; limits of its mimic joints count. Zero at an
    edge of the limits is moved inside by a small share of their range: motions may overshoot.
    Mimic joints take the values that their leaders give them. Joints of loops start at zero, or as the file draws them,
    or near the middle of their limits: at the first of these configurations that closes the loops within the limits.

    Args:
        robot: the robot.
    """
    start = {}
    for name in robot.single_joint_names:
        (low, high), (first, last) = joint_range(robot, name), _inner_range(robot, name)
        inside = round(float(min(max(0.0, first), last)), 4) + 0.0
        # Zero first: a file draws its robot there, so that shapes and wheels are where they are read.
        start[name] = inside if low <= 0.0 <= high else _middle(robot, name)
    start = _with_mimics(robot, start)
    with suppress(RncError):  # loops that cannot be closed are an error of the draft
        return _closed(robot, start)
    return start


def _inner_range(robot: Robot, name: str) -> tuple[float, float]:
    """Range of a joint without the margins at its ends [rad or m]."""
    low, high = joint_range(robot, name)
    share = 0.02  # distance from a limit, as a share of the range
    margin = share * (high - low) if np.isfinite(high - low) else 0.0
    return low + margin, high - margin


def _middle(robot: Robot, name: str) -> float:
    """Middle of the limits of a joint and its mimic joints [rad or m]; without two finite limits, the nearest to 0."""
    low, high = joint_range(robot, name)
    if low > high:  # limits of mimic joints contradict its own, which count then
        low, high = joint_limits(robot, name)
    return round((low + high) / 2, 4) if np.isfinite(high - low) else float(min(max(0.0, low), high))


def _with_mimics(robot: Robot, start: Mapping[str, float]) -> _Values:
    values = dict(start)
    for _ in robot.mimics:  # mimic joints can form chains
        for joint, of, multiplier, offset in robot.mimics:
            if joint in values:
                values[joint] = round(multiplier * values.get(of, robot.locked.get(of, 0.0)) + offset, 9) + 0.0
    return values


def _closed(robot: Robot, start: _Values) -> _Values:
    """Return start values that close the loops of the file, or the given ones if there are none.

    Raises:
        RncError: the loops are not constraints of this robot.
    """
    loops = loop_closures(robot)
    if not loops:
        return start
    loose = uncoupled_joints(loops, robot, start)
    coupled = [name for name in start if name not in loose]
    system = NonholonomicSystem(robot, [constraint_of(entry) for entry, _ in loops])
    closed = 1e-4  # largest gap of a loop that counts as rounding in the file [m or rad], as at the start of a run
    for drawn in ({}, robot.references):  # references: joint values of an MJCF at which its bodies are drawn
        values = _with_mimics(robot, {**start, **{name: drawn.get(name, 0.0) for name in coupled}})
        inside = all(low <= values[name] <= high for name in coupled for low, high in [joint_limits(robot, name)])
        if inside and np.abs(system.assembly.residual(robot.configuration(values))).max() < closed:
            return values
    # From the middle, the way to a limit is longest on both sides.
    targets: dict[OutputTarget, float] = {output_of({"joint": name}): _middle(robot, name) for name in coupled}
    found = solve_ik(system.reduce(), robot.configuration(start), targets, hold=loose)
    if found.holonomic_residual > 1e-9:  # a solution is exact up to rounding, or none
        return start
    solved = robot.joint_values(found.q)
    return {name: round(float(np.ravel(solved[name])[0]), 9) + 0.0 for name in start}


# ---------------------------------------------------------------------- starts that the robot can have


def with_regular_inertia(robot: Robot, start: Mapping[str, float]) -> tuple[_Values, list[str]]:
    """Move joints if the inertia matrix is singular at the start: two axes on one line, no mass between them.

    Args:
        robot: the robot.
        start: values of joints with one degree of freedom [rad or m].

    Returns:
        New values, and a line on each moved joint.
    """
    values, notes = dict(start), []
    singular = 1e-9  # smallest eigenvalue of an inertia matrix with ones on its diagonal
    moves = 3  # largest number of joints to move for a regular inertia matrix
    for _ in range(moves):
        if _smallest_eigenvalue(robot, values) > singular:
            break
        moved = {name: {**values, name: _aside(robot, name, values[name])} for name in values}
        # One joint at a time, the best of all: most starts become regular with the first one.
        name = max(moved, key=lambda each: _smallest_eigenvalue(robot, moved[each]))
        values = moved[name]
        notes.append(f"{name} starts at {values[name]:g}: at its default value two joint axes coincide")
    return values, notes


def _smallest_eigenvalue(robot: Robot, start: Mapping[str, float]) -> float:
    """Smallest eigenvalue of the inertia matrix with ones on its diagonal."""
    M = pin.crba(robot.model, robot.model.createData(), robot.configuration(start))
    # A zero on the diagonal cannot be scaled to one: the matrix is singular.
    return float(np.linalg.eigvalsh(unit_diagonal(M))[0]) if np.diag(M).all() else 0.0


def _aside(robot: Robot, name: str, value: float) -> float:
    """Value of a joint near a given one, within its limits."""
    low, high = joint_limits(robot, name)
    step = min(0.6 if robot.single_joint(name).unit == "rad/s" else 0.1, (high - low) / 4)  # [rad] or [m]
    return round(value + (step if value + step < high else -step), 4)


def with_bearable_loads(robot: Robot, start: Mapping[str, float], joints: Collection[str]) -> tuple[_Values, list[str]]:
    """Move joints whose weight needs more than their efforts at the start: one by one, to where the loads are bearable.

    Args:
        robot: the robot, with gravity.
        start: values of joints with one degree of freedom [rad or m].
        joints: those of them that motors hold and that no constraint couples.

    Returns:
        New values, and a line on the moved joints; the given values and no line if no start is bearable.
    """
    limits = {name: effort for name in joints if 0 < (effort := effort_limit(robot, name)) < np.inf}
    values = dict(start)
    if (_loads(robot, values, limits) <= 1.0).all():
        return values, []
    bearable = 0.8  # largest share of an effort limit that the weight takes at the start: the rest is for the motion
    for _ in limits:  # coordinate descent: the load of a joint depends on all behind it
        tried = [(name, value) for name in limits for value in _values_around(robot, name, values[name])]
        beyond = [_loads(robot, {**values, name: value}, limits) - bearable for name, value in tried]
        overloads = [float((np.maximum(each, 0.0) ** 2).sum()) for each in beyond]
        away = [abs(value - values[name]) for name, value in tried]
        # Overloads are rounded: of starts that are equally good, the one nearest to the usual start counts.
        best = min(range(len(tried)), key=lambda each: (round(overloads[each], 9), away[each]))
        values = _with_mimics(robot, {**values, tried[best][0]: tried[best][1]})
        if overloads[best] == 0.0:
            moved = [f"{name} at {values[name]:g}" for name in limits if values[name] != start[name]]
            why = "because their weight needs more than the efforts of the file at the usual values"
            return values, [f"start where motors can hold the weight: {', '.join(moved)}, {why}"]
    return dict(start), []


def is_loaded(robot: Robot, q: np.ndarray, joints: Collection[str]) -> bool:
    """Return whether gravity loads a joint at q (nq,) or at poses near it: an upright arm has no load at the start.

    Args:
        robot: the robot.
        q: start.
        joints: joints with one degree of freedom.
    """
    model, data = robot.model, robot.model.createData()
    pin.computeSubtreeMasses(model, data)
    rows = [robot.velocity_indices(name).start for name in joints]
    # Relative to the weight behind the joint, so that a small gripper counts as a heavy arm does.
    weights = [data.mass[robot.joint_id(name)] for name in joints]
    lever = 1e-4  # gravity loads a joint above this lever arm of the weight behind it [m]; for a slide, share of it
    least = np.maximum(np.linalg.norm(model.gravity.linear) * lever * np.array(weights), 1e-6)
    # The same poses each time: a draft does not change by chance.
    poses, aside = 4, 0.5  # number of random poses, and their distance from the start [rad or m]
    steps = np.zeros((1 + poses, model.nv))
    steps[1:, rows] = np.random.default_rng(0).uniform(-aside, aside, (poses, len(rows)))
    beside = [pin.integrate(model, q, step) for step in steps]
    forces = [np.abs(pin.computeGeneralizedGravity(model, data, each))[rows] for each in beside]
    return bool((np.max(forces, axis=0) > least).any())


def _loads(robot: Robot, start: Mapping[str, float], limits: Mapping[str, float]) -> np.ndarray:
    """Efforts that hold joints against gravity, as shares of their limits."""
    forces = pin.computeGeneralizedGravity(robot.model, robot.model.createData(), robot.configuration(start))
    rows = [robot.velocity_indices(name).start for name in limits]
    return np.abs(forces[rows]) / np.array([*limits.values()])


def _values_around(robot: Robot, name: str, value: float) -> list[float]:
    """Values of a revolute joint within its limits; the weight on a slide does not depend on its own position."""
    if robot.single_joint(name).unit != "rad/s":
        return [value]
    low, high = _inner_range(robot, name)
    ends = max(low, value - np.pi), min(high, value + np.pi)
    tried = 25  # number of values of a joint that are tried
    return [value, *np.round(np.linspace(*ends, tried), 4).tolist()] if ends[0] < ends[1] else [value]
