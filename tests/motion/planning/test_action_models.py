"""Steps of the action models: derivatives against central differences, and the order of the integrator."""

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from rnc_pin.motion.planning.action_models import ActionModel, Nodes, action_model

FORMS = ["kinematic", "acceleration", "dynamic"]
SYSTEMS = {"sleigh": systems.sleigh, "space robot": systems.space_robot_in_joints}
CURVED = SYSTEMS | {"mobile manipulator": systems.mobile_manipulator, "flying arm": systems.free_flying_panda}
"""Also with a planar and with a free base."""


def random_nodes(model, count=4, seed=0):
    generator = np.random.default_rng(seed)
    q = np.array([model.reduced.random_configuration(generator, 0.5) for _ in range(count)])
    w, u = (0.3 * generator.normal(size=(count, size)) for size in (model.nw, model.nu))
    return Nodes(q, w), u, np.full(count, 0.05)


def central(model, function, size, step=1e-4):
    """Central differences (n, nx, size) of a function from a displacement to states; log of tiny turns is zero."""
    columns = []
    for direction in np.eye(size):
        ahead, behind = (function(sign * step * direction) for sign in (1, -1))
        columns.append(model.difference(behind, ahead) / (2 * step))
    return np.stack(columns, axis=2)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("system", SYSTEMS)
def test_derivatives_of_a_step_are_those_of_differences(system, form):
    model = action_model(SYSTEMS[system](), form)
    at, u, h = random_nodes(model)
    found, n = model.step_derivatives(at, u, h), len(u)

    by_x = central(model, lambda d: model.step(model.displaced(at, np.tile(d, (n, 1))), u, h), model.nx)
    by_u = central(model, lambda d: model.step(at, u + d, h), model.nu)
    by_h = central(model, lambda d: model.step(at, u, h + d), 1)
    np.testing.assert_allclose(found.x, by_x, atol=1e-7)
    np.testing.assert_allclose(found.u, by_u, atol=1e-7)
    np.testing.assert_allclose(found.h, by_h[:, :, 0], atol=1e-7)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("system", CURVED)
def test_one_call_gives_the_derivatives_of_the_formulas(system, form, monkeypatch):
    """The series of the kernel for curved joints beside the functions of Pinocchio."""
    model = action_model(CURVED[system](), form)
    at, u, h = random_nodes(model, count=8)
    h *= 0.2  # the arm is near a singular position: its base turns at up to 45 rad/s
    assert (model.reduced.evaluator.kernel is None) == (model._compiled_derivatives(at, u, h) is None)
    found = model.step_derivatives(at, u, h)
    monkeypatch.setattr(ActionModel, "_compiled_derivatives", lambda *_: None)
    for one, other in zip(parts(found), parts(model.step_derivatives(at, u, h)), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-11 * (1 + np.abs(other).max(initial=0.0)))


def test_a_turn_beyond_the_series_has_the_derivatives_of_pinocchio():
    model = action_model(systems.sleigh(), "kinematic")
    at, u, _ = random_nodes(model)
    u[:, 1], h = 1.0, np.full(len(u), 2.5)
    assert model._compiled_derivatives(at, u, h) is None
    by_u = central(model, lambda d: model.step(at, u + d, h), model.nu, step=1e-5)
    np.testing.assert_allclose(model.step_derivatives(at, u, h).u, by_u, atol=1e-7)


def parts(found):
    """All arrays of the derivatives of a step."""
    return (found.x, found.u, found.h, *found.after, *vars(found.flow).values())


def test_only_the_dynamic_form_needs_actuators():
    reduced = rnc.NonholonomicSystem(systems.sleigh().robot, [rnc.NoSideSlip("sleigh")]).reduce()
    for form, states in (("kinematic", 3), ("acceleration", 5)):
        model = action_model(reduced, form)
        assert (model.form, model.nx, model.nu) == (form, states, 2)
    with pytest.raises(rnc.ConfigurationError, match="form 'dynamic': the system has no actuators; use 'accel"):
        action_model(reduced, "dynamic")


@pytest.mark.parametrize("form", FORMS)
def test_error_of_the_integrator_falls_with_the_square_of_the_step(form):
    model = action_model(systems.sleigh(), form)
    at, u, _ = random_nodes(model, count=1)

    def end(steps):
        now = at
        for _ in range(steps):
            now = model.step(now, u, np.array([1.0 / steps]))
        return now

    exact = end(640)
    errors = [np.abs(model.difference(exact, end(steps))).max() for steps in (10, 20)]
    if form == "kinematic":  # a constant velocity in the axes of the body: the exponential is exact
        assert max(errors) < 1e-10
    else:
        assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
