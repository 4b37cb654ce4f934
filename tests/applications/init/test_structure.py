"""Structure decides what a robot is: axle lines, motors, what carries what; names only help, and options overrule."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from driven_bases import KINDS, turret
from rnc_pin.applications.init import DraftOptions
from rnc_pin.applications.init.evidence import Alternative, named_as_driven
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.constraints import MomentumConservation
from rnc_pin.errors import ConfigurationError, ConstraintError, ModelError
from rnc_pin.model import NonholonomicSystem
from rnc_pin.robots import Robot
from rnc_pin.simulation import ground_paths
from urdf_parts import BOX, caster, joint, link, pivot, plugin, robot, transmissions, wheel

pytestmark = [pytest.mark.filterwarnings("ignore::rnc_pin.ModelWarning"), pytest.mark.usefixtures("brief")]


def moved(folder, **options):
    """Distance that the base moves in 2 s of the drafted run [m]."""
    run = execute(Scenario.load(f"{folder}/unit.yaml", {"simulation.duration": 2, "simulation.dt": 0.01, **options}))
    assert run.error is None
    q = run.trajectory.q
    return float(np.linalg.norm(q[-1, :2] - q[0, :2]))


def of(content, kind):
    return [each[kind] for each in content["constraints"] if kind in each]


def pair(name, parent, x, y=0.2, z=0.0, **more):
    """A wheel on the left, with ``_l`` after the name, and one on the right."""
    return "".join(wheel(f"{name}_{side}", parent, (x, sign * y, z), **more) for side, sign in (("l", 1), ("r", -1)))


def knuckles(name, front, x, y=0.2, parent="base", toe=0.0, lean=0.0):
    """Two pivots, and a wheel on each."""
    parts = []
    for side, sign in (("l", 1), ("r", -1)):
        parts.append(pivot(f"{name}_{side}", parent, (x, sign * y, 0), lean=sign * lean))
        parts.append(wheel(f"{front}_{side}", f"{name}_{side}", (0, 0, 0), toe=-sign * toe))
    return "".join(parts)


def car(offset=0.0, toe=0.0, lean=0.0):
    """A car of 0.55 m: offset of one wheel along the car [m], toe-in and lean of the kingpins [rad]."""
    rear = wheel("rear_l", "base", (-0.275 + offset, 0.2, 0)) + wheel("rear_r", "base", (-0.275, -0.2, 0))
    return robot(link("base", 10.0, BOX), rear, knuckles("knuckle", "front", 0.275, toe=toe, lean=lean))


@pytest.mark.parametrize(("offset", "toe", "lean"), [
    (0.0, 0.0, 0.0), (1e-4, 1e-4, 5e-4), (1e-3, 1e-3, 2e-3), (0.0, 3e-3, 0.03), (1e-3, 0.01, 0.03),
])  # fmt: skip
def test_workmanship_changes_no_car(offset, toe, lean, drafted, tmp_path):
    """Errors of a workshop. Each axle line has one lateral row: two, and the Ackermann row, would lock the car."""
    kind, content, _ = drafted(car(offset, toe, lean))
    assert kind == "planar: 4 wheels, steered like a car"
    assert content["task"]["primary"] == ["base_speed_x", "knuckle_l_joint"]
    assert [each.get("lateral", True) for each in of(content, "rolling_wheel")] == [True, False, True, False]
    text = (tmp_path / "unit.yaml").read_text()
    assert not any(word in text for word in ("nearly dependent", "Assumed", "CHECK"))
    if toe == 0.01:
        options = {"reference.primary.minimum_jerk.duration": 1.5, "controller.tracker": "computed_torque"}
        assert moved(tmp_path, **options) == pytest.approx(0.5, rel=0.05)


def truck(load_effort=10.0, extra=""):
    """A reach truck: two wheels under the load, and one steered wheel behind."""
    drive = pivot("steer", "base", (-0.5, 0, 0)) + wheel("drive", "steer", (0, 0, 0))
    return robot(link("base", 50.0, BOX), pair("load", "base", 0.5, 0.3, effort=load_effort), drive, extra)


@pytest.mark.parametrize(("given", "confidence"), [
    ({"extra": transmissions("drive_joint", "steer_joint")}, 0.95),
    ({"extra": plugin("libtricycle.so", "drive_joint", "steer_joint")}, 0.95),
    ({"load_effort": 0.0}, 0.8),
    ({"load_effort": None}, 0.8),
    ({}, 0.5),
    ({"option": True}, 0.95),
], ids=["transmissions", "plugin", "effort 0", "effort", "name", "option"])  # fmt: skip
def test_the_driven_wheel_may_be_the_steered_one(given, confidence, drafted, tmp_path):
    option = {"driven": ["drive_joint"]} if given.pop("option", False) else {}
    kind, content, decided = drafted(truck(**given), **option)
    assert kind == "planar: 3 wheels, steered like a car"
    assert content["actuators"] == ["drive_joint", "steer_joint"]
    found = decided["Which wheels are driven?"]
    assert (found.answer, found.confidence) == ("drive_joint", confidence)
    assert found.is_open == (confidence < 0.6)
    assert moved(tmp_path) > 0.05


@pytest.mark.parametrize(("text", "joint"), [(car(), "knuckle_l_joint"), (truck(), "steer_joint")])
def test_effort_and_velocity_0_of_a_steering_joint_are_a_gap_of_the_file(text, joint, drafted, tmp_path):
    """As CAD exporters write them. Front wheels beside their kingpins could steer by their torques, too."""
    text = re.sub(r'(name="(?:knuckle|steer).*?)effort="10.0" velocity="20"', r'\1effort="0" velocity="0"', text)
    text = re.sub(r'(child link="front_(?:l|r)"/><origin xyz="0 )0', r"\g<1>0.06", text)
    _, content, _ = drafted(text, driven=["front_l_joint", "front_r_joint"] if "front_l" in text else ["drive_joint"])
    assert joint in content["actuators"]
    said = " ".join((tmp_path / "unit.yaml").read_text().replace("# ", "").split())
    assert f"driven without a limit, CHECK: {joint}" in said
    assert execute(Scenario.load(str(tmp_path / "unit.yaml"), {"simulation.duration": 1})).trajectory.verdict.succeeded


def test_options_name_joints_of_the_file(drafted):
    with pytest.raises(ModelError, match="--driven drive_join: no joint 'drive_join'; did you mean 'drive_joint'"):
        drafted(truck(), driven=("drive_join",))


@pytest.mark.parametrize(("text", "expected"), [
    ('<transmission><type/><joint name="a"><hardwareInterface/></joint></transmission>', {"a"}),
    ('<ros2_control><joint name="a"><command_interface name="effort"/></joint></ros2_control>', {"a"}),
    ('<ros2_control><joint name="a"><state_interface name="position"/></joint></ros2_control>', set()),
    ('<gazebo><plugin filename="diff"><left_joint>a</left_joint><right_joint>b</right_joint></plugin></gazebo>',
     {"a", "b"}),
    ('<gazebo><plugin filename="x"><joint_name>a, b</joint_name><torque>a</torque></plugin></gazebo>', {"a", "b"}),
    ('<gazebo><plugin filename="libgazebo_ros_joint_state_publisher.so"><jointName>a</jointName></plugin></gazebo>',
     set()),
    ('<transmission><joint name="stranger"/></transmission>', set()),
])  # fmt: skip
def test_joints_that_a_file_drives(text, expected):
    joints = '<joint name="a"/><joint name="b"/>'
    named, is_list = named_as_driven(ElementTree.fromstring(f"<robot>{joints}{text}</robot>"))
    assert (set(named), is_list) == (expected, bool(expected) and "plugin" not in text)


def test_options_of_an_alternative_are_choices():
    for choices, command, expected in (
        ({"driven": ["b", "c"]}, "--driven b --driven c", {"driven": ("a", "b", "c")}),
        ({"balance": False}, "--no-balance", {"balance": False}),
        ({"rollers": True}, "--rollers", {"rollers": True}),
        ({"base": "planar"}, "--base planar", {"base": "planar"}),
    ):
        assert Alternative("other", choices).command == command
        assert DraftOptions(driven=("a",)).with_choices(choices) == DraftOptions(**{"driven": ("a",), **expected})


def turret_on_balls(carrier):
    """The body or the turret stands on three balls, each with a joint about one axis."""
    body = link("body", 20.0, '<box size="0.5 0.5 0.2"/>', at="0 0 0.2")
    parts = [body, pivot("turn", "body", (0, 0, 0.1), turns_round=True)]
    for k, (x, y) in enumerate(((0.3, 0.0), (-0.15, 0.25), (-0.15, -0.25))):
        at = (x, y, 0.05 if carrier == "body" else -0.05)
        parts += [link(f"b{k}", 0.1, '<sphere radius="0.05"/>'), joint(f"b{k}_joint", carrier, f"b{k}", at, effort=0.0)]
    return robot(*parts, pair("drive", "turn", 0.0, 0.15), transmissions("turn_joint", *DRIVE))


DRIVE = ["drive_l_joint", "drive_r_joint"]


def test_one_steered_wheel_on_casters_does_not_hold_the_heading(drafted, tmp_path):
    parts = [link("base", 20.0, BOX), pivot("steer", "base", (0.5, 0, 0.05)), wheel("front", "steer", (0, 0, 0))]
    parts += [caster(f"rear_{side}", "base", (-0.4, y, 0)) for side, y in (("l", 0.2), ("r", -0.2))]
    kind, _, _ = drafted(robot(*parts))
    said = " ".join(line.removeprefix("# ") for line in (tmp_path / "unit.yaml").read_text().splitlines())
    remedy = "--lock rear_l_joint --lock rear_r_joint"
    assert kind == "planar: 3 wheels, in any direction"
    assert f"casters do not hold the heading of the base (if they are fixed: {remedy}): the base is assumed" in said
    kind, content, _ = drafted(robot(*parts), lock=dict.fromkeys(remedy.split()[1::2], 0.0))
    assert (kind, len(of(content, "rolling_wheel"))) == ("planar: 3 wheels, steered like a car", 3)


def bogies():
    """Rockers and bogies carry six driven wheels; a bar across the body couples the rockers, and nothing drives it."""
    parts = [link("base", 20.0, BOX, at="0 0 0.2"), link("bar", 0.5)]
    parts.append(joint("bar_joint", "base", "bar", (0, 0, 0.4), "0 0 1", "revolute", 0.0, (-0.3, 0.3)))
    for side, y in (("l", 0.3), ("r", -0.3)):
        rocker, bogie, loose = f"rocker_{side}", f"bogie_{side}", ("0 1 0", "revolute", 0.0, (-1, 1))
        parts += [link(rocker), joint(f"{rocker}_joint", "base", rocker, (0, y, 0.2), *loose)]
        parts += [link(bogie), joint(f"{bogie}_joint", rocker, bogie, (-0.2, 0, 0), *loose)]
        parts.append(wheel(f"w_m{side}", bogie, (0.2, 0, -0.2)))
        for end, carrier, x in ((f"f{side}", rocker, 0.4), (f"b{side}", bogie, -0.2)):
            parts += [pivot(f"s_{end}", carrier, (x, 0, -0.2)), wheel(f"w_{end}", f"s_{end}", (0, 0, 0))]
    return robot(*parts, transmissions(*BOGIE_WHEELS, *(f"s_{end}_joint" for end in ("fl", "fr", "bl", "br"))))


BOGIE_WHEELS = [f"w_{end}{side}_joint" for side in "lr" for end in "mfb"]


def steered_drives(base):
    """Motors of a base whose wheels are all driven and steered."""
    return [*base.wheels, *(each.pivot for each in base.wheels.values())]


def tracks(called):
    """Wheels of a track are called so, or they are many."""
    first = pair("sprocket" if called == "idler" else "w", "base", -0.5, 0.25)
    others = (pair(f"{called}{k}", "base", -0.3 + 0.2 * k, 0.25) for k in range(4))
    return robot(link("base", 20.0, BOX), first, *others)


def tracks_on_bogies():
    """A sprocket and an idler above the ground hold the track of two bogies with two rollers each."""
    parts = [link("base", 20.0, BOX), pair("sprocket", "base", 0.7, 0.25, 0.15)]
    parts += [pair("idler", "base", -0.7, 0.25, 0.15, effort=None)]
    for bogie, x, y in (("a", 0.3, 0.25), ("b", -0.3, 0.25), ("c", 0.3, -0.25), ("d", -0.3, -0.25)):
        parts += [link(bogie), joint(f"{bogie}_joint", "base", bogie, (x, y, 0.1), effort=0.0)]
        parts += [wheel(f"roller_{bogie}{k}", bogie, (at, 0, -0.1), effort=None) for k, at in enumerate((0.1, -0.1))]
    return robot(*parts)


def drawn(name, parent, at, axis="0 0 1", kind="revolute", limits=(-0.6, 0.6), yaw=0.0):
    """A wheel without a joint about its axle: fixed to a body, or on a pivot; its frame is turned [rad]."""
    shape = '<cylinder radius="0.1" length="0.04"/>'
    turns = joint(f"{name}_joint", parent, name, at, axis, kind, limits=limits, rpy=f"0 0 {yaw}")
    return link(name, 0.5, shape, turn=f"1.570796326794897 0 {-yaw}") + turns


def drawn_pair(name, parent, x, **more):
    return "".join(drawn(f"{name}_{side}", parent, (x, y, 0), **more) for side, y in (("l", 0.2), ("r", -0.2)))


def semi():
    """The tree begins at the trailer; the truck has an axle and a steered wheel, and all wheels are only drawn."""
    body, still = '<box size="0.3 0.2 0.05"/>', {"kind": "fixed"}
    trailer = link("trailer", 5.0, body, at="0 0 0.1") + drawn_pair("tw", "trailer", 0.0, **still)
    truck = link("truck", 5.0, body, at="0 0 0.1") + joint("pin", "trailer", "truck", (0.6, 0, 0), "0 0 1")
    return robot(trailer, truck, drawn_pair("rw", "truck", 0.0, **still), drawn("front", "truck", (0.4, 0, 0)))


def rigid_axles():
    """A car whose wheels turn with their axle: one joint for the disks at its ends. It does not lean."""
    parts = [link("base", 20.0, BOX), pivot("turn", "base", (0.3, 0, 0))]
    for name, parent, x in (("back", "base", -0.3), ("front", "turn", 0.0)):
        ends = (drawn(f"{name}{y}", name, (0, y, 0), kind="fixed") for y in (0.2, -0.2))
        parts += [wheel(name, parent, (x, 0, 0), shape='<cylinder radius="0.02" length="0.4"/>'), *ends]
    return robot(*parts, transmissions("back_joint", "turn_joint"))


DRAWN_CAR = robot(link("base", 10.0, BOX), pair("rear", "base", -0.3), drawn_pair("front", "base", 0.3, yaw=0.4))
IN_FRONT = pivot("steer", "base", (0.3, 0, 0)) + wheel("w", "steer", (0, 0, 0))
DRAWN_REAR = robot(link("base", 10.0, BOX), drawn_pair("rear", "base", -0.3, kind="fixed"), IN_FRONT)
DRAWN_PIVOTS = [drawn_pair(f"w{k}", "base", x, kind="continuous", limits=None) for k, x in enumerate((0.3, -0.3))]
DRAWN_SWERVE = robot(link("base", 10.0, BOX), *DRAWN_PIVOTS)
PUSHED = {"force": {"frame": "truck", "axis": "x"}}
CARTS = KINDS["two carts"]
TURRET = "planar: 5 wheels, driven by a turret with 2 wheels"


@pytest.mark.parametrize(("text", "kind", "actuators", "counts"), [
    (turret().urdf, TURRET, [*DRIVE, "turn_joint"], {"reducing": 3}),
    (turret(behind=0.1).urdf, TURRET, [*DRIVE, "turn_joint"], {"reducing": 2}),  # the body moves in any direction
    (turret_on_balls("body"), TURRET, [*DRIVE, "turn_joint"], {"lock": {"b0_joint", "b1_joint", "b2_joint"}}),
    (turret_on_balls("turn"), TURRET, [*DRIVE, "turn_joint"], {"lock": {"b0_joint", "b1_joint", "b2_joint"}}),
    (bogies(), "planar: 6 wheels, steered like a car", {*BOGIE_WHEELS}, {"ackermann": 3}),
    *((KINDS[name].urdf, "planar: 2 wheels, 2 of them steered drives", steered_drives(KINDS[name]), {})
      for name in ("two steered drives", "two steered drives side by side")),
    (CARTS.urdf, "planar: 8 wheels, 8 of them steered drives", steered_drives(CARTS), {"reducing": 9}),  # 3 + 2 + 8 - 4
    (tracks("idler"), "planar: 10 wheels, on tracks, skid-steered", 2, {"joint_coupling": 8}),
    (tracks("w"), "planar: 10 wheels, on tracks, skid-steered", 2, {"joint_coupling": 8}),
    (tracks_on_bogies(), "planar: 8 wheels, on tracks, skid-steered", ["sprocket_l_joint", "sprocket_r_joint"],
        {"joint_coupling": 10}),
    (DRAWN_CAR, "planar: 4 wheels, steered like a car", ["rear_l_joint", "rear_r_joint", "front_l_joint"],
        {"no_side_slip": 1, "ackermann": 1}),
    (DRAWN_REAR, "planar: 2 wheels, steered like a car", ["w_joint", "steer_joint"], {"no_side_slip": 1}),
    (rigid_axles(), "planar: 2 wheels, steered like a car", ["back_joint", "turn_joint"], {"rolling_wheel": 2}),
    (DRAWN_SWERVE, "planar: 4 wheels, 4 of them steered drives", 5, {"no_side_slip": 2}),
    (semi(), "planar: wheels are drawn on 2 axles", [PUSHED, "front_joint"], {"no_side_slip": 3}),
])  # fmt: skip
def test_bases_are_what_their_joints_make_them_and_move(text, kind, actuators, counts, drafted, tmp_path):
    assert_base(drafted(text), kind, actuators, counts)
    assert "no joint 'universe'" not in (tmp_path / "unit.yaml").read_text()  # a drawn axle is no wheel of a bicycle
    assert moved(tmp_path, **{"controller.tracker": "computed_torque"}) > 0.05


def assert_base(found, kind, actuators, counts):
    words, content, _ = found
    assert words.startswith(kind)
    if isinstance(actuators, set):
        assert {each for each in content["actuators"] if each[0] == "w"} == actuators
    elif actuators is not None:
        assert actuators in (content["actuators"], len(content["actuators"]))
    for key, count in counts.items():
        if key == "lock":
            assert {*content["robot"].get("lock", {})} == count
        else:
            assert len(content["outputs"]["reducing"] if key == "reducing" else of(content, key)) == count


def rover(shuffled):
    """Six wheels; the four at the corners are steered, and all are driven."""
    parts = [knuckles("s_f", "w_f", 0.5, 0.3), pair("w_m", "base", 0, 0.3), knuckles("s_b", "w_b", -0.4, 0.3)]
    named = [f"{name}_{side}_joint" for name in ("w_f", "w_m", "w_b", "s_f", "s_b") for side in "lr"]
    return robot(link("base", 20.0, BOX), *(parts[::-1] if shuffled else parts), transmissions(*named))


@pytest.mark.parametrize("shuffled", [False, True])
def test_all_steered_axles_turn_about_one_point(shuffled, drafted, tmp_path):
    """The rear wheels steer the other way, with cot(l) L_l - cot(r) L_r equal to the distance across."""
    kind, content, _ = drafted(rover(shuffled))
    assert kind == "planar: 6 wheels, steered like a car"
    assert (len(of(content, "ackermann")), len(content["actuators"])) == (3, 7)
    assert len(content["outputs"]["reducing"]) == 2
    result = execute(Scenario.load(str(tmp_path / "unit.yaml"), {"simulation.duration": 3, "simulation.dt": 0.01}))
    run = result.trajectory
    model = Scenario.load(str(tmp_path / "unit.yaml")).experiment.reduced.robot
    places = {"f_l": (0.5, 0.3), "f_r": (0.5, -0.3), "b_l": (-0.4, 0.3), "b_r": (-0.4, -0.3)}
    angle = {name: model.joint_values(run.q[-1])[f"s_{name}_joint"] for name in places}
    assert abs(angle["f_l"]) > 0.05
    centers = [y + x / np.tan(angle[name]) for name, (x, y) in places.items()]
    np.testing.assert_allclose(centers, centers[0], rtol=1e-6)


def fixed(name, at, shape="", mass=0.1, parent="base"):
    return link(name, mass, shape) + joint(f"{name}_mount", parent, name, at, kind="fixed", effort=None)


def cart(*more, limits=None, names=("l", "r"), name="unit_7"):
    """Two wheels and a ball in front that is no joint."""
    parts = [link("base", 10.0, BOX, at="0.02 0 0.05"), fixed("skid", (0.2, 0, -0.07), '<sphere radius="0.03"/>')]
    for each, y in zip(names, (0.2, -0.2), strict=True):
        turns = "continuous" if limits is None else "revolute"
        parts.append(link(each, 0.5, '<cylinder radius="0.1" length="0.04"/>', turn="1.570796326794897 0 0"))
        parts.append(joint(f"{each}_joint", "base", each, (0, y, 0), kind=turns, limits=limits))
    return robot(*parts, *more, name=name)


def two_wheels(*more, tall=0.5, name="unit_7"):
    body = link("base_footprint", 10.0, '<box size="0.2 0.2 0.6"/>', at=f"0 0 {tall}")
    pair = (wheel(side, "base_footprint", (0, y, 0.1)) for side, y in (("l", 0.2), ("r", -0.2)))
    return robot(body, *pair, *more, name=name)


def four_wheels(*more, name="unit_7", wheels="w"):
    places = enumerate(((0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)))
    parts = (wheel(f"{wheels}_{k}", "base", (x, y, 0)) for k, (x, y) in places)
    return robot(link("base", 10.0, BOX), *parts, *more, name=name)


def arm_with(name, title="unit_7"):
    parts = [link("base", 3.0, '<cylinder radius="0.1" length="0.1"/>')]
    for k, (parent, child) in enumerate((("base", name), (name, "elbow"), ("elbow", "wrist"))):
        axis, at = ("0 0 1", "0 1 0")[k % 2], (0, 0, 0.2 if k else 0.1)
        parts += [link(child, 2.0, at="0 0 0.1"), joint(f"j{k}", parent, child, at, axis, "revolute", 80.0, (-2, 2))]
    return robot(*parts, name=title)


def mates(mass):
    """Without shapes and names: a file turned the inertia of one wheel, and its mate on the axle tells what it is."""
    wheels = []
    for name, y, m, (x, yy, z) in (("one", 0.15, 0.3, (3e-4, 5e-4, 3e-4)), ("other", -0.15, mass, (3e-4, 3e-4, 5e-4))):
        inertia = f'<inertia ixx="{x}" iyy="{yy}" izz="{z}" ixy="0" ixz="0" iyz="0"/>'
        wheels += [f'<link name="{name}"><inertial><mass value="{m}"/>{inertia}</inertial></link>']
        wheels += [joint(f"{name}_joint", "base", name, (0, y, 0.05))]
    return robot(link("base", 5.0, at="0.02 0 0.05"), *wheels)


def on_legs(beside):
    """Errors of all joints of two legs add up: a fifth of a radius."""
    body = link("base", 10.0, '<box size="0.2 0.2 0.3"/>', at="0 0 0.5")
    return robot(body, wheel("l", "base", (beside / 2, 0.2, 0)), wheel("r", "base", (-beside / 2, -0.2, 0)))


def diver(name):
    """Thrusters beside a hull: cylinders about the long axis, not below it."""
    parts = [link("base", 10.0, '<box size="0.6 0.4 0.3"/>')]
    for k, (x, y) in enumerate(((0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2))):
        parts.append(link(f"t{k}", 0.2, '<cylinder radius="0.05" length="0.1"/>', turn="0 1.5707963267948966 0"))
        parts.append(joint(f"t{k}_joint", "base", f"t{k}", (x, y, -0.1), "1 0 0"))
    return robot(*parts, name=name)


CONTROLLER = fixed("controller_box", (0, 0, 0.3), mass=0.2, parent="base_footprint")
LOW, HIGH = (fixed("caster_dummy", (0.1, 0, height), mass=0.2, parent="base_footprint") for height in (0.02, 0.4))
CAMERA = fixed("omni_camera", (0, 0, 0.3), mass=0.2)
LOAD = fixed("load_balancer", (-0.05, 0, 0.4), '<box size="0.2 0.2 0.2"/>', mass=4.0)
ONCE, DISKS = (-3.14, 3.14), ("part_3", "part_4")  # exporters write the limits of a wrist for wheels too
BALANCES, DRIVES = "free: 2 wheels under a body that balances", "planar: 2 wheels, differential drive"
SKIDS, MECANUM, ARM = "planar: 4 wheels, skid-steered", "planar: 4 Mecanum wheels", "fixed: no wheels were found"


@pytest.mark.parametrize(("text", "wishes", "kind"), [
    (two_wheels(CONTROLLER), {}, BALANCES),  # neither the foot in footprint nor the roller in controller supports it
    (two_wheels(CONTROLLER), {"balance": False}, DRIVES),
    (two_wheels(LOW), {}, DRIVES),
    (two_wheels(HIGH), {}, BALANCES),
    (two_wheels(LOW), {"balance": True}, BALANCES),
    (cart(LOAD), {}, DRIVES),
    *((on_legs(beside), {}, BALANCES) for beside in (0.0, 0.02)),
    (four_wheels(CAMERA), {}, SKIDS),
    (four_wheels(CAMERA), {"rollers": True}, MECANUM),
    (four_wheels(name="rover_omni_camera"), {}, SKIDS),
    (four_wheels('<gazebo><sensor><plugin name="omni_top" filename="libcamera.so"/></sensor></gazebo>'), {}, SKIDS),
    (four_wheels(wheels="mecanum_wheel"), {}, MECANUM),
    (four_wheels(name="OmniRover"), {}, MECANUM),
    (four_wheels(name="OmniRover"), {"rollers": False}, SKIDS),
    (mates(0.3), {}, DRIVES),
    (mates(0.9), {}, "planar: 1 wheel, one wheel"),
    *((arm_with(name), {}, ARM) for name in ("shoulder_rotor", "work_space_center", "floating_tool")),
    (arm_with("shoulder", "free_flyer"), {}, "free: no wheels, and a name"),
    (cart(limits=ONCE, names=DISKS), {}, DRIVES),
    (cart(limits=ONCE).replace('"r_joint" type="revolute"', '"r_joint" type="fixed"'), {}, ARM),  # one disk is a wrist
    (cart(limits=(-2.0, 2.0)), {}, ARM),
    (diver("mini_rov"), {}, "free"),
    (diver("unit_7"), {}, "planar"),
])  # fmt: skip
def test_names_and_options_decide_where_structure_leaves_it_open(text, wishes, kind, drafted):
    assert drafted(text, **wishes)[0].startswith(kind)


def flap(*named):
    turns = joint("flap_joint", "base", "flap", (0.3, 0, 0.1), kind="revolute", limits=(-1, 1), effort=100.0)
    return robot(link("base", 10.0, BOX), pair("w", "base", 0), link("flap", 1.0), turns, transmissions(*named))


def two_steered_axles():
    """Of two the farther one leads; a swivel without motor and trail is held, and its wheel skids."""
    front = pivot("front", "base", (0.6, 0, 0)) + wheel("f", "front", (0, 0, 0))
    back = pivot("back", "base", (-0.4, 0, 0)) + wheel("b", "back", (0, 0, 0))
    return robot(link("base", 20.0, BOX), pair("m", "base", 0, 0.3), front, back)


def with_axis_across(name, effort=10.0):
    """A ball caster of which the file draws one axis."""
    turning = joint(f"{name}_joint", "base_footprint", name, (-0.25, 0, 0.05), "1 0 0", effort=effort)
    shape = '<cylinder radius="0.05" length="0.04"/>'
    return two_wheels(link(name, 0.1, shape, turn="0 1.570796326794897 0"), turning)


def kingpins():
    """A kingpin of a trailer is one joint behind the base; those of knuckles stand side by side."""
    return robot(link("base", 10.0, BOX) + pair("rear", "base", -0.3), knuckles("kingpin", "front", 0.3))


def afloat(text):
    """The same robot on a free joint of its file, which a planar base replaces."""
    floats = joint("world_joint", "world", "base", (0, 0, 0), kind="floating", effort=None)
    return text.replace('<link name="base">', f'<link name="world"/>{floats}<link name="base">')


def with_steered_trailer():
    """A driven dolly of the trailer does not steer the car."""
    hitch = link("trailer", 10.0, BOX) + joint("hitch", "base", "trailer", (-0.5, 0, 0), "0 0 1", "revolute", 0.0)
    dolly = pivot("dolly", "trailer", (-0.4, 0, 0)) + pair("d", "dolly", 0.0)
    driven = ("rear_l_joint", "rear_r_joint", "knuckle_l_joint", "dolly_joint")
    return robot(
        link("base", 20.0, BOX), pair("rear", "base", -0.3), knuckles("knuckle", "front", 0.3), hitch,
        pair("t", "trailer", -1.0), dolly, transmissions(*driven),
    )  # fmt: skip


def with_virtual_wheels(*named):
    """A car with what controllers of steered bases ask for: 0.06 g on each axle, one on a pivot, no shapes."""
    parts = [link(name, 6e-5, moment=1e-8) for name in ("rear", "turn", "front")]
    parts += [joint("rear_v", "base", "rear", (-0.3, 0, 0)), joint("front_v", "turn", "front", (0, 0, 0))]
    parts += [joint("turn_v", "base", "turn", (0.3, 0, 0), "0 0 1", "revolute", limits=(-0.6, 0.6))]
    front = knuckles("k", "f", 0.3)
    return robot(link("base", 10.0, BOX), pair("back", "base", -0.3), front, *parts, transmissions(*named))


VIRTUAL = ("rear_v", "turn_v", "front_v")
L_R, W_LR = ["l_joint", "r_joint"], ["w_l_joint", "w_r_joint"]
CAR = "planar: 4 wheels, steered like a car"


@pytest.mark.parametrize(("text", "wishes", "kind", "actuators", "counts"), [
    (flap(*W_LR), {}, DRIVES, W_LR, {"lock": {"flap_joint"}}),
    (flap(*W_LR), {"driven": ["flap_joint"]}, DRIVES, [*W_LR, "flap_joint"], {"lock": set()}),
    (flap(), {}, DRIVES, [*W_LR, "flap_joint"], {}),
    (flap(), {"passive": ["flap_joint"]}, DRIVES, W_LR, {}),
    (two_steered_axles(), {}, CAR, ["m_l_joint", "m_r_joint", "front_joint"], {}),
    (two_steered_axles(), {"passive": ["front_joint"]}, CAR, ["m_l_joint", "m_r_joint", "back_joint"],
        {"lock": {"front_joint"}}),
    (with_axis_across("caster"), {}, "planar: 3 wheels, differential drive", L_R, {"lock": {"caster_joint"}}),
    (with_axis_across("aux"), {"passive": ["aux_joint"]}, "planar: 3 wheels, differential drive", L_R,
        {"lock": {"aux_joint"}}),
    (with_axis_across("aux"), {}, "planar: 3 omni wheels", 3, {}),
    (with_axis_across("aux", effort=0.0), {}, "planar: 3 wheels, differential drive", L_R, {"lock": {"aux_joint"}}),
    (with_axis_across("caster"), {"driven": ["caster_joint"]}, "planar: 3 omni wheels", 3, {}),
    (kingpins(), {}, CAR, ["rear_l_joint", "rear_r_joint", "kingpin_l_joint"], {}),
    (with_virtual_wheels(), {}, CAR, ["back_l_joint", "back_r_joint", "k_l_joint"], {"lock": {*VIRTUAL}}),
    (with_virtual_wheels(*VIRTUAL), {}, CAR, ["back_l_joint", "back_r_joint", "k_l_joint"], {"lock": {*VIRTUAL}}),
    (cart(limits=ONCE, names=DISKS), {}, DRIVES, ["part_3_joint", "part_4_joint"], {}),
    (afloat(cart()), {}, DRIVES, L_R, {"lock": {"world_joint"}}),
    (with_steered_trailer(), {}, "planar: 8 wheels, steered like a car with 1 trailer",
        ["rear_l_joint", "rear_r_joint", "knuckle_l_joint"], {"lock": {"dolly_joint"}}),
])  # fmt: skip
def test_motors_locks_and_wheels_of_a_draft(text, wishes, kind, actuators, counts, drafted):
    assert_base(drafted(text, **wishes), kind, actuators, counts)


def test_a_wheel_with_its_mass_beside_the_axle_is_to_be_checked(drafted, tmp_path):
    skid = fixed("skid", (0.2, 0, -0.07), "<sphere radius='0.03'/>")
    text = robot(link("base", 10.0, BOX, at="0.02 0 0.05"), pair("w", "base", 0), skid)
    inertial = '<link name="w_r"><inertial><origin xyz="{}"'
    moved_mass = text.replace(inertial.format("0 0 0"), inertial.format("0.3 0.1 0"))
    for each in (text, moved_mass):
        drafted(each)
        said = " ".join((tmp_path / "unit.yaml").read_text().replace("# ", "").split())
        wanted = "CHECK: the center of mass of wheel w_r_joint is 0.3 m from its axle in the file"
        assert (wanted in said) == (each is moved_mass)


def test_wheels_in_line_do_not_skid_steer(drafted):
    parts = [link("base", 10.0, BOX), wheel("a", "base", (0.3, 0, 0)), wheel("b", "base", (-0.3, 0.003, 0))]
    with pytest.raises(ConfigurationError, match=r"a_joint, b_joint stand in line: .* with --base planar"):
        drafted(robot(*parts))
    assert drafted(robot(*parts), base="planar")[0].startswith("planar")


def test_an_axis_across_a_drawn_cylinder_is_said(drafted, tmp_path):
    """Joints without an <axis> turn about x, and the cylinders of these wheels are about y."""
    turned = re.sub('"(?=[lr](_joint)?")', '"wheel_', two_wheels(LOW, tall=0.5))
    turned = turned.replace('axis xyz="0 1 0"', 'axis xyz="1 0 0"')
    with pytest.raises(ConfigurationError, match="wheel_l_joint, wheel_r_joint: the joint's axis is across that of"):
        drafted(turned)
    drafted(four_wheels().replace('axis xyz="0 1 0"', 'axis xyz="1 0 0"'))
    draft = (tmp_path / "unit.yaml").read_text()
    assert "# CHECK: the axis of joint w_0_joint is across that of its drawn cylinder" in draft


def test_omni_wheels_beside_others_slide(drafted):
    """A differential drive on two omni wheels in front; an option says that all wheels have rollers, or none."""
    text = robot(link("base", 10.0, BOX), pair("drive", "base", -0.2), pair("omni", "base", 0.3))
    kind, content, decided = drafted(text)
    assert kind == "planar: 4 wheels, differential drive"
    assert content["actuators"] == ["drive_l_joint", "drive_r_joint"]
    assert decided["Do the wheels have rollers?"].answer == "only omni_l_joint, omni_r_joint, which slide"
    rows = {each["frame"]: each.get("lateral", True) for each in of(content, "rolling_wheel")}
    assert rows == {"drive_l": True, "drive_r": False, "omni_l": False, "omni_r": False}
    assert drafted(text, rollers=True)[0] == "planar: 4 Mecanum wheels"
    assert drafted(text, rollers=False)[0] == "planar: 4 wheels, skid-steered"
    front = pivot("turn", "base", (0.4, 0, 0)) + wheel("front", "turn", (0, 0, 0))
    text = robot(link("base", 10.0, BOX), pair("omni", "base", 0), front)
    assert drafted(text)[0] == "planar: 3 wheels, steered like a car"


@pytest.mark.parametrize(("effort", "lists", "kind", "is_open"), [
    (0.0, "", "planar: 4 wheels, differential drive with 1 trailer", False),
    (200.0, "", "planar: 4 wheels, differential drive with 1 trailer", True),
    (200.0, transmissions("fl_joint", "fr_joint"), "planar: 4 wheels, differential drive with 1 trailer", False),
    (200.0, transmissions("fl_joint", "fr_joint", "waist"), "planar: 4 wheels, steered like a car", None),
], ids=["no effort", "effort", "not listed", "listed"])  # fmt: skip
def test_a_pivot_with_an_effort_may_be_that_of_an_articulated_loader(effort, lists, kind, is_open, drafted):
    """Two bodies with an axle each; what drives the joint between them decides, and init asks if nothing tells."""
    parts = [link("front", 20.0, BOX), wheel("fl", "front", (0.3, 0.3, 0)), wheel("fr", "front", (0.3, -0.3, 0))]
    parts += [link("rear", 20.0, BOX, at="-0.4 0 0")]
    parts += [joint("waist", "front", "rear", (-0.1, 0, 0), "0 0 1", "revolute", effort, (-0.6, 0.6))]
    parts += [wheel("rl", "rear", (-0.5, 0.3, 0)), wheel("rr", "rear", (-0.5, -0.3, 0))]
    found, content, decided = drafted(robot(*parts, lists))
    assert found == kind
    question = decided.get("Is waist a free hitch?")
    assert (question.is_open if question else None) == is_open
    assert ("waist" in content["actuators"]) == (is_open is None)
    if is_open:
        (other,) = question.alternatives
        assert other.command == "--driven waist"
        assert drafted(robot(*parts), driven=["waist"])[0] == "planar: 4 wheels, steered like a car"


@pytest.mark.parametrize(("called", "listed"), [("road", True), ("u", False)])
def test_sprockets_above_the_ground_drive_their_tracks(called, listed, drafted, tmp_path):
    parts = [link("base", 50.0, '<box size="1.2 0.4 0.2"/>', at="0 0 0.15")]
    for side, y in (("l", 0.3), ("r", -0.3)):
        parts += [wheel(f"{called}_{side}{k}", "base", (-0.4 + 0.2 * k, y, 0)) for k in range(4)]
        parts += [wheel(f"sprocket_{side}", "base", (0.6, y, 0.12), 0.08)]
    sprockets = ["sprocket_l_joint", "sprocket_r_joint"]
    kind, content, _ = drafted(robot(*parts, transmissions(*sprockets) if listed else ""))
    assert (kind, content["actuators"]) == ("planar: 8 wheels, on tracks, skid-steered", sprockets)
    couplings = {each["joint_coupling"]["joint"]: each["joint_coupling"]["ratio"] for each in content["constraints"]
                 if "joint_coupling" in each}  # fmt: skip
    assert (len(couplings), couplings["sprocket_l_joint"]) == (8, pytest.approx(0.1 / 0.08))
    run = execute(Scenario.load(str(tmp_path / "unit.yaml"), {"simulation.dt": 0.01})).trajectory
    assert run.verdict.succeeded, run.verdict.first  # both ends of a track carry
    assert np.linalg.norm(run.q[-1, :2] - run.q[0, :2]) > 0.25


def test_a_gear_that_is_not_quite_on_the_axle_lifts_no_car(drafted):
    """The rear wheels turn on hubs about nearly the same axle: both together move them by a hair."""
    hubs = "".join(
        link(f"hub_{side}") + joint(f"hub_{side}_joint", "base", f"hub_{side}", (-0.275, y, 0))
        for side, y in (("l", 0.2), ("r", -0.2))
    )
    rear = "".join(wheel(f"rear_{side}", f"hub_{side}", (0, 0, 0), toe=0.01) for side in "lr")
    kind, content, _ = drafted(robot(link("base", 10.0, BOX), hubs, rear, knuckles("knuckle", "front", 0.275)))
    assert kind == CAR
    assert [each.get("vertical", True) for each in of(content, "rolling_wheel")][:2] == [False, False]


@pytest.mark.parametrize("reverse", [False, True])
def test_steered_wheels_turn_about_the_fixed_axle_that_does_not_skid(reverse, drafted):
    parts = []
    for k, x in enumerate((1.5, 1.0)):
        for side, y in (("l", 0.4), ("r", -0.4)):
            parts.append(pivot(f"k{k}{side}", "base", (x, y, 0)) + wheel(f"f{k}{side}", f"k{k}{side}", (0, 0, 0), 0.2))
    for k, x in enumerate((-0.6, -1.1, -1.6)):
        parts += [wheel(f"b{k}{side}", "base", (x, y, 0), 0.2) for side, y in (("l", 0.4), ("r", -0.4))]
    parts = parts[::-1] if reverse else parts
    kind, content, _ = drafted(robot(link("base", 200.0, '<box size="3.4 0.6 0.3"/>'), *parts))
    assert kind == "planar: 10 wheels, steered like a car"
    assert {each["ackermann"]["axle"][:2] for each in content["constraints"] if "ackermann" in each} == {"b1"}
    lateral = [each["rolling_wheel"]["frame"] for each in content["constraints"] if "rolling_wheel" in each
               and each["rolling_wheel"].get("lateral", True)]  # fmt: skip
    assert sorted(each[:2] for each in lateral) == ["b1", "f0"]


def test_one_body_on_fixed_wheels_stays_on_the_ground(drafted):
    parts = [link("base", 10.0, BOX), *(drawn_pair(f"w{x}", "base", x, kind="fixed") for x in (0.3, -0.3))]
    mover = '<gazebo><plugin name="mover" filename="libgazebo_ros_planar_move.so"/></gazebo>'
    kind, content, _ = drafted(robot(*parts, mover))
    assert kind == "planar: a plugin of the file moves it over the ground in any direction"
    assert content["robot"].get("gravity") is None


def test_a_body_with_links_called_wheels_stays_on_the_ground_and_init_asks(drafted):
    """A body with many limbs on casters that no joint turns; a reaction wheel is no sign of ground."""

    def body(name):
        parts = [link("base", 30.0, '<box size="0.6 0.6 0.3"/>')]
        for k, (x, y) in enumerate(((0.2, 0.2), (0.2, -0.2), (-0.2, 0.2))):
            turns = joint(f"m{k}", "base", f"{name}_{k}", (x, y, 0), "0 0 1", "revolute", 5.0, (-1, 1))
            parts += [link(f"{name}_{k}", 0.3), turns]
        return robot(*parts)

    kind, _, decided = drafted(body("caster"))
    assert kind.startswith("planar: links are called wheels")
    assert [each.is_open for each in decided.values()] == [True]
    assert drafted(body("reaction_wheel"))[0].startswith("free")


def test_a_boat_is_no_spacecraft_and_an_unknown_body_is_a_question(drafted):
    hull = link("link_1", 50.0, '<box size="2 0.6 0.4"/>')
    screw = link("screw", 0.3) + joint("screw_joint", "link_1", "screw", (-1, 0.3, -0.2), "1 0 0")
    for parts in ("", screw, screw + screw.replace("screw", "other").replace("-1 0.3", "-1 -0.3")):
        kind, content, _ = drafted(robot(hull, parts, name="survey_boat"))
        assert kind == "planar: a name of something that swims on the surface"
        assert [next(iter(each)) for each in content["actuators"][:3]] == ["force", "force", "torque"]
        assert content["robot"].get("gravity") is None
    kind, _, decided = drafted(robot(hull))
    (question,) = decided.values()
    assert kind == "free: one rigid body"
    assert question.is_open
    assert [each.command for each in question.alternatives] == ["--base planar"]
    assert not any(each.is_open for each in drafted(robot(hull, name="cube_satellite"))[2].values())


def test_a_body_below_rotors_carries_its_weight_and_init_asks(drafted):
    parts = [link("base", 1.0, '<box size="0.2 0.2 0.08"/>')]
    for k, (x, y) in enumerate(((0.2, 0.2), (0.2, -0.2), (-0.2, 0.2), (-0.2, -0.2))):
        parts += [link(f"p{k}", 0.01), joint(f"p{k}_joint", "base", f"p{k}", (x, y, 0.05), "0 0 1")]
    kind, content, decided = drafted(robot(*parts))
    assert kind.endswith("4 rotors with upright axes around it carry it")
    assert (content["robot"].get("gravity"), len(content["robot"]["lock"])) == (None, 4)
    assert [each.is_open for each in decided.values()] == [True]


def legged(hang, ahead=0.0, effort=10.0):
    """A body on two legs, whose wheels are below it [m], and ahead of it."""
    parts, foot = [link("base", 8.0, '<box size="0.2 0.2 0.15"/>')], '<box size="0.02 0.02 0.1"/>'
    for side, y in (("l", 0.15), ("r", -0.15)):
        turns = ("0 1 0", "revolute", 20.0, (-2, 2))
        parts += [link(f"thigh_{side}", 0.5), joint(f"hip_{side}", "base", f"thigh_{side}", (0, y, 0), *turns)]
        parts += [link(f"shank_{side}", 0.4, foot)]
        parts += [joint(f"knee_{side}", f"thigh_{side}", f"shank_{side}", (0, 0, -hang), *turns)]
        parts += [wheel(f"w_{side}", f"shank_{side}", (ahead, 0, 0), 0.06, effort)]
    return robot(*parts)


def stands_on_two(effort, name="unit_7"):
    return re.sub('effort="10.0"', effort, two_wheels(CONTROLLER, name=name))


WEAK = 'effort="0.06"'  # 70 times less than 0.1 rad of tilt takes: 0.1 rad * 11 kg * 9.8 m/s^2 * 0.4 m


@pytest.mark.parametrize(("text", "kind", "is_open"), [
    (stands_on_two(WEAK), DRIVES, True),
    (stands_on_two(WEAK, "segway"), DRIVES, True),
    (stands_on_two(""), BALANCES, True),
    (stands_on_two('effort="10.0"'), BALANCES, False),
    (legged(0.3), BALANCES, False),
    (legged(0.05), BALANCES, False),  # folded
    (legged(0.05, ahead=0.08), DRIVES, True),
    (legged(0.05, effort=0.02), DRIVES, True),
])  # fmt: skip
def test_efforts_of_the_file_decide_whether_a_base_balances(text, kind, is_open, drafted):
    found, _, decided = drafted(text)
    assert found.startswith(kind)
    assert decided["Does the base balance on its two wheels?"].is_open is is_open


def test_bodies_with_one_moment_of_inertia_float_in_a_plane(drafted, tmp_path):
    parts = [link("bus", 20.0, '<box size="0.4 0.4 0.1"/>')]
    for name, x in (("a", 0.3), ("b", -0.3), ("c", 0.4)):
        parts += [link(name, 1.0, at=f"{x / 2} 0 0"), joint(f"{name}_joint", "bus", name, (x, 0, 0), "0 0 1")]
    kind, content, _ = drafted(re.sub('ixx="[^"]*" iyy="[^"]*"', 'ixx="0" iyy="0"', robot(*parts)))
    assert kind.startswith("planar: no wheels, and 3 limbs on one body, and bus, a, b and 1 more have a moment of")
    assert content["constraints"] == [{"momentum": "root_joint"}]
    free = Robot.from_urdf(tmp_path / "unit.urdf", base="free", gravity=(0, 0, 0))
    with pytest.raises(ConstraintError, match=r"bus, a, b and 1 more have a moment of inertia about one axis.*planar"):
        NonholonomicSystem(free, [MomentumConservation("root_joint")])


def test_the_desired_path_belongs_to_the_point_that_is_drawn(drafted, tmp_path):
    """The base's origin is 0.1 m beside the middle of its Mecanum wheels, which the top view used to draw."""
    places = ((0.3, 0.3), (0.3, -0.1), (-0.3, 0.3), (-0.3, -0.1))
    wheels = [wheel(f"mecanum_{k}", "base", (x, y, 0)) for k, (x, y) in enumerate(places)]
    drafted(robot(link("base", 10.0, BOX), *wheels))
    result = execute(Scenario.load(str(tmp_path / "unit.yaml"), {"simulation.duration": 5.5, "simulation.dt": 0.01}))
    (path,) = [each for each in ground_paths(result.trajectory) if each.desired is not None]
    np.testing.assert_allclose(path.points, path.desired, atol=0.01)
    assert np.linalg.norm(path.points[-1] - path.points[0]) == pytest.approx(0.5, abs=0.02)


def test_the_path_of_a_name_begins_at_its_point(drafted, tmp_path):
    """The outputs are speeds; the contacts of a car have another middle than its base, or stand aside."""
    for text in (car(), DRAWN_CAR, robot(link("base", 10.0, BOX), pair("w", "base", 0.3))):
        drafted(text)
        run = execute(Scenario.load(str(tmp_path / "unit.yaml"), {"simulation.duration": 0.5})).trajectory
        (path,) = [each for each in ground_paths(run) if each.name == "base"]
        np.testing.assert_allclose(path.points, run.q[:, :2], atol=1e-9)
