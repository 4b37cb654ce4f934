"""Checks of a model before anything is computed with it, and masses that repair impossible inertias."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, argument, check_unique, few, warn
from rnc_pin.printing import significant
from rnc_pin.robots.joint_values import NamedModel
from rnc_pin.robots.sources.description import Body


def check_model(model: pin.Model) -> None:
    """Raise an error if a model cannot be simulated; warn about inertias that no body can have, and moving axes.

    Args:
        model: model of the robot.

    Raises:
        ModelError: no joints or too many, duplicate joint names, interleaved branches, or invalid inertias.
    """
    if model.nv == 0:
        raise ModelError(
            f"robot '{model.name}' has no moving joint: load it with {argument('base', 'planar')}, or 'free'"
        )
    # First: the next checks take time that grows with the square of the joints.
    check_model_size(model)
    check_unique(list(model.names)[1:], f"robot '{model.name}' has two joints named", ModelError)
    _check_order(model)
    check_inertias(model)
    moving = joints_with_moving_axes(model)
    if moving:
        warn(
            f"robot '{model.name}': axes of {few(moving)} depend on the joint's own position. Pinocchio's Jacobian "
            "rates and Coriolis matrix are wrong for such joints, so R_dot, V and A_star_dot are refused. "
            "Accelerations are right. Use joints of one degree of freedom instead"
        )


def flat_links(model: pin.Model) -> list[str]:
    """Links if all bodies have a moment of inertia about one axis only, as files of robots in a plane have them.

    Args:
        model: model of the robot.
    """
    heavy = {joint: np.linalg.eigvalsh(each.inertia) for joint, each in enumerate(model.inertias) if each.mass > 0}
    flat = 1e-9  # part of the largest moment of inertia below which another one is zero
    if not all(most > 0 and middle <= flat * most for _, middle, most in heavy.values()):
        return []
    return [each.name for each in model.frames if each.type == pin.FrameType.BODY and each.parentJoint in heavy]


def joints_with_moving_axes(model: pin.Model) -> list[str]:
    """Joints whose axes are not constant in the body that they move: universal, ZYX and most composite joints.

    Args:
        model: model of the robot.
    """
    # Half a unit away from neutral in every entry, axes that move differ visibly.
    places = pin.neutral(model), pin.integrate(model, pin.neutral(model), np.full(model.nv, 0.5))
    found = []
    for name, joint in zip(model.names, model.joints, strict=True):
        if joint.nv > 1:  # the axis of one degree of freedom is constant
            data = joint.createData(), joint.createData()
            for each, q in zip(data, places, strict=True):
                joint.calc(each, q)
            found += [] if np.allclose(data[0].S, data[1].S) else [name]
    return found


def _check_order(model: pin.Model) -> None:
    """Check that each subtree has consecutive joint indices; Pinocchio's inertia matrix is wrong otherwise."""
    names = list(model.names)
    for joint, behind in enumerate(list(model.subtrees)[1:], start=1):
        for number, other in enumerate(behind, start=joint):
            if number != other:
                raise ModelError(
                    f"robot '{model.name}': joint '{names[number]}' was added between '{names[joint]}' and "
                    f"'{names[other]}' behind it, for which Pinocchio's inertia matrix is wrong; "
                    "add joints branch by branch"
                )


# ---------------------------------------------------------------------- inertias


_DEFAULT_MASS = 0.1  # [kg] suggested for a link without mass and geometry

LARGEST = 256
"""Largest number of degrees of freedom. One evaluation in Pinocchio takes 32 bytes times its cube, 0.5 GB here."""

HEAVIEST = 1e15
"""Largest mass [kg], moment of inertia [kg m^2] and distance [m]. No robot exceeds it, and products stay finite."""


class Massless(NamedTuple):
    """Joint whose body cannot be simulated with the inertia in the file.

    Attributes:
        joint: name of the joint; ``root_joint`` for the base.
        idle: True if it moves no mass, in place of an impossible inertia.
        shaped: links with geometry that the joint moves, without links behind further joints.
        masses: link to mass [kg]. ``Robot.from_urdf`` accepts the file with the masses of all such joints together.
        message: description of the fault in one line.
    """

    joint: str
    idle: bool
    shaped: tuple[str, ...]
    masses: dict[str, float]
    message: str


class UselessInertia(ModelError):
    """Error for a model whose masses do not allow a simulation.

    Attributes:
        what: description of the fault in one line, without a remedy.
        joints: all joints with such bodies.
    """

    def __init__(self, what: str, joints: Sequence[Massless]) -> None:
        self.what, self.joints = what, tuple(joints)
        super().__init__(what)

    def _words(self) -> str:
        masses = {link: mass for each in self.joints for link, mass in each.masses.items()}
        if not masses:
            return f"{self.what}: give the links behind it an inertia"
        several = f"link '{next(iter(masses))}' a mass" if len(masses) == 1 else f"{len(masses)} links masses"
        return f"{self.what}: give {several} with {argument('masses', masses)}"


