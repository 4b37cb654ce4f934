"""Broken files and arguments through the command line: one line on stderr, status 2, nothing written."""

import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

import rnc_pin as rnc
from patience import PATIENCE
from refusals import refused
from rnc_pin.applications.command_line.report import print_summary
from rnc_pin.applications.scenario.files import find_scenario, read_yaml, with_options
from simple_controllers import silent
from terminal import results
from urdf_parts import XACRO, inertial, write

QUICK = {"comparisons": {}, "simulation.duration": 0.1, "sweep": {}}
SPACE_ROBOT = with_options(read_yaml(find_scenario("space-robot")), QUICK)
CART = {  # a cart on two wheels, whose file is written by the case
    "robot": {"urdf": "robot.urdf", "base": "planar"},
    "constraints": [{"rolling_wheel": {"frame": f"wheel_{side}", "radius": 0.1}} for side in ("left", "right")],
    "actuators": ["wheel_left_joint", "wheel_right_joint"],
    "outputs": {"reducing": [{"frame_speed": {"frame": "base"}}, {"frame_yaw": "base"}]},
    "reference": {"primary": {"minimum_jerk": {"by": [0.1, 0.1], "duration": 1}}},
    "controller": {"type": "reducing_outputs", "tracker": "computed_torque"},
    "simulation": {"duration": 0.1},
}


def wheel(side, y, body=None, kind="continuous", axis="0 1 0", mimic="", parent="base"):
    return (
        f'<link name="wheel_{side}">{inertial(0.5, 0.01) if body is None else body}</link>'
        f'<joint name="wheel_{side}_joint" type="{kind}"><parent link="{parent}"/><child link="wheel_{side}"/>'
        f'<origin xyz="0 {y} 0.1"/><axis xyz="{axis}"/>{mimic}</joint>'
    )


LEFT, RIGHT = wheel("left", 0.2), wheel("right", -0.2)
BASE = f'<link name="base">{inertial(10)}</link>'


def urdf(*parts, base=BASE, attributes=""):
    return f'<robot name="cart" {attributes}>{base}{"".join(parts)}</robot>'


GOOD = urdf(LEFT, RIGHT)


def mjcf(body="", more="", head="", base='<freejoint name="float"/>'):
    wheels = "".join(
        f'<body name="wheel_{side}" pos="0 {y} 0"><joint name="wheel_{side}_joint" axis="0 1 0"/>'
        '<geom type="cylinder" size=".1 .02" mass="1" euler="90 0 0"/></body>'
        for side, y in (("left", 0.15), ("right", -0.15))
    )
    return (
        f'<mujoco model="cart">{head}<worldbody><body name="base" pos="0 0 0.1">{base}'
        f'<geom type="box" size=".2 .1 .05" mass="5"/>{wheels}{body}</body></worldbody>{more}</mujoco>'
    )


def scenario(changes=None, of=CART, command="run"):
    """A command on a scenario with values at dotted keys replaced."""
    return command, yaml.safe_dump(with_options(of, changes or {}), sort_keys=False).encode()


def text(content, command="run"):
    """A command on a file with this content."""
    return command, content if isinstance(content, bytes) else content.encode()


def on_mjcf(**changes):
    return scenario({"robot": {"mjcf": "robot.xml", "base": "planar", **changes}})


def on_xacro(**changes):
    return scenario({"robot": {"urdf": "robot.urdf.xacro", "base": "planar", **changes}})


def xacro(head="", radius="0.1"):
    return urdf(head, LEFT, RIGHT.replace('xyz="0 -0.2 0.1"', f'xyz="0 -0.2 {radius}"'), attributes=XACRO)


def laughs(levels=12):
    """YAML that is a few hundred bytes and would be gigabytes of values."""
    lines = ["a0: &a0 [lol, lol, lol, lol, lol, lol, lol, lol, lol]"]
    lines += [f"a{k}: &a{k} [{', '.join(9 * [f'*a{k - 1}'])}]" for k in range(1, levels)]
    return "\n".join(lines) + "\n"


ENTITIES = (
    '<!DOCTYPE robot [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY {chr(98 + k)} "{10 * f"&{chr(97 + k)};"}">' for k in range(10))
    + "]><robot name='&k;'/>"
)

