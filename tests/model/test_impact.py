"""Impacts against closed forms, conservation laws and Carnot's theorem."""

import pickle

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
import systems
from bodies import add_body, add_frame
from rnc_pin.model.state_evaluation import least_norm_forces
from tolerances import ROUNDING

LENGTH, MASS = 1.4, 3.0


def bodies(*inertias):
    """Free planar bodies, each with a frame at its centre and one at (LENGTH / 2, 0, 0)."""
    model = pin.Model()
    for k, (mass, turning) in enumerate(inertias):
        joint = add_body(model, f"body_{k}_joint", "Planar", mass, moments=turning)
        for name, x in (("center", 0.0), ("end", LENGTH / 2), ("tail", -LENGTH / 2)):
            add_frame(model, f"{name}_{k}", joint, (x, 0.0, 0.0))
    model.gravity = pin.Motion.Zero()
    return rnc.Robot(model)


@pytest.fixture(scope="module")
def bar():
    return bodies((MASS, MASS * LENGTH**2 / 12))


@pytest.fixture(scope="module")
def pinned(bar):
    """The bar, pinned at its end to the world."""
    anchor = rnc.LoopClosure("universe", "tail_0", kind="point", offset_a=(-LENGTH / 2, 0.0, 0.0))
    return rnc.NonholonomicSystem(bar, [anchor])


def test_two_point_masses_stick_or_rebound():
    masses, speeds = np.array([2.0, 5.0]), np.array([1.5, -0.4])
    robot = bodies(*((mass, 1.0) for mass in masses))
    touching = rnc.NonholonomicSystem(robot, [rnc.LoopClosure("center_0", "center_1", kind="point")])
    v = np.array([speeds[0], 0.0, 0.0, speeds[1], 0.0, 0.0])
    common, approach = masses @ speeds / masses.sum(), speeds[0] - speeds[1]
    for e in (0.0, 0.35, 1.0):
        jump = rnc.impact(touching, robot.configuration(), v, restitution=e)
        expected = common + np.array([-1.0, 1.0]) * e * approach * masses[::-1] / masses.sum()
        np.testing.assert_allclose(jump.v[[0, 3]], expected, atol=ROUNDING)
        loss = 0.5 * (1 - e**2) * approach**2 * masses.prod() / masses.sum()
        assert jump.loss == pytest.approx(loss, abs=1e-12)


def test_landing_wheels_spin_up_and_share_the_lateral_impulse():
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
    system = rnc.NonholonomicSystem(robot, [rnc.RollingWheel(f"{side}_wheel", 0.1) for side in ("left", "right")])
    q, v = robot.configuration(), np.array([0.7, 0.2, 0.0, 0.0, 0.0])
    jump, state = rnc.impact(system, q, v), system.reduce().at(q)
    kkt = np.block([[state.M, -state.A.T], [state.A, np.zeros((3, 3))]])
    np.testing.assert_allclose(jump.v, np.linalg.solve(kkt, [*state.M @ v, 0, 0, 0])[:5], atol=ROUNDING)
    left, right = (jump.impulses[f"lateral({side}_wheel)"] for side in ("left", "right"))
    assert left == pytest.approx(right)  # dependent rows share by least norm
    assert left + right == pytest.approx((state.M @ (jump.v - v))[1], rel=1e-9)


def test_nothing_happens_if_constraints_hold_or_vanish(bar, pinned):
    q, v = bar.configuration(), np.array([0.0, 0.35 * LENGTH, 0.7])
    for system in (pinned, rnc.NonholonomicSystem(bar)):
        np.testing.assert_allclose(rnc.impact(system, q, v, restitution=0.6).v, v, atol=1e-12)


