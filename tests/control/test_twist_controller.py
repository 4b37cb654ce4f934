"""Twist in, wheels out: closed forms of all kinds of bases, limits, standstill, and loops around a velocity plant."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from driven_bases import KINDS, RADIUS, STEERING_RATE, KinematicPlant, drafted_model, tricycle, turret
from rnc_pin.control import TwistController
from rnc_pin.control.actuator_velocity import velocity_from_actuators
from systems import ackermann_car, bicycle, differential_drive, fire_truck, spinning_space_robot

pytestmark = pytest.mark.usefixtures("brief")

DT = 0.04
# Place of the axle whose wheels have no pivot, ahead of the frame "base"; a twist with vy = -x w suits it.
AXLE = {
    "differential drive": 0.0, "tricycle, driven in front": -0.4, "forklift": 0.3,
    "car": -0.3, "car with trailer": -0.3,
}  # fmt: skip
STEERED = {
    "differential drive": 0, "Mecanum": 0, "turret": 1, "two steered drives": 2, "two steered drives side by side": 2,
    "four steered drives": 4, "two carts": 8, "four-wheel steering": 4,
}  # fmt: skip


def model(name):
    return drafted_model(KINDS[name])


def standing(name, **options):
    """Model of a base, its controller, and the base at its start."""
    reduced = model(name)
    return reduced, TwistController(reduced, "base", DT, **options), KinematicPlant(reduced, start(reduced))


def start(reduced):
    return reduced.assembled(reduced.robot.configuration())


def suitable(name, forward=0.4, turn=0.3, left=0.1):
    """A twist of the frame "base" that a kind can have."""
    return np.array([forward, -AXLE[name] * turn if name in AXLE else left, turn])


def expected_wheels(name, twist, angles):
    """Side slip [m/s] and rolling rate [rad/s] of each wheel, whose hub moves at (vx - w y, vy + w x)."""
    vx, vy, w = twist
    rates, slips = {}, {}
    for joint, each in KINDS[name].wheels.items():
        across, along = vy + w * each.x, vx - w * each.y
        if joint in KINDS[name].rollers:
            rates[joint], slips[joint] = (along + across * np.tan(KINDS[name].rollers[joint])) / RADIUS, 0.0
            continue
        c, s = (1.0, 0.0) if each.pivot is None else (np.cos(angles[each.pivot]), np.sin(angles[each.pivot]))
        rates[joint] = (c * along + s * across - w * each.beside) / RADIUS
        slips[joint] = c * across - s * along
    return rates, slips


def independence(name, angles, length=1.0):
    """Smallest singular value of the rows of side slip; zero for three pivots or more with one centre of rotation."""
    places = [(each.x, each.y, angles[each.pivot]) for each in KINDS[name].wheels.values()]
    guides = [[-np.sin(a), np.cos(a), (x * np.cos(a) + y * np.sin(a)) / length] for x, y, a in places]
    return np.linalg.svd(guides)[1][-1]


def twist_of(reduced, v, frame="base"):
    """Twist of a frame by Pinocchio alone, with the base at its origin."""
    robot, data = reduced.robot, reduced.robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.configuration(), v)
    velocity = pin.getFrameVelocity(robot.model, data, robot.frame_id(frame), pin.ReferenceFrame.LOCAL)
    return np.array([*velocity.linear[:2], velocity.angular[2]])


@pytest.mark.parametrize("forward", [0.4, -0.4])
@pytest.mark.parametrize("name", KINDS)
def test_wheels_and_pivots_have_the_closed_forms_of_their_base(name, forward):
    reduced, twist = model(name), suitable(name, forward)
    controller = TwistController(reduced, "base", DT)
    found = controller.feasible(start(reduced), twist)
    np.testing.assert_allclose(found.twist, twist, atol=1e-9)
    assert (found.cuts, len(controller.steering)) == ((), STEERED.get(name, 1))
    rates, slips = expected_wheels(name, twist, reduced.robot.joint_values(found.q))
    for joint, rate in rates.items():
        assert found.v[reduced.robot.velocity_indices(joint).start] == pytest.approx(rate, abs=1e-6)
    assert max(map(abs, slips.values())) < 1e-6
    np.testing.assert_allclose(twist_of(reduced, found.v), twist, atol=1e-9)


def test_the_nearest_twist_weights_turning_by_the_length():
    """On the line vy = a w the nearest to (0, 0, w) has the share l^2 / (l^2 + a^2) of w."""
    reduced = model("car")
    for length in (0.2, 0.3, 1.0):
        found = TwistController(reduced, "base", length=length).feasible(start(reduced), [1.0, 0.0, 0.3])
        share = length**2 / (length**2 + 0.3**2)
        np.testing.assert_allclose(found.twist, [1.0, 0.3 * 0.3 * share, 0.3 * share], atol=1e-9)
        (cut,) = found.cuts
        assert (cut.kind, cut.name) == ("constraint", "base")
        assert cut.amount == pytest.approx(0.3 * length * np.sqrt(1 - share), rel=1e-9)


def test_the_left_knuckle_of_a_linkage_has_its_angle_and_the_right_one_follows():
    """Ackermann: cot(left) = (1 / k - y) / L for the curvature k."""
    reduced = ackermann_car()
    controller = TwistController(reduced, "base")
    found = controller.feasible(start(reduced), [0.5, 0.0, 0.3])
    values = reduced.robot.joint_values(found.q)
    assert controller.steering == ("left_steer",)
    assert values["left_steer"] == pytest.approx(np.arctan(1.1 / (0.5 / 0.3 - 0.3)), abs=1e-9)
    assert -values["right_steer"] == pytest.approx(np.arctan(1.1 / (0.5 / 0.3 + 0.3)), abs=1e-9)  # its axis points down
    np.testing.assert_allclose(found.twist, [0.5, 0.0, 0.3], atol=1e-9)


def test_a_steered_trailer_axle_steers_no_tractor():
    """The rear steering of the fire truck moves its trailer only: the twist of the tractor leaves it alone."""
    controller = TwistController(fire_truck(), "tractor")
    assert controller.steering == ("front_steering",)
    found = controller.feasible(start(fire_truck()), [0.5, 0.0, 0.2])
    assert fire_truck().robot.joint_values(found.q)["front_steering"] == pytest.approx(np.arctan(0.2 / 0.5), abs=1e-9)
    assert found.v[fire_truck().robot.velocity_indices("rear_steering")] == 0.0


def test_a_pivot_ahead_of_its_axle_follows_as_a_powered_caster():
    """The axle 0.1 m behind the pivot has no side slip: the pivot turns at v / 0.1 - w, and nothing has to be aimed."""
    reduced = drafted_model(turret(behind=0.1))
    controller = TwistController(reduced, "base", limits=False)
    assert controller.steering == ()
    angle, (vx, vy, w) = 0.7, (0.2, 0.3, 0.4)
    q = reduced.robot.configuration({"turn_joint": angle})
    command, _ = controller.step(q, [vx, vy, w], controller.initial_state())
    ahead, left = vx, vy + 0.05 * w  # at the pivot
    along, across = ahead * np.cos(angle) + left * np.sin(angle), left * np.cos(angle) - ahead * np.sin(angle)
    turning = across / 0.1
    expected = {"turn_joint": turning - w}
    expected |= {f"drive_{side}_joint": (along - turning * y) / RADIUS for side, y in (("l", 0.15), ("r", -0.15))}
    np.testing.assert_allclose(command.joints, [expected[name] for name in controller.joints], atol=1e-7)
    np.testing.assert_allclose(command.twist, [vx, vy, w], atol=1e-9)


def driven(controller, plant, twist, state, samples):
    """Commands of a constant twist, one a sample, after which the plant has moved; and the state."""
    commands = []
    for _ in range(samples):
        command, state = controller.step(plant.q, twist, state)
        plant.advance(command.u, DT, hold=controller.steering)
        commands.append(command)
    return commands, state


@pytest.mark.parametrize("name", sorted({*KINDS} - {"two carts"}))  # carts turn where lateral rows are dependent
def test_the_base_reaches_the_feasible_twist_within_limits_and_without_slip(name):
    """The plant has the motors' velocities only. It may miss some, and wheels without a lateral row may slip."""
    reduced, controller, plant = standing(name)
    state = controller.initial_state()
    turning = [k for k, joint in enumerate(reduced.robot.velocity_names) if joint.startswith("turn")]
    motors = {reduced.actuation.names[k]: k for k in range(reduced.p)}
    fastest = suitable(name, 3.0, 0.3) if name == "car with trailer" else [2.0] * 3  # too much for wheels or pivots
    for twist in (suitable(name), suitable(name, 0.3, -0.4, -0.1), np.zeros(3), suitable(name, -0.3, 0.2), fastest):
        reachable = controller.feasible(plant.q, twist)
        for _ in range(30):
            command, state = controller.step(plant.q, twist, state)
            plant.advance(command.u, DT, hold=controller.steering)
            end = velocity_from_actuators(reduced.at(plant.q), command.u)  # of a second knuckle: no motor has it
            assert np.abs([command.v[turning], end[turning]]).max(initial=0.0) <= 1.005 * STEERING_RATE
            assert np.abs(command.joints).max() <= 20.0 + 1e-6
            missed = np.abs(reduced.at(plant.middle).B.T @ plant.v - command.u)
            _, across = expected_wheels(name, twist_of(reduced, plant.v), reduced.robot.joint_values(plant.middle))
            speed = RADIUS * max(abs(command.u[k]) for joint, k in motors.items() if joint in KINDS[name].wheels)
            allowed = (controller.slip + 0.5 * STEERING_RATE * DT) * speed + 1e-9  # angles change during a sample
            speeds = (missed[k] * (RADIUS if joint in KINDS[name].wheels else 1.0) for joint, k in motors.items())
            assert max(speeds) < allowed
            assert max(map(abs, across.values())) < allowed
        if name == "car with trailer":  # the speed of the trailer's wheels depends on the hitch
            reachable = controller.feasible(plant.q, twist)
        np.testing.assert_allclose(command.twist, reachable.twist, atol=1e-7)
        np.testing.assert_allclose(twist_of(reduced, plant.v), reachable.twist, atol=1e-7)
        assert {each.kind for each in command.cuts} == {each.kind for each in reachable.cuts}