# name: (content of the file, words of the message besides the file's name)
TEXTS = {  # mine.yaml
    "binary scenario": (bytes(range(256)), "cannot be read"),
    "URDF for a scenario": (GOOD,),
    "only a robot": ("robot: {urdf: space_robot.urdf}", "mine.yaml: outputs: is missing"),
    "key that is a number": ("3: 4\n", "'3' is not known"),
    "key that is a list": ("[1, 2]: 4\n", "line 1"),
    "merge of a number": ("robot:\n  <<: 3\n", "line 2"),
    "billion laughs": (laughs(),),
    "number too long": ("seed: " + 5000 * "9" + "\n",),
}
URDFS = {  # robot.urdf
    "URDF that is empty": ("", "not well-formed XML"),
    "URDF that is SDF": ("<sdf version='1.9'/>", "<sdf>", "expected <robot>"),
    "entities without end": (ENTITIES, "not well-formed XML"),
    "nothing but a ring":
        (urdf(wheel("left", 1, parent="wheel_right"), wheel("right", 1, parent="wheel_left"), base=""), "root"),
    "link with two parents": (urdf(LEFT, RIGHT, RIGHT[RIGHT.index("<joint") :].replace("wheel_right_joint", "other")),),
    "joint without a type": (GOOD.replace(' type="continuous"', "", 1), "wheel_left_joint", "type"),
    "joint without a child": (GOOD.replace('<child link="wheel_left"/>', ""), "wheel_left_joint"),
    "axis of no length": (urdf(LEFT, wheel("right", -0.2, axis="0 0 0")), "axis of joint 'wheel_right_joint' is zero"),
    "axis in words": (urdf(LEFT, wheel("right", -0.2, axis="y")), "wheel_right_joint"),
    "negative mass on a fixed link": (urdf(LEFT, RIGHT, wheel("spare", 0, inertial(-1), "fixed")),
        "mass of link 'wheel_spare' is negative: -1 kg"),
    "mass with a unit": (urdf(LEFT, wheel("right", -0.2, inertial("1kg"))), "1kg"),
    "mimic in words": (urdf(LEFT, wheel("right", -0.2, mimic='<mimic joint="wheel_left_joint" multiplier="twice"/>')),
        "multiplier of joint 'wheel_right_joint'", "'twice'"),
}  # fmt: skip
XACROS = {  # robot.urdf.xacro
    "xacro that is empty": ("",),
    "xacro that is no XML": ("<robot", "xacro", "line 1"),
    "xacro that is no robot": ("<html/>", "expected <robot>"),
    "unknown macro": (xacro("<xacro:wheeel/>"), "unknown macro name", "wheeel"),
    "unknown property": (xacro(radius="${size}"), "'size'"),
    "argument without a value": (xacro(radius="$(arg size)"), "argument 'size' has no value", "xacro_arguments"),
    "macro without its parameter": (xacro('<xacro:macro name="w" params="side"/><xacro:w/>'), "side"),
    "macro that calls itself": (xacro('<xacro:macro name="w"><xacro:w/></xacro:macro><xacro:w/>'), "recursive"),
    "xacro that includes itself": (xacro('<xacro:include filename="robot.urdf.xacro"/>'), "recursive"),
    "include of a missing file": (xacro('<xacro:include filename="wheels.xacro"/>'), "cannot read", "wheels.xacro"),
    "find of a missing package": (xacro('<xacro:include filename="$(find nopkg)/a.xacro"/>'), "no package 'nopkg'",
        "package_dirs"),
    "properties in a circle":
        (xacro('<xacro:property name="a" value="${b}"/><xacro:property name="b" value="${a}"/>', "${a}"), "circular"),
    "division by zero": (xacro(radius="${1/0}"), "division"),
    "xacro that runs a program": (xacro(radius="${(lambda: ().__class__.__base__.__subclasses__())()}"),
        "refuses to evaluate"),
    "xacro that would never end": (xacro(radius="${9**9**9**9}"), "refuses to evaluate"),
}  # fmt: skip
MJCFS = {  # robot.xml
    "MJCF that is empty": ("", "not well-formed XML"),
    "MJCF that is a URDF": (GOOD, "<robot>", "expected <mujoco>"),
    "MJCF of nothing": ("<mujoco/>", "no <body>"),
    "MJCF joint of an unknown type":
        (mjcf('<body name="c"><joint name="c" type="hingee"/><geom size=".1" mass="1"/></body>'), "hingee"),
    "MJCF mass in words": (mjcf('<body name="c"><joint name="c"/><geom size=".1" mass="heavy"/></body>'),
        "<geom>: mass", "'heavy'"),
    "MJCF missing mesh": (mjcf(head='<asset><mesh name="m" file="no.stl"/></asset>'), "no mesh", "no.stl"),
    "MJCF gravity in words": (mjcf(head='<option gravity="down"/>'), "<option>: gravity", "'down'"),
}  # fmt: skip
# name: (command and content of mine.yaml, other files, words of the message)
FILES = {
    "no such URDF": (scenario(), {}, ["mine.yaml", "robot.urdf", "no URDF file"]),
    "URDF that is a folder": (scenario({"robot.urdf": "meshes"}), {"meshes/a": ""}, ["no URDF file 'meshes'"]),
    "URDF with a zero byte in its name": (scenario({"robot.urdf": "a\0b"}), {}, ["no URDF file"]),
    "package_dirs without a URDF": (scenario({"robot": {"example": "panda", "package_dirs": ["."]}}), {},
        ["robot: 'package_dirs' belongs to 'urdf'"]),
    "unknown argument of a xacro": (on_xacro(xacro_arguments={"sizze": 3}),
        {"robot.urdf.xacro": xacro('<xacro:arg name="size" default="1"/>')},
        ["robot.urdf.xacro", "no xacro argument 'sizze'", "did you mean 'size'?"]),
    "argument of no kind": (on_xacro(xacro_arguments={"size": [1, 2]}), {"robot.urdf.xacro": xacro()},
        ["robot.xacro_arguments.size", "[1, 2]"]),
    "arguments for a URDF": (scenario({"robot.xacro_arguments": {"size": 3}}), {"robot.urdf": GOOD},
        ["robot.urdf", "whose name ends in .xacro"]),
    "no such MJCF": (on_mjcf(), {"robt.xml": mjcf()}, ["no MJCF file", "did you mean 'robt.xml'?"]),
    "MJCF of an unknown frame": (scenario({"robot": {"mjcf": "robot.xml", "base": "planar"},
        "outputs.reducing.1.frame_yaw": "bas"}), {"robot.xml": mjcf()},
        ["mine.yaml", "frame 'bas'", "did you mean 'base'?"]),
    **{name: (text(content), {}, ["mine.yaml", *words]) for name, (content, *words) in TEXTS.items()},
    **{name: (scenario(), {"robot.urdf": it}, ["robot.urdf", *words]) for name, (it, *words) in URDFS.items()},
    **{name: (on_xacro(), {"robot.urdf.xacro": it}, ["robot.urdf.xacro", *words]) for name,
        (it, *words) in XACROS.items()},
    **{name: (on_mjcf(), {"robot.xml": it}, ["robot.xml", *words]) for name, (it, *words) in MJCFS.items()},
}  # fmt: skip

