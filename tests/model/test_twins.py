"""The compiled kernel beside NumPy: each kind of row, force, task, limit and law, values and derivatives, batches."""

import inspect
from contextlib import suppress

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, assume, given, settings

import rnc_pin as rnc
from bodies import add_body
from by_numpy import by_numpy, needs_library
from kernel_calls import CALLS, LIMITS, TASKS, Taken, rows_of
from kinds import ILL_SCALED, KINDS, ROBOTS, driven_arm
from random_systems import recipes, reduced_of
from rnc_pin import _kernel
from rnc_pin._kernel.kernel_rows import Form, Value
from rnc_pin.analysis.derivatives import _at_one_state as at_one_state
from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.control import limits, tasks
from rnc_pin.model.evaluator import Evaluator
from rnc_pin.model.integrators import LieRungeKutta4, ReducedMotion, state_rates
from systems import mobile_manipulator, random_states, sprung_arm, tiago, tumbling_panda

pytestmark = needs_library
BY_PYTHON = {"Pfaffian", "CenterOfMass", "ForceFunction"}
"""Kinds that the kernel does not know; rows of a user are in ``outputs_of_all_kinds``."""

CONFIGURATION = ("M", "B", "E", "E_inverse", "R", "H", "J1", "A_star", "input_matrix", "b")
STATE = (
    *("row_velocities", "v", "v1", "v2", "gamma", "residual", "bias", "E_dot", "R_dot", "J1_dot", "A_star_dot"),
    *("V", "G", "b_dot", "passive_force"),
)
DERIVATIVES = ("v", "v2_dot", "v_q", "v_v2", "v2_dot_q", "v2_dot_v2", "v2_dot_T")


def fused(call, *arguments):
    """Result of a call that the kernel answers; None for states that it leaves to NumPy."""
    with pytest.MonkeyPatch.context() as patch, suppress(AttributeError):  # where formulas begin
        for module in ("evaluator", "integrators"):
            patch.setattr(f"rnc_pin.model.{module}.StateEvaluation", None)
        return call(*arguments)


def fused_rate(reduced, q, v2, T, external=None, damping=None, t=None):
    y = np.concatenate([v2, np.zeros(reduced.vertical.size), [0.0] if t is None else [t, 0.0]])
    return fused(ReducedMotion(reduced.robot, damping).rate, reduced.evaluator, q, y, T, external)


