"""The compiled kernel and NumPy evaluate the same quantities, for all kinds of rows and for random systems."""

import ast
import os
import subprocess
import sys
from copy import deepcopy
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, assume, given, settings

import rnc_pin as rnc
from random_systems import recipes, reduced_of
from rnc_pin import _kernel
from rnc_pin.integrators import LieRungeKutta4
from rnc_pin.model import reduction_kernel
from rnc_pin.model.numpy_evaluator import NumPyEvaluator, state_rates
from rnc_pin.model.reduction_kernel import ReductionKernel
from rnc_pin.model.state_evaluation import StateEvaluation
from systems import (
    ackermann_car,
    bicycle,
    bodies_on_bodies,
    drifting_manipulator,
    fire_truck,
    four_bar,
    free_arm,
    free_flying_panda,
    leaning_wheel,
    mecanum,
    mobile_manipulator,
    random_states,
    rolling_bodies,
    spinning_space_robot,
    sprung_arm,
    tiago,
    tumbling_panda,
    wheels_on_moving_ground,
)

needs_library = pytest.mark.skipif(
    _kernel.library is _kernel.NUMPY_ALONE, reason="NumPy evaluates: no library, or RNC_PIN_KERNEL=numpy"
)

CONFIGURATION = ("M", "B", "E", "E_inverse", "R", "H", "J1", "A_star", "input_matrix", "b")
STATE = (
    "v",
    "v1",
    "v2",
    "gamma",
    "residual",
    "bias",
    "E_dot",
    "R_dot",
    "J1_dot",
    "A_star_dot",
    "V",
    "G",
    "b_dot",
    "passive_force",
)


def outputs_of_all_kinds():
    """Free base: outputs of every kind, a point with an offset, a caster, a force on a frame, and rows of the user."""
    robot = rnc.Robot(free_arm())
    row = np.linspace(0.2, 1.0, robot.nv)[None]

    def turning(q):
        return row * np.cos(q[0])

    def turning_rate(q, v):
        heading = pin.Quaternion(q[3:7]).matrix()[0]
        return -row * np.sin(q[0]) * (heading @ v[:3])

    constraints = [
        rnc.NoSideSlip("base", "y", at=(0.2, -0.1, 0.3)),
        rnc.Caster("upper", 0.1),
        rnc.Pfaffian(turning, turning_rate, names=["row"]),
    ]
    actuators = [rnc.FrameForce("tip", "x"), rnc.FrameTorque("base", "z"), "arm", "hand", rnc.FrameForce("base", "y")]
    own = rnc.Output(None, turning, turning_rate, ["own"])
    vertical = [
        rnc.FrameOrientation("tip"),
        rnc.FrameYaw("tip", "y"),
        rnc.FrameTilt("tip", "x"),
        rnc.Distance("base", "tip"),
        rnc.FramePosition("tip", "zx"),
        rnc.FrameAngularVelocity("base", "z"),
        rnc.FrameSpeed("upper", "z"),
        own,
    ]
    return rnc.NonholonomicSystem(robot, constraints, actuators).reduce(vertical=vertical)


def body_on_a_joint(joint_model):
    model = pin.Model()
    joint = model.addJoint(0, joint_model, pin.SE3.Identity(), "root_joint")
    inertia = pin.Inertia(1.0, np.array([0.1, 0.2, 0.3]), np.diag([1.0, 1.5, 2.0]))
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    return rnc.NonholonomicSystem(rnc.Robot(model), [], np.eye(model.nv)).reduce()


SYSTEMS = (
    ackermann_car,
    bicycle,
    bodies_on_bodies,
    drifting_manipulator,
    fire_truck,
    four_bar,
    free_flying_panda,
    leaning_wheel,
    mecanum,
    mobile_manipulator,
    outputs_of_all_kinds,
    rolling_bodies,
    spinning_space_robot,
    sprung_arm,
    tiago,
    tumbling_panda,
    wheels_on_moving_ground,
)


def by_numpy(reduced, q, *, t=None, **velocity):
    """Evaluation of the same rows without the kernel."""
    evaluator = NumPyEvaluator(reduced.reduction_data)
    return StateEvaluation.at(evaluator, q.copy(), t=t, **{name: each.copy() for name, each in velocity.items()})