# name: (changes of the cart's scenario, words)
MEETINGS = {
    "frame for a joint": ({"actuators.0": "base"}, ["joint 'base'", "wheel_left_joint"]),
    "force without an axis": ({"actuators.0": {"force": {"frame": "base"}}}, ["actuators[0].force.axis: is missing"]),
    "force of no limit": ({"actuators.0": {"force": {"frame": "base", "axis": "x", "limit": 0}}},
        ["actuators[0].force.limit", "greater than 0"]),
    "two kinds in one constraint": ({"constraints.0": {"rolling_wheel": {}, "no_side_slip": {}}},
        ["constraints[0]: expected a mapping with one key"]),
    "constraint of nothing": ({"constraints.0": None}, ["constraints[0]", "None"]),
    "points and times of different length": ({"reference.primary": {"via_points": {"times": [1, 2],
        "points": [[1, 1]]}}}, ["reference.primary", "2 times for 1 points"]),
    "active actuator of another type": ({"controller.active": ["wheel_left_joint"]},
        ["controller.active", "'reducing_outputs'"]),
    "redundancy without vertical outputs": ({"controller": {"type": "redundancy"}}, ["mine.yaml"]),
    "steering without a steering wheel": ({"controller": {"type": "steering"}}, ["mine.yaml"]),
    "two phases without a platform": ({"controller": {"type": "two_phase"}}, ["controller.platform: is missing"]),
    "transpose of an unknown actuator": ({"controller": {"type": "jacobian_transpose", "active": ["wheel_lef"]}},
        ["'wheel_lef'", "did you mean"]),
    "path of a frame that is not there": ({"reference": {"path": {"frame": "bas", "to": [1, 0, 0], "duration": 3,
        "wheelbase": 1}}}, ["mine.yaml"]),
    "step longer than the run": ({"simulation.dt": 5}, ["mine.yaml", "dt"]),
    "run beyond memory": ({"simulation.duration": 1e12, "simulation.dt": 1e-6}, ["mine.yaml", "simulation"]),
    "comparisons of one name": ({"comparisons": {"a b": {"seed": 1}, "a-b": {"seed": 2}}},
        ["comparisons", "give one file name"]),
}  # fmt: skip


