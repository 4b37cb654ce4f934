"""Use of kinematic redundancy: outputs that a robot can control beside its primary ones, found without a partition.

With primary outputs x21 (Jacobian J21), the motions that leave them alone are ``v = R N z`` with ``J21 R N = 0``. A set
of vertical outputs x1 (rows J1) moves with them by ``D = J1 R N``. Rank and singular values of D do not depend on the
choice of redundant coordinates x22, which only changes the conditioning of the reduction. So the search is over sets of
vertical outputs. Columns of ``R N`` are orthonormal here, with angles multiplied by a length of the robot: then
singular values are motions of outputs per motion of joints.

The paper defines the classes, section 3.2 (``classify`` has the same with a given partition):

* 1: D has full row rank.
* 2: some rows of D vanish. The others are square and nonsingular, and the rates of the former do not depend on x22.
* 2s: D vanishes, and the values of x22 steer the rates of x1.
* 3: D has not full row rank, but brackets of the motions ``R N`` have: manoeuvres reach x1 while x21 rests. It is
  looked for among at most 16 motions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations
from typing import cast

import numpy as np

from rnc_pin.analysis.growth import grow, regular_samples
from rnc_pin.analysis.redundancy_class import has_full_row_rank, largest_entries, motions_alone, rates_along
from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import ConfigurationError, RncError, SingularityError, few
from rnc_pin.io.json import Json, to_json_mapping
from rnc_pin.math.linear_algebra import pivot_columns
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.configuration_evaluation import ConfigurationEvaluation
from rnc_pin.model.evaluator import evaluator_for
from rnc_pin.model.input_validation import Axes
from rnc_pin.model.kinematics import Kinematics, PositionKinematics, VelocityKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import GroundContact, OutputKind, OutputRows, OutputStack, Rows, RowStack
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.model.task import OutputTarget, find_output
from rnc_pin.outputs import (
    CenterOfMass,
    FrameOrientation,
    FramePosition,
    FrameTilt,
    FrameYaw,
    JointPosition,
    velocity_outputs,
)
from rnc_pin.printing import Item, ObjectSummary, SummaryMixin, counted
from rnc_pin.robots.robot import Robot

_ZERO = 1e-9  # motion, relative to the largest of all outputs, that is rounding
_RANK = 1e-6  # singular value of D, relative to its largest, below which a direction is not moved
_USUAL = 0.9  # share of the samples that decides
_POSES = 4  # samples at which a straight joint has to make D singular, or at which a frame may move


@dataclass(frozen=True)
class Use:
    """Use of the redundancy: a set of vertical outputs, and what motions that leave the primary ones alone do to it.

    Attributes:
        vertical: names of the outputs (k,).
        redundancy_class: "1", "2", "2s", "3" or None.
        moved: names of the outputs that the class says move or are steered.
        rank: usual rank of D.
        singular_values: median of each over the samples (k,); angles of outputs and joints count by ``length``.
        smallest: smallest singular value at any sample.
        singular_share: share of the samples at which D is singular or nearly so.
        singular_at: configuration (nq,) of the smallest one.
        best_at: configuration (nq,) of the largest one.
        straight: joints that make D singular when they are straight or folded (0 or pi), whatever the others do.
        redundant: names of the coordinates x22 that reduce best: joints, or speeds of a body that moves freely.
        driven: False if actuators cannot begin these motions from rest while the primary outputs rest.
        actuators: actuators that do most of the work.
        effort: largest static effort of these over the samples, in the median [N or N m]; None without gravity.
        reason: one sentence: what moves, by which motion of the joints, where that is lost.
    """

    vertical: tuple[str, ...]
    redundancy_class: str | None
    moved: tuple[str, ...]
    rank: int
    singular_values: Float[Array, " k"]
    smallest: float
    singular_share: float
    singular_at: Float[Array, " nq"]
    best_at: Float[Array, " nq"]
    straight: tuple[str, ...]
    redundant: tuple[str, ...]
    driven: bool
    actuators: tuple[str, ...]
    effort: float | None
    reason: str

    def to_dict(self) -> dict[str, Json]:
        """Return lists, numbers and strings that JSON can store."""
        return to_json_mapping(vars(self), "use")


@dataclass(frozen=True, repr=False)
class Exploration(SummaryMixin):
    """Result of ``explore``, best use first.

    Attributes:
        primary: names of the primary outputs.
        motions: number of independent motions that leave the primary outputs alone.
        length: length by which angles count [m].
        samples: regular configurations that were evaluated.
        rows: uses of the redundancy.
        untried: number of sets that were left out, because there are too many.
    """

    primary: tuple[str, ...]
    motions: int
    length: float
    samples: int
    rows: tuple[Use, ...]
    untried: int

    def to_dict(self) -> dict[str, Json]:
        """Return lists, numbers and strings that JSON can store."""
        return to_json_mapping({**vars(self), "rows": [each.to_dict() for each in self.rows]}, "exploration")

    def _summary(self) -> ObjectSummary:
        title = f"Exploration: {counted(self.motions, 'motion')} beside {short_names(self.primary)}"
        kinds = [f"class {each.redundancy_class}" if each.redundancy_class else "none" for each in self.rows]
        names = [f"{short_names(each.vertical)} ({kind})" for each, kind in zip(self.rows, kinds, strict=True)]
        return ObjectSummary(title, [(name, [Item(each.reason)]) for name, each in zip(names, self.rows, strict=True)])


def short_names(names: Sequence[str]) -> str:
    """Return names in one line, with the components of a vector together: ``hand_xyz``.

    Args:
        names: names of outputs.
    """
    found: list[str] = []
    for name in names:
        stem = name[:-1]
        joins = found and name[-2:-1] == "_" and found[-1].rstrip("xyz") == stem and found[-1] != stem
        found = [*found[:-1], found[-1] + name[-1]] if joins else [*found, name]
    return ", ".join(found)


def explore(
    reduced: ReducedModel,
    primary: Sequence[OutputTarget],
    candidates: Sequence[OutputTarget | Sequence[OutputTarget]] | None = None,
    samples: int = 64,
    seed: int = 0,
    region: Mapping[str, tuple[float, float]] | None = None,
) -> Exploration:
    """Find what the redundancy of a robot can do beside primary outputs, at seeded random configurations.

    Args:
        reduced: the model, with any reducing outputs; a rheonomic one is explored at time zero.
        primary: primary outputs, by name or as output objects.
        candidates: vertical outputs: names, output objects, or lists of them that belong together. By default the
            vertical outputs of the model, position and orientation of the base and of the ends of chains, yaw and tilt
            of a free base under gravity, the centre of mass, and joints. A joint also stands for its distance to a
            limit, and the joint of a trailer for its angle.
        samples: number of configurations.
        seed: of the random configurations.
        region: ranges (smallest, largest) of joints, by name [rad or m]; by default the limits, within half a turn.

    Raises:
        ConfigurationError: an unknown output, or primary outputs that the robot cannot move independently.
        InputError: ``samples`` is not a positive integer, or a range of ``region`` is wrong.
        ModelError: ``region`` names an unknown joint.
        SingularityError: every sampled configuration is singular.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> found = rnc.explore(system.reduce(), [rnc.FramePosition("tip", "xy")], samples=16)
        >>> use = next(each for each in found.rows if each.vertical == ("platform",))
        >>> use.redundancy_class, found.motions
        ('1', 1)
    """
    model = reduced.frozen(0.0)
    return _Exploring(model, primary, candidates, regular_samples(model, samples, seed, region), seed).found()


class _HeldRows(Rows):
    """Outputs at rest."""

    def __init__(self, outputs: RowStack) -> None:
        self._outputs, self.units = outputs, outputs.units
        self.names = tuple(f"held({name})" for name in outputs.names)

    def bind(self, robot: Robot) -> Rows:
        return self

    def jacobian(self, at: PositionKinematics) -> Array:
        return self._outputs.jacobian(at)

    def jacobian_dot(self, at: VelocityKinematics) -> Array:
        return self._outputs.jacobian_dot(at)

    def bias_acceleration(self, at: VelocityKinematics) -> Array:
        return self._outputs.bias_acceleration(at)


class _Set:
    """Set of vertical outputs.

    Args:
        rows: places of the outputs among all candidates (k,).
        D: motions of all candidates at the samples (S, all, r2).
        names: names of all candidates.

    Attributes:
        names: names of these outputs (k,).
        D: motions of these outputs (S, k, r2).
        values: singular values of D.
        rank: usual rank.
        full: True if D usually has full row rank.
        moved: mask of the outputs that move (k,).
    """

    def __init__(self, rows: tuple[int, ...], D: Array, names: Sequence[str]) -> None:
        self.rows, self.D, self.names = rows, D[:, list(rows)], tuple(names[row] for row in rows)
        self.values = np.linalg.svd(self.D, compute_uv=False)
        # One scale for all candidates: an output that hardly moves beside the others does not move.
        scale = max(float(np.abs(D).max(initial=0.0)), 1e-300)
        ranks = (self.values > _RANK * scale).sum(axis=1)
        self.rank, self.full = int(np.median(ranks)), bool((ranks == len(rows)).mean() > _USUAL)
        self.moved = largest_entries(self.D) > _ZERO * scale


class _Exploring:
    def __init__(
        self,
        reduced: ReducedModel,
        primary: Sequence[OutputTarget],
        candidates: Sequence[OutputTarget | Sequence[OutputTarget]] | None,
        q: Array,
        seed: int,
    ) -> None:
        self._reduced, self._robot, self._seed = reduced, reduced.robot, seed
        chosen = [find_output(reduced, each, "a primary output has to be") for each in primary]
        if not primary:
            raise ConfigurationError("primary outputs: expected at least one")
        self._by_default = candidates is None
        self._primary = tuple(stack.names[row] for stack, rows in chosen for row in rows)
        own = (place.of(np.array(place.block.names)).tolist() for place in reduced.vertical.places)
        offered = [*own, *default_candidates(reduced)] if candidates is None else candidates
        together = ([each] if isinstance(each, str | OutputKind) else each for each in offered)
        groups = [[find_output(reduced, one, "a candidate has to be") for one in each] for each in together]
        used = [*chosen, *(pair for group in groups for pair in group)]
        blocks = (place.block for stack, _ in used for place in stack.places)
        outputs = {each.names: each for each in blocks if isinstance(each, OutputRows)}
        self._outputs = OutputStack(list(outputs.values()))
        self._names = self._outputs.names
        self._first = [self._names.index(name) for name in self._primary]
        self._evaluator = evaluator_for(reduced.reduction_data.measuring(self._outputs), reduced.evaluator)
        at_start = Kinematics(self._robot).position(self._robot.configuration())
        places = [at_start.placement(frame).translation for frame in range(self._robot.model.nframes)]
        size = 0.5 * float(np.linalg.norm(np.ptp(places, axis=0)))  # of the box around all frames
        point = 1e-3  # [m] below which a robot has no length
        self._length = size if size > point else 1.0
        angles = np.array([unit.startswith("rad") for unit in self._robot.velocity_units])
        # Angles times the size of the robot are lengths: motions of both kinds can then be compared.
        self._lengths = np.where(angles, self._length, 1.0)[:, None]
        self._angular = [unit.startswith("rad") for unit in self._outputs.units]
        self._scale = scale = np.where(self._angular, self._length, 1.0)[:, None]
        good, (self._A, self._J, P, self._ways, self._D) = self._motions_at(q)
        # Not at all samples: some are next to a singularity.
        if not good.mean() > _USUAL:
            raise ConfigurationError(
                f"primary outputs {', '.join(self._primary)}: the robot cannot move them independently"
            )
        self._q, self.motions, self._inverse = q[good], self._ways.shape[-1], np.linalg.pinv(P)
        sizes, moved = largest_entries(scale * self._J), largest_entries(scale * self._A)
        nothing = sizes <= _ZERO * sizes.max()
        self._conserved = ~nothing & (moved <= _ZERO * moved.max())
        rows = [[self._names.index(stack.names[row]) for stack, each in group for row in each] for group in groups]
        kept = [tuple(k for k in group if not nothing[k] and k not in self._first) for group in rows]
        self._groups = list(dict.fromkeys(group for group in kept if group))
        self._coordinate_names = list(velocity_outputs(self._robot))
        self._redundant, self._redundant_names = self._coordinates() if self.motions else ([], ())

    def _motions_at(self, q: Array) -> tuple[Array, tuple[Array, ...]]:
        """Mask of the configurations where the primary outputs are independent; A_star, J, P, R N and D at these."""
        # All samples in one call, with all outputs as vertical ones: each set of outputs is a choice of rows then.
        here, count = self._reduced.at(q).in_reduction(self._evaluator), len(self._first)
        _, values, right = np.linalg.svd(here.A_star[:, self._first])
        # Where the primary outputs depend on each other, motions beside them are not defined.
        good = (values[:, -1] > _RANK * values[:, 0]) & (count <= self._reduced.r)
        A, J = here.A_star[good], here.J1[good]
        # Orthonormal in lengths, so that singular values say how far an output moves for a unit of joint motion.
        ways = np.linalg.qr(self._lengths * (here.R[good] @ right[good, count:].mT))[0] / self._lengths  # (S, nv, r2)
        return good, (A, J, A[:, self._first], ways, self._scale * (J @ ways))

    # ------------------------------------------------------------------ search

    def found(self) -> Exploration:
        sets, untried = self._sets() if self.motions else ([], 0)
        rows = sorted((self._use(each) for each in sets), key=self._order)
        return Exploration(self._primary, self.motions, self._length, len(self._q), tuple(rows), untried)

    def _sets(self) -> tuple[list[_Set], int]:
        """Groups of outputs, then unions of groups whose parts all have full rank; and the number of untried unions."""
        found = [_Set(group, self._D, self._names) for group in self._groups]
        level: list[tuple[int, ...]]
        # Actuated joints and redundant coordinates are offered one by one only.
        own = {*self._reduced.actuation.names, *self._redundant_names} if self._by_default else set()
        single = [each.rows for each in found if each.full and not own.issuperset(each.names)]
        known = {frozenset(group) for group in self._groups}
        level, tried, untried = [(k,) for k in range(len(single))], 0, 0
        most_sets = 300  # the number of unions grows exponentially with the candidates
        while level:
            whole, larger = set(level), []
            for members in [(*each, k) for each in level for k in range(each[-1] + 1, len(single))]:
                rows = tuple(row for k in members for row in single[k])
                parts = combinations(members, len(members) - 1)
                failed = any(part not in whole for part in parts)
                # A set has full rank only if all its parts have: most unions need no singular values.
                if failed or len({*rows}) < len(rows) or len(rows) > self.motions or frozenset(rows) in known:
                    continue
                if tried == most_sets:
                    untried += 1
                    continue
                tried += 1
                if (union := _Set(rows, self._D, self._names)).full:
                    larger.append(members)
                    found.append(union)
            level = larger
        return found, untried

    def _decided(self, each: _Set) -> tuple[str | None, Array, str]:
        """Class, mask of the outputs that move, and words: by rank, then by first derivatives, then by brackets."""
        rows, count, moved = list(each.rows), len(each.rows), int(each.moved.sum())
        every = np.ones(count, dtype=bool)
        if self._conserved[rows].any():
            fixed = [name for name, row in zip(each.names, rows, strict=True) if self._conserved[row]]
            return None, ~every, f"no motion of the robot changes {short_names(fixed)}"
        if each.full:
            return "1", every, ""
        if not moved and (steered := self._steered(rows)).any():
            return "2s", steered, ""
        if 0 < moved < count and moved == self.motions and self._splits(each):
            return "2", each.moved, "the rest follows from the primary outputs"
        most_motions = 16  # whose brackets take less than a second; class 3 is not looked for among more
        if 1 < self.motions <= most_motions and each.rank < count:
            precision = 1e-5  # of brackets
            ranks = [np.linalg.matrix_rank(J[rows] @ closure, precision) for J, closure in self._closures]
            if ranks and float(np.median(ranks)) == count:  # brackets of the motions move outputs in all directions
                return "3", every, "not directly"
        still = f"{each.rank} of {counted(count, 'direction')} of {short_names(each.names)} can be moved"
        return None, ~every, still if moved else f"{short_names(each.names)} cannot be moved"

    def _steered(self, rows: Sequence[int]) -> Array:
        """Mask of the outputs whose rates the values of the redundant coordinates steer; none if not all at will."""
        # Steering needs a primary motion: a random one shows whatever some motion shows.
        v21 = np.random.default_rng(self._seed).uniform(0.5, 1.5, len(self._first))
        slopes = np.einsum("skji,i->skj", self._slopes(rows, self._ways), v21)
        steered = largest_entries(slopes) > _RANK * max(1.0, float(np.abs(self._A).max()))
        possible = int(steered.sum()) == self.motions and has_full_row_rank(slopes[:, steered])
        return steered & possible

    def _splits(self, each: _Set) -> bool:
        """True if the rates of the outputs that do not move are independent of the redundant coordinates.

        The derivative is that at fixed primary and vertical outputs. The constraints forbid such a motion, but a
        derivative allows it (``classify``).
        """
        rows, unit = np.array(each.rows), np.eye(self._J.shape[-1])[self._redundant]
        fixed = self._J[:, [*self._first, *rows]]
        all_rows = np.concatenate([fixed, np.broadcast_to(unit, (len(fixed), *unit.shape))], axis=1)
        # Motions of one redundant coordinate alone: the rest of the outputs must not notice its value.
        ways = motions_alone(all_rows, np.arange(fixed.shape[1], all_rows.shape[1]), self._ways)
        slopes = self._slopes(rows[~each.moved].tolist(), ways)
        return bool(np.abs(slopes).max() < _RANK * max(1.0, float(np.abs(self._A).max())))

    def _slopes(self, rows: Sequence[int], ways: Array) -> Array:
        """Derivatives (S, k, j, r1) along motions (S, nv, j) of B, where the rates of rows are ``B x21_dot``.

        Where D vanishes, ``J1 R = B P`` with ``P = J21 R``. So ``dB = (d(J1 R) - B dP) P^+``.
        """
        rates, B = rates_along(self._here, ways), self._A[:, rows] @ self._inverse
        slopes = (rates[:, :, rows] - B[:, None] @ rates[:, :, self._first]) @ self._inverse[:, None]
        return np.moveaxis(slopes, 1, 2)

    @cached_property
    def _here(self) -> ConfigurationEvaluation:
        """Model at the samples, with all outputs."""
        return self._reduced.at(self._q).in_reduction(self._evaluator)

    @cached_property
    def _closures(self) -> list[tuple[Array, Array]]:
        """Jacobian of all outputs, and directions that brackets of the redundant motions reach, at a few samples."""
        # The system adds rows without a kind itself, such as those of mimic joints.
        known = [place.block.kind for place in self._reduced.all_constraints.places if place.block.kind is not None]
        held = _HeldRows(self._outputs.selected(tuple(self._first)))
        found: list[tuple[Array, Array]] = []
        most_closures, deepest = 3, 4  # configurations at which brackets are evaluated, and the order of these
        with suppress(RncError):
            # Primary outputs at rest as further constraints: brackets of what is left are manoeuvres beside them.
            resting = NonholonomicSystem(self._robot, [*known, held]).reduce()
            for q, J in zip(self._q, self._J, strict=True):
                with suppress(SingularityError):
                    found.append((J, grow(resting, q, limit=deepest).closure))
                if len(found) == most_closures:
                    break
        return found

    def _coordinates(self, without: Sequence[str] = ()) -> tuple[list[int], tuple[str, ...]]:
        """Entries of v that parametrise the redundant motions best: the largest typical smallest singular value.

        Coordinates of these names are left out if others are enough.
        """
        free = [k for k, name in enumerate(self._coordinate_names) if name not in without]
        single = [k for k in free if self._coordinate_names[k] in self._robot.single_joint_names]
        scaled = self._lengths * self._ways
        allowed = single if np.linalg.matrix_rank(scaled[0][single], _RANK) == self.motions else free
        best: tuple[float, list[int]] = (-1.0, [])
        # Pivots of a few samples are candidates; the median over all samples decides among them.
        for way in scaled[:: max(1, len(scaled) // 8)]:
            chosen = [allowed[k] for k in pivot_columns(way[allowed].T, self.motions)[0]]
            smallest = float(np.median(np.linalg.svd(scaled[:, chosen], compute_uv=False)[:, -1]))
            best = max(best, (smallest, sorted(chosen)))
        # Without its own coordinates nothing parametrises the motion: they are named after all.
        if without and best[0] < _RANK:
            return self._coordinates()
        return best[1], tuple(self._coordinate_names[k] for k in best[1])

    # ------------------------------------------------------------------ report

    def _use(self, each: _Set) -> Use:
        kind, mask, words = self._decided(each)
        typical = np.zeros(len(each.rows))
        # The median and not the mean: values near singularities are far from typical.
        typical[: each.values.shape[1]] = np.median(each.values, axis=0)
        typical.setflags(write=False)
        last = each.values[:, max(each.rank - 1, 0)]
        worst = int(np.argmin(last))
        weak_part = 0.05  # of the median singular value below which a sample counts as singular
        weak = float((last < weak_part * np.median(last)).mean()) if each.rank else 0.0
        names, (actuators, effort) = each.names, self._work(each)
        ends = self._q[[worst, int(np.argmax(last))]]
        ends.setflags(write=False)
        moved = tuple(name for name, moves in zip(names, mask, strict=True) if moves)
        use = Use(
            vertical=names,
            redundancy_class=kind,
            moved=moved,
            rank=each.rank,
            singular_values=typical,
            smallest=float(last[worst]),
            singular_share=weak,
            singular_at=ends[0],
            best_at=ends[1],
            straight=self._straight(each) if each.rank else (),
            redundant=self._coordinates(names)[1] if {*names} & {*self._redundant_names} else self._redundant_names,
            driven=self._is_driven(each.D[:, mask] if kind in ("1", "2") else np.eye(self.motions)),
            actuators=actuators,
            effort=effort,
            reason="",
        )
        return replace(use, reason=self._sentence(use, words, [self._angular[row] for row in each.rows]))

    def _sentence(self, use: Use, words: str, angles: list[bool]) -> str:
        """One sentence: what moves, by which motion of the joints, and where that is lost."""
        primary, moved, means = short_names(self._primary), short_names(use.moved), use.actuators or use.redundant
        if use.redundancy_class is None:
            return f"with {primary} at rest, {words}"
        idle = "" if use.driven else "; no actuator drives it"
        if use.redundancy_class == "2s":
            return f"while {primary} moves, the values of {few(use.redundant)} steer {moved}, not their rates{idle}"
        if use.redundancy_class == "3":
            return f"with {primary} at rest, manoeuvres of {few(use.redundant)} reach {moved}, {words}{idle}"
        turn, slowest = all(angles), float(use.singular_values[use.rank - 1])
        parts = [f"with {primary} at rest, {few(means)} can {'turn' if turn else 'move'} {moved}{idle}", words]
        motion = 1.0 / (slowest if turn else slowest * self._length)
        parts.append(f"1 {'rad' if turn else 'm'} takes {motion:.3g} rad of the joints")
        parts.append(f"holding its weight takes {use.effort:.3g} N or N m" if use.effort else "")
        if use.straight:
            parts.append(f"lost where {' or '.join(use.straight)} is straight")
        elif use.singular_share:
            parts.append(f"nearly lost at {100 * use.singular_share:.0f} % of the poses")
        return "; ".join(part for part in parts if part)

    def _straight(self, each: _Set) -> tuple[str, ...]:
        """Joints that make D singular at 0 or pi."""
        found, limit = list[str](), _RANK * np.abs(self._D).max()
        for name, D in self._at_straight_joints:
            values = np.linalg.svd(D[:, list(each.rows)], compute_uv=False)[:, each.rank - 1]
            found += [name] if values.max(initial=0.0) < limit else []
        return tuple(dict.fromkeys(found))

    @cached_property
    def _at_straight_joints(self) -> list[tuple[str, Array]]:
        """D at samples with one joint straight or folded; empty where the primary outputs are singular then."""
        found: list[tuple[str, Array]] = []
        model = self._robot.model
        names = [] if self._reduced.assembly.size else self._robot.single_joint_names  # others would have to follow
        for name in names:
            joint = self._robot.single_joint(name)
            low, high = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
            for angle in (0.0, np.pi) if joint.unit == "rad/s" else ():
                if joint.continuous or low <= angle <= high:
                    q = self._q[:_POSES].copy()
                    joint.put(q, np.array(angle))
                    with suppress(SingularityError):
                        found.append((name, self._motions_at(q)[1][-1]))
        return found

    def _work(self, each: _Set) -> tuple[tuple[str, ...], float | None]:
        """Actuators that move most for unit motions of the outputs, and their static effort."""
        names = self._reduced.actuation.names
        if not (names and each.rank):
            return (), None
        # The least motion that moves each output by one.
        moving = self._ways @ np.linalg.pinv(each.D, rcond=_RANK)
        motion = np.abs(self._here.B.mT @ moving).max(axis=2)  # (S, p)
        shares = np.median(motion, axis=0)
        most_actuators = 4  # more do not fit into a sentence
        busiest = np.argsort(-shares, kind="stable")[:most_actuators].tolist()
        working_part = 0.25  # of the motion of the busiest actuator, above which one counts as working
        working = [k for k in busiest if shares[k] > working_part * shares.max()]
        load = self._static_inputs
        effort = 0.0 if load is None else float(np.median(np.abs(load[:, working]).max(axis=1)))
        return tuple(names[k] for k in working), effort if effort > _ZERO else None

    def _is_driven(self, D: Array) -> bool:
        """True if inputs can usually begin motions of all rows of D (S, k, r2) from rest; or if there are no inputs."""
        ranks = np.linalg.matrix_rank(D @ self._driven, _RANK * max(float(np.abs(D).max(initial=0.0)), 1e-300))
        return not self._reduced.actuation.names or float((ranks == D.shape[-2]).mean()) > _USUAL

    @cached_property
    def _driven(self) -> Array:
        """Directions (S, r2, r2) of the motions whose reduced inertial force inputs can give; zero for the others."""
        here = self._here
        force = here.H @ (here.J2 @ self._ways)
        # From rest, an acceleration along a motion needs this force; what inputs cannot give of it is missing.
        missing = force - here.input_matrix @ (np.linalg.pinv(here.input_matrix) @ force)
        _, values, right = np.linalg.svd(missing)
        return np.asarray(right.mT * (values < _RANK * np.abs(force).max())[:, None])

    @cached_property
    def _static_inputs(self) -> Array | None:
        """Inputs (S, p) that hold the robot; None if actuators cannot hold it."""
        with suppress(RncError):
            state = self._reduced.at(self._q, np.zeros((len(self._q), self._reduced.r)))
            return np.asarray(state.allocate(state.G))
        return None

    def _order(self, use: Use) -> tuple[bool, bool, int, int, float, int]:
        """Best first: by class, but what one actuator moves alone after the others, then what none drives."""
        own = {*self._reduced.actuation.names, *self._redundant_names}
        typical = float(use.singular_values[use.rank - 1]) if use.rank else 0.0
        kind, count = use.redundancy_class, len(use.vertical)
        alone = max(sum(name in own for name in use.vertical), int(len(use.actuators) == 1))
        order = ("1", "2", "2s", "3", None)
        return kind is None, not use.driven, alone, order.index(kind), -typical, count


def _wheel_joints(reduced: ReducedModel, *, steered: bool = False) -> set[int]:
    """Joints of bodies that roll, and of last bodies on runners that an actuator steers, but not a trailer's."""
    robot, found = reduced.robot, set()
    inner = list(robot.model.parents)
    for each in reduced.all_constraints.mechanisms():
        if isinstance(each, GroundContact):
            joint = int(robot.model.frames[robot.frame_id(each.frame)].parentJoint)
            driven = joint not in inner and robot.model.names[joint] in reduced.actuation.names
            if each.radius or (steered and driven):
                found.add(joint)
    return found


