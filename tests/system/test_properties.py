"""Lemma 1 and the equations of motion hold for drawn systems, or an error says why; ``-m long -s`` tries 2,000."""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from tolerances import CONSTRAINT, KKT, LEMMA_1

pytest.importorskip("hypothesis", reason="hypothesis is in the extra 'test' and not installed")

from hypothesis import HealthCheck, Phase, given, settings

from random_systems import CONSTRAINTS, KINDS, recipes, reduced_of
from systems import reacting

CONDITION = 100.0  # of E, up to which states are looked at: beyond, differences say nothing of derivatives
STATES = 2
STEPS = (5e-5, 5e-6)  # of differences, beside the usual one
BOUNDS = {"A R": CONSTRAINT, "H - H^T": KKT, "Hdot - V - V^T": LEMMA_1, "V linear": KKT, "KKT": KKT, "rows": 1e-5}


@dataclass
class Tally:
    """Outcomes of systems."""

    ends: Counter = field(default_factory=Counter)
    parts: Counter = field(default_factory=Counter)
    worst: dict = field(default_factory=dict)
    failures: list = field(default_factory=list)

    def note(self, figures):
        for name, value in figures.items():
            self.worst[name] = max(self.worst.get(name, 0.0), value)

    def __str__(self):
        lines = [f"systems: {self.ends.total()}"]
        lines += [f"{end}: {count}" for end, count in self.ends.most_common()]
        lines += [f"{name}, worst: {value:.1e}" for name, value in self.worst.items()]
        lines += [f"FAILED {failure}" for failure in self.failures]
        lines += ["among those that hold: " + ", ".join(f"{part} {count}" for part, count in self.parts.most_common())]
        return "\n".join(lines)


def kkt_residual(reduced, q, v2, T):
    """Accelerations against those of ``M a + A^T l = f`` that keep to the rows; momenta, without reaction, follow."""
    t, full = reduced.terms(q, v2), reduced.lagrangian_terms(q, v2)
    state, v2_dot = reduced.at(q, v2), reduced.forward_dynamics(q, v2, T)
    v_dot = state.v_dot(v2_dot)
    A = t.A[reacting(reduced)]
    n, m = reduced.n, len(A)
    K = np.block([[full.H, A.T], [A, np.zeros((m, m))]])
    rows = A @ v_dot  # what the rows ask for; that they do is checked by differences below
    pushed = full.B @ T - full.C @ t.v - full.g
    solution = np.linalg.solve(K, np.concatenate([pushed, rows]))
    weight = np.sqrt(np.diag(full.H))
    off = np.abs(weight * (solution[:n] - v_dot)).max() / max(np.abs(weight * v_dot).max(), 1.0)
    return off / max(1.0, 1e-5 * np.linalg.cond(K))


def rate_residual(reduced, q, v2, T):
    """Violation of the rows by accelerations: change of ``A v - mu`` along the motion, by differences."""
    state = reduced.at(q, v2)
    v, v_dot = state.v, state.v_dot(reduced.forward_dynamics(q, v2, T))
    h = 1e-5 / max(1.0, np.abs(v).max())

    def residual(s):
        p = pin.integrate(reduced.robot.model, q, s * v + 0.5 * s * s * v_dot)
        return reduced.at(p, v=v + s * v_dot).residual

    size = np.abs(state.A).max(initial=1.0) * max(1.0, np.abs(v).max() ** 2, np.abs(v_dot).max())
    return np.abs(residual(h) - residual(-h)).max(initial=0.0) / (2 * h) / size


def in_one_line(error):
    said = str(error)
    assert said
    assert len(said.splitlines()) == 1, said
    return type(error).__name__


def check(recipe, tally):
    try:
        reduced = reduced_of(recipe)
    except rnc.RncError as error:
        tally.ends[in_one_line(error)] += 1
        return
    generator = np.random.default_rng(recipe.seed)
    found = []
    for _ in range(8):
        try:
            q = reduced.random_configuration(generator, 1.0)
            if np.max(reduced.at(q).condition) < CONDITION:
                found.append(q)
        except rnc.RncError as error:  # a wheel that lies flat, a loop that does not close there
            in_one_line(error)
        if len(found) == STATES:
            break
    if not found or not reduced.r:
        tally.ends["no state far from singular"] += 1
        return
    figures = rnc.analysis.lemma_1_residuals(reduced, np.stack(found), recipe.seed)
    assert figures.pop("smallest eigenvalue of H") > 0
    for step in STEPS:  # next to a wheel that lies flat H is steep; a wrong V is wrong at every step
        finer = rnc.analysis.lemma_1_residuals(reduced, np.stack(found), recipe.seed, step)
        figures["Hdot - V - V^T"] = min(figures["Hdot - V - V^T"], finer["Hdot - V - V^T"])
    for q in found:
        v2, T = generator.uniform(-1, 1, reduced.r), generator.normal(size=reduced.p)
        for name, value in (("KKT", kkt_residual(reduced, q, v2, T)), ("rows", rate_residual(reduced, q, v2, T))):
            figures[name] = max(figures.get(name, 0.0), float(value))
    tally.ends["holds"] += 1
    tally.parts.update({*recipe.constraints, *(kind for _, kind in recipe.joints), recipe.base})
    tally.note(figures)
    for name, bound in BOUNDS.items():
        assert figures[name] < bound, (name, figures[name], recipe)


def run(count, stop=True):
    """Try systems; stop at the first that does not hold, made as small as it gets, or list all of them."""
    tally = Tally()

    @settings(
        max_examples=count, derandomize=True, deadline=None, database=None,
        suppress_health_check=list(HealthCheck), phases=(Phase.generate, Phase.shrink),
    )  # fmt: skip
    @given(recipes())
    def every(recipe):
        try:
            check(recipe, tally)
        except Exception as error:
            if stop:
                raise
            tally.failures.append(f"{type(error).__name__}: {error} {recipe}")

    every()
    return tally


def test_lemma_1_and_the_equations_of_motion_hold_for_40_systems():
    tally = run(40)
    assert tally.ends["holds"] > 12, str(tally)


@pytest.mark.long
def test_lemma_1_and_the_equations_of_motion_hold_for_2000_systems():
    tally = run(2000, stop=False)
    print(f"\n{tally}")
    assert not tally.failures
    assert tally.ends["holds"] > 600, str(tally)
    assert {*KINDS, *CONSTRAINTS} <= set(tally.parts)
