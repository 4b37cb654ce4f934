"""Momenta that stay what they are: only where no reaction of another constraint acts on the joint."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, add_frame
from random_systems import CONSTRAINTS, KINDS, Recipe, constraint, robot_of
from systems import drifting_manipulator, random_states, reacting, tumbling_panda
from tolerances import KKT

SAID = "which is declared as conserved: omit the momentum"


def satellite(base: str = "free") -> rnc.Robot:
    """A body in space or in the plane with two arms of two joints each, alike enough to hold hands, and a flywheel."""
    model = pin.Model()
    model.gravity.linear = np.zeros(3)
    generator = np.random.default_rng(3)

    def body(joint: str, kind: str, parent: int, at: tuple, frame: str, place: tuple = (0.0, 0.0, 0.0)) -> int:
        center = 0.1 * generator.uniform(-1, 1, 3)
        index = add_body(model, joint, kind, 1.5, parent, com=center, moments=(0.2, 0.25, 0.3), at=at)
        add_frame(model, frame, index, place)
        return index

    kinds = {"free": "FreeFlyer", "planar": "Planar", "pin": "RZ"}
    root = body("root_joint", kinds[base], 0, (0.0, 0.0, 0.0), "hub", (0.1, 0.2, -0.1))
    for side, y in (("left", 0.3), ("right", -0.3)):
        shoulder = body(f"{side}_shoulder", "RZ", root, (0.0, y, 0.0), f"{side}_arm")
        body(f"{side}_elbow", "RZ", shoulder, (0.5, 0.0, 0.0), f"{side}_hand", (0.6, 0.0, 0.0))
    add_body(model, "flywheel", "RZ", 0.8, root, moments=(0.02, 0.02, 0.04), at=(-0.4, 0.1, 0.0), frame="rotor")
    return rnc.Robot(model)


def own_row(robot: rnc.Robot, *joints: str, rate: float = 0.0) -> rnc.Pfaffian:
    """A user's row: velocities of some joints, the first of each, add up to nothing, or to a rate."""
    row = np.zeros((1, robot.nv))
    row[0, [robot.velocity_indices(name).start for name in joints]] = np.arange(1, 1 + len(joints))
    options = {"rate": lambda q: np.array([rate]), "rate_dot": lambda q, v: np.zeros(1)} if rate else {}
    return rnc.Pfaffian(lambda q: row, lambda q, v: 0 * row, ["own"], **options)


ACTING = {
    "a hand on the wall": lambda robot: rnc.LoopClosure("universe", "left_hand", "point", offset_a=(0.7, 0.3, 0.0)),
    "a hand that is welded": lambda robot: rnc.LoopClosure("left_hand", "universe", "frame", offset_b=(0.7, 0.3, 0.0)),
    "a knife edge": lambda robot: rnc.NoSideSlip("left_hand"),
    "a wheel": lambda robot: rnc.RollingWheel("left_hand", 0.3, axis="y"),
    "a ball": lambda robot: rnc.RollingBall("hub", 0.3),
    "a weld of many rows": lambda robot: rnc.LoopClosure("universe", "hub"),
    "a ground that moves": lambda robot: own_row(robot, "root_joint", rate=0.5),
    "a lock": lambda robot: own_row(robot, "root_joint"),
    "a user's row": lambda robot: own_row(robot, "left_elbow", "root_joint"),
}


@pytest.mark.parametrize(("what", "base"), [
    *((what, "free") for what in ACTING), *((what, "planar") for what in ACTING if "weld of" not in what),
    ("a lock", "pin"), ("a user's row", "pin"),
])  # fmt: skip
def test_whatever_acts_on_the_joint_is_refused(what, base):
    robot = satellite(base)
    size = robot.velocity_indices("root_joint").stop
    momentum = rnc.MomentumConservation("root_joint", np.arange(1.0, 1 + size) if base == "planar" else 0.0)
    with pytest.raises(rnc.ConstraintError, match=SAID) as caught:
        rnc.NonholonomicSystem(robot, [momentum, ACTING[what](robot)], ["left_elbow"])
    assert "momentum(root_joint)," in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_loop_that_a_files_digits_keep_open_is_internal_all_the_same():
    robot = satellite()
    hands = rnc.LoopClosure("left_hand", "right_hand", rpy=(2e-6, 0.0, 0.0))
    assert rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("root_joint"), hands], ["left_elbow"]).m == 9


