# ruff: noqa: E501
"""Files of strangers: what would hang, fill memory, be passed over or end in an error that is not ours."""

import base64
import json
import os
import re
import tracemalloc
import zipfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import mesh_solid as solid
import rnc_pin as rnc
from patience import ending_within
from rnc_pin.applications.command_line.replay import load_run
from rnc_pin.applications.command_line.report import print_object, print_summary
from rnc_pin.applications.scenario.files import parse_option, read_yaml
from rnc_pin.io.json import dump_json
from rnc_pin.robots.robot_files import shipped_directory
from rnc_pin.visualization import mg
from rnc_pin.visualization.scene_bodies import drawn_mesh, own_textures
from urdf_parts import INERTIAL, inertial, write

LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def tree(count, kind="fixed", parent=lambda k: k, inside=""):
    """A robot of joints of one kind; joint k carries link k + 1."""
    links = "".join(f'<link name="l{k}">{INERTIAL}</link>' for k in range(count + 1))
    joints = "".join(
        f'<joint name="j{k}" type="{kind}"><parent link="l{parent(k)}"/><child link="l{k + 1}"/><origin xyz="0.1 0 0"/>'
        f'<axis xyz="0 0 1"/>{LIMIT}{inside}</joint>'
        for k in range(count)
    )
    return f'<robot name="r">{links}{joints}</robot>'


def nested(form, depth=9, width=9):
    lines = [f"a0: &a0 {'{x: 1}' if '<<' in form else '[x]'}"]
    lines += [f"a{k + 1}: &a{k + 1} {form.format(', '.join([f'*a{k}'] * width))}" for k in range(depth)]
    return "\n".join(lines)


@pytest.mark.parametrize(("text", "words"), [
    (nested("{{<<: [{}]}}"), "expands to more than 100,000 values"),
    (nested("[{}]"), "expands to more than 100,000 values"),
    ("a: &a [*a]", "contains itself"),
    ("a: &a {<<: *a}", "contains itself"),
    ("a: " + "[" * 5_000, "nested too deeply"),
    ("a: 1\n" * 500_000, "longer than"),
])  # fmt: skip
def test_a_scenario_that_would_not_end_is_refused(text, words, tmp_path):
    with ending_within(5), pytest.raises(rnc.ConfigurationError, match=words):
        read_yaml(write(tmp_path / "s.yaml", text))


@pytest.mark.parametrize(
    "text", ["!!bool maybe", "!!int ''", "!!float {a: 1}", "!!timestamp no", "!!binary 'é'", "!!set [1]"]
)
def test_a_value_that_is_not_what_its_tag_says_is_refused(text, tmp_path):
    with pytest.raises(rnc.ConfigurationError, match=r"s\.yaml"):
        read_yaml(write(tmp_path / "s.yaml", f"title: {text}"))
    with pytest.raises(rnc.ConfigurationError):
        parse_option(f"title={text}")


def test_aliases_and_merges_of_sensible_size_are_read(tmp_path):
    content = read_yaml(write(tmp_path / "s.yaml", "a: &a {x: 1, y: 2}\nb: {<<: *a, y: 3}\nc: [*a, *a]"))
    assert content == {"a": {"x": 1, "y": 2}, "b": {"x": 1, "y": 3}, "c": [{"x": 1, "y": 2}, {"x": 1, "y": 2}]}


def test_a_pipe_is_not_waited_for(tmp_path):
    for name in ("r.urdf", "r.xml", "s.yaml", "r.xacro"):
        os.mkfifo(tmp_path / name)
    with ending_within(5):
        for read, name in (
            (rnc.Robot.from_urdf, "r.urdf"), (rnc.Robot.from_urdf, "r.xacro"), (rnc.Robot.from_mjcf, "r.xml"),
            (read_yaml, "s.yaml"),
        ):  # fmt: skip
            with pytest.raises(rnc.RncError):
                read(tmp_path / name)


