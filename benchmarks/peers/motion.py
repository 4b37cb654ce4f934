"""Free motions at equal error: ``free_motion`` beside DOP853 of SciPy over the solution by hand.

Both start at the same state and give samples every 20 ms. The error is the largest displacement between a sample and
that of a much finer integration. DOP853 runs at several tolerances; its cost at our error is interpolated.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import rnc_pin as rnc
from benchmarks.peers.cases import Case
from benchmarks.states import regular_states
from benchmarks.timing import Measurement, in_turn, used_by

DURATION, DT, SLOWER = 4.0, 0.02, 0.3
RTOL, FINEST = 1e-10, 3e-14
TOLERANCES = (1e-8, 1e-9, 1e-10, 1e-11, 1e-12)


class Motion:
    """One motion of a system by both ways.

    Args:
        case: system.
        duration: [s].

    Attributes:
        q0, v2_0: initial state.
        times: times of the samples [s].
    """

    def __init__(self, case: Case, duration: float = DURATION) -> None:
        self._case, self._duration = case, duration
        start = regular_states(case.reduced, case.q0, 1)
        self.q0, self.v2_0 = start.q[0], SLOWER * start.v2[0]
        self._no_input = np.zeros(case.reduced.p)
        self.times = np.linspace(0.0, duration, round(duration / DT) + 1)

    def ours(self, rtol: float) -> np.ndarray:
        """Samples (count, nq) of ``free_motion``."""
        run = rnc.free_motion(self._case.reduced, self.q0, self.v2_0, self._duration, DT, tolerance=rtol)
        return run.q

    def theirs(self, rtol: float) -> np.ndarray:
        """Coordinates (count, n) by DOP853."""
        start = np.concatenate([self._case.coordinates.of(self.q0), self.v2_0])
        span = (0.0, self._duration)
        found = solve_ivp(self._rate, span, start, "DOP853", self.times, rtol=rtol, atol=rtol)
        if not found.success:
            raise RuntimeError(f"{self._case.name}: DOP853 stopped at t = {found.t[-1]:g} s: {found.message}")
        return found.y[: -len(self.v2_0)].T

    def _rate(self, t: float, y: np.ndarray) -> np.ndarray:
        """Rates of the coordinates and of v2."""
        coordinates, r = self._case.coordinates, len(self.v2_0)
        q = coordinates.configuration(y[:-r])
        v2_dot, v, _ = self._case.by_hand(q, y[-r:], self._no_input)
        return np.concatenate([coordinates.rate(q, v), v2_dot])

    def displacement(self, q: np.ndarray, reference: np.ndarray) -> float:
        """Largest displacement between samples (count, nq) [m or rad]."""
        model = self._case.model
        return max(float(np.abs(pin.difference(model, a, b)).max()) for a, b in zip(reference, q, strict=True))

    def configurations(self, x: np.ndarray) -> np.ndarray:
        """Configurations (count, nq) for coordinates (count, n)."""
        return np.array([self._case.coordinates.configuration(each) for each in x])

    def cost(self, rounds: int) -> dict[str, float]:
        """Medians of times taken in turn [ms], theirs interpolated to our error, and displacements [m or rad].

        The error is ours from the reference, the agreement that of our finest motion.
        """
        reference = self.configurations(self.theirs(FINEST))

        def measured(tolerance: float) -> Measurement:
            return used_by(lambda: self.theirs(tolerance), 1)

        errors = [self.displacement(self.configurations(self.theirs(each)), reference) for each in TOLERANCES]
        taken = in_turn([used_by(lambda: self.ours(RTOL), 1), *map(measured, TOLERANCES)], rounds)
        ours, *times = (float(figure[0]) for figure in taken)
        error = self.displacement(self.ours(RTOL), reference)
        agreement = self.displacement(self.ours(1e-13), reference)
        theirs = cost_at(error, errors, times)
        figures = {"ours_ms": ours * 1e3, "theirs_ms": theirs * 1e3, "ratio": ours / theirs}
        return {**figures, "error": error, "agreement": agreement}


def cost_at(error: float, errors: list[float], times: list[float]) -> float:
    """Cost of an error by a straight line through ``log(time)`` over ``log(error)``, which smooths chance."""
    slope, offset = np.polyfit(np.log(errors), np.log(times), 1)
    return float(np.exp(offset + slope * np.log(error)))
