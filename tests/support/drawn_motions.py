"""Drawn robots of primitives and their motions among obstacles, with a dense replay by Pinocchio and coal alone."""

import warnings
from collections.abc import Iterable
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from rnc_pin.collision import Obstacle

DENSE = 80  # times between two samples


@dataclass
class DrawnMotion:
    """A robot, obstacles, and a motion with few samples."""

    robot: rnc.Robot
    obstacles: list[Obstacle]
    time: np.ndarray
    q: np.ndarray

    def configuration(self, t: float) -> np.ndarray:
        k = int(np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self.time) - 2))
        part = (t - self.time[k]) / (self.time[k + 1] - self.time[k])
        return pin.interpolate(self.robot.model, self.q[k], self.q[k + 1], float(part))


def unit(generator: np.random.Generator, size: int) -> np.ndarray:
    vector = generator.normal(size=size)
    return vector / np.linalg.norm(vector)


def random_pose(generator: np.random.Generator, size: float) -> pin.SE3:
    return pin.SE3(pin.Quaternion(unit(generator, 4)), generator.uniform(-size, size, 3))


def random_joint(generator: np.random.Generator) -> pin.JointModel:
    axis, inner = unit(generator, 3), pin.JointModelComposite()
    inner.addJoint(pin.JointModelPY(), random_pose(generator, 0.1))
    inner.addJoint(pin.JointModelRevoluteUnaligned(axis), random_pose(generator, 0.1))
    inner.addJoint(pin.JointModelRX(), random_pose(generator, 0.1))
    kinds = [
        pin.JointModelRX(), pin.JointModelRZ(), pin.JointModelRUBY(), pin.JointModelRevoluteUnaligned(axis),
        pin.JointModelPX(), pin.JointModelPrismaticUnaligned(axis), pin.JointModelSpherical(),
        pin.JointModelSphericalZYX(), pin.JointModelPlanar(), pin.JointModelTranslation(), pin.JointModelFreeFlyer(),
        pin.JointModelUniversal(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])),
        pin.JointModelHX(0.2), pin.JointModelHelicalUnaligned(axis, -0.1), pin.JointModelEllipsoid(0.1, 0.3, 0.2),
        inner,
    ]  # fmt: skip
    return kinds[generator.integers(len(kinds))]


def random_shape(generator: np.random.Generator) -> coal.CollisionGeometry:
    a, b, c = generator.uniform(0.02, 0.25, 3)
    shapes = [
        coal.Box(a, b, c), coal.Sphere(a), coal.Capsule(0.5 * a, b), coal.Cylinder(a, b), coal.Cone(a, b),
        coal.Ellipsoid(a, b, c),
    ]  # fmt: skip
    return shapes[generator.integers(len(shapes))]


def random_obstacle(generator: np.random.Generator, name: str, place: np.ndarray, duration: float) -> Obstacle:
    thin, shape = coal.Box(generator.uniform(0.004, 0.02), *generator.uniform(0.1, 1.0, 2)), random_shape(generator)
    angles = dict(zip(("yaw", "roll", "pitch"), generator.uniform(-3, 3, 3), strict=True))
    kind, yaw = generator.integers(4), angles["yaw"]
    at = np.append(place, yaw)
    if kind == 0:
        motion = rnc.planning.Harmonic(at, generator.uniform(-0.8, 0.8, 4), generator.uniform(0.2, 1.5))
    elif kind == 1:
        move = generator.uniform(-2, 2, 4)
        motion = rnc.planning.MinimumJerk(at - 0.5 * move, at + 0.5 * move, duration=duration)
    else:
        motion = None
    if kind == 2 and generator.uniform() < 0.3:
        return Obstacle(rnc.collision.ground_shape(), place - [0, 0, 1.0], name=name, roll=angles["roll"] / 10)
    return Obstacle(thin if generator.uniform() < 0.7 else shape, place, name=name, motion=motion, **angles)


