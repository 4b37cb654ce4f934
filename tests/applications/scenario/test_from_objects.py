"""Scenarios from Python objects: they run, what has a form in a file is saved and read back, the rest is named."""

import coal
import numpy as np
import pytest
from pydantic import TypeAdapter

import rnc_pin as rnc
from rnc_pin.applications.scenario.files import built_in_names
from rnc_pin.applications.scenario.from_objects import spelled
from rnc_pin.applications.scenario.schema.kinds import ActuatorItem, ConstraintItem, ForceItem, OutputItem
from rnc_pin.applications.scenario.schema.scenario import constraint_of, output_of
from rnc_pin.collision import Obstacle
from rnc_pin.control import ReducingOutputController, VelocityTracker
from rnc_pin.planning import MinimumJerk, RelativeMinimumJerk

GOAL = [0.5, 0.4, -0.3]
TRACKER = {"type": "reducing_outputs", "preset": "scaled"}


def arm(robot=None, constraints=None):
    robot = robot or rnc.Robot.from_urdf("space_robot.urdf")
    kinds = [rnc.MomentumConservation("platform")] if constraints is None else constraints
    system = rnc.NonholonomicSystem(robot, kinds, robot.joint_names[1:])
    return system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)], [rnc.JointPosition("platform")])


def reach(reduced, controller=TRACKER, settings=None, **more):
    references = {"primary": RelativeMinimumJerk(to=GOAL, duration=0.6)}
    q0 = reduced.robot.configuration({"joint_1": 0.1})
    objects = rnc.RunObjects(reduced, controller, q0, **{"references": references, **more})
    return rnc.Scenario.of(objects, 0.8, 0.002, settings=settings, name="reach")


def test_a_saved_scenario_is_the_same_run_to_the_bit(tmp_path):
    box = Obstacle(coal.Box(0.2, 0.3, 0.4), position=(9.0, 1.0, 0.5), yaw=0.3, name="crate", ignored_links=["platform"])
    shapes = [coal.Sphere(0.1), coal.Cylinder(0.1, 0.4), coal.Capsule(0.1, 0.4), rnc.collision.ground_shape()]
    others = [Obstacle(each, position=(9.0, k, -5.0), name=f"body {k}") for k, each in enumerate(shapes)]
    made = reach(
        arm(), obstacles=[box, *others], settings={"goal_tolerance": 0.01, "title": "a reach"}, v2_0=[0.1, 0, 0]
    )
    made.save(tmp_path / "reach.yaml")
    again = rnc.Scenario.load(tmp_path / "reach.yaml")
    assert again.raw == made.raw
    assert again.content.goal_tolerance == 0.01
    for one, other in zip(again.obstacles, made.obstacles, strict=True):
        assert (one.name, type(one.shape)) == (other.name, type(other.shape))
        assert one.placement(0.0).isApprox(other.placement(0.0), 1e-15)
    run, same = made.run(), again.run()
    for name in ("time", "q", "v2", "T", "x2_desired"):
        np.testing.assert_array_equal(getattr(run, name), getattr(same, name))
    assert run.verdict.word == same.verdict.word == "succeeded"
    np.testing.assert_allclose(run.x2[-1], GOAL, atol=0.01)


def test_a_controller_object_runs_as_simulate_does_and_is_named_on_save(tmp_path):
    reduced = arm()
    q0 = reduced.robot.configuration({"joint_1": 0.1})
    reference = MinimumJerk([0.1, 0.0, 0.0], GOAL, duration=0.6)
    tracker = VelocityTracker(ReducingOutputController(reduced, reference))
    made = reach(reduced, tracker, references={"primary": reference})
    expected = rnc.simulate(reduced, tracker, q0, 0.8, 0.002)
    np.testing.assert_array_equal(made.run().q, expected.q)
    assert made.controller is tracker
    assert made.references["primary"] is reference
    assert "VelocityTracker" in str(made)
    with pytest.raises(rnc.ConfigurationError) as caught:
        made.save(tmp_path / "reach.yaml")
    assert "reference.primary: a MinimumJerk has no form in a file" in str(caught.value)
    assert "controller: a VelocityTracker has no form in a file" in str(caught.value)
    assert not (tmp_path / "reach.yaml").exists()
    with pytest.raises(rnc.ConfigurationError, match="options need the form of a file"):
        made.with_options({"seed": 1})


def test_what_a_user_wrote_or_changed_is_named(tmp_path):
    row = np.array([[1.0, 0.9, 0.5, 0.25]])
    own = rnc.Pfaffian(lambda q: row, lambda q, v: 0.0 * row, names=["own"])
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    robot.model.gravity.linear = np.array([0.0, -1.0, 0.0])
    reduced = arm(robot, [own])
    made = reach(reduced, plant=rnc.ReducedPlant(reduced))
    assert set(made.without_form) == {"robot", "constraints", "plant"}
    assert made.run().verdict.word == "succeeded"
    with pytest.raises(rnc.ConfigurationError, match="constraints: a Pfaffian has no form in a file"):
        made.save(tmp_path / "reach.yaml")
    heavy = rnc.Robot.from_urdf("space_robot.urdf").with_masses({"link_3": 5.0})
    assert set(reach(arm(heavy)).without_form) == {"robot"}


def test_what_is_refused():
    reduced = arm()
    with pytest.raises(rnc.ConfigurationError, match=r"no role 'primry'; did you mean 'primary'\?"):
        reach(reduced, references={"primry": RelativeMinimumJerk(to=GOAL, duration=0.6)})
    with pytest.raises(rnc.ConfigurationError, match=r"reference\.primary: a MinimumJerk .* needs it"):
        reach(reduced, references={"primary": MinimumJerk([0.1, 0.0, 0.0], GOAL, duration=0.6)})
    with pytest.raises(rnc.ConfigurationError, match=r"controller\.type"):
        reach(reduced, {"type": "magic"})
    with pytest.raises(rnc.InputError, match="q0 has shape"):
        rnc.Scenario.of(rnc.RunObjects(reduced, TRACKER, [0.0]), 1.0)
    with pytest.raises(rnc.ConfigurationError, match="'tolerance' is not known"):
        reach(reduced, settings={"tolerance": 1.0})


def same(one, other):
    """Equal objects, with arrays and lists in place of tuples."""
    if type(one) is not type(other):
        return np.array_equal(np.asarray(one, dtype=object), np.asarray(other, dtype=object))
    fields = getattr(type(one), "__dataclass_fields__", None)
    if fields is None:
        return bool(np.array_equal(one, other)) if isinstance(one, np.ndarray | list | tuple) else one == other
    return all(same(getattr(one, name), getattr(other, name)) for name in fields)


@pytest.mark.parametrize("name", sorted(built_in_names()))
def test_parts_of_every_built_in_scenario_are_read_back(name):
    """Constraints, outputs, actuators and forces: what a file says, the file of the object says, too."""
    content = rnc.Scenario.load(name).content
    outputs = content.listed_outputs
    readers = (
        (ConstraintItem, constraint_of, content.constraints), (OutputItem, output_of, outputs),
        (ActuatorItem, TypeAdapter(ActuatorItem).validate_python, content.actuators),
        (ForceItem, TypeAdapter(ForceItem).validate_python, content.forces),
    )  # fmt: skip
    for item, read, kinds in readers:
        for kind in kinds:
            if not isinstance(kind, rnc.PrescribedMotion):  # its motion has no form
                assert same(read(spelled(item, kind)), kind), kind
