"""Distances of CollisionDistances against closed forms, support functions and fine differences."""

import coal
import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection, ground_shape
from systems import with_shape
from telescopes import telescope


def ball_on_rails(radius=0.1):
    """Ball that moves along x and then along y."""
    model = pin.Model()
    along = add_body(model, "along", "PX", pin.Inertia.FromSphere(1.0, radius))
    add_body(model, "across", "PY", pin.Inertia.FromSphere(1.0, radius), along, frame="ball")
    return with_shape(rnc.Robot(model), "ball", coal.Sphere(radius))


@pytest.fixture(scope="module")
def tiago():
    return rnc.Robot.from_example("tiago_no_hand", base="planar")


@pytest.fixture(scope="module")
def flying_panda():
    return rnc.Robot.from_example("panda", base="free")


def obstacles(center):
    x, y, z = center
    motion = rnc.planning.Harmonic([x, y, z, 0.3], [0.3, 0.2, 0.1, 0.8], 0.4)
    return [
        Obstacle(coal.Box(0.3, 0.5, 0.7), position=(x + 0.5, y - 0.6, z), yaw=0.4, roll=0.3, pitch=-0.2, name="box"),
        Obstacle(coal.Cylinder(0.2, 0.8), position=(x, y + 0.9, z), pitch=0.7, name="cylinder"),
        Obstacle(coal.Capsule(0.15, 0.5), name="person", motion=motion),
        Obstacle(coal.Sphere(0.2), position=(x - 0.6, y - 0.6, z + 0.3), name="ball"),
        Obstacle(ground_shape(), position=(x, y, z - 1.2), yaw=1.0, roll=0.2, pitch=-0.3, name="slope"),
    ]


@pytest.mark.parametrize("place", [(0.7, 0.2), (0.05, -0.12), (-1.0, 0.4)])
def test_spheres_have_the_closed_form(place):
    robot = ball_on_rails()
    target = Obstacle(coal.Sphere(0.25), position=(0.3, 0.1, 0.2), name="target")
    found = CollisionDistances(robot, [target]).at(place)
    offset = target.position - np.array([*place, 0.0])
    length = np.linalg.norm(offset)
    assert found.distance == pytest.approx([length - 0.35], abs=1e-12)
    np.testing.assert_allclose(found.normal[0], offset / length, atol=1e-12)
    np.testing.assert_allclose(found.jacobian[0], -offset[:2] / length, atol=1e-12)
    np.testing.assert_allclose(found.point_a[0], [*place, 0.0] + 0.1 * offset / length, atol=1e-12)
    np.testing.assert_allclose(found.point_b - found.point_a, found.distance[:, None] * found.normal, atol=1e-12)


