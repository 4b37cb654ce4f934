"""Privileged coordinates: hand-derived ones, orders along flows, symbolic derivatives, and what is refused."""

from itertools import pairwise, product

import numpy as np
import pinocchio as pin
import pytest
import sympy as sp

import rnc_pin as rnc
from bodies import add_body, add_frame
from rnc_pin.analysis import growth_vector, privileged_coordinates
from rnc_pin.model.integrators import LieRungeKutta4
from systems import ackermann_car, fire_truck, mecanum, spinning_space_robot
from textbook_systems import planar_model, unicycle_with_trailers

EXACT = 1e-10


def shape_of(coordinates, q):
    """Center, coordinates of a planar base about it in its own axes, and differences of the joints."""
    center, q = coordinates.q, np.asarray(q)
    c, s = center[2:4]
    x, y = np.array([[c, s], [-s, c]]) @ (q[:2] - center[:2])
    yaw = np.arctan2(q[3] * c - q[2] * s, q[2] * c + q[3] * s)
    return x, y, yaw, *(q[4:] - center[4:])


def near(reduced, q, generator, size=0.7):
    return pin.integrate(reduced.robot.model, q, generator.uniform(-size, size, reduced.n))


def car(length=0.8):
    """The front axle steers as one wheel."""
    model, base = planar_model("car")
    add_frame(model, "rear", base, (0.0, 0.0, 0.0))
    add_body(model, "steer", "RZ", 1.0, base, moments=0.1, at=(length, 0.0, 0.0), frame="front")
    edges = [rnc.NoSideSlip("rear"), rnc.NoSideSlip("front")]
    return rnc.NonholonomicSystem(rnc.Robot(model), edges).reduce([rnc.FrameSpeed("rear"), rnc.JointPosition("steer")])


@pytest.mark.parametrize("steering", [0.0, 0.4, -0.6])
def test_car(steering):
    """On a circle of curvature k = tan(steering) / L: (x, steer, yaw - k x, y - k x^2 / 2) of weights 1, 1, 2, 3."""
    reduced, generator = car(), np.random.default_rng(1)
    q = reduced.robot.configuration({"root_joint": [1.0, 2.0, -0.7], "steer": steering})
    coordinates, k = privileged_coordinates(reduced, q), np.tan(steering) / 0.8
    assert coordinates.weights == (1, 1, 2, 3)
    for _ in range(5):
        there = near(reduced, q, generator)
        x, y, yaw, steer = shape_of(coordinates, there)
        # The pivots of the first two are x and the steering angle; the yaw is larger than x where k is small.
        expected = [x, steer, yaw - k * x, y - k * x**2 / 2]
        np.testing.assert_allclose(coordinates.values(there), expected, atol=EXACT)


@pytest.mark.parametrize("angle", [0.4, 1.1, 2.0])
def test_one_trailer(angle):
    """The fields (cos t, sin t, 0, -sin a), (0, 0, 1, -1) and their bracket -(0, 1, 0, cos a) at a hitch angle a.

    They annihilate ``l = sin(a) x - cos(a) y + t + da``, and ``X1 X1 l = sin(a) cos(a)`` needs x^2.
    """
    reduced, generator = unicycle_with_trailers(1), np.random.default_rng(3)
    coordinates = privileged_coordinates(reduced, reduced.robot.configuration({"hitch_1": angle}))
    assert coordinates.weights == (1, 1, 2, 3)
    s, c = np.sin(angle), np.cos(angle)
    for _ in range(5):
        there = near(reduced, coordinates.q, generator)
        x, y, yaw, hitch = shape_of(coordinates, there)
        expected = [x, hitch, y, s * x - c * y + yaw + hitch - s * c * x**2 / 2]
        np.testing.assert_allclose(coordinates.values(there), expected, atol=EXACT)


def trailers_fields(count, q):
    """Fields of a unicycle with trailers, symbolically, in coordinates (x, y, yaw, hitches); lengths 1."""
    _, _, yaw, *hitches = symbols = sp.symbols(f"x y t a1:{count + 1}")
    angle, speed = yaw, sp.Integer(1)
    rates, headings = [sp.Integer(0)], [yaw]
    for hitch in hitches:
        angle, turn = angle + hitch, -speed * sp.sin(hitch)
        speed = speed * sp.cos(hitch)
        rates.append(turn)
        headings.append(angle)
    forward = [sp.cos(yaw), sp.sin(yaw), 0, *(b - a for a, b in pairwise(rates))]
    turning = [0, 0, 1, *([-1] if count else []), *[0] * (count - 1)]
    return symbols, [forward, turning]


@pytest.mark.parametrize("hitches", [(0.5,), (0.5, -0.3), (0.0, 0.0), (np.pi / 2,)])
def test_words_shorter_than_the_weight_vanish(hitches):
    """The definition itself, for symbolic fields: all derivatives along fewer than w_j fields are zero at q."""
    reduced = unicycle_with_trailers(len(hitches))
    names = {f"hitch_{k + 1}": value for k, value in enumerate(hitches)}
    coordinates = privileged_coordinates(reduced, reduced.robot.configuration(names))
    bound = max(EXACT, 24.0 * coordinates.error)  # derivatives multiply coefficients by factorials up to that of four
    symbols, fields = trailers_fields(len(hitches), hitches)
    center = [0.0, 0.0, 0.0, *hitches]
    shape = [symbol - value for symbol, value in zip(symbols, center, strict=True)]
    z = []
    for linear, polynomial in zip(coordinates.linear, coordinates.polynomials, strict=True):
        terms = [c * sp.prod([z[i] ** p for i, p in enumerate(powers) if p]) for powers, c in polynomial.items()]
        z.append(sum(float(a) * b for a, b in zip(linear, shape, strict=True)) + sum(terms))
    for f, weight in zip(z, coordinates.weights, strict=True):
        words = [f]
        at = dict(zip(symbols, center, strict=True))
        for length in range(1, weight + 1):
            words = [sum(a * sp.diff(g, s) for a, s in zip(X, symbols, strict=True)) for X, g in product(fields, words)]
            size = max(abs(float(word.subs(at))) if word else 0.0 for word in map(sp.sympify, words))
            assert size < bound if length < weight else size > 1e-3