def test_moving_constraint_gives_its_own_speed(bar):
    """A conveyor grips the bar: A v = mu."""
    row = np.array([[1.0, 0.0, 0.0]])
    belt = rnc.Pfaffian(lambda q: row, names=["belt"], rate=lambda q: np.array([0.5]))
    jump = rnc.impact(rnc.NonholonomicSystem(bar, [belt]), bar.configuration(), [0.2, 0.1, 0.3], restitution=0.5)
    np.testing.assert_allclose(jump.v, [0.65, 0.1, 0.3], atol=ROUNDING)
    assert jump.impulses["belt"] == pytest.approx(MASS * 0.45)


def test_conserved_momenta_take_no_impulse():
    reduced = systems.space_robot()
    q = reduced.robot.configuration({"joint_2": 1.2})
    v = reduced.at(q, [0.2, -0.1, 0.3]).v
    np.testing.assert_allclose(rnc.impact(reduced, q, v).v, v, atol=1e-12)
    with pytest.raises(rnc.ConstraintError, match=r"momentum\(platform\) is .* requires 0: .* conserved momentum"):
        rnc.impact(reduced, q, v + 0.1)


def test_refusals(bar, pinned):
    q, v = bar.configuration(), np.array([0.0, 1.0, 0.0])
    with pytest.raises(rnc.ConstraintError, match=r"no constraint row 'closure_u.*did you mean 'closure_"):
        rnc.impact(pinned, q, v, restitution={"closure_u(universe[-0.7 0 0], tail_0)": 0.5})
    with pytest.raises(rnc.ConstraintError, match=r"expected a number from 0 to 1, found 1.5"):
        rnc.impact(pinned, q, v, restitution=1.5)
    with pytest.raises(rnc.InputError, match=r"violates closure_x.* by"):
        rnc.impact(pinned, bar.configuration({bar.joint_names[0]: [0.3, 0, 0]}), v)
    for many in ((np.stack([q, q]), np.stack([v, v])), (0.0, v)):
        with pytest.raises(rnc.InputError, match="expected one state"):
            rnc.impact(pinned, *many)
    slip = rnc.NonholonomicSystem(bar, [rnc.NoSideSlip("center_0"), rnc.Pfaffian(lambda q: np.array([[0, 2.0, 0]]))])
    with pytest.raises(rnc.ConstraintError, match=r"restitution: row 'row\[0\]' has to move"):
        rnc.impact(slip, q, v, restitution={"no_side_slip(center_0.y)": 0.5})


def test_coefficients_that_create_energy_are_refused(bar):
    """Newton's law with a rebound along the row that couples least (Kane 1984)."""
    rows = np.array([[0.0, 1.0, 0.1], [1.0, 3.0, 1.0]])
    system = rnc.NonholonomicSystem(bar, [rnc.Pfaffian(lambda q: rows, names=["normal", "tangential"])])
    v, M = np.array([-2.95, 1.0, 0.0]), np.diag([MASS, MASS, MASS * LENGTH**2 / 12])
    change = np.linalg.solve(rows @ np.linalg.inv(M) @ rows.T, -np.array([2.0, 1.0]) * (rows @ v))
    end = v + np.linalg.solve(M, rows.T @ change)
    gained, before = 0.5 * (end @ M @ end - v @ M @ v), 0.5 * v @ M @ v
    assert gained > 0
    with pytest.raises(rnc.ConstraintError, match=f"create energy, {gained:.3g} J of {before:.3g} J"):
        rnc.impact(system, bar.configuration(), v, restitution={"normal": 1.0})


@pytest.mark.parametrize("apart", [0.0, 1e-7])
def test_impulses_of_dependent_rows_are_those_of_least_norm(apart):
    """The pseudo-inverse without the singular values of rows that depend on others to rounding."""
    matrix = np.array([[1.0, 2.0, 0.0, 0.5], [0.0, 1.0, 1.0, 0.0], [1.0, 3.0, 1.0 + apart, 0.5]])
    momentum = matrix.T @ np.array([0.7, -1.2, 0.4])
    expected = np.linalg.pinv(matrix.T, rcond=1e-5) @ momentum
    for rank in (2, 3) if apart == 0 else (2,):
        np.testing.assert_allclose(least_norm_forces(matrix, momentum, rank), expected, atol=1e-12)


