"""Regressors of unknown wheels and masses, and estimators over them: refusals in full, thresholds from both sides."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.control import (
    Command,
    Estimator,
    MomentumRegressor,
    UncertainController,
    UncertainRedundancyController,
    UnknownMass,
    UnknownRadius,
    UnknownTrack,
    VelocityTarget,
    WheelRegressor,
)
from rnc_pin.control.estimator import EstimatorState
from rnc_pin.control.wheel_regressor import _axles
from rnc_pin.model.measurement import Measurement
from tolerances import ROUNDING

# ---------------------------------------------------------------------- wheels

TURNED = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.4, 0.5), np.array([0.02, -0.03, 0.05]))


def cart(base=None, left=(0.1, 0.3, 0.2), right=(0.1, -0.3, 0.2), off=(0.0, 0.0, 0.0)):
    """Two wheels on a body; the left one's frame is off the axis of its joint by this much."""
    model = pin.Model()
    model.name = "cart"
    body = model.addJoint(0, base or pin.JointModelPX(), pin.SE3.Identity(), "body")
    model.appendBodyToJoint(body, pin.Inertia(5.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    for name, place, aside in (("left", left, off), ("right", right, (0.0, 0.0, 0.0))):
        joint = model.addJoint(body, pin.JointModelRY(), pin.SE3(np.eye(3), np.array(place)), f"{name}_joint")
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), 0.01 * np.eye(3)), pin.SE3.Identity())
        model.addFrame(pin.Frame(name, joint, 0, pin.SE3(np.eye(3), np.array(aside)), pin.FrameType.OP_FRAME))
    return rnc.Robot(model)


def rolling(robot, radii=(0.2, 0.25)):
    wheels = [rnc.RollingWheel(wheel, radius) for wheel, radius in zip(("left", "right"), radii, strict=True)]
    return rnc.NonholonomicSystem(robot, wheels).reduce()


def test_a_track_that_no_row_depends_on_is_refused():
    """On a cart that only slides nothing tells how far apart its wheels are, though their radii enter."""
    reduced = rolling(cart())
    unknown = [UnknownRadius(["right"]), UnknownTrack(["left", "right"]), UnknownRadius(["left"])]
    with pytest.raises(rnc.ConfigurationError) as caught:
        WheelRegressor(reduced, unknown)
    assert str(caught.value) == "no independent constraint row depends on the track of left, right"
    radii = WheelRegressor(reduced, unknown[::2])
    y, Y = radii.regress(np.array([0.4, 1.0, 2.0]), np.array([0.5, 7.0, 11.0]))
    order = [("rolling(left)", "rolling(right)").index(name) for name in radii.predicted]
    signs = np.sign(y)
    np.testing.assert_allclose(np.abs(y), 0.5)
    np.testing.assert_allclose(signs[:, None] * Y, np.array([[0.0, 7.0], [11.0, 0.0]])[order], atol=ROUNDING)
    one = WheelRegressor(reduced, unknown[2:])
    assert one.predicted == ("rolling(left)",)
    assert one.regress(np.zeros(3), np.array([0.5, 7.0, 11.0]))[1].shape == (1, 1)


def test_an_axle_is_one_whichever_wheel_is_named_first():
    """The centre of each wheel is its middle and half the track to its own side; the joint stands beside it."""
    robot = cart(pin.JointModelFreeFlyer(), left=(0.15, 0.35, 0.22), right=(0.1, -0.25, 0.2), off=(0.0, 0.07, 0.0))
    centres = {"left": np.array([0.15, 0.42, 0.22]), "right": np.array([0.1, -0.25, 0.2])}
    track = np.linalg.norm(centres["left"] - centres["right"])
    for pair in (("left", "right"), ("right", "left")):
        axles = _axles(robot, 4, *pair)
        assert tuple(axles) == pair
        for wheel, axle in axles.items():
            assert (axle.column, axle.joint, axle.carrier) == (4, robot.joint_id(f"{wheel}_joint"), 1)
            np.testing.assert_allclose(axle.middle + track * axle.side, centres[wheel], atol=1e-15)
            np.testing.assert_allclose(axle.centre, [0.0, 0.07, 0.0] if wheel == "left" else np.zeros(3), atol=1e-15)
            assert np.linalg.norm(axle.side) == pytest.approx(0.5)