@pytest.mark.parametrize("name", ["two steered drives", "four steered drives", "turret", "tricycle, driven in front"])
def test_pivots_complete_the_command_while_the_base_stands(name):
    """Two samples of a command, then none: the base stands at once, the pivots turn on to their angles and stay."""
    reduced, controller = model(name), TwistController(model(name), "base", DT)
    plant, twist = KinematicPlant(reduced, start(reduced)), suitable(name, 0.3, 0.3, 0.3)
    commands, state = driven(controller, plant, twist, controller.initial_state(), 2)
    aimed = reduced.robot.joint_values(controller.feasible(plant.q, twist).q)
    commands, state = driven(controller, plant, np.zeros(3), state, 30)
    for command in commands:
        np.testing.assert_allclose(command.twist, 0.0, atol=1e-12)
    now = reduced.robot.joint_values(plant.q)
    for joint in controller.steering:
        assert np.sin(now[joint] - aimed[joint]) == pytest.approx(0.0, abs=1e-6)  # either of both angles
        assert abs(now[joint]) > 0.1
    command, _ = controller.step(plant.q, twist, state)  # it goes on with the full twist, and no pivot moves
    np.testing.assert_allclose(command.twist, twist, atol=1e-6)
    assert command.cuts == ()


def test_a_slow_stop_and_a_start_are_continuous():
    """A command that passes through zero: pivots and wheels change by no more than the command's rate explains."""
    name = "four steered drives"
    reduced, controller = model(name), TwistController(model(name), "base", DT)
    plant, direction = KinematicPlant(reduced, start(reduced)), np.array([0.3, 0.2, 0.4])
    _, state = driven(controller, plant, direction, controller.initial_state(), 40)
    last, q = None, plant.q
    for share in np.linspace(1.0, -1.0, 41):
        (command,), state = driven(controller, plant, share * direction, state, 1)
        np.testing.assert_allclose(command.twist, share * direction, atol=1e-9)
        if last is not None:
            assert np.abs(command.joints - last).max() < 0.06 * 0.6 / RADIUS
        last = command.joints
    for joint in controller.steering:
        before, after = (reduced.robot.joint_values(each)[joint] for each in (q, plant.q))
        assert after == pytest.approx(before, abs=1e-9)


