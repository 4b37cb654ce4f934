"""Contacts that open and close by themselves, against closed forms and an integration with events by SciPy."""

import numpy as np
import pinocchio as pin
import pytest
import scipy

import rnc_pin as rnc
from bodies import add_body, free_body
from simple_controllers import Idle, Inputs

G = 9.81

CORNERS = {f"c{k}": [(k & 1) * 0.2 - 0.1, (k >> 1 & 1) * 0.3 - 0.15, (k >> 2) * 0.1 - 0.05] for k in range(8)}


@pytest.fixture(scope="module")
def ball():
    robot = free_body(2.0, [0.008] * 3, ball=[0.0, 0.0, 0.0])
    return rnc.NonholonomicSystem(robot, [], [rnc.FrameForce("ball", "z")])


@pytest.fixture(scope="module")
def free(ball):
    return ball.reduce()


def at(system, height, pitch=0.0):
    return system.robot.configuration({"root_joint": [0, 0, height, 0, np.sin(pitch / 2), 0, np.cos(pitch / 2)]})


def test_bouncing_ball(ball, free):
    """Heights e^2n h, and times of flight e^n; then it rolls with 5/7 of its speed. The energy balance closes."""
    e, height, speed, rest = 0.6, 0.3, 0.7, 0.2
    contact = rnc.UnilateralContact(rnc.RollingBall("ball", 0.1), e, rest_speed=rest)
    plant = rnc.ContactPlant(ball, [contact], substeps=8)
    v = [speed, 0, 0, 0, 0, 0]
    run = rnc.simulate(free, Idle(1), at(ball, 0.1 + height), 1.0, 0.02, v2_0=v, plant=plant)
    fall = np.sqrt(2 * height / G)
    bounces = int(np.floor(np.log(rest / (G * fall)) / np.log(e)))
    phases = run.info.phases
    flights = fall * np.array([1.0, *(2 * e**k for k in range(1, bounces + 1))])
    np.testing.assert_allclose([each.start for each in phases[1:]], np.cumsum(flights), rtol=1e-9)
    assert [each.name for each in phases] == ["flight"] * (bounces + 1) + ["ball"]
    # Kinetic energy before and after each bounce, and what friction takes at the first one.
    kinetic = 2.0 * G * height * e ** (2 * np.arange(bounces + 1))
    lost = kinetic * (1 - e**2)
    lost[-1] = kinetic[-1]
    lost[0] += 0.5 * 2.0 * speed**2 * 2 / 7
    np.testing.assert_allclose([each.energy_loss for each in phases[1:]], lost, rtol=1e-7)
    assert np.ptp(run.energy - run.work) < 1e-8
    assert run.q[run.phase == 1][:, 2].max() == pytest.approx(0.1 + e**2 * height, abs=G * 0.02**2 / 8)
    rolls = run.phase == bounces + 1
    assert not run.normal_forces[~rolls].any()
    np.testing.assert_allclose(run.normal_forces[rolls, 0], 2.0 * G, rtol=1e-9)
    np.testing.assert_allclose(run.v[rolls, 4], 5 / 7 * speed / 0.1, rtol=1e-6)
    assert np.abs(run.q[rolls, 2] - 0.1).max() < 1e-12
    assert rnc.summarize(run)["impacts"][0]["energy_loss"] == pytest.approx(lost[0])


def test_contact_opens_and_closes_in_one_run(ball, free):
    """A push of 1.5 weights for 0.1 s: the jump of the input opens the contact, gravity closes it."""
    push, weight = 0.1, 2.0 * G
    pull = Inputs(lambda t: [1.5 * weight if t < push - 1e-9 else 0.0])
    contact = rnc.UnilateralContact(rnc.RollingBall("ball", 0.1))
    run = rnc.simulate(free, pull, at(ball, 0.1), 0.5, 0.01, plant=rnc.ContactPlant(ball, [contact]))
    height, speed = 0.5 * 0.5 * G * push**2, 0.5 * G * push
    landing = push + (speed + np.sqrt(speed**2 + 2 * G * height)) / G
    assert [each.end for each in run.info.phases] == ["lift-off of ball", "landing of ball", None]
    assert run.info.phases[2].start == pytest.approx(landing, rel=1e-10)
    assert run.info.phases[2].energy_loss == pytest.approx(0.5 * 2.0 * (speed**2 + 2 * G * height))
    flies = run.phase == 1
    assert run.time[flies][0] == 0.0
    assert not run.contact_forces[flies].any()
    assert rnc.summarize(run)["lift_off"] is None
    assert np.ptp(run.energy - run.work) < 1e-9


