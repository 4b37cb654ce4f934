"""Predictive control to set points: time of an update beside hand-written CasADi problems, and rates of convergence.

``python -m benchmarks.set_point_updates``

An update is one iteration from the last motion over 20 nodes with the gains of its feedback; those count whose motion
has an input at its bound. A motion that stalls has none, and would take less. The
CasADi problems have the same states, inputs, nodes, bounds and powers of residuals; their equations are written by
hand, their derivatives are generated as C code and compiled, and qrqp solves their quadratic program. Without CasADi or
a C compiler, their column says so. Rates are slopes of the logarithm of the homogeneous distance over time, from the
start to the first distance below 0.05; within 0.02, its ``precision``, the cost is smooth.
"""

from __future__ import annotations

import importlib
import importlib.util
import shutil
import subprocess
import tempfile
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import rnc_pin as rnc
from benchmarks.set_points import CASES, displaced
from rnc_pin.optimal import (
    BoundKind,
    CostKind,
    EffortCost,
    InputBound,
    OutputCost,
    PredictiveController,
    SetPoint,
    SetPointCost,
    VelocityCost,
)

HORIZON, NODES, LIMIT, PERIOD, UPDATES = 4.0, 20, 2.0, 0.05, 60
DRAWN, SPREAD = 5, np.array([0.5, 0.1, 0.1])  # starts about START, and how far from it [m, m, rad]
NEAR, START = 0.05, (-1.0, 0.2, 0.2)  # place and heading
PRECISION = 0.02
_COST, _SPEED, _EFFORT = 10.0, 0.1, 0.01


def controller_of(name: str, kind: str, bounds: Sequence[BoundKind]) -> PredictiveController:
    """Controller of a system with a kind of cost: "set point", "squares", or "squares, goal"."""
    case = CASES[name]
    reduced, goal = case.build(), case.goal()
    costs: list[CostKind] = [SetPointCost(goal, weight=_COST, velocity_weight=_SPEED), EffortCost(_EFFORT)]
    if kind != "set point":
        squares = [OutputCost(output, value, weight=_COST, phase="both") for output, value in goal.items()]
        costs = [*squares, VelocityCost(_SPEED, phase="both"), EffortCost(_EFFORT)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rnc.ModelWarning)
        return PredictiveController(
            reduced,
            costs,
            HORIZON,
            form="acceleration",
            bounds=bounds,
            nodes=NODES,
            goal=goal if kind == "squares, goal" else None,
        )


class Updates(NamedTuple):
    """Processor times of the updates of one run in closed loop, after the first motion [s]."""

    bounded: list[float]
    """Of those whose motion has an input at its bound."""
    other: list[float]
    searches: list[float]
    """Of those that searched for another motion, because the last one stalled."""


def updates_of(name: str, seed: int | None = None) -> Updates:
    """Updates from the start of the CasADi problem, or from a drawn one.

    Args:
        name: name of the system.
        seed: of the start.
    """
    controller = controller_of(name, "set point", [InputBound(-LIMIT, LIMIT)])
    reduced = CASES[name].build()
    place = np.array(START)
    if seed is not None:
        place += SPREAD * np.random.default_rng(seed).uniform(-1.0, 1.0, 3)
    start = reduced.robot.configuration({"root_joint": place})
    measured = reduced.at(start, np.zeros(reduced.r)).measure(np.zeros(reduced.r))
    state, taken = controller.initial_state(measured), Updates([], [], [])
    model = rnc.optimal.action_model(reduced, "acceleration")
    now = rnc.optimal.Nodes(np.array(measured.q)[None], np.zeros((1, reduced.r)))
    for k in range(UPDATES):
        seen = reduced.at(now.q[0], now.w[0]).measure(np.zeros(reduced.r))
        begin, searches = time.process_time(), state.searches
        _, state = controller.step(k * PERIOD, seen, state)
        spent = time.process_time() - begin
        if state.searches > searches:
            taken.searches.append(spent)
        elif k:
            (taken.bounded if float(np.abs(state.u).max()) > LIMIT - 1e-3 else taken.other).append(spent)
        now = model.step(now, state.u[:1], np.array([PERIOD]))
    if state.missed:
        raise ValueError(f"{state.missed} updates were not used")
    return taken


def update_time(name: str) -> float:
    """Median processor time of an update from the start of the CasADi problem [s]."""
    return _median(updates_of(name).bounded)


