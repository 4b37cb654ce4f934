"""Changed URDFs are still the same robot, and their drafts keep the kind of base."""

from collections import Counter
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

import perturbed_urdf as perturbed
import rnc_pin as rnc
from base_kind import BaseKind, base_kind
from benchmarks import perturbations
from places import DIRT
from rnc_pin.applications.init import DraftOptions, draft
from rnc_pin.applications.init.evidence import named_as_driven
from rnc_pin.applications.init.robot_at_start import shapes

pytestmark = pytest.mark.filterwarnings("ignore::rnc_pin.ModelWarning")

SHAPES = ('<box size="0.1 0.2 0.3"/>', '<cylinder radius="0.1" length="0.3"/>', '<mesh filename="wedge.stl"/>')
TYPES = ("revolute", "prismatic", "continuous", "fixed", "revolute", "prismatic", "revolute")
MIRROR = np.diag([1.0, -1.0, 1.0])


def skew_robot(folder=None):
    """A tree of eight links, nothing of which is symmetric; in a folder with its mesh, if one is given."""
    generator = np.random.default_rng(7)

    def placement():
        xyz, rpy = generator.uniform(-0.3, 0.3, 3), generator.uniform(-1, 1, 3)
        return f'<origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/>'

    parts = []
    for k in range(len(TYPES) + 1):
        spread = generator.uniform(-0.3, 0.3, (20, 3))
        tensor = np.trace(spread.T @ spread) * np.eye(3) - spread.T @ spread
        moments = {f"i{a}{b}": tensor["xyz".index(a), "xyz".index(b)] for a, b in ("xx", "yy", "zz", "xy", "xz", "yz")}
        inertia = " ".join(f'{key}="{value}"' for key, value in moments.items())
        shape = f"<collision>{placement()}<geometry>{SHAPES[k % len(SHAPES)]}</geometry></collision>"
        inertial = f'<inertial>{placement()}<mass value="{20 + k}"/><inertia {inertia}/></inertial>'
        parts.append(f'<link name="part {k}">{inertial}{shape}</link>')
    for k, kind in enumerate(TYPES):
        axis = " ".join(map(str, generator.uniform(-1, 1, 3)))
        limit = '<limit lower="-0.4" upper="0.5" effort="3" velocity="2"/><dynamics damping="0.7" friction="0.2"/>'
        mimic = '<mimic joint="joint 0" multiplier="0.5" offset="0.1"/>' if k == 5 else ""
        parts.append(
            f'<joint name="joint {k}" type="{kind}"><parent link="part {k // 2}"/><child link="part {k + 1}"/>'
            f'{placement()}<axis xyz="{axis}"/>{limit if kind != "fixed" else ""}{mimic}</joint>'
        )
    if folder is not None:
        (folder / "wedge.stl").write_bytes((DIRT / "wedge.stl").read_bytes())
    return f'<robot name="skew">{"".join(parts)}</robot>'


def model_of(urdf, base=None):
    """Pinocchio's model without rounding, whose mimic joints move freely."""
    return pin.buildModelFromXML(urdf, *([] if base is None else [base]))


def forces(model, q, v, a):
    return pin.rnea(model, model.createData(), q, v, a)


def motion(model, seed=0):
    generator = np.random.default_rng(seed)
    q = pin.integrate(model, pin.neutral(model), generator.uniform(-1, 1, model.nv))
    return q, *generator.uniform(-1, 1, (2, model.nv))


def test_a_mirrored_robot_moves_as_the_mirror_image():
    """Forces of a free robot at mirrored motions are the mirrored forces; angular vectors change their sign beside."""
    urdf = skew_robot()
    model, image = (model_of(each, pin.JointModelFreeFlyer()) for each in (urdf, perturbed.mirrored(urdf, 0)))
    q, v, a = motion(model)
    q[:3], v[:6], a[:6] = 0.1, 0.3, -0.2
    reflected = np.concatenate([np.diag(MIRROR), -np.diag(MIRROR), np.ones(model.nv - 6)])
    turned = np.concatenate([np.diag(MIRROR), -np.diag(MIRROR), [1.0], np.ones(model.nq - 7)])
    expected = reflected * forces(model, q, v, a)
    np.testing.assert_allclose(forces(image, turned * q, reflected * v, reflected * a), expected, atol=1e-10)
    assert np.abs(forces(model, turned * q, reflected * v, reflected * a) - expected).max() > 1, "it is not symmetric"
    once_more = perturbed.mirrored(perturbed.mirrored(urdf, 0), 0)
    np.testing.assert_array_equal(
        forces(model_of(once_more, pin.JointModelFreeFlyer()), q, v, a), forces(model, q, v, a)
    )