def test_a_swerve_module_takes_the_shorter_way_and_rolls_backwards():
    """From straight ahead to 170 degrees: it turns by -10 degrees in one sample, and the wheels roll backwards."""
    name = "two steered drives"
    reduced, controller, plant = standing(name, limits=False)
    angle = np.deg2rad(170.0)
    commands, _ = driven(controller, plant, [np.cos(angle), np.sin(angle), 0.0], controller.initial_state(), 2)
    turned = DT * commands[0].v[[reduced.robot.velocity_indices(joint).start for joint in controller.steering]]
    np.testing.assert_allclose(np.rad2deg(turned), -10.0, atol=1e-9)
    wheels = [commands[1].joints[controller.joints.index(joint)] for joint in KINDS[name].wheels]
    np.testing.assert_allclose(wheels, -1.0 / RADIUS, rtol=1e-9)


def test_pivots_take_the_shorter_way_where_the_centre_of_rotation_passes_between_them():
    """From a tight left turn to the same on the right, wheels nearer to the centre than its distance turn round."""
    name, twist = "four steered drives", np.array([0.1, 0.0, 0.8])
    reduced, controller, plant = standing(name, length=0.1)
    _, state = driven(controller, plant, twist, controller.initial_state(), 60)
    commands, _ = driven(controller, plant, twist * [1, 1, -1], state, 60)
    np.testing.assert_allclose(commands[-1].twist, twist * [1, 1, -1], atol=1e-6)
    for each in KINDS[name].wheels.values():
        before, after = (np.arctan2(w * each.x, 0.1 - w * each.y) for w in (0.8, -0.8))
        column = reduced.robot.velocity_indices(each.pivot).start
        path = DT * sum(abs(command.v[column]) for command in commands)
        assert path == pytest.approx(abs((after - before + np.pi / 2) % np.pi - np.pi / 2), abs=1e-6)