def compare(reduced, q, v2, size=1e-3):
    """All quantities at states (..., nq), (..., r), both ways; ``size`` is that of terms that may cancel."""

    def near(found, expected, condition, what, scale=0.0):
        scale = np.abs(expected).max(initial=max(scale, size))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * scale * condition, err_msg=what)

    plain = by_numpy(reduced, q, v2=v2)
    condition, found = np.max(plain.condition) ** 2, reduced.at(q, v2)
    assert found.arrays_at_q.vertical is not None
    inertial = np.abs(plain.C).max() * np.abs(plain.v).max() * np.abs(plain.R).max()  # cancels in G
    for name in (*CONFIGURATION, *STATE):
        near(getattr(found, name), getattr(plain, name), condition, name, inertial)
        assert not getattr(found, name).flags.writeable, name
    for name, value in vars(plain.terms()).items():
        near(getattr(reduced.terms(q, v2), name), value, condition, f"terms().{name}", inertial)
    for one, other in zip(found.outputs(), plain.outputs(), strict=True):
        near(one, other, 1.0, "outputs")
    integrals = np.zeros(v2.shape)
    for name, value in plain.measure(integrals)._asdict().items():
        if value is not None:
            near(getattr(found.measure(integrals), name), value, condition, f"measure().{name}")
    T = np.random.default_rng(1).normal(size=(*q.shape[:-1], reduced.p))
    condition = condition * np.max(np.linalg.cond(plain.H))
    for one in (reduced.forward_dynamics(q, v2, T), found.v2_dot(T)):
        near(one, plain.v2_dot(T), condition, "v2_dot")
    for method in ("acceleration", "multipliers", "contact_forces"):
        near(getattr(found, method)(T), getattr(plain, method)(T), condition, method)
    force = plain.inverse_dynamics(v2)
    for one in (found.inverse_dynamics(v2), reduced.inverse_dynamics(q, v2, v2)):
        near(one, force, condition, "inverse_dynamics")
    if reduced.p == reduced.r and (inputs := np.max(np.linalg.cond(plain.input_matrix))) < 1e8:
        near(found.allocate(force), plain.allocate(force), condition * inputs, "allocate")
    damping = np.linspace(0.0, 1.0, reduced.n)
    for one, other in zip(found.flow(T, damping, 0.1 * damping), plain.flow(T, damping, 0.1 * damping), strict=True):
        near(one, other, condition, "flow")
    if q.ndim == 1 and (rates := fused_rate(reduced, q, v2, T, 0.1 * damping, damping)):
        expected = plain.flow(T, damping, 0.1 * damping)
        near(rates[0], expected.v, condition, "state_derivative")
        near(rates[1], np.concatenate([expected.v2_dot, plain.v1, [expected.power]]), condition, "state_derivative")
    if q.ndim == 1 and (found := fused(reduced.evaluator.admissible_velocity, q, v2)):
        near(found[0], plain.v, condition, "admissible_velocity")
        near(found[1], np.square(plain.R).sum(), condition, "sum of squares of R")
    if q.ndim == 1 and (ends := reduced.evaluator.sample(q, v2, 0.01)) is not None:
        end = by_numpy(reduced, pin.integrate(reduced.robot.model, q, 0.01 * plain.v), v2=v2)
        near(ends[0].v, plain.v, condition, "sample")
        for one, other in zip(ends[0].input_accelerations, plain.input_accelerations, strict=True):
            near(one, other, condition, "sample")
        near(ends[1].R, end.R, condition * np.max(end.condition) ** 2, "sample")
        row, faster = np.ones((1, reduced.n)), v2 + 0.1
        later, reached = by_numpy(reduced, end.q, v2=faster), row @ (end.R @ faster + end.b)
        change, ahead = row @ end.R @ (faster - v2), 0.01 * row @ end.R @ later.v2_dot(T)
        away = abs(change) + abs(ahead - change)
        for margin in (1e-6, -1e-6):
            bounds = row, reached - 9.0 * away, reached + (1.0 + margin) * away
            assert reduced.evaluator.far_within(ends, faster, T, 0.0, 0.01, bounds) == (margin > 0.0)
    measured = plain.v + 0.1
    slipping = by_numpy(reduced, q, v=measured)
    for name in STATE:
        near(getattr(reduced.at(q, v=measured), name), getattr(slipping, name), condition, f"measured {name}", inertial)
    if q.ndim == 1:
        sampled = reduced.evaluator.measured(q.copy(), measured)
        assert reduced.evaluator.measures == ("arrays_at_v" in vars(sampled))  # one call, unless Python evaluates rows
        for name, value in slipping.measure(integrals)._asdict().items():
            if value is not None:
                near(getattr(sampled.measure(integrals), name), value, condition, f"sampled {name}", inertial)


@pytest.mark.parametrize("name", [*KINDS, *ROBOTS])
def test_rows_and_forces_of_each_kind(name):
    reduced = (KINDS | ROBOTS)[name]()
    states = random_states(reduced, 4)
    compare(reduced, *states[0])
    q, v2 = (np.stack(each) for each in zip(*states, strict=True))
    compare(reduced, q.reshape(2, 2, -1), v2.reshape(2, 2, -1))


@pytest.mark.parametrize("name", KINDS)
def test_derivatives_of_each_kind(name):
    """In motion and under inputs; ``tests/analysis/test_derivatives.py`` has the differences of the dynamics."""
    reduced = KINDS[name]()
    for q, v2 in random_states(reduced, 2, condition=300.0 if name in ILL_SCALED else 50.0):
        compare_derivatives(reduced, q, v2, np.linspace(-1.0, 2.0, reduced.p))


def compare_derivatives(reduced, q, v2, T):
    found, plain = state_derivatives(reduced, q, v2, T), at_one_state(reduced, reduced.at(q, v2), T)
    for each in DERIVATIVES:
        expected = getattr(plain, each)
        scale = max(1.0, np.abs(expected).max(initial=0.0))
        np.testing.assert_allclose(getattr(found, each), expected, rtol=0, atol=1e-10 * scale, err_msg=each)


