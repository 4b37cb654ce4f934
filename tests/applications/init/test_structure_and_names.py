"""Names only help: what turns, what stands on the ground and what is beside it decide."""

import numpy as np
import pytest

from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from urdf_parts import BOX, joint, link, pivot, robot, transmissions, wheel

pytestmark = [pytest.mark.filterwarnings("ignore::rnc_pin.ModelWarning"), pytest.mark.usefixtures("brief")]

UPRIGHT = "1.570796326794897 0 0"  # turns a cylinder so that its axis is y


def fixed(name, at, shape="", mass=0.1, parent="base"):
    return link(name, mass, shape) + joint(f"{name}_mount", parent, name, at, kind="fixed", effort=None)


def cart(*more, limits=None, names=("l", "r"), name="unit_7"):
    """Two wheels and a ball in front that is no joint."""
    parts = [link("base", 10.0, BOX, at="0.02 0 0.05"), fixed("skid", (0.2, 0, -0.07), '<sphere radius="0.03"/>')]
    for each, y in zip(names, (0.2, -0.2), strict=True):
        turns = "continuous" if limits is None else "revolute"
        parts.append(link(each, 0.5, '<cylinder radius="0.1" length="0.04"/>', turn=UPRIGHT))
        parts.append(joint(f"{each}_joint", "base", each, (0, y, 0), kind=turns, limits=limits))
    return robot(*parts, *more, name=name)


def run_of(folder, **options):
    result = execute(Scenario.load(str(folder / "unit.yaml"), options))
    assert result.error is None
    return result.trajectory


# ---------------------------------------------------------------------- names of parts


def test_a_load_balancer_balances_nothing(drafted):
    box = fixed("load_balancer", (-0.05, 0, 0.4), '<box size="0.2 0.2 0.2"/>', mass=4.0)
    assert drafted(cart(box))[0] == "planar: 2 wheels, differential drive"


@pytest.mark.parametrize(("mass", "kind"), [(0.3, "2 wheels, differential drive"), (0.9, "1 wheel, one wheel")])
def test_a_wheel_has_its_mate_on_the_axle_line(mass, kind, drafted):
    """A file turned the inertia of one wheel; without shapes and names, its mate tells what it is."""
    wheels = []
    for name, y, m, moments in (("one", 0.15, 0.3, (3e-4, 5e-4, 3e-4)), ("other", -0.15, mass, (3e-4, 3e-4, 5e-4))):
        ixx, iyy, izz = moments
        wheels.append(
            f'<link name="{name}"><inertial><mass value="{m}"/><inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" '
            'ixy="0" ixz="0" iyz="0"/></inertial></link>' + joint(f"{name}_joint", "base", name, (0, y, 0.05))
        )
    text = robot(link("base", 5.0, at="0.02 0 0.05"), *wheels)
    assert drafted(text)[0] == f"planar: {kind}"


@pytest.mark.parametrize("listed", [True, False])
def test_a_pair_of_kingpins_steers_a_car(listed, drafted):
    """A kingpin of a trailer is one joint behind the base; those of knuckles stand side by side."""
    parts = [link("base", 10.0, BOX)]
    for side, y in (("l", 0.2), ("r", -0.2)):
        parts += [wheel(f"rear_{side}", "base", (-0.3, y, 0)), pivot(f"kingpin_{side}", "base", (0.3, y, 0))]
        parts += [wheel(f"front_{side}", f"kingpin_{side}", (0, 0, 0))]
    lists = transmissions("rear_l_joint", "rear_r_joint", "kingpin_l_joint") if listed else ""
    kind, content, _ = drafted(robot(*parts, lists))
    assert kind == "planar: 4 wheels, steered like a car"
    assert content["actuators"] == ["rear_l_joint", "rear_r_joint", "kingpin_l_joint"]


@pytest.mark.parametrize("name", ["shoulder_rotor", "work_space_center", "floating_tool"])
def test_parts_of_an_arm_do_not_make_it_float(name, drafted):
    parts = [link("base", 3.0, '<cylinder radius="0.1" length="0.1"/>')]
    for k, (parent, child) in enumerate((("base", name), (name, "elbow"), ("elbow", "wrist"))):
        axis, at = ("0 0 1", "0 1 0")[k % 2], (0, 0, 0.2 if k else 0.1)
        parts += [link(child, 2.0, at="0 0 0.1"), joint(f"j{k}", parent, child, at, axis, "revolute", 80.0, (-2, 2))]
    assert drafted(robot(*parts))[0].startswith("fixed: no wheels were found")
    assert drafted(robot(*parts, name="free_flyer"))[0].startswith("free: no wheels, and a name")