def check_model_size(model: pin.Model) -> None:
    """Raise an error if a model is too large for the memory.

    Args:
        model: model of the robot.

    Raises:
        ModelError: the model has more than ``LARGEST`` degrees of freedom.
    """
    if model.nv > LARGEST:
        raise ModelError(
            f"robot '{model.name}' has {model.nv} degrees of freedom, limit {LARGEST}: "
            "the memory of an evaluation grows with their cube; make joints fixed in the file"
        )


def check_inertias(model: pin.Model) -> None:
    """Raise an error for inertias that cannot be simulated; warn about inertias that no body can have.

    The literature idealises bodies: a rotor without mass, or a moment larger than the sum of the others. Their
    equations of motion are sound as long as the inertia matrix of the robot is positive definite.

    Args:
        model: model of the robot.

    Raises:
        ModelError: an inertia or mass is not finite.
        UselessInertia: ``massless`` finds a joint.
    """
    found = massless(model, {})
    if found:
        names = [f"'{each.joint}'" for each in found if each.idle]
        several = len(names) == len(found) > 1
        raise UselessInertia(f"joints {few(names)} move no mass" if several else found[0].message, found)
    impossible, weightless = [], []
    triangle_tolerance = 1e-3  # relative to the largest principal moment: values in files are rounded
    for name, inertia in zip(list(model.names)[1:], list(model.inertias)[1:], strict=True):
        moments = np.linalg.eigvalsh(inertia.inertia)
        # A warning only: the equations of motion need positive moments, not the triangle inequality.
        if moments[2] > moments[0] + moments[1] + triangle_tolerance * moments[2]:
            impossible.append(name)
        if inertia.mass == 0 and moments.any():
            weightless.append(name)
    unreal = "impossible rotational inertia behind {}: the largest principal moment exceeds the sum of the others"
    rotors = "rotational inertia but zero mass behind {}: such bodies are idealised, so check the file"
    for names, fault in ((impossible, unreal), (weightless, rotors)):
        if names:
            warn(f"robot '{model.name}': {fault.format(few(names))}")


def massless(model: pin.Model, bodies: Mapping[str, Body]) -> tuple[Massless, ...]:
    """Return the joints of a model whose bodies cannot be simulated, and the masses that repair them.

    Args:
        model: not changed.
        bodies: bodies of its links, as far as known.

    Raises:
        ModelError: an inertia or mass is not finite, or a placement is too far away.
    """
    _check_places(model)
    # A copy: bodies are mended on the way, so that the search finds those behind them too.
    model = model.copy()
    found = [each for joint in range(1, model.njoints) for each in _body(model, joint, bodies)]
    for each in found:
        _mend(model, each)
    data = model.createData()
    # A joint may move mass at the neutral configuration and none at others: three random ones, with a fixed seed,
    # decide.
    generator = np.random.default_rng(0)
    for step in generator.uniform(-np.pi, np.pi, (3, model.nv)):
        q = pin.integrate(model, pin.neutral(model), step)
        # Each mended body makes the matrix positive along one more motion, so nv rounds suffice.
        for _ in range(model.nv):
            velocity = _free_of_mass(pin.crba(model, data, q))
            if velocity is None:
                break
            found.append(_behind(model, data, q, velocity, bodies))
            _mend(model, found[-1])
    return tuple(found)


def _check_places(model: pin.Model) -> None:
    places = [*zip(model.names, model.jointPlacements, strict=True), *((f.name, f.placement) for f in model.frames)]
    for name, place in places:
        farthest = float(np.abs(place.translation).max())
        if not (farthest <= HEAVIEST and np.isfinite(place.rotation).all()):
            raise ModelError(f"placement of '{name}' is {farthest:g} m from its parent, limit {HEAVIEST:g} m")


