"""Figure of a plan: outputs, rates and inputs over time, with their bounds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from rnc_pin.optimal.motion_plan import MotionPlan

_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#999999")
_SAMPLES = 400
_NEAR = 2.0  # bounds farther away than this share of the range of a curve are not drawn


def plan_figure(plan: MotionPlan, outputs: Sequence[str]) -> Figure:
    """Return the figure of a plan.

    Args:
        plan: the plan.
        outputs: names of the outputs to draw.
    """
    reference = plan.reference(list(outputs))
    times = np.linspace(0.0, plan.duration, _SAMPLES, endpoint=False)
    points = [reference.at(float(t)) for t in times]
    position, velocity = (np.array([getattr(each, name) for each in points]) for name in ("position", "velocity"))
    figure = Figure(figsize=(8.0, 7.0), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    for k, name in enumerate(outputs):
        for axis, values, quantity in ((axes[0], position, "output"), (axes[1], velocity, "velocity")):
            axis.plot(times, values[:, k], color=_color(k), label=name)
            _draw_bounds(axis, plan, quantity, name, values[:, k], _color(k))
    for k, name in enumerate(plan.info.input_names):
        held = np.append(plan.u[:, k], plan.u[-1, k])
        axes[2].step(plan.time, held, where="post", color=_color(k), label=name)
        _draw_bounds(axes[2], plan, "input", name, held, _color(k))
    for axis, title in zip(axes, ("outputs", "rates", "inputs"), strict=True):
        axis.set_ylabel(f"{title} [SI]")
        axis.grid(alpha=0.3)
        axis.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        axis.spines[["top", "right"]].set_visible(False)
    axes[-1].set_xlabel("time [s]")
    figure.suptitle(f"plan: cost {plan.info.cost:.4g}, {plan.info.iterations} iterations", fontsize="medium")
    return figure


def _draw_bounds(axis: Axes, plan: MotionPlan, quantity: str, name: str, values: np.ndarray, color: str) -> None:
    room = _NEAR * max(float(np.ptp(values)), 1e-9)
    for kind, bounded, *limits in plan.info.bounds:
        if (kind, bounded) != (quantity, name):
            continue
        for limit in limits:
            if values.min() - room < limit < values.max() + room:
                axis.axhline(limit, color=color, ls="--", lw=0.8, alpha=0.7)


def _color(k: int) -> str:
    return _COLORS[k % len(_COLORS)]
