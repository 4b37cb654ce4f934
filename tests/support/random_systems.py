"""Systems that nobody thought of: random trees of joints, bases, constraints and outputs."""

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from hypothesis import strategies as st

import rnc_pin as rnc
from bodies import add_frame
from drawn_motions import random_pose, unit

ONE = ("revolute", "continuous", "prismatic")  # joints that a coupling can join
KINDS = (*ONE, "slanted", "slide", "planar", "free", "ball")
CONSTRAINTS = ("skate", "wheel", "roller", "skid", "ball", "momentum", "coupling", "point", "frame", "rows", "belt")
TOUCHING = ("wheel", "roller", "skid", "ball")  # the ground
OUTPUTS = ("joint", "position", "yaw", "speed", "spin", "distance")


@dataclass(frozen=True)
class Recipe:
    """Parts of a system; the seed gives the numbers."""

    joints: tuple[tuple[int, str], ...]  # parent, counted from the base, and kind of each joint
    base: str  # "fixed", "planar" or "free"
    constraints: tuple[str, ...]
    outputs: tuple[str, ...]  # kinds of reducing outputs, taken in turn until there are enough; none for ``reduce()``
    heavy: bool
    seed: int


@st.composite
def recipes(draw):
    count = draw(st.integers(1, 6))
    joints = tuple((draw(st.integers(0, k)), draw(st.sampled_from(KINDS))) for k in range(count))
    base = draw(st.sampled_from(("fixed", "planar", "free")))
    constraints = tuple(draw(st.lists(st.sampled_from(CONSTRAINTS), max_size=3, unique=True)))
    outputs = tuple(draw(st.lists(st.sampled_from(OUTPUTS), max_size=4)))
    return Recipe(joints, base, constraints, outputs, draw(st.booleans()), draw(st.integers(0, 2**32 - 1)))


@dataclass
class Built:
    """A robot under way."""

    model: pin.Model
    generator: np.random.Generator
    frames: list[str] = field(default_factory=list)
    single: list[str] = field(default_factory=list)
    conserved: bool = False
    """Whether the momentum of the first joint is: most that acts on it gives way to what does not."""

    def body(self, joint: int, name: str) -> None:
        self.model.appendBodyToJoint(joint, inertia(self.generator), pin.SE3.Identity())
        add_frame(self.model, name, joint, random_pose(self.generator, 0.5))
        self.frames.append(name)

    def frame(self) -> str:
        return str(self.generator.choice(self.frames))


def inertia(generator: np.random.Generator) -> pin.Inertia:
    """That of a body: four masses at the corners of no plane."""
    corners = [(mass, generator.uniform(-0.4, 0.4, 3)) for mass in generator.uniform(0.1, 1.0, 4)]
    bodies = (pin.Inertia.FromSphere(mass, 0.05).se3Action(pin.SE3(np.eye(3), place)) for mass, place in corners)
    return sum(bodies, start=pin.Inertia.Zero())


def joint_model(kind: str, generator: np.random.Generator) -> pin.JointModel:
    axis = generator.integers(3)
    slanted = {"slanted": pin.JointModelRevoluteUnaligned, "slide": pin.JointModelPrismaticUnaligned}
    if kind in slanted:
        return slanted[kind](unit(generator, 3))
    along = {"revolute": "R", "continuous": "RUB", "prismatic": "P"}
    whole = {"planar": "Planar", "free": "FreeFlyer", "ball": "Spherical"}
    return getattr(pin, "JointModel" + (along[kind] + "XYZ"[axis] if kind in along else whole[kind]))()


def robot_of(recipe: Recipe) -> tuple[rnc.Robot, Built]:
    built = Built(pin.Model(), np.random.default_rng(recipe.seed), conserved="momentum" in recipe.constraints)
    model = built.model
    model.name = "random"
    heavy = recipe.heavy and not built.conserved
    model.gravity.linear = np.array([0.0, 0.0, -9.81 if heavy else 0.0])
    places = [0]
    if recipe.base != "fixed":
        base = pin.JointModelPlanar() if recipe.base == "planar" else pin.JointModelFreeFlyer()
        places = [model.addJoint(0, base, pin.SE3.Identity(), "root_joint")]
        built.body(places[0], "base")
    _branch(recipe, 0, places[0], built)
    bound = np.full(model.nq, 1.0)
    model.lowerPositionLimit, model.upperPositionLimit = -bound, bound
    return rnc.Robot(model), built


def _branch(recipe: Recipe, at: int, place: int, built: Built) -> None:
    """Add what is behind the base (0) or the k-th joint (k + 1), branch by branch as Pinocchio wants it."""
    model, generator = built.model, built.generator
    for k, (parent, kind) in enumerate(recipe.joints):
        if parent == at:
            placement = random_pose(generator, 0.7)
            joint = model.addJoint(place, joint_model(kind, generator), placement, f"joint_{k}")
            built.body(joint, f"body_{k}")
            if kind in ONE:
                built.single.append(f"joint_{k}")
            _branch(recipe, k + 1, joint, built)


