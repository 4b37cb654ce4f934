"""Calls that reach each function of the compiled library, and a task and a limit of each kind."""

import inspect

import coal
import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from controlled_tasks import TASK, Cubic, task_at, truck_task
from rnc_pin.collision import CollisionDistances, Obstacle
from rnc_pin.control import (
    DrivenPath,
    PositionGains,
    PositionTracker,
    RedundancyController,
    SlitheringReference,
    VelocityGains,
    VelocityQP,
    VelocityTarget,
    VelocityTracker,
    limits,
    tasks,
)
from rnc_pin.control.estimation import adapt
from rnc_pin.control.feedback import Feedback
from rnc_pin.control.velocity_tracker import TrackerState
from rnc_pin.control.whole_body import ControlSample
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.model.reduced_kinematics import Measurement
from rnc_pin.optimal.interior_point import InteriorPointSolver, LinearQuadratic, RiccatiFactors
from rnc_pin.planning import Harmonic, Hold, MinimumJerk, ViaPoints
from rnc_pin.planning.references import ReferencePoint
from systems import fire_truck, mecanum, mobile_manipulator, random_states, space_robot_in_joints, tiago


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


# ---------------------------------------------------------------------- tasks and limits

HAND, REACH = rnc.FramePosition("arm_7_link"), Hold([1.5, 1.0, 1.2])
TASKS = {
    "output": (tiago, tasks.OutputTask(HAND, REACH, gain=3.0)),
    "orientation": (tiago, tasks.OutputTask(rnc.FrameOrientation("arm_7_link"), Hold([0.0, 0.3, 0.0]))),
    "posture": (tiago, tasks.PostureTask({"torso_lift_joint": 0.2, "arm_1_joint": 0.5})),
    "centre of mass": (tiago, tasks.CenterOfMassTask(Hold([0.1, 0.2]), "xy")),
    "look at a point": (tiago, tasks.LookAtTask("head_2_link", [2.0, 0.4, 1.4])),
    "look at a frame": (tiago, tasks.LookAtTask("head_2_link", "arm_7_link")),
    "base pose": (tiago, tasks.BasePoseTask("base_link", Hold([0.3, -0.4, 0.6]), lateral_gain=4.0)),
    "damping": (tiago, tasks.DampingTask()),
    "damping of joints": (tiago, tasks.DampingTask(joints=["arm_1_joint"])),
    "manipulability": (tiago, tasks.ManipulabilityTask(HAND)),
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
    "base acceleration": (tiago, limits.BaseAccelerationLimit("base_link", 1.0)),
    "wheel speeds": (mecanum, limits.WheelSpeedLimit(0.4)),
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


def limited_arm():
    """The mobile manipulator inside the limits of its joints, at their ends and beyond."""
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    x2 = [rnc.FrameSpeed("base"), rnc.FrameYaw("base"), rnc.JointPosition("joint_1"), rnc.JointPosition("joint_2")]
    reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce(x2)
    bound, found = limits.JointPositionLimit(deceleration=2.0).bind(reduced), []
    for angle in (-9.0, -1.0, 0.3, 2.0, 9.0):
        q = robot.configuration({"joint_1": angle, "joint_2": 0.5 * angle})
        rows = bound.rows(ControlSample(reduced, 0.0, q, np.array([0.1, 0.2, -0.6, 0.9]), 0.01))
        found += [rows.lower, rows.upper]
    return found


def programs():
    """Velocities and multipliers of a level that determines everything, alone and below another; limits are active."""
    reduced, found = fresh(tiago), []
    arm = [name for name in reduced.robot.joint_names[1:] if "wheel" not in name]
    level = tasks.OutputTask(rnc.FrameOrientation("arm_7_link"), Hold([0.0, 0.3, 0.0]), weight=[0.2, 0.5, 1])
    posture = [tasks.OutputTask(rnc.JointPosition(name), Hold([0.1]), gain=2.0, weight=0.05) for name in arm]
    hand, look = tasks.OutputTask(HAND, REACH, gain=3.0), tasks.LookAtTask("head_2_link", "arm_7_link", weight=0.3)
    below = [tasks.PostureTask({"torso_lift_joint": 0.2}, priority=1), tasks.DampingTask(priority=1)]
    box = [limits.JointVelocityLimit(limit=0.2, margin=0.0)]
    for damping in (0.0, 0.3):
        for chosen in ([hand, look, level, *posture, tasks.DampingTask(weight=0.1)], [hand, look, *below]):
            program = VelocityQP(reduced, chosen, box, damping=damping)
            for q, v2 in random_states(reduced, 4, seed=5):
                solution = program.solve(ControlSample(reduced, 0.0, q, 0.1 * v2, 0.002))
                found += [solution.v2, *solution.multipliers]
    assert sum(multipliers.any() for multipliers in found[1::2]) > 2
    return found


# ---------------------------------------------------------------------- distances and frames


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


# ---------------------------------------------------------------------- laws of controllers


def feedbacks():
    """Of places on lines and circles and of orientations; zero gains need no values."""
    generator, found = np.random.default_rng(3), []
    lines, turns = Coordinates([False, False, True]), Coordinates([0, 1, 0, 0, 0, 0], [2])
    for gain in (2.0, np.array([1.5, 0.0, 0.7])):
        desired = ReferencePoint(*generator.normal(size=(4, 3)))
        for circles in (-3, -1, 0, 2):
            x, rate = generator.normal(size=(2, 4, 3))
            x[:, 2] += 2 * np.pi * circles
            x[:, 1] = np.nan if np.ndim(gain) else x[:, 1]
            law = Feedback(lines, gain)
            found += [*law(desired, x[0], rate[0]), *law(desired, x, rate)]
    law = Feedback(turns, generator.uniform(1.0, 3.0, 6))
    for size in (1e-9, 1e-5, 1e-2, 0.3, 1.0, 2.0, 3.0):
        for _ in range(20):
            desired = ReferencePoint(*generator.normal(size=(4, 6)))
            desired.position[2:5] *= size
            actual, rate = generator.normal(size=(2, 6))
            actual[2:5] = desired.position[2:5] + size * generator.normal(size=3)
            found += law(desired, actual, rate)
    return found


def adaptations():
    """Parameters inside their bounds and at them."""
    generator = np.random.default_rng(2)
    drawn = [(generator.normal(size=3), generator.normal(size=(2, 3)), generator.normal(size=2)) for _ in range(6)]
    bounds = np.full(3, -1.0), np.full(3, 1.0)
    return [adapt(*each, 5.0, 0.1, *bounds, zone) for each in drawn for zone in (0.0, np.array([0.5, 0.1]))]


def position_trackers():
    """Outputs chosen out of order, one of them an angle; with a dead zone and force that is cut off."""
    generator, found, held = np.random.default_rng(5), [], np.array([0.4, -0.7])
    points = ViaPoints([0.0, 1.0, 2.0], generator.uniform(-1, 1, (3, 2)))
    for zone in (0.0, 0.3):
        gains = PositionGains(k1=np.array([10.0, 6.0]), beta=np.array([8.0, 12.0]), dead_zone=zone)
        tracker = PositionTracker(points, gains, [2, 0], [True, False], held)
        for saturated in (False, True):
            state = None
            for t in np.linspace(0.0, 1.0, 60):
                x2 = generator.uniform(-1, 1, 3) + np.array([0.0, 0.0, 2 * np.pi])
                m = rnc.Measurement(x2=x2, force_deficit=generator.normal(size=3) if saturated else None)
                command, state = tracker.step(t, m, state or tracker.initial_state(m))
                found += [command.F, command.v2_desired, command.x2_desired, *state[1:]]
    return found


class Said:
    """A velocity target that is written down."""

    def __init__(self, v2, v2_dot):
        self.target = VelocityTarget(v2, v2_dot, np.zeros(0), np.zeros(2))

    def initial_state(self, measurement):
        return None

    def step(self, t, measurement, state):
        return self.target, state


def velocity_trackers():
    """One state and six, leaking or not, with dead zones and force that is cut off."""
    generator, found = np.random.default_rng(5), []
    k, beta, held = np.array([3.0, 7.0]), np.array([11.0, 4.0]), [0.7, -1.3]
    v2, v2d, v2d_dot, excess = generator.uniform(-1, 1, (4, 6, 2))
    learnt = generator.normal(size=(6, 2)), generator.normal(size=(6, 2, 2)), generator.normal(size=(6, 2, 4))
    for sigma in (0.0, 0.6):
        for zone in (0.0, np.array([0.3, 0.05])):
            for at in (0, slice(None)):
                tracker = VelocityTracker(Said(v2d[at], v2d_dot[at]), VelocityGains(k, beta, sigma, zone), held)
                for deficit in (None, excess[at]):
                    m = Measurement(v2=v2[at], force_deficit=deficit)
                    command, state = tracker.step(2.35, m, TrackerState(2.0, *(each[at] for each in learnt), None))
                    found += [command.F, *state[1:4]]
    return found


def pursuits():
    """As many redundant as vertical outputs and more, a secondary objective, rows that move by themselves."""
    found, orders = [], np.random.default_rng(7).uniform(-1, 1, (2, 4, 2))
    gains = np.array([1.7, 0.6]), np.array([0.9, 2.3])

    def objective(t, m):
        return 0.3 * t + m.x2[..., [1, 2, 4]], 0.3 + m.v2[..., [1, 2, 4]]

    for redundant, secondary in (([2, 1], None), ([4, 1, 2], None), ([4, 1, 2], objective)):
        r = 2 + len(redundant)
        weights = np.array([0.5, 3.0, 1.3]) if r == 5 else None
        chosen = task_at([3, 0], redundant, [2, 0])
        law = RedundancyController(chosen, *(Cubic(*each) for each in orders), *gains, weights, secondary)
        for batch in ((), (3,)) if secondary is None else ((),):
            shapes = {"x1": (3,), "x2": (r,), "v1": (3,), "v2": (r,), "A_star": (3, r), "A_star_dot": (3, r)}
            shapes |= {"v1_offset": (3,), "v1_offset_dot": (3,)}
            generator = np.random.default_rng(4)
            m = {name: generator.uniform(-1, 1, (*batch, *shape)) for name, shape in shapes.items()}
            for absent in ({}, {"v1_offset": None, "v1_offset_dot": None}):
                target = law.step(0.4, Measurement(**(m | absent)))[0]
                found += [target.v2, target.v2_dot, target.x1, target.x2]
    return found


def steerings():
    reduced, _, _, law, _ = truck_task()
    found = []
    for q, v2 in random_states(reduced, 6):
        m = reduced.at(q, v2).measure(np.array([0.2, 0.0, 0.0]))
        target, _ = law.step(0.6, m, law.initial_state(m))
        found += [target.v2, target.v2_dot, target.x1, target.x2]
    return found


def slitherings():
    """Heading behind a noisy path, and the places that are forgotten."""
    task = rnc.Task.of(fire_truck(), *TASK)
    law, generator = SlitheringReference(fire_truck(), task, "tractor", "rear_axle"), np.random.default_rng(8)
    driven = np.arange(0.0, 4.0, law.spacing)
    path = np.column_stack([2.0 * np.sin(driven / 2), 2.0 - 2.0 * np.cos(driven / 2), driven / 2, driven])
    path[:, :3] += 1e-4 * generator.standard_normal((len(path), 3))
    v2, v2_dot, A, A_dot = (generator.normal(size=size) for size in (3, 3, (4, 3), (4, 3)))
    x1 = np.array([*(path[-1, :2] + [0.004, 0.003]), 0.3, path[-1, 2]])
    v1 = np.array([0.7, 0.4, 3.0, -2.0])
    m = Measurement(x1=x1, v1=v1, v2=v2, A_star=A, A_star_dot=A_dot)
    point, after = law.step(m, v2_dot, DrivenPath(path, path[-1, 2] - 0.25))
    assert len(after.path) < len(path)
    np.testing.assert_array_equal(after.path, path[len(path) - len(after.path) :])
    return [*point[:3], np.array([after.heading, len(after.path)])]


# ---------------------------------------------------------------------- references and optimal control


def along(reference):
    return [np.array(reference.at(t)) for t in (-0.1, 0.0, 0.3, 0.7, 1.0, 1.9, 2.5)]


def polynomials():
    points = np.random.default_rng(5).uniform(-1, 1, (3, 2))
    return [*along(MinimumJerk([1.0, -1.0], [0.5, 0.7], 2.0)), *along(ViaPoints([0.0, 1.0, 2.0], points))]


def harmonics():
    return along(Harmonic([0.1, 2.0], [0.3, -0.7], [0.5, 1.3], phase=[0.4, 0.0]))


def riccati():
    """Factors and solutions of problems whose costs are convex."""
    generator, N, nx, nu, m = np.random.default_rng(0), 5, 3, 2, 2

    def positive(*shape):
        root = generator.normal(size=(*shape, shape[-1]))
        return root @ root.mT + 0.1 * np.eye(shape[-1])

    AB, H, end = generator.normal(size=(N, nx, nx + nu)), positive(N, nx + nu), positive(nx)
    return RiccatiFactors(AB, H, end).solve(
        *(generator.normal(size=shape) for shape in ((N, nx + nu, m), (nx, m), (N, nx, m)))
    )


def programs_in_stages():
    """Problems within rows that act on states and inputs, one with an end out of reach."""
    found = []
    for end in (0.3, 50.0):
        generator, N, nx, nu = np.random.default_rng(3), 6, 3, 2
        D, C = np.zeros((N + 1, 4, nu)), np.zeros((N + 1, 4, nx))
        D[:-1], C[-1, 0, 0] = generator.normal(size=(4, nu)), 1.0
        C[:-1, 2:] = 0.1 * generator.normal(size=(2, nx))
        upper = np.full((N + 1, 4), np.inf)
        upper[:-1], upper[-1, 0] = 0.3, end
        A, B = (scale * generator.normal(size=(N, nx, size)) for scale, size in ((0.5, nx), (1.0, nu)))
        g, g_end = generator.normal(size=(N, nx + nu)), generator.normal(size=nx)
        H = np.tile(np.eye(nx + nu), (N, 1, 1))
        lower = np.where(np.isinf(upper), -np.inf, np.where(upper < 1, -0.3, end))
        lower[-1, 0] = end
        problem = LinearQuadratic(A, B, np.zeros((N, nx)), H, g, np.eye(nx), g_end, C, D, lower, upper)
        direction = InteriorPointSolver().solve(problem, 1e-8, 1e3)
        assert direction.iterations > 0
        found += [direction.x, direction.u, direction.costate, np.array([float(direction.iterations)])]
    return found


def sizes_of_rows():
    """Typical sizes of rows that depend on states, inputs and both."""
    generator, N, nx, nu, k = np.random.default_rng(5), 7, 5, 3, 4
    A, B, C, D = (generator.normal(size=(N + last, *shape)) for last, *shape in (
        (0, nx, nx), (0, nx, nu), (1, k, nx), (1, k, nu)
    ))  # fmt: skip
    C[:, 0], D[:, 1] = 0.0, 0.0
    H, end = np.tile(np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 0.3, 2.0, 0.0]), (N, 1, 1)), np.eye(nx)
    limit = np.ones((N + 1, k))
    linear = LinearQuadratic(0.4 * A, B, A[:, 0], H, H[:, 0], end, end[0], C, D, -limit, limit)
    return list(linear.typical_sizes)


CALLS = {
    "feedback": (feedbacks, 1e-10),
    "adapt": (adaptations, 1e-12),
    "track_position": (position_trackers, 1e-12),
    "track": (velocity_trackers, 1e-12),
    "pursue": (pursuits, 1e-9),
    "steer": (steerings, 1e-9),
    "slither": (slitherings, 1e-9),
    "polynomial": (polynomials, 1e-12),
    "harmonic": (harmonics, 1e-13),
    "riccati_factors": (riccati, 1e-9),
    "riccati_solve": (riccati, 1e-9),
    "variances": (sizes_of_rows, 1e-12),
    "interior_point": (programs_in_stages, 1e-9),
    "least_squares": (programs, 1e-10),
    "stopping_velocities": (limited_arm, 0.0),
    "frame_kinematics": (frames, 1e-13),
    "shape_poses": (distances, 1e-13),
    "pair_rows": (distances, 1e-13),
    "pair_bounds": (distances, 1e-13),
}
"""Function of the library to a call that reaches it, with the tolerance relative to the largest value, at least 1."""