def fused_call(reduced, name):
    """A call of the compiled evaluator that returns None for states that it leaves to NumPy."""

    def call(*arguments):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(NumPyEvaluator, name, lambda *_: None)
            return getattr(reduced.evaluator, name)(*arguments)

    return call


def compare(reduced, q, v2, size=1e-3):
    """All quantities at states (..., nq), (..., r), both ways; ``size`` is that of terms that may cancel."""

    def near(found, expected, condition, what, scale=0.0):
        scale = np.abs(expected).max(initial=max(scale, size))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * scale * condition, err_msg=what)

    plain = by_numpy(reduced, q, v2=v2)
    condition = np.max(plain.condition) ** 2
    found = reduced.at(q, v2)
    assert found.arrays_at_q.vertical is not None
    inertial = np.abs(plain.C).max() * np.abs(plain.v).max() * np.abs(plain.R).max()  # cancels in G
    for name in (*CONFIGURATION, *STATE):
        near(getattr(found, name), getattr(plain, name), condition, name, inertial)
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
    if q.ndim == 1 and (fused := fused_call(reduced, "state_derivative")(q, v2, T, 0.1 * damping, damping)):
        expected = plain.flow(T, damping, 0.1 * damping)
        near(fused[0], expected.v, condition, "state_derivative")
        near(fused[1], np.concatenate([expected.v2_dot, plain.v1, [expected.power]]), condition, "state_derivative")
    if q.ndim == 1 and (found := fused_call(reduced, "admissible_velocity")(q, v2)):
        near(found[0], plain.v, condition, "admissible_velocity")
        near(found[1], np.square(plain.R).sum(), condition, "sum of squares of R")
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


@needs_library
@pytest.mark.parametrize("make", SYSTEMS, ids=lambda make: make.__name__)
def test_every_kind_of_row_agrees(make):
    reduced = make()
    states = random_states(reduced, 4)
    compare(reduced, *states[0])
    q, v2 = (np.stack(each) for each in zip(*states, strict=True))
    compare(reduced, q.reshape(2, 2, -1), v2.reshape(2, 2, -1))


@needs_library
@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
@given(recipes())
def test_random_systems_agree(recipe):
    try:
        reduced = reduced_of(recipe)
        states = random_states(reduced, 2)
    except (rnc.RncError, RuntimeError, AssertionError):  # AssertionError: no configuration is well conditioned
        assume(False)
    assume(reduced.r and reduced.evaluator.compiled)
    q, v2 = (np.stack(each) for each in zip(*states, strict=True))
    assume(reduced.at(q).arrays_at_q.one_by_one)
    v2 = v2 / np.maximum(1.0, np.abs(reduced.at(q, v2).v).max(axis=-1, keepdims=True))  # R may be large
    size = max(1e-3, np.abs(reduced.at(q).R).max() ** 2)  # as in the rate of R, which may be zero
    compare(reduced, q[0], v2[0], size)
    compare(reduced, q, v2, size)


@needs_library
@pytest.mark.parametrize("make", [mobile_manipulator, rolling_bodies, sprung_arm, tiago, tumbling_panda])
def test_integration_agrees(make):
    """Steps of the kernel are those of ``LieRungeKutta4``."""
    compare_steps(make(), h=0.002, steps=3)


@needs_library
@pytest.mark.parametrize("joint", [pin.JointModelPlanar, pin.JointModelSpherical, pin.JointModelFreeFlyer])
def test_steps_of_more_than_a_radian_agree(joint):
    compare_steps(body_on_a_joint(joint()), h=3.0, steps=1)


