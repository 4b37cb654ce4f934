"""Contacts that stick and slide, against closed forms, ``ReducedPlant`` and ``Grip``."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, free_body

G = 9.81


def energy(plant):
    q, v = plant.read()
    return float(plant.reduced.at(q, v=v).energy)


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
    turned = [0, 0, 0, 1] if rotation is None else pin.Quaternion(rotation).coeffs()
    return np.r_[x, 0.0, z, turned]


def block(friction, half=(0.2, 0.15, 0.1), mass=2.0, ground=None, radius=0.01, tolerance=1e-7, **options):
    """A box on balls at its four lower corners, and its height above the ground at rest."""
    a, b, h = half
    corners = {f"c{i}": [a * (1 - 2 * (i & 1)), b * (1 - (i & 2)), -h] for i in range(4)}
    moments = mass / 3 * np.array([b * b + h * h, a * a + h * h, a * a + b * b])
    robot = free_body(mass, moments, **corners)
    feet = (rnc.RollingBall(name, radius, ground) for name in corners)
    contacts = [rnc.UnilateralContact(foot, friction=friction, **options) for foot in feet]
    return rnc.ContactPlant(rnc.NonholonomicSystem(robot), contacts, tolerance=tolerance), h + radius


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
    uphill = -sum(force for name, force in plant.contact_forces.items() if name.startswith("rolling_x"))
    held = min(np.sin(slope), friction * np.cos(slope))
    assert abs(uphill) == pytest.approx(2.0 * G * held, rel=1e-8)
    assert plant.errors.rate <= plant.tolerance
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


def test_runs_record_the_forces_of_contacts_also_of_open_ones(tmp_path):
    """A ball falls by 5 mm, slides with ``mu m g``, and rolls without friction; its impact has friction too."""
    mass, radius, friction = 2.0, 0.2, 0.3
    robot = free_body(mass, [0.4 * mass * radius**2] * 3, ball=[0, 0, 0])
    contact = rnc.UnilateralContact(rnc.RollingBall("ball", radius), friction=friction)
    system = rnc.NonholonomicSystem(robot)
    reduced = system.reduce()
    plant = rnc.plants.FaultyPlant(rnc.ContactPlant(system, [contact]), rnc.Faults(), reduced)
    start = {"v2_0": np.array([1.0, 0, 0, 0, 0, 0]), "plant": plant, "dt": 0.01}
    idle = rnc.control.ZeroInput(reduced)
    rnc.simulate(reduced, idle, pose(z=radius + 0.005), 0.5, **start).save(tmp_path / "run.npz")
    run = rnc.Trajectory.load(tmp_path / "run.npz")
    names, landing = run.info.outputs, np.sqrt(2 * 0.005 / G)
    rolls = 2.0 / (7 * friction * G)  # as without the fall: its impact takes as much slip as sliding in that time
    flies, slides, done = run.time < landing, (run.time > landing + 0.02) & (run.time < rolls), run.time > rolls + 0.02
    normal, along = run.normal_forces[:, 0], run.contact_forces[:, 1:3]
    assert (names.normal_forces.names, names.contact_forces.units) == (("ball",), ("N",) * 3)
    assert (normal[flies] == 0.0).all()
    assert (run.contact_forces[flies] == 0.0).all()
    assert normal[slides | done] == pytest.approx(mass * G, rel=1e-6)
    assert np.linalg.norm(along[slides], axis=1) == pytest.approx(friction * mass * G, rel=1e-6)
    assert np.abs(along[done]).max() < 1e-4 * mass * G  # of the Euler steps, without extrapolation


def test_billiard_ball_from_sliding_to_rolling():
    """It rolls with 5/7 of its speed from ``t = 2 v / (7 mu g)`` on."""
    speed, friction, radius = 1.4, 0.25, 0.2
    robot = free_body(1.0, [0.4 * radius**2] * 3, ball=[0, 0, 0])
    contact = rnc.UnilateralContact(rnc.RollingBall("ball", radius), friction=friction)
    plant = rnc.ContactPlant(rnc.NonholonomicSystem(robot), [contact], tolerance=1e-6)
    plant.reset(pose(z=radius), np.array([speed, 0, 0, 0, 0, 0]))
    time = 2 * speed / (7 * friction * G)
    assert run(plant, 0.2) < 1e-7
    assert causes(plant) == ["start", "slip of ball", "grip of ball"]
    assert plant.contact_events[-1].time == pytest.approx(time, abs=1e-5)
    assert plant.read()[1][4] == pytest.approx(5 / 7 * speed / radius, rel=1e-8)
    slid = speed * time - friction * G * time**2 / 2
    missed = abs(plant.read()[0][0] - slid - 5 / 7 * speed * (0.2 - time))
    assert missed < 1e-6
    assert missed < plant.errors.total < 1e-5  # the estimate covers the event


@pytest.mark.parametrize("friction", [0.1, 0.9])
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_disk_that_lands_with_spin(friction, e):
    """The impulse along the ground is ``mu m (1 + e) u``, or what stops slip if this is less."""
    robot = rnc.Robot.from_urdf("rolling_disk.urdf", base="free")
    radius, height, spin = 0.25, 0.1, 8.0
    contact = rnc.UnilateralContact(rnc.RollingWheel("disk", radius, axis="y"), e, friction=friction)
    plant = rnc.ContactPlant(rnc.NonholonomicSystem(robot), [contact], tolerance=1e-8)
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


def car(friction, brake):
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
    wheels = (rnc.RollingWheel(f"{name}_wheel", 0.1, axis="y") for name in model.names[2:])
    contacts = [rnc.UnilateralContact(wheel, friction=friction) for wheel in wheels]
    return rnc.ContactPlant(rnc.NonholonomicSystem(robot), contacts, joint_friction=True, tolerance=1e-6)


@pytest.mark.parametrize("brake", [50.0, 1.0])
def test_braking_car(brake):
    """``v^2 / (2 mu g)`` with locked wheels, ``v^2 M r / (8 T)`` with ``M = m + 4 I / r^2`` if they roll."""
    speed, friction, locks = 1.2, 0.4, brake > 10
    plant = car(friction, brake)
    plant.reset(np.r_[pose(z=0.4), np.zeros(4)], np.r_[speed, np.zeros(5), np.full(4, 0.0 if locks else speed / 0.1)])
    assert run(plant, 0.8, 0.05) < 1e-6
    rolling = speed**2 / 2 * (20 + 4 * 0.01 / 0.1**2) * 0.1 / (4 * brake)
    distance = speed**2 / (2 * friction * G) if locks else rolling
    assert (plant.read()[0][0], "slip" in " ".join(causes(plant))) == (pytest.approx(distance, rel=1e-5), locks)
    assert np.abs(plant.read()[1]).max() < 1e-7


@pytest.mark.parametrize(("friction", "spin"), [(2.0, 2.4), (2.0, 2.8), (0.3, 1.8)])
def test_block_on_a_turntable_tips_or_slides(friction, spin):
    """At a distance R it slides if ``w^2 R > mu g``, and tips over its outer edge if ``w^2 R h > g a`` before that."""
    half, distance = (0.1, 0.15, 0.15), 1.0
    plant, height = block(friction, half, ground=rnc.GroundPlane(spin=spin), radius=1e-4, tolerance=1e-5)
    plant.reset(pose(distance, height), np.array([0, spin * distance, 0, 0, 0, spin]))
    plant.advance(0.01)
    plant.advance(0.01)
    tips, slides = spin**2 * distance * height > G * half[0], spin**2 * distance > friction * G
    assert ("lift-off" in " ".join(causes(plant))) == (tips and not slides)
    assert ("slip" in " ".join(causes(plant))) == slides


def test_rod_of_painleve():
    """A rod that slides where rigid friction has no force: it goes on, and no energy appears."""
    mass, half, angle, friction = 1.0, 0.5, 1.0, 3.0
    robot = free_body(mass, [1e-3, mass * half**2 / 3, mass * half**2 / 3], tip=[half, 0, 0])
    contact = rnc.UnilateralContact(rnc.RollingBall("tip", 1e-4), friction=friction)
    plant = rnc.ContactPlant(rnc.NonholonomicSystem(robot), [contact], tolerance=1e-4)
    # The normal acceleration per normal force is negative for slip towards -x: Genot and Brogliato 1999.
    sin, cos = np.sin(angle), np.cos(angle)
    inverse = (1 + 3 * cos * (cos - friction * sin)) / mass
    assert inverse < 0.0
    for turning in (-1.0, 0.0, 1.0):
        for direction in (-1.0, 1.0):
            R = pin.rpy.rpyToMatrix(0.0, angle, 0.0)
            slip = np.array([3.0 * direction, 0.0, 0.0])  # of the tip, which does not leave the ground
            w = np.array([0.0, turning, 0.0])
            center = slip - np.cross(w, np.array([half * cos, 0.0, -half * sin - 1e-4]))
            plant.reset(pose(z=half * sin + 1e-4, rotation=R), np.r_[R.T @ center, R.T @ w])
            before = energy(plant)
            for _ in range(10):
                plant.advance(0.01)
                assert energy(plant) < before + 1e-4
                before = energy(plant)


def test_much_friction_is_the_rigid_model():
    robot = rnc.Robot.from_urdf("rolling_disk.urdf", base="free")
    wheel = rnc.RollingWheel("disk", 0.25, axis="y")
    rigid = rnc.ReducedPlant(rnc.NonholonomicSystem(robot, [wheel]).reduce(), tolerance=1e-9)
    contact = rnc.UnilateralContact(wheel, friction=1e6)
    plant = rnc.ContactPlant(rnc.NonholonomicSystem(robot), [contact], tolerance=1e-9)
    lean = pin.rpy.rpyToMatrix(0.15, 0.0, 0.0)
    q = pose(z=0.25 * np.cos(0.15), rotation=lean)
    rigid.reset(q, np.array([1.5, 0, 0, 0, 6.0, 0.8]))
    plant.reset(q, rigid.read()[1])
    for each in (rigid, plant):
        for _ in range(10):
            each.advance(0.01)
    np.testing.assert_allclose(np.concatenate(plant.read()), np.concatenate(rigid.read()), atol=3e-8)
    assert plant.sliding == ()