def test_pivots_that_cannot_turn_at_once_share_one_centre_of_rotation_on_the_way():
    """The base goes on, and one pivot at least turns as fast as it can, until all have the angles of the command."""
    name, twist = "four steered drives", np.array([0.4, -0.2, 0.9])
    reduced, controller, plant = standing(name)
    _, state = driven(controller, plant, suitable(name), controller.initial_state(), 60)
    columns = [reduced.robot.velocity_indices(joint).start for joint in controller.steering]
    for _ in range(10):
        (command,), state = driven(controller, plant, twist, state, 1)
        assert independence(name, reduced.robot.joint_values(plant.q)) < 1e-9
        assert np.abs(command.v[columns]).max() == pytest.approx(STEERING_RATE, rel=5e-3)
        assert command.twist[0] > 0.39


def test_a_turn_by_a_right_angle_does_not_hesitate():
    """Both ways are equally long, and noise of the angle prefers now one, now the other."""
    reduced, controller = model("turret"), TwistController(model("turret"), "base", DT)
    state, generator = controller.initial_state(), np.random.default_rng(3)
    pivot = reduced.robot.velocity_indices("turn_joint").start
    velocities = []
    for _ in range(12):
        noise = np.zeros(reduced.n)
        noise[pivot] = generator.normal(0.0, 0.02)
        q = pin.integrate(reduced.robot.model, start(reduced), noise)  # as of a pivot that has not moved yet
        command, state = controller.step(q, [0.0, 0.3, 0.0], state)
        velocities.append(command.v[pivot])
    np.testing.assert_allclose(velocities, np.sign(velocities[0]) * STEERING_RATE, rtol=1e-6)