@pytest.mark.parametrize(("turning", "closed"), [(0.1, ("left", "right")), (0.5, ("right",))])
def test_body_that_rocks(turning, closed):
    """As the right foot lands, the left one stays if ``I < m a^2``, and lifts off if ``I > m a^2``."""
    mass, a, tilt = 1.0, 0.5, 0.05
    system = rnc.NonholonomicSystem(free_body(mass, [1e-3, turning, turning], left=[-a, 0, 0], right=[a, 0, 0]))
    plant = rnc.ContactPlant(system, [rnc.UnilateralContact(rnc.Caster(name, 0.0)) for name in ("left", "right")])
    plant.reset(at(system, a * np.sin(tilt), -tilt), np.zeros(6))  # on the left foot
    for _ in range(40):
        plant.advance(0.01)
        if len(plant.contact_events) > 1:
            break
    before, landing = plant.contact_events
    assert before.closed == ("left",)
    assert (landing.cause, landing.closed) == ("landing of right", closed)
    # Energy of the fall, half of it along the vertical: w^2 (I + m a^2 cos^2) = 2 m g a sin(tilt), at the end cos = 1.
    w = np.sqrt(2 * mass * G * a * np.sin(tilt) / (turning + mass * a**2))
    if closed == ("right",):  # an impulse at the right foot alone stops this foot
        impulse = 2 * a * w / (1 / mass + a**2 / turning)
        assert landing.impulses == {"vertical(right)": pytest.approx(impulse, rel=1e-6)}
    else:
        up, moment = mass * a * w, turning * w / a
        expected = {"vertical(left)": (up - moment) / 2, "vertical(right)": (up + moment) / 2}
        assert landing.impulses == {name: pytest.approx(value, rel=1e-6) for name, value in expected.items()}


def test_hopper_lifts_off_where_its_spring_carries_the_foot():
    """``upper u'' = -k u - upper g`` from a compression until ``k u = lower g``, where the foot has no load left."""
    upper, lower, k, length, pressed = 1.5, 0.4, 400.0, 0.5, 0.12
    model = pin.Model()
    first = add_body(model, "body", "PZ", upper, moments=1e-3)
    add_body(model, "leg", "PZ", lower, first, moments=1e-3, at=(0, 0, -length), frame="foot")
    system = rnc.NonholonomicSystem(rnc.Robot(model), forces=[rnc.forces.Spring(rnc.JointPosition("leg"), k)])
    plant = rnc.ContactPlant(system, [rnc.UnilateralContact(rnc.Caster("foot", 0.0))], substeps=4)
    plant.reset(np.array([length - pressed, pressed]), np.zeros(2))
    for _ in range(20):
        plant.advance(0.01)
    rate, sag = np.sqrt(k / upper), upper * G / k
    leaves = np.arccos((lower * G / k + sag) / (sag - pressed)) / rate
    start, lift = plant.contact_events
    assert (start.closed, lift.cause, lift.closed) == (("foot",), "lift-off of foot", ())
    assert lift.time == pytest.approx(leaves, abs=1e-7)
    rises, flight = -(sag - pressed) * rate * np.sin(rate * leaves), 0.2 - leaves
    q, _ = plant.read()
    centre = (upper * q[0] + lower * (q[0] + q[1] - length)) / (upper + lower)
    up = upper * (length + lower * G / k) / (upper + lower)
    fallen = upper * rises / (upper + lower) * flight - G * flight**2 / 2
    assert centre == pytest.approx(up + fallen, abs=1e-6)


