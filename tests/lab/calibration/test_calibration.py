"""Calibration of vehicles whose logs follow from textbook formulas, refusals, and a real tricycle."""

from dataclasses import replace

import numpy as np
import pytest

import rnc_pin as rnc
from measured_logs import COLUMNS, DELAYS, MEASURED, UNKNOWN, tricycle_system
from rnc_pin.lab.calibration import EncoderOffset, EncoderScale, JointShift, SensorPlace, TimeShift, WheelRadius
from rnc_pin.lab.calibration.calibration import PoseProblem
from rnc_pin.lab.calibration.rolling_motion import RollingMotion
from rnc_pin.lab.logs import Channel
from rolled_logs import CAR, DIFFERENTIAL, TRICYCLE, VEHICLES


def values(numbers):
    return np.array(list(numbers.values()))


@pytest.mark.parametrize("name", VEHICLES)
def test_exact_sensors_show_the_true_parameters(name, tmp_path):
    vehicle = VEHICLES[name]
    found = rnc.calibrate(vehicle.system(tmp_path), vehicle.log(3, noise=0.0, ticks=0), vehicle.unknown, "sensor")
    np.testing.assert_allclose(found.values, values(vehicle.true), atol=1e-4)
    assert found.errors["fit"].largest < 2e-5
    assert found.errors["nominal"].mean > 0.05


@pytest.mark.parametrize("name", VEHICLES)
def test_noise_and_its_standard_deviations(name, tmp_path):
    vehicle = VEHICLES[name]
    found = rnc.calibrate(vehicle.system(tmp_path), vehicle.log(1), vehicle.unknown, "sensor")
    assert (np.abs(found.values - values(vehicle.true)) < 3 * found.std).all()
    np.testing.assert_allclose(found.deviations, [0.005, 0.002], rtol=0.15)  # those of the drawn noise
    assert found.correlation < 1.5


def test_the_calibrated_system_is_the_robot_with_the_numbers(tmp_path):
    found = rnc.calibrate(DIFFERENTIAL.system(tmp_path), DIFFERENTIAL.log(2, noise=0.0, ticks=0),
                          DIFFERENTIAL.unknown, "sensor")  # fmt: skip
    again = rnc.calibrate(found.system, DIFFERENTIAL.log(5, noise=0.0, ticks=0), [SensorPlace("x")], "sensor")
    assert again.errors["nominal"].largest < 1e-3
    wheels = {kind.frame: kind.radius for kind in found.system.kinds}
    value = dict(zip(found.names, found.values, strict=True))
    assert wheels == {"left": value["radius of left"], "right": value["radius of right"]}
    model = found.system.robot.model
    left, right = (
        model.jointPlacements[model.getJointId(f"{side}_joint")].translation[1] for side in ("left", "right")
    )
    assert left - right == pytest.approx(value["place of left_joint, right_joint along y"])
    assert found.system.reduce().r == 2


def test_slopes_of_the_path_are_those_of_differences(tmp_path):
    sides = ("left", "right")
    unknown = [
        *(WheelRadius(f"{side}_{end}") for side in sides for end in ("front", "rear")),
        *CAR.unknown[2:4],
        EncoderOffset("left_steer_joint"), EncoderScale("right_steer_joint"), EncoderScale("left_rear_joint"),
        SensorPlace("x"), SensorPlace("y"), SensorPlace("yaw"),
        TimeShift(), TimeShift("left_steer_joint"), TimeShift("right_rear_joint"),
        JointShift("left_front_joint", "z"),
    ]  # fmt: skip
    motion = RollingMotion(CAR.system(tmp_path), CAR.log(0, duration=10), unknown, "sensor")
    p = np.array([each.nominal for each in motion.parameters]) + 0.01 * np.random.default_rng(0).normal(
        size=len(unknown)
    )
    times, step = np.linspace(1.0003, 9.0007, 77), 1e-6
    slopes = motion.poses(p, times).slopes
    for k, each in enumerate(motion.parameters):
        change = np.eye(len(p))[k] * step
        expected = (motion.poses(p + change, times).values - motion.poses(p - change, times).values) / (2 * step)
        np.testing.assert_allclose(slopes[:, :, k], expected, atol=2e-8, err_msg=each.name)


