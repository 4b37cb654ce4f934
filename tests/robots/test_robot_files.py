"""Files that a robot description may name: its own, its packages' and those of folders that the user names."""

import os

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.robots.robot_files import Packages, folders_above, package_name
from urdf_parts import TETRAHEDRON, XACRO, inertial, write

REFUSED = r"outside the folders of the description: give its folder in package_dirs \(--package-dir\)"


def urdf(filename, tag="mesh", mass=1):
    shape = f'<geometry><mesh filename="{filename}"/></geometry>'
    if tag == "texture":
        material = f'<material name="m"><texture filename="{filename}"/></material>'
        shape = f'<geometry><sphere radius="1"/></geometry>{material}'
    return (
        f'<robot name="r" {XACRO}><link name="a"/><link name="b">{inertial(mass)}<visual>{shape}'
        '</visual></link><joint name="j" type="continuous"><parent link="a"/><child link="b"/>'
        '<axis xyz="0 0 1"/></joint></robot>'
    )


def package(folder, name):
    write(folder / "package.xml", f"<package><name>{name}</name></package>")


def vertices(robot):
    """Of the one mesh; zero where a box stands in for it or nothing is drawn."""
    shapes = [each for each in robot.visual_model.geometryObjects if each.name not in robot.stand_ins]
    return sum(each.geometry.num_vertices for each in shapes)


@pytest.fixture
def tree(tmp_path):
    """A description, a mesh that is its own, and one elsewhere; links to the latter among its own."""
    write(tmp_path / "robot/own.obj", TETRAHEDRON)
    write(tmp_path / "private/secret.obj", TETRAHEDRON)
    write(tmp_path / "private/secret.yaml", "password: hush")
    write(tmp_path / "private/secret.xacro", urdf("own.obj", mass=7))
    (tmp_path / "robot/link.obj").symlink_to(tmp_path / "private/secret.obj")
    (tmp_path / "robot/linked").symlink_to(tmp_path / "private")
    return tmp_path


OUTSIDE = [
    "file://{tree}/private/secret.obj", "{tree}/private/secret.obj", "../private/secret.obj", "link.obj",
    "linked/secret.obj", "package://robot/../private/secret.obj", "package://robot//{tree}/private/secret.obj",
    "package://robot/linked/secret.obj", "file://$(find robot)/../private/secret.obj", "$(find private)/secret.obj",
    "package://private/secret.obj", "model://private/secret.obj",
]  # fmt: skip


@pytest.mark.parametrize("tag", ["mesh", "texture"])
@pytest.mark.parametrize("name", OUTSIDE)
def test_a_urdf_names_no_file_elsewhere(name, tag, tree):
    path = write(tree / "robot/r.urdf", urdf(name.format(tree=tree), tag))
    with pytest.raises(rnc.ModelError, match=REFUSED):
        rnc.Robot.from_urdf(path)
    assert tag == "texture" or vertices(rnc.Robot.from_urdf(path, package_dirs=[tree / "private"])) == 4


@pytest.mark.parametrize("name", ["own.obj", "file://own.obj", "{tree}/robot/own.obj", "package://robot/own.obj"])
def test_a_urdf_names_its_own_files(name, tree):
    assert vertices(rnc.Robot.from_urdf(write(tree / "robot/r.urdf", urdf(name.format(tree=tree))))) == 4


def test_a_mesh_is_not_taken_from_the_working_directory(tree, monkeypatch):
    """A wanted mass is measured from the box around the link's meshes; without one it is a ball of 0.05 m."""
    monkeypatch.chdir(tree / "private")
    path = write(tree / "robot/r.urdf", urdf("secret.obj").replace(inertial(), ""))
    inertia = rnc.Robot.from_urdf(path, masses={"b": 1.0}).model.inertias[1].inertia
    np.testing.assert_allclose(inertia, 0.4 * 0.05**2 * np.eye(3))


