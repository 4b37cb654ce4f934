# ruff: noqa: E501
"""MJCF that MuJoCo writes out: the same machine as MuJoCo's own, and nothing read that is not the description's."""

import os
import sys

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc

SHORT = """<mujoco><include file="parts/defaults.xml"/><compiler settotalmass="6" meshdir="parts" angle="degree"/>
<asset><mesh name="wedge" file="wedge.obj" scale="1 2 0.5"/><material name="red" rgba="1 0 0 1"/></asset><worldbody>
<frame pos="0 0 1" euler="0 0 30"><body name="a"><joint name="root" axis="1 2 3"/><geom type="box" size="1 1 0.1"/>
<replicate count="3" offset="0.5 0.1 0" euler="0 0 20"><body name="b" pos="1 0 0"><joint name="j" axis="0 1 0" pos="0 0 0.1"
range="-60 60"/><geom type="capsule" fromto="0 0 0 1 0 0" size="0.1" density="700"/><frame euler="90 0 20">
<geom type="mesh" mesh="wedge" pos="0 1 0" euler="10 20 30" material="red"/><body name="c"><joint name="k" type="slide"
axis="1 0 1"/><geom type="sphere" size="0.1" pos="0 1 0"/><site name="tip" pos="0 0 1"/></body></frame></body></replicate>
</body></frame></worldbody></mujoco>"""
DEFAULTS = '<mujoco><default><joint damping="0.1" armature="0.02"/></default></mujoco>'
WEDGE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
BODY = '<mujoco>{}<worldbody><body name="b"><joint name="j"/><geom size="1"/>{}</body></worldbody></mujoco>'


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "robot" / "parts").mkdir(parents=True)
    (tmp_path / "robot" / "parts" / "defaults.xml").write_text(DEFAULTS)
    (tmp_path / "robot" / "parts" / "wedge.obj").write_text(WEDGE)
    (tmp_path / "elsewhere.xml").write_text(DEFAULTS)
    (tmp_path / "elsewhere.obj").write_text(WEDGE)
    (tmp_path / "robot" / "link.xml").symlink_to(tmp_path / "elsewhere.xml")
    os.mkfifo(tmp_path / "robot" / "pipe.xml")
    return tmp_path / "robot"


def written(folder, text):
    (folder / "robot.xml").write_text(text)
    return folder / "robot.xml"


