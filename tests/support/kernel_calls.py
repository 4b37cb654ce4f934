"""Calls that reach each function of the compiled library, and a task and a limit of each kind."""

import inspect

import coal
import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from rnc_pin.collision import CollisionDistances, Obstacle
from rnc_pin.control import InverseDynamicsQP, VelocityQP, limits, tasks
from rnc_pin.math.linear_algebra import inverse, solve
from rnc_pin.motion.optimal.interior_point import InteriorPointSolver, LinearQuadratic, RiccatiFactors
from rnc_pin.motion.planning import Harmonic, Hold
from rnc_pin.motion.whole_body import ControlSample
from systems import mobile_manipulator, random_states, space_robot_in_joints, tiago


class Taken:
    """A library that notes the names of its functions that took their arrays."""

    def __init__(self, library):
        self._library, self.names = library, set()

    def __getattr__(self, name):
        function = getattr(self._library, name)
        if inspect.isclass(function):
            return function

        def call(*arguments):
            taken = function(*arguments)
            self.names |= {name} if taken else set()
            return taken

        return call


def fresh(make):
    """A reduction by the library in use, which is not that of another test."""
    return inspect.unwrap(make)()


HAND, REACH = rnc.FramePosition("arm_7_link"), Hold([1.5, 1.0, 1.2])
TASKS = {
    "output": (tiago, tasks.OutputTask(HAND, REACH, gain=3.0)),
    "orientation": (tiago, tasks.OutputTask(rnc.FrameOrientation("arm_7_link"), Hold([0.0, 0.3, 0.0]))),
    "posture": (tiago, tasks.PostureTask({"torso_lift_joint": 0.2, "arm_1_joint": 0.5})),
    "centre of mass": (tiago, tasks.CenterOfMassTask(Hold([0.1, 0.2]), "xy")),
    "base pose": (tiago, tasks.BasePoseTask("base_link", Hold([0.3, -0.4, 0.6]), lateral_gain=4.0)),
    "damping": (tiago, tasks.DampingTask()),
    "damping of joints": (tiago, tasks.DampingTask(joints=["arm_1_joint"])),
    "singularity": (mobile_manipulator, tasks.SingularityTask()),
}
LIMITS = {
    "joint positions": (tiago, limits.JointPositionLimit(deceleration=2.0)),
    "joint positions by efforts": (tiago, limits.JointPositionLimit()),
    "joint velocities": (tiago, limits.JointVelocityLimit(margin=0.1)),
    "accelerations": (tiago, limits.AccelerationLimit(2.0)),
    "accelerations of joints": (tiago, limits.AccelerationLimit(2.0, joints=["arm_1_joint"])),
    "region": (tiago, limits.RegionLimit("arm_7_link", box={"x": (-1.0, 2.0)}, gain=5.0)),
    "base speed": (tiago, limits.BaseSpeedLimit("base_link", 0.5)),
    "collisions": (tiago, limits.CollisionAvoidance(influence=0.3)),
}


def rows_of(entry):
    """Arrays of the rows of a task or limit at three samples."""
    make, kind = entry
    reduced, found = fresh(make), []
    bound = kind.bind(reduced)
    for q, v2 in random_states(reduced, 3, seed=5):
        sample = ControlSample(reduced, 0.2, q, 0.1 * v2, 0.01)
        found += [np.asarray(each) for each in bound.rows(sample) if each is not None]
    return found


def programs():
    """Velocities and multipliers of a level that determines everything, alone and below another, in limits and free."""
    reduced, found = fresh(tiago), []
    arm = [name for name in reduced.robot.joint_names[1:] if "wheel" not in name]
    level = tasks.OutputTask(rnc.FrameOrientation("arm_7_link"), Hold([0.0, 0.3, 0.0]), weight=[0.2, 0.5, 1])
    posture = [tasks.OutputTask(rnc.JointPosition(name), Hold([0.1]), gain=2.0, weight=0.05) for name in arm]
    hand = tasks.OutputTask(HAND, REACH, gain=3.0)
    look = tasks.PostureTask({"head_1_joint": 0.4, "head_2_joint": -0.3}, weight=0.3)
    below = [tasks.PostureTask({"torso_lift_joint": 0.2}, priority=1), tasks.DampingTask(priority=1)]
    for largest in (0.2, 100.0):
        box = [limits.JointVelocityLimit(limit=largest, margin=0.0)]
        for chosen in ([hand, look, level, *posture, tasks.DampingTask(weight=0.1)], [hand, look, *below]):
            program = VelocityQP(reduced, chosen, box)
            for q, v2 in random_states(reduced, 4, seed=5):
                solution = program.solve(ControlSample(reduced, 0.0, q, 0.1 * v2, 0.002))
                found += [solution.v2, *solution.multipliers]
    assert sum(multipliers.any() for multipliers in found[1::2]) > 2
    return found


def samples():
    """Inputs of a program that knows the dynamics."""
    reduced, kept = fresh(tiago), [LIMITS["joint velocities"][1]]
    program = InverseDynamicsQP(reduced, [TASKS[name][1] for name in ("output", "posture")], kept, dt=0.01)
    return [program.solve(0.0, q, 0.1 * v2).T for q, v2 in random_states(reduced, 3, seed=5)]