@pytest.mark.parametrize("place", ["meshes/m.obj", "assets/deep/m.obj", "textures/m.obj", "Secrets/m.obj"])
def test_beside_a_description_without_package_only_customary_folders_count(place, tmp_path):
    write(tmp_path / "robot" / place, TETRAHEDRON)
    path = write(tmp_path / "robot/urdf/r.urdf", urdf(f"../{place}"))
    if place.startswith("Secrets"):
        with pytest.raises(rnc.ModelError, match=REFUSED):
            rnc.Robot.from_urdf(path)
    else:
        assert vertices(rnc.Robot.from_urdf(path)) == 4


def test_the_package_of_a_description_is_its_own(tmp_path):
    package(tmp_path / "checkout", "robot")
    write(tmp_path / "checkout/any/where/m.obj", TETRAHEDRON)
    for k, name in enumerate(("../../any/where/m.obj", "package://robot/any/where/m.obj")):
        assert vertices(rnc.Robot.from_urdf(write(tmp_path / f"checkout/urdf/arms/r{k}.urdf", urdf(name)))) == 4


def test_a_package_beside_may_not_be_a_link_to_one_elsewhere(tmp_path):
    package(tmp_path / "private", "parts")
    write(tmp_path / "private/m.obj", TETRAHEDRON)
    path = write(tmp_path / "ws/robot/r.urdf", urdf("package://parts/m.obj"))
    (tmp_path / "ws/parts").symlink_to(tmp_path / "private")
    with pytest.raises(rnc.ModelError, match=REFUSED):
        rnc.Robot.from_urdf(path)


@pytest.mark.parametrize("inside", [
    "<a x=\"${{xacro.load_yaml('{place}.yaml')['password']}}\"/>",
    "<a x=\"${{load_yaml('{place}.yaml')['password']}}\"/>",
    '<xacro:include filename="{place}.xacro"/>',
    '<xacro:include filename="{place}.xacro" optional="true"/>',
    '<xacro:include filename="{place}.xacro" ns="n"/>',
])  # fmt: skip
@pytest.mark.parametrize(
    "place", ["{tree}/private/secret", "../private/secret", "linked/secret", "$(find private)/secret"]
)
def test_a_xacro_file_names_no_file_elsewhere(inside, place, tree):
    content = inside.format(place=place.format(tree=tree))
    path = write(tree / "robot/r.xacro", f'<robot name="r" {XACRO}>{content}</robot>')
    with pytest.raises(rnc.ModelError, match=REFUSED) as raised:
        rnc.Robot.from_urdf(path)
    assert "hush" not in str(raised.value)


def test_a_xacro_file_takes_what_the_user_names(tree, monkeypatch):
    """In an argument, in a variable that it may read, or with its folder; of a folder in the former no file."""
    secret = tree / "private/secret.xacro"
    include = f'<robot name="r" {XACRO}><xacro:arg name="extra" default=""/><xacro:include filename="{{}}"/></robot>'
    by_argument = write(tree / "robot/a.xacro", include.format("$(arg extra)"))
    by_variable = write(tree / "robot/v.xacro", include.format("$(optenv ROBOT_EXTRA none.xacro)"))
    inside = write(tree / "robot/i.xacro", include.format("$(arg extra)/secret.xacro"))
    monkeypatch.setenv("ROBOT_EXTRA", str(secret))
    assert rnc.Robot.from_urdf(by_argument, xacro_arguments={"extra": str(secret)}).model.inertias[1].mass == 7
    assert rnc.Robot.from_urdf(by_variable).model.inertias[1].mass == 7
    folder = {"extra": str(secret.parent)}
    with pytest.raises(rnc.ModelError, match=REFUSED):
        rnc.Robot.from_urdf(inside, xacro_arguments=folder)
    assert rnc.Robot.from_urdf(inside, package_dirs=[secret.parent], xacro_arguments=folder).nv == 1