def _body(model: pin.Model, joint: int, bodies: Mapping[str, Body]) -> list[Massless]:
    """Fault of the single body that a joint carries; empty if there is none."""
    name, inertia = model.names[joint], model.inertias[joint]
    tensor = inertia.inertia
    if not (np.isfinite(inertia.mass) and np.isfinite(tensor).all() and np.isfinite(inertia.lever).all()):
        raise ModelError(f"inertia behind joint '{name}' is not finite")
    largest = max(abs(inertia.mass), float(np.abs(tensor).max()), float(np.abs(inertia.lever).max()))
    if largest > HEAVIEST:
        raise ModelError(f"inertia behind joint '{name}' contains {largest:g}, limit {HEAVIEST:g} [kg, m]")
    # Zero is no fault of a body alone: others may move with it.
    if inertia.mass < 0:
        message = f"mass behind joint '{name}' is negative: {inertia.mass:g} kg"
        return [_massless(model, joint, message, bodies, lambda body: body.mass < 0)]
    if not _is_positive(tensor):
        message = f"rotational inertia behind joint '{name}' is not positive"
        return [_massless(model, joint, message, bodies, lambda body: not _is_positive(body.inertia))]
    return []


def _is_positive(tensor: np.ndarray) -> bool:
    # A thin body has a principal moment of zero, which rounding makes slightly negative.
    return bool(np.linalg.eigvalsh(tensor)[0] >= -1e-9 * max(1.0, float(np.trace(tensor))))


def _massless(
    model: pin.Model,
    joint: int,
    message: str,
    bodies: Mapping[str, Body],
    is_wrong: Callable[[Body], bool] | None = None,
    idle: bool = False,
) -> Massless:
    """Fault of a joint. ``is_wrong`` tells whether a link itself has the fault of the body to which it belongs."""
    known = [link for link in NamedModel(model).links_of(joint) if link in bodies]
    shaped = tuple(link for link in known if bodies[link].shaped)
    wrong = [] if is_wrong is None else [link for link in known if is_wrong(bodies[link])]
    # One mass repairs the body: of a faulty link, else of one with geometry, which has a plausible size.
    masses = {link: _mass(bodies[link]) for link in wrong or shaped[:1] or known[:1]}
    return Massless(model.names[joint], idle, shaped, masses, message)


def _mass(body: Body) -> float:
    if body.mass > 0:
        return body.mass
    least_mass = 0.01  # [kg], for a link with tiny geometry
    return max(mass_of_box(body.volume()), least_mass) if body.shaped else _DEFAULT_MASS


def mass_of_box(volume: float) -> float:
    """Suggested mass [kg] of a body that fills a box of this volume [m^3].

    Args:
        volume: volume of the box around the geometry [m^3].
    """
    density = 300.0  # [kg/m^3] of the box around a link's geometry: robots are hollow
    return significant(density * volume)


def _mend(model: pin.Model, each: Massless) -> None:
    """Give a body the inertia that the remedy gives it."""
    index = model.getJointId(each.joint)
    mass = sum(each.masses.values()) or _DEFAULT_MASS
    inertia_per_mass = 1e-3  # [m^2], as of a ball of 5 cm radius: 0.4 r^2
    model.inertias[index] = pin.Inertia(mass, np.zeros(3), mass * inertia_per_mass * np.eye(3))


def _free_of_mass(inertia_matrix: np.ndarray) -> np.ndarray | None:
    """Return a velocity (nv,) of zero kinetic energy, of one entry if possible; None if there is none."""
    diagonal = np.sqrt(np.maximum(np.diag(inertia_matrix), 0.0))
    if not diagonal.all():
        return np.eye(len(diagonal))[np.argmin(diagonal)]
    # With a unit diagonal, eigenvalues compare motions of a finger and of a base: units and sizes cancel.
    values, vectors = np.linalg.eigh(inertia_matrix / (diagonal[:, None] * diagonal))
    least_eigenvalue = 1e-12  # of the matrix with a unit diagonal: a robot's is many orders larger, rounding smaller
    return None if values[0] >= least_eigenvalue else vectors[:, 0] / diagonal


def _behind(
    model: pin.Model, data: pin.Data, q: np.ndarray, velocity: np.ndarray, bodies: Mapping[str, Body]
) -> Massless:
    """Fault at the first body that moves in a motion of zero kinetic energy; an inertia of this body repairs it."""
    # The first body that moves in the motion carries no mass along it, nor do the bodies behind.
    # At unit size: a motion without mass is divided by small roots of inertias, and its speeds could overflow.
    pin.forwardKinematics(model, data, q, velocity / np.abs(velocity).max())
    speeds = [float(np.linalg.norm(data.v[joint].vector)) for joint in range(model.njoints)]
    moving = (index for index, speed in enumerate(speeds) if speed > 1e-6 * max(speeds))
    joint = next(moving, 1)  # no joint if placements are so large that speeds are not finite
    name = NamedModel(model).velocity_names[int(np.argmax(np.abs(velocity)))]
    idle = np.count_nonzero(velocity) == 1
    singular = f"inertia matrix is singular: joint '{name}' can move without moving mass"
    return _massless(model, joint, f"joint '{name}' moves no mass" if idle else singular, bodies, idle=idle)
