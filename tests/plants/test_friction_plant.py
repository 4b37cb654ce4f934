"""Contacts that stick and slide, against closed forms, ``ReducedPlant`` and ``Grip``."""

import copy
import pickle

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, free_body

G = 9.81


def energy(plant):
    q, v = plant.read()
    return float(plant.reduced.at(q, v=v).energy)


def world_velocity(plant, joint=1):
    """Linear velocity of the free base in the world."""
    q, v = plant.read()
    return pin.Quaternion(*q[[6, 3, 4, 5]]).matrix() @ v[:3]


def run(plant, duration, dt=0.01):
    """Advance, and return the largest increase of energy minus work."""
    start, most = energy(plant) - plant.work, 0.0
    for _ in range(round(duration / dt)):
        plant.advance(dt)
        most = max(most, abs(energy(plant) - plant.work - start))
    return most


def causes(plant):
    return [event.cause for event in plant.contact_events]


def pose(x=0.0, z=0.0, rotation=None):
    """Configuration of a free body at (x, 0, z)."""
    turned = [0, 0, 0, 1] if rotation is None else pin.Quaternion(rotation).coeffs()
    return np.r_[x, 0.0, z, turned]


def block(friction, half=(0.2, 0.15, 0.1), mass=2.0, ground=None, radius=0.01, **options):
    """A box on balls at its four lower corners, and its height above the ground at rest."""
    a, b, h = half
    corners = {f"c{i}": [a * (1 - 2 * (i & 1)), b * (1 - (i & 2)), -h] for i in range(4)}
    moments = mass / 3 * np.array([b * b + h * h, a * a + h * h, a * a + b * b])
    robot = free_body(mass, moments, **corners)
    contacts = [
        rnc.UnilateralContact(rnc.RollingBall(name, radius, ground), friction=friction, **options) for name in corners
    ]
    return rnc.FrictionPlant(rnc.NonholonomicSystem(robot), contacts), h + radius


@pytest.mark.parametrize("friction", [0.2, 0.45])
def test_block_on_a_slope(friction):
    """It stays below ``tan(slope) = mu``, and slides with ``g (sin - mu cos)`` above, also down from a push uphill."""
    slope = 0.35
    R = pin.rpy.rpyToMatrix(0.0, slope, 0.0)  # x points downhill
    plant, height = block(friction, ground=rnc.GroundPlane(normal=tuple(R[:, 2])))
    q = pose(rotation=R)
    q[:3] = R[:, 2] * height
    plant.reset(q, np.zeros(6))
    assert run(plant, 0.3) < 1e-9
    along = plant.read()[1][0]
    if friction > np.tan(slope):
        assert np.abs(plant.read()[1]).max() < 1e-9
        assert plant.sliding == ()
    else:
        assert along == pytest.approx(0.3 * G * (np.sin(slope) - friction * np.cos(slope)), rel=1e-8)
        assert set(plant.sliding) == {"c0", "c1", "c2", "c3"}
    assert sum(plant.normal_forces.values()) == pytest.approx(2.0 * G * np.cos(slope), rel=1e-8)
    plant.reset(q, np.array([-0.8, 0, 0, 0, 0, 0]))
    up = G * (np.sin(slope) + friction * np.cos(slope))
    run(plant, 0.3)
    if friction > np.tan(slope):
        grip = next(event for event in plant.contact_events if event.cause.startswith("grip"))
        assert grip.time == pytest.approx(0.8 / up, abs=1e-5)
        down = 0.0
    else:
        down = (0.3 - 0.8 / up) * G * (np.sin(slope) - friction * np.cos(slope))
    assert plant.read()[1][0] == pytest.approx(down, abs=1e-5)


def test_billiard_ball_from_sliding_to_rolling():
    """It rolls with 5/7 of its speed from ``t = 2 v / (7 mu g)`` on."""
    speed, friction, radius = 1.4, 0.25, 0.2
    robot = free_body(1.0, [0.4 * radius**2] * 3, ball=[0, 0, 0])
    contact = rnc.UnilateralContact(rnc.RollingBall("ball", radius), friction=friction)
    plant = rnc.FrictionPlant(rnc.NonholonomicSystem(robot), [contact], tolerance=1e-6)
    plant.reset(pose(z=radius), np.array([speed, 0, 0, 0, 0, 0]))
    time = 2 * speed / (7 * friction * G)
    assert run(plant, 0.2) < 1e-7
    assert causes(plant) == ["start", "slip of ball", "grip of ball"]
    assert plant.contact_events[-1].time == pytest.approx(time, abs=1e-5)
    assert plant.read()[1][4] == pytest.approx(5 / 7 * speed / radius, rel=1e-8)
    slid = speed * time - friction * G * time**2 / 2
    assert plant.read()[0][0] == pytest.approx(slid + 5 / 7 * speed * (0.2 - time), abs=1e-6)