def test_no_content_of_files_elsewhere_is_drafted(call, tree, monkeypatch):
    monkeypatch.chdir(tree)
    named = urdf("own.obj").replace('"j"', "\"${xacro.load_yaml('../private/secret.yaml')['password']}\"")
    write(tree / "robot/r.xacro", named)
    status, _, complaint = call("init", "robot/r.xacro", "--out", "draft.yaml")
    assert status == 2
    assert "--package-dir" in complaint
    assert not (tree / "draft.yaml").exists()
    status, _, complaint = call("init", "robot/r.xacro", "--package-dir", "private", "--out", "draft.yaml")
    assert status == 0, complaint
    assert "hush" in (tree / "draft.yaml").read_text()


MJCF = (
    "<mujoco>{head}<worldbody><body name='b'><joint name='j'/><geom type='mesh' mesh='m'/>"
    "<inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/></body></worldbody></mujoco>"
)


@pytest.mark.parametrize("head", [
    "<asset><mesh name='m' file='{tree}/private/secret.obj'/></asset>",
    "<asset><mesh name='m' file='../private/secret.obj'/></asset>",
    "<asset><mesh name='m' file='link.obj'/></asset>",
    "<asset><mesh name='m' file='linked/secret.obj'/></asset>",
    "<compiler meshdir='{tree}/private'/><asset><mesh name='m' file='secret.obj'/></asset>",
    "<compiler assetdir='../private'/><asset><mesh name='m' file='secret.obj'/></asset>",
    "<compiler meshdir='linked'/><asset><mesh name='m' file='secret.obj'/></asset>",
    "<compiler meshdir='../private' strippath='true'/><asset><mesh name='m' file='robot/secret.obj'/></asset>",
    "<asset><mesh name='m' file='own.obj'/><texture name='t' type='2d' file='../private/secret.obj'/></asset>",
    "<asset><mesh name='m' file='own.obj'/><hfield name='h' size='1 1 1 1' file='../private/secret.obj'/></asset>",
    "<compiler texturedir='../private'/><asset><mesh name='m' file='own.obj'/><texture name='t' type='2d' "
    "file='secret.obj'/></asset>",
])  # fmt: skip
def test_an_mjcf_names_no_file_elsewhere(head, tree):
    path = write(tree / "robot/r.xml", MJCF.format(head=head.format(tree=tree)))
    with pytest.raises(rnc.ModelError, match=REFUSED):
        rnc.Robot.from_mjcf(path)
    if "hfield" not in head:  # none is read
        assert vertices(rnc.Robot.from_mjcf(path, package_dirs=[tree / "private"])) == 4


@pytest.mark.parametrize("head", [
    "<asset><mesh name='m' file='own.obj'/></asset>",
    "<asset><mesh name='m' file='{tree}/robot/own.obj'/></asset>",
    "<compiler meshdir='{tree}/robot' strippath='true'/><asset><mesh name='m' file='any/own.obj'/></asset>",
    "<compiler meshdir='../meshes' texturedir='.'/><asset><mesh name='m' file='m.obj'/></asset>",
    "<asset><mesh name='m' file='own.obj'/><texture name='t' type='2d' file='/nowhere/t.png'/></asset>",
])  # fmt: skip
def test_an_mjcf_names_its_own_files(head, tree):
    write(tree / "meshes/m.obj", TETRAHEDRON)
    assert vertices(rnc.Robot.from_mjcf(write(tree / "robot/r.xml", MJCF.format(head=head.format(tree=tree))))) == 4