def test_combinations_that_no_log_shows_are_named(tmp_path):
    log = DIFFERENTIAL.log(0)
    cases = [
        # A larger wheel is a smaller gear, exactly.
        ([*DIFFERENTIAL.unknown, EncoderScale("left_joint")],
         {"radius of left", "scale of left_joint"}),
        # The path of the base says nothing about where the axle is on the base, but about the sensor beside it.
        ([*DIFFERENTIAL.unknown, JointShift({"left_joint": 1.0, "right_joint": 1.0}, "x")],
         {"place of left_joint, right_joint along x", "x of the sensor"}),
    ]  # fmt: skip
    for unknown, names in cases:
        with pytest.raises(rnc.InfeasibleError) as error:
            rnc.calibrate(DIFFERENTIAL.system(tmp_path), log, unknown, "sensor")
        message = str(error.value)
        assert message.startswith("the log does not determine the combination ")
        assert {each.name for each in unknown if each.name in message} == names


@pytest.mark.parametrize(("name", "seen"), [
    ("differential drive", {"radius of left", "radius of right"}),
    ("tricycle", {"radius of front", "offset of fork_joint"}),
    ("car", {"offset of left_steer_joint"}),
])  # fmt: skip
def test_a_straight_motion_shows_no_track_no_wheelbase_and_no_sensor(name, seen, tmp_path):
    vehicle = replace(VEHICLES[name], true=VEHICLES[name].nominal)
    steady, still = (lambda time: 0.3 + 0.1 * np.sin(time)), (lambda time: 0.0 * time)
    log = vehicle.log(0, inputs=[steady, steady if name == "differential drive" else still], ticks=0)
    with pytest.raises(rnc.InfeasibleError, match="the log does not determine the ") as error:
        rnc.calibrate(vehicle.system(tmp_path), log, vehicle.unknown, "sensor")
    missing = {each.name for each in vehicle.unknown if each.name in str(error.value)}
    assert missing == {each.name for each in vehicle.unknown} - seen
    # What the motion shows alone is estimated.
    alone = [each for each in vehicle.unknown if each.name in seen]
    if alone:
        found = rnc.calibrate(vehicle.system(tmp_path), log, alone, "sensor")
        np.testing.assert_allclose(found.values, found.nominal, atol=2e-3)


def test_outliers_are_named_and_hardly_count(tmp_path):
    log = TRICYCLE.log(4)
    pose = log.channel("pose", "sensor")
    bad = np.array([50, 51, 400, 600])
    moved = pose.values.copy()
    moved[bad, :2] += [1.0, -2.0]
    spoiled = rnc.Log([*[each for each in log if each is not pose], Channel("pose", "sensor", pose.time, moved)])
    found = rnc.calibrate(TRICYCLE.system(tmp_path), spoiled, TRICYCLE.unknown, "sensor")
    np.testing.assert_array_equal(found.outliers, pose.time[bad])
    assert (np.abs(found.values - values(TRICYCLE.true)) < 3.5 * found.std).all()


def with_gap(each):
    kept = (each.time < 11.0) | (each.time > 14.0)
    return Channel(each.quantity, each.of, each.time[kept], each.values[kept])


def as_velocity(each):
    return Channel("velocity", each.of, each.time, np.gradient(each.values[:, 0], each.time)[:, None])


@pytest.mark.parametrize(("change", "seed", "atol"), [(with_gap, 6, 1e-4), (as_velocity, 7, 2e-3)])
def test_gaps_in_the_joints_end_windows_and_velocities_serve_as_positions(change, seed, atol, tmp_path):
    log = DIFFERENTIAL.log(seed, noise=0.0, ticks=0)
    parts = [change(each) if each.quantity == "position" else each for each in log]
    found = rnc.calibrate(DIFFERENTIAL.system(tmp_path), rnc.Log(parts), DIFFERENTIAL.unknown, "sensor")
    np.testing.assert_allclose(found.values, values(DIFFERENTIAL.true), atol=atol)


def test_headings_need_not_be_measured(tmp_path):
    log = DIFFERENTIAL.log(8)
    found = rnc.calibrate(DIFFERENTIAL.system(tmp_path), log, DIFFERENTIAL.unknown, "sensor", heading=False)
    assert (np.abs(found.values - values(DIFFERENTIAL.true)) < 3 * found.std).all()