def test_wheels_that_share_the_load_stay_closed():
    system = rnc.NonholonomicSystem(free_body(1.0, [0.1, 0.1, 0.1], a=[-1, 0, 0], b=[0, 0, 0], c=[1, 0, 0]))
    plant = rnc.ContactPlant(system, [rnc.UnilateralContact(rnc.Caster(name, 0.1), 0.5) for name in "abc"])
    plant.reset(at(system, 0.2), np.array([0.3, 0, 0, 0, 0, 0]))
    for _ in range(10):
        plant.advance(0.1)
    assert plant.contact_events[1].closed == ()  # all three rebound together
    assert plant.contact_events[-1].closed == ("a", "b", "c")
    np.testing.assert_allclose(plant.read()[1], [0.3, 0, 0, 0, 0, 0], atol=1e-9)


def test_endless_bounces_are_refused(ball):
    plant = rnc.ContactPlant(ball, [rnc.UnilateralContact(rnc.RollingBall("ball", 0.1), 0.9, rest_speed=0.0)])
    plant.reset(at(ball, 0.2), np.zeros(6))
    with pytest.raises(rnc.SimulationError, match="increase the rest_speed"):
        plant.advance(3.0)


@pytest.mark.parametrize(("radius", "height"), [(0.2, 9e-5), (5e-5, 8e-5), (5e-5, 1e-7), (20.0, 1e-3)])
def test_a_ball_above_the_ground_falls_whatever_its_size(radius, height):
    model = rnc.Robot.from_urdf("rolling_ball.urdf", base="free").model.copy()
    model.inertias[1] = pin.Inertia.FromSphere(1.0, radius)
    ball = rnc.NonholonomicSystem(rnc.Robot(model))
    plant = rnc.ContactPlant(ball, [rnc.UnilateralContact(rnc.RollingBall("ball", radius))], tolerance=1e-9)
    q = pin.neutral(model)
    q[2] = radius + height
    plant.reset(q, np.zeros(6))
    time = np.sqrt(2 * height / 9.81)
    plant.advance(2 * time)
    start, landing = plant.contact_events
    assert (start.closed, landing.closed) == ((), ("ball",))
    assert landing.time == pytest.approx(time, rel=1e-6)
    for depth in (0.0, 1e-6 * radius):
        q[2] = radius - depth
        plant.reset(q, np.zeros(6))
        assert plant.contact_events[0].closed == ("ball",)
    q[2] = radius - 1e-3 * radius
    with pytest.raises(rnc.InputError, match="below the ground"):
        plant.reset(q, np.zeros(6))


@pytest.mark.parametrize("e", [0.2, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("angle", [0.3, 0.9, 1.3])
@pytest.mark.parametrize("spin", [-4.0, 0.0, 3.0])
def test_a_point_with_friction_rebounds_by_the_energetic_law(e, angle, spin):
    """Slip stops, then the work of the normal impulse returns by the share e^2; in the plane, by hand."""
    mass, half, radius = 2.0, 0.4, 0.01
    moment = mass * half**2 / 3
    robot = free_body(mass, [1e-3, moment, moment], tip=[half, 0.0, 0.0])
    contact = rnc.UnilateralContact(rnc.RollingBall("tip", radius), restitution=e, rest_speed=0.0)
    plant = rnc.ContactPlant(rnc.NonholonomicSystem(robot), [contact])
    x, z = half * np.cos(angle), -half * np.sin(angle) - radius  # of the point that touches, seen from the centre
    turned = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, angle, 0.0)).coeffs()
    along, down = 0.7, -3.0
    R = pin.rpy.rpyToMatrix(0.0, angle, 0.0)
    plant.reset(np.r_[0.0, 0.0, -z, turned], np.r_[R.T @ [along, 0.0, down], 0.0, spin, 0.0])
    slip, fall = along + spin * z, down - spin * x
    W = np.array([[1 / mass + z**2 / moment, -x * z / moment], [-x * z / moment, 1 / mass + x**2 / moment]])
    left = fall - W[0, 1] / W[0, 0] * slip
    if left >= 0.0:
        pytest.skip("slip that stops lifts the tip: nothing is compressed")
    loss = slip**2 / (2 * W[0, 0]) + (1 - e**2) * left**2 * W[0, 0] / (2 * np.linalg.det(W))
    (start,) = plant.contact_events[:1]
    assert start.energy_loss == pytest.approx(loss, rel=1e-9)


