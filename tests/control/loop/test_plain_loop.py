"""Every controller in somebody else's loop: no ``simulate``, no reduced plant, Pinocchio's constrained dynamics."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.applications.scenario.scenario import Scenario

DT, SUBSTEPS, SAMPLES = 0.002, 4, 45
CASES = {
    "(12) over (10)": ("space-robot", {}),
    "(12) over computed torque": ("mobile-manipulator", {"controller.tracker": "computed_torque"}),
    "reducing outputs": ("space-robot", {"controller.type": "reducing_outputs"}),
    "(8)-(9) on some actuators": ("space-robot-fixed-platform", {}),
    "(16) and (20)": ("space-robot-uncertain", {}),
    "(16) and (20) for wheels": ("wheels-uncertain", {}),
    "wide A4 with a secondary objective": ("free-flying-arm", {"controller.posture": {}}),
    "class 2s": ("fire-truck", {}),
    "class 3, first phase": ("mobile-manipulator-two-phase", {}),
    "class 3, second phase": ("mobile-manipulator-two-phase", {"controller.platform.begin": 0.05}),
}


@pytest.mark.parametrize("case", CASES)
def test_a_plain_loop_gives_the_motion_of_the_simulation(case):
    scenario, options = CASES[case]
    experiment = Scenario.load(scenario, {**options, "comparisons": {}, "plots": {}}).experiment
    reduced, controller, q = experiment.reduced, experiment.controller, experiment.q0
    run = rnc.simulate(reduced, controller, q, SAMPLES * DT, DT, plant=rnc.ReducedPlant(reduced, substeps=SUBSTEPS))

    model, data = reduced.robot.model, reduced.robot.model.createData()
    v, integrals = np.zeros(reduced.n), np.zeros(reduced.r)
    state = controller.initial_state(reduced.at(q, integrals).measure(integrals))
    moved = False
    for sample in range(SAMPLES + 1):
        v2 = _rates(reduced, q, v)
        np.testing.assert_allclose(q, run.q[sample], atol=1e-6)
        np.testing.assert_allclose(v2, run.v2[sample], atol=1e-5)
        command, state = controller.step(sample * DT, reduced.at(q, v2).measure(integrals), state)
        T = reduced.allocate(q, command.F) if command.T is None else command.T
        moved = moved or np.abs(T).max() > 1e-3
        for _ in range(SUBSTEPS):
            q, v, integrals = _step(reduced, model, data, q, v, integrals, T, DT / SUBSTEPS)
    assert moved


def _rates(reduced, q, v):
    """v2 = J2 v, for J2 is what is left of E^-1: v2 = (R^T R)^-1 R^T v on the constraint surface."""
    return np.linalg.lstsq(reduced.terms(q, np.zeros(reduced.r)).R, v, rcond=None)[0]


def _acceleration(reduced, model, data, q, v, T):
    terms = reduced.terms(q, _rates(reduced, q, v))
    B = reduced.lagrangian_terms(q, np.zeros(reduced.r)).B
    return pin.forwardDynamics(model, data, q, v, B @ T, terms.A, terms.A_dot @ v)


def _step(reduced, model, data, q, v, integrals, T, h):
    """The midpoint rule on (q, v): simple, and good enough."""
    a = _acceleration(reduced, model, data, q, v, T)
    q_half, v_half = pin.integrate(model, q, h / 2 * v), v + h / 2 * a
    a_half = _acceleration(reduced, model, data, q_half, v_half, T)
    return pin.integrate(model, q, h * v_half), v + h * a_half, integrals + h * _rates(reduced, q_half, v_half)