def test_noise_does_not_turn_the_base_where_the_axles_are_in_line():
    """Two drives side by side: exact rows of angles with noise would turn the base about any point of the axle."""
    name = "two steered drives side by side"
    reduced, controller = model(name), TwistController(model(name), "base", DT)
    generator, state = np.random.default_rng(3), controller.initial_state()
    pivots = [reduced.robot.velocity_indices(joint).start for joint in controller.steering]
    for _ in range(20):
        noise = np.zeros(reduced.n)
        noise[pivots] = generator.normal(0.0, 3e-4, len(pivots))
        q = pin.integrate(reduced.robot.model, start(reduced), noise)
        command, state = controller.step(q, [0.4, 0.0, 0.3], state)
        np.testing.assert_allclose(command.twist, [0.4, 0.0, 0.3], atol=0.01)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_program_aims_beside_angles_at_which_the_axles_are_in_line(sign):
    """Across the line through both wheels: a twist within 4 % whose guides are apart, and nothing slips."""
    name, goal = "two steered drives", sign * np.array([-0.2, 0.3, 0.0])
    controller, q = TwistController(model(name), "base", DT), start(model(name))
    scale, motion, length = controller._scale, controller.base.at(q), controller.base.length
    found, turn = controller._regular(motion, q, goal * scale, np.zeros(2))
    angles = dict(zip(controller.steering, turn, strict=True))  # from straight ahead
    assert 0.02 < np.linalg.norm(found - goal * scale) / np.linalg.norm(goal) <= 0.04
    np.testing.assert_allclose(list(expected_wheels(name, found / scale, angles)[1].values()), 0.0, atol=1e-12)
    assert independence(name, angles, length) >= 0.75 * 0.04
    assert np.abs(turn).max() < np.arctan2(0.3, 0.2)  # of both sides of the goal, the one with the shorter turns


def rolls_within(twist, name, largest):
    """True if each wheel on a pivot has an angle of at most ``largest``, forwards or backwards."""
    for each in KINDS[name].wheels.values():
        if each.pivot is not None:
            along, across = twist[0] - twist[2] * each.y, twist[1] + twist[2] * each.x
            if abs(across) > np.tan(largest) * abs(along) + 1e-9:
                return False
    return True


@pytest.mark.parametrize("seed", range(8))
def test_the_nearest_twist_within_limits_of_angle_beats_all_others(seed):
    """Four pivots with limits of 1 rad: no twist of a dense search is nearer to the command and within all limits."""
    name, generator = "four-wheel steering", np.random.default_rng(seed)
    reduced, controller = model(name), TwistController(model(name), "base", DT, limits=False)
    scale = np.array([1.0, 1.0, controller.base.length])
    wanted = generator.normal(size=3) * [0.5, 1.0, 1.0] / scale
    found = controller.feasible(start(reduced), wanted)
    assert rolls_within(found.twist, name, 1.0 + 1e-7)
    assert ("angle" in {each.kind for each in found.cuts}) == (not rolls_within(wanted, name, 1.0))
    distance = np.linalg.norm(scale * (found.twist - wanted))
    spread = distance * generator.normal(size=(20_000, 3)) / scale
    for other in wanted + spread:
        if np.linalg.norm(scale * (other - wanted)) < distance - 1e-6:
            assert not rolls_within(other, name, 1.0)


