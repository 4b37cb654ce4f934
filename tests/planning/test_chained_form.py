"""Chained form (22): the maps undo each other, and the truck of the URDF moves as the chain says."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.planning import FireTruckChart
from systems import fire_truck
from tolerances import FINITE_DIFFERENCE, ROUNDING


def random_state(generator):
    x, y, theta1, phi1, hitch, phi2 = generator.uniform(-0.9, 0.9, 6)
    return np.array([x, y, theta1, phi1, theta1 + hitch, phi2])


def rates(chain, v):
    _, x0, x1, _, y0, _ = chain
    return np.array([v[0], v[1], x0 * v[0], x1 * v[0], v[2], y0 * v[0]])


@pytest.mark.parametrize("lengths", [(1.0, 1.0), (1.4, 2.3)])
def test_maps_undo_each_other(lengths):
    chart, generator = FireTruckChart(*lengths), np.random.default_rng(0)
    for _ in range(20):
        state = random_state(generator)
        np.testing.assert_allclose(chart.from_chain(chart.to_chain(state)), state, atol=ROUNDING)


def test_the_truck_of_the_urdf_is_the_chain():
    """Independent of the formulas' proof: rates of the reduced model's own outputs, by central differences."""
    chart, generator, reduced, h = FireTruckChart(), np.random.default_rng(1), fire_truck(), 1e-6
    robot = reduced.robot

    def state_of(q):
        heading = np.arctan2(q[3], q[2])
        return np.array([q[0], q[1], heading, q[4], heading + q[5], q[6]])

    order = [name for name in robot.joint_names if name != "root_joint"]
    assert order == ["front_steering", "hitch", "rear_steering"]
    for _ in range(10):
        x, y, theta1, phi1, theta2, phi2 = random_state(generator)
        q = robot.configuration(
            {"root_joint": (x, y, theta1), "front_steering": phi1, "hitch": theta2 - theta1, "rear_steering": phi2}
        )
        state, v = state_of(q), generator.normal(size=3)
        velocity = reduced.terms(q, chart.to_inputs(state, v)).v
        moved = (pin.integrate(robot.model, q, sign * h * velocity) for sign in (1, -1))
        ahead, behind = (chart.to_chain(state_of(each)) for each in moved)
        expected = rates(chart.to_chain(state), v)
        tolerance = FINITE_DIFFERENCE * (1 + np.abs(expected).max())
        np.testing.assert_allclose((ahead - behind) / (2 * h), expected, atol=tolerance)


def test_the_inputs_of_a_truck_of_any_lengths_give_the_chain_its_rates():
    chart, generator, h = FireTruckChart(1.4, 2.3), np.random.default_rng(1), 1e-6
    assert FireTruckChart() == FireTruckChart(1.0, 1.0)
    for _ in range(10):
        x, y, theta1, phi1, hitch, phi2 = generator.uniform(-0.9, 0.9, 6)
        state, v = np.array([x, y, theta1, phi1, theta1 + hitch, phi2]), generator.normal(size=3)
        u, *steered = chart.to_inputs(state, v)
        tractor = u * np.array([np.cos(theta1), np.sin(theta1), np.tan(phi1) / 1.4])
        trailer = -u * np.sin(hitch + phi2) / (2.3 * np.cos(phi2))  # its axle slips not, and is steered by phi2
        rate = np.array([*tractor, steered[0], trailer, steered[1]])
        _, x0, x1, _, y0, _ = chart.to_chain(state)
        expected = [v[0], v[1], x0 * v[0], x1 * v[0], v[2], y0 * v[0]]
        found = (chart.to_chain(state + h * rate) - chart.to_chain(state - h * rate)) / (2 * h)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("moved", [(2, 4), (3,), (4,), (5,)])  # heading with hitch zero, steering, hitch, trailer's
def test_each_angle_of_the_truck_stays_within_90_degrees(moved, sign):
    for degrees in (89.0, 90.0, 91.0):
        state = np.zeros(6)
        state[list(moved)] = sign * np.deg2rad(degrees)
        if degrees < 90:
            np.testing.assert_allclose(FireTruckChart().from_chain(FireTruckChart().to_chain(state)), state, atol=1e-9)
            continue
        words = "^a heading, steering or hitch angle is not within 90 degrees: outside the chained form$"
        with pytest.raises(rnc.InputError, match=words):
            FireTruckChart().to_chain(state)