def tip_frames(reduced: ReducedModel) -> tuple[str, ...]:
    """Return the ends of the chains of a robot: the last body of each, without wheels; a hand in place of its fingers.

    Args:
        reduced: the model, whose rows name the wheels.
    """
    model = reduced.robot.model
    parents = [int(each) for each in model.parents]
    bodies = {int(each.parentJoint): str(each.name) for each in model.frames if each.type.name == "BODY"}
    first = [joint for joint in range(1, model.njoints) if parents[joint] == 0 and model.joints[joint].nv > 1]
    rolling, wheels = _wheel_joints(reduced), _wheel_joints(reduced, steered=True)
    carriers = [parents[joint] for joint in rolling]
    single = {joint for joint in carriers if carriers.count(joint) == 1}  # casters, forks and steering knuckles
    inner = {*first, *wheels, *single, *(parents[joint] for joint in range(1, model.njoints) if joint not in wheels)}
    ends = [joint for joint in range(1, model.njoints) if joint not in inner]
    bases = {0, *first, *(joint for joint in range(1, model.njoints) if parents[joint] == 0)}
    hands = {joint: _hand(joint, parents, bases) for joint in ends}
    tips = [hands[joint] if list(hands.values()).count(hands[joint]) > 1 else joint for joint in ends]
    named = (bodies.get(tip or joint, bodies.get(joint, "")) for tip, joint in zip(tips, ends, strict=True))
    return tuple(dict.fromkeys(name for name in named if name))


