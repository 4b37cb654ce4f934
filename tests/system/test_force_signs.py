"""One convention: a force of a row acts on the robot, in the direction in which the row counts velocity."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import free_body

GRAVITY = 9.81


def drive(base="free"):
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base=base)
    wheels = [rnc.RollingWheel(f"{side}_wheel", 0.1) for side in ("left", "right")]
    return rnc.NonholonomicSystem(robot, [*wheels, rnc.Caster("nose", 0.1)], robot.joint_names[1:]).reduce()


def forces_of(reduced, state, T):
    return dict(zip(reduced.all_constraints.names, state.contact_forces(T), strict=True))


def test_the_ground_pushes_a_ball_at_rest_up():
    reduced = rnc.NonholonomicSystem(free_body(2.0, 0.008, ball=[0, 0, 0]), [rnc.RollingBall("ball", 0.1)], []).reduce()
    q = reduced.assembled(reduced.robot.configuration())
    state, none = reduced.at(q, np.zeros(3)), np.zeros(0)
    assert forces_of(reduced, state, none)["vertical(ball)"] == pytest.approx(2 * GRAVITY, rel=1e-12)
    assert rnc.analysis.NormalForces(reduced).at(state, none) == pytest.approx([2 * GRAVITY], rel=1e-12)
    run = rnc.simulate(reduced, rnc.control.ZeroInput(reduced), q, 0.02, 0.01)
    column = run.info.outputs.contact_forces.index("vertical(ball)")
    np.testing.assert_allclose(run.contact_forces[:, column], run.normal_forces[:, 0], rtol=1e-12)


def test_driven_wheels_push_the_robot_forward_and_a_turn_to_its_inside():
    reduced = drive("planar")
    mass = sum(each.mass for each in list(reduced.robot.model.inertias)[1:])
    state = reduced.at(reduced.robot.configuration(), np.array([3.0, 5.0]))  # turns to the left
    T = np.array([2.0, 1.0])
    named, acceleration = forces_of(reduced, state, T), state.acceleration(T)
    model = reduced.robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, state.q, state.v, acceleration)
    pin.centerOfMass(model, data, state.q, state.v, acceleration)
    com = data.acom[0]
    along = sum(force for name, force in named.items() if name.startswith("rolling"))
    across = sum(force for name, force in named.items() if name.startswith("lateral"))
    assert (along, across) == (pytest.approx(mass * com[0], rel=1e-10), pytest.approx(mass * com[1], rel=1e-10))
    assert across > 0


@pytest.mark.parametrize("base", ["free", "planar"])
def test_forces_of_rows_are_what_the_equations_of_motion_leave(base):
    reduced, generator = drive(base), np.random.default_rng(1)
    q = reduced.assembled(reduced.robot.configuration())
    v2, T = generator.normal(size=reduced.r), generator.normal(size=2)
    state = reduced.at(q, v2)
    acceleration = state.acceleration(T)
    left = state.M @ acceleration + state.bias - reduced.actuation.matrix(state.position) @ T
    np.testing.assert_allclose(state.all_rows.T @ state.contact_forces(T), left, atol=1e-9)
    np.testing.assert_allclose(state.constraint_forces(T), left, atol=1e-9)
    kept = [reduced.all_constraints.names.index(name) for name in reduced.constraints.names]
    np.testing.assert_allclose(-state.all_rows[kept].T @ state.multipliers(T), left, atol=1e-9)