def distances():
    """Distances and rates along a path of TIAGo: which pairs are near is a part of it."""
    reduced, found = fresh(lambda: rnc.NonholonomicSystem(tiago().robot).reduce()), []
    robot = reduced.robot
    motion = Harmonic([0.6, 0.0, 0.6, 0.3], [0.3, 0.2, 0.1, 0.8], 0.4)
    about = [
        Obstacle(coal.Box(0.3, 0.5, 0.7), position=(1.1, -0.6, 0.6), yaw=0.4, roll=0.3, pitch=-0.2, name="box"),
        Obstacle(coal.Capsule(0.15, 0.5), name="person", motion=motion),
    ]
    measured = CollisionDistances(robot, about)
    direction = np.random.default_rng(4).standard_normal(robot.nv)
    for s in (0.0, 0.02, 0.2, 0.21):
        q = pin.integrate(robot.model, robot.configuration(), s * direction)
        near = measured.at(reduced.at(q), 0.5, within=0.2)
        found += [near.pairs, near.distance, near.jacobian]
    return found


def frames():
    """Placements and Jacobians of frames."""
    found = []
    for make in (tiago, space_robot_in_joints):
        reduced = fresh(make)
        ((q, v2),) = random_states(reduced, 1)
        state = reduced.at(q, v2)
        found.append(state.M)  # the kernel fills its record with it
        at = state.position
        for frame in range(0, reduced.robot.model.nframes, 3):
            found += [at.placement(frame).rotation, at.placement(frame).translation, at.jacobian(frame)]
    return found


def positive(generator, *shape):
    """Symmetric positive definite matrices of a shape (..., n), as (..., n, n)."""
    root = generator.normal(size=(*shape, shape[-1]))
    return root @ root.mT + 0.1 * np.eye(shape[-1])


def riccati():
    """Factors and solutions of problems whose costs are convex."""
    generator, N, nx, nu, m = np.random.default_rng(0), 5, 3, 2, 2
    AB, H, end = generator.normal(size=(N, nx, nx + nu)), positive(generator, N, nx + nu), positive(generator, nx)
    shapes = ((N, nx + nu, m), (nx, m), (N, nx, m))
    return RiccatiFactors(AB, H, end).solve(*(generator.normal(size=shape) for shape in shapes))


def programs_in_stages():
    """Problems within rows that act on states and inputs, one with an end out of reach."""
    found = []
    for end in (0.3, 50.0):
        generator, N, nx, nu = np.random.default_rng(3), 6, 3, 2
        G = np.zeros((N + 1, 4, nx + nu))
        G[:-1, :, nx:], G[-1, 0, 0] = generator.normal(size=(4, nu)), 1.0
        G[:-1, 2:, :nx] = 0.1 * generator.normal(size=(2, nx))
        upper = np.full((N + 1, 4), np.inf)
        upper[:-1], upper[-1, 0] = 0.3, end
        AB = generator.normal(size=(N, nx, nx + nu)) * ([0.5] * nx + [1.0] * nu)
        g, g_end = generator.normal(size=(N, nx + nu)), generator.normal(size=nx)
        H = np.tile(np.eye(nx + nu), (N, 1, 1))
        lower = np.where(np.isinf(upper), -np.inf, np.where(upper < 1, -0.3, end))
        lower[-1, 0] = end
        rows = G, lower, upper, np.zeros((N, nu, nx))
        problem = LinearQuadratic(AB, np.zeros((N, nx)), H, g, np.eye(nx), g_end, *rows)
        direction = InteriorPointSolver().solve(problem, 1e-8, 1e3)
        assert direction.iterations > 0
        found += [direction.x, direction.u, direction.costate, np.array([float(direction.iterations)])]
    return found


def sizes_of_rows():
    """Typical sizes of rows that depend on states, inputs and both."""
    generator, N, nx, nu, k = np.random.default_rng(5), 7, 5, 3, 4
    AB, G = generator.normal(size=(N, nx, nx + nu)), generator.normal(size=(N + 1, k, nx + nu))
    G[:, 0, :nx], G[:, 1, nx:], G[-1, :, nx:] = 0.0, 0.0, 0.0
    H, end, limit = np.tile(np.diag([1.0] * 5 + [0.3, 2.0, 0.0]), (N, 1, 1)), np.eye(nx), np.ones((N + 1, k))
    rows = G, -limit, limit, np.zeros((N, nu, nx))
    linear = LinearQuadratic(0.4 * AB, AB[:, :, 0], H, H[:, 0], end, end[0], *rows)
    return [linear.typical_sizes]


CALLS = {
    **dict.fromkeys(("riccati_factors", "riccati_solve"), (riccati, 1e-9)),
    "variances": (sizes_of_rows, 1e-12), "interior_point": (programs_in_stages, 1e-9),
    "cascade": (programs, 1e-10), "program": (samples, 1e-10), "frame_kinematics": (frames, 1e-13),
    "stopping": (lambda: rows_of(LIMITS["joint positions by efforts"]), 1e-12),
    "solve": (lambda: [solve(np.eye(3) + 1.0, np.arange(3.0)), inverse(np.eye(3) + 1.0)], 1e-14),
    **dict.fromkeys(("shape_poses", "pair_rows", "pair_bounds"), (distances, 1e-13)),
}  # fmt: skip
"""Function of the library to a call that reaches it, with the tolerance relative to the largest value, at least 1."""