def _hand(joint: int, parents: list[int], bases: set[int]) -> int:
    """Body that carries a short chain, such as a finger, beside others; zero if the chain is long."""
    longest_finger = 3  # joints
    for _ in range(longest_finger):
        joint = parents[joint]
        if joint in bases or parents.count(joint) > 1:
            break
    return joint if joint not in bases and parents.count(joint) > 1 else 0


def tip_positions(reduced: ReducedModel) -> list[FramePosition]:
    """Return the positions of the ends of chains, in the directions that the robot can move: primary outputs to try.

    Args:
        reduced: the model, whose rows name the wheels.
    """
    q = regular_samples(reduced, _POSES)
    outputs = [each for frame in tip_frames(reduced) for each in _frame_outputs(reduced, q, frame)]
    return [each for each in outputs if isinstance(each, FramePosition)]


def _frame_outputs(reduced: ReducedModel, q: Array, frame: str) -> list[OutputKind]:
    """Position and orientation of a frame, in the directions in which it moves at any of the configurations."""
    moves = largest_entries(reduced.at(q).position.jacobian(reduced.robot.frame_id(frame))) > _ZERO
    found: list[OutputKind] = []
    if moves[:3].any():
        found.append(FramePosition(frame, cast(Axes, "".join(np.array(list("xyz"))[moves[:3]]))))
    if moves[3:].any():
        found.append(FrameOrientation(frame) if moves[3:5].any() else FrameYaw(frame))
    return found