@pytest.mark.parametrize("ratio", [1e-6, 1e-3, 1.0])
def test_the_weakest_gear_to_the_joint_is_refused(ratio):
    gear = rnc.JointCoupling("left_elbow", "root_joint", ratio)
    words = rf"^constraint row coupling\(left_elbow, root_joint\) acts on momentum\(root_joint\), {SAID}"
    with pytest.raises(rnc.ConstraintError, match=words) as caught:
        rnc.NonholonomicSystem(satellite("pin"), [rnc.MomentumConservation("root_joint"), gear])
    assert "mimic" not in str(caught.value)


SLANTED = np.array([2.0, -1.0, 2.0]) / 3


@pytest.mark.parametrize("mass", [1e-12, 1e6])
@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.81), (0.0, 0.0, 1.62), tuple(3.7 * SLANTED), (0.0, 0.0, 0.0)])
def test_what_falls_along_its_joint_has_no_constant_momentum_up_or_down(gravity, mass):
    """A slide is free of gravity exactly if its axis is square to it, whatever the mass; a hinge if it is along it."""
    sideways = np.cross(SLANTED, [0.0, 0.0, 1.0])
    axes = [sign * axis for axis in (*np.eye(3), SLANTED, sideways / np.linalg.norm(sideways)) for sign in (1, -1)]
    for kind, axis in ((kind, axis) for kind in ("Prismatic", "Revolute") for axis in axes):
        model = pin.Model()
        model.gravity.linear = np.array(gravity)
        slanted = getattr(pin, f"JointModel{kind}Unaligned")(axis)
        for parent, (name, each) in enumerate((("joint", slanted), ("arm", "RX"))):  # so that there is a motion left
            add_body(model, name, each, mass, parent, com=(0.3, -0.2, 0.5), moments=mass)
        force = axis @ gravity if kind == "Prismatic" else np.linalg.norm(np.cross(axis, gravity))
        robot = rnc.Robot(model)
        if abs(force) < 1e-12:
            assert rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("joint")]).m == 1
            continue
        words = r"^momentum of joint 'joint' is not conserved: gravity acts along"
        with pytest.raises(rnc.ConstraintError, match=words):
            rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("joint")])


def loop(robot: rnc.Robot) -> list:
    return [rnc.LoopClosure("left_hand", "right_hand", "point")]


INTERNAL = {
    "hands that hold each other": ("free", [0.4, -0.3, 0.2, 0.1, 0.5, -0.2], loop),
    "the same in the plane": ("planar", [0.4, -0.3, 0.5], loop),
    "the same on a pin": ("pin", 0.7, loop),
    "hands that hold each other at rest": ("free", 0.0, loop),
    "geared arms": ("planar", [0.4, -0.3, 0.5], lambda r: [rnc.JointCoupling("left_elbow", "right_elbow", -1.0)]),
    "an elbow that is driven at its own speed": ("planar", 0.0, lambda r: [own_row(r, "left_elbow", rate=0.8)]),
    "a user's row between arms": ("planar", [0.4, -0.3, 0.5], lambda r: [own_row(r, "left_elbow", "right_shoulder")]),
    "a flywheel that turns freely": ("free", 0.0, lambda r: [rnc.MomentumConservation("flywheel", 0.3)]),
}  # fmt: skip


@pytest.mark.parametrize("what", INTERNAL)
def test_momentum_is_conserved_because_of_the_dynamics(what):
    """The other constraints alone, at the right momentum, give the same acceleration; momenta take no force."""
    base, value, others = INTERNAL[what]
    robot = satellite(base)
    model, data = robot.model, robot.model.createData()
    constraints = [rnc.MomentumConservation("root_joint", value), *others(robot)]
    reduced = rnc.NonholonomicSystem(robot, constraints, ["left_elbow", "right_shoulder"]).reduce()
    rows = reacting(reduced)
    assert (~rows).any()
    for q, v2 in random_states(reduced, 5):
        state, T = reduced.at(q, v2), np.array([0.7, -0.4])
        bias_acceleration = state.terms().A_dot[rows] @ state.v  # rates are constant in all of them
        expected = pin.forwardDynamics(model, data, q, state.v, state.B @ T, state.A[rows], bias_acceleration)
        np.testing.assert_allclose(state.v_dot(reduced.forward_dynamics(q, v2, T)), expected, atol=KKT * 10)
        np.testing.assert_allclose(reduced.multipliers(q, v2, T)[~rows], 0, atol=KKT)
        assert not rows.any() or np.abs(reduced.multipliers(q, v2, T)[rows]).max() > 0.01