def constraint(kind: str, robot: rnc.Robot, built: Built) -> object:
    """A constraint with numbers at random; a loop is closed at a configuration at random."""
    generator, frame = built.generator, built.frame()
    axis, radius = str(generator.choice(list("xyz"))), float(generator.uniform(0.05, 0.4))
    if (kind in TOUCHING and "root_joint" not in robot.joint_names) or (kind == "coupling" and len(built.single) < 2):
        kind = "skate"  # what hangs on a fixed base rarely reaches the ground
    if built.conserved and kind in ("skate", *TOUCHING) and generator.random() < 0.7:
        kind = "rows"
    if kind == "skate":
        return rnc.NoSideSlip(frame, axis)
    if kind == "wheel":
        return rnc.RollingWheel(frame, radius, axis)
    if kind == "roller":
        return rnc.RollingWheel(frame, radius, axis, roller=float(generator.uniform(-1, 1)))
    if kind == "skid":
        return rnc.RollingWheel(frame, radius, axis, lateral=False)
    if kind == "ball":
        return rnc.RollingBall(frame, radius)
    if kind == "momentum":
        return rnc.MomentumConservation(robot.joint_names[0])
    if kind == "coupling":
        pair = map(str, generator.permutation(built.single)[:2])
        return rnc.JointCoupling(*pair, ratio=float(generator.choice([-2, 0.5, 1, 3])))
    if kind in ("rows", "belt"):
        row = generator.normal(size=(1, robot.nv))
        if built.conserved and generator.random() < 0.7:
            row[:, robot.velocity_indices(robot.joint_names[0])] = 0.0
        if kind == "rows":
            return rnc.Pfaffian(lambda q: row, lambda q, v: 0 * row, names=["row"])
        speed = generator.normal(size=1)
        return rnc.Pfaffian(lambda q: row, lambda q, v: 0 * row, ["belt"], lambda q: speed, lambda q, v: 0 * speed)
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.random_configuration(generator))
    others = [name for name in built.frames if name != frame]
    other = str(generator.choice(others)) if others and generator.random() < 0.8 else "universe"
    a, b = (data.oMf[robot.model.getFrameId(name)] for name in (frame, other))
    point = generator.uniform(-0.3, 0.3, 3)
    offset_b = b.actInv(a.act(point))
    rpy = pin.rpy.matrixToRpy(a.rotation.T @ b.rotation) if kind == "frame" else np.zeros(3)
    return rnc.LoopClosure(frame, other, kind, tuple(point), tuple(offset_b), tuple(rpy))


def output(kind: str, built: Built, taken: set[tuple[str, ...]]) -> object:
    """An output that is not taken yet; another kind where there is none."""
    generator = built.generator
    while True:
        frame, axis = built.frame(), str(generator.choice(list("xyz")))
        joint = str(generator.choice(built.single)) if built.single else ""
        keys = {"joint": (kind, joint), "yaw": (kind, frame), "distance": (kind, *sorted((frame, built.frame())))}
        key: tuple[str, ...] = keys.get(kind, (kind, frame, axis))
        if key not in taken and joint + kind != "joint" and not (kind == "distance" and key[1] == key[2]):
            break
        kind = "position" if kind == "speed" else "speed"
    taken.add(key)
    if kind == "joint":
        return rnc.JointPosition(joint)
    if kind == "yaw":
        return rnc.FrameYaw(frame)
    if kind == "speed":
        return rnc.FrameSpeed(frame, axis)
    if kind == "spin":
        return rnc.FrameAngularVelocity(frame, axis)
    if kind == "distance":
        return rnc.Distance(*key[1:])
    return rnc.FramePosition(frame, axis)


def reduced_of(recipe: Recipe) -> rnc.ReducedModel:
    """The system of a recipe; an RncError if there is none."""
    robot, built = robot_of(recipe)
    constraints = [constraint(kind, robot, built) for kind in recipe.constraints]
    actuators = built.generator.normal(size=(robot.nv, int(built.generator.integers(1, robot.nv + 1))))
    if "momentum" in recipe.constraints:
        actuators[robot.velocity_indices(robot.joint_names[0])] = 0.0
    system = rnc.NonholonomicSystem(robot, constraints, actuators)
    if not recipe.outputs:
        return system.reduce()
    taken: set[tuple[str, ...]] = set()
    reducing = [output(recipe.outputs[k % len(recipe.outputs)], built, taken) for k in range(system.r)]
    vertical = [] if any(key[0] == "position" for key in taken) else [rnc.FramePosition(built.frame(), "xyz")]
    return system.reduce(reducing, vertical)