def compare_steps(reduced, h, steps):
    ((q, v2),) = random_states(reduced, 1)
    T = np.linspace(-1.0, 1.0, reduced.p)
    y = np.concatenate([v2, np.zeros(reduced.vertical.size + 1)])
    found = reduced.evaluator.integrate(q, y, T, h, steps)
    integrator = LieRungeKutta4(reduced.robot)

    def rate(at, y):
        return state_rates(by_numpy(reduced, at, v2=y[: reduced.r]), T, None, None)

    for _ in range(steps):
        q, y = integrator.step(rate, q, y, h)
    np.testing.assert_allclose(found[0], q, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(found[1], y, rtol=1e-9, atol=1e-9 * np.abs(y).max())


@needs_library
def test_a_step_that_is_too_long_is_left_to_python():
    """``LieRungeKutta4`` then raises the error."""
    reduced = mobile_manipulator()
    ((q, v2),) = random_states(reduced, 1)
    y = np.concatenate([1e6 * v2, np.zeros(reduced.vertical.size + 1)])
    assert reduced.evaluator.integrate(q, y, np.zeros(reduced.p), 0.1, 1) is None


@needs_library
def test_an_integrator_needs_no_evaluation():
    """The fused state derivative serves all built-in rows, moving constraints included; rows of the user decline."""
    for make in (
        mobile_manipulator,
        rolling_bodies,
        bodies_on_bodies,
        wheels_on_moving_ground,
        sprung_arm,
        tiago,
        spinning_space_robot,
        drifting_manipulator,
    ):
        reduced = make()
        ((q, v2),) = random_states(reduced, 1)
        assert fused_call(reduced, "state_derivative")(q, v2, np.ones(reduced.p), None, None) is not None
    reduced = outputs_of_all_kinds()
    ((q, v2),) = random_states(reduced, 1)
    assert fused_call(reduced, "state_derivative")(q, v2, np.ones(reduced.p), None, None) is None


@needs_library
def test_built_in_rows_need_no_python():
    """Only rows of the user are evaluated in Python."""
    reduced = outputs_of_all_kinds()
    kernel = ReductionKernel(reduced.reduction_data)
    names = [name for place in (*kernel.external, *kernel.external_vertical) for name in place.block.names]
    assert names == ["row", "own"]
    assert [block.names[0] for blocks in kernel.python_values for block, _ in blocks] == ["tip_orientation_x"]


@needs_library
def test_a_state_that_is_singular_for_the_default_rows_is_evaluated_by_numpy():
    """The other states of a batch are evaluated by NumPy too, with the same result."""
    reduced = four_bar()
    (q, v2), *_ = random_states(reduced, 2)
    flat = reduced.robot.configuration()
    assert not reduced.at(np.stack([q, flat])).arrays_at_q.one_by_one
    found = reduced.forward_dynamics(q, v2, np.zeros(reduced.p))
    np.testing.assert_allclose(found, by_numpy(reduced, q, v2=v2).v2_dot(np.zeros(reduced.p)), rtol=1e-9)


@needs_library
def test_another_result_than_numpy_is_not_used(monkeypatch):
    """A row whose description is wrong: the model warns once, and NumPy evaluates it."""
    monkeypatch.setattr(rnc.NoSideSlip, "bind", _wrong(rnc.NoSideSlip.bind))
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    with pytest.warns(RuntimeWarning, match="kernel is not used for this model: it differs from NumPy by"):
        reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
    assert not reduced.evaluator.compiled
    assert reduced.at(robot.configuration(), [0.1, 0.2]).v.shape == (3,)


def _wrong(bind):
    def bound(kind, robot):
        rows = bind(kind, robot)
        described = rows.kernel_rows
        rows.kernel_rows = lambda model: [row._replace(numbers=2 * np.array(row.numbers)) for row in described(model)]
        return rows

    return bound


@needs_library
def test_another_memory_layout_is_not_used(monkeypatch):
    def refuse(*_):
        raise ValueError("Pinocchio's matrices are not stored by columns")

    monkeypatch.setattr(reduction_kernel, "_view", refuse)
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
    with pytest.warns(RuntimeWarning, match="not stored by columns"):
        reduced = system.reduce()
    assert not reduced.evaluator.compiled


@needs_library
def test_results_repeat_to_the_bit_whatever_was_evaluated_in_between():
    reduced = tiago()
    (q, v2), (p, w) = random_states(reduced, 2)
    T = np.ones(reduced.p)
    first = reduced.forward_dynamics(q, v2, T)
    _ = reduced.terms(p, w), reduced.at(p, w).A_star_dot
    np.testing.assert_array_equal(reduced.forward_dynamics(q, v2, T), first)
    np.testing.assert_array_equal(reduced.at(q, v2).v2_dot(T), first)
    np.testing.assert_array_equal(deepcopy(reduced).forward_dynamics(q, v2, T), first)
    np.testing.assert_array_equal(reduced.forward_dynamics(*(np.stack([x, x]) for x in (q, v2, T)))[1], first)
    forces = reduced.inverse_dynamics(*(np.stack([x, y]) for x, y in ((p, q), (w, v2), (w, v2))))[1]
    np.testing.assert_array_equal(reduced.inverse_dynamics(q, v2, v2), forces)


@needs_library
@pytest.mark.parametrize("wrong", ["list", "float32", "strided", "shape", "nan", "not of unit length"])
def test_forward_dynamics_takes_and_refuses_what_an_evaluation_does(wrong):
    reduced = tiago()
    ((q, v2),) = random_states(reduced, 1)
    T = np.ones(reduced.p)
    expected = reduced.forward_dynamics(q, v2, T)
    if wrong == "list":
        np.testing.assert_array_equal(reduced.forward_dynamics(q.tolist(), v2.tolist(), T.tolist()), expected)
    elif wrong == "float32":
        assert reduced.forward_dynamics(q, v2.astype(np.float32), T).dtype == float
    elif wrong == "strided":
        np.testing.assert_array_equal(reduced.forward_dynamics(np.repeat(q, 2)[::2], v2, T), expected)
    else:
        bad = {"shape": q[:-1], "nan": np.full_like(q, np.nan), "not of unit length": 2 * q}[wrong]
        with pytest.raises(rnc.InputError):
            reduced.forward_dynamics(bad, v2, T)


@needs_library
def test_the_kernel_refuses_arrays_of_other_sizes():
    reduced = tiago()
    ((q, v2),) = random_states(reduced, 1)
    records = reduced.evaluator.kernel
    evaluator = records.calls
    for arrays in (
        (q[:-1], np.empty((), records.kinematics), np.empty((), records.inverse), None, False),
        (q, np.empty((2,), records.kinematics), np.empty((), records.inverse), None, False),
        (q, np.empty(3), np.empty((), records.inverse), None, False),
        (q,),
    ):
        with pytest.raises((ValueError, TypeError), match="kernel: "):
            evaluator.configure(*arrays)
    with pytest.raises(TypeError):
        type(evaluator)()
    unmade = type(evaluator).__new__(type(evaluator))
    with pytest.raises(TypeError):
        unmade.forward_dynamics(q, v2, q)


@needs_library
def test_the_stub_has_the_functions_and_methods_of_the_library():
    """Type checkers read it in place of the C, so each call of the package is checked against it."""
    stub = ast.parse(Path(_kernel.__file__).with_name("compiled.pyi").read_text())
    (evaluator,) = (node for node in stub.body if isinstance(node, ast.ClassDef))
    functions = {node.name for node in stub.body if isinstance(node, ast.FunctionDef)}
    methods = {node.name for node in evaluator.body if isinstance(node, ast.FunctionDef)}
    library = _kernel.library
    assert functions == {name for name, each in vars(library).items() if callable(each) and not isinstance(each, type)}
    assert methods - {"__init__"} == {name for name in vars(library.Evaluator) if not name.startswith("__")}


@pytest.mark.parametrize(
    ("asked", "expected"), [("numpy", "numpy"), ("", "numpy" if _kernel._load()[0] is _kernel.NUMPY_ALONE else "c")]
)
def test_the_environment_selects_the_path(asked, expected, tmp_path):
    script = "import rnc_pin; print(rnc_pin.kernel)"
    command, environment = [sys.executable, "-c", script], {"RNC_PIN_KERNEL": asked}
    # Beside the checkout, whose sources may have no library.
    found = subprocess.run(command, capture_output=True, text=True, env=environment, check=True, cwd=tmp_path)
    assert found.stdout.strip() == expected


def test_an_unknown_path_is_refused():
    found = subprocess.run(
        [sys.executable, "-c", "import rnc_pin; rnc_pin.kernel"],
        capture_output=True,
        text=True,
        env={"RNC_PIN_KERNEL": "fortran"},
    )
    assert "RNC_PIN_KERNEL is 'fortran': expected 'c' or 'numpy'" in found.stderr


OUTDATED = """
import sys, types
sys.modules["rnc_pin._kernel.compiled"] = types.SimpleNamespace(INTERFACE=3)
"""


@pytest.mark.parametrize(
    ("what", "asked", "stream", "line"),
    [
        ("import rnc_pin; print(rnc_pin.kernel)", "", "stderr", "using NumPy; reinstall with pip install -e ."),
        (
            "from rnc_pin.applications.command_line.usage import cli; cli(['--version'])",
            "",
            "stdout",
            ", kernel numpy (compiled kernel is of",
        ),
        ("import rnc_pin; rnc_pin.kernel", "c", "stderr", "RNC_PIN_KERNEL is 'c', but the compiled kernel is of"),
    ],
)
def test_a_library_of_other_sources_is_named(what, asked, stream, line, tmp_path):
    environment = {**os.environ, "RNC_PIN_KERNEL": asked}
    command = [sys.executable, "-c", OUTDATED + what]
    found = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path)
    text = getattr(found, stream)
    assert line in text
    assert f"of interface 3, {_kernel.INTERFACE} expected" in text
    if not asked:
        assert found.stderr.count("compiled kernel") == (stream == "stderr")


