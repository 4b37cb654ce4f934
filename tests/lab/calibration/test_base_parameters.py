"""Base parameters: closed forms of a pendulum, the number of a free-flying arm, and fits of changed masses."""

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from bodies import add_body
from systems import floating_panda, four_bar


def hinge():
    model, place = pin.Model(), pin.SE3(pin.exp3(np.array([np.pi / 2, 0, 0])), np.zeros(3))
    add_body(model, "hinge", "RZ", 2.0, com=(0.3, 0.1, 0.2), at=place)
    return rnc.NonholonomicSystem(rnc.Robot(model), (), ["hinge"]).reduce()


def test_a_pendulum_shows_its_first_moments_and_its_inertia_about_the_axis():
    base = rnc.base_parameters(hinge())
    assert base.names == ("m x of hinge", "m y of hinge", "I_zz of hinge")
    assert base.unseen == tuple(f"{each} of hinge" for each in ("m", "m z", "I_xx", "I_xy", "I_yy", "I_xz", "I_yz"))
    assert base.rank == 3


def test_a_free_flying_arm_shows_ten_parameters_of_its_base_and_seven_of_each_link():
    """Khalil and Dombre; links behind a revolute joint whose axis is parallel to none before it."""
    reduced = rnc.NonholonomicSystem(floating_panda().robot, ()).reduce()
    assert rnc.base_parameters(reduced).rank == 10 + 7 * 7


def test_unseen_changes_have_no_effect_and_the_rest_is_complete():
    reduced, draw = four_bar(), np.random.default_rng(1)
    base = rnc.base_parameters(reduced)
    assert base.rank + len(base.unseen) == base.matrix.shape[1]
    q = np.stack([reduced.random_configuration(draw) for _ in range(5)])
    Y = reduced.regressor(q, *draw.normal(size=(2, 5, reduced.r))).matrix.reshape(-1, base.matrix.shape[1])
    np.testing.assert_allclose(Y[:, base.columns] @ base.matrix, Y, atol=1e-6 * np.abs(Y).max())


def test_a_motion_of_one_joint_shows_less_than_the_robot(robot):
    reduced = rnc.NonholonomicSystem(robot, ()).reduce()
    draw = np.random.default_rng(0)
    v2, v2_dot = draw.normal(size=(2, 30, 4)) * np.eye(4)[3]
    seen = rnc.base_parameters(reduced.regressor(robot.configuration(), v2, v2_dot))
    assert seen.rank < rnc.base_parameters(reduced).rank
    assert rnc.base_parameters(reduced).condition < 100
