"""Uses of the redundancy of a scenario's robot, and the scenario of one of them, tried before it is written."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np

from rnc_pin.analysis import Exploration, Use, default_candidates, explore, short_names, tip_positions
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.errors import ConfigurationError, RncError, SingularityError, nearest
from rnc_pin.io import Json, to_json_mapping
from rnc_pin.model import OutputKind
from rnc_pin.outputs import CenterOfMass, FrameAngularVelocity, FramePosition, FrameSpeed, FrameYaw, JointPosition
from rnc_pin.robots import Robot
from rnc_pin.verdict import Verdict

_KEPT = "robot", "ground", "constraints", "mimic", "actuators", "forces", "obstacles"
_SHARES = 1.0, 0.3, 0.1  # of the usual motion
_MOTION, _REST, _MANOEUVRE = 4.0, 2.0, 24.0  # [s]
_NEAR = 0.7  # distance of joints from the start that is tried where the start is singular [rad or m]
_BEND = 0.3  # motion of the joints [rad]
_VECTORS = FramePosition | CenterOfMass
_AXES: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")
_TRAVEL = 8.0  # distance of a vehicle that steers, in lengths of the robot


@dataclass(frozen=True)
class FoundUse:
    """Use of the redundancy of a scenario's robot.

    Attributes:
        exploration: uses beside the same primary outputs.
        use: this one.
    """

    exploration: Exploration
    use: Use

    @property
    def title(self) -> str:
        """Class and sentence."""
        kind = self.use.redundancy_class
        return f"{'none' if kind is None else f'class {kind}'}: {self.use.reason}"


def find_uses(scenario: Scenario, primary: Sequence[str] = ()) -> tuple[list[FoundUse], list[str]]:
    """Find the uses of the redundancy of a scenario's robot, best first, and what could not be explored.

    Args:
        scenario: the robot, its constraints and outputs.
        primary: names of primary outputs; by default those of the scenario, then the position of each end of a chain.

    Raises:
        ConfigurationError: an output is unknown, or the robot cannot move the primary ones independently.
    """
    reduced, known = scenario.reduced, _known_outputs(scenario)
    for name in primary:
        if name not in known:
            raise ConfigurationError(f"--primary: no output '{name}'{nearest(name, known)}")
    own = [] if primary or not scenario.task.primary_names else [list(scenario.task.primary_names)]
    tips = [] if primary else [list(each.bind(reduced.robot).names) for each in tip_positions(reduced)]
    found: list[FoundUse] = []
    failures: list[str] = []
    for names in [list(primary)] if primary else [*own, *(each for each in tips if each not in own)]:
        try:
            each = explore(reduced, _whole(known, names))
        except ConfigurationError as error:
            if primary:
                raise
            failures.append(str(error))
            continue
        found += [FoundUse(each, use) for use in each.rows]
        if not each.motions:
            failures.append(f"no motion is left beside {short_names(each.primary)}")
    if found and reduced.actuation.names:
        driven = int(np.linalg.matrix_rank(reduced.at(found[0].use.best_at).input_matrix))
        if driven < reduced.r:
            failures.append(f"actuators drive {driven} of {reduced.r} motions: a use may need the others too")
    return found, failures


def best_rows(found: Sequence[FoundUse], most: int) -> list[int]:
    """Return the indices of the best uses, as many beside each set of primary outputs.

    Args:
        found: all uses.
        most: largest number of indices.
    """
    groups: dict[int, list[int]] = {}
    for k, each in enumerate(found):
        groups.setdefault(id(each.exploration), []).append(k)
    share = max(1, most // max(1, len(groups)))
    return [k for group in groups.values() for k in group[:share]][:most]


def scenario_of(scenario: Scenario, found: FoundUse) -> tuple[Scenario, Verdict]:
    """Return the scenario of a use and the verdict of its run: the first that succeeds, else the one with most motion.

    Args:
        scenario: the robot and its start.
        found: the use.

    Raises:
        ConfigurationError: no controller of this package makes such a motion, or none completes it.
    """
    failures: list[str] = []
    best: tuple[Scenario, Verdict] | None = None
    singular: set[bool] = set()
    for bent, share, tracker in product((False, True), _SHARES, ("adaptive", "computed_torque")):
        if bent in singular:
            continue
        try:
            start = _bent_start(scenario, found) if bent else (found, {})
            made = replace(scenario, raw=_content(scenario, *start, share, tracker), show_warnings=False)
            verdict = made.run().verdict
        except RncError as error:
            failures.append(str(error))
            singular |= {bent} if isinstance(error, SingularityError) else set()
            continue
        if verdict.succeeded:
            return made, verdict
        best = best or (made, verdict)
    if best is None:
        raise ConfigurationError(f"{short_names(found.use.vertical)}: {failures[0]}")
    return best


def _bent_start(scenario: Scenario, found: FoundUse) -> tuple[FoundUse, dict[str, float]]:
    """Return a use near the start, and the joints there at which it moves its outputs best."""
    known, robot, model = _known_outputs(scenario), scenario.robot, scenario.robot.model
    joints = {kind.joint: robot.single_joint(kind.joint) for kind in known.values() if isinstance(kind, JointPosition)}
    region: dict[str, tuple[float, float]] = {}
    for name, joint in joints.items():
        value, k = float(joint.position(scenario.q0)), joint.idx_q
        low, high = (
            (-np.inf, np.inf) if joint.continuous else (model.lowerPositionLimit[k], model.upperPositionLimit[k])
        )
        region[name] = max(low, min(value, high) - _NEAR), min(high, max(value, low) + _NEAR)
    primary, vertical = _whole(known, found.exploration.primary), _whole(known, found.use.moved)
    local = explore(scenario.reduced, primary, [vertical], 32, region=region)
    if not local.rows:
        raise ConfigurationError(f"{short_names(found.use.vertical)}: not moved near the start")
    use = local.rows[0]
    start = {name: round(float(joint.position(use.best_at)), 3) for name, joint in joints.items()}
    return FoundUse(local, use), start


def _content(
    scenario: Scenario, found: FoundUse, start: Mapping[str, float], share: float, tracker: str
) -> dict[str, Json]:
    """Content of the scenario file."""
    use, known, robot = found.use, _known_outputs(scenario), scenario.robot
    primary, vertical = _whole(known, found.exploration.primary), _whole(known, use.moved)
    redundant = _whole(known, use.redundant)
    if use.redundancy_class == "3":  # a platform that drives and turns
        redundant = [FrameSpeed(_base(robot), "x"), FrameYaw(_base(robot))]
    given = scenario.content.initial.q
    content = {
        "title": found.title,
        **{key: scenario.raw[key] for key in _KEPT if key in scenario.raw},
        "outputs": {"reducing": _entries([*primary, *redundant]), "vertical": _entries(vertical)},
        "task": {
            "primary": _names(primary, robot),
            "redundant": _names(redundant, robot),
            "vertical": _names(vertical, robot),
        },
        "initial": {"q": {**given, **start}},
        **_control(scenario, found, share, tracker),
    }
    return to_json_mapping(content, "use")


def _control(scenario: Scenario, found: FoundUse, share: float, tracker: str) -> dict[str, Json]:
    """Controller of the class, a reference that moves the vertical outputs a little, and the duration."""
    exploration, use, robot = found.exploration, found.use, scenario.robot
    controller: dict[str, Json] = {"type": "redundancy", "preset": "scaled", "tracker": tracker}
    simulation: dict[str, Json] = {"duration": _MOTION + _REST, "dt": 0.002}
    bent = _BEND * share * exploration.length
    if use.redundancy_class == "1" or use.redundancy_class == "2":
        units = [unit for each in _whole(_known_outputs(scenario), use.moved) for unit in each.bind(robot).units]
        step = bent * float(use.singular_values[use.rank - 1]) / np.sqrt(len(units))
        by = [step / exploration.length if unit.startswith("rad") else step for unit in units]
        wide = {"posture": dict[str, Json]()} if exploration.motions > len(use.moved) else {}
        return {"reference": {"vertical": _motion(by)}, "controller": {**controller, **wide}, "simulation": simulation}
    if use.redundancy_class == "2s":  # it steers only while it drives
        travel = share * _TRAVEL * exploration.length
        drive = [travel if "_speed_" in name else 0.0 for name in exploration.primary]
        reference = {"primary": _motion(drive), "vertical": _motion([_BEND * share] * len(use.moved))}
        return {
            "reference": dict(reference),
            "controller": {**controller, "type": "steering"},
            "simulation": simulation,
        }
    if use.redundancy_class == "3":
        platform = _parking(scenario, use, bent)
        return {
            "controller": {"type": "two_phase", "preset": "scaled", "platform": platform},
            "simulation": {**simulation, "duration": _MANOEUVRE},
        }
    raise ConfigurationError(use.reason)


def _motion(by: list[float]) -> dict[str, Json]:
    return to_json_mapping({"minimum_jerk": {"by": np.round(by, 4).tolist(), "duration": _MOTION}}, "reference")


def _parking(scenario: Scenario, use: Use, aside: float) -> dict[str, Json]:
    """Goal of a platform that moves aside while the hand rests."""
    base = _base(scenario.robot)
    position = [f"{base}_x", f"{base}_y"]
    if not {*position} <= {*use.moved} <= {*position, f"{base}_yaw"}:
        raise ConfigurationError("class 3 has a controller for the pose of a platform that drives and turns only")
    place = scenario.reduced.at(scenario.q0).position.placement(scenario.robot.frame_id(base))
    yaw = float(np.arctan2(place.rotation[1, 0], place.rotation[0, 0]))
    to = place.translation[:2] + aside * np.array([-np.sin(yaw), np.cos(yaw)])
    return {"position": list[Json](position), "to": np.round([*to, yaw], 4).tolist(), "begin": 1.0}


# ---------------------------------------------------------------------- outputs


def _base(robot: Robot) -> str:
    """Body of the first joint."""
    return next(str(each.name) for each in robot.model.frames if each.type.name == "BODY" and each.parentJoint == 1)


def _known_outputs(scenario: Scenario) -> dict[str, OutputKind]:
    """Outputs of one row, or of three of a rotation, by the names of their rows, and of entries of v by their names."""
    reduced, robot = scenario.reduced, scenario.robot
    found: dict[str, OutputKind] = {}
    for kind in (*scenario.content.listed_outputs, *(each for group in default_candidates(reduced) for each in group)):
        parts = [replace(kind, axes=axis) for axis in kind.axes] if isinstance(kind, _VECTORS) else [kind]
        for each in parts:
            found |= {name: found.get(name, each) for name in each.bind(robot).names}
    for joint, model in zip(robot.joint_names, list(robot.model.joints)[1:], strict=True):
        if model.nv == 1:
            found.setdefault(joint, JointPosition(joint))
    size = int(robot.model.joints[1].nv)
    if size in (3, 6):
        base = _base(robot)
        spins: list[OutputKind] = (
            [FrameYaw(base)] if size == 3 else [FrameAngularVelocity(base, axis) for axis in _AXES]
        )
        speeds = [FrameSpeed(base, axis) for axis in _AXES[: size - len(spins)]]
        moving = {f"{robot.joint_names[0]}[{k}]": each for k, each in enumerate([*speeds, *spins])}
        found |= moving | {name: each for each in moving.values() for name in each.bind(robot).names}
    return found


def _whole(known: Mapping[str, OutputKind], names: Iterable[str]) -> list[OutputKind]:
    """Outputs of these names, with all axes of a vector in one."""
    found: list[OutputKind] = []
    for kind in dict.fromkeys(known[name] for name in names):
        last = found[-1] if found else None
        if (
            isinstance(kind, _VECTORS)
            and isinstance(last, _VECTORS)
            and replace(last, axes="") == replace(kind, axes="")
        ):
            found[-1] = replace(last, axes=last.axes + kind.axes)
        else:
            found.append(kind)
    return found


def _names(kinds: Iterable[OutputKind], robot: Robot) -> list[str]:
    return [name for each in kinds for name in each.bind(robot).names]


def _entries(kinds: Iterable[OutputKind]) -> list[dict[str, object]]:
    """Entries of a scenario file."""
    found: list[dict[str, object]] = []
    for each in kinds:
        if isinstance(each, JointPosition):
            found.append({"joint": each.joint})
            continue
        key = re.sub("(?<!^)([A-Z])", r"_\1", type(each).__name__).lower()
        found.append({key: {name: value for name, value in vars(each).items() if value is not None}})
    return found