@pytest.mark.parametrize("joints", ["left_wheel right_wheel", "left right"])
def test_the_rotor_of_a_motor_may_carry_a_wheel(joints, drafted):
    """One of the names tells of a wheel: that of the joint, or of a tyre beside the axle."""
    parts = [link("base", 10.0, BOX, at="0.02 0 0.05"), fixed("skid", (0.2, 0, -0.07), '<sphere radius="0.03"/>')]
    tyre = '<cylinder radius="0.1" length="0.04"/>'
    for name, y in zip(joints.split(), (0.2, -0.2), strict=True):
        parts += [link(f"{name}_rotor", 0.5), joint(name, "base", f"{name}_rotor", (0, y, 0))]
        own = f"{name}_wheel_tyre" if joints == "left right" else f"{name}_ring"
        parts += [link(own, 0.3, tyre, turn=UPRIGHT)]
        parts += [joint(f"{own}_mount", f"{name}_rotor", own, (0.001, 0, 0), kind="fixed", effort=None)]
    assert drafted(robot(*parts))[0] == "planar: 2 wheels, differential drive"


def test_a_spare_wheel_is_not_the_ground(drafted):
    """It has the only name of a wheel, and its axis is along the cart."""
    shape = '<cylinder radius="0.1" length="0.04"/>'
    spare = link("spare_wheel", 0.5, shape, turn="0 1.570796326794897 0")
    spare += joint("spare", "base", "spare_wheel", (-0.35, 0, 0.2), "1 0 0", effort=0.0)
    kind, content, _ = drafted(cart(spare))
    assert kind == "planar: 2 wheels, differential drive"
    assert content["actuators"] == ["l_joint", "r_joint"]


def test_omni_wheels_beside_others_slide(drafted):
    """A differential drive on two omni wheels in front; an option says that all wheels have rollers, or none."""
    places = {"drive_l": (-0.2, 0.2, 0), "drive_r": (-0.2, -0.2, 0), "omni_l": (0.3, 0.2, 0), "omni_r": (0.3, -0.2, 0)}
    text = robot(link("base", 10.0, BOX), *(wheel(name, "base", place) for name, place in places.items()))
    kind, content, decided = drafted(text)
    assert kind == "planar: 4 wheels, differential drive"
    assert content["actuators"] == ["drive_l_joint", "drive_r_joint"]
    assert decided["Do the wheels have rollers?"].answer == "only omni_l_joint, omni_r_joint, which slide"
    rows = {
        each["rolling_wheel"]["frame"]: each["rolling_wheel"].get("lateral", True) for each in content["constraints"]
    }
    assert rows == {"drive_l": True, "drive_r": False, "omni_l": False, "omni_r": False}
    assert drafted(text, rollers=True)[0] == "planar: 4 Mecanum wheels"
    assert drafted(text, rollers=False)[0] == "planar: 4 wheels, skid-steered"
    rear = [wheel(f"omni_{side}", "base", (0, y, 0)) for side, y in (("l", 0.2), ("r", -0.2))]
    front = pivot("turn", "base", (0.4, 0, 0)) + wheel("front", "turn", (0, 0, 0))
    assert drafted(robot(link("base", 10.0, BOX), *rear, front))[0] == "planar: 3 wheels, steered like a car"


# ---------------------------------------------------------------------- hitches


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


# ---------------------------------------------------------------------- water and space


@pytest.mark.parametrize("turned", [False, True], ids=["propellers", "azimuth thrusters"])
def test_a_boat_with_propellers_stays_on_the_water(turned, drafted):
    parts = [link("base", 80.0, '<box size="2 0.8 0.5"/>')]
    for side, y in (("l", 0.3), ("r", -0.3)):
        parent, at = ("base", (-1, y, -0.2))
        if turned:
            parts.append(pivot(f"thruster_{side}", "base", at))
            parent, at = f"thruster_{side}", (0, 0, -0.1)
        parts += [link(f"screw_{side}", 0.3), joint(f"screw_{side}_joint", parent, f"screw_{side}", at, "1 0 0")]
    kind, content, _ = drafted(robot(*parts, name="survey_boat"))
    assert kind == "planar: a name of something that swims on the surface"
    assert content["robot"].get("gravity") is None
    assert [next(iter(each)) for each in content["actuators"][:3]] == ["force", "force", "torque"]


@pytest.mark.parametrize(("name", "kind"), [("mini_rov", "free"), ("unit_7", "planar")])
def test_thrusters_beside_a_hull_are_no_wheels_of_a_diver(name, kind, drafted):
    """Cylinders about the long axis, not below the hull; without a telling name they could be wheels."""
    parts = [link("base", 10.0, '<box size="0.6 0.4 0.3"/>')]
    for k, (x, y) in enumerate(((0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2))):
        parts.append(link(f"t{k}", 0.2, '<cylinder radius="0.05" length="0.1"/>', turn="0 1.5707963267948966 0"))
        parts.append(joint(f"t{k}_joint", "base", f"t{k}", (x, y, -0.1), "1 0 0"))
    assert drafted(robot(*parts, name=name))[0].startswith(kind)
    gear = [wheel(f"g{k}", "base", (0.2 - 0.4 * (k > 0), 0.1 * (k - 1), -0.15)) for k in range(3)]
    assert drafted(robot(parts[0], *gear, name=name))[0].startswith("planar: 3 wheels")