def points(urdf, folder, name):
    """Points of the shapes of a robot (k, 3) [m], sorted, and its links' origins."""
    path = folder / f"{name}.urdf"
    path.write_text(urdf)
    robot = rnc.Robot.from_urdf(path)
    found = shapes(robot, "collision", robot.configuration({}))
    assert len(found) == len(TYPES) + 1
    cloud = np.concatenate([each.points for each in found if each.axis is None])
    return cloud[np.lexsort(np.round(cloud, 9).T)], np.array([each.points.mean(axis=0) for each in found])


def test_shapes_are_mirrored_and_scaled_with_the_robot(tmp_path):
    urdf = skew_robot(tmp_path)
    cloud, middles = points(urdf, tmp_path, "original")
    seen, seen_middles = points(perturbed.mirrored(urdf, 0), tmp_path, "mirrored")
    expected = cloud @ MIRROR
    np.testing.assert_allclose(seen, expected[np.lexsort(np.round(expected, 9).T)], atol=1e-6)
    np.testing.assert_allclose(seen_middles, middles @ MIRROR, atol=1e-6)
    for scale in (perturbed.SMALL, perturbed.LARGE):
        seen, seen_middles = points(perturbed.scaled(urdf, scale), tmp_path, "scaled")
        np.testing.assert_allclose(seen_middles, scale * middles, rtol=1e-5, atol=1e-6 * scale)
        np.testing.assert_allclose(seen, scale * cloud, rtol=1e-5, atol=1e-6 * scale)


@pytest.mark.parametrize("scale", [perturbed.SMALL, perturbed.LARGE])
def test_a_scaled_robot_moves_alike_in_its_own_time(scale):
    """Froude's similarity: with times sqrt(s) as long, torques are s^4 times as large, and forces s^3."""
    urdf = skew_robot()
    model, other = model_of(urdf), model_of(perturbed.scaled(urdf, scale))
    assert pin.computeTotalMass(other) == pytest.approx(scale**3 * pin.computeTotalMass(model))
    size = np.array([scale if joint.shortname().startswith("JointModelP") else 1.0 for joint in [*model.joints][1:]])
    _, v, a = motion(model)
    q = np.array([0.1, -0.2, 0.6, 0.8, 0.3, 0.2, 0.1])[: model.nq]  # the third and fourth are a cosine and a sine
    pitch = np.insert(size, model.joints[model.getJointId("joint 2")].idx_q + 1, 1.0)
    time = np.sqrt(scale)
    found = forces(other, pitch * q, size * v / time, size * a / time**2)
    effort = scale**4 / size
    np.testing.assert_allclose(found, effort * forces(model, q, v, a), rtol=1e-9)
    velocity = size / time
    expected = {"effortLimit": effort, "velocityLimit": velocity, "damping": effort / velocity, "friction": effort}
    for name, factor in expected.items():
        np.testing.assert_allclose(getattr(other, name), factor * getattr(model, name))
    for name in ("lowerPositionLimit", "upperPositionLimit"):
        np.testing.assert_allclose(getattr(other, name), pitch * getattr(model, name))


def test_a_mimic_joint_of_another_kind_keeps_its_ratio_in_a_scaled_robot():
    """Joint 5 slides by half a metre for each radian of joint 0, and by 5 m in a robot ten times as large."""
    mimic = ElementTree.fromstring(perturbed.scaled(skew_robot(), 10.0)).find(".//mimic")
    assert (mimic.get("multiplier"), mimic.get("offset")) == ("5.0", "1.0")


def elements(urdf):
    return Counter(ElementTree.canonicalize(ElementTree.tostring(each)) for each in ElementTree.fromstring(urdf))


def test_a_shuffled_robot_has_the_same_mass_matrix_up_to_its_order():
    urdf = skew_robot()
    other = perturbed.shuffled(urdf, 1)
    assert other not in (urdf, perturbed.shuffled(urdf, 2))
    assert elements(other) == elements(urdf)
    models = model_of(urdf), model_of(other)
    order = [models[1].joints[models[1].getJointId(name)].idx_v for name in [*models[0].names][1:]]
    M, M_other = (pin.crba(each, each.createData(), pin.neutral(each)) for each in models)
    np.testing.assert_array_equal(M_other[np.ix_(order, order)], M)