def drawn_motion(seed: int) -> DrawnMotion:
    """A robot of one to five joints, one to three obstacles, and two to five samples that are far apart."""
    generator = np.random.default_rng(seed)
    model, geometry = pin.Model(), pin.GeometryModel()
    for k in range(generator.integers(1, 6)):
        above = generator.choice(list(model.supports[k]))  # Pinocchio's order of joints is depth first
        placed = random_joint(generator), random_pose(generator, 0.4), f"joint_{k}"
        joint = model.addJoint(int(above), *placed)
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
        frame = model.addFrame(pin.Frame(f"link_{k}", joint, 0, pin.SE3.Identity(), pin.FrameType.BODY))
        for number in range(generator.integers(1, 3)):
            shape, pose = random_shape(generator), random_pose(generator, 0.2)
            geometry.addGeometryObject(pin.GeometryObject(f"link_{k}_{number}", joint, frame, pose, shape))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rnc.ModelWarning)  # universal, ZYX and composite joints are meant
        robot = rnc.Robot(model, geometry, geometry)
    time = np.cumsum(generator.uniform(0.05, 0.4, generator.integers(2, 6)))
    q = [robot.random_configuration(generator, 1.0)]
    speed = generator.uniform(0.2, 1.5)
    for _ in time[1:]:
        q.append(pin.integrate(model, q[-1], speed * generator.normal(size=model.nv)))
    data, obstacles = model.createData(), []
    for k in range(generator.integers(1, 4)):  # near the path of a link
        pin.forwardKinematics(model, data, q[generator.integers(len(q))])
        place = data.oMi[int(generator.integers(1, model.njoints))].translation + generator.normal(scale=0.25, size=3)
        obstacles.append(random_obstacle(generator, f"obstacle_{k}", place, float(time[-1])))
    return DrawnMotion(robot, obstacles, time, np.array(q))


class DenseReplay:
    """Smallest distances of pairs of shapes at many times, by Pinocchio's kinematics and coal; minima are refined."""

    def __init__(self, motion: DrawnMotion, pairs: list[tuple[int, int]]) -> None:
        self._motion, self._pairs, self._data = motion, pairs, motion.robot.model.createData()
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        self._request.gjk_tolerance, self._request.epa_tolerance = 1e-9, 1e-6
        self._request.gjk_max_iterations = 256

    def smallest(self) -> np.ndarray:
        """Smallest distances (k,) of the pairs [m]."""
        ends = zip(self._motion.time, self._motion.time[1:], strict=False)
        times = np.unique(np.concatenate([np.linspace(*each, DENSE + 1) for each in ends]))
        every = np.array([self.distances(t, range(len(self._pairs))) for t in times.tolist()])
        found = every.min(axis=0)
        for k, at in enumerate(every.argmin(axis=0).tolist()):
            low, high = times[max(at - 1, 0)], times[min(at + 1, len(times) - 1)]
            for _ in range(3):
                closer = np.linspace(low, high, 9)
                values = [self.distances(t, [k])[0] for t in closer.tolist()]
                best = int(np.argmin(values))
                found[k] = min(found[k], values[best])
                low, high = closer[max(best - 1, 0)], closer[min(best + 1, 8)]
        return found

    def distances(self, t: float, which: Iterable[int]) -> list[float]:
        """Distances of some pairs at a time [m]."""
        shapes, robot = self._motion.robot.collision_model.geometryObjects, self._motion.robot
        pin.forwardKinematics(robot.model, self._data, self._motion.configuration(t))
        links = [(self._data.oMi[shape.parentJoint] * shape.placement, shape.geometry) for shape in shapes]
        bodies = [*links, *((each.placement(t), each.shape) for each in self._motion.obstacles)]
        placed = [(body, coal.Transform3s(pose.rotation, pose.translation)) for pose, body in bodies]
        found = []
        for k in which:
            self._result.clear()
            first, second = self._pairs[k]
            found.append(float(coal.distance(*placed[first], *placed[second], self._request, self._result)))
        return found