@pytest.mark.parametrize(("mass", "is_open"), [(9.0, False), (3.0, True)])
def test_half_of_the_mass_in_the_first_link_is_a_question(mass, is_open, drafted):
    arm = link("arm", 2.0, at="0 0 0.2") + joint("turn", "base", "arm", (0, 0, 0.1), "0 1 0", "revolute", 9.0, (-1, 1))
    kind, _, decided = drafted(robot(link("base", mass, BOX), arm))
    assert kind.startswith("free: no wheels, and")
    assert [each.is_open for each in decided.values()] == [is_open]


# ---------------------------------------------------------------------- axles


@pytest.mark.parametrize("beside", [0.0, 0.01, 0.02])
def test_wheels_at_the_ends_of_legs_are_of_one_axle_line(beside, drafted):
    """Errors of all joints of two legs add up: a fifth of a radius."""
    body = link("base", 10.0, '<box size="0.2 0.2 0.3"/>', at="0 0 0.5")
    wheels = wheel("l", "base", (beside / 2, 0.2, 0)) + wheel("r", "base", (-beside / 2, -0.2, 0))
    assert drafted(robot(body, wheels))[0] == "free: 2 wheels under a body that balances"


# ---------------------------------------------------------------------- limits


def test_a_pair_of_disks_that_turn_once_are_wheels(drafted):
    """Exporters write the limits of a wrist for wheels too; one disk alone is a wrist."""
    kind, content, _ = drafted(cart(limits=(-3.14, 3.14), names=("part_3", "part_4")))
    assert kind == "planar: 2 wheels, differential drive"
    assert content["actuators"] == ["part_3_joint", "part_4_joint"]
    alone = cart(limits=(-3.14, 3.14)).replace('"r_joint" type="revolute"', '"r_joint" type="fixed"')
    for text in (alone, cart(limits=(-2.0, 2.0))):
        assert drafted(text)[0].startswith("fixed: no wheels were found")


# ---------------------------------------------------------------------- tracks and axles


@pytest.mark.parametrize(("called", "listed"), [("road", True), ("u", False)])
def test_sprockets_above_the_ground_drive_their_tracks(called, listed, drafted, tmp_path):
    parts = [link("base", 50.0, '<box size="1.2 0.4 0.2"/>', at="0 0 0.15")]
    for side, y in (("l", 0.3), ("r", -0.3)):
        parts += [wheel(f"{called}_{side}{k}", "base", (-0.4 + 0.2 * k, y, 0)) for k in range(4)]
        parts += [wheel(f"sprocket_{side}", "base", (0.6, y, 0.12), 0.08)]
    sprockets = ["sprocket_l_joint", "sprocket_r_joint"]
    kind, content, _ = drafted(robot(*parts, transmissions(*sprockets) if listed else ""))
    assert kind == "planar: 8 wheels, on tracks, skid-steered"
    assert content["actuators"] == sprockets
    couplings = {each["joint_coupling"]["joint"]: each["joint_coupling"]["ratio"] for each in content["constraints"]
                 if "joint_coupling" in each}  # fmt: skip
    assert len(couplings) == 8
    assert couplings["sprocket_l_joint"] == pytest.approx(0.1 / 0.08)
    run = run_of(tmp_path, **{"simulation.dt": 0.01})
    assert run.verdict.succeeded, run.verdict.first  # both ends of a track carry
    assert np.linalg.norm(run.q[-1, :2] - run.q[0, :2]) > 0.25


def test_an_axle_far_from_the_sides_is_no_sprocket(drafted):
    """Rollers of a conveyor above six wheels."""
    wheels = [wheel(f"w{k}{s}", "base", (0.2 * k, y, 0)) for k in range(3) for s, y in (("l", 0.3), ("r", -0.3))]
    rollers = [wheel(f"roll{k}", "base", (0.1 * k, 0, 0.3), 0.03) for k in range(3)]
    kind, content, _ = drafted(robot(link("base", 20.0, BOX), *wheels, *rollers))
    assert kind == "planar: 6 wheels, skid-steered"
    assert len(content["actuators"]) == 9


@pytest.mark.parametrize("reverse", [False, True])
def test_steered_wheels_turn_about_the_fixed_axle_that_does_not_skid(reverse, drafted):
    """A truck with two steered axles and three fixed ones: the middle one of these."""
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