def test_a_renamed_robot_is_the_same_to_the_last_bit():
    drives = '<transmission name="drive"><joint name="joint 0"/></transmission>'
    plugin = '<gazebo reference="part 1"><plugin name="p" filename="diff.so"><joint>joint_2</joint></plugin></gazebo>'
    urdf = skew_robot().replace("</robot>", f"{drives}{plugin}</robot>").replace("joint 2", "joint_2")
    text = perturbed.renamed(urdf, 3)
    names = perturbed.new_names(urdf, text)
    assert len(names) == len(set(names.values())) == 2 * len(TYPES) + 1
    for old, new in names.items():
        assert old not in text
        text = text.replace(f'"{new}"', f'"{old}"').replace(f">{new}<", f">{old}<")
    robot, back = (ElementTree.fromstring(each) for each in (urdf, text))
    for one, other in zip(robot.iter(), back.iter(), strict=True):
        free = {"mesh": "filename", "robot": "name", "transmission": "name", "plugin": "name"}.get(one.tag)
        assert (one.tag, one.text) == (other.tag, other.text)
        assert {**one.attrib, free: None} == {**other.attrib, free: None}
    assert set(named_as_driven(ElementTree.fromstring(text))[0]) == {"joint 0", "joint_2"}
    models = model_of(urdf), model_of(perturbed.renamed(urdf, 3))
    for name, new in names.items():
        if models[0].existJointName(name):
            one, other = (each.getJointId(called) for each, called in zip(models, (name, new), strict=True))
            assert models[0].inertias[one] == models[1].inertias[other]
            assert models[0].jointPlacements[one] == models[1].jointPlacements[other]


def test_noise_has_the_stated_size_and_moves_nothing_but_placements():
    urdf = skew_robot()
    away, turned = [], []
    for seed in range(20):
        other = perturbed.with_noise(urdf, seed)
        for one, two in zip(*(ElementTree.fromstring(each).iter() for each in (urdf, other)), strict=True):
            if one.tag != "origin":
                assert one.attrib == two.attrib
                continue
            placements = [[np.array(each.get(key).split(), float) for key in ("xyz", "rpy")] for each in (one, two)]
            away.append(placements[1][0] - placements[0][0])
            turned.append(pin.log3(pin.rpy.rpyToMatrix(placements[0][1]).T @ pin.rpy.rpyToMatrix(placements[1][1])))
    assert len(away) == 20 * (2 * (len(TYPES) + 1) + len(TYPES))
    np.testing.assert_allclose(np.std(away, axis=0), 1e-3, rtol=0.15)
    np.testing.assert_allclose(np.std(turned, axis=0), np.pi / 1800, rtol=0.15)
    assert perturbed.with_noise(urdf, 0) == perturbed.with_noise(urdf, 0) != perturbed.with_noise(urdf, 1)


# ---------------------------------------------------------------------- kinds of base


def drafted(name, folder):
    urdf = (DIRT / f"{name}.urdf").read_text()
    (folder / f"{name}.urdf").write_text(urdf)
    return draft(str(folder / f"{name}.urdf"), folder, DraftOptions()), urdf


@pytest.mark.parametrize(("name", "expected"), [
    ("wide_wheels", BaseKind("planar", "skid-steered", 0, 4, 4)),
    ("truck_and_trailer", BaseKind("planar", "car", 1, 8, 3)),
    ("satellite", BaseKind("free", "floating", 0, 0, 0)),
    ("rigid_drone", BaseKind("free", "floating", 0, 0, 6)),
    ("raked_fork", BaseKind("free", "bicycle", 0, 2, 2)),
])  # fmt: skip
def test_the_kind_of_a_draft(name, expected, brief, tmp_path):
    assert base_kind(*drafted(name, tmp_path)) == expected


# ---------------------------------------------------------------------- trials


def test_trials_of_a_robot(brief):
    found = list(perturbations.trials("dirt/wide_wheels", draws=2))
    names = [*perturbed.PERTURBATIONS, perturbations.MOVED]
    assert Counter(each.perturbation for each in found) == {
        name: 2 if name in perturbed.DRAWN else 1 for name in names if name != "no drives"
    }
    assert perturbations.share(found, perturbations.KEPT) == 1
    assert "| dirt/wide_wheels | planar skid-steered, 4 wheels, 4 inputs | kept" in perturbations.table(found)


@pytest.mark.long  # an hour
def test_drafts_keep_the_kind_of_base():
    found = [trial for name in perturbations.sources() for trial in perturbations.trials(name)]
    assert perturbations.share(found, perturbations.KEPT) >= 0.98, perturbations.table(found)
