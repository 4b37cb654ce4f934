"""MuJoCo as the plant, and the mapping of actuator inputs to its forces.

An actuator of a joint acts on that joint. A force or torque on a frame of a wheeled vehicle models the effect of its
wheels. It becomes the smallest wheel torques with the same effect on the admissible motion,
``R^T B_wheels tau = R^T B T`` at the current configuration. Only wheels that have no actuator take part: first those
on the body of the frame, then all. If no wheels can produce an input, it acts on the frame itself; an example is a
torque that turns a single wheel about the vertical.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import DivergenceError
from rnc_pin.lab.mujoco import contact_bodies
from rnc_pin.lab.mujoco.body_tree import BodyTree, JointEquality, RobotCoordinates, add_equalities, mujoco
from rnc_pin.lab.mujoco.contact_bodies import ContactBody, MuJoCoSettings
from rnc_pin.lab.mujoco.ground import Ground, add_ground
from rnc_pin.math.linear_algebra import null_space
from rnc_pin.model.input_validation import own_vector
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plants.plant import PlantReport
from rnc_pin.robots.robot import Robot
from rnc_pin.robots.sources.description import unlogged


class MuJoCoPlant:
    """Robot of a reduced model in MuJoCo: a ``Plant``.

    The MuJoCo model is built from the loaded robot. Joint names match. Conservation of momentum is not imposed; it
    follows from the dynamics. Forces from ``rnc_pin.forces`` act at every step. Wheels drive by friction. For a vehicle
    whose model is planar only x, y and heading are read; see ``MuJoCoSettings.stance``. Constraints become these
    contacts:

    * ``RollingWheel``: a disk on the ground.
    * ``RollingBall``: a ball.
    * ``Caster``: a frictionless ball.
    * ``NoSideSlip``: the wheels that are drawn on its axle, or a blade if there are none. The wheels roll freely unless
      a force on their body drives them.

    Args:
        reduced: model with the robot, constraints and actuators.
        settings: settings of MuJoCo.
        q0: configuration (nq,) for the choice of the stance and of the wheels that replace forces on frames; neutral
            by default.

    Attributes:
        model, data: MuJoCo's model and data.
        stance: "free", "level", or "as it is" if the base of the robot already has the required degrees of freedom.
        wheel_names: contacts with friction, (w,).
        casters: names of the added supports.
        wheel_driven: actuators whose inputs become wheel torques.
        applied: applied inputs (p,), after clipping.

    Raises:
        ConfigurationError: a joint or constraint has no equivalent in MuJoCo, or no weight presses a wheel on the
            ground.

    Example:
        >>> from rnc_pin.lab.mujoco import MuJoCoPlant
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"])
        >>> plant = MuJoCoPlant(system.reduce())
        >>> plant.reset(robot.configuration(), np.zeros(5))
        >>> plant.apply(np.array([0.5, 0.5]))
        >>> plant.advance(1.0)
        >>> bool(plant.read()[0][0] > 0.1), plant.stance, len(plant.casters)
        (True, 'free', 2)
    """

    def __init__(
        self, reduced: ReducedModel, settings: MuJoCoSettings | None = None, q0: np.ndarray | None = None
    ) -> None:
        self.settings = settings or MuJoCoSettings()
        self._reduced = reduced
        robot, blocks = reduced.robot, [place.block for place in reduced.all_constraints.places]
        q = robot.configuration() if q0 is None else np.asarray(q0, dtype=float)
        ground, plane = 0.0, contact_bodies.common_plane(blocks)
        contacts = contact_bodies.contact_bodies(robot, blocks)
        if contacts:
            contacts, ground = contact_bodies.on_one_plane(robot, contacts, q, plane)
        self.stance, casters = contact_bodies.choose_support(robot, contacts, ground, q, self.settings, plane)
        self._lift = -ground
        spec = mujoco.MjSpec()
        tree = BodyTree(spec, robot, self.stance, self.settings.joint_limits)
        add_ground(spec, tree, [*contacts, *casters], self.settings, plane)
        couplers = add_equalities(spec, tree, blocks, self.settings.step)
        self._set_options(spec.option)
        self._inputs = ActuatorMapping(reduced, contacts, q, plane.axes[2])
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        tree.finish(self.model, self.data, self.settings.joint_damping)
        self._joints = RobotCoordinates(tree)
        self._equalities = [JointEquality(self.model, name, coupler) for name, coupler in couplers]
        self._ground = Ground(self.model, self.data, [*contacts, *casters], self.settings, plane)
        self.wheel_names = self._ground.names
        self.casters = tuple(each.name for each in casters)
        self.wheel_driven = self._inputs.wheel_driven
        self._limits = reduced.actuation.limits
        self.applied = np.zeros(reduced.p)

    def _set_options(self, option: mujoco.MjOption) -> None:
        option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{self.settings.integrator.upper()}")
        option.solver, option.cone = mujoco.mjtSolver.mjSOL_NEWTON, mujoco.mjtCone.mjCONE_ELLIPTIC
        iterations, tolerance = 50, 1e-12  # of the solver of contact forces
        option.iterations, option.tolerance, option.timestep = iterations, tolerance, self.settings.step
        # A diverged run ends with an error, and does not start anew unnoticed.
        option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET

    # ------------------------------------------------------------------ plant

    def reset(self, q: Float[Array, " nq"], v: Float[Array, " nv"]) -> None:
        """Restart at time zero with zero inputs: settle on the ground at rest, then set velocity v.

        Args:
            q: configuration (nq,).
            v: velocity (nv,).

        Raises:
            DivergenceError: the robot does not come to rest.
        """
        q, v = own_vector(q, self._reduced.robot.nq, "q"), own_vector(v, self._reduced.robot.nv, "v")
        mujoco.mj_resetData(self.model, self.data)
        self.applied = np.zeros(self._reduced.p)
        if self.stance == "free":
            self.data.qpos[2] += self._lift
        elif self.stance == "level":
            self.data.qpos[self.model.joint(f"{self._reduced.robot.joint_names[0]}/z").qposadr[0]] = self._lift
        # At rest first: contacts that come to their load in motion would push the robot off its path.
        self._joints.write(q, np.zeros_like(v), self.data.qpos, self.data.qvel)
        for equality in self._equalities:
            equality.set(self.model, self.data.qpos, fresh=True)
        self._ground.reset()
        if self.stance in ("free", "level"):
            self._settle(q)
        self._joints.write(q, v, self.data.qpos, self.data.qvel)
        self.data.time = 0.0
        mujoco.mj_forward(self.model, self.data)

    def read(self) -> tuple[Float[Array, " nq"], Float[Array, " nv"]]:
        return self._joints.read(self.data.qpos, self.data.qvel)

    def apply(self, T: Float[Array, " p"]) -> None:
        """Hold the inputs T (p,) until the next call, clipped if the settings ask for it.

        Args:
            T: actuator inputs (p,) [N or N m].

        Raises:
            InputError: T is not p finite numbers.
        """
        T = own_vector(T, self._reduced.p, "T")
        self.applied = np.clip(T, -self._limits, self._limits) if self.settings.effort_limits else T

    def advance(self, dt: float) -> None:
        """Advance the time by dt [s].

        Args:
            dt: the time [s]; the step of MuJoCo is shortened so that it divides it.

        Raises:
            DivergenceError: the state is not finite.
        """
        self._ground.slid[:] = 0.0
        rounding = 1e-9  # of the number of steps
        # Without the tolerance, four steps in a sample could become five by rounding.
        steps = max(1, int(np.ceil(dt / self.settings.step - rounding)))
        self.model.opt.timestep = dt / steps
        q, _ = self.read()
        wheel_force, drawn = self._inputs.wheel_forces(q, self.applied)
        drive_forces = np.array([drawn.get(name, 0.0) for name in self.wheel_names])
        # Torques of wheels are held over a sample, as those of motors are; a force on a frame turns with it.
        force = wheel_force if self._inputs.varies else wheel_force + self._inputs.joint_forces(q, self.applied)
        with unlogged(mujoco):
            for _ in range(steps):
                if self._inputs.varies:
                    force = wheel_force + self._inputs.joint_forces(self.read()[0], self.applied)
                self._step(force, drive_forces)

    def _step(self, force: np.ndarray, drive_forces: np.ndarray) -> None:
        self.data.qfrc_applied[:] = 0.0
        if self._reduced.reduction_data.forces:
            q, v = self.read()
            force = force + self._reduced.at(q, v=v).passive_force
        self._joints.add_force(self.data.qpos, force, self.data.qfrc_applied)
        self._ground.prepare(drive_forces)
        for equality in self._equalities:
            equality.set(self.model, self.data.qpos, fresh=False)
        mujoco.mj_step(self.model, self.data)
        if not np.isfinite(self.data.qvel).all():
            raise DivergenceError(
                "velocity in MuJoCo is not finite; reduce the step or the inputs", time=float(self.data.time)
            )

    # ------------------------------------------------------------------ rest

    def _settle(self, q: np.ndarray) -> None:
        """Simulate at fixed pose and joints until the contacts carry the weight."""
        # The last run may have ended with a step of another length.
        self.model.opt.timestep = self.settings.step
        rest, joints = np.zeros(self._reduced.robot.nv), slice(6 if self.stance == "free" else 4, None)
        with unlogged(mujoco):
            for _ in range(round(self.settings.settling / self.settings.step)):
                mujoco.mj_fwdPosition(self.model, self.data)
                mujoco.mj_fwdVelocity(self.model, self.data)
                # Gravity and the like of the joints are held, so that only the base sinks onto its wheels.
                self.data.qfrc_applied[joints] = self.data.qfrc_bias[joints]
                mujoco.mj_step(self.model, self.data)
                self._joints.write(q, rest, self.data.qpos, self.data.qvel)
        self.data.qfrc_applied[:] = 0.0
        if not np.isfinite(self.data.qpos).all() or not np.isfinite(self.data.qvel).all():
            raise DivergenceError("the state in MuJoCo is not finite after settling on the ground; reduce the step")

    # ------------------------------------------------------------------ for the record

    def report(self) -> PlantReport:
        """Return the applied inputs, and the friction and slip of the wheels."""
        used, slid = (dict(zip(self.wheel_names, x, strict=True)) for x in (self.friction_used(), self.slip_speed()))
        return PlantReport(applied=self.applied, friction_used=used, slip_speed=slid)

    def slip(self) -> Float[Array, " m"]:
        """Return ``A v - mu`` at the current velocity, in the order of ``reduced.constraints.names``."""
        q, v = self.read()
        return self._reduced.at(q, v=v).residual

    def friction_used(self) -> Float[Array, " w"]:
        """Return tangential force over friction limit of each of ``wheel_names``; zero off the ground."""
        return self._ground.used()

    def slip_speed(self) -> Float[Array, " w"]:
        """Return the largest speed at which each of ``wheel_names`` slid in the last ``advance`` [m/s].

        It is inf where a drive force without a wheel was cut to what friction can give.
        """
        self._ground.watch()
        return self._ground.slid.copy()


_RANK_TOLERANCE = 1e-9  # relative singular value below which rows are dependent


@dataclass(frozen=True)
class Drive:
    """Driven wheel: its contact, the index of its joint in v (None for a drawn wheel), and the normal of the ground."""

    contact: ContactBody
    velocity_index: int | None
    up: np.ndarray

    def effect(self, robot: Robot, data: pin.Data) -> np.ndarray:
        """Return the generalized force (nv,) of a unit torque; needs the joint Jacobians in ``data``.

        Args:
            robot: the robot.
            data: Pinocchio data with the joint Jacobians.
        """
        if self.velocity_index is not None:
            return np.eye(robot.nv)[self.velocity_index]
        joint, radius = self.contact.joint, self.contact.radius
        placement = data.oMi[joint]
        _, lowest = self.contact.at(placement, self.up)
        jacobian = pin.getJointJacobian(robot.model, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        moving = jacobian[:3] - pin.skew(lowest - placement.translation) @ jacobian[3:]
        assert self.contact.axle is not None  # balls have no drives
        heading = np.cross(placement.rotation @ self.contact.axle, self.up)
        return np.asarray(heading @ moving / (np.linalg.norm(heading) * radius))


class ActuatorMapping:
    """Actuator inputs as joint forces and wheel torques.

    Args:
        reduced: model with the actuators.
        contacts: ground contacts of the robot.
        q: configuration (nq,) near which wheels must reproduce the inputs of frames.
        up: normal of the ground (3,).

    Attributes:
        wheel_driven: names of the actuators that wheels replace.
    """

    def __init__(self, reduced: ReducedModel, contacts: Sequence[ContactBody], q: np.ndarray, up: np.ndarray) -> None:
        self._robot, self._actuation, self._rows = reduced.robot, reduced.actuation, reduced.constraints
        self._data = self._robot.model.createData()
        self._kinematics = Kinematics(self._robot)
        self._drives = _drives(reduced, contacts, up)
        self._groups = self._assigned(q)
        """Columns of B with the drives that reproduce them."""
        wheeled = [column for columns, _ in self._groups for column in columns]
        self.wheel_driven = tuple(self._actuation.names[column] for column in wheeled)
        self._direct = np.setdiff1d(np.arange(reduced.p), wheeled)
        # The actuators that wheels do not replace act on joints then.
        only_joints = bool(wheeled) and set(wheeled) == self._actuation.configured
        is_fixed = only_joints or self._actuation.constant is not None
        self._constant = self._matrix(q) if is_fixed else None

    def wheel_forces(self, q: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, dict[str, float]]:
        """Return the wheel forces of inputs: generalized forces (nv,), and forces of drawn wheels by name [N].

        Args:
            q: configuration (nq,).
            T: inputs (p,).
        """
        force, drawn = np.zeros(self._robot.nv), defaultdict[str, float](float)
        if not self._groups:
            return force, drawn
        of_inputs, of_drives = self._effects(q)
        for columns, drives in self._groups:
            wanted = of_inputs[:, columns] @ T[columns]
            torques = np.linalg.lstsq(of_drives[:, drives], wanted, rcond=_RANK_TOLERANCE)[0]
            for drive, torque in zip(drives, torques, strict=True):
                wheel = self._drives[drive]
                if wheel.velocity_index is None:
                    drawn[wheel.contact.name] += torque / wheel.contact.radius
                else:
                    force[wheel.velocity_index] += torque
        return force, drawn

    @property
    def varies(self) -> bool:
        """True if ``joint_forces`` depends on the configuration."""
        return self._constant is None

    def joint_forces(self, q: np.ndarray, T: np.ndarray) -> np.ndarray:
        """Return the generalized force (nv,) of the inputs that wheels do not replace.

        Args:
            q: configuration (nq,).
            T: inputs (p,).
        """
        return (self._matrix(q) if self._constant is None else self._constant) @ T[self._direct]

    def _matrix(self, q: np.ndarray) -> np.ndarray:
        return self._actuation.matrix(self._kinematics.position(q))[:, self._direct]

    # ------------------------------------------------------------------ which wheels

    def _effects(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Effects on admissible motion of unit inputs (r, p), and of unit torques of drives (r, k)."""
        at = self._kinematics.position(q)
        # Only the effect on admissible motion counts: the rest of a force is carried by the constraints.
        basis = null_space(self._rows.jacobian(at), _RANK_TOLERANCE).T
        pin.computeJointJacobians(self._robot.model, self._data, q)
        forces = np.column_stack([drive.effect(self._robot, self._data) for drive in self._drives])
        return basis @ self._actuation.matrix(at), basis @ forces

    def _assigned(self, q: np.ndarray) -> list[tuple[list[int], list[int]]]:
        if not self._drives:
            return []
        generator, model = np.random.default_rng(0), self._robot.model
        count = 3  # configurations near q: wheels that reproduce an input at all of them do so on the way
        moved = [0.3 * generator.uniform(-1, 1, self._robot.nv) for _ in range(count - 1)]
        samples = [self._effects(each) for each in (q, *(pin.integrate(model, q, step) for step in moved))]
        groups: dict[tuple[int, ...], list[int]] = {}
        for column, frame, _ in self._actuation.frames:
            body = model.frames[frame].parentJoint
            same = tuple(k for k, drive in enumerate(self._drives) if self._carrying_joint(drive) == body)
            # The own wheels of the body first: a motor on a body drives these.
            for drives in (same, tuple(range(len(self._drives)))):
                if drives and all(_reproduces(each[:, column], other[:, drives]) for each, other in samples):
                    groups.setdefault(drives, []).append(column)
                    break
        return [(columns, list(drives)) for drives, columns in groups.items()]

    def _carrying_joint(self, drive: Drive) -> int:
        """Return the joint of the body that carries a wheel."""
        joint = drive.contact.joint
        return joint if drive.velocity_index is None else int(self._robot.model.parents[joint])


def _reproduces(effect: np.ndarray, wheels: np.ndarray) -> bool:
    missed = effect - wheels @ np.linalg.lstsq(wheels, effect, rcond=_RANK_TOLERANCE)[0]
    tolerance = 1e-6  # relative error below which wheels reproduce the effect of an actuator
    return bool(np.linalg.norm(missed) <= tolerance * np.linalg.norm(effect))


def _drives(reduced: ReducedModel, contacts: Sequence[ContactBody], up: np.ndarray) -> list[Drive]:
    model, found = reduced.robot.model, []
    for contact in contacts:
        if contact.drawn:
            found.append(Drive(contact, None, up))
        elif contact.friction in ("all", "longitudinal") and contact.axle is not None:
            joint = model.joints[contact.joint]
            if joint.nv == 1 and str(model.names[contact.joint]) not in reduced.actuation.names:
                found.append(Drive(contact, joint.idx_v, up))
    return found