# name: (arguments, files, words)
DRAFTS = {
    "no such robot": (["robt.urdf"], {"robot.urdf": GOOD}, ["no robot 'robt.urdf'"]),
    "misspelt example": (["tiago_no_hnd"], {}, ["did you mean 'tiago_no_hand'?"]),
    "misspelt shipped": (["space_robt.urdf"], {}, ["did you mean 'space_robot.urdf'?"]),
    "folder": (["."], {"robot.urdf": GOOD}, ["'.'", "folder"]),
    "binary": (["robot.urdf"], {"robot.urdf": bytes(range(256))}, ["robot.urdf", "not well-formed XML"]),
    "scenario": (["mine.yaml"], {"mine.yaml": "robot: {}"},
        ["that is a scenario, not a robot: run it with: rnc-pin run mine.yaml"]),
    "unknown base": (["robot.urdf", "--base", "flying"], {"robot.urdf": GOOD}, ["'--base'", "'flying'"]),
    "out exists": (["robot.urdf", "--out", "a.yaml"], {"robot.urdf": GOOD, "a.yaml": "mine"}, ["a.yaml", "--force"]),
    "out is a folder": (["robot.urdf", "--out", "d"], {"robot.urdf": GOOD, "d/x": ""}, ["--out d", "is a folder"]),
    "out in no folder": (["robot.urdf", "--out", "no/a.yaml"], {"robot.urdf": GOOD},
        ["--out no/a.yaml", "does not exist"]),
    "argument of a URDF": (["robot.urdf", "--arg", "a=1"], {"robot.urdf": GOOD}, ["whose name ends in .xacro"]),
    "argument of an MJCF": (["robot.xml", "--arg", "a=1"], {"robot.xml": mjcf()}, ["'xacro_arguments' belongs to"]),
    "broken xacro": (["r.xacro"], {"r.xacro": "<robot"}, ["r.xacro"]),
}  # fmt: skip
SWEPT = {
    "sweep of an unknown key": ("simulation.nothing", ["sweep.simulation.nothing", "'nothing' is not known"]),
    "sweep of words": ("title", ["sweep.title", "string"]),
}
BELOW_A_FILE = ["space-robot", "--out", "file/out"]


def on_file(command="run"):
    return [command, "mine.yaml", *{"run": ["--out", "out"], "sweep": ["--out", "out", "--runs", 1]}.get(command, [])]


