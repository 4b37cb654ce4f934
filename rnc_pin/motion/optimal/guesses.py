"""Guesses of motions: a straight line, detours, loops of the shape, configurations, another plan, random velocities."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import chain, combinations, islice, pairwise

import numpy as np
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Array, Float
from rnc_pin.collision import CollisionDistances, Obstacle
from rnc_pin.collision.shapes import bounding_box
from rnc_pin.errors import ConfigurationError, ConstraintError, InputError, RncError
from rnc_pin.model.input_validation import admit_configurations
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.motion.optimal.bounds import DistanceRows, Goal
from rnc_pin.motion.optimal.motion_plan import MotionPlan
from rnc_pin.motion.optimal.transcription import Iterate, Transcription
from rnc_pin.motion.planning import IkSearch, Reference, Way, find_steering, solve_ik
from rnc_pin.motion.planning.action_models import ActionModel, Nodes
from rnc_pin.motion.planning.exact_steering import CarSteering
from rnc_pin.motion.planning.way import Limits, motion_along
from rnc_pin.printing import counted

GIVEN = "given"  # name of a guess of the caller
_HARMONICS = 3
_PAIRS = 6  # pairs of reducing outputs whose loops are tried: those of the largest effect
_RADII = np.geomspace(0.25, 3.0, 8)  # [m or rad]
_TURNS = np.array([1.0, 2.0, 4.0])  # how often loops are driven
_SHORT = 1e-6  # length of a segment of a path that counts as none, in turning radii
_PATIENCE = 10  # singular random motions in succession after which no more are drawn

Guess = MotionPlan | Way | ArrayLike | None
"""Another plan, a way, or configurations (n, nq) at equal times; None for the straight line."""


def guesses(
    problem: Transcription, goal: Goal | None, given: Guess, seeds: int, seed: int
) -> Iterator[tuple[str, Iterate]]:
    """Named guesses, in the order in which they are tried.

    Args:
        problem: the problem.
        goal: the goal, for the straight line.
        given: a plan, a way, configurations (n, nq) at equal times, or None for the straight line.
        seeds: number of guesses after it: detours first, then loops of the shape, then random ones.
        seed: of the random generator.
    """
    begin = float(np.mean(problem.duration))
    line = straight_line(problem, goal)
    if given is None:
        yield "straight line", along(problem.model, line, begin)
    else:
        yield GIVEN, _given(problem, given, begin)
    random = _random_motions(problem, line, begin, seed)
    words = list(_words(problem, line, begin))
    # Paths of a car take turns with random motions, so that a few guesses have some of both.
    shaped = chain(*zip(words, random, strict=False)) if words else _loops(problem, line, begin)
    yield from islice(chain(_detours(problem, line, begin), shaped, random), seeds)


def straight_line(problem: Transcription, goal: Goal | None) -> Float[Array, "K1 nq"]:
    """Configurations from the start to one that reaches the goal, at equal times on a geodesic."""
    begin = problem.start.q[0]
    end = goal_configuration(problem.model.reduced, begin, goal)
    return _spaced(problem.model, np.array([begin, end]), problem.K)


def _random_motions(problem: Transcription, line: Array, duration: float, seed: int) -> Iterator[tuple[str, Iterate]]:
    """Motions with random harmonic velocities, until many in succession meet a singular configuration.

    Every second one is warped: bent so that it ends at the end of the line.
    """
    model, K, generator = problem.model, problem.K, np.random.default_rng(seed)
    size = np.maximum(2.0 * np.abs(_speeds(model, line, duration / K)).mean(axis=0), 3.0 / duration)
    phase = np.pi * (np.arange(K) + 0.5) / K
    # Sines of the whole motion: velocities begin and end at rest. Higher ones are smaller, as in smooth motions.
    waves = np.array([np.sin(j * phase) / np.sqrt(j) for j in range(1, _HARMONICS + 1)])
    made = failed = attempt = 0
    while failed < _PATIENCE:
        attempt, failed = attempt + 1, failed + 1
        v2 = waves.T @ (generator.normal(size=(_HARMONICS, model.r)) * size)
        try:
            path = _driven(model, line[0], v2[None], duration)[0]
            # Half of them: a bent motion reaches the goal but breaks the rows, the other one keeps the rows.
            if attempt % 2 == 0:
                offset = model.manifold.difference(path[-1:], line[-1:])
                path = model.manifold.integrate(path, np.linspace(0.0, 1.0, K + 1)[:, None] ** 2 * offset)
            found = along(model, path, duration, v2)
        except RncError:
            continue
        made, failed = made + 1, 0
        yield f"random {made}", found


def _words(problem: Transcription, line: Array, duration: float) -> Iterator[tuple[str, Iterate]]:
    """Shortest paths of a car, of Reeds and Shepp, for each first direction and number of reversals, by length."""
    model = problem.model
    try:
        steering = find_steering(model.reduced, line[0])
    except RncError:
        return
    if not isinstance(steering, CarSteering):
        return
    seen = set[tuple[bool, int]]()
    for motion, word in steering.paths(line[0], line[-1]):
        forward = [length > 0.0 for _, length in word if abs(length) > _SHORT]
        kind = forward[0], sum(a != b for a, b in pairwise(forward))
        # Words of one kind are neighbours of each other, and lead to one solution: the shortest stands for all.
        if kind in seen:
            continue
        seen.add(kind)
        sizes = np.linalg.norm(motion.steps, axis=1)
        path = motion.at(model.manifold, sizes, np.linspace(0.0, sizes.sum(), problem.K + 1))
        name = f"{'forwards' if kind[0] else 'backwards'}, {counted(kind[1], 'reversal')}"
        yield name, along(model, path, duration)


def _detours(problem: Transcription, line: Array, duration: float) -> Iterator[tuple[str, Iterate]]:
    """Motions that pass to the left and to the right of each standing obstacle that is in the way of a mobile base."""
    base = problem.model.reduced.robot.model.joints[1]
    if base.shortname() not in ("JointModelPlanar", "JointModelFreeFlyer"):
        return  # the side on which an arm passes is not that of a straight line in the plane
    places = slice(base.idx_q, base.idx_q + 2)
    for bound in problem.bounds:
        if not isinstance(bound, DistanceRows):
            continue
        for obstacle in bound.distances.obstacles:
            if obstacle.motion is not None or obstacle.unbounded:  # nothing is beside a floor
                continue
            for side, corners in _corners(line[[0, -1], places], bound.distances, obstacle, bound.clearance):
                yield f"{side} of {obstacle.name}", along(problem.model, _through(line, places, corners), duration)


def _corners(
    ends: Array, distances: CollisionDistances, obstacle: Obstacle, clearance: float
) -> Iterator[tuple[str, Array]]:
    """Sides, the nearer one first, with corners (2, 2) to pass an obstacle; none for an obstacle beside the line."""
    length = float(np.linalg.norm(ends[1] - ends[0]))
    if length == 0.0:
        return
    ahead = (ends[1] - ends[0]) / length
    axes = np.array([ahead, [-ahead[1], ahead[0]]])
    center, halves = bounding_box(obstacle.shape, obstacle.name)
    pose = obstacle.placement(0.0)
    ahead_of, beside = axes @ (pose.act(center)[:2] - ends[0])
    reach = np.abs(axes @ pose.rotation[:2]) @ halves
    # The largest link at any heading: a guess need not be short.
    room = clearance + float(distances.radii[: distances.link_shapes].max(initial=0.0))
    if abs(beside) >= reach[1] + room or not -reach[0] < ahead_of < length + reach[0]:
        return
    before, after = np.clip(ahead_of + np.array([-1.0, 1.0]) * (reach[0] + room), 0.0, length)
    for sign in (-1.0, 1.0) if beside > 0 else (1.0, -1.0):
        aside = beside + sign * (reach[1] + room)
        offsets = [[before, aside], [after, aside]]
        yield "left" if sign > 0 else "right", ends[0] + np.array(offsets) @ axes


def _through(line: Array, places: slice, corners: Array) -> Array:
    """The line with the positions of its base on a polygon through corners, at equal spacing."""
    points = np.vstack([line[0, places], corners, line[-1, places]])
    since = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0.0, since[-1], len(line))
    path = line.copy()
    path[:, places] = np.column_stack([np.interp(at, since, points[:, k]) for k in range(2)])
    return path


def _loops(problem: Transcription, line: Array, duration: float) -> Iterator[tuple[str, Iterate]]:
    """Loops of two reducing outputs that bring everything else to the end of the line, those of least effort first.

    Rows such as those of momentum couple the shape with the rest of the robot: after a loop of the shape, the rest has
    moved by a geometric phase, which grows with the area. Loops are circles on which the shape starts and ends, driven
    once or several times. Their radius is such that the phase leads to the goal. A quasi-velocity has no value that
    returns: its integral does.
    """
    model, K = problem.model, problem.K
    if model.r < 2:
        return
    direct = _speeds(model, line, duration / K)
    try:
        end = _driven(model, line[0], direct[None], duration)[:, -1]
        needed = model.manifold.difference(end, line[-1:])[0]
        distance = float(needed @ needed)
        if distance < 1e-12:
            return

        def progress(circles: Array, turns: Array, radii: Array) -> Array:
            """Share of the way to the goal that circles (n, 2, r) lead to."""
            v2 = direct + _circular(radii[:, None, None] * circles, turns, K, duration)
            ends = _driven(model, line[0], v2, duration)[:, -1]
            return np.asarray(model.manifold.difference(np.repeat(end, len(ends), axis=0), ends) @ needed / distance)

        # The phase grows with the area of a circle, but rotations make it bend: the first radius that reaches the goal
        # is bracketed on a grid, and halved.
        circles, turns = _circles(model.r, progress)
        count = len(circles)
        shares = [progress(circles, turns, np.full(count, radius)) for radius in _RADII]
        found = np.column_stack([np.zeros(count), *shares])
        known = np.concatenate([[0.0], _RADII])
        crossed = (found[:, :-1] < 1.0) & (found[:, 1:] >= 1.0)
        leading = np.flatnonzero(crossed.any(axis=1))
        if not len(leading):
            return
        circles, turns, at = circles[leading], turns[leading], np.argmax(crossed[leading], axis=1)
        low, high = known[at], known[at + 1]
        halved = 5  # times that the range of the radius is halved
        for _ in range(halved):
            radii = 0.5 * (low + high)
            short = progress(circles, turns, radii) < 1.0
            low, high = np.where(short, radii, low), np.where(short, high, radii)
        v2 = direct + _circular(radii[:, None, None] * circles, turns, K, duration)
        paths = _driven(model, line[0], v2, duration)
    except RncError:
        return
    offsets = model.manifold.difference(paths[:, -1], np.repeat(line[-1:], len(paths), axis=0))
    missed = 0.3  # of the way that a loop may leave
    # The radius brings the motion as far as the goal along the way to it; what it misses aside has to be small.
    near = np.linalg.norm(offsets, axis=1) < missed * np.sqrt(distance)
    effort = np.square(np.diff(v2, axis=1)).sum(axis=(1, 2))
    bent = np.linspace(0.0, 1.0, K + 1)[:, None] ** 2  # no velocity is added at the start
    names = model.reduced.reducing.names
    loops = 4  # loops that are tried
    for number, k in enumerate([k for k in np.argsort(effort, kind="stable") if near[k]][:loops], 1):
        path = model.manifold.integrate(paths[k], bent * offsets[k])
        pair = " and ".join(names[i] for i in np.flatnonzero(np.abs(circles[k]).max(axis=0)))
        yield f"loop {number}, of {pair}", along(model, path, duration, v2[k])


def _circles(r: int, progress: Callable[[Array, Array, Array], Array]) -> tuple[Array, Array]:
    """First and second directions (n, 2, r) of circles through the start, and how often they are driven (n,)."""
    axes = np.eye(r)
    pairs = [axes[[i, j]] for i, j in combinations(range(r), 2)]
    small = 0.5  # [m or rad]; radius of the loops that choose the pairs
    effect = np.abs(progress(np.array(pairs), np.ones(len(pairs)), np.full(len(pairs), small)))
    chosen = [pairs[k] for k in np.argsort(-effect, kind="stable")[:_PAIRS]]
    signs = np.array([[a, b] for a in (1.0, -1.0) for b in (1.0, -1.0)])
    orders = [0, 1], [1, 0]
    circles = np.array([sign[:, None] * pair[order] for pair in chosen for order in orders for sign in signs])
    return np.repeat(circles, len(_TURNS), axis=0), np.tile(_TURNS, len(circles))


def _circular(circles: Array, turns: Array, steps: int, duration: float) -> Array:
    """Velocities (n, steps, r) along circles, from rest to rest."""
    share = (np.arange(steps) + 0.5) / steps
    angle = 2.0 * np.pi * turns[:, None] * (share - np.sin(2.0 * np.pi * share) / (2.0 * np.pi))
    rate = 2.0 * np.pi * turns[:, None] / duration * (1.0 - np.cos(2.0 * np.pi * share))
    return np.einsum("nks,nsr->nkr", np.stack([rate * np.cos(angle), rate * np.sin(angle)], axis=2), circles)


def _driven(model: ActionModel, q0: Array, v2: Array, duration: float) -> Array:
    """Configurations (n, steps + 1, nq) of n motions with velocities (n, steps, r), each for an equal time."""
    kinematic = model if model.form == "kinematic" else ActionModel(model.reduced, "kinematic")
    start = Nodes(np.repeat(q0[None], len(v2), axis=0), np.empty((len(v2), 0)))
    return kinematic.rollout(start, v2, duration / v2.shape[1])[0]


def along(
    model: ActionModel, q: Array, duration: float, mean: Array | None = None, nodes: Array | None = None
) -> Iterate:
    """Motion along configurations (K + 1, nq) at equal times: velocities and inputs fit it as well as they can.

    Args:
        model: action model.
        q: the configurations.
        duration: duration [s].
        mean: mean reduced velocities (K, r) of the intervals; by default those that fit the configurations.
        nodes: reduced velocities (K + 1, r); by default those between the means, from rest.
    """
    K = len(q) - 1
    mean = _speeds(model, q, duration / K) if mean is None else mean
    if model.form == "kinematic":
        return Iterate(q, np.empty((len(q), 0)), mean, duration)
    w = np.concatenate([0.0 * mean[:1], (mean[:-1] + mean[1:]) / 2, mean[-1:]]) if nodes is None else nodes
    rates = np.diff(w, axis=0) * (K / duration)
    u = rates if model.form == "acceleration" else inputs_for(model, Nodes(q[:-1], w[:-1]), rates)
    return Iterate(q, w, u, duration)


def driven_configurations(
    reduced: ReducedModel, q0: ArrayLike, reference: Reference, duration: float | None = None, count: int = 201
) -> Float[Array, "n nq"]:
    """Return the configurations to which a motion of the reducing outputs leads, as a guess for ``plan``.

    The constraints give the motion of everything else. The reference may come from a ``CarPath``, or be a gait.

    Args:
        reduced: the model.
        q0: initial configuration (nq,).
        reference: of all reducing outputs; only its rates count.
        duration: duration [s]; the duration of the reference by default.
        count: number of configurations, at equal times.

    Raises:
        ConfigurationError: the reference has another number of outputs.
        InputError: the duration is not positive and finite.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce(
        ...     [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> ahead = rnc.planning.MinimumJerk([0.0, 0.0], [2.0, 0.0], 1.0)
        >>> rnc.optimal.driven_configurations(reduced, robot.configuration(), ahead)[-1].round(6).tolist()
        [2.0, 0.0, 1.0, 0.0]
    """
    if reference.size != reduced.r:
        raise ConfigurationError(f"reference of {reference.size} outputs: the model has {reduced.r} reducing outputs")
    total = reference.duration if duration is None else duration
    if not 0 < total < np.inf:
        raise InputError(f"duration: expected a positive number, found {total:g}")
    h = total / (count - 1)
    v2 = np.array([reference.at((k + 0.5) * h).velocity for k in range(count - 1)])
    return _driven(ActionModel(reduced, "kinematic"), np.array(reduced.at(q0).q), v2[None], total)[0]


def inputs_for(model: ActionModel, at: Nodes, rates: Array) -> Array:
    """Actuator inputs (n, p) that come nearest to reduced accelerations (n, r)."""
    state = model.reduced.at(at.q, at.w)
    F = state.inverse_dynamics(rates)
    try:
        return np.array(model.reduced.allocate(at.q, F))
    except ConstraintError:  # fewer actuators than velocities
        return np.einsum("kpr,kr->kp", np.linalg.pinv(state.input_matrix), F)


def _speeds(model: ActionModel, q: Array, h: float) -> Array:
    """Reduced velocities (K, r) that fit configurations (K + 1, nq) at intervals h [s] as well as they can."""
    v = model.manifold.difference(q[:-1], q[1:]) / h
    return np.einsum("kri,ki->kr", model.reduced.at(q[:-1]).J2, v)


def resampled(model: ActionModel, at: Iterate, K: int) -> Iterate:
    """The same motion over K intervals. Inputs are their means over each interval: exact if K is a multiple."""
    count = len(at.u)
    places = np.linspace(0.0, count, K + 1)
    before = np.minimum((places + 1e-9).astype(int), count - 1)
    since = np.maximum(places - before, 0.0) * at.duration / count
    found = model.step(Nodes(at.q[before], at.w[before]), at.u[before], since)
    q, w = np.array(found.q), np.array(found.w)
    q[-1], w[-1] = at.q[-1], at.w[-1]
    total = np.concatenate([np.zeros((1, at.u.shape[1])), np.cumsum(at.u, axis=0)])
    part = (places - before)[:, None]
    u = np.diff((1 - part) * total[before] + part * total[before + 1], axis=0) * K / count
    return Iterate(q, w, u, at.duration)


def goal_configuration(reduced: ReducedModel, q0: Array, goal: Goal | None) -> Array:
    """Return a configuration (nq,) that reaches a goal of ``plan``; ``q0`` if none is found."""
    if goal is None:
        return q0
    if not isinstance(goal, Mapping):
        return np.array(reduced.at(goal).q)
    try:
        found = solve_ik(reduced, q0, goal, limits=False, search=IkSearch(starts=3))
    except (ConfigurationError, InputError):  # a list of outputs
        return q0
    return np.array(found.q) if found.converged else q0


def _given(problem: Transcription, given: MotionPlan | Way | ArrayLike, duration: float) -> Iterate:
    """Guess from a plan, a way or configurations."""
    K, model = problem.K, problem.model
    if isinstance(given, Way):
        q, nodes, mean = motion_along(given, K, duration, motion_limits(problem))
        return along(model, q, duration, mean, nodes)
    if isinstance(given, MotionPlan):
        inside = np.clip(given.duration, *problem.duration)
        if given.info.form == model.form and given.info.input_names == model.input_names:
            same = Iterate(np.array(given.q), np.array(given.w), np.array(given.u), given.duration)
            return resampled(model, same, K)._replace(duration=float(inside))
        return along(model, _spaced(model, given.q, K), float(inside))
    try:
        rows = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        raise ConfigurationError(f"guess: expected a plan or configurations (n, nq), found {given!r}") from None
    if rows.ndim != 2 or rows.shape[1] != model.reduced.robot.nq or len(rows) < 2:
        raise InputError(f"guess: expected configurations (n, {model.reduced.robot.nq}), found shape {rows.shape}")
    rows = admit_configurations(rows, model.reduced.robot)
    return along(model, _spaced(model, rows, K), duration)


def motion_limits(problem: Transcription) -> Limits:
    """Largest reduced velocities and accelerations (r,) within the bounds of a problem in both directions."""
    model = problem.model
    speeds, rates = np.full((2, model.r), np.inf)
    own = {"velocity": (speeds, model.reduced.reducing.names)}
    if model.form != "dynamic":  # efforts limit neither
        own["input"] = speeds if model.form == "kinematic" else rates, model.input_names
    for quantity, name, low, high in problem.limits:
        most, names = own.get(quantity, (speeds, ()))
        if name in names:
            k = names.index(name)
            most[k] = min(most[k], min(-low, high) if low < 0 < high else max(-low, high))
    return speeds, rates


def _spaced(model: ActionModel, q: Array, K: int) -> Array:
    """Configurations (K + 1, nq) at equal times along others."""
    places = np.linspace(0.0, len(q) - 1.0, K + 1)
    before = np.minimum(places.astype(int), len(q) - 2)
    return model.manifold.interpolate(q[before], q[before + 1], places - before)