def default_candidates(reduced: ReducedModel) -> list[list[OutputKind]]:
    """Return the vertical outputs that ``explore`` tries by default, without outputs of the model.

    Args:
        reduced: the model.
    """
    robot, q = reduced.robot, regular_samples(reduced, _POSES)
    frames = list(tip_frames(reduced))
    base = next(iter(robot.links_of(1)), None)
    found: list[list[OutputKind]] = []
    if base is not None and robot.model.joints[1].nv > 1 and base not in frames:
        frames.insert(0, base)
        # Without gravity no direction is up, so that yaw and tilt mean nothing.
        if robot.model.joints[1].nv == 6 and robot.model.gravity.linear.any():
            found += [[FrameYaw(base)], [FrameTilt(base, "x"), FrameTilt(base, "y")]]
    for frame in frames:
        parts = _frame_outputs(reduced, q, frame)
        found += [*([each] for each in parts), parts]
    # Angles of wheels and of mimics follow from the rest: nobody asks for them.
    left_out = [*(str(robot.model.names[k]) for k in _wheel_joints(reduced)), *(each.joint for each in robot.mimics)]
    joints = [name for name in robot.single_joint_names if name not in left_out]
    return [*found, [CenterOfMass()], *(list[OutputKind]([JointPosition(name)]) for name in joints)]
