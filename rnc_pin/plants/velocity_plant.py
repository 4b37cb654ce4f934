"""Plant with ideal velocity servos."""

from __future__ import annotations

import numpy as np

from rnc_pin.control.actuator_velocity import check_velocity_actuation, velocity_from_actuators
from rnc_pin.errors import DivergenceError, InputError, SingularityError
from rnc_pin.model.input_validation import is_count, is_number, own_vector
from rnc_pin.model.integrators import LieRungeKutta4
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plants.plant import PlantReport


class VelocityPlant:
    """Plant whose actuators follow velocity commands u with a first-order lag, ``w_dot = (u - w) / servo_time``.

    w has the velocities of the actuators, ``B^T v``. The lag is exact, and the plant satisfies its constraints exactly:
    a fourth-order Lie-group integrator moves the configuration, and a projection removes the drift of holonomic rows.
    The servos have no effort limits.

    Args:
        reduced: reduced model.
        servo_time: time constant of the servos [s].
        substeps: integration steps per call of ``advance``.

    Attributes:
        takes_velocities: True; its inputs are velocities.
        applied: applied velocities u (p,).

    Raises:
        ConfigurationError: the actuators do not determine the motion.
        InputError: servo_time or substeps is not positive.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"])
        >>> plant = rnc.plants.VelocityPlant(system.reduce(), servo_time=0.05)
        >>> plant.reset(robot.configuration(), np.zeros(5))
        >>> plant.apply(np.array([8.0, 8.0]))
        >>> plant.advance(0.05)
        >>> plant.read()[1][0].round(4)  # 0.8 m/s (1 - 1/e)
        np.float64(0.5057)
    """

    takes_velocities = True

    def __init__(self, reduced: ReducedModel, servo_time: float = 0.01, substeps: int = 1) -> None:
        if not (is_number(servo_time) and servo_time > 0):
            raise InputError(f"servo_time of a VelocityPlant has to be a positive number, found {servo_time!r}")
        if not is_count(substeps, 1):
            raise InputError(f"substeps of a VelocityPlant have to be a positive integer, found {substeps!r}")
        # Before any motion: wheels that leave a direction free would let the robot drift.
        check_velocity_actuation(reduced)
        self.reduced, self.servo_time, self.substeps = reduced, servo_time, substeps
        self._integrator = LieRungeKutta4(reduced.robot)
        self.applied = np.zeros(reduced.p)
        self._q: np.ndarray
        self._w: np.ndarray

    def reset(self, q: np.ndarray, v: np.ndarray) -> None:
        """Restart with zero commands at configuration q (nq,) and velocity v (nv,).

        Args:
            q: configuration.
            v: velocity; its part along the actuators counts.
        """
        self._q, self._w = np.array(q, dtype=float), self.reduced.at(q).B.T @ v
        self.applied = np.zeros(self.reduced.p)

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Return configuration (nq,) and velocity (nv,)."""
        return self._q.copy(), self._velocity(self._q, self._w)

    def apply(self, u: np.ndarray) -> None:
        """Hold the velocity commands u (p,) until the next call.

        Args:
            u: velocities of the actuators [m/s or rad/s].
        """
        self.applied = own_vector(u, self.reduced.p, "u")

    @property
    def effort(self) -> np.ndarray:
        """Efforts (p,) of the actuators [N or N m] that give the present acceleration.

        NaN where outputs are singular or the state is not finite, and if B is a function without a rate.
        """
        try:
            q, v = self.read()
            state = self.reduced.at(q, v=v)
            B_rate = self.reduced.actuation.matrix_rate(state.motion)
            if B_rate is None:
                return np.full(self.reduced.p, np.nan)
            # The lag gives the acceleration of the actuators; the efforts that it takes follow from the model.
            w_dot = (self.applied - self._w) / self.servo_time
            known = state.B.T @ state.v_dot(np.zeros(self.reduced.r)) + B_rate.T @ v
            # Least squares: there may be more actuators than velocities.
            v2_dot = np.linalg.lstsq(state.B.T @ state.R, w_dot - known, rcond=None)[0]
            return state.allocate(state.inverse_dynamics(v2_dot))
        except (DivergenceError, SingularityError):
            return np.full(self.reduced.p, np.nan)

    def report(self) -> PlantReport:
        """Return the model, the velocities that are applied, and the efforts."""
        return PlantReport(applied=self.applied, reduced=self.reduced, effort=self.effort)

    def advance(self, dt: float) -> None:
        """Advance the time by dt [s].

        Args:
            dt: the time [s].

        Raises:
            DivergenceError: the configuration is not finite.
        """
        q, w = self._q, self._w
        elapsed, pace = np.zeros(1), np.ones(1)

        def rate(q: np.ndarray, elapsed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return self._velocity(q, self._lagged(w, elapsed[0])), pace

        for h in np.diff(self._instants(dt)):
            q, elapsed = self._integrator.step(rate, q, elapsed, h)
        # In closed form over the whole time: substeps only integrate the configuration.
        w = self._lagged(w, dt)
        if not np.isfinite(q).all():
            raise DivergenceError("plant configuration is not finite")
        self._q, self._w = self.reduced.assembly.project(q) if self.reduced.assembly.size else q, w

    def _instants(self, dt: float) -> np.ndarray:
        """Ends of the integration steps; they are short while velocities change."""
        instants = np.linspace(0.0, dt, self.substeps + 1)
        settled = 20.0  # time constants: exp(-20) is 2e-9 of the change
        if self.servo_time < dt / self.substeps:
            # Steps of one time constant follow the exponential; later the velocity is constant.
            changing = np.arange(self.servo_time, min(dt, settled * self.servo_time), self.servo_time)
            instants = np.union1d(instants, changing)
        return instants

    def _lagged(self, w: np.ndarray, elapsed: float) -> np.ndarray:
        """Actuator velocities (p,) at a time after w."""
        share = np.exp(-elapsed / self.servo_time)
        return share * w + (1.0 - share) * self.applied

    def _velocity(self, q: np.ndarray, w: np.ndarray) -> np.ndarray:
        """Velocity (nv,) of the robot with actuator velocities w."""
        if not np.isfinite(q).all():
            raise DivergenceError("plant configuration is not finite")
        return velocity_from_actuators(self.reduced.at(q), w)