def test_thousands_of_links_are_read_in_time_that_grows_as_they_do(tmp_path):
    with ending_within(8):
        assert robot_of(tmp_path, tree(4_000, parent=lambda k: k // 10), base="planar").nv == 3


RING = '<joint name="back" type="fixed"><parent link="l2000"/><child link="l0"/></joint></robot>'


@pytest.mark.parametrize(("text", "base", "words"), [
    (tree(2_000), "planar", "a chain of more than 1000 links"),  # in which recursion would end the process
    (tree(2_000).replace("</robot>", RING), "fixed", "in a loop of links"),
    (tree(1_000, "revolute"), "fixed", "1000 degrees of freedom, limit 256"),
], ids=["chain", "ring", "memory"])  # fmt: skip
def test_a_robot_too_large_is_refused_at_once(text, base, words, tmp_path):
    with ending_within(10), pytest.raises(rnc.ModelError, match=words):
        robot_of(tmp_path, text, base=base)


@pytest.mark.parametrize("name", ["r.urdf", "r.xml", "r.xacro"])
def test_xml_too_deep_is_refused(name, tmp_path):
    with ending_within(10), pytest.raises(rnc.ModelError, match="deep"):
        robot_of(tmp_path, "<robot name='r'>" + "<a>" * 100_000 + "</a>" * 100_000 + "</robot>", name)


def test_a_name_is_compared_with_others_in_bounded_time():
    with ending_within(3):
        rnc.errors.nearest("x" * 100_000, ["y" * 100_000, "z"])
        rnc.errors.nearest("joint_5", [f"joint_{k}" for k in range(100_000)])


def test_many_mimics_of_nothing_are_told_at_once(tmp_path):
    with ending_within(20), pytest.warns(rnc.ModelWarning, match="and 199 more"):
        robot_of(tmp_path, tree(200, "revolute", inside='<mimic joint="nobody"/>'))


@pytest.mark.parametrize("count", [2, 12])
def test_a_loop_out_of_reach_is_refused_at_once(count, tmp_path):
    robot = robot_of(tmp_path, tree(count, "continuous"))
    anchor = rnc.LoopClosure("universe", f"l{count}", "point", offset_a=(30.0, 0.0, 0.0))
    with ending_within(2), pytest.raises(rnc.ConstraintError, match="from 25 random configurations"):
        rnc.NonholonomicSystem(robot, [anchor])


def robot_of(folder, text, name="r.urdf", **options):
    """The robot of a file with this text, which is MJCF or a URDF."""
    read = rnc.Robot.from_mjcf if "<mujoco" in text or name == "r.xml" else rnc.Robot.from_urdf
    return read(write(folder / name, text), **options)


def arm(inside="", mass="1", moment="1", link="", limit=LIMIT):
    return (
        f'<robot name="r"><link name="a">{INERTIAL}</link><link name="b">{inertial(mass, moment)}{link}</link><joint name="j" '
        f'type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>{limit}{inside}</joint></robot>'
    )


def mjcf(body, head=""):
    return f'<mujoco>{head}<worldbody><body name="b">{body}</body></worldbody></mujoco>'


@pytest.mark.parametrize("head", [
    '<!DOCTYPE r [<!ENTITY e SYSTEM "secret.txt">]>', '<!DOCTYPE r SYSTEM "r.dtd">', "",
], ids=["file", "DTD", "no"])  # fmt: skip
@pytest.mark.parametrize("name", ["r.urdf", "r.urdf.xacro"])
def test_an_entity_of_another_file_is_refused_and_not_read_as_nothing(head, name, tmp_path):
    write(tmp_path / "secret.txt", "hush")
    with pytest.raises(rnc.ModelError, match="not well-formed XML: undefined entity"):
        robot_of(tmp_path, head + arm().replace("</robot>", "&e;</robot>"), name)


@pytest.mark.parametrize(("text", "words"), [
    (arm(link=INERTIAL.replace('"1"', '"7"')), "a second <inertial>, which is left out: link b"),
    (arm('<axis xyz="1 0 0"/>'), "a second <axis>, which is left out: joint j"),
    (arm('<origin xyz="1 0 0"/><origin xyz="2 0 0"/>'), "a second <origin>, which is left out: joint j"),
    (arm(LIMIT), "a second <limit>, which is left out: joint j"),
    (arm(limit='<limit lower="1" upper="-1" effort="1" velocity="1"/>'), "above the upper and is taken as unlimited: joint j"),
    (mjcf('<joint name="j" stiffness="5"/><geom size="1" mass="1"/>'), r"springs .* are left out of the model: joint j"),
])  # fmt: skip
def test_what_is_not_taken_as_written_is_warned_of(text, words, tmp_path):
    with pytest.warns(rnc.ModelWarning, match=words):
        robot = robot_of(tmp_path, text)
    assert robot.model.inertias[1].mass == 1
    if "above" in words:
        assert robot.model.lowerPositionLimit[0] < -1e100


GEOM, HINGE = '<geom size="1" mass="1"/>', '<joint name="j" type="hinge"/>'


@pytest.mark.parametrize(("text", "words"), [
    (arm('<dynamics damping="-1"/>'), "damping of joint 'j' is negative"),
    (arm('<dynamics friction="-1"/>'), "friction of joint 'j' is negative"),
    (arm(mass="1e308"), "limit 1e.15"),
    (arm(moment="1e300"), "limit 1e.15"),
    (arm('<origin xyz="0 1e308 0"/>'), "placement of 'j' is 1e.308 m from its parent"),
    (mjcf(f'{HINGE}{GEOM}<composite type="cable" count="5 1 1"/>'), "<composite> is not supported"),
    (mjcf(f'<joint name="j" damping="-1"/>{GEOM}'), "damping of joint 'j' is negative"),
    (mjcf(f'<joint name="j" range="2 1"/>{GEOM}'), "range of joint 'j' has a lower limit above the upper"),
    (mjcf(HINGE + 2 * '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'),
        "unique element 'inertial' found 2 times"),
    (mjcf(HINGE + GEOM, '<compiler settotalmass="much"/>'), "<compiler>: settotalmass takes a finite number"),
    (mjcf(HINGE.replace('"j"', '"universe"') + GEOM), "a joint cannot be called 'universe'"),  # ended the process
    (mjcf(f'<body pos="1\xa00 0">{HINGE}{GEOM}</body>'), "pos takes 3 finite numbers"),
])  # fmt: skip
def test_what_no_machine_is_is_refused_by_name(text, words, tmp_path):
    with pytest.raises(rnc.ModelError, match=words):
        robot_of(tmp_path, text)


def test_a_joint_of_the_bases_name_is_refused_beside_a_base(tmp_path):
    text = mjcf(HINGE.replace('"j"', '"root_joint"') + GEOM)
    with pytest.raises(rnc.ModelError, match="a joint cannot be called 'root_joint'"):
        robot_of(tmp_path, text, base="planar")
    assert robot_of(tmp_path, text).joint_names == ("root_joint",)


@pytest.mark.parametrize("ratio", [-1e308, 1e200])  # of the second the square alone has no room
def test_a_coupling_without_bound_is_refused(ratio, tmp_path):
    robot = robot_of(tmp_path, tree(2, "continuous"))
    with pytest.raises(rnc.ConstraintError, match="constraint rows overflow"):
        rnc.NonholonomicSystem(robot, [rnc.JointCoupling("j0", "j1", ratio, 1.0)])


def collada(image):
    images = f'<library_images><image id="i"><init_from>{image}</init_from></image></library_images>'
    return solid.collada().decode().replace("<library_geometries>", f"{images}<library_geometries>", 1)


PNG = b"\x89PNG\r\n\x1a\n" + b"pixels"


@pytest.mark.parametrize(("image", "shown"), [
    ("robot/textures/skin.png", True), ("robot/meshes/skin.png", True), ("robot/meshes/secret.png", False),
    ("elsewhere/secret.txt", False), ("elsewhere/skin.png", False), ("robot/meshes/link.png", False),
    ("robot/meshes/missing.png", False),
])  # fmt: skip
def test_pages_take_along_images_of_the_robot_alone(image, shown, tmp_path):
    for name in ("robot/textures/skin.png", "robot/meshes/skin.png", "elsewhere/skin.png"):
        write(tmp_path / name, PNG)
    for name in ("robot/meshes/secret.png", "elsewhere/secret.txt"):
        write(tmp_path / name, "hush")
    (tmp_path / "robot/meshes/link.png").symlink_to(tmp_path / "elsewhere/skin.png")
    write(tmp_path / "robot/meshes/m.dae", collada(tmp_path / image))
    visual = '<visual><geometry><mesh filename="meshes/m.dae"/></geometry></visual>'
    robot = rnc.Robot.from_urdf(write(tmp_path / "robot/r.urdf", arm(link=visual)))
    (shape,) = robot.visual_model.geometryObjects
    if shown:
        pixels = base64.b64encode(PNG).decode()
        expected = {str(tmp_path / image): f"data:image/png;base64,{pixels}"}
        assert drawn_mesh(shape, robot.folders)["object"]["resources"] == expected
    else:
        with pytest.warns(rnc.ModelWarning, match="is not an image below the robot's own folders"):
            assert isinstance(drawn_mesh(shape, robot.folders), mg.TriangularMeshGeometry)


@pytest.mark.parametrize("namespace", ["http://www.collada.org/2005/11/COLLADASchema", "urn:other"])
@pytest.mark.parametrize("image", ["<ref>{}</ref>", "<b>{}</b>", "<b/>{}", "<b><c>{}</c></b>", "\n<b>{}</b>"])
def test_an_image_whose_name_has_child_elements_is_left_out(image, namespace, tmp_path):
    """Meshcat's page takes the text of all of them as an address, in any namespace."""
    text = collada(image.format("http://192.0.2.1/skin.png"))
    text = text.replace("http://www.collada.org/2005/11/COLLADASchema", namespace)
    with pytest.warns(rnc.ModelWarning, match="is not an image below the robot's own folders"):
        assert own_textures(write(tmp_path / "m.dae", text), []) is None


LONG = "x" * 5000


@pytest.mark.parametrize(
    "name", [LONG, f"{LONG}.stl", f"package://{LONG}/m.stl", f"file:///{LONG}", "a/" * 3000 + "m.stl"]
)
def test_a_mesh_of_an_impossible_name_is_a_mesh_that_is_not_there(name, tmp_path):
    visual = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
    robot = robot_of(tmp_path, arm(link=visual))
    with pytest.warns(rnc.ModelWarning, match="1 mesh was not found") as warned:
        assert [shape.name for shape in robot.visual_model.geometryObjects] == ["b_stand_in"]
    assert all(issubclass(each.category, rnc.ModelWarning) for each in warned)
    light = robot_of(tmp_path, arm(link=visual, mass="0", moment="0"), masses={"b": 2.0}, package_dirs=[LONG])
    assert light.model.inertias[1].mass == 2.0


@pytest.mark.parametrize(("name", "text"), [
    ("r.xml", mjcf(f'{HINGE}{GEOM}<geom type="mesh" mesh="m"/>', f'<asset><mesh name="m" file="{LONG}"/></asset>')),
    ("r.xml", mjcf(HINGE + GEOM, f'<include file="{LONG}"/>')),
    ("r.xacro", f'<robot name="r" xmlns:xacro="x"><xacro:include filename="{LONG}"/></robot>'),
    ("r.xacro", f'<robot name="r" xmlns:xacro="x"><xacro:include filename="$(find {LONG})/a"/></robot>'),
])  # fmt: skip
def test_files_of_impossible_names_are_refused_in_one_line(name, text, tmp_path):
    with pytest.raises(rnc.ModelError) as caught:
        robot_of(tmp_path, text, name)
    assert len(str(caught.value)) < 4100


@pytest.mark.parametrize(
    "load", [rnc.Robot.from_urdf, rnc.Robot.from_mjcf, rnc.Robot.from_example, rnc.Trajectory.load, load_run]
)
def test_an_impossible_name_is_bad_input(load):
    with pytest.raises(rnc.RncError):
        load(Path(LONG))


@pytest.fixture(scope="module")
def run_file(tmp_path_factory):
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
    path = tmp_path_factory.mktemp("run") / "trajectory.npz"
    rnc.free_motion(reduced, robot.configuration(), [1.0, 0.5], duration=0.2).save(path)
    return path


@contextmanager
def little_memory():
    """Fail if the block allocates 20 MB at a time."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < 20 * 2**20
    finally:
        tracemalloc.stop()


def rewritten(run_file, path, change):
    """A run whose arrays are changed by a function."""
    with np.load(run_file) as file:
        np.savez(path, **change(dict(file)))
    return path


def archive(path, arrays):
    """An .npz of zeros: shape and dtype that its headers say, and the bytes that there are, by name."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, (shape, dtype, size) in arrays.items():
            with file.open(name + ".npy", "w") as member:
                np.lib.format.write_array_header_1_0(member, {"descr": dtype, "fortran_order": False, "shape": shape})
                for start in range(0, size, 2**20):
                    member.write(bytes(min(2**20, size - start)))
    return path


MANY = dict.fromkeys(("time", "energy", "work", "singular_value", "position_residual"), ((2**23,), "<f8", 2**26))
BOMBS = {
    "a gigabyte of zeros": ({"time": ((2**27,), "<f8", 2**26)}, "take more than 268,435,456 bytes: 'time' has shape"),
    "many that are large together": (MANY, "take more than 268,435,456 bytes"),
    "a header that promises": ({"time": ((2**24,), "<f8", 80)}, "'time' is shorter than its header declares"),
    "a header that hides": ({"time": ((2,), "<f8", 2**26)}, "'time' is longer than its header declares"),
    "more than memory": ({"time": ((2**60,), "<f8", 8)}, "take more than 268,435,456 bytes"),
    "a shape below zero": ({"time": ((-1, -(2**40)), "<f8", 8)}, "'time' has shape"),
    "long letters": ({"meta": ((), "<U100000000", 2**20)}, "'meta' has shape"),
    "objects": ({"time": ((2,), "|O", 16)}, "'time' holds no numbers"),
    "records": ({"time": ((2,), [("a", "<f8")], 16)}, "'time' holds no numbers"),
}


@pytest.mark.parametrize("what", BOMBS)
def test_archives_that_would_fill_memory_are_refused_before_they_do(what, tmp_path):
    arrays, reason = BOMBS[what]
    path = archive(tmp_path / "t.npz", arrays)
    with little_memory(), pytest.raises(rnc.ConfigurationError, match=re.escape(reason)):
        rnc.Trajectory.load(path)


def test_headers_of_arrays_are_short(tmp_path):
    """Those of version 2 have a length of their own, which NumPy takes before it looks."""
    path = tmp_path / "t.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file, file.open("time.npy", "w") as member:
        member.write(np.lib.format.magic(2, 0) + (2**26).to_bytes(4, "little"))
        for _ in range(2**6):
            member.write(b" " * 2**20)
    with little_memory(), pytest.raises(rnc.ConfigurationError, match="'time' is not an array of numbers"):
        rnc.Trajectory.load(path)


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_ways_to_compress_that_take_memory_of_their_own_are_not_read(method, run_file, tmp_path):
    path = tmp_path / "t.npz"
    with zipfile.ZipFile(run_file) as source, zipfile.ZipFile(path, "w", method) as target:
        for name in source.namelist():
            target.writestr(name, source.read(name))
    with pytest.raises(rnc.ConfigurationError, match="has an unsupported compression method"):
        rnc.Trajectory.load(path)


def test_a_directory_that_says_less_than_there_is_gains_nothing(tmp_path):
    """Sizes are believed of neither; the array is read to the size of its header, and has to end there."""
    path = archive(tmp_path / "t.npz", {"time": ((4,), "<f8", 2**26)})
    content = path.read_bytes()
    for size in (2**26 + 128, 2**26):
        content = content.replace(size.to_bytes(4, "little"), (128 + 32).to_bytes(4, "little"))
    path.write_bytes(content)
    with little_memory(), pytest.raises(rnc.ConfigurationError, match="not a trajectory"):
        rnc.Trajectory.load(path)


def test_a_large_run_loads_where_it_is_asked_for(run_file, tmp_path, monkeypatch):
    with np.load(run_file) as file:
        size = sum(array.nbytes for array in dict(file).values())
    assert rnc.Trajectory.load(run_file, largest=size).outcome == "completed"
    with pytest.raises(rnc.ConfigurationError, match=f"take more than {size // 2:,} bytes"):
        rnc.Trajectory.load(run_file, largest=size // 2)
    monkeypatch.setattr("rnc_pin.io.safe_npz.ROOM", 0)  # a run of any length is within what its own size allows
    assert rnc.Trajectory.load(run_file).outcome == "completed"


@pytest.mark.parametrize("change", [
    lambda meta: {**meta, "names": None},
    lambda meta: {**meta, "names": {"x1": 3}},
    lambda meta: {**meta, "names": {**meta["names"], "x2": ["a\n\x1b[31m" * 1000]}},
    lambda meta: {**meta, "outcome": "\x1b[2J"},
    lambda meta: {**meta, "rotations": {"x1": ["a"]}},
    lambda meta: [],
    lambda meta: 10**400,
])  # fmt: skip
def test_meta_that_is_crafted_is_refused_in_a_line(change, run_file, tmp_path):
    def crafted(arrays):
        return {**arrays, "meta": np.array(json.dumps(change(json.loads(str(arrays["meta"])))))}

    with pytest.raises(rnc.RncError) as raised:
        rnc.Trajectory.load(rewritten(run_file, tmp_path / "t.npz", crafted))
    assert str(raised.value).isprintable()
    assert len(str(raised.value)) < 1000


@pytest.mark.parametrize(("change", "words"), [
    *(({"meta": np.array(meta)}, "not a trajectory") for meta in ("[" * 100_000, "{", "NaN", '{"names": ' * 5000)),
    ({"time": None}, "runs backwards"),
])  # fmt: skip
def test_arrays_that_are_no_run_are_refused(change, words, run_file, tmp_path):
    def changed(arrays):
        return {**arrays, **{name: arrays[name][::-1] if name == "time" else new for name, new in change.items()}}

    with pytest.raises(rnc.ConfigurationError, match=words):
        rnc.Trajectory.load(rewritten(run_file, tmp_path / "t.npz", changed))


def test_every_error_is_one_printable_line_of_bounded_length():
    for kind in (rnc.ModelError, rnc.ConfigurationError, rnc.DivergenceError):
        text = str(kind("a\n\tb \x1b[31mred\x07 " + "x" * 100_000))
        assert text.isprintable()
        assert len(text) < 5000
        assert "\\x1b[31mred" in text


def test_json_has_no_infinity():
    content = {"a": float("inf"), "b": [float("nan"), 1.5], "c": {"d": -float("inf")}}
    assert json.loads(dump_json(content)) == {"a": None, "b": [None, 1.5], "c": {"d": None}}


@pytest.mark.parametrize("value", ["1e300", "[0.1, 1e300]", "[[1e300]]", "1" + "0" * 400])
def test_a_number_that_leaves_no_room_is_refused(value, call):
    status, _, complaint = call("run", "space-robot", "--set", f"simulation.duration={value}", "--out", "never")
    assert (status, complaint.count("\n")) == (2, 1)
    assert "Traceback" not in complaint


@pytest.mark.parametrize("name", [r"$\frac$", "[/nope]", "x" * 300])
def test_names_are_printed_and_drawn_as_they_are(name, tmp_path, capsys):
    text = (shipped_directory() / "space_robot.urdf").read_text().replace('"joint_1"', f'"{name}"')
    robot = rnc.Robot.from_urdf(write(tmp_path / "r.urdf", text))
    reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce([*map(rnc.JointPosition, robot.joint_names)])
    run = rnc.free_motion(reduced, robot.configuration(), np.zeros(4), duration=0.1)
    run.plot(title=name).savefig(tmp_path / "p.png", dpi=30)
    print_summary(rnc.summarize(run))
    print_object(rnc.analyze(reduced, samples=4), name)
    assert name[:5] in "".join(capsys.readouterr().out.split())