def driven_arm():
    """Arm on a free base: a joint, the tilt of a frame and its speed move as prescribed, above a turntable."""
    robot, swing = rnc.Robot(free_arm()), rnc.planning.Harmonic([0.1], amplitude=[0.3], frequency=0.5, phase=0.4)
    rows = [
        rnc.NoSideSlip("base", "y", at=(0.2, -0.1, 0.3), ground=rnc.GroundPlane(spin=0.7)),
        rnc.PrescribedMotion(rnc.JointPosition("arm"), swing),
        rnc.PrescribedMotion(rnc.FrameTilt("tip", "x"), swing),
        rnc.PrescribedMotion(rnc.FrameSpeed("upper", "z"), swing),
    ]
    return rnc.NonholonomicSystem(robot, rows, [rnc.FrameForce("tip", "x"), rnc.FrameTorque("base", "z"), "hand"])


@needs_library
def test_rows_over_time_agree():
    """Whole evaluations, stacks of states with a time each, steps of the integrator, and the model at one time."""
    reduced = driven_arm().reduce()
    assert reduced.evaluator.kernel.fused
    generator = np.random.default_rng(3)
    q = np.stack([reduced.robot.random_configuration(generator) for _ in range(2)])
    v2, T, times = generator.normal(size=(2, reduced.r)), np.ones(reduced.p), np.array([0.2, 0.7])
    plain = [by_numpy(reduced, q[k], v2=v2[k], t=times[k]) for k in range(2)]
    together = reduced.at(q, v2, t=times)
    assert together.arrays_at_q.one_by_one
    for k, expected in enumerate(plain):
        alone, frozen = reduced.at(q[k], v2[k], t=times[k]), reduced.frozen(times[k])
        assert alone.fused_terms is not None
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
    fused = fused_call(reduced, "state_derivative")(q[0], v2[0], T, None, damping, times[0])
    for one, other in zip(fused, rates, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
    found = reduced.evaluator.integrate(q[0], y, T, 0.02, 2)

    def rate(at, y):
        return state_rates(by_numpy(reduced, at, v2=y[: reduced.r], t=y[-2]), T, None, None)

    at = q[0]
    for _ in range(2):
        at, y = integrator.step(rate, at, y, 0.02)
    np.testing.assert_allclose(found[0], at, rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(found[1], y, rtol=1e-9, atol=1e-9)


@needs_library
def test_a_wrong_rate_over_time_is_not_used(monkeypatch):
    """The comparison at the reduction covers mu and its rate: NumPy evaluates a model whose rates differ."""
    rows = type(
        rnc.PrescribedMotion(rnc.JointPosition("arm"), rnc.planning.Harmonic([0.1], [0.3], 0.5)).bind(
            rnc.Robot(free_arm())
        )
    )
    for wrong in (0, 1):
        monkeypatch.setattr(
            rows,
            "rates_over_time",
            lambda self, t, k=wrong: [x * (1 + (i == k)) for i, x in enumerate(self._at(t)[1:])],
        )
        with pytest.warns(RuntimeWarning, match="kernel is not used for this model: it differs from NumPy by"):
            assert not driven_arm().reduce().evaluator.compiled