def satellite_with_rotors():
    """Attitude by two rotors; the centre of mass stays: 5 of 8 dimensions."""
    model = pin.Model()
    body = add_body(model, "root_joint", "FreeFlyer", 8.0, moments=(0.9, 1.1, 1.3))
    for name, kind, place in (("roll", "RX", (0.2, 0.1, 0.0)), ("pitch", "RY", (0, -0.1, 0))):
        add_body(model, name, kind, 0.5, body, moments=0.1, at=place)
    model.gravity.linear = np.zeros(3)
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.MomentumConservation("root_joint")])
    return system.reduce([rnc.JointPosition("roll"), rnc.JointPosition("pitch")])


def wheeled_car():
    """Wheels that roll, with angles that do not matter."""
    reduced = ackermann_car()
    return reduced, reduced.assembled(reduced.robot.configuration()), ("bl_spin", "br_spin", "fl_spin", "fr_spin")


SYSTEMS = {
    "satellite with two rotors": lambda: (satellite_with_rotors(), None, ()),
    "fire truck": lambda: (fire_truck(), {"hitch": 0.3, "front_steering": 0.2, "rear_steering": -0.4}, ()),
    "two trailers at a right angle": lambda: (unicycle_with_trailers(2), {"hitch_1": np.pi / 2, "hitch_2": 0.2}, ()),
    "car with wheels": wheeled_car,
    "mecanum": lambda: (mecanum(), None, ("fl_spin", "fr_spin", "bl_spin", "br_spin")),
}
WEIGHTS = {
    "satellite with two rotors": (1, 1, 2, 3, 3),
    "two trailers at a right angle": (1, 1, 2, 3, 5),
    "car with wheels": (1, 1, 2, 3),
    "mecanum": (1, 1, 1),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_coordinates_have_the_order_of_their_weight_along_flows(name):
    """Of the size t^w after motions over t: the slope of logarithms, with an integrator that knows no brackets."""
    reduced, start, ignored = SYSTEMS[name]()
    q = start if isinstance(start, np.ndarray) else reduced.robot.configuration(start or {})
    coordinates = privileged_coordinates(reduced, q, ignored=ignored)
    if not ignored:
        vector = growth_vector(reduced, q)
        counted = [sum(w <= s for w in coordinates.weights) for s in range(1, max(coordinates.weights) + 1)]
        assert tuple(counted) == coordinates.growth_vector == vector
    assert WEIGHTS.get(name, coordinates.weights) == coordinates.weights
    integrator, generator = LieRungeKutta4(reduced.robot), np.random.default_rng(5)
    pieces, steps = 4, 3  # an error of the fourth order is small beside the sizes
    scale = 1.0 / np.abs(coordinates.linear[np.array(coordinates.weights) == 1] @ reduced.at(q).R).max()
    inputs = scale * generator.normal(size=(12, pieces, reduced.r)) / pieces
    times, sizes = np.array([0.04, 0.02]), []
    for time in times:
        ends = []
        for each in inputs:
            now = q
            for u in each:
                flow = lambda at, y, u=u: (reduced.at(at).R @ u, y)  # noqa: E731
                for _ in range(steps):
                    now, _ = integrator.step(flow, now, y=np.zeros(0), h=time / steps)
            ends.append(now)
        sizes.append(np.abs(coordinates.values(np.array(ends))).max(axis=0))
    slopes = np.log(sizes[0] / sizes[1]) / np.log(times[0] / times[1])
    np.testing.assert_allclose(slopes, coordinates.weights, atol=0.25)


@pytest.mark.parametrize("name", ["satellite with two rotors", "fire truck"])
def test_jacobian_is_the_derivative(name):
    reduced, start, _ = SYSTEMS[name]()
    q = reduced.robot.configuration(start or {})
    coordinates = privileged_coordinates(reduced, q)
    generator, h = np.random.default_rng(6), 1e-6
    for _ in range(3):
        there, v = near(reduced, q, generator), generator.normal(size=reduced.n)
        ahead, behind = (coordinates.values(pin.integrate(reduced.robot.model, there, s * h * v)) for s in (1, -1))
        np.testing.assert_allclose(coordinates.jacobian(there) @ v, (ahead - behind) / (2 * h), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize(("make", "ignored", "words"), [
    (spinning_space_robot, [], r"affine.*momentum"),
    (car, ["steer"], "depend on the position of steer"),
    (car, ["stear"], "did you mean 'steer'"),
])  # fmt: skip
def test_what_has_no_coordinates_is_refused(make, ignored, words):
    reduced = make()
    with pytest.raises(rnc.RncError, match=words):
        privileged_coordinates(reduced, reduced.robot.configuration(), ignored=ignored)


def test_wrong_shapes_are_refused():
    reduced = car()
    q = reduced.robot.configuration()
    with pytest.raises(rnc.InputError, match="one configuration"):
        privileged_coordinates(reduced, np.tile(q, (2, 1)))
    with pytest.raises(rnc.InputError, match="finite configurations"):
        privileged_coordinates(reduced, q).values(np.zeros(3))