def drawn(seed: int) -> Recipe:
    """A tree behind one joint, its momentum and one other constraint."""
    generator = np.random.default_rng(seed)
    count = int(generator.integers(2, 6))
    joints = tuple((int(generator.integers(min(k, 1), k + 1)), str(generator.choice(KINDS))) for k in range(count))
    others = [kind for kind in CONSTRAINTS if kind != "momentum"]
    loops = ["point", "frame", "coupling", "rows", "belt"]
    kind = str(generator.choice(loops if generator.random() < 0.5 else others))
    base = str(generator.choice(["fixed", "planar", "free"]))
    return Recipe(joints, base, ("momentum", kind), (), False, seed)


def pushes(alone: rnc.ReducedModel, joint: slice, generator: np.random.Generator) -> list[float]:
    """Force along a joint, relative to the largest of all, that motions without momentum of it take."""
    model, data, found = alone.robot.model, alone.robot.model.createData(), []
    for _ in range(12):
        try:
            q = alone.random_configuration(generator, 1.0)
            if alone.at(q).condition > 100:
                continue
        except rnc.RncError:
            continue
        M, still = alone.at(q).M[joint], alone.at(q, np.zeros(alone.r))
        v2 = generator.normal(size=alone.r)
        v2 -= np.linalg.pinv(M @ still.R) @ (M @ (still.R @ v2 + still.b))
        state = alone.at(q, v2)
        if np.abs(M @ state.v).max() > 1e-9:
            continue  # moved ground allows no motion without momentum
        vdot = state.v_dot(alone.forward_dynamics(q, v2, generator.normal(size=alone.p)))
        force = pin.rnea(model, data, q, state.v, vdot)
        found.append(float(np.abs(force[joint]).max() / max(np.abs(force).max(), 1e-9)))
    return found


def test_of_systems_at_random_those_are_refused_whose_momentum_changes():
    """Independent: inverse dynamics of the motion that the other constraint alone allows."""
    accepted, refused = [], []
    for seed in range(24):
        robot, built = robot_of(drawn(seed))
        joint = robot.velocity_indices(robot.joint_names[0])
        try:
            both = [constraint(kind, robot, built) for kind in drawn(seed).constraints]
            B = built.generator.normal(size=(robot.nv, robot.nv))
            B[joint] = 0.0
            alone = rnc.NonholonomicSystem(robot, both[1:], B).reduce()
            conserved = rnc.NonholonomicSystem(robot, both[:1])  # the joint is cyclic
            assert conserved.m == joint.stop - joint.start
        except rnc.RncError:
            continue
        found = pushes(alone, joint, np.random.default_rng(seed))
        if not found:
            continue
        try:
            rnc.NonholonomicSystem(robot, both, B)
            accepted.append(max(found))
        except rnc.ConstraintError as error:
            if SAID in str(error):
                refused.append(max(found))
    assert min(len(accepted), len(refused)) > 5
    assert max(accepted) < 1e-8
    assert min(refused) > 1e-4


def test_a_momentum_that_is_kept_where_nobody_knows():
    """Of a disc that floats on a lift: its momentum keeps its direction in the world, not in its own axes."""
    model = pin.Model()
    add_body(model, "disc", "Planar", 1.0, add_body(model, "lift", "PZ", 1.0))
    robot = rnc.Robot(model)
    assert rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("disc")]).r == 1
    with pytest.raises(rnc.ConstraintError, match=r"'disc' has to be zero, .* JointModelPlanar on 'lift'"):
        rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("disc", [1.0, 0.0, 0.0])])


@pytest.mark.parametrize(("make", "axes", "given"), [
    (tumbling_panda, [0, 1, 2, 3, 4, 5], [2.0, -1.0, 0.5, 0.3, 0.4, -0.6]),
    (drifting_manipulator, [0, 1, 5], [3.0, -2.0, 5.0]),
])  # fmt: skip
def test_momentum_is_that_about_the_origin_of_the_world(make, axes, given):
    reduced = make()
    model, data = reduced.robot.model, reduced.robot.model.createData()
    for q, v2 in random_states(reduced, 4):
        pin.computeCentroidalMomentum(model, data, q, reduced.at(q, v2).v)
        linear = data.hg.linear
        about_origin = data.hg.angular + np.cross(data.com[0], linear)
        np.testing.assert_allclose(np.concatenate([linear, about_origin])[axes], given, atol=1e-10)
