"""Configurations and velocities are admitted by shape, number and length."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.model.input_validation import ConfigurationValidator, check_finite, check_positive_settings, vector
from systems import space_robot
from textbook_systems import sliders


def test_configurations_are_admitted_by_shape_number_and_length():
    flat, turning = ConfigurationValidator(sliders()), ConfigurationValidator(sliders("UXX"))
    given = np.array([1.0, 2.0, 3.0])
    admitted = flat.validate(given)
    given[0] = 9.0
    assert admitted.tolist() == [1.0, 2.0, 3.0]
    assert flat.validate(np.ones((2, 4, 3))).shape == (2, 4, 3)
    unit = np.array([0.6, 0.8, 5.0, 6.0])
    for q in (unit, np.stack([unit, unit])):
        np.testing.assert_array_equal(turning.validate(q * [1 + 1e-9, 1 + 1e-9, 1, 1]), q * [1 + 1e-9, 1 + 1e-9, 1, 1])
    for wrong, words in (
        (1.0, r"q has shape \(\), expected \(..., 3\)"),
        (np.ones((3, 2)), r"q has shape \(3, 2\), expected \(..., 3\)"),
        ([1.0, np.inf, 0.0], r"q holds values that are not finite: \[ 1., inf,  ?0.\]"),
    ):
        with pytest.raises(rnc.InputError, match=words):
            flat.validate(wrong)
    batch = np.zeros((2, 3, 3))
    batch[1, 0, 2] = np.nan
    for call in (lambda: flat.validate(batch), lambda: vector(batch, 3, "q"), lambda: check_finite("q", batch)):
        message = r"q holds values that are not finite at state 1, 0: \[ 0., +0., nan\]"
        with pytest.raises(rnc.InputError, match=message):
            call()
    with pytest.raises(rnc.InputError, match=r": \[ 0., 1., 2., 3., nan, 5., 6., 7., 8., 9.\]$"):
        check_finite("q", np.where(np.arange(10) == 4, np.nan, np.arange(10.0)))
    assert vector([1, 2], 2, "v").tolist() == [1.0, 2.0]
    assert vector(np.ones((5, 2)), 2, "v").shape == (5, 2)
    for wrong in (1.0, np.ones((2, 3))):
        with pytest.raises(rnc.InputError, match=r"v has shape .*, expected \(..., 2\)"):
            vector(wrong, 2, "v")
    with pytest.raises(rnc.InputError, match=r"v holds values that are not finite: \[nan, +1.\]"):
        vector([np.nan, 1.0], 2, "v")


@pytest.mark.parametrize("kinds", ["U", "XU", "UU"])
def test_angles_without_end_are_of_unit_length_to_a_millionth(kinds):
    validator = ConfigurationValidator(sliders(kinds))
    unit = np.concatenate([[0.6, -0.8] if kind == "U" else [7.0] for kind in kinds])
    for off, good in ((0.95e-6, True), (-0.95e-6, True), (1.05e-6, False), (-1.05e-6, False)):
        q = unit * np.where(np.arange(len(unit)) >= len(unit) - 2, 1 + off, 1.0)
        for given in (q, np.stack([unit, q]), np.stack([[q, unit], [unit, unit]])):
            if good:
                np.testing.assert_array_equal(validator.validate(given), given)
            else:
                words = r"^q holds a \(cos, sin\) pair or a quaternion that is not of"
                with pytest.raises(rnc.InputError, match=words):
                    validator.validate(given)


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
