"""Impacts without slip: conditions of the quadratic program, and a tall cart that is dropped and comes to rest."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, add_frame
from rnc_pin.plants.reduced.contact_modes import ContactImpacts
from rnc_pin.plants.reduced.unilateral_contact import BoundContact
from simple_controllers import Idle

G, MASS, RADIUS = 9.81, 5.0, 0.1
FEET = {
    "left": (0, 0.2), "right": (0, -0.2), "fl": (0.2, 0.1), "fr": (0.2, -0.1), "bl": (-0.2, 0.1), "br": (-0.2, -0.1),
}  # fmt: skip


@pytest.fixture(scope="module")
def cart():
    """A tall body with six feet."""
    model = pin.Model()
    joint = add_body(model, "root_joint", "FreeFlyer", MASS, moments=(0.5, 0.4, 0.2))
    for name, (x, y) in FEET.items():
        add_frame(model, name, joint, (x, y, -0.5))
    return rnc.NonholonomicSystem(rnc.Robot(model))


@pytest.fixture(scope="module")
def contacts():
    """One foot does not slip, two rebound."""
    held, *smooth = FEET
    rest = (rnc.UnilateralContact(rnc.Caster(name, RADIUS), 0.3 * (name == "right")) for name in smooth)
    return [rnc.UnilateralContact(rnc.RollingBall(held, RADIUS), 0.3), *rest]


def test_conditions_of_the_least_change(cart, contacts):
    """Impulses push, no contact slips or comes closer, and a rebound has the share e^2 of the compression's energy."""
    reduced, q = cart.reduce(), cart.robot.configuration({"root_joint": [0, 0, 0.5 + RADIUS, 0, 0, 0, 1]})
    bound, plastic = (
        [BoundContact(replace(each, restitution=e * each.restitution), cart.robot) for each in contacts] for e in (1, 0)
    )
    at = reduced.at(q).position
    heights = np.array([each.jacobian(at) for each in bound])
    slips = np.vstack([each.slip(at)[0] for each in bound])
    names = [name for each in bound for name in each.slip(at)[2]]
    M = pin.crba(cart.robot.model, cart.robot.model.createData(), q)
    M = np.triu(M) + np.triu(M, 1).T
    for seed in range(8):
        v = np.random.default_rng(seed).uniform(-1, 1, 6) - [0, 0, 2, 0, 0, 0]
        jumps = [ContactImpacts(reduced, q, v, dict(enumerate(each))).sticking() for each in (plastic, bound)]
        for jump in jumps:
            normal = np.array([jump.impulses[each.row] for each in bound])
            assert normal.min() >= 0.0
            assert (heights @ jump.v).min() > -1e-7
            np.testing.assert_allclose(slips @ jump.v, 0.0, atol=1e-12)
            tangential = [jump.impulses[name] for name in names]
            np.testing.assert_allclose(M @ (jump.v - v), heights.T @ normal + slips.T @ tangential, atol=1e-12)
            assert jump.loss == pytest.approx(0.5 * v @ M @ v - 0.5 * jump.v @ M @ jump.v)
        stopped = v - np.linalg.solve(M, slips.T) @ np.linalg.pinv(slips @ np.linalg.solve(M, slips.T)) @ slips @ v
        before, after = jumps[0].v - stopped, jumps[1].v - jumps[0].v
        compressed = np.array([jumps[0].impulses[each.row] for each in bound])
        np.testing.assert_allclose(compressed * (heights @ jumps[0].v), 0.0, atol=1e-10)
        assert after @ M @ after <= 0.3**2 * (before @ M @ before) * (1 + 1e-9)
        assert jumps[1].loss > 0.0
    pair = contacts[:2]
    fall = np.array([0, 0, -1.0, 0, 0, 0])
    both = rnc.impact(cart.with_constraints([each.constraint for each in pair]), q, fall, dict.fromkeys(
        (each.row for each in bound[:2]), 0.3))  # fmt: skip
    np.testing.assert_allclose(
        ContactImpacts(reduced, q, fall, dict(enumerate(bound[:2]))).sticking().v, both.v, atol=1e-12
    )


def test_a_cart_that_slides_into_its_contacts(cart, contacts):
    """The foot that does not slip stops at once, whichever feet push; the tall cart tips over the feet ahead."""
    plant = rnc.ContactPlant(cart, contacts)
    plant.reset(
        cart.robot.configuration({"root_joint": [0, 0, 0.5 + RADIUS, 0, 0, 0, 1]}), np.array([0.5, 0, 0, 0, 0, 0])
    )
    (start,) = plant.contact_events
    assert set(start.closed) == {"fl", "fr"}
    _, v = plant.read()
    pitch, yaw = v[4:]
    assert pitch > 0.1
    # Velocities of the contact points, 0.6 m below the centre: the left one does not slip, those ahead stay down.
    np.testing.assert_allclose([v[0] - 0.6 * pitch - 0.2 * yaw, v[1], v[3]], 0.0, atol=1e-12)
    assert v[2] == pytest.approx(0.2 * pitch)
    assert all(value > 0 for name, value in start.impulses.items() if name.startswith("vertical"))


def test_a_tall_cart_comes_to_rest_on_all_its_feet(cart, contacts):
    """It rocks on redundant contacts with different coefficients; at rest they share its weight."""
    q0 = cart.robot.configuration(
        {"root_joint": [0, 0, 0.75, *pin.Quaternion(pin.rpy.rpyToMatrix(0.1, 0.06, 0.2)).coeffs()]}
    )
    plant = rnc.ContactPlant(cart, contacts)
    run = rnc.simulate(cart.reduce(), Idle(0), q0, 1.5, 0.02, v2_0=[0.05, 0.1, 0, 0, 0, 0], plant=plant)
    assert run.info.phases[-1].name == " + ".join(FEET)
    np.testing.assert_allclose(run.v[-1, 2:5], 0.0, atol=1e-9)  # it may still turn about the foot that does not slip
    forces = run.normal_forces[-1]
    assert forces.min() >= -1e-9
    assert forces.sum() == pytest.approx(MASS * G)
    assert np.ptp(run.energy - run.work) < 1e-5 * run.energy[0]