RADIUS, OFFSET, MASS, MOMENT = 0.25, 0.2, 1.0, 0.02  # of a hoop with a mass beside its centre


def hoop(friction, spin, slip=0.0):
    """Plant of the hoop at rest on the ground but for a spin, with its mass at the bottom; without slip it rolls."""
    system = rnc.NonholonomicSystem(free_body(MASS, [MOMENT] * 3, hoop=[0.0, 0.0, -OFFSET]))
    wheel = rnc.RollingWheel("hoop", RADIUS, axis="y")
    plant = rnc.ContactPlant(system, [rnc.UnilateralContact(wheel, friction=friction)], tolerance=1e-7)
    forward = (RADIUS - OFFSET) * spin - slip  # the body is upside down
    plant.reset(at(system, RADIUS - OFFSET, np.pi), np.array([-forward, 0, 0, 0, spin, 0]))
    return plant


def height(plant):
    q, v = plant.read()
    return np.array([q[2], (pin.Quaternion(q[3:]).matrix() @ v[:3])[2]])


def time_to(angle, rate):
    return scipy.integrate.quad(lambda each: 1.0 / rate(each), np.pi, angle)[0]


def test_hoop_that_would_have_to_slip_before_it_lifts_off():
    """Without a limit of friction, its rim would sink in flight at the time of zero normal force: that is said."""
    spin = 25.0

    def turning(angle):  # moment of inertia about the contact
        return MOMENT + MASS * (RADIUS**2 + OFFSET**2 + 2 * RADIUS * OFFSET * np.cos(angle))

    def rate(angle):
        fallen = 2 * MASS * G * OFFSET * (1 + np.cos(angle))
        return np.sqrt((turning(np.pi) * spin**2 - fallen) / turning(angle))

    def normal(angle):
        up = OFFSET * np.cos(angle) * rate(angle) ** 2
        turns = np.sin(angle) * MASS * OFFSET * (RADIUS * rate(angle) ** 2 + G) / turning(angle)
        return G - up - OFFSET * np.sin(angle) * turns

    lost = scipy.optimize.brentq(normal, np.pi, 1.5 * np.pi - 0.05)
    plant = hoop(None, spin)
    plant.advance(0.09)
    with pytest.raises(rnc.SimulationError, match=f"contacts hoop at t = {time_to(lost, rate):.4f} s: .*'friction'"):
        plant.advance(0.01)
    assert [each.cause for each in plant.contact_events] == ["start"]


def test_a_box_without_slip_comes_to_rest_on_four_corners():
    system = rnc.NonholonomicSystem(free_body(1.0, [0.0084, 0.0042, 0.0109], **CORNERS))
    contacts = [rnc.UnilateralContact(rnc.RollingBall(name, 0.01), restitution=0.5) for name in CORNERS]
    plant, reduced = rnc.ContactPlant(system, contacts), system.reduce()
    tilted = pin.Quaternion(pin.rpy.rpyToMatrix(0.3, 0.2, 0.0)).coeffs()
    still, q = rnc.control.ZeroInput(reduced), np.r_[0.0, 0.0, 0.3, tilted]
    run = rnc.simulate(reduced, still, q, 1.5, 0.01, v2_0=[0.4, 0.0, 0.0, 0.0, 0.0, 0.0], plant=plant)
    assert len(plant.closed) == 4
    assert not run.v[-1].any()
    assert run.contact_forces[-1].sum() == pytest.approx(G, rel=1e-9)
    assert run.contact_forces[-1].max() == pytest.approx(G / 4, rel=1e-9)
    assert rnc.impact(system, *plant.read(), appearing=[each.constraint for each in contacts[:4]]).loss == 0.0
