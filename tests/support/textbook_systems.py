"""Small systems whose mechanics fit on a page."""

import json

import numpy as np
import pinocchio as pin

import rnc_pin as rnc
from bodies import add_body, add_frame
from places import DATA
from rnc_pin.analysis.linearization import Linearization
from rnc_pin.model.rows import ConstantRows, Rows
from systems import rolling_base


def planar_model(name="vehicle"):
    model = pin.Model()
    model.name = name
    joint = add_body(model, "root_joint", "Planar", 1.0, moments=0.1, frame="body")
    return model, joint


def unicycle():
    model, _ = planar_model()
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("body")], np.eye(3)[:, [0, 2]])
    return system.reduce([rnc.FrameSpeed("body"), rnc.FrameYaw("body")], [rnc.FramePosition("body", "xy")])


def unicycle_with_trailers(count):
    """A unicycle with trailers hitched at each other's axles; growth (2, 3, 4, ...): Laumond 1993."""
    model, parent = planar_model()
    frames = ["body"]
    for k in range(1, count + 1):
        hitch = (0.0 if k == 1 else -1.0, 0.0, 0.0)
        parent = add_body(model, f"hitch_{k}", "RZ", 1.0, parent, com=(-1.0, 0.0, 0.0), moments=0.1, at=hitch)
        add_frame(model, f"axle_{k}", parent, (-1.0, 0.0, 0.0))
        frames.append(f"axle_{k}")
    edges = [rnc.NoSideSlip(frame) for frame in frames]
    system = rnc.NonholonomicSystem(rnc.Robot(model), edges, np.eye(model.nv)[:, [0, 2]])
    return system.reduce([rnc.FrameSpeed("body"), rnc.FrameYaw("body")])


def prismatic(A5, A5_gradient):
    """Four bodies on four rails, ``x11dot = 0.3 x21dot + x22dot, x12dot = A5(q) x21dot``, q = (x11, x12, x21, x22)."""
    model = pin.Model()
    for name in ("x11", "x12", "x21", "x22"):
        add_body(model, name, "PX", 1.0)
    rows = rnc.Pfaffian(
        lambda q: np.array([[1.0, 0.0, -0.3, -1.0], [0.0, 1.0, -A5(q), 0.0]]),
        lambda q, v: np.array([[0.0, 0.0, 0.0, 0.0], [0.0, 0.0, -A5_gradient(q) @ v, 0.0]]),
    )
    x11, x12, x21, x22 = map(rnc.JointPosition, model.names[1:])
    return rnc.NonholonomicSystem(rnc.Robot(model), [rows]).reduce([x21, x22], [x11, x12])


def rail_sliders(count):
    """Bodies on rails of their own, ``s0`` to ``s<count - 1>``: q and v are their places and speeds."""
    model = pin.Model()
    model.name = "sliders"
    for k in range(count):
        add_body(model, f"s{k}", "PX", 1.0)
    return rnc.Robot(model)


G = 9.81

WHEEL, BLADE = 0.08, np.array([-0.2, 0.5, 0.0])
PLACES = {"a": (0.4, 0.3), "b": (-0.2, -0.35), "nose": (0.55, -0.25), "tail": (-0.6, 0.15)}


def cart_robot(base="planar", gravity=-G):
    """Two wheels at odd places, two gliding points, and a heavy mast that turns."""
    model = rolling_base({name: PLACES[name] for name in "ab"}, WHEEL, base)
    model.gravity.linear = np.array([0.0, 0.0, gravity])
    carrier = model.getJointId("root_joint")
    for name in ("nose", "tail"):
        add_frame(model, name, carrier, (*PLACES[name], 0.0))
    add_body(model, "mast", "RZ", 9.0, carrier, com=(0.4, 0.0, 0.2))
    return rnc.Robot(model)


def hanging_chain(actuators, count=3):
    return rnc.NonholonomicSystem(hanging(f"hinge_{k}" for k in range(count)), [], actuators).reduce()


