"""The compiled kernel: when it is used, what it leaves to NumPy; ``test_twins.py`` compares what both compute."""

import ast
import os
import subprocess
import sys
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

import rnc_pin as rnc
from by_numpy import by_numpy, needs_library
from kinds import driven_arm, outputs_of_all_kinds
from plain_kinematics import Plain, near
from rnc_pin import _kernel
from rnc_pin.math.linear_algebra import null_space
from rnc_pin.model import ConfigurationEvaluation, ReducedModel, StateEvaluation, reduction_kernel
from rnc_pin.model.evaluator import Evaluator, evaluator_for
from rnc_pin.model.filled_arrays import CompiledArraysAtQ, CompiledArraysAtV
from rnc_pin.model.integrators import ReducedMotion
from rnc_pin.model.kinematics import OWN_AXES, WORLD_AXES, KnownKinematics
from rnc_pin.model.reduction_kernel import ReductionKernel
from systems import four_bar, free_arm, mobile_manipulator, random_states, space_robot_in_joints, tiago


@needs_library
def test_a_step_that_is_too_long_is_left_to_python():
    """``LieRungeKutta4`` then raises the error."""
    reduced = mobile_manipulator()
    ((q, v2),) = random_states(reduced, 1)
    y = np.concatenate([1e6 * v2, np.zeros(reduced.vertical.size + 1)])
    with pytest.raises(rnc.DivergenceError, match="reduce the step"):
        ReducedMotion(reduced.robot).steps(reduced.evaluator, q, y, np.zeros(reduced.p), 0.1, 1)


@needs_library
def test_built_in_rows_need_no_python():
    """Only rows of the user are evaluated in Python."""
    kernel = ReductionKernel(outputs_of_all_kinds().reduction_data)
    names = [name for stack in (kernel.external, kernel.external_vertical) for name in stack.names]
    assert names == ["row", "own"]
    assert [block.names[0] for blocks in kernel.python_values for block, _ in blocks] == ["tip_orientation_x"]


@needs_library
@pytest.mark.parametrize("form", [np.ndarray.tolist, tuple, np.float32])
def test_lists_and_other_numbers_take_the_kernel_too(form, monkeypatch):
    reduced = mobile_manipulator()
    ((q, v2),) = random_states(reduced, 1)
    q, v2, T = (np.float32(each).astype(float) for each in (q, v2, np.arange(reduced.p)))
    expected = reduced.forward_dynamics(q, v2, T)
    monkeypatch.setattr(ReducedModel, "_state", lambda *_: pytest.fail("NumPy evaluates"))
    assert np.array_equal(reduced.forward_dynamics(*map(form, (q, v2, T))), expected)


@needs_library
def test_a_state_that_is_singular_for_the_default_rows_is_evaluated_by_numpy():
    """The other states of a batch are evaluated by NumPy too, with the same result."""
    reduced = four_bar()
    (q, v2), *_ = random_states(reduced, 2)
    assert reduced.at(np.stack([q, reduced.robot.configuration()])).compiled_kinematics is None
    found = reduced.forward_dynamics(q, v2, np.zeros(reduced.p))
    np.testing.assert_allclose(found, by_numpy(reduced, q, v2=v2).v2_dot(np.zeros(reduced.p)), rtol=1e-9)


@needs_library
def test_another_result_than_numpy_is_not_used(monkeypatch):
    """A row whose description is wrong: the model warns once, and NumPy evaluates it."""
    monkeypatch.setattr(rnc.NoSideSlip, "bind", _wrong(rnc.NoSideSlip.bind))
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    with pytest.warns(RuntimeWarning, match="kernel is not used for this model: it differs from NumPy by"):
        reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
    assert not reduced.evaluator.kernel
    assert reduced.at(robot.configuration(), [0.1, 0.2]).v.shape == (3,)