@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
@given(recipes())
def test_random_systems(recipe):
    try:
        reduced = reduced_of(recipe)
        states = random_states(reduced, 2)
    except (rnc.RncError, RuntimeError, AssertionError):  # AssertionError: no configuration is well conditioned
        assume(False)
    assume(reduced.r and reduced.evaluator.kernel)
    q, v2 = (np.stack(each) for each in zip(*states, strict=True))
    assume(reduced.at(q).compiled_kinematics is not None)
    v2 = v2 / np.maximum(1.0, np.abs(reduced.at(q, v2).v).max(axis=-1, keepdims=True))  # R may be large
    size = max(1e-3, np.abs(reduced.at(q).R).max() ** 2)  # as in the rate of R, which may be zero
    compare(reduced, q[0], v2[0], size)
    compare(reduced, q, v2, size)


def body_on_a_joint(joint_model):
    model = pin.Model()
    add_body(model, "root_joint", joint_model, 1.0, com=(0.1, 0.2, 0.3), moments=(1.0, 1.5, 2.0))
    return rnc.NonholonomicSystem(rnc.Robot(model), [], np.eye(model.nv)).reduce()


@pytest.mark.parametrize("make", [mobile_manipulator, KINDS["bodies that roll"], sprung_arm, tiago, tumbling_panda])
def test_integration(make):
    """Steps of the kernel are those of ``LieRungeKutta4``."""
    compare_steps(make(), h=0.002, steps=3)


@pytest.mark.parametrize("joint", [pin.JointModelPlanar, pin.JointModelSpherical, pin.JointModelFreeFlyer])
def test_steps_of_more_than_a_radian(joint):
    compare_steps(body_on_a_joint(joint()), h=3.0, steps=1)