def hanging(names):
    """Links of 1 m and 1 kg on joints of these names, which hang from the ceiling at zero."""
    model = pin.Model()
    for k, name in enumerate(names):
        add_body(model, name, "RY", 1.0, k, com=(0, 0, -0.5), moments=0.1, at=(0, 0, -1.0 if k else 0.0))
    return rnc.Robot(model)


def sideways_pendulum():
    """Gravity of 0.1, of which 0.08 pull it down and 0.06 go along its axis."""
    reduced = hanging_chain([], 1)
    reduced.robot.model.gravity.linear = np.array([0.0, 0.06, -0.08])
    return reduced


def sliders_with_rows(A, A_dot=None):
    """Slides whose last ``k`` move at ``A(q)`` (k, r) times the rates of the first ``r``."""
    k, r = np.shape(A(np.zeros(99)))

    def rows(q):
        return np.hstack([-np.array(A(q), float), np.eye(k)])

    def rows_dot(q, v):
        return np.zeros((k, r + k)) if A_dot is None else np.hstack([-np.array(A_dot(q, v), float), np.zeros((k, k))])

    names = [f"row_{i}" for i in range(k)]
    reduced = rnc.NonholonomicSystem(rail_sliders(r + k), [rnc.Pfaffian(rows, rows_dot, names)])
    joints = [rnc.JointPosition(f"s{i}") for i in range(r + k)]
    return reduced.reduce(joints[:r], joints[r:])


def wheeled_pendulum(actuators=("left_axle", "right_axle")):
    robot = rnc.Robot.from_urdf("wheeled_pendulum.urdf", base="planar")
    wheels = [rnc.RollingWheel(f"{side}_wheel", 0.1) for side in ("left", "right")]
    system = rnc.NonholonomicSystem(robot, wheels, list(actuators))
    return system.reduce([rnc.FrameSpeed("base"), rnc.JointPosition("pitch"), rnc.FrameYaw("base")])


def vertical_disk():
    robot = rnc.Robot.from_urdf("vertical_disk.urdf", base="planar")
    system = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("disk", 0.25)], ["axle"])
    return system.reduce([rnc.JointPosition("axle"), rnc.FrameYaw("carrier")])


def tractor_trailers(n):
    robot = rnc.Robot.from_urdf("tractor_trailers.urdf.xacro", base="planar", xacro_arguments={"trailers": n})
    axles = ["front_axle", "tractor_axle", *(f"axle_{number}" for number in range(1, n + 1))]
    rows, inputs = [rnc.NoSideSlip(axle) for axle in axles], [rnc.FrameForce("tractor", "x"), "front_steering"]
    system = rnc.NonholonomicSystem(robot, rows, inputs)
    return system.reduce([rnc.FrameSpeed("tractor"), rnc.JointPosition("front_steering")])


SLEIGH = json.loads((DATA / "chaplygin_sleigh.json").read_text())


def chaplygin_sleigh() -> rnc.ReducedModel:
    p, model = SLEIGH["parameters"], pin.Model()
    model.name = "sleigh"
    com, moments = (p["a"], 0.0, 0.0), (0.3, 0.3, p["I_com"])
    add_body(model, "root_joint", "Planar", p["m"], com=com, moments=moments, frame="edge")
    inputs = [rnc.FrameForce("edge", "x"), rnc.FrameTorque("edge", "z")]
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("edge")], inputs)
    return system.reduce([rnc.FrameSpeed("edge"), rnc.FrameYaw("edge")], [rnc.FramePosition("edge", "xy")])


def sliders(kinds="XXX", masses=(2.0, 3.0, 5.0), chain=True):
    """Bodies that slide along x, each on the one before: their inertia matrix is constant and full."""
    model = pin.Model()
    model.name = "sliders"
    for name, kind, mass in zip("abcdef", kinds, masses, strict=False):
        joint = getattr(pin, "JointModel" + {"X": "PX", "R": "RX", "U": "RUBX"}[kind])()
        add_body(model, name, joint, mass, model.njoints - 1 if chain else 0, moments=mass)
    return rnc.Robot(model)