def _wrong(bind):
    def bound(kind, robot):
        rows = bind(kind, robot)
        described = rows.kernel_rows
        longer = lambda row: row._replace(numbers=(1 + 1e-7) * np.array(row.numbers))  # noqa: E731
        rows.kernel_rows = lambda model: [longer(row) for row in described(model)]
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
    assert not reduced.evaluator.kernel


@needs_library
def test_results_repeat_to_the_bit_whatever_was_evaluated_in_between():
    reduced = tiago()
    (q, v2), (p, w) = random_states(reduced, 2)
    T = np.ones(reduced.p)
    first = reduced.forward_dynamics(q, v2, T)
    _ = reduced.terms(p, w), reduced.at(p, w).A_star_dot
    np.testing.assert_array_equal(reduced.forward_dynamics(q, v2, T), first)
    np.testing.assert_array_equal(deepcopy(reduced).forward_dynamics(q, v2, T), first)
    np.testing.assert_array_equal(reduced.forward_dynamics(*(np.stack([x, x]) for x in (q, v2, T)))[1], first)
    forces = reduced.inverse_dynamics(*(np.stack([x, y]) for x, y in ((p, q), (w, v2), (w, v2))))[1]
    np.testing.assert_array_equal(reduced.inverse_dynamics(q, v2, v2), forces)


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


OUTDATED = """
import sys, types
sys.modules["rnc_pin._kernel.compiled"] = types.SimpleNamespace(INTERFACE=3)
"""
KERNEL = "import rnc_pin; print(rnc_pin.kernel)"


@pytest.mark.parametrize(("code", "asked", "stream", "words"), [
    (KERNEL, "numpy", "stdout", "numpy\n"),
    (KERNEL, "", "stdout", "numpy\n" if _kernel._load()[0] is _kernel.NUMPY_ALONE else "c\n"),
    (KERNEL, "fortran", "stderr", "RNC_PIN_KERNEL is 'fortran': expected 'c' or 'numpy'"),
    (OUTDATED + KERNEL, "", "stderr", f"of interface 3, {_kernel.INTERFACE} expected; using NumPy; reinstall with"),
    (OUTDATED + "from rnc_pin.applications.command_line.cli import cli; cli(['--version'])", "", "stdout",
        ", kernel numpy (compiled kernel is of interface 3"),
    (OUTDATED + KERNEL, "c", "stderr", "RNC_PIN_KERNEL is 'c', but the compiled kernel is of interface 3"),
])  # fmt: skip
def test_the_environment_selects_the_kernel(code, asked, stream, words, tmp_path):
    command, environment = [sys.executable, "-c", code], {**os.environ, "RNC_PIN_KERNEL": asked}
    # Beside the checkout, whose sources may have no library.
    found = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path)
    assert words in getattr(found, stream)


@needs_library
def test_a_wrong_rate_over_time_is_not_used(monkeypatch):
    """The comparison at the reduction covers mu and its rate: NumPy evaluates a model whose rates differ."""
    swing = rnc.planning.Harmonic([0.1], [0.3], 0.5)
    rows = type(rnc.PrescribedMotion(rnc.JointPosition("arm"), swing).bind(rnc.Robot(free_arm())))
    for wrong in (0, 1):
        spoilt = lambda self, t, k=wrong: [x * (1 + (i == k)) for i, x in enumerate(self._at(t)[1:])]  # noqa: E731
        monkeypatch.setattr(rows, "rates_over_time", spoilt)
        with pytest.warns(RuntimeWarning, match="kernel is not used for this model: it differs from NumPy by"):
            assert not driven_arm().reduce().evaluator.kernel