# name: (arguments, files, words)
CASES = {
    **{name: (on_file(command), {"mine.yaml": content, **files}, words)
        for name, ((command, content), files, words) in FILES.items()},
    **{name: (on_file(), {"mine.yaml": scenario(changes)[1], "robot.urdf": GOOD}, words)
        for name, (changes, words) in MEETINGS.items()},
    **{f"draft: {name}": (["init", *arguments], files, words) for name, (arguments, files, words) in DRAFTS.items()},
    **{name: (on_file("sweep"), {"mine.yaml": scenario({"sweep": {key: [0, 1]}}, SPACE_ROBOT)[1]}, words)
        for name, (key, words) in SWEPT.items()},
    "run below a file": (["run", *BELOW_A_FILE], {"file": "mine"}, ["--out file/out"]),
    "sweep below a file": (["sweep", *BELOW_A_FILE, "--runs", 1], {"file": "mine"}, ["--out file/out"]),
}  # fmt: skip


def check_refusal(call, folder, arguments, words):
    """The command ends with status 2, one line that holds the words, and the folder as it was."""
    before = sorted(folder.rglob("*"))
    status, out, error = call(*arguments)
    assert error.endswith("\n"), error
    assert len(error.splitlines()) == 1, error
    assert error.startswith("rnc-pin: error: "), error
    assert "unexpected" not in error
    assert len(error) < 600
    assert (status, results(out)) == (2, ""), error
    for word in words:
        assert word in error, error
    assert sorted(folder.rglob("*")) == before


def fill(folder, files):
    for name, content in files.items():
        write(folder / name, content)


