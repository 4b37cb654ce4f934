"""Configurations and velocities are admitted by shape, number and length."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.model.input_validation import admit_configurations, check_finite, check_positive_settings, vector
from simple_controllers import Memoryless
from systems import space_robot
from textbook_systems import sliders


def test_configurations_are_admitted_by_shape_number_and_length():
    flat, turning = sliders(), sliders("UXX")
    given = np.array([1.0, 2.0, 3.0])
    admitted = admit_configurations(given, flat)
    given[0] = 9.0
    assert (admitted.tolist(), admit_configurations(np.ones((2, 4, 3)), flat).shape) == ([1.0, 2.0, 3.0], (2, 4, 3))
    unit = np.array([0.6, 0.8, 5.0, 6.0])
    for q in (unit, np.stack([unit, unit])):
        rounded = q * [1 + 1e-9, 1 + 1e-9, 1, 1]
        np.testing.assert_array_equal(admit_configurations(rounded, turning), rounded)
    for wrong, words in (
        (1.0, r"q has shape \(\), expected \(..., 3\)"),
        (np.ones((3, 2)), r"q has shape \(3, 2\), expected \(..., 3\)"),
        ([1.0, np.inf, 0.0], r"q holds values that are not finite: \[ 1., inf,  ?0.\]"),
    ):
        with pytest.raises(rnc.InputError, match=words):
            admit_configurations(wrong, flat)
    two = np.zeros((2, 3, 3))
    two[1, 0, 2] = np.nan
    for call in (lambda: admit_configurations(two, flat), lambda: vector(two, 3, "q"), lambda: check_finite("q", two)):
        message = r"q holds values that are not finite at state 1, 0: \[ 0., +0., nan\]"
        with pytest.raises(rnc.InputError, match=message):
            call()
    with pytest.raises(rnc.InputError, match=r": \[ 0., 1., 2., 3., nan, 5., 6., 7., 8., 9.\]$"):
        check_finite("q", np.where(np.arange(10) == 4, np.nan, np.arange(10.0)))
    assert (vector([1, 2], 2, "v").tolist(), vector(np.ones((5, 2)), 2, "v").shape) == ([1.0, 2.0], (5, 2))
    for wrong in (1.0, np.ones((2, 3))):
        with pytest.raises(rnc.InputError, match=r"v has shape .*, expected \(..., 2\)"):
            vector(wrong, 2, "v")
    with pytest.raises(rnc.InputError, match=r"v holds values that are not finite: \[nan, +1.\]"):
        vector([np.nan, 1.0], 2, "v")


NO_NUMBERS = [lambda array, kind=kind: array.astype(kind) for kind in (complex, str, object, bool)]
NO_NUMBERS += [lambda array: np.ma.masked_array(array, mask=array == 0), lambda array: [str(each) for each in array]]


@pytest.mark.parametrize("made", NO_NUMBERS)
def test_states_and_times_are_real_numbers(made):
    reduced, idle = space_robot(), rnc.control.Command(T=np.zeros(3))
    q, v2, v, T = reduced.robot.configuration(), np.zeros(3), np.zeros(4), np.zeros(3)
    controller = Memoryless(lambda *_: idle)
    loop, t = rnc.ControlLoop(reduced, controller, dt=0.01), made(np.zeros(1))
    calls = [
        lambda: reduced.at(made(q)), lambda: reduced.at(q, made(v2)), lambda: reduced.at(q, v=made(v)),
        lambda: reduced.at(q, v2, t=t), lambda: reduced.at(q, t=True),
        lambda: reduced.assembled(made(q)), lambda: reduced.terms(made(q), v2),
        lambda: reduced.forward_dynamics(made(q), v2, T), lambda: reduced.forward_dynamics(q, v2, made(T)),
        lambda: reduced.forward_dynamics(q, v2, T, t=t), lambda: reduced.inverse_dynamics(q, v2, made(T)),
        lambda: rnc.state_derivatives(reduced, q, made(v2), T), lambda: reduced.at(q, v2).contact_forces(T, made(v)),
        lambda: rnc.simulate(reduced, controller, made(q), 0.1, 0.01),
        lambda: rnc.free_motion(reduced, made(q), v2, 1.0),
        lambda: rnc.linearize(reduced, made(q)), lambda: rnc.equilibrium(reduced, made(q)),
        lambda: rnc.planning.Hold(made(v2)), lambda: rnc.planning.MinimumJerk(v2, made(v2), 1.0),
        lambda: rnc.solve_ik(reduced, q, {rnc.FramePosition("tip", "xyz"): made(v2)}),
        lambda: rnc.planning.find_way(reduced, made(q), {rnc.FramePosition("tip", "xy"): [1.0, 0.0]}),
        lambda: rnc.free_motion(reduced, q, v2, 1.0, inputs=made(T)), lambda: rnc.ReducedPlant(reduced).apply(made(T)),
    ]  # fmt: skip
    for call in calls:
        with pytest.raises(rnc.InputError, match=r"^[\w' -]+ is not an array of numbers: ") as caught:
            call()
        assert len(str(caught.value).splitlines()) == 1
    for measured in ((0.0, made(q), v), (0.0, q, made(v)), (t, q, v)):
        loop.step(*measured)
        assert loop.state.fault is not None


def test_a_wrong_size_names_the_entries():
    reduced = space_robot()
    q = reduced.robot.configuration()
    with pytest.raises(rnc.InputError, match=r"^v2 has shape \(2,\), expected \(.*, 3\) for tip_x, tip_y, joint_1$"):
        reduced.terms(q, [0.1, 0.2])
    with pytest.raises(rnc.InputError, match=r"^T has shape \(1,\), .* for joint_1, joint_2, joint_3$"):
        reduced.forward_dynamics(q, np.zeros(3), [1.0])


def test_settings_are_positive_numbers_or_none():
    check_positive_settings(first=None, second=1e-300)
    for value, words in ((0.0, "0"), (-1, "-1"), (np.inf, "inf"), (np.nan, "nan"), ("1", "'1'"), (True, "1")):
        with pytest.raises(rnc.ConfigurationError, match=f"^last: expected a positive number, found {words}$"):
            check_positive_settings(first=2.0, last=value)