def compare_steps(reduced, h, steps):
    ((q, v2),) = random_states(reduced, 1)
    T = np.linspace(-1.0, 1.0, reduced.p)
    y = np.concatenate([v2, np.zeros(reduced.vertical.size + 1)])
    motion = ReducedMotion(reduced.robot)
    found = fused(motion.steps, reduced.evaluator, q, y, T, h, steps)
    traced = fused(motion.trace, reduced.evaluator, q, v2, T, h, steps)
    plain = motion.trace(Evaluator(reduced.evaluator.data), q, v2, T, h, steps)
    for one, other in zip(traced[:4], plain[:4], strict=True):  # the way of more than half a turn is not unique
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())
    integrator = LieRungeKutta4(reduced.robot)

    def rate(at, y):
        return state_rates(by_numpy(reduced, at, v2=y[: reduced.r]), T, None, None)

    for _ in range(steps):
        q, y = integrator.step(rate, q, y, h)
    np.testing.assert_allclose(found[0], q, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(found[1], y, rtol=1e-9, atol=1e-9 * np.abs(y).max())


@pytest.mark.parametrize("name", [*KINDS, "outputs_of_all_kinds"])
def test_an_integrator_needs_no_evaluation(name):
    """The fused state derivative serves all built-in rows, moving constraints included; rows of the user decline."""
    reduced = (KINDS | ROBOTS)[name]()
    ((q, v2),) = random_states(reduced, 1)
    rates = fused_rate(reduced, q, v2, np.ones(reduced.p), t=0.0 if reduced.rheonomic else None)
    assert (rates is None) == (name in ("outputs_of_all_kinds", "disk that leans"))  # outputs of a user


def test_rows_over_time(generator):
    """Whole evaluations, stacks of states with a time each, steps of the integrator, and the model at one time."""
    reduced = driven_arm().reduce()
    assert reduced.evaluator.kernel.fused
    q = np.stack([reduced.robot.random_configuration(generator) for _ in range(2)])
    v2, T, times = generator.normal(size=(2, reduced.r)), np.ones(reduced.p), np.array([0.2, 0.7])
    plain = [by_numpy(reduced, q[k], v2=v2[k], t=times[k]) for k in range(2)]
    together = reduced.at(q, v2, t=times)
    assert together.compiled_kinematics is not None
    for k, expected in enumerate(plain):
        alone, frozen = reduced.at(q[k], v2[k], t=times[k]), reduced.frozen(times[k])
        for name in ("v", "b", "gamma", "V", "G", "b_dot", "residual"):
            value = getattr(expected, name)
            for found in (getattr(alone, name), getattr(together, name)[k], getattr(frozen.at(q[k], v2[k]), name)):
                np.testing.assert_allclose(found, value, rtol=0, atol=1e-10 * max(1.0, np.abs(value).max()))
        np.testing.assert_allclose(frozen.forward_dynamics(q[k], v2[k], T), expected.v2_dot(T), rtol=1e-9)
        np.testing.assert_allclose(reduced.forward_dynamics(q[k], v2[k], T, t=times[k]), expected.v2_dot(T), rtol=1e-9)
        force = reduced.inverse_dynamics(q[k], v2[k], v2[k], t=times[k])
        np.testing.assert_allclose(force, expected.inverse_dynamics(v2[k]), rtol=1e-9, atol=1e-9)
    y = np.concatenate([v2[0], np.zeros(reduced.vertical.size), [times[0], 0.0]])
    damping, integrator = np.linspace(0.0, 1.0, reduced.n), LieRungeKutta4(reduced.robot)
    rates = state_rates(plain[0], T, damping, None)
    for one, other in zip(fused_rate(reduced, q[0], v2[0], T, None, damping, times[0]), rates, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
    found = fused(ReducedMotion(reduced.robot).steps, reduced.evaluator, q[0], y, T, 0.02, 2)

    def rate(at, y):
        return state_rates(by_numpy(reduced, at, v2=y[: reduced.r], t=y[-2]), T, None, None)

    at = q[0]
    for _ in range(2):
        at, y = integrator.step(rate, at, y, 0.02)
    np.testing.assert_allclose(found[0], at, rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(found[1], y, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", TASKS | LIMITS)
def test_tasks_and_limits(name, monkeypatch):
    """Rows of a bound task or limit; each has at least one row."""
    found = []
    for library in (_kernel.library, _kernel.NUMPY_ALONE):
        monkeypatch.setattr(_kernel, "library", library)
        found.append(rows_of((TASKS | LIMITS)[name]))
    assert len(found[0][0])
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", CALLS)
def test_functions_of_the_library(name, monkeypatch):
    """The caller of a function computes the same without the library."""
    call, tolerance = CALLS[name]
    taken = Taken(_kernel.library)
    monkeypatch.setattr(_kernel, "library", taken)
    found = call()
    assert name in taken.names
    monkeypatch.setattr(_kernel, "library", _kernel.NUMPY_ALONE)
    expected = call()
    assert len(found) == len(expected) > 0
    for one, other in zip(found, expected, strict=True):
        scale = max(1.0, np.abs(np.nan_to_num(other)).max(initial=0.0))
        np.testing.assert_allclose(one, other, rtol=0, atol=tolerance * scale)


def test_each_kind_has_a_reduction(monkeypatch):
    """Constraints, outputs and forces that can be bound, and formulas of rows and values."""
    rooms = (rnc.constraints, rnc.outputs, rnc.forces)
    public = [getattr(room, name) for room in rooms for name in room.__all__]
    kinds = {each for each in public if inspect.isclass(each) and hasattr(each, "bind")}
    assert len(kinds) > 25
    bound, forms, values = set(), set(), set()

    def noted(bind):
        return lambda self, robot: bound.add(type(self)) or bind(self, robot)

    for kind in kinds:
        monkeypatch.setattr(kind, "bind", noted(kind.bind))
    for make in (*KINDS.values(), lambda: driven_arm().reduce()):
        reduced = inspect.unwrap(make)()
        data, model = reduced.reduction_data, reduced.robot.model
        stacks = (reduced.all_constraints, data.reducing, data.vertical)
        blocks = [place.block for stack in stacks for place in stack.places]
        rows = [row for block in blocks for row in block.kernel_rows(model) or ()]
        forms |= {row.form for row in rows}
        values |= {row.value[0] for row in rows}
    assert ({kind.__name__ for kind in kinds - bound}, forms) == (BY_PYTHON, set(Form) - {Form.EXTERNAL})
    assert values == set(Value)


def test_each_task_limit_and_function_of_the_library_has_a_call():
    for room, base, entries in ((tasks, tasks.ControlTask, TASKS), (limits, limits.ControlLimit, LIMITS)):
        public = {each for name in dir(room) if inspect.isclass(each := getattr(room, name))}
        kinds = {each for each in public if inspect.isclass(each) and issubclass(each, base)} - {base}
        assert kinds == {type(each) for _, each in entries.values()}
    library = vars(_kernel.library).items()
    assert set(CALLS) == {name for name, each in library if callable(each) and not inspect.isclass(each)}