@pytest.mark.parametrize(("head", "words"), [
    ("<default><mesh file='../private/secret.obj'/></default><asset><mesh name='m'/></asset>",
        r"unrecognized attribute: 'file' \(element 'mesh'\)"),
    ("<asset><mesh name='m' file='gone.obj'/></asset>", "no mesh"),
    ("<asset><mesh name='m' file='pipe.obj'/></asset>", "no mesh"),
], ids=["default", "gone", "pipe"])  # fmt: skip
def test_a_mesh_of_an_mjcf_is_a_file_and_a_default_names_none(head, words, tree):
    os.mkfifo(tree / "robot/pipe.obj")
    with pytest.raises(rnc.ModelError, match=words):
        rnc.Robot.from_mjcf(write(tree / "robot/r.xml", MJCF.format(head=head)))


def test_the_search_upwards_stops_at_home_at_shared_folders_and_after_eight(tmp_path, monkeypatch):
    home, deep = tmp_path / "home/me", tmp_path / "home/me/ws/robot/urdf"
    deep.mkdir(parents=True)
    monkeypatch.setenv("HOME", str(home))
    assert list(folders_above(deep)) == [deep, deep.parent, deep.parents[1]]
    assert list(folders_above(home)) == [home]
    monkeypatch.setenv("HOME", "/nobody")
    (tmp_path / "home").chmod(0o1777)
    assert list(folders_above(deep)) == [deep, *deep.parents[:3]]
    deep = tmp_path.joinpath(*"abcdefghijkl")
    deep.mkdir(parents=True)
    assert list(folders_above(deep)) == [deep, *deep.parents[:8]]


@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "large", "broken", "deep", "other"])
def test_a_package_is_a_folder_with_a_manifest_that_can_be_read(kind, tmp_path):
    manifest = tmp_path / "package.xml"
    if kind == "pipe":
        os.mkfifo(manifest)
    elif kind == "device":
        manifest.symlink_to("/dev/zero")
    elif kind == "folder":
        manifest.mkdir()
    else:
        valid = "<package><name>r</name></package>"
        texts = {"large": valid + " " * 2**20, "broken": "<package", "deep": "<package>" * 10_000, "other": "<robot/>"}
        manifest.write_text(texts[kind])
    assert package_name(tmp_path) is None


def test_a_pipe_in_the_place_of_a_manifest_is_not_waited_for(tree):
    os.mkfifo(tree / "package.xml")
    os.mkfifo(tree / "robot/package.xml")
    assert vertices(rnc.Robot.from_urdf(write(tree / "robot/r.urdf", urdf("package://robot/own.obj")))) == 4


def test_the_nearest_allowed_file_of_a_package_is_taken(tmp_path):
    """A folder of the package's name without a manifest stands nearer."""
    write(tmp_path / "ws/parts/robot/m.obj", "secret")
    write(tmp_path / "ws/parts/m.obj", TETRAHEDRON)
    package(tmp_path / "ws/parts", "parts")
    write(tmp_path / "ws/robot/parts/other.obj", TETRAHEDRON)
    assert Packages(tmp_path / "ws/robot").file("package://parts/m.obj") == tmp_path / "ws/parts/m.obj"


def test_rings_of_links_and_impossible_names_are_in_no_folder(tmp_path):
    (tmp_path / "ring").symlink_to(tmp_path / "ring")
    allowed = Packages(tmp_path)
    for name in ("ring", "a\0b", "../x", "/"):
        with pytest.raises(rnc.ModelError, match=REFUSED):
            allowed.admit(tmp_path / name, f"file '{name}'")
    assert allowed.admit(tmp_path / "xxx", "file") == tmp_path / "xxx"