@pytest.mark.skipif(not MEASURED.is_dir(), reason=f"measured logs are not in {MEASURED}")
class TestTricycle:
    """A real robot with encoders and an external tracker, 43 m; others report 0.8 to 1.4 m after their calibration."""

    @pytest.mark.parametrize(("unknown", "fit", "second"), [(UNKNOWN, 0.08, 0.13), ((*UNKNOWN, *DELAYS), 0.06, 0.1)])
    def test_its_open_loop_path(self, unknown, fit, second, tmp_path):
        log, system = rnc.Log.read(MEASURED / "tricycle" / "dataset.txt", COLUMNS), tricycle_system(tmp_path)
        assert rnc.calibrate(system, log, unknown, "laser").errors["fit"].mean < fit
        half = rnc.calibrate(system, log, unknown, "laser", held_out=0.5)
        assert half.errors["held out"].mean < second
        assert half.errors["held out, nominal"].mean > 2.0


@pytest.mark.parametrize("seed", [26, 33])
def test_a_log_that_hardly_shows_a_number_converges(seed, tmp_path):
    """A car that steers little: its track and wheelbase change their paths over short windows less than the noise."""
    found = rnc.calibrate(CAR.system(tmp_path), CAR.log(seed), CAR.unknown, "sensor", resolution=np.inf)
    assert (np.abs(found.values - list(CAR.true.values())) < 4 * found.std).all()


def test_the_error_of_a_right_model_is_the_noise_of_the_sensor(tmp_path):
    true = replace(TRICYCLE, true=TRICYCLE.nominal)
    found = rnc.compare(true.system(tmp_path), true.log(0), "sensor")
    assert list(found.errors) == [1.0, 10.0, np.inf]  # the log has 30 s
    for error in found.errors.values():
        assert error.mean == pytest.approx(0.005 * np.sqrt(np.pi / 2), rel=0.05)  # of the noise (Rayleigh)
    # The rear wheel is not measured: it rolls in any case, and only its lateral row can slip.
    assert list(found.slip) == ["rolling(front)", "lateral(front)", "lateral(rear)"]


def test_slip_is_that_of_the_closed_form(tmp_path):
    """A left wheel of another radius slips by the difference of the radii times its rate; nothing else slips."""
    other = replace(DIFFERENTIAL, true={**DIFFERENTIAL.nominal, "rl": 0.11})
    system, log = other.system(tmp_path), other.log(3, noise=0.0, ticks=0)
    motion = RollingMotion(system, log, (), "sensor")
    problem = PoseProblem(motion, log.channel("pose", "sensor"), True)
    _, slip = motion.slip(problem.base_poses(motion.time))
    slip = slip.reshape(-1, 2, 4).sum(axis=1)  # from pose to pose: between them, poses are interpolated
    whole = np.isfinite(slip).all(axis=1)
    assert whole.mean() > 0.99
    turned = np.diff(log.channel("position", "left_joint").at(motion.time[::2])[:, 0])
    slips = dict(zip(motion.used, slip.T, strict=True))
    np.testing.assert_allclose(slips["rolling(left)"][whole], 0.01 * turned[whole], atol=3e-6)
    for name in ("rolling(right)", "lateral(left)", "lateral(right)"):
        np.testing.assert_allclose(slips[name][whole], 0.0, atol=3e-6)


def test_the_replay_is_the_measured_path_of_a_right_model(tmp_path):
    true = replace(TRICYCLE, true=TRICYCLE.nominal)
    replay = rnc.compare(true.system(tmp_path), true.log(0, noise=0.0, ticks=0), "sensor").replay
    np.testing.assert_allclose(replay.predicted, replay.measured, atol=1e-4)
    np.testing.assert_allclose(replay.q[:, :2], replay.predicted[:, :2])


def test_fingers_that_are_coupled_to_each_other_only_need_no_log(tmp_path):
    log, cart = DIFFERENTIAL.log(0), DIFFERENTIAL.system(tmp_path)
    robot = cart.robot.attach(rnc.Robot.from_example("panda"), "base")
    carrying = rnc.NonholonomicSystem(robot, DIFFERENTIAL.constraints(DIFFERENTIAL.nominal))
    assert rnc.compare(carrying, log, "sensor").errors == rnc.compare(cart, log, "sensor").errors
