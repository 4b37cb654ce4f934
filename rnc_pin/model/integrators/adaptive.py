"""Adaptive integration on the configuration manifold."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.errors import DivergenceError
from rnc_pin.model.integrators.exponential_coordinates import ExponentialCoordinates
from rnc_pin.robots.robot import Robot

_SHORT = 1e-9  # step size that counts as too short, relative to the whole duration
_PATIENCE = 50  # largest number of consecutive steps that are too short

TimedRate = Callable[[float, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
LocalRate = Callable[[float, np.ndarray, np.ndarray], np.ndarray | None]
Settle = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
Samples = tuple[np.ndarray, np.ndarray, np.ndarray]


class AdaptiveIntegrator:
    """SciPy's eighth-order Dormand-Prince method with step-size control, in local coordinates.

    Each step runs in the coordinates ``q = q_k (+) u`` about the configuration at its start. The next chart is centred
    at its end. Quaternions therefore keep unit length, and no step leaves its chart. The next step starts from the
    result of ``settle``.

    Args:
        robot: robot of the configurations.
        rate: ``rate(t, q, y) -> (v, ydot)``; y holds all other states, in a linear space.
        rtol, atol: relative and absolute tolerance of a step. Only the absolute one applies to positions, because u
            starts at zero.
        settle: maps (q, y) at the end of a step to an equivalent state, for example in another chart.
        local_rate: faster way to rates of ``x = (u, y)``: ``local_rate(t, q_k, x) -> xdot``, or None where ``rate`` has
            to decide.

    Example:
        >>> from rnc_pin.model.integrators import AdaptiveIntegrator
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> circle = lambda t, q, y: (np.array([1.0, 0.0, 1.0]), -y)
        >>> integrator = AdaptiveIntegrator(robot, circle, rtol=1e-10, atol=1e-10)
        >>> blocks = list(integrator.run(np.array([0.0, 1.0, np.pi]), robot.configuration(), np.ones(1)))
        >>> t, q, y = (each[-1] for each in blocks[-1])
        >>> q.round(6) + 0.0, y.round(6)  # half a circle of radius 1, and exp(-pi)
        (array([ 0.,  2., -1.,  0.]), array([0.043214]))
    """

    def __init__(
        self,
        robot: Robot,
        rate: TimedRate,
        rtol: float,
        atol: float,
        settle: Settle | None = None,
        local_rate: LocalRate | None = None,
    ) -> None:
        self._model, self._nv = robot.model, robot.nv
        self._coordinates = ExponentialCoordinates(robot)
        self._rate, self._rtol, self._atol, self._settle = rate, rtol, atol, settle
        self._local_rate = local_rate

    def run(self, times: np.ndarray, q0: np.ndarray, y0: np.ndarray) -> Iterator[Samples]:
        """Yield the states (t, q, y) at the increasing ``times`` in blocks (count, ...); the first is (q0, y0).

        Between the ends of steps, the method's seventh-order interpolation applies. A block has the samples of one
        step before its end, in the chart of this step, or the sample at its end.

        Raises:
            DivergenceError: steps become too short, for example near a singularity.
        """
        q, nv = np.array(q0, dtype=float), self._nv

        def chart_rate(t: float, x: np.ndarray) -> np.ndarray:
            found = None if self._local_rate is None else self._local_rate(t, q, x)
            if found is None:
                found = np.concatenate(self._coordinates.derivative(partial(self._rate, t), q, x[:nv], x[nv:]))
            return found

        x0 = np.concatenate([np.zeros(nv), y0])
        yield _block(times[:1], q, x0[nv:])
        solver = scipy.integrate.DOP853(
            chart_rate, float(times[0]), x0, float(times[-1]), rtol=self._rtol, atol=self._atol
        )
        due, short, shortest = 1, 0, _SHORT * float(times[-1] - times[0])
        while due < len(times):
            solver.step()
            short = short + 1 if solver.step_size is None or solver.step_size < shortest else 0
            if solver.status == "failed" or short > _PATIENCE:
                raise DivergenceError(
                    "the step size is too small: the motion runs into a singularity, or the "
                    f"tolerances (rtol {self._rtol:g}, atol {self._atol:g}) are finer than rounding allows",
                    time=float(solver.t),
                )
            end = due + int(np.searchsorted(times[due:], solver.t))
            if end > due:
                x = solver.dense_output()(times[due:end])
                inside = np.array([pin.integrate(self._model, q, u) for u in np.ascontiguousarray(x[:nv].T)])
                yield times[due:end], inside, np.ascontiguousarray(x[nv:].T)
                due = end
            # The next chart; chart_rate sees the new q.
            q = pin.integrate(self._model, q, solver.y[:nv])
            y = solver.y[nv:]
            if self._settle is not None:
                q, y = self._settle(q, y)
            solver.y = np.concatenate([np.zeros(nv), y])
            if due < len(times) and times[due] == solver.t:
                yield _block(times[due : due + 1], q, y)
                due += 1
            if due < len(times):
                solver.f = chart_rate(solver.t, solver.y)


def _block(times: np.ndarray, q: np.ndarray, y: np.ndarray) -> Samples:
    """Block of one sample."""
    return times, q[None].copy(), np.array(y[None], dtype=float)