@needs_library
def test_whole_calls_of_a_compiled_evaluator_are_those_of_numpy_where_it_declines():
    """Two velocities depend on each other so nearly that others replace them."""
    reduced = mobile_manipulator()
    ((q, v2),) = random_states(reduced, 1)
    W = null_space(reduced.at(q).A).T
    W[1] = np.cos(1e-4) * W[0] + np.sin(1e-4) * W[1]
    data = reduced.reduction_data.in_velocities(W, free=True)
    compiled, plain = evaluator_for(data, reduced.evaluator), Evaluator(data)
    assert compiled.kernel
    assert ConfigurationEvaluation(compiled, q).compiled_kinematics is None
    T, external, y = np.ones(data.p), np.full(data.n, 0.1), np.concatenate([v2, np.zeros(data.vertical.size + 1)])
    motion = ReducedMotion(data.robot, np.full(data.n, 0.2))
    for call in (
        lambda by: ReducedModel(by, reduced.assembly).forward_dynamics(q, v2, T),
        lambda by: ReducedModel(by, reduced.assembly).inverse_dynamics(q, v2, v2),
        lambda by: ReducedModel(by, reduced.assembly).terms(q, v2).V,
        lambda by: motion.rate(by, q.copy(), y, T, external)[1],
        lambda by: by.admissible_velocity(q.copy(), v2)[0],
        lambda by: by.measured(q.copy(), np.ones(data.n)).residual,
    ):
        np.testing.assert_allclose(call(compiled), call(plain), rtol=1e-9)


def test_an_evaluator_is_made_again_from_its_data():
    reduced = mobile_manipulator()
    ((q, v2),) = random_states(reduced, 1)
    copied = deepcopy(reduced)
    assert (copied.evaluator.kernel is None) == (reduced.evaluator.kernel is None)
    assert copied.evaluator.data is copied.reduction_data
    T = np.ones(reduced.p)
    np.testing.assert_array_equal(copied.forward_dynamics(q, v2, T), reduced.forward_dynamics(q, v2, T))
    state = reduced.at(q, v2)
    expected, _ = state.A_star_dot.copy(), state.motion.jacobian_dot(0)  # what Pinocchio computed is not copied
    np.testing.assert_allclose(deepcopy(state).A_star_dot, expected, rtol=1e-12, atol=1e-15)
    assert not {"arrays_at_q", "arrays_at_v"} & vars(deepcopy(state)).keys()


def test_arrays_have_the_names_of_quantities():
    """An array that no quantity has the name of would never be used."""
    others = {"vertical", "output_values", "output_slopes", "biases", "rates"}
    for arrays, evaluation in ((CompiledArraysAtQ, ConfigurationEvaluation), (CompiledArraysAtV, StateEvaluation)):
        names = {name for name, entry in vars(arrays).items() if hasattr(entry, "__get__") and name[0] != "_"} - others
        assert 4 < len(names & vars(evaluation).keys()) == len(names)


@needs_library
@pytest.mark.parametrize("make", [tiago, space_robot_in_joints])
def test_frames_are_those_of_pinocchio(make):
    """Frames of all joints, the world's and the base's included: masks of other branches, and offsets of frames."""
    reduced = make()
    robot = reduced.robot
    q = robot.random_configuration(np.random.default_rng(2))
    state = reduced.at(q, np.ones(reduced.r))
    assert state.compiled_kinematics is not None
    here, plain = state.position, Plain(robot, q, np.zeros(robot.nv))
    assert isinstance(here, KnownKinematics)
    near(here.M, plain.M())
    for frame in range(0, robot.model.nframes, 3):
        near(here.placement(frame).rotation, plain.placement(frame).rotation)
        near(here.placement(frame).translation, plain.placement(frame).translation)
        for axes in (WORLD_AXES, OWN_AXES):
            near(here.jacobian(frame, axes), plain.jacobian(frame, axes))
        near(here.jacobian(frame, rows=[4, 1]), plain.jacobian(frame, WORLD_AXES)[[4, 1]])
    assert not here.jacobian(1).flags.writeable
    assert not here.placement(1).translation.flags.writeable


def test_the_rows_of_another_reduction_are_told_apart():
    """Vertical outputs leave E as it is; other velocities, rows or times do not."""
    data = tiago().reduction_data
    assert data.measuring(data.vertical).has_rows_of(data)
    for other in (data.in_entries(list(range(data.r))), data.frozen(1.0)):
        assert not other.has_rows_of(data)