def test_penetration_of_a_box_is_the_way_out():
    block = Obstacle(coal.Box(2.0, 1.0, 4.0), name="block")
    found = CollisionDistances(ball_on_rails(), [block]).at([0.2, 0.45])
    assert found.distance == pytest.approx([-(0.05 + 0.1)], abs=1e-9)
    np.testing.assert_allclose(found.normal[0], [0.0, -1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(found.jacobian[0], [0.0, 1.0], atol=1e-9)


def support(shape, direction):
    """Largest coordinate of a shape along a direction of its own frame."""
    if isinstance(shape, coal.Box):
        return np.abs(direction) @ np.array(shape.halfSide)
    if isinstance(shape, coal.Sphere):
        return shape.radius
    if isinstance(shape, coal.Halfspace):
        np.testing.assert_allclose(direction, [0.0, 0.0, 1.0], atol=1e-9)
        return 0.0
    if isinstance(shape, coal.Cylinder):
        return shape.halfLength * abs(direction[2]) + shape.radius * np.hypot(*direction[:2])
    if isinstance(shape, coal.Capsule):
        return shape.halfLength * abs(direction[2]) + shape.radius
    return (np.array(shape.vertices()) @ direction).max()  # the vertices of a mesh, not those of its hull


@pytest.mark.parametrize("name", ["tiago", "flying_panda"])
def test_planes_along_the_normals_separate_by_the_distance(name, request):
    """The gap of two convex bodies along a direction is a lower bound of their distance, equal at the normal."""
    robot, about = request.getfixturevalue(name), obstacles((0.6, 0.0, 0.6))
    distances, generator = CollisionDistances(robot, about), np.random.default_rng(3)
    shapes = {shape.name: shape for shape in robot.collision_model.geometryObjects}
    checked = 0
    for t in (0.0, 0.6, 1.7):
        q = robot.random_configuration(generator, 1.0)
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, q)
        found, names = distances.at(q, t), list(shapes)
        for k, distance, normal in zip(found.pairs, found.distance, found.normal, strict=True):
            pair, gap = distances.pairs[k], 0.0
            for index, sign in ((pair.first, -1.0), (pair.second, 1.0)):
                if index < len(names):
                    shape = shapes[names[index]]
                    pose, body = data.oMi[shape.parentJoint] * shape.placement, shape.geometry
                else:
                    obstacle = about[index - len(names)]
                    pose, body = obstacle.placement(t), obstacle.shape
                inner = pose.rotation.T @ normal
                gap += sign * (normal @ pose.translation) - support(body, -sign * inner)
            assert gap == pytest.approx(distance, abs=1e-6 if distance > 0 else 5e-6)
            checked += distance > 0
    assert checked > 300


@pytest.mark.parametrize("name", ["tiago", "flying_panda"])
def test_rates_agree_with_differences(name, request):
    robot = request.getfixturevalue(name)
    distances = CollisionDistances(robot, obstacles((0.6, 0.0, 0.6)))
    generator = np.random.default_rng(5)
    errors, step = [], 1e-5
    for _ in range(8):
        q = robot.random_configuration(generator, 1.0)
        v, t = generator.normal(size=robot.nv), generator.uniform(0.0, 2.0)
        found = distances.at(q, t)
        ahead, behind = (distances.at(pin.integrate(robot.model, q, s * step * v), t + s * step) for s in (1.0, -1.0))
        difference = (ahead.distance - behind.distance) / (2 * step)
        # A difference across a change of the nearest feature shows as a second difference.
        smooth = np.abs(ahead.distance - 2 * found.distance + behind.distance) < 1e-8
        apart = (found.distance > 1e-3) & smooth
        errors.append(np.abs(found.rates(v) - difference)[apart])
    every = np.concatenate(errors)
    assert every.size > 1000
    assert np.quantile(every, 0.99) < 1e-3
    assert np.median(every) < 1e-6


def test_results_do_not_depend_on_the_history(tiago, generator):
    about = obstacles((0.6, 0.0, 0.6))
    fresh, used = CollisionDistances(tiago, about), CollisionDistances(tiago, about)
    for _ in range(3):
        q = tiago.random_configuration(generator, 1.0)
        used.at(q, 0.5)
    one, other = fresh.at(q, 0.7), used.at(q, 0.7)
    for key in ("distance", "normal", "jacobian", "drift"):
        assert getattr(one, key).tobytes() == getattr(other, key).tobytes()
    assert not one.distance.flags.writeable


def test_pairs_that_touch_at_the_start_are_reported(tiago):
    omitted = {each.names: each.reason for each in CollisionDistances(tiago).omitted}
    assert omitted["torso_fixed_column_link", "arm_1_link"] == "overlap by 0.0115 m at the reference configuration"
    assert omitted["arm_1_link", "arm_2_link"] == "adjacent links"
    free = tiago.configuration({"torso_lift_joint": 0.3, "arm_1_joint": 0.7})
    pairs = [pair.names for pair in CollisionDistances(tiago, q0=free).pairs]
    assert ("torso_fixed_column_link", "arm_1_link") in pairs


@pytest.mark.parametrize(("reach", "checked"), [(1.04, False), (3.0, True)])
def test_pairs_that_touch_nearly_always_are_left_out_wherever_a_run_starts(tmp_path, reach, checked):
    """The tool leaves its rail at 1.02 m. At the end of a stroke of 1.04 m, its pair once refused the way back."""
    (tmp_path / "telescope.urdf").write_text(telescope(reach))
    arm = rnc.Robot.from_urdf(tmp_path / "telescope.urdf", base="fixed")
    found = CollisionDistances(arm, q0=arm.configuration({"two": reach}))
    assert bool(found.pairs) == checked
    reasons = [str(each) for each in found.omitted]
    assert reasons == ([] if checked else ["rail / tool: overlap in nearly all configurations"])


def test_rules_of_pairs(tiago):
    named = [("arm_5_link", "base_link")]
    chosen = CollisionDistances(tiago, selection=PairSelection(pairs=named))
    assert {frozenset(pair.names) for pair in chosen.pairs} == {frozenset(named[0])}
    every = CollisionDistances(tiago)
    fewer = CollisionDistances(tiago, selection=PairSelection(disabled=named))
    assert len(every.pairs) - len(fewer.pairs) == 1
    ball = Obstacle(coal.Sphere(0.1), position=(3, 0, 0), name="ball")
    alone = CollisionDistances(tiago, [ball], PairSelection(links=False))
    assert {pair.names[1] for pair in alone.pairs} == {"ball"}
    assert len(alone.pairs) == len(tiago.collision_model.geometryObjects)


def test_an_obstacle_ignores_the_links_that_it_names(tiago):
    wheels = ["wheel_left_link", "wheel_right_link"]
    floor = Obstacle(ground_shape(), name="floor", ignored_links=wheels)
    alone = PairSelection(links=False)
    every = CollisionDistances(tiago, [Obstacle(ground_shape(), name="floor")], alone)
    others = CollisionDistances(tiago, [floor], alone)
    left = {pair.names[0] for pair in every.pairs} - {pair.names[0] for pair in others.pairs}
    assert left == set(wheels)
    wrong = Obstacle(ground_shape(), name="floor", ignored_links=["wheel_left_lnk"])
    with pytest.raises(rnc.ModelError, match=r"'floor': ignored_links: no link 'wheel_left_lnk'.*'wheel_left_link'"):
        CollisionDistances(tiago, [wrong])


# ---------------------------------------------------------------------- distance bounds


WITHIN = 0.15


def test_pairs_that_approach_along_a_path_are_measured_in_time():
    """Steps of all sizes, a person who walks by, and kinematics from an evaluation of the model or from q."""
    robot = rnc.Robot.from_example("panda")
    reduced = rnc.NonholonomicSystem(robot).reduce()
    walk = rnc.planning.MinimumJerk([0.5, -2.0, 0.8, 0.0], [0.5, 2.0, 0.8, 3.0], duration=6.0)
    person = Obstacle(coal.Box(0.2, 0.6, 1.2), roll=0.3, name="person", motion=walk)
    post = Obstacle(coal.Cylinder(0.1, 1.0), position=(0.7, 0.5, 0.5), name="post")
    used, every = CollisionDistances(robot, [person, post]), CollisionDistances(robot, [person, post])
    generator = np.random.default_rng(3)
    q, direction, counts = robot.configuration(), generator.standard_normal(robot.nv), []
    for sample in range(40):
        if sample % 12 == 0:
            direction = generator.standard_normal(robot.nv)
        q = pin.integrate(robot.model, q, (0.5 if sample % 20 == 19 else 0.03) * direction)
        t = 0.1 * sample
        near = used.at(reduced.at(q) if sample % 3 else q, t, within=WITHIN)
        whole = every.at(q, t)
        inside = whole.distance < WITHIN
        np.testing.assert_array_equal(near.pairs, whole.pairs[inside])
        bounds = used.smallest(q, t, beyond=WITHIN)
        np.testing.assert_allclose(bounds[inside], whole.distance[inside], atol=1e-6)
        assert (bounds <= whole.distance + 1e-6).all()
        for key in ("distance", "drift"):
            np.testing.assert_allclose(getattr(near, key), getattr(whole, key)[inside], atol=1e-6)
        separate = inside & (whole.distance > 1e-3)  # the normal of a penetration may jump
        mine = whole.distance[inside] > 1e-3
        fixed = near.point_b[mine] - near.point_a[mine] - near.distance[mine, None] * near.normal[mine]
        assert np.abs(fixed).max(initial=0.0) < 1e-6
        np.testing.assert_allclose(near.jacobian[mine], whole.jacobian[separate], atol=1e-4)
        counts.append(len(near.pairs))
    assert len(set(counts)) > 5