class Flat(ConstantRows):
    """Rows of numbers, with a residual that is linear in q, or whatever is given."""

    def __init__(self, matrix, names, gap=None, holonomic=None, units=None, on_ground=False):
        self.matrix, self.names = np.array(matrix, dtype=float), tuple(names)
        self.units = units or ("m/s",) * len(names)
        self.holonomic, self.on_ground = holonomic or (True,) * len(names), on_ground
        self._gap = (lambda q: np.matvec(self.matrix, q) - 1.0) if gap is None else gap

    def residual(self, at):
        return self._gap(at.q)


def coupling(joint, driver, ratio=1.0, offset=0.0):
    return rnc.JointCoupling(joint, driver, ratio, offset)


class Bound:
    """A kind that is bound already."""

    def __init__(self, rows):
        self.rows = rows

    def bind(self, robot):
        return self.rows


def linear(A, B):
    """A system that is written down, with states x0, x1, ... and inputs u0, u1, ..."""
    A, B = np.array(A, float), np.array(B, float)
    states, inputs = (tuple(f"{letter}{k}" for k in range(count)) for letter, count in zip("xu", B.shape, strict=True))
    zero = np.zeros(1)
    return Linearization(A, B, states, inputs, zero, zero, zero, 0.0, (), None, None)


def two_wheeled_cart(base=None, left=(0.1, 0.3, 0.2), right=(0.1, -0.3, 0.2), off=(0.0, 0.0, 0.0)):
    """Two wheels on a body; the left one's frame is off the axis of its joint by this much."""
    model = pin.Model()
    model.name = "cart"
    body = add_body(model, "body", base or pin.JointModelPX(), 5.0)
    for name, place, aside in (("left", left, off), ("right", right, (0.0, 0.0, 0.0))):
        joint = add_body(model, f"{name}_joint", "RY", 1.0, body, moments=0.01, at=place)
        add_frame(model, name, joint, aside)
    return rnc.Robot(model)


def reduced_cart(robot, radii=(0.2, 0.25)):
    wheels = [rnc.RollingWheel(wheel, radius) for wheel, radius in zip(("left", "right"), radii, strict=True)]
    return rnc.NonholonomicSystem(robot, wheels).reduce()


def differential_drive():
    return rnc.Robot.from_urdf("differential_drive.urdf", base="planar")


DRIVE = ("left_wheel", "right_wheel")


class Turning(Rows):
    """Rows (k, nv) of each configuration by a function; nobody asks for their rates."""

    def __init__(self, names, function, mu=None, units=None):
        self.names, self.units = tuple(names), units or ("m/s",) * len(names)
        self.affine, self._function, self._mu = mu is not None, function, mu

    def bind(self, robot):
        return self

    def jacobian(self, at):
        flat = [self._function(q) for q in at.q.reshape(-1, at.q.shape[-1])]
        return np.array(flat, dtype=float).reshape(*at.q.shape[:-1], len(self.names), at.q.shape[-1])

    def jacobian_dot(self, at):
        raise NotImplementedError

    def bias_acceleration(self, at):
        raise NotImplementedError

    def rate(self, at):
        return self._zeros(at) if self._mu is None else self._mu(at.q)


def high_cart():
    """A cart of two axles, one metre apart, with its mass one metre above the ground."""
    model = pin.Model()
    base = add_body(model, "root_joint", "Planar", 10.0, com=(0.0, 0.0, 1.0), moments=0.5)
    for name, x in (("base", 0.0), ("front", 0.5), ("rear", -0.5)):
        add_frame(model, name, base, (x, 0.0, 0.0))
    edges = [rnc.NoSideSlip("front"), rnc.NoSideSlip("rear")]
    system = rnc.NonholonomicSystem(rnc.Robot(model), edges, [rnc.FrameForce("base", "x")])
    return system.reduce([rnc.FrameSpeed("base")])