def drawn_row(name: str) -> str:
    """Line of the table of drawn starts."""
    runs = [updates_of(name, seed) for seed in range(DRAWN)]
    warm = [1e3 * spent for run in runs for spent in (*run.bounded, *run.other)]
    bounded = [1e3 * spent for run in runs for spent in run.bounded]
    searches = [spent for run in runs for spent in run.searches]
    at_bounds = f"{np.median(bounded):.1f}, {np.max(bounded):.1f} ({len(bounded)})" if bounded else "none"
    longest = f"{len(searches)}, {np.max(searches):.2g} s" if searches else "none"
    return f"| {name} | {np.median(warm):.1f} | {np.max(warm):.1f} ({len(warm)}) | {at_bounds} | {longest} |"


def _median(spent: Sequence[float]) -> float:
    """Median time of updates whose motion has an input at its bound."""
    if len(spent) < 5:
        raise ValueError(f"{len(spent)} updates have an input at its bound: too few for a median")
    return float(np.median(spent))


class Rate(NamedTuple):
    """Convergence of one run."""

    slope: float
    """Of the logarithm of the homogeneous distance [1/s]; NaN if the run does not come near the goal."""
    end: float
    """Homogeneous distance at the end."""


def rate(name: str, kind: str, aside: float) -> Rate:
    """Rate of convergence from a start aside."""
    case = CASES[name]
    reduced, controller = case.build(), controller_of(name, kind, case.bounds())
    point = SetPoint(reduced, case.goal())
    run = rnc.simulate(reduced, controller, displaced(point, aside), 20.0, PERIOD)
    distance = np.asarray(point.distance(run.q))
    below = np.flatnonzero(distance < NEAR)
    if not len(below):
        return Rate(np.nan, float(distance[-1]))
    last = max(int(below[0]), 2)
    slope = np.polyfit(run.time[: last + 1], np.log(distance[: last + 1]), 1)[0]
    return Rate(float(slope), float(distance[-1]))


# ---------------------------------------------------------------------- CasADi


def _edge(ca: Any, x: Any, u: Any) -> tuple[Any, list[Any], list[int]]:
    """State (place, heading, speeds) of an edge: rates, coordinates and their weights."""
    place_x, place_y, yaw, speed, turn = (x[k] for k in range(5))
    rates = ca.vertcat(speed * ca.cos(yaw), speed * ca.sin(yaw), turn, u)
    return rates, [place_x, yaw, place_y], [1, 1, 2]


def _trailers(ca: Any, x: Any, u: Any) -> tuple[Any, list[Any], list[int]]:
    """State of a car with two trailers, all wheelbases 1 m."""
    place_x, place_y, yaw, steering, first, second, speed, rate = (x[k] for k in range(8))
    turn = speed * ca.tan(steering)
    turn_1 = -speed * ca.sin(first)
    along = speed * ca.cos(first)
    turn_2 = -along * ca.sin(second)
    rates = ca.vertcat(speed * ca.cos(yaw), speed * ca.sin(yaw), turn, rate, turn_1 - turn, turn_2 - turn_1, u)
    return rates, [place_x, steering, yaw + first + second, yaw + first, yaw, place_y], [1, 1, 2, 3, 4, 5]


_EQUATIONS = {"edge": (_edge, 5), "trailers": (_trailers, 8)}