@pytest.mark.parametrize(("arguments", "files", "words"), CASES.values(), ids=CASES)
def test_what_is_broken_is_refused_in_one_line(arguments, files, words, call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fill(tmp_path, files)
    check_refusal(call, tmp_path, arguments, words)


def test_a_wheel_about_the_wrong_axle_lies_flat(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    files = scenario({"constraints.0": {"rolling_wheel": {"frame": "wheel_left", "radius": 0.1, "axis": "z"}}})
    fill(tmp_path, {"mine.yaml": files[1], "robot.urdf": GOOD})
    status, _, error = call("run", "mine.yaml", "--out", "out")
    assert status == 2
    assert "a wheel lies flat on the ground" in error.splitlines()[-1]


@pytest.mark.parametrize("name", ["mine.yaml", "robot.urdf"])
def test_a_file_that_fails_while_it_is_read_is_refused(name, call, tmp_path, monkeypatch):
    """As a disk or a network share does: /proc/self/mem opens, and cannot be read at its beginning."""
    monkeypatch.chdir(tmp_path)
    fill(tmp_path, {"mine.yaml": scenario()[1], "robot.urdf": GOOD})
    (tmp_path / name).unlink()
    (tmp_path / name).symlink_to("/proc/self/mem")
    check_refusal(call, tmp_path, ["run", "mine.yaml", "--out", "out"], ["cannot be read"])


def test_what_the_cases_break_is_whole(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fill(tmp_path, {"robot.urdf": GOOD, "robot.xml": mjcf(), "robot.urdf.xacro": xacro(radius="${0.05 * 2}")})
    for _, content in (scenario(), on_mjcf(), on_xacro(), scenario(of=SPACE_ROBOT)):
        write(tmp_path / "mine.yaml", content)
        status, _, error = call("inspect", "mine.yaml", "--samples", 2)
        assert (status, error) == (0, "")


def small():
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
    reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
    return system, reduced, rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([1.0, 0.0]))


WRONG_ARGUMENTS = {
    "no controller": ({"controller": None}, "expected a controller with initial_state and step"),
    "a class": ({"controller": rnc.control.VelocityTracker},
        "the controller is the class VelocityTracker: pass an instance of it"),
    "no model": ({"reduced": None}, "expected a ReducedModel, found None"),
    "words for q0": ({"q0": "here"}, "q0 is not an array of numbers: 'here'"),
    "no q0": ({"q0": None}, "q0 is not an array of numbers: None"),
    "words for v2_0": ({"v2_0": "fast"}, "v2 is not an array of numbers: 'fast'"),
    "a time in words": ({"duration": "1"}, "duration '1' and dt 0.01 have to be positive numbers"),
    "a step backwards": ({"dt": -1.0}, "duration 0.1 and dt -1.0 have to be positive numbers"),
    "a plant": ({"plant": object()}, "plant: expected methods reset, read, apply, advance, found a object"),
    "meta": ({"options": rnc.SimulationOptions(meta=3)}, "meta: expected a Provenance or a mapping, found int"),
    "options": ({"options": {"meta": 3}}, "options: expected SimulationOptions, found a dict"),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG_ARGUMENTS)
def test_arguments_of_simulate_are_refused_before_anything_runs(what):
    changed, words = WRONG_ARGUMENTS[what]
    _, reduced, target = small()
    tracker, q0 = rnc.control.VelocityTracker(target), reduced.robot.configuration()
    given = {"reduced": reduced, "controller": tracker, "q0": q0, "duration": 0.1, "dt": 0.01}
    with pytest.raises(rnc.RncError, match=words):
        rnc.simulate(**{**given, **changed})


test_options_of_a_simulation_are_refused = refused([
    (lambda: rnc.SimulationOptions(stop="now"), "stop: expected a Stop, found a str"),
    (lambda: rnc.SimulationOptions(loop=3), "loop: expected a mapping of options of ControlLoop, found a int"),
    (lambda: rnc.SimulationOptions(observer=3), "observer: expected a function of a Sample"),
    (lambda: rnc.SimulationOptions(loop={"limit": True}), "loop: no option 'limit'; did you mean 'limits'"),
    (lambda: rnc.ReducedPlant(small()[1], substeps="2"), "substeps of a plant .* a positive integer, found '2'"),
])  # fmt: skip


def test_a_kinematic_controller_and_a_step_of_another_kind_are_named():
    system, reduced, target = small()
    q0 = reduced.robot.configuration()
    with pytest.raises(rnc.RncError, match=r"decides velocities, not forces: .*VelocityTracker\(it\)"):
        rnc.simulate(reduced, target, q0, 0.1)
    lazy = SimpleNamespace(initial_state=lambda _: None, step=lambda *_: rnc.control.Command(T=np.zeros(2)))
    with pytest.raises(rnc.RncError, match="has to return a Command and its state, found a Command"):
        rnc.simulate(reduced, lazy, q0, 0.1)
    with pytest.raises(rnc.ConfigurationError, match="found a NonholonomicSystem: call reduce"):
        rnc.simulate(system, lazy, q0, 0.1)


def test_rows_without_names_are_numbered_through():
    robot, rows = rnc.Robot.from_urdf("space_robot.urdf"), np.eye(4)

    def held(*which, names=None):
        chosen = rows[list(which)]
        return rnc.Pfaffian(lambda q: chosen, lambda q, v: 0 * chosen, names)

    again = held(1)  # a kind is a description: binding one leaves the others as they are
    for kinds, names in (
        ([held(1), held(0, names=["mine"])], ("row[0]", "mine")),
        ([again], ("row[0]",)),
        ([held(2, 3), again], ("row[0]", "row[1]", "row[2]")),
    ):
        assert rnc.NonholonomicSystem(robot, kinds).constraints.names == names


def test_a_plant_that_tells_no_work_has_no_drift(capsys):
    _, reduced, target = small()
    tracker, plant = rnc.control.VelocityTracker(target), silent(rnc.ReducedPlant(reduced))
    summary = rnc.summarize(rnc.simulate(reduced, tracker, reduced.robot.configuration(), 0.1, 0.01, plant=plant))
    assert summary["energy_drift"] is None
    print_summary(summary)
    out = capsys.readouterr().out
    assert "nan" not in out
    assert "drift" not in out


@pytest.mark.parametrize(("output", "words"), [(">/dev/full", "cannot be written: No space"), (">&-", "is closed")])
@pytest.mark.parametrize("command", ["list", "run space-robot --out OUT --set simulation.duration=0.1"])
def test_a_standard_output_that_takes_nothing_is_told_in_one_line(command, output, words, tmp_path):
    line = f"{sys.executable} -m rnc_pin {command.replace('OUT', str(tmp_path / 'run'))} {output}"
    ended = subprocess.run(["sh", "-c", line], capture_output=True, text=True, timeout=PATIENCE)
    assert ended.returncode != 0
    (told,) = ended.stderr.splitlines()
    assert re.fullmatch(f"rnc-pin: error: standard output {words}.*", told)
