"""Every robot of example-robot-data under constraints that any can have."""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from scipy.linalg import null_space, qr

import rnc_pin as rnc
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.robots.robot_files import example_urdfs
from systems import reacting

STATES = 3

# Wheels that touch the ground: frames, radius [m] of the URDF's own cylinders (PR2's are meshes), base.
WHEELS: dict[str, tuple[list[str], float, str]] = {
    "tiago": (["wheel_left_link", "wheel_right_link"], 0.0985, "planar"),
    "tiago_dual": (["wheel_left_link", "wheel_right_link"], 0.0985, "planar"),
    "tiago_no_hand": (["wheel_left_link", "wheel_right_link"], 0.0985, "planar"),
    "pr2": ([f"{end}{side}_caster_{wheel}_wheel_link" for end in "fb" for side in "lr" for wheel in "lr"], 0.075,
        "planar"),
    "tiago_pro": ([f"wheel_{end}_{side}_link" for end in ("front", "rear") for side in ("left", "right")], 0.0762,
        "planar"),
    # Wheels at the ends of legs: they lean, and lift the body with them.
    "centauro": ([f"wheel_{k}" for k in (1, 2, 3, 4)], 0.124, "free"),
}  # fmt: skip

# Of Mecanum wheels, on which side of the wheel's heading the axes of the rollers point that touch the ground.
MECANUM: dict[str, list[int]] = {"tiago_pro": [1, -1, -1, 1]}

# Joints that move no mass at all are locked in these; any other robot with such a joint is refused.
MASSLESS = ("romeo",)

_NO_INERTIA = "rotational inertia behind joint 'root_joint' is not positive"
_NO_LINKS = "has no links"
_RIGID = "leave no motion of 6 degrees of freedom"

# Robot and constraint: what rnc_pin says of it, and why that is right. Everything else has to pass.
EXCUSED: dict[tuple[str, str], tuple[str, str]] = {
    ("romeo_laas_small", "momentum"): (_NO_INERTIA, "inertia tensors of base and hips have a negative eigenvalue"),
    ("romeo_laas_small", "knife edge"): (_NO_INERTIA, "inertia tensors of base and hips have a negative eigenvalue"),
    ("ur3", "momentum"): (_NO_LINKS, "its `<robot>` is empty; `ur3_robot` is the arm"),
    ("ur3", "knife edge"): (_NO_LINKS, "its `<robot>` is empty; `ur3_robot` is the arm"),
    ("quadrotor_base", "momentum"): (_RIGID, "one rigid body: without momentum it does not move"),
    ("iris_simple", "momentum"): (_RIGID, "one rigid body: without momentum it does not move"),
    ("pr2", "rolling wheels"): ("has no single axis", "caster and wheel joints are fixed in this description"),
}

# Folders of the package without a URDF.
WITHOUT_URDF = {"cassie": "described in SDF only, which the Pinocchio of the `pin` wheel does not read"}


class Residuals(NamedTuple):
    """Worst figures of one system over its states, relative to size."""

    robot: str
    constraint: str
    base: str
    n: int
    kept: int
    rows: int
    r: int
    constraint_residual: float
    lemma_1: float
    kkt: float
    smallest_eigenvalue: float


def root_frame(robot: rnc.Robot) -> str:
    """The link that a planar or free base carries."""
    return next(frame.name for frame in robot.model.frames if frame.parentJoint == 1 and frame.type == pin.BODY)


def load(name: str, base: str, **settings: object) -> rnc.Robot:
    """A robot of the zoo, without joints that move no mass where it has such."""
    return rnc.Robot.from_example(name, base=base, lock=dict.fromkeys(massless_joints(name), 0.0), **settings)


@cache
def massless_joints(name: str) -> tuple[str, ...]:
    """Of the robots in MASSLESS, the joints behind which there is no mass."""
    if name not in MASSLESS:
        return ()
    model = pin.buildModelFromUrdf(str(example_urdfs()[name]))
    data = model.createData()
    pin.computeSubtreeMasses(model, data)
    return tuple(joint for joint, mass in zip(model.names, data.mass, strict=True) if mass == 0)


def leading(robot: rnc.Robot) -> list[str]:
    """Joints beside the base that follow no other."""
    following = {mimic.joint for mimic in robot.mimics}
    return [name for name in robot.joint_names if name not in following and name != "root_joint"]


def momentum(name: str) -> rnc.ReducedModel:
    """A free base in space, whose joints are the reducing outputs."""
    robot = load(name, "free", gravity=(0, 0, 0))
    joints = leading(robot)
    system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("root_joint")], joints)
    return system.reduce([rnc.JointPosition(joint) for joint in joints])