@pytest.mark.filterwarnings("ignore:compiler attribute")
def test_what_is_written_out_is_the_same_machine(folder):
    mujoco = pytest.importorskip("mujoco", reason="mujoco is an optional extra and not installed")
    path = written(folder, SHORT)
    theirs = mujoco.MjModel.from_xml_path(str(path))
    robot = rnc.Robot.from_mjcf(path)
    model, data = robot.model, mujoco.MjData(theirs)
    assert sum(inertia.mass for inertia in model.inertias) == pytest.approx(6.0, rel=1e-12)
    assert sorted(robot.joint_names) == sorted(["root", "j0", "j1", "j2", "k0", "k1", "k2"])
    entries = [int(theirs.joint(name).dofadr[0]) for name in robot.joint_names]
    generator = np.random.default_rng(0)
    for q in generator.uniform(-1, 1, (3, 7)):
        data.qpos[entries] = q
        mujoco.mj_forward(theirs, data)
        M = np.zeros((7, 7))
        for row, unit in zip(M, np.eye(7), strict=True):
            mujoco.mj_mulM(theirs, data, row, unit)
        here = model.createData()
        np.testing.assert_allclose(pin.crba(model, here, q), M[np.ix_(entries, entries)], atol=1e-9)
        gravity = pin.computeGeneralizedGravity(model, here, q)
        np.testing.assert_allclose(gravity, data.qfrc_bias[entries], atol=1e-9)
        pin.framesForwardKinematics(model, here, q)
        for name in ("tip0", "tip2"):
            place = here.oMf[model.getFrameId(name)].translation
            np.testing.assert_allclose(place, data.site(name).xpos, atol=1e-9)
        # Meshes are drawn where MuJoCo draws them, which turns them to their principal axes.
        shapes = robot.visual_model
        drawn = pin.GeometryData(shapes)
        pin.updateGeometryPlacements(model, here, shapes, drawn)
        meshes = [k for k in range(theirs.ngeom) if theirs.geom_type[k] == mujoco.mjtGeom.mjGEOM_MESH]
        ours = [k for k, shape in enumerate(shapes.geometryObjects) if shape.meshPath.endswith(".obj")]
        assert len(meshes) == len(ours) == 3
        for mine, other in zip(ours, meshes, strict=True):
            shape = shapes.geometryObjects[mine]
            points = np.array(shape.geometry.vertices()) @ drawn.oMg[mine].rotation.T + drawn.oMg[mine].translation
            turned = theirs.mesh_vert @ data.geom_xmat[other].reshape(3, 3).T + data.geom_xpos[other]
            np.testing.assert_allclose(np.sort(points, axis=0), np.sort(turned, axis=0), atol=1e-6)
    limits = dict(zip(robot.joint_names, model.upperPositionLimit, strict=True))
    assert limits["j2"] == pytest.approx(np.pi / 3)
    assert limits["k2"] > 1e9


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (BODY.format('<include file="../elsewhere.xml"/>', ""), "is no file in the folder of the description"),
        (BODY.format('<include file="/etc/passwd"/>', ""), "is no file in the folder of the description"),
        (BODY.format('<include file="link.xml"/>', ""), "is no file in the folder of the description"),
        (BODY.format('<include file="pipe.xml"/>', ""), "is no file in the folder of the description"),
        (BODY.format('<include file="robot.xml"/>', ""), "is there twice"),
        (BODY.format(2 * '<include file="parts/defaults.xml"/>', ""), "is there twice"),
        (
            BODY.format('<asset><mesh file="../elsewhere.obj"/></asset>', "<frame><geom size='1'/></frame>"),
            "is no file",
        ),
        (
            BODY.format(
                '<compiler meshdir="/etc" strippath="true"/><asset><mesh file="parts/hosts"/></asset>',
                "<frame><geom size='1'/></frame>",
            ),
            "is no file",
        ),
        (BODY.format("", "<replicate count='1000000000'><geom size='1'/></replicate>"), "more than 20,000 elements"),
        (BODY.format("", 5 * "<replicate count='100'>" + "<body/>" + 5 * "</replicate>"), "more than 20,000 elements"),
        (BODY.format("", "<replicate count='-1'><geom size='1'/></replicate>"), "takes a whole number"),
        (BODY.format("", "<frame><geom size='0'/></frame>"), "robot.xml: "),
        (BODY.format("", "<frame><attach model='x'/></frame>"), "<attach> is not read"),
    ],
)
def test_what_is_not_the_descriptions_own_is_not_read(text, words, folder):
    pytest.importorskip("mujoco", reason="mujoco is an optional extra and not installed")
    with pytest.raises(rnc.ModelError, match=words) as raised:
        rnc.Robot.from_mjcf(written(folder, text))
    assert str(raised.value).isprintable()


@pytest.mark.parametrize(
    ("text", "tag"),
    [
        (BODY.format("", "<frame><geom size='1'/></frame>"), "<frame>"),
        (BODY.format("", "<replicate count='5'><body/></replicate>"), "<replicate>"),
        (BODY.format('<include file="parts/defaults.xml"/>', ""), '<include file="parts/defaults.xml">'),
    ],
)
def test_without_mujoco_it_is_refused_by_name(text, tag, folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(rnc.ModelError, match=f"{tag} is not read without MuJoCo: pip install"):
        rnc.Robot.from_mjcf(written(folder, text))


def test_what_only_pictures_are_in_needs_no_mujoco(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert rnc.Robot.from_mjcf(written(folder, BODY.format("", "<frame><light/></frame>"))).nv == 1