def test_a_tight_turn_stops_at_the_limit_of_the_angle():
    """A tricycle with a limit of 1 rad: its curvature at the axle is at most tan(1) / L."""
    name = "tricycle, driven in front"
    _, controller, plant = standing(name)
    commands, _ = driven(controller, plant, suitable(name, 0.1, 0.5), controller.initial_state(), 30)
    vx, _, w = commands[-1].twist
    assert w / vx == pytest.approx(np.tan(1.0) / 0.9, rel=1e-6)
    (cut,) = commands[-1].cuts
    assert (cut.kind, cut.name) == ("angle", "turn_front_joint")
    assert cut.amount == pytest.approx(np.arctan(0.9 * 5.0) - 1.0, abs=1e-6)
    assert str(cut) == "turn_front_joint is at its limit, 0.352 rad before the angle of the twist"


def test_a_pivot_between_its_limits_goes_the_long_way_if_it_has_to():
    """From a bend in reverse to a tight one ahead: the short way is beyond the limit, so the truck stops and steers."""
    name = "forklift"
    _, controller, plant = standing(name)
    _, state = driven(controller, plant, suitable(name, -0.35, 0.42), controller.initial_state(), 40)
    commands, _ = driven(controller, plant, suitable(name, 0.35, 0.42), state, 40)
    assert min(np.abs(each.twist).max() for each in commands) < 1e-9
    np.testing.assert_allclose(commands[-1].twist, suitable(name, 0.35, 0.42), atol=1e-9)
    assert commands[-1].cuts == ()


@pytest.mark.parametrize(("waits", "least", "most"), [(np.pi / 4, 0.005, 0.1), (0.01, 0.0, 2e-4)])
def test_a_tricycle_that_waits_turns_on_the_spot_without_creeping(waits, least, most):
    reduced, places = drafted_model(tricycle(turns_round=True)), []
    controller, plant = TwistController(reduced, "base", DT, waits=waits), KinematicPlant(reduced, start(reduced))
    state = controller.initial_state()
    for _ in range(60):
        _, state = driven(controller, plant, [0.0, 0.2, 0.5], state, 1)
        places.append(plant.q)
    q = np.array(places)
    axle = q[:, :2] - 0.4 * q[:, 2:4]
    assert least <= np.linalg.norm(axle - axle[0], axis=1).max() < most
    assert abs(np.arctan2(q[-1, 3], q[-1, 2])) > 0.1


@pytest.mark.parametrize("name", ["turret", "four steered drives"])
def test_pivots_of_a_program_turn_within_its_accelerations_and_the_base_drives_by_what_they_leave(name):
    reduced, dt, most = model(name), 0.02, 1.5
    controller, twist, q, v = TwistController(reduced, "base"), [0.0, 0.4, 0.0], start(reduced), np.zeros(reduced.n)
    rows, limits = np.eye(reduced.n)[controller._entries], np.full(len(controller.joints), most)
    for _ in range(800):
        motion, (base, turning) = controller.base.at(q), controller.aimed(q, twist, v, dt, (rows, limits))
        last, v = v, motion.moving @ (base * controller._scale) + motion.turning @ turning
        assert np.abs(rows @ (v - last)).max() < 1.2 * most * dt  # rows change a little with the angles
        q = pin.integrate(reduced.robot.model, q, dt * v)
    np.testing.assert_allclose(twist_of(reduced, v), twist, atol=0.02)
    assert np.abs(v[controller.base.pivots]).max() < 1e-3


