"""Velocity servos in MuJoCo: actuators with a velocity gain, and an integral action against gravity and friction.

A servo drives the joint of its actuator. An actuator on a frame that wheels with joints replace gets servos on these
wheels; their commands are the wheel velocities of the admissible motion. Other actuators on frames get the force of a
servo at every step.

    force = gain (u + z / T_i - w),   z_dot = u - w,   gain = inertia / servo_time

u is the command and w the velocity. The inertia is that of the constrained robot, seen by the joint. z stops at the
effort limit. At the start it holds the robot against gravity, as drives do when their brakes open.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rnc_pin.control.actuator_velocity import check_velocity_actuation, velocity_from_actuators
from rnc_pin.errors import ConfigurationError, few
from rnc_pin.math.linear_algebra import null_space
from rnc_pin.model.configuration_evaluation import ConfigurationEvaluation
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plants.mujoco.actuator_mapping import ActuatorMapping
from rnc_pin.plants.mujoco.engine import mujoco
from rnc_pin.plants.mujoco.settings import MuJoCoSettings

_INTEGRAL_RATIO = 5.0  # integral time over the time constant
_MIN_MOBILITY = 1e-9  # smallest mobility of a driven joint [1/kg, 1/(kg m^2)]
_MAX_STEP_RATIO = {"RK4": 2.5, "Euler": 1.8}  # largest step over the servo's own time constant of explicit integrators
_SUFFIX = "/servo"


class VelocityServos:
    """Servos of all actuators of a robot.

    Args:
        spec: specification that receives an actuator for each driven joint.
        reduced: model with the actuators.
        mapping: mapping of inputs to wheels.
        settings: time constant and effort limits.
        q: configuration (nq,) that defines the gains.

    Attributes:
        joints: names of the joints with servos; the actuators of MuJoCo have the same names with ``/servo``.
        gains: gain of each servo [N m s/rad, N s/m].

    Raises:
        ConfigurationError: the actuators do not determine the motion, or one drives a joint that cannot move.
    """

    def __init__(
        self,
        spec: mujoco.MjSpec,
        reduced: ReducedModel,
        mapping: ActuatorMapping,
        settings: MuJoCoSettings,
        q: np.ndarray,
    ) -> None:
        check_velocity_actuation(reduced)
        assert settings.servo_time is not None
        self._reduced, self._settings = reduced, settings
        at = reduced.at(q)
        matrix, frames = at.B, reduced.actuation.configured
        columns = [k for k in range(reduced.p) if k not in frames and np.count_nonzero(matrix[:, k]) == 1]
        self._wheel_columns = [k for k in mapping.joint_driven if k not in columns]
        self._force_columns = np.array(
            [k for k in range(reduced.p) if k not in {*columns, *self._wheel_columns}], dtype=int
        )
        self._joint_columns = columns
        self._dofs = [int(np.flatnonzero(matrix[:, k])[0]) for k in columns]
        own = {*self._dofs}
        self._dofs += [dof for dof in mapping.wheel_dofs(self._wheel_columns) if dof not in own]
        self.joints = tuple(_joint_name(reduced, dof) for dof in self._dofs)
        directions = np.hstack([np.eye(reduced.n)[:, self._dofs], matrix[:, self._force_columns]])
        names = [*self.joints, *(reduced.actuation.names[k] for k in self._force_columns)]
        gains = _inertias(at, directions, names) / settings.servo_time
        given = reduced.robot.model.upperEffortLimit[self._dofs]
        limits = np.r_[np.where(given > 0, given, np.inf), reduced.actuation.limits[self._force_columns]]
        if not settings.effort_limits:
            limits[:] = np.inf
        count = len(self._dofs)
        self._joints = _Feedback(gains[:count], limits[:count], _INTEGRAL_RATIO * settings.servo_time)
        self._frames = _Feedback(gains[count:], limits[count:], _INTEGRAL_RATIO * settings.servo_time)
        self.gains = self._joints.gains
        for name, gain, limit in zip(self.joints, self.gains, limits[:count], strict=True):
            _add_servo(spec, name, float(gain), float(limit))

    def compiled(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Store the compiled model.

        Raises:
            ConfigurationError: the step is too long for the gains and an explicit integrator.
        """
        self._data = data
        self._controls = np.array([model.actuator(f"{name}{_SUFFIX}").id for name in self.joints], dtype=int)
        self._places = np.array([model.joint(name).dofadr[0] for name in self.joints], dtype=int)
        self._check_step(model, data)

    def _check_step(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        most = _MAX_STEP_RATIO.get(self._settings.integrator)
        if most is None or not len(self._places):
            return
        mujoco.mj_forward(model, data)
        units = np.zeros((len(self._places), model.nv))
        units[np.arange(len(self._places)), self._places] = np.sqrt(self.gains)
        moved = np.zeros_like(units)
        mujoco.mj_solveM(model, data, moved, units)
        fastest = float(np.linalg.eigvalsh(units @ moved.T)[-1])
        if fastest * self._settings.step > most:
            raise ConfigurationError(
                f"MuJoCo: servo_time {self._settings.servo_time:g} s is too short for integrator "
                f"'{self._settings.integrator}' with step {self._settings.step:g} s: use integrator 'implicitfast', or "
                f"a step of at most {0.9 * most / fastest:.2g} s"
            )

    def reset(self, q: np.ndarray) -> None:
        """Restart with zero commands; the integral action holds the robot at rest at a configuration (nq,)."""
        at, model = self._reduced.at(q), self._reduced.robot.model
        basis, chosen = null_space(at.A), [*self._joint_columns, *self._force_columns]
        weight = basis.T @ pin.computeGeneralizedGravity(model, model.createData(), q)
        holding = np.linalg.lstsq(basis.T @ at.B[:, chosen], weight, rcond=None)[0]
        count = len(self._joint_columns)
        self._joints.hold(np.pad(holding[:count], (0, len(self._dofs) - count)))
        self._frames.hold(holding[count:])
        self._targets, self._u = np.zeros(len(self._dofs)), np.zeros(self._reduced.p)

    def command(self, q: np.ndarray, u: np.ndarray) -> None:
        """Set the commands u (p,) at a configuration (nq,)."""
        self._u = u
        v = velocity_from_actuators(self._reduced.at(q), u)
        self._targets = v[self._dofs]

    def forces(self, velocity: np.ndarray | None) -> np.ndarray:
        """Return inputs (p,) of the actuators without joint servos.

        Args:
            velocity: velocities ``B^T v`` (p,) of all actuators; None if every actuator has joint servos.
        """
        T = np.zeros(self._reduced.p)
        if velocity is not None and len(self._force_columns):
            chosen = self._force_columns
            T[chosen] = self._frames.force(self._u[chosen] - velocity[chosen])
        return T

    def write(self, step: float, velocity: np.ndarray | None) -> None:
        """Before a step: write the commands of MuJoCo's actuators, and integrate the velocity errors.

        Args:
            step: time step [s].
            velocity: as for ``forces``.
        """
        self._data.ctrl[self._controls] = self._targets + self._joints.integral
        self._joints.integrate(step, self._targets - self._data.qvel[self._places])
        if velocity is not None and len(self._force_columns):
            self._frames.integrate(step, self._u[self._force_columns] - velocity[self._force_columns])

    @property
    def needs_velocity(self) -> bool:
        """True if ``forces`` and ``write`` need the velocities of the actuators."""
        return bool(len(self._force_columns))

    def effort(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the present efforts (p,) of the actuators; wheels that replace frames give the equivalent ones."""
        at = self._reduced.at(q)
        generalized = np.zeros(self._reduced.n)
        generalized[self._dofs] = self._joints.force(self._targets - v[self._dofs])
        T = self.forces(at.B.T @ v)
        rest = np.setdiff1d(np.arange(self._reduced.p), self._force_columns)
        basis = null_space(at.A) if len(self._wheel_columns) else np.eye(self._reduced.n)
        T[rest] = np.linalg.lstsq(basis.T @ at.B[:, rest], basis.T @ generalized, rcond=None)[0]
        return T


class _Feedback:
    """Proportional and integral action of servos on velocity errors (k,).

    Args:
        gains: gain of each servo.
        limits: largest force of each servo.
        time: integral time [s].
    """

    def __init__(self, gains: np.ndarray, limits: np.ndarray, time: float) -> None:
        self.gains, self._limits, self._time = gains, limits, time
        self._z = np.zeros(len(gains))

    def hold(self, force: np.ndarray) -> None:
        """Restart with a force (k,) of the integral action."""
        self._z = self._time * force / self.gains

    @property
    def integral(self) -> np.ndarray:
        """Integral action as a velocity (k,)."""
        return self._z / self._time

    def force(self, error: np.ndarray) -> np.ndarray:
        """Force (k,) within its limits."""
        return np.clip(self.gains * (error + self.integral), -self._limits, self._limits)

    def integrate(self, step: float, error: np.ndarray) -> None:
        """Integrate the errors over a time step [s], but not into the limits."""
        force = self.gains * (error + self.integral)
        self._z = self._z + step * np.where((np.abs(force) > self._limits) & (force * error > 0), 0.0, error)


def _inertias(at: ConfigurationEvaluation, directions: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Return the inertia of the constrained robot along directions (nv, k)."""
    basis = null_space(at.A)
    along = basis.T @ directions
    mobility = np.vecdot(along.T, np.linalg.solve(basis.T @ at.M @ basis, along).T)
    stuck = [name for name, each in zip(names, mobility, strict=True) if each < _MIN_MOBILITY]
    if stuck:
        raise ConfigurationError(f"MuJoCo: {few(stuck)} cannot move, so a velocity servo has no use there")
    inertias: np.ndarray = 1.0 / mobility
    return inertias


def _joint_name(reduced: ReducedModel, dof: int) -> str:
    """Return the joint with an index in v.

    Raises:
        ConfigurationError: it has several degrees of freedom.
    """
    name = reduced.robot.velocity_names[dof]
    if name in reduced.robot.joint_names:
        return name
    raise ConfigurationError(
        f"MuJoCo: a velocity servo on '{name}' needs a joint of one degree of freedom; use FrameForce and FrameTorque"
    )


def _add_servo(spec: mujoco.MjSpec, joint: str, gain: float, limit: float) -> None:
    servo = spec.add_actuator(name=f"{joint}{_SUFFIX}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint)
    servo.gaintype, servo.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    servo.gainprm[0], servo.biasprm[2] = gain, -gain
    if np.isfinite(limit):
        servo.forcelimited, servo.forcerange = True, [-limit, limit]