def assert_track(robot, wheels, exists, otherwise):
    """Both wheels have one axle, or are refused in these words."""
    if exists:
        assert set(_axles(robot, 0, *wheels)) == set(wheels)
        return
    with pytest.raises(rnc.ConfigurationError) as caught:
        _axles(robot, 0, *wheels)
    first, second = wheels
    assert str(caught.value) == f"unknown track: wheels '{first}' and '{second}' {otherwise}"


def test_wheels_have_a_track_from_a_billionth_of_a_metre_on():
    here = np.array([0.1, 0.3, 0.2])
    for apart in (1.01e-9, 0.99e-9):
        robot = cart(left=here, right=here + np.array([0.0, 0.0, apart]))
        words = "have the same position: the direction of their axle is undefined"
        assert_track(robot, ("left", "right"), apart > 1e-9, words)
    for aside in ((0.99e-9, 0.4, 0.0), (0.0, -0.4, -0.99e-9), (1.01e-9, 0.4, 0.0), (0.0, 0.0, -1.01e-9)):
        words = "have no fixed track: frame 'left' is not on the axis of its joint"
        assert_track(cart(off=aside), ("right", "left"), max(map(abs, aside[::2])) < 1e-9, words)


@pytest.mark.parametrize("joint", [pin.JointModelSpherical(), pin.JointModelPlanar(), pin.JointModelPY()])
def test_a_wheel_that_does_more_than_turn_about_its_axle_has_no_fixed_track(joint):
    """On a ball it turns about all axes, in a plane it moves, on a rail it only slides."""
    model = cart().model.copy()
    ball = model.addJoint(1, joint, TURNED, "ball")
    model.appendBodyToJoint(ball, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("loose", ball, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    with pytest.raises(rnc.ConfigurationError, match="frame 'loose' is not on the axis of its joint"):
        _axles(rnc.Robot(model), 0, "left", "loose")


def test_two_wheels_of_one_joint_or_of_two_bodies_have_no_track():
    model = cart().model.copy()
    model.addFrame(pin.Frame("outer", 2, 0, pin.SE3(np.eye(3), np.array([0.0, 0.1, 0.0])), pin.FrameType.OP_FRAME))
    arm = model.addJoint(1, pin.JointModelRZ(), pin.SE3.Identity(), "arm")
    far = model.addJoint(arm, pin.JointModelRY(), TURNED, "far_joint")
    model.appendBodyToJoint(far, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("far", far, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    robot = rnc.Robot(model)
    for pair in (("left", "outer"), ("outer", "left"), ("left", "far"), ("far", "right")):
        with pytest.raises(rnc.ConfigurationError) as caught:
            _axles(robot, 0, *pair)
        words = "do not turn on joints of their own on one body: they have no fixed track"
        assert str(caught.value) == f"unknown track: wheels '{pair[0]}' and '{pair[1]}' {words}"


# ---------------------------------------------------------------------- masses


def arm(base=None, light=False):
    """A body that moves freely, or turns or slides, with three bodies in a chain on it: a turn, a ball, a slide."""
    model, generator = pin.Model(), np.random.default_rng(6)
    model.name, model.gravity.linear = "arm", np.zeros(3)
    parent = model.addJoint(0, base or pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    kinds = (("hip", pin.JointModelRX()), ("knee", pin.JointModelSpherical()), ("foot", pin.JointModelPZ()))
    for mass, (name, kind) in zip((7.0, 2.0, 3.0, 0.0 if light else 1.5), (("", None), *kinds), strict=True):
        if kind is not None:
            place = pin.SE3(pin.exp3(generator.uniform(-1, 1, 3)), generator.uniform(-0.5, 0.5, 3))
            parent = model.addJoint(parent, kind, place, name)
        inertia = np.diag([0.4, 0.5, 0.6]) * mass
        model.appendBodyToJoint(parent, pin.Inertia(mass, generator.uniform(-0.1, 0.1, 3), inertia), pin.SE3.Identity())
    if light:
        tip = model.addJoint(parent, pin.JointModelRY(), pin.SE3.Identity(), "tip")
        model.appendBodyToJoint(tip, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    return rnc.Robot(model)


@pytest.mark.parametrize("base", [None, pin.JointModelPlanar(), pin.JointModelRZ(), pin.JointModelPX()])
def test_momentum_is_linear_in_masses_and_the_base_moves_as_it_is_conserved(base):
    """By the kinetic energy of a robot of other masses: ``dE/dv`` of the base is zero at the base's predicted rate."""
    robot = arm(base)
    unknown = [UnknownMass("foot", 0.5), UnknownMass("knee", 3.0)]
    regressor = MomentumRegressor(robot, "body", unknown)
    assert regressor.units == ("0.5 kg", "3 kg")
    p = np.array([1.9, 0.3])
    model = robot.model.copy()
    for joint, mass in (("foot", 0.95), ("knee", 0.9)):
        index = robot.joint_id(joint)
        old = model.inertias[index]
        model.inertias[index] = pin.Inertia(mass, old.lever, old.inertia * mass / old.mass)
    data, rows, generator = model.createData(), robot.velocity_indices("body"), np.random.default_rng(2)
    for _ in range(3):
        q, v = robot.random_configuration(generator), generator.normal(size=robot.nv)
        before = v.copy()
        W0, W = regressor.predict(q, v)
        y, Y = regressor.regress(q, v)
        np.testing.assert_array_equal(v, before)
        np.testing.assert_array_equal(Y, W)
        np.testing.assert_array_equal(y, v[rows] - W0)
        known = robot.model.copy()  # rates are those of the momentum under the inertia of the known bodies alone
        for joint in ("foot", "knee"):
            known.inertias[robot.joint_id(joint)] = pin.Inertia.Zero()
        A = pin.crba(known, known.createData(), q)[rows, rows]
        momentum = np.array(
            [
                (pin.computeKineticEnergy(model, data, q, v + e) - pin.computeKineticEnergy(model, data, q, v - e)) / 2
                for e in np.eye(robot.nv)[rows]
            ]
        )
        np.testing.assert_allclose(A @ (y - Y @ p), momentum, atol=1e-9)


def test_masses_that_cannot_be_estimated_are_refused():
    robot = arm(light=True)
    for unknown, error, words in (
        ([], rnc.ConfigurationError, "name at least one body of unknown mass"),
        ([UnknownMass("hip"), UnknownMass("foot")], rnc.ModelError, "body behind joint 'foot' has no mass to estimate"),
    ):
        with pytest.raises(error) as caught:
            MomentumRegressor(robot, "body", unknown)
        assert str(caught.value) == words
    regressor = MomentumRegressor(robot, "body", [UnknownMass("hip"), UnknownMass("tip")])
    assert regressor.names == ("mass behind hip", "mass behind tip")
    alone = rnc.Robot.from_urdf("space_robot.urdf")
    every = [UnknownMass(name) for name in alone.joint_names]
    with pytest.raises(rnc.ConfigurationError) as caught:
        MomentumRegressor(alone, "platform", every)
    assert str(caught.value) == "no body of known mass turns with joint 'platform'"


# ---------------------------------------------------------------------- over an estimator


class Believer:
    """An estimator that is written down: its model has kinematics of its own, and allocates three times the force."""

    def __init__(self):
        self.model = SimpleNamespace(at=self._at)

    def _at(self, q, v2):
        return SimpleNamespace(
            A_star=np.array([[v2[0], 2.0]]),
            A_star_dot=np.array([[q[0], 4.0]]),
            input_matrix=np.diag([5.0, 6.0]),
            allocate=lambda F: 3.0 * F,
        )

    def describe(self):
        return {"alpha": 0.5}

    def initial_state(self):
        return EstimatorState(None, np.array([1.0]))

    def step(self, t, measurement, state):
        return EstimatorState(t, state.p + 1.0), np.array([0.25])


class Watcher:
    """A controller that remembers what it is shown, and commands what it was made with."""

    def __init__(self, **command):
        self.command, self.shown = command, []

    def initial_state(self, measurement):
        self.shown.append(measurement)
        return 4

    def step(self, t, measurement, state):
        self.shown.append(measurement)
        return Command(**self.command), state + 1


@pytest.mark.parametrize("by_force", [True, False])
def test_a_controller_under_estimates_sees_their_kinematics_and_is_allocated_by_them(by_force):
    force = np.array([1.0, -2.0])
    inner = Watcher(F=force, v2_desired=force) if by_force else Watcher(T=force)
    law = UncertainController(Believer(), inner)
    m = Measurement(
        q=np.array([7.0]), v2=np.array([8.0, 9.0]), A_star=np.zeros((1, 2)), residual=np.ones(1), input_deficit=force
    )
    command, state = law.step(0.5, m, law.initial_state(m))
    assert command.F is None
    assert command.T.tolist() == ([3.0, -6.0] if by_force else [1.0, -2.0])
    assert command.v2_desired is (force if by_force else None)
    assert (command.estimates.tolist(), command.prediction_error.tolist()) == ([2.0], [0.25])
    assert (state.estimator.time, state.estimator.p.tolist(), state.controller) == (0.5, [2.0], 5)
    assert len(inner.shown) == 2
    for seen in inner.shown:
        assert (seen.A_star.tolist(), seen.A_star_dot.tolist()) == ([[8.0, 2.0]], [[7.0, 4.0]])
        assert seen.force_deficit.tolist() == [5.0, -12.0]
        assert seen.residual is None
        assert seen.input_deficit is force
    assert law.describe() == {"type": "UncertainController", "alpha": 0.5, "controller": {"type": "Watcher"}}


def test_an_estimator_has_the_settings_of_the_documentation():
    reduced = rolling(cart())
    regressor = WheelRegressor(reduced, [UnknownRadius(["left"]), UnknownRadius(["right"])])
    estimator = Estimator(reduced, regressor, [0.3, 20.0])
    names = ("radius of left", "radius of right")
    said = {"alpha": 1.0, "dead_zone": 0.0, "initial": dict(zip(names, (0.3, 20.0), strict=True))}
    assert estimator.describe() == {**said, "bounds": [[0.05, 0.05], [20.0, 20.0]]}
    inner = SimpleNamespace(
        describe=lambda: {"type": "Inner", "k3": 4.0}, step=lambda t, m, s: (VelocityTarget(t, m), s)
    )
    law = UncertainRedundancyController(reduced, inner, regressor, [0.3, 20.0])
    assert law.describe() == {"type": "UncertainRedundancyController", "k3": 4.0, **estimator.describe()}
    m = reduced.measured(np.array([0.4, 1.0, 2.0]), np.array([0.5, 7.0, 11.0]))
    state = law.initial_state(m)
    assert (state.time, state.p.tolist()) == (None, [0.3, 20.0])
    target, after = law.step(0.5, m, state)
    assert (target.v2, after.time, target.estimates is after.p) == (0.5, 0.5, True)
    y, Y = regressor.regress(m.q, m.v)
    np.testing.assert_allclose(target.prediction_error, y - Y @ [0.3, 20.0])
    guess = law.estimator.model.at(m.q, m.v2)
    np.testing.assert_array_equal(target.v2_dot.A_star, guess.A_star)
    np.testing.assert_array_equal(after.p, [0.3, 20.0])  # no time has passed before the first sample
    later, last = law.step(0.75, m, after)
    assert later.prediction_error.tolist() == target.prediction_error.tolist()
    assert (np.abs(last.p - [0.3, 20.0]) > 1e-3).all()
    # Each radius has a row of its own: ``p + s Y E / (1 + s Y^2)``, within the bounds.
    s, slope = 0.25, np.abs(Y).max(axis=0)
    wanted = np.array([0.3, 20.0]) + s * (Y.T @ target.prediction_error) / (1 + s * slope**2)
    np.testing.assert_allclose(last.p, np.clip(wanted, 0.05, 20.0), rtol=1e-12)


def test_an_estimated_model_believes_what_it_is_told_and_leaves_the_given_one_alone():
    """Radii and tracks of the copies alone; each call changes one and the same object."""
    reduced = rolling(cart(pin.JointModelPlanar()))
    regressor = WheelRegressor(reduced, [UnknownTrack(["right", "left"]), UnknownRadius(["right"])])
    estimated = regressor.estimated(reduced)
    q, v2 = np.array([0.2, -0.1, 0.6, 0.8, 0.3, 0.4])[: reduced.robot.nq], np.array([0.7, -0.4])
    before = reduced.measure(q, v2)
    model = estimated.at(np.array([0.9, 0.33]))
    other = rolling(cart(pin.JointModelPlanar(), (0.1, 0.45, 0.2), (0.1, -0.45, 0.2)), (0.2, 0.33))
    v = other.velocity(q, v2)
    np.testing.assert_allclose(model.constraint_residual(q, v), 0.0, atol=1e-12)
    assert np.abs(reduced.constraint_residual(q, v)).max() > 1e-3
    assert estimated.at(np.array([0.6, 0.25])) is model
    np.testing.assert_allclose(model.constraint_residual(q, before.v), 0.0, atol=1e-12)
    np.testing.assert_array_equal(reduced.measure(q, v2).v, before.v)