@pytest.mark.parametrize("name", ["differential drive", "Mecanum", "four steered drives", "car"])
def test_a_step_of_the_command_keeps_the_accelerations(name):
    most, goals = np.array([0.5, 0.4, 0.6]), [suitable(name), suitable(name, 0.3, 0.28, 0.1), np.zeros(3)]
    plant = KinematicPlant(model(name), start(model(name)))
    controller = TwistController(model(name), "base", DT, max_acceleration=most)
    state, twists = controller.initial_state(), []
    for goal in goals:
        commands, state = driven(controller, plant, goal, state, 80)
        twists += [each.twist for each in commands]
    changes = np.abs(np.diff(np.vstack([np.zeros(3), twists]), axis=0)) / DT
    free = [0, 2] if name == "car" else [0, 1, 2]  # vy of a frame that is not on its axle follows
    assert (changes[:, free].max(axis=0) < 1.02 * most[free]).all()
    np.testing.assert_allclose(twists[79::80], goals, atol=1e-6)


def test_a_limit_of_speed_scales_the_twist_as_a_whole():
    """Wheels of 0.1 m at 0.2 m: at (1, 0, 2) the right one needs 14 rad/s; a limit of 7 halves the twist."""
    reduced = differential_drive()
    limits = np.full(reduced.n, np.inf)
    limits[reduced.robot.velocity_indices("right_wheel_joint").start] = 7.0
    controller = TwistController(reduced, "base", limits=limits)
    command, _ = controller.step(reduced.robot.configuration(), [1.0, 0.0, 2.0], controller.initial_state())
    np.testing.assert_allclose(command.twist, [0.5, 0.0, 1.0], atol=1e-9)
    (cut,) = command.cuts
    assert str(cut) == "right_wheel_joint is at its velocity limit: the twist is scaled by 0.5"


def test_a_trailer_at_the_limit_of_its_hitch_stops_the_car():
    """Backwards on a circle the hitch folds up to its limit of 1.2 rad, and not beyond."""
    name = "car with trailer"
    reduced, controller, plant = standing(name)
    commands, _ = driven(controller, plant, suitable(name, -0.5, 0.5), controller.initial_state(), 100)
    assert abs(reduced.robot.joint_values(plant.q)["hitch"]) == pytest.approx(1.2, abs=2e-3)
    assert np.abs(commands[-1].twist).max() < 0.02
    assert ("range", "hitch") in {(each.kind, each.name) for each in commands[-1].cuts}


def test_a_base_has_three_velocities_in_the_plane_and_enough_motors():
    wheels = [rnc.RollingWheel(f"{side}_wheel", 0.1) for side in ("left", "right")]
    idle = rnc.NonholonomicSystem(differential_drive().robot, wheels, ["left_wheel_joint"]).reduce()
    car, turning = ackermann_car(), spinning_space_robot()
    for reduced, frame, options, words in (
        (car, "bass", {}, "did you mean 'base'"),
        (car, "fl", {}, r"left_steer, fl_spin with 5 velocities: expected a frame of a base"),
        (turning, turning.robot.model.frames[-1].name, {}, "affine"),
        (idle, "base", {}, r"velocities of the actuators .* determine 1 of 2"),
        (bicycle(), "rear", {}, "expected a frame"),
        (car, "base", {"dt": 0}, r"dt > 0, 0 < slip < 1, .* found 0, 0\.02"),
        (car, "base", {"length": -1}, "length: expected a positive number, found -1"),
    ):
        with pytest.raises((rnc.ConfigurationError, rnc.ModelError), match=words):
            TwistController(reduced, frame, **options)


def test_a_twist_is_three_numbers():
    reduced = ackermann_car()
    controller = TwistController(reduced, "base")
    for twist in ([1.0, 0.0], [[1.0, 0.0, 0.0]], [1.0, 0.0, np.inf], [None] * 3, ["a", 0, 0], [1, np.nan, 0]):
        with pytest.raises(rnc.InputError, match=r"twist is \(vx, vy, wz\)"):
            controller.step(start(reduced), twist, controller.initial_state())