@pytest.mark.parametrize("again", [lambda each: each, lambda each: pickle.loads(pickle.dumps(each))])
def test_results_are_immutable(bar, pinned, again):
    jump = again(rnc.impact(pinned, bar.configuration(), [0.0, 1.0, 0.0]))
    with pytest.raises(ValueError, match="read-only"):
        jump.v[0] = 1.0
    with pytest.raises(TypeError):
        jump.impulses["closure_x(universe[-0.7 0 0], tail_0)"] = 1.0
    assert "are lost" in repr(jump)


def two_links(masses=(1.0, 2.0), length=0.7):
    """A planar arm of two rods, hinged at the origin, and its mass matrix in closed form."""
    model, joint = pin.Model(), 0
    for number, mass in enumerate(masses):
        moments, place = np.array([0.0, 1.0, 1.0]) * mass * length**2 / 12, (length if number else 0.0, 0.0, 0.0)
        joint = add_body(model, f"joint_{number}", "RZ", mass, joint, com=(length / 2, 0, 0), moments=moments, at=place)
    add_frame(model, "tip", joint, (length, 0.0, 0.0))
    return rnc.NonholonomicSystem(rnc.Robot(model))


def test_an_arm_that_grasps_a_fixed_point_stops():
    arm, q, v, length = two_links(), np.array([0.4, 0.9]), np.array([1.5, -0.7]), 0.7
    place = length * np.array([np.cos(0.4) + np.cos(1.3), np.sin(0.4) + np.sin(1.3)])
    grasp = rnc.FixedOutput(rnc.FramePosition("tip", "xy"), place)
    jump = rnc.impact(arm, q, v, appearing=[grasp])
    assert np.abs(jump.v).max() < 1e-12
    # Rods of masses 1 and 2: energy by the parallel axis theorem, and J^T Lambda = -M v by hand.
    inertia, coupling = length**2 / 3, length**2 / 2
    c, M22 = np.cos(0.9), 2 * inertia
    M12 = M22 + 2 * coupling * c
    M = np.array([[inertia + M22 + 2 * length**2 + 4 * coupling * c, M12], [M12, M22]])
    assert jump.loss == pytest.approx(0.5 * v @ M @ v, rel=1e-12)
    J = length * np.array([[-np.sin(0.4) - np.sin(1.3), -np.sin(1.3)], [np.cos(0.4) + np.cos(1.3), np.cos(1.3)]])
    assert np.array(list(jump.impulses.values())) == pytest.approx(-np.linalg.solve(J.T, M @ v), rel=1e-9)
    back = rnc.impact(arm, q, v, 1.0, appearing=[grasp])
    assert back.v == pytest.approx(-v)
    assert abs(back.loss) < 1e-12


def test_constraints_that_appear_and_leave_motion_act_as_those_of_the_system():
    arm, q, v = two_links(), np.array([0.4, 0.9]), np.array([1.5, -0.7])
    weld = rnc.FixedOutput(rnc.JointPosition("joint_1"), 0.9)
    jump, same = rnc.impact(arm, q, v, appearing=[weld]), rnc.impact(arm.with_constraints([weld]), q, v)
    assert (jump.v, dict(jump.impulses)) == (pytest.approx(same.v), pytest.approx(dict(same.impulses)))
    with pytest.raises(rnc.InputError, match="appearing: expected a NonholonomicSystem"):
        rnc.impact(arm.reduce(), q, v, appearing=[weld])
    far = rnc.FixedOutput(rnc.FramePosition("tip", "xy"), [0.1, 0.2])
    with pytest.raises(rnc.InputError, match="impact: the configuration violates"):
        rnc.impact(arm, q, v, appearing=[far])