def test_moments_against_rolling_and_spin():
    """``a = 5/7 c g / r`` until the ball rests, and ``5/2 c g / r^2`` of a ball that spins in place."""
    radius, rolling, spinning = 0.1, 0.004, 0.001
    robot = free_body(1.0, [0.4 * radius**2] * 3, ball=[0, 0, 0])
    contact = rnc.UnilateralContact(
        rnc.RollingBall("ball", radius), friction=0.5, rolling_friction=rolling, spin_friction=spinning
    )
    plant = rnc.FrictionPlant(rnc.NonholonomicSystem(robot), [contact], tolerance=1e-6)
    plant.reset(pose(z=radius), np.array([0.04, 0, 0, 0, 0.4, 0]))
    assert run(plant, 0.2) < 1e-7
    assert plant.read()[0][0] == pytest.approx(0.04**2 / (2 * 5 / 7 * rolling * G / radius), abs=1e-6)
    assert np.abs(plant.read()[1]).max() < 1e-9
    plant.reset(pose(z=radius), np.array([0, 0, 0, 0, 0, 2.0]))
    run(plant, 0.05)
    assert plant.read()[1][5] == pytest.approx(2.0 - 0.05 * 2.5 * spinning * G / radius**2, rel=1e-7)


@pytest.mark.parametrize("friction", [0.1, 0.9])
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_disk_that_lands_with_spin(friction, e):
    """The impulse along the ground is ``mu m (1 + e) u``, or what stops slip if this is less."""
    robot = rnc.Robot.from_urdf("rolling_disk.urdf", base="free")
    radius, height, spin = 0.25, 0.1, 8.0
    contact = rnc.UnilateralContact(rnc.RollingWheel("disk", radius, axis="y"), e, friction=friction)
    plant = rnc.FrictionPlant(rnc.NonholonomicSystem(robot), [contact], tolerance=1e-6)
    plant.reset(pose(z=radius + height), np.array([0, 0, 0, 0, spin, 0]))
    fall, down = np.sqrt(2 * height / G), np.sqrt(2 * G * height)
    plant.advance(fall + 1e-6)
    landing = plant.contact_events[1]
    assert (landing.cause, landing.time) == ("landing of disk", pytest.approx(fall, rel=1e-8))
    speed = min(friction * (1 + e) * down, radius * spin / 3)
    assert landing.impulses["vertical(disk)"] == pytest.approx(2.0 * (1 + e) * down, rel=1e-6)
    assert landing.impulses["rolling(disk)"] == pytest.approx(2.0 * speed, rel=1e-6)
    turned = spin - 2 * speed / radius
    lost = down**2 * (1 - e**2) + 0.03125 * (spin**2 - turned**2) - speed**2
    assert landing.energy_loss == pytest.approx(lost, rel=1e-6)


def car(friction, brake=0.0, driven=()):
    """A car of 20 kg on four wheels: half length 0.5 m, centre of mass 0.4 m above the ground."""
    model = pin.Model()
    base = add_body(model, "root_joint", "FreeFlyer", 16.0, moments=[0.5, 1.0, 1.2])
    for x, end in ((0.5, "front"), (-0.5, "rear")):
        for y, side in ((0.3, "left"), (-0.3, "right")):
            name = f"{end}_{side}"
            add_body(model, name, "RY", 1.0, base, moments=[0.005, 0.01, 0.005], at=(x, y, -0.3), frame=name + "_wheel")
    limits = model.upperDryFrictionLimit
    limits[6:] = brake
    model.upperDryFrictionLimit = limits
    model.lowerDryFrictionLimit = -limits
    robot = rnc.Robot(model)
    contacts = [
        rnc.UnilateralContact(rnc.RollingWheel(name + "_wheel", 0.1, axis="y"), friction=friction)
        for name in model.names[2:]
    ]
    system = rnc.NonholonomicSystem(robot, [], list(driven))
    return rnc.FrictionPlant(system, contacts, joint_friction=brake > 0, tolerance=1e-6)


def test_braking_car():
    """``v^2 / (2 mu g)`` with locked wheels, ``v^2 M r / (8 T)`` with ``M = m + 4 I / r^2`` below their limit."""
    speed, friction = 1.5, 0.4
    v = np.r_[speed, np.zeros(5), np.full(4, speed / 0.1)]
    for brake, distance in ((50.0, None), (1.0, speed**2 / 2 * (20 + 4 * 0.01 / 0.01) * 0.1 / 4)):
        plant = car(friction, brake)
        plant.reset(np.r_[pose(z=0.4), np.zeros(4)], v)
        assert run(plant, 0.75, 0.05) < 1e-6
        if distance is None:  # the wheels lock at once, by an impulse of friction at the ground
            lock = 4 * 0.01 * speed / 0.1 / 0.1 / 20
            assert lock > 0
            assert set(plant.contact_events[1].closed) == set(plant.normal_forces)
            distance = speed**2 / (2 * friction * G)
            assert plant.read()[0][0] == pytest.approx(distance, rel=0.02)
        else:
            assert plant.read()[0][0] == pytest.approx(distance, rel=1e-5)
            assert "slip" not in " ".join(causes(plant))
        assert np.abs(plant.read()[1]).max() < 1e-7