@pytest.mark.parametrize(("place", "file", "options", "variable"), [
    ("ws/shapes", "ws/shapes/urdf/arm.urdf", {}, None),  # the file is in the package
    ("ws/shapes", "ws/arm_description/urdf/arm.urdf", {}, None),  # the package is beside the file's
    ("else/shapes", "arm.urdf", {"package_dirs": ["else"]}, None),
    ("else/shapes", "arm.urdf", {"package_dirs": ["else/shapes"]}, None),  # the package itself
    ("else/shapes", "arm.urdf", {}, ("ROS_PACKAGE_PATH", "nowhere:else")),
    ("else/share/shapes", "arm.urdf", {}, ("AMENT_PREFIX_PATH", "else")),
    ("git-checkout", "git-checkout/urdf/arm.urdf", {}, None),  # by the name in its manifest
], ids=["inside", "beside", "folder", "itself", "ROS 1", "ROS 2", "another name"])  # fmt: skip
def test_a_package_is_found(place, file, options, variable, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / place / "meshes/t.obj", TETRAHEDRON)
    if "arm_description" in file or place == "git-checkout":  # else the folder could be anybody's
        package(tmp_path / place, "shapes")
    path = write(tmp_path / file, urdf("package://shapes/meshes/t.obj"))
    if variable:
        monkeypatch.setenv(*variable)
    assert vertices(rnc.Robot.from_urdf(path, **options)) == 4


@pytest.mark.parametrize("name", ["$(find shapes)/meshes/t.obj", "file://$(find  shapes )/meshes/t.obj"])
def test_a_package_is_found_as_xacro_names_it_although_the_file_is_none(name, tmp_path):
    write(tmp_path / "checkout/meshes/t.obj", TETRAHEDRON)
    path = write(tmp_path / "checkout/urdf/arm.urdf", urdf(name).replace(XACRO, ""))
    robot = rnc.Robot.from_urdf(path)
    with pytest.warns(rnc.ModelWarning, match=r"1 mesh was not found: package 'shapes' \(1\); give the folder"):
        assert vertices(robot) == 0
    package(tmp_path / "checkout", "shapes")
    package_name.cache_clear()
    assert vertices(rnc.Robot.from_urdf(path)) == 4


def test_missing_meshes_of_a_known_package_are_named_with_their_folder(tmp_path):
    """One of them is drawn and collides, the other is drawn only: two files, and the package needs no folder."""
    package(tmp_path / "checkout", "shapes")
    shape = '<geometry><mesh filename="package://shapes/meshes/{}.stl"/></geometry>'
    mast, lid = shape.format("mast"), shape.format("lid")
    more = f"</visual><collision>{mast}</collision><collision>{lid}</collision>"
    text = urdf("package://shapes/meshes/mast.stl").replace("</visual>", more)
    robot = rnc.Robot.from_urdf(write(tmp_path / "checkout/urdf/arm.urdf", text))
    expected = rf"2 meshes were not found: mast.stl, lid.stl in folder '{tmp_path}/checkout/meshes'; put them there"
    with pytest.warns(rnc.ModelWarning, match=expected):
        assert vertices(robot) == 0


def test_two_links_of_one_name_are_told_with_their_files(tmp_path):
    write(tmp_path / "part.xacro", f'<robot {XACRO}>\n<link name="b"/></robot>')
    text = urdf("t.obj").replace('<link name="a"/>', '<link name="a"/>\n<xacro:include filename="part.xacro"/>\n')
    path = write(tmp_path / "arm.xacro", text)
    expected = r"arm.xacro: link 'b' is not unique: .*part.xacro line 2 and in arm.xacro line 3"
    with pytest.raises(rnc.ModelError, match=expected):
        rnc.Robot.from_urdf(path)


@pytest.mark.parametrize("name", ["", "..", "a/b", "nowhere_at_all"])
def test_a_package_of_no_name_is_not_found(name, tmp_path):
    assert Packages(tmp_path).folder(name) is None


def test_each_file_finds_its_own_packages(tmp_path):
    for number in (1, 2):
        package(tmp_path / f"{number}/parts", "parts")
        write(tmp_path / f"{number}/parts/arm.xacro", urdf("own.obj", mass=number))
        text = f'<robot name="r" {XACRO}><xacro:include filename="$(find parts)/arm.xacro"/></robot>'
        robot = rnc.Robot.from_urdf(write(tmp_path / f"{number}/mine/robot.xacro", text))
        assert robot.model.inertias[1].mass == number
