"""Uses of the redundancy of a scenario's robot, and the scenario of one of them, tried before it is written."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, product
from typing import Literal

import numpy as np

from rnc_pin.analysis import Exploration, Use, default_candidates, explore, short_names, tip_positions
from rnc_pin.applications.init.evidence import joint_limits
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.errors import ConfigurationError, RncError, SingularityError, place_of
from rnc_pin.io import Json, to_json_mapping
from rnc_pin.model import OutputKind, OutputStack, heading_of
from rnc_pin.outputs import CenterOfMass, FramePosition, FrameSpeed, FrameYaw, JointPosition, velocity_outputs
from rnc_pin.verdict import Verdict

_KEPT = "robot", "ground", "constraints", "mimic", "actuators", "forces", "obstacles"
_MOTION = 4.0  # duration of the reference [s]
_NEAR = 0.7  # distance of joints from the start that is tried where the start is singular [rad or m]
_BEND = 0.3  # motion of the joints [rad]


@dataclass(frozen=True)
class FoundUse:
    """Use of the redundancy of a scenario's robot.

    Attributes:
        scenario: the robot and its start.
        exploration: uses beside the same primary outputs.
        use: this one.
        outputs: outputs of the robot by the names of their rows.
    """

    scenario: Scenario
    exploration: Exploration
    use: Use
    outputs: Mapping[str, OutputKind]

    @property
    def title(self) -> str:
        """Class and sentence."""
        kind = self.use.redundancy_class
        return f"{'none' if kind is None else f'class {kind}'}: {self.use.reason}"

    def kinds(self, names: Iterable[str]) -> list[OutputKind]:
        """Outputs of the robot that have rows of these names.

        Args:
            names: names of rows.
        """
        return _kinds(self.outputs, names)

    @property
    def is_of_coordinates(self) -> bool:
        """True if no controller takes the outputs of the use: redundant coordinates, or some rows of a rotation."""
        rows = {name for each in self.kinds(self.use.moved) for name in each.bind(self.scenario.robot).names}
        is_apart = rows == {*self.use.moved} and rows.isdisjoint(self.use.redundant)
        return self.use.redundancy_class in ("1", "2") and not is_apart

    def near_start(self) -> tuple[FoundUse, dict[str, float]]:
        """Return a use near the start, and the joints there at which it moves its outputs best."""
        scenario, robot = self.scenario, self.scenario.robot
        kinds = (each for group in default_candidates(scenario.reduced) for each in group)
        joints = {each.joint: robot.single_joint(each.joint) for each in kinds if isinstance(each, JointPosition)}
        region: dict[str, tuple[float, float]] = {}
        for name, joint in joints.items():
            low, high = joint_limits(robot, name)
            margin = min(_BEND, 0.1 * (high - low))  # the motion itself needs room to each limit
            ends = np.clip(joint.position(scenario.q0) + np.array([-_NEAR, _NEAR]), low + margin, high - margin)
            region[name] = float(ends[0]), float(ends[1])
        primary, vertical = self.kinds(self.exploration.primary), self.kinds(self.use.moved)
        # Fewer samples: the class is known, and only the best posture near the start is asked for.
        local = explore(scenario.reduced, primary, [vertical], 32, region=region)
        use = local.rows[0] if local.rows else self.use
        start = {name: round(float(joint.position(use.best_at)), 3) for name, joint in joints.items()}
        return replace(self, exploration=local, use=use), start

    def content(self, start: Mapping[str, float], share: float, tracker: str) -> dict[str, Json]:
        """Content of a scenario file.

        Args:
            start: joints that start elsewhere than in the scenario [rad or m].
            share: share of the usual motion.
            tracker: velocity tracker of the controller.
        """
        use, scenario, robot = self.use, self.scenario, self.scenario.robot
        followers = {each.joint for each in robot.mimics if start}  # where their drivers start elsewhere
        primary, redundant = self.kinds(self.exploration.primary), self.kinds(use.redundant)
        vertical = [] if self.is_of_coordinates else self.kinds(use.moved)
        if use.redundancy_class == "3":  # a platform that drives and turns
            redundant = [FrameSpeed(robot.links_of(1)[0], "x"), FrameYaw(robot.links_of(1)[0])]
        roles = {"primary": primary, "redundant": redundant, "vertical": vertical}
        names = {role: [name for each in kinds for name in each.bind(robot).names] for role, kinds in roles.items()}
        content = {
            "title": self.title,
            **{key: scenario.raw[key] for key in _KEPT if key in scenario.raw},
            "outputs": {"reducing": _entries([*primary, *redundant]), "vertical": _entries(vertical)},
            "task": names,
            "initial": {"q": {k: q for k, q in {**scenario.content.initial.q, **start}.items() if k not in followers}},
            **self._control(share, tracker),
        }
        return to_json_mapping(content, "use")

    def _control(self, share: float, tracker: str) -> dict[str, object]:
        """Controller of the class, a reference that moves the vertical outputs a little, and the duration."""
        exploration, use = self.exploration, self.use
        controller: dict[str, object] = {"type": "redundancy", "preset": "scaled", "tracker": tracker}
        by: dict[str, list[float]] = {}
        bent, duration = _BEND * share * exploration.length, _MOTION + 2.0  # and a rest at the end [s]
        match use.redundancy_class:
            case "1" | "2":
                bound = [self.outputs[name].bind(self.scenario.robot) for name in use.moved]
                units = [rows.units[rows.names.index(name)] for name, rows in zip(use.moved, bound, strict=True)]
                # The least mobile direction gets the usual motion of the joints times its singular value.
                step = bent * float(use.singular_values[use.rank - 1]) / np.sqrt(len(units))
                by["vertical"] = [step / exploration.length if unit.startswith("rad") else step for unit in units]
                if self.is_of_coordinates:
                    by = {"redundant": self._coordinate_steps(by["vertical"])}
                    controller["type"] = "reducing_outputs"
                elif exploration.motions > len(use.moved):
                    controller["posture"] = {}
            case "2s":  # it steers only while it drives
                travel = share * 8.0 * exploration.length  # eight lengths of the robot
                # Vertical outputs turn by the angle of steering times the speed: without travel nothing happens.
                by["primary"] = [travel if "_speed_" in name else 0.0 for name in exploration.primary]
                by["vertical"] = [_BEND * share] * len(use.moved)
                controller["type"] = "steering"
            case "3":
                controller = {"type": "two_phase", "preset": "scaled", "platform": self._parking(bent)}
                duration = 24.0  # [s] of a manoeuvre of several phases
            case _:
                raise ConfigurationError(use.reason)
        motions = {
            role: {"minimum_jerk": {"by": np.round(each, 4).tolist(), "duration": _MOTION}} for role, each in by.items()
        }
        return {"reference": motions, "controller": controller, "simulation": {"duration": duration, "dt": 0.002}}

    def _coordinate_steps(self, steps: Sequence[float]) -> list[float]:
        """Displacements of the redundant coordinates that move the outputs of a use by these steps, to first order."""
        use, primary, scenario = self.use, self.exploration.primary, self.scenario
        kinds = self.kinds((*primary, *use.moved, *use.redundant))
        stack, at = OutputStack([kind.bind(scenario.robot) for kind in kinds]), scenario.reduced.at(use.best_at)
        rates = dict(zip(stack.names, stack.jacobian(at.position) @ at.R, strict=True))
        wanted = np.pad(steps, (len(primary), 0))  # primary outputs stand
        motion = np.linalg.lstsq(np.array([rates[name] for name in (*primary, *use.moved)]), wanted, rcond=None)[0]
        return [float(rates[name] @ motion) for name in use.redundant]

    def _parking(self, aside: float) -> dict[str, Json]:
        """Goal of a platform that moves aside while the hand rests."""
        scenario, base = self.scenario, self.scenario.robot.links_of(1)[0]
        position = [f"{base}_x", f"{base}_y"]
        if not {*position} <= {*self.use.moved} <= {*position, f"{base}_yaw"}:
            raise ConfigurationError("class 3 has a controller for the pose of a platform that drives and turns only")
        place = scenario.reduced.at(scenario.q0).position.placement(scenario.robot.frame_id(base))
        yaw = heading_of(place.rotation)
        to = place.translation[:2] + aside * np.array([-np.sin(yaw), np.cos(yaw)])
        return {"position": list[Json](position), "to": np.round([*to, yaw], 4).tolist(), "begin": 1.0}


def find_uses(scenario: Scenario, primary: Sequence[str] = ()) -> tuple[list[FoundUse], list[str]]:
    """Find the uses of the redundancy of a scenario's robot, best first, and what could not be explored.

    Args:
        scenario: the robot, its constraints and outputs.
        primary: names of primary outputs; by default those of the scenario, then the position of each end of a chain.

    Raises:
        ConfigurationError: an output is unknown, or the robot cannot move the primary ones independently.
    """
    reduced, known = scenario.reduced, _known_outputs(scenario)
    tips = (tuple(each.bind(reduced.robot).names) for each in tip_positions(reduced))
    found: list[FoundUse] = []
    failures: list[str] = []
    # The scenario's own task first, then the ends of chains: what a user would try.
    for names in [primary] if primary else filter(None, dict.fromkeys((tuple(scenario.task.primary_names), *tips))):
        try:
            each = explore(reduced, _kinds(known, names))
        except ConfigurationError as error:
            if primary:  # the user asked for these and no others
                raise
            failures.append(str(error))
            continue
        found += [FoundUse(scenario, each, use, known) for use in each.rows]
        failures += [] if each.motions else [f"no motion is left beside {short_names(each.primary)}"]
    if found and reduced.actuation.names:
        # Uses are of kinematics: a motion that no motor drives is found as well.
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
    groups = [list(rows) for _, rows in groupby(range(len(found)), lambda k: id(found[k].exploration))]
    return [k for group in groups for k in group[: max(1, most // len(groups))]][:most]


def scenario_of(found: FoundUse) -> tuple[Scenario, Verdict]:
    """Return the scenario of a use and the verdict of its run: the first that succeeds, else the one with most motion.

    Args:
        found: the use.

    Raises:
        ConfigurationError: no controller of this package makes such a motion, or none completes it.
    """
    called = short_names(found.use.vertical)
    if not found.use.driven:
        raise ConfigurationError(f"{called}: {found.use.reason}")
    failures: list[str] = []
    best: tuple[Scenario, Verdict] | None = None
    shares = 1.0, 0.3, 0.1  # of the usual motion
    # The given start first; a bent one where it is singular. Smaller motions keep limits that larger ones exceed.
    for bent in (False, True):
        try:
            use, start = found.near_start() if bent else (found, {})
        except RncError as error:
            failures.append(str(error))
            continue
        for share, tracker in product(shares, ("adaptive", "computed_torque")):
            try:
                made = replace(found.scenario, raw=use.content(start, share, tracker), show_warnings=False)
                verdict = made.run().verdict
            except RncError as error:
                failures.append(str(error))
                if isinstance(error, SingularityError):  # no share of the motion and no tracker changes the start
                    break
                continue
            if verdict.succeeded:
                return made, verdict
            best = best or (made, verdict)
    if best is None:
        raise ConfigurationError(f"{called}: {failures[0]}")
    return best


# ---------------------------------------------------------------------- outputs


def _known_outputs(scenario: Scenario) -> dict[str, OutputKind]:
    """Outputs of one row, or of three of a rotation, by the names of their rows."""
    robot, found = scenario.robot, dict[str, OutputKind]()
    candidates = (each for group in default_candidates(scenario.reduced) for each in group)
    # Outputs of the file first: their names keep their meaning.
    for kind in filter(None, (*scenario.content.listed_outputs, *candidates, *velocity_outputs(robot).values())):
        kinds: list[OutputKind] = [kind]
        if isinstance(kind, FramePosition | CenterOfMass):
            axes: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")
            kinds = [replace(kind, axes=axis) for axis in axes if axis in kind.axes]
        for each in kinds:
            found |= {name: found.get(name, each) for name in each.bind(robot).names}
    return found


def _kinds(known: Mapping[str, OutputKind], names: Iterable[str]) -> list[OutputKind]:
    """Outputs of these names."""
    kinds = [*known.values()]
    return list(dict.fromkeys(kinds[place_of(name, [*known], "no output")] for name in names))


def _entries(kinds: Iterable[OutputKind]) -> list[dict[str, object]]:
    """Entries of a scenario file."""
    found: list[dict[str, object]] = []
    for each in kinds:
        key = re.sub("(?<!^)([A-Z])", r"_\1", type(each).__name__).lower().replace("joint_position", "joint")
        found.append({key: {name: value for name, value in vars(each).items() if value is not None}})
    return found
