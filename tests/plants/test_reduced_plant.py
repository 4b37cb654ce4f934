"""Arrays that a user gives a plant: any numbers are read as numbers, copied, and refused if they do not fit."""

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from refusals import refused


def started(**options):
    plant = rnc.ReducedPlant(systems.sleigh(), **options)
    plant.reset(plant.reduced.robot.configuration(), np.zeros(3))
    return plant


@pytest.mark.parametrize("limits", [False, True])
@pytest.mark.parametrize(
    "given", [np.array([1, 2]), [1, 2], np.array([1.0, 2.0], ">f4"), np.array([[1.0, 9.0], [2.0, 9.0]])[:, 0]]
)
def test_numbers_of_any_type_move_the_plant_alike(given, limits):
    ends = []
    for T in (np.array([1.0, 2.0]), given):
        plant = started(actuator_limits=limits)
        plant.apply(T)
        plant.advance(0.02)
        ends.append(np.concatenate(plant.read()))
    assert np.abs(ends[0]).max() > 1e-3
    np.testing.assert_array_equal(*ends)


def test_later_changes_of_given_arrays_have_no_effect():
    plant = rnc.ReducedPlant(systems.sleigh())
    q0, v0, T = plant.reduced.robot.configuration(), np.array([0.5, 0.0, 0.0]), np.array([1.0, 2.0])
    plant.reset(q0, v0)
    plant.apply(T)
    q0[0], v0[0], T[:] = 77.0, 77.0, 1000.0
    assert (plant.read()[0][0], plant.applied.tolist()) == (0.0, [1.0, 2.0])


test_what_does_not_fit_is_refused_in_one_line = refused([
    (lambda plant: plant.apply([1.0]), r"T has shape \(1,\), expected"),
    (lambda plant: plant.apply([[1.0, 2.0]]), r"T has shape \(1, 2\), expected \(2,\)"),
    (lambda plant: plant.apply([np.nan, 1.0]), "T holds values that are not finite"),
    (lambda plant: plant.reset([1.0], np.zeros(3)), "q has shape"),
    (lambda plant: plant.reset([0.0, 0.0, 0.0, 0.0], np.zeros(3)), "not of unit length"),
    (lambda plant: plant.reset([0.0, 0.0, 1.0, 0.0], [0.0, np.nan, 0.0]), "v holds values that are not finite"),
    (lambda plant: plant.reset(np.tile([0.0, 0.0, 1.0, 0.0], (2, 1)), np.zeros((2, 3))), "expected one state"),
    (lambda plant: plant.advance(0.0), "dt has to be a positive number, found 0.0"),
    (lambda plant: rnc.ReducedPlant(plant.reduced).read(), r"no state yet: call reset\(q, v\)"),
], lambda use: use(started()), rnc.InputError)  # fmt: skip