def knife_edge(name: str) -> rnc.ReducedModel:
    """A planar base on a skate: forward speed, heading and the joints."""
    robot = load(name, "planar")
    frame, joints = root_frame(robot), leading(robot)
    drive = [rnc.FrameForce(frame, "x"), rnc.FrameTorque(frame, "z")]
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip(frame)], [*drive, *joints])
    return system.reduce([rnc.FrameSpeed(frame), rnc.FrameYaw(frame), *map(rnc.JointPosition, joints)])


def rolling_wheels(name: str) -> rnc.ReducedModel:
    """The robot on its own wheels, in those of its velocities that parametrise the motion best."""
    frames, radius, base = WHEELS[name]
    robot = load(name, base)
    joints = list(robot.joint_names[1:])
    rollers = [side * np.pi / 4 for side in MECANUM[name]] if name in MECANUM else [None] * len(frames)
    wheels = [rnc.RollingWheel(frame, radius, roller=roller) for frame, roller in zip(frames, rollers, strict=True)]
    system = rnc.NonholonomicSystem(robot, wheels, joints)
    return system.reduce([best_velocities(system)])


def best_velocities(system: rnc.NonholonomicSystem) -> rnc.Output:
    """r entries of v, chosen by column-pivoted QR of a null-space basis at one configuration."""
    position = Kinematics(system.robot).position(system.robot.random_configuration(np.random.default_rng(1)))
    chosen = sorted(qr(null_space(system.constraints.jacobian(position)).T, pivoting=True)[2][: system.r])
    rows, still = np.eye(system.n)[chosen], np.zeros((system.r, system.n))
    names = [f"v.{system.robot.velocity_names[k]}" for k in chosen]
    return rnc.Output(None, lambda q: rows, lambda q, v: still, names)


KINDS: dict[str, Callable[[str], rnc.ReducedModel]] = {
    "momentum": momentum, "knife edge": knife_edge, "rolling wheels": rolling_wheels,
}  # fmt: skip


def entries() -> list[tuple[str, str]]:
    """Robot and constraint of every system of the zoo, excused or not."""
    robots = list(example_urdfs())
    return [(name, kind) for name in robots for kind in KINDS if kind != "rolling wheels" or name in WHEELS]


def wheel_links(name: str) -> list[str]:
    """Links of a description that are called wheels."""
    root = ElementTree.parse(example_urdfs()[name]).getroot()
    return [link.get("name", "") for link in root.findall("link") if "wheel" in link.get("name", "").lower()]


def states(reduced: rnc.ReducedModel, count: int = STATES) -> list[tuple[np.ndarray, np.ndarray]]:
    """Seeded random states, the best conditioned of a few times as many."""
    generator = np.random.default_rng(0)
    drawn = [reduced.robot.random_configuration(generator) for _ in range(4 * count)]
    conditions = [reduced.at(q).condition for q in drawn]
    return [(drawn[k], generator.uniform(-1, 1, reduced.r)) for k in np.argsort(conditions)[:count]]


def residuals(name: str, kind: str) -> Residuals:
    """Check a reduction: A R = 0, Lemma 1, and Pinocchio's own constrained dynamics, which know no momentum row."""
    reduced = KINDS[kind](name)
    robot, drawn = reduced.robot, states(reduced)
    lemma = rnc.analysis.lemma_1_residuals(reduced, np.stack([q for q, _ in drawn]))
    generator, data = np.random.default_rng(1), robot.model.createData()
    worst, rows = 0.0, reacting(reduced)
    for q, v2 in drawn:
        T = generator.normal(size=reduced.p)
        t, full = reduced.terms(q, v2), reduced.lagrangian_terms(q, v2)
        ours = t.R @ reduced.forward_dynamics(q, v2, T) + t.R_dot @ v2
        theirs = pin.forwardDynamics(robot.model, data, q, t.v, full.B @ T, t.A[rows], t.A_dot[rows] @ t.v)
        # Weighted by what each moves, so that a light finger's acceleration does not hide the base's.
        weight = np.sqrt(np.diag(full.H))
        worst = max(worst, float(np.abs(weight * (ours - theirs)).max() / np.abs(weight * theirs).max()))
    return Residuals(
        robot=name, constraint=kind,
        base=WHEELS[name][2] if kind == "rolling wheels" else {"momentum": "free", "knife edge": "planar"}[kind],
        n=reduced.n, kept=reduced.m, rows=reduced.m + len(reduced.dropped_rows), r=reduced.r,
        constraint_residual=lemma["A R"],
        lemma_1=max(lemma[each] for each in ("H - H^T", "Hdot - V - V^T", "V linear")), kkt=worst,
        smallest_eigenvalue=lemma["smallest eigenvalue of H"],
    )  # fmt: skip
