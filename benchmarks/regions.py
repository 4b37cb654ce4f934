"""Regions of convergence of feedback along plans: share of random initial errors that end near the goal, by size."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

import rnc_pin as rnc
from benchmarks.planned_models import car, docking
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.errors import SimulationError
from rnc_pin.optimal import MotionPlan, OutputBound, PlanFeedback, SolverSettings, VelocityBound
from rnc_pin.planning.action_models import KinematicModel, Nodes

PICTURE = Path(__file__).parent.parent / "docs" / "images" / "optimal_regions.png"
SIZES = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
"""Lengths of the vectors of initial errors [m, rad]."""
NEAR, LARGEST_HITCH = 0.1, 1.5
"""Error at the end [m, rad] and hitch angle [rad] that count as a success."""

Start = Callable[[np.ndarray], np.ndarray]
"""Configuration from an error."""


class Case(NamedTuple):
    """A plan, its regulator's weight of states, and how errors start and count."""

    reduced: rnc.ReducedModel
    plan: MotionPlan
    state_cost: float
    dt: float
    size: int
    start: Start
    error: Callable[[rnc.Trajectory], float]


def regions(count: int) -> None:
    """Print success rates of both kinds of gains, and write the picture of the documentation."""
    cases = {
        "car, parking": _parking(),
        "tractor, 1 trailer in reverse": _docking(1),
        "tractor, 2 trailers in reverse": _docking(2),
        "bicycle, change of lane (lean, steering)": _bicycle(),
    }
    print(f"share of {count} random errors that end within {NEAR:g} m or rad, by size {SIZES}")
    rates: dict[str, dict[str, list[float]]] = {}
    for name, case in cases.items():
        gains = {
            "rnc.tvlqr": rnc.tvlqr(case.reduced, case.plan, case.state_cost),
            "gains of the plan": PlanFeedback(case.reduced, case.plan),
        }
        for kind, controller in gains.items():
            found = [_share(case, controller, size, count) for size in SIZES]
            rates.setdefault(name, {})[kind] = found
            print(f"  {name:42s} {kind:18s} {'  '.join(f'{each:4.0%}' for each in found)}", flush=True)
    _draw(rates)


def _share(case: Case, controller: PlanFeedback, size: float, count: int) -> float:
    generator, reached = np.random.default_rng(0), 0
    for _ in range(count):
        direction = generator.normal(size=case.size)
        q0 = case.start(size * direction / np.linalg.norm(direction))
        v2_0 = case.plan.w[0]
        try:
            run = rnc.simulate(case.reduced, controller, q0, case.plan.duration, case.dt, v2_0=v2_0)
            reached += case.error(run) < NEAR
        except SimulationError:  # the motion diverges
            continue
    return reached / count


def _displaced(reduced: rnc.ReducedModel, q0: np.ndarray) -> Start:
    """Start from an error along the tangent space, for planar robots without holonomic rows."""
    model = KinematicModel(reduced)
    return lambda error: model.displaced(Nodes(q0[None], np.empty((1, 0))), error[None]).q[0]


def _end_error(reduced: rnc.ReducedModel, plan: MotionPlan, hitches: int = 0) -> Callable[[rnc.Trajectory], float]:
    """Largest difference from the end of the plan; infinite after a jackknife."""
    model = KinematicModel(reduced)

    def error(run: rnc.Trajectory) -> float:
        if hitches and np.abs(run.q[:, -hitches:]).max() > LARGEST_HITCH:
            return np.inf
        none = np.empty((1, 0))
        return float(np.abs(model.difference(Nodes(plan.q[-1:], none), Nodes(run.q[-1:], none))).max())

    return error


def _parking() -> Case:
    reduced = car()
    bounds = [OutputBound(rnc.JointPosition("front_steering"), -0.6, 0.6), VelocityBound(-1.0, 1.0)]
    goal = {rnc.FramePosition("rear_axle", "xy"): [0.5, 1.7], rnc.FrameYaw("chassis"): 0.0}
    q0 = reduced.robot.configuration()
    plan = rnc.optimal.plan(reduced, q0, goal, 12.0, bounds=bounds, settings=SolverSettings(nodes=80))
    return Case(reduced, plan, 20.0, 0.02, reduced.n, _displaced(reduced, q0), _end_error(reduced, plan))


def _docking(trailers: int) -> Case:
    reduced, goal, bounds = docking(trailers, most_bent=1.0)
    q0 = reduced.robot.configuration({"root_joint": [4.0, 1.0, 0.2]})
    plan = rnc.optimal.plan(
        reduced,
        q0,
        goal,
        16.0,
        bounds=bounds,
        settings=SolverSettings(refinements=1, accuracy=1e-2),
        feedback=lambda found: rnc.tvlqr(reduced, found, state_cost=20.0).K,
    )
    start, error = _displaced(reduced, q0), _end_error(reduced, plan, hitches=trailers)
    return Case(reduced, plan, 20.0, 0.02, reduced.n, start, error)


def _bicycle() -> Case:
    """Change of lane of the built-in scenario; errors are motions that the constraints allow."""
    experiment = Scenario.load("bicycle-lane-change", {"plots": {}, "comparisons": {}}).experiment
    reduced, plan = experiment.reduced, experiment.plan
    assert plan is not None
    names = ["rear_wheel_y", "rear_frame_yaw", "rear_frame_tilt_y"]
    rows = [reduced.vertical.names.index(name) for name in names]
    end, model = plan.reference(names).at(plan.duration).position, KinematicModel(reduced)

    def start(error: np.ndarray) -> np.ndarray:
        now, speed = Nodes(plan.q[:1], np.empty((1, 0))), np.array([[*error, 0.0]])
        for _ in range(50):
            now = model.step(now, speed, np.array([0.02]))
        return now.q[0]

    def error(run: rnc.Trajectory) -> float:
        return float(np.abs(run.x1[-1, rows] - end).max())

    return Case(reduced, plan, 20.0, 0.01, 2, start, error)


def _draw(rates: dict[str, dict[str, list[float]]]) -> None:
    """Write the picture: solid lines for ``rnc.tvlqr``, dashed ones for the gains of the plan."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.6), layout="constrained")
    axes = figure.add_subplot(xscale="log", xlabel="initial error [m, rad]", ylabel="share that reaches the goal")
    for number, (name, kinds) in enumerate(rates.items()):
        for kind, found in kinds.items():
            line = "-" if kind == "rnc.tvlqr" else "--"
            axes.plot(SIZES, found, line, color=f"C{number}", marker="o", markersize=3, label=f"{name}: {kind}")
    axes.set_xticks(SIZES, [f"{size:g}" for size in SIZES])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    figure.legend(loc="outside right upper", fontsize=6)
    figure.savefig(PICTURE, dpi=150)