def casadi_time(name: str) -> float | str:
    """Median processor time of an update of the hand-written problem [s], or why there is none."""
    if importlib.util.find_spec("casadi") is None:
        return "casadi is not installed"
    if shutil.which("gcc") is None:
        return "no C compiler"
    ca = importlib.import_module("casadi")
    equations, nx = _EQUATIONS[name]
    nu, h = 2, HORIZON / NODES
    x, u = ca.SX.sym("x", nx), ca.SX.sym("u", nu)
    field = ca.Function("f", [x, u], [equations(ca, x, u)[0]])
    step = ca.Function("step", [x, u], [x + h * field(x + h / 2 * field(x, u), u)])
    residual = ca.Function("r", [x], [_residuals(ca, *equations(ca, x, u)[1:], x[nx - nu :])])
    states, inputs, start = ca.SX.sym("X", nx, NODES + 1), ca.SX.sym("U", nu, NODES), ca.SX.sym("x0", nx)
    gaps = [states[:, 0] - start, *(states[:, k + 1] - step(states[:, k], inputs[:, k]) for k in range(NODES))]
    rows = [np.sqrt(h) * residual(states[:, k]) for k in range(NODES)] + [residual(states[:, NODES])]
    rows += [np.sqrt(h * _EFFORT) * inputs[:, k] for k in range(NODES)]
    whole = ca.vertcat(ca.vec(states), ca.vec(inputs))
    r, g = ca.vertcat(*rows), ca.vertcat(*gaps)
    J = ca.jacobian(r, whole)
    parts = ca.Function("parts", [whole, start], [J.T @ J, J.T @ r, ca.jacobian(g, whole), g])
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder) / "parts.c", Path(folder) / "parts.so"
        generator = ca.CodeGenerator("parts.c")
        generator.add(parts)
        generator.generate(f"{folder}/")
        subprocess.run(["gcc", "-O3", "-march=native", "-shared", "-fPIC", source, "-o", library], check=True)
        compiled = ca.external("parts", str(library))
        return _updates(ca, compiled, nx, nu, np.array(step(np.zeros(nx), np.zeros(nu))).ravel(), step)


def _residuals(ca: Any, coordinates: Sequence[Any], weights: Sequence[int], speeds: Any) -> Any:
    """Homogeneous residuals of coordinates with their weights, and speeds."""
    top = max(weights)
    s = ca.vertcat(*(ca.sign(z) * ca.fabs(z) ** (top / w) for z, w in zip(coordinates, weights, strict=True)))
    total = ca.sumsqr(s) + PRECISION ** (2 * top)
    return ca.vertcat(np.sqrt(_COST) * total ** (-(top - 1) / (2 * top)) * s, np.sqrt(_SPEED) * speeds)


def _updates(ca: Any, parts: Any, nx: int, nu: int, at_rest: np.ndarray, step: Any) -> float:
    """Median time of updates in closed loop."""
    start = at_rest.copy()
    start[:3] = START
    count = (NODES + 1) * nx
    w = np.concatenate([np.tile(start, NODES + 1), np.zeros(NODES * nu)])
    H, _, A, _ = parts(w, start)
    solver = ca.conic(
        "qp", "qrqp", {"h": H.sparsity(), "a": A.sparsity()}, {"print_iter": False, "print_header": False}
    )
    taken = []
    for _ in range(UPDATES):
        begin = time.process_time()
        H, gradient, A, g = parts(w, start)
        low = np.concatenate([np.full(count, -np.inf), -LIMIT - w[count:]])
        high = np.concatenate([np.full(count, np.inf), LIMIT - w[count:]])
        found = solver(h=H + 1e-8 * ca.DM.eye(len(w)), g=gradient, a=A, lba=-g, uba=-g, lbx=low, ubx=high)
        w = w + np.array(found["x"]).ravel()
        taken.append((float(np.abs(w[count:]).max()), time.process_time() - begin))
        start = start + (np.array(step(start, w[count : count + nu])).ravel() - start) * PERIOD / (HORIZON / NODES)
    return _median([spent for largest, spent in taken[1:] if largest > LIMIT - 1e-3])


def main() -> None:
    """Print both tables."""
    print("| update, 20 nodes, bounded inputs [ms] | rnc_pin | hand-written CasADi, generated code |")
    print("|---|---|---|")
    for name in _EQUATIONS:
        peer = casadi_time(name)
        said = peer if isinstance(peer, str) else f"{1e3 * peer:.1f}"
        print(f"| {name} | {1e3 * update_time(name):.1f} | {said} |", flush=True)
    print(f"\n| updates from {DRAWN} starts [ms] | median | largest (count) | at bounds: median, largest | searches |")
    print("|---|---|---|---|---|")
    for name in _EQUATIONS:
        print(drawn_row(name), flush=True)
    print("\n| from 0.3 aside | cost | rate [1/s] | homogeneous distance after 20 s |")
    print("|---|---|---|---|")
    for name in ("edge", "car"):
        for kind in ("set point", "squares", "squares, goal"):
            found = rate(name, kind, 0.3)
            slope = "none: stalls" if np.isnan(found.slope) else f"{found.slope:.2f}"
            print(f"| {name} | {kind} | {slope} | {found.end:.2g} |", flush=True)


if __name__ == "__main__":
    main()
