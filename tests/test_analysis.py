"""Growth vectors, redundancy classes and the report."""

import json

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.analysis import growth_vector
from systems import ALL, fire_truck, free_flying_panda, leaning_wheel, random_states, space_robot, tiago


def planar_model(name="vehicle"):
    model = pin.Model()
    model.name = name
    joint = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), 0.1 * np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("body", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    return model, joint


def unicycle():
    model, _ = planar_model()
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("body")], np.eye(3)[:, [0, 2]])
    return system.reduce([rnc.FrameSpeed("body"), rnc.FrameYaw("body")], [rnc.FramePosition("body", "xy")])


def trailers(count):
    """A unicycle with trailers hitched at each other's axles; growth (2, 3, 4, ...): Laumond 1993."""
    model, parent = planar_model()
    frames = ["body"]
    for k in range(1, count + 1):
        hitch = pin.SE3(np.eye(3), np.array([0.0 if k == 1 else -1.0, 0.0, 0.0]))
        parent = model.addJoint(parent, pin.JointModelRZ(), hitch, f"hitch_{k}")
        axle = pin.SE3(np.eye(3), np.array([-1.0, 0.0, 0.0]))
        model.appendBodyToJoint(parent, pin.Inertia(1.0, np.zeros(3), 0.1 * np.eye(3)), axle)
        model.addFrame(pin.Frame(f"axle_{k}", parent, 0, axle, pin.FrameType.OP_FRAME))
        frames.append(f"axle_{k}")
    edges = [rnc.NoSideSlip(frame) for frame in frames]
    system = rnc.NonholonomicSystem(rnc.Robot(model), edges, np.eye(model.nv)[:, [0, 2]])
    return system.reduce([rnc.FrameSpeed("body"), rnc.FrameYaw("body")])


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (unicycle, (2, 3)),
        (fire_truck, (3, 5, 6)),
        (space_robot, (3, 4)),
        (lambda: trailers(1), (2, 3, 4)),
        (lambda: trailers(2), (2, 3, 4, 5)),
        (lambda: trailers(3), (2, 3, 4, 5, 6)),
        (leaning_wheel, (3, 4, 5)),  # the height above the plane is holonomic
        (free_flying_panda, (7, 10)),  # linear momentum is holonomic: the centre of mass stays
        (tiago, (12, 13, 14)),  # the difference of the wheels' angles is the heading
    ],
    ids=["unicycle", "fire truck", "space robot", "1 trailer", "2 trailers", "3 trailers", "disk", "panda", "tiago"],
)
def test_growth_vector(make, expected):
    reduced = make()
    q, _ = random_states(reduced, 1, seed=11)[0]
    assert growth_vector(reduced, q) == expected


def test_first_bracket_is_the_commutator_of_flows():
    """Independent of any formula: along r1, r2, back along r1, back along r2."""
    from rnc_pin.simulation.lie_runge_kutta import LieRungeKutta4

    for reduced in (unicycle(), leaning_wheel()):
        model, integrator = reduced.robot.model, LieRungeKutta4(reduced.robot)
        q, _ = random_states(reduced, 1, seed=12)[0]
        h = 3e-3

        def flow(p, column, time, reduced=reduced, integrator=integrator):
            field = np.eye(reduced.r)[column]
            return integrator.step(lambda s, y: (reduced.terms(s, field).v, y), p, np.zeros(1), time)[0]

        end = q
        for column, time in ((0, h), (1, h), (0, -h), (1, -h)):
            end = flow(end, column, time)
        commutator = pin.difference(model, q, end) / h**2
        R = reduced.terms(q, np.zeros(reduced.r)).R
        from rnc_pin.analysis.growth import _frame_bracket

        along_0, along_1 = (reduced.basis_rate(q, R[:, i])[1] for i in (0, 1))
        bracket = along_0[:, 1] - along_1[:, 0] + _frame_bracket(model)(R[:, 0], R[:, 1])
        np.testing.assert_allclose(commutator, bracket, atol=0.02 * (1 + np.abs(bracket).max()))


def test_the_space_robot_is_class_1():
    report = rnc.analyze(space_robot(), primary=["tip_x", "tip_y"], redundant=["joint_1"])
    assert report.redundancy_class == "1"
    assert report.redundancy["tracked"] == ("platform",)
    assert report.completely_nonholonomic


def test_the_fire_truck_is_class_2s_not_2():
    """The paper says 2; the rate of the rear steering moves nothing, its angle does."""
    report = rnc.analyze(fire_truck(), redundant=["rear_steering"])
    assert report.redundancy_class == "2s"
    assert report.redundancy["A4_singular_values"] == [0.0, 0.0]
    assert report.redundancy["d(A3 v21)/dx22"] > 0.1
    assert report.redundancy["tracked"] == ("trailer_yaw",)
    assert report.redundancy["driven"] == ("tractor_x", "tractor_y", "tractor_yaw")


def turreted():
    """A unicycle with a turret, whose heading is tracked by its own joint."""
    model, joint = planar_model("turreted")
    turret = model.addJoint(joint, pin.JointModelRZ(), pin.SE3.Identity(), "turret")
    model.appendBodyToJoint(turret, pin.Inertia(0.5, np.zeros(3), 0.1 * np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("gun", turret, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("body")], np.eye(4)[:, [0, 2, 3]])
    return system.reduce(
        [rnc.FrameSpeed("body"), rnc.FrameYaw("body"), rnc.JointPosition("turret")],
        [rnc.FramePosition("body", "xy"), rnc.FrameYaw("gun")],
    )


def test_a_unicycle_with_a_turret_is_class_2():
    """The turret's own heading is tracked by its joint, position by the base alone: A6 = 0, A5 free of x22."""
    reduced = turreted()
    report = rnc.analyze(reduced, redundant=["turret"])
    assert report.redundancy_class == "2"
    assert report.redundancy["tracked"] == ("gun_yaw",)


def test_nothing_redundant_is_no_class_and_says_why():
    report = rnc.analyze(unicycle())
    assert report.redundancy_class is None
    assert report.redundancy["reason"] == "no redundant output"


@pytest.mark.parametrize("name", ALL)
def test_lemma_1_holds_in_the_report_and_it_is_json(name):
    report = rnc.analyze(ALL[name](), samples=16)
    assert report.lemma1_holds
    assert report.lemma1["Hdot - V - V^T"] < 1e-8
    content = json.loads(json.dumps(report.to_dict()))
    assert content["condition"]["min"] <= content["condition"]["median"] <= content["condition"]["max"]
    assert content["actuation_rank"] == content["r"]


def test_lemma_1_is_denied_to_wrong_rates():
    """The residuals can fail: a constraint whose rate is a lie."""
    robot = rnc.Robot.from_urdf("space_robot.urdf")

    def rows(q):
        return np.array([[1.0, np.sin(q[1]), 0.2, 0.1]])

    honest = rnc.Pfaffian(rows, lambda q, v: np.array([[0.0, np.cos(q[1]) * v[1], 0.0, 0.0]]))
    lying = rnc.Pfaffian(rows, lambda q, v: np.zeros((1, 4)))
    outputs = [rnc.JointPosition(f"joint_{i}") for i in (1, 2, 3)]
    holds = [
        rnc.analyze(rnc.NonholonomicSystem(robot, [kind]).reduce(outputs), samples=8).lemma1_holds
        for kind in (honest, lying)
    ]
    assert holds == [True, False]
