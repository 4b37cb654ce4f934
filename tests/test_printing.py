"""Things print themselves: short in a terminal, a table in a notebook, whatever their names hold."""

import re
from importlib.metadata import version
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, add_frame
from rnc_pin import control
from rnc_pin.planning import Hold
from systems import bicycle, space_robot


def cart() -> rnc.Robot:
    """A body that slides in the plane, with two knife edges on one axle; its names are not fit for HTML."""
    model = pin.Model()
    model.name = "<cart> & 'co'"
    joint = add_body(model, "root_joint", "Planar", 2.0)
    for name, y in (("left<b>", 0.2), ("right<b>", -0.2)):
        add_frame(model, name, joint, (0.0, y, 0.0))
    return rnc.Robot(model)


@pytest.fixture(scope="module")
def system():
    edges = [rnc.NoSideSlip("left<b>"), rnc.NoSideSlip("right<b>")]
    return rnc.NonholonomicSystem(cart(), edges, [rnc.FrameForce("left<b>", "x"), rnc.FrameTorque("left<b>", "z")])


@pytest.fixture(scope="module")
def reduced(system):
    return system.reduce([rnc.FrameSpeed("left<b>"), rnc.FrameYaw("left<b>")], [rnc.FramePosition("left<b>", "xy")])


@pytest.fixture(scope="module")
def run(reduced):
    q0 = reduced.robot.configuration()
    options = rnc.SimulationOptions(meta={"scenario": "<a> & b"})
    return rnc.free_motion(reduced, q0, [1.0, 0.5], 1.0, 0.1, np.array([2.0, 0.0]), options=options)


def cells(thing) -> list[list[str]]:
    """Rows of the table that a notebook shows, without markup; refuses what is not well formed."""
    html = thing._repr_html_()
    whole = ElementTree.fromstring(f"<body>{html}</body>")
    return [["".join(cell.itertext()) for cell in row] for row in whole.iter("tr")]


def test_a_robot():
    assert str(space_robot().robot).splitlines() == [
        "Robot 'space_robot': 4 degrees of freedom, fixed base",
        "  joints: platform, joint_1, joint_2, joint_3",
    ]
    assert str(cart()).splitlines()[0] == "Robot '<cart> & 'co'': 3 degrees of freedom, planar base"
    assert "free base" in str(bicycle().robot)


def test_a_system_says_which_rows_it_dropped_and_why(system):
    assert str(system).splitlines() == [
        "NonholonomicSystem of '<cart> & 'co'': 3 degrees of freedom less 1 independent row leave 2",
        "  rows kept: no_side_slip(left<b>.y)",
        "  rows dropped: no_side_slip(right<b>.y) [a combination of no_side_slip(left<b>.y)]",
        "  actuators: force(left<b>.x), torque(left<b>.z)",
    ]


def test_a_reduced_model_says_its_outputs_too(reduced):
    lines = str(reduced).splitlines()
    assert lines[0] == "ReducedModel of '<cart> & 'co'': 3 degrees of freedom less 1 independent row leave 2"
    assert "  reducing: left<b>_speed_x [quasi-velocity], left<b>_yaw" in lines
    assert "  vertical: left<b>_x, left<b>_y" in lines
    assert "vertical(rear) [holonomic]" in str(bicycle())


def test_a_notebook_shows_tables(system, reduced):
    dropped = ["rows dropped", "no_side_slip(right<b>.y)", "a combination of no_side_slip(left<b>.y)"]
    assert dropped in cells(system)
    assert dropped in cells(reduced)
    assert ["vertical", "left<b>_x, left<b>_y"] in cells(reduced)


def test_a_run(run):
    assert repr(run) == "Trajectory of '<a> & b': completed, 1 s in 11 samples"
    shown = cells(run)
    assert ["largest input", "force(left<b>.x)", "2 N"] in shown
    assert any(row[-2] == "singular value of E, smallest" for row in shown)


def test_a_run_that_failed_says_why(reduced):
    with pytest.raises(rnc.DivergenceError) as caught:
        rnc.free_motion(reduced, reduced.robot.configuration(), [1.0, 0.0], 1.0, 0.1, np.array([1e5, 0.0]))
    headline, message, *_ = str(caught.value.trajectory).splitlines()
    assert re.fullmatch(r"Trajectory: diverged, [\d.]+ s in \d+ samples", headline)
    assert message == f"  message: {caught.value}"
    assert ["message", str(caught.value)] in cells(caught.value.trajectory)


def test_no_name_is_taken_for_markup(system, reduced, run):
    for thing in (system, reduced, run, reduced.robot):
        html = thing._repr_html_()
        assert not re.search(r"<b>_|<cart>|<a>| & ", html)
        assert html.count("<b>") == 1


def test_a_task_and_controllers_say_their_settings():
    reduced = space_robot()
    task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
    said = "Task(primary=[tip_x, tip_y], redundant=[joint_1], vertical=[platform])"
    assert repr(task) == said
    target = control.RedundancyController(task, Hold(np.zeros(2)), Hold(np.zeros(1)), k3=1.5)
    inner = f"RedundancyController(task={said}, primary=Hold, vertical=Hold, k3=1.5, k21=2)"
    assert repr(target) == inner
    gains = control.VelocityGains(k=np.array([1.0, 2.5, 3.0]), beta=10.0, sigma=0.1)
    tracker = control.VelocityTracker(target, gains)
    said = "VelocityGains(k=[1.  2.5 3. ], beta=10, sigma=0.1, dead_zone=0)"
    assert repr(tracker) == f"VelocityTracker(target={inner}, gains={said}, gravity_compensation=0)"
    parts = [(tracker, np.array([0, 1, 2]))]
    assert repr(control.SplitController(parts, 3)) == f"SplitController(parts=[{tracker!r}])"


def test_every_controller_prints_itself():
    kinds = [kind for kind in vars(control).values() if isinstance(kind, type)]
    for kind in kinds:
        if hasattr(kind, "step") and not getattr(kind, "_is_protocol", False):
            assert kind.__repr__ is not object.__repr__, kind.__name__


def test_the_version_is_the_installed_one():
    assert rnc.__version__ == version("rnc_pin")
