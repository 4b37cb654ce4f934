"""Planar cars, body by body, in NumPy: neither rnc_pin nor Pinocchio."""

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import rnc_pin as rnc
from bodies import add_body


def at(x, y=0.0, z=0.0):
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def yawing(mass, inertia, x=0.0, y=0.0):
    """A body of which only mass, centre and yaw inertia matter: it moves in the plane."""
    return pin.Inertia(mass, np.array([x, y, 0.0]), inertia * np.eye(3))


def integrated(rate, start, times):
    """An ordinary differential equation from ``times[0]`` on, as well as double precision lets it: (times, size)."""
    ends = (times[0], times[-1])
    return solve_ivp(rate, ends, start, "DOP853", times, rtol=1e-13, atol=1e-13).y.T


def directions(angle):
    """Unit vectors along and across."""
    return np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])


TRACK, RADIUS = 1.4, 0.3  # distance of the wheels of an axle, radius of each [m]
CHASSIS, CHASSIS_YAW, CENTRE = 90.0, 40.0, (0.9, 0.05)  # mass, yaw inertia about its centre of mass, where that is
KNUCKLE, KNUCKLE_YAW = 4.0, 0.15  # what steers with a wheel
WHEEL, WHEEL_YAW, WHEEL_SPIN = 7.0, 0.2, 0.35  # about a diameter, and about the axle


@dataclass(frozen=True, eq=False)
class Car:
    """A planar car in its own axes: x ahead, y to the left, the origin on the line of turning centres.

    Without slip every wheel's axle points to one centre (0, 1/k), k the curvature. So the wheel at (x, y) is steered by
    ``atan2(k x, 1 - k y)`` and goes ``hypot(k x, 1 - k y)`` metres while the origin goes one (Ackermann).

    Attributes:
        wheels: where each wheel is, by name, in the order of the joints.
        steered: those of them that are.
        pairs: wheels that have to agree upon a turning centre.
    """

    wheels: dict
    steered: tuple
    pairs: tuple

    @cached_property
    def joints(self):
        """Joints behind the base by name, each a column of v; in front are (u, side slip, w) of the origin.

        Depth first, as Pinocchio's algorithms take joints: a wheel's steering before its spin.
        """
        kinds = {name: ("steer", "spin") if name in self.steered else ("spin",) for name in self.wheels}
        return {f"{name}_{kind}": 3 + i for i, (name, kind) in enumerate((n, k) for n in kinds for k in kinds[n])}

    @property
    def size(self):
        return 3 + len(self.joints)

    def steer(self, wheel):
        return self.joints[f"{wheel}_steer"]

    def spin(self, wheel):
        return self.joints[f"{wheel}_spin"]

    def robot(self):
        model = pin.Model()
        model.name = "car"
        base = add_body(model, "root_joint", "Planar", yawing(CHASSIS, CHASSIS_YAW, *CENTRE), frame="chassis")
        for name, (x, y) in self.wheels.items():
            carrier, place = base, at(x, y, RADIUS)
            if name in self.steered:
                carrier, place = (
                    add_body(model, f"{name}_steer", "RZ", yawing(KNUCKLE, KNUCKLE_YAW), base, at=place),
                    None,
                )
            spin = (WHEEL_YAW, WHEEL_SPIN, WHEEL_YAW)
            add_body(model, f"{name}_spin", "RY", WHEEL, carrier, moments=spin, at=place, frame=name)
        return rnc.Robot(model)

    # ------------------------------------------------------------------ agreement upon a turning centre

    def coupling(self, q):
        """Residuals (pairs,), gradients (pairs, size) and second derivatives (pairs, size, size).

        A wheel's centre is at curvature k with ``x cot(d) = 1/k - y``. Two of them agree if
        ``x1 cot(d1) + y1 = x2 cot(d2) + y2``; times ``sin(d1) sin(d2)`` that is

            x1 cos(d1) sin(d2) - x2 sin(d1) cos(d2) + (y1 - y2) sin(d1) sin(d2) = 0,

        regular at zero. For the wheels of one axle: ``wheelbase sin(d2 - d1) + track sin(d1) sin(d2) = 0``.
        """
        angles = q[1:]  # (x, y, cos, sin) of the base: one entry more than v has
        sizes = (len(self.pairs), self.size)
        residual, gradient, second = np.zeros(sizes[0]), np.zeros(sizes), np.zeros((*sizes, self.size))
        for k, pair in enumerate(self.pairs):
            (x1, y1), (x2, y2) = (self.wheels[name] for name in pair)
            i, j = (self.steer(name) for name in pair)
            (c1, s1), (c2, s2) = ((np.cos(angles[n]), np.sin(angles[n])) for n in (i, j))
            apart = y1 - y2
            residual[k] = x1 * c1 * s2 - x2 * s1 * c2 + apart * s1 * s2
            gradient[k, i] = -x1 * s1 * s2 - x2 * c1 * c2 + apart * c1 * s2
            gradient[k, j] = x1 * c1 * c2 + x2 * s1 * s2 + apart * s1 * c2
            second[k, i, i] = second[k, j, j] = -residual[k]
            second[k, i, j] = second[k, j, i] = -x1 * s1 * c2 + x2 * c1 * s2 + apart * c1 * c2
        return residual, gradient, second

    def agreement(self):
        """The coupling as a constraint of rnc_pin."""
        return rnc.Pfaffian(
            lambda q: self.coupling(q)[1],
            lambda q, v: self.coupling(q)[2] @ v,
            [f"ackermann({a},{b})" for a, b in self.pairs],
            residual=lambda q: self.coupling(q)[0],
        )

    @cache  # noqa: B019
    def reduce(self, order):
        """In the speed of the origin and the rate of the first steering joint, wheels listed in some order."""
        wheels = [rnc.RollingWheel(name, RADIUS) for name in order]
        system = rnc.NonholonomicSystem(self.robot(), [self.agreement(), *wheels], self.actuators)
        return system.reduce([rnc.FrameSpeed("chassis"), rnc.JointPosition(f"{self.steered[0]}_steer")])

    @property
    def actuators(self):
        return [f"{self.steered[0]}_steer", "bl_spin", "br_spin"]

    def force(self, T):
        """Generalized forces (size,) of the actuators."""
        force = np.zeros(self.size)
        force[[self.steer(self.steered[0]), self.spin("bl"), self.spin("br")]] = T
        return force

    # ------------------------------------------------------------------ kinematics from the turning centre

    def q(self, pose, curvature, spins):
        x, y, heading = pose
        q = np.concatenate([[x, y, np.cos(heading), np.sin(heading)], np.zeros(len(self.joints))])
        for (name, (ahead, aside)), spin in zip(self.wheels.items(), spins, strict=True):
            q[1 + self.spin(name)] = spin
            if name in self.steered:
                q[1 + self.steer(name)] = np.arctan2(curvature * ahead, 1 - curvature * aside)
        return q

    def basis(self, curvature, curvature_rate=0.0):
        """Velocities per (u, curvature rate) and the rate of that, both (size, 2); never singular."""
        R, R_dot = np.zeros((self.size, 2)), np.zeros((self.size, 2))
        R[0, 0] = 1.0
        R[2, 0], R_dot[2, 0] = curvature, curvature_rate
        for name, (x, y) in self.wheels.items():
            way = np.hypot(curvature * x, 1 - curvature * y)  # of the wheel, for a metre of the origin
            slope = (curvature * x**2 - (1 - curvature * y) * y) / way
            R[self.spin(name), 0], R_dot[self.spin(name), 0] = way / RADIUS, slope * curvature_rate / RADIUS
            if name in self.steered:
                R[self.steer(name), 1] = x / way**2
                R_dot[self.steer(name), 1] = -2 * x / way**3 * slope * curvature_rate
        return R, R_dot

    def own_rates(self, curvature, v2):
        """(u, curvature rate) from (u, first steering rate)."""
        return np.array([v2[0], v2[1] / self.basis(curvature)[0][3, 1]])

    # ------------------------------------------------------------------ dynamics, body by body

    @cache  # noqa: B019
    def inertia(self):
        """Mass matrix in the car's own axes, constant, and the matrix S of ``w S v``, the forces of turning axes.

        A point (x, y) of the car moves with P v and is accelerated by ``P vdot + w K P v``, K a quarter turn. Steering
        axes meet the wheels' centres, and a wheel's inertia about a diameter is the same for each: so steering and
        spinning move no mass, and gyroscopic moments are about horizontal axes, where the ground answers.
        """
        M, S = np.zeros((2, self.size, self.size))
        quarter = np.array([[0.0, -1.0], [1.0, 0.0]])

        def add(mass, yaw, where, turning=2, spin=None):
            P, yaw_row = np.zeros((2, self.size)), np.zeros(self.size)
            P[:, :3] = [[1, 0, -where[1]], [0, 1, where[0]]]
            yaw_row[[2, turning]] = 1.0
            M[...] += mass * P.T @ P + yaw * np.outer(yaw_row, yaw_row)
            S[...] += mass * P.T @ quarter @ P
            if spin is not None:
                M[spin, spin] += WHEEL_SPIN

        add(CHASSIS, CHASSIS_YAW, CENTRE)
        for name, where in self.wheels.items():
            turning = self.steer(name) if name in self.steered else 2
            add(WHEEL, WHEEL_YAW, where, turning, self.spin(name))
            if name in self.steered:
                add(KNUCKLE, KNUCKLE_YAW, where, turning)
        return M, S

    def rows(self, q, v):
        """All constraint rows (wheels twice and pairs, size) and their rate times v, by hand.

        A wheel's centre moves with (u - w y, slip + w x) in the car's axes: along its heading by spin times radius,
        across not at all. Of the four lateral rows two are dependent if the pairs agree, and only then.
        """
        (u, slip, w), rows, bias_acceleration = v[:3], [], []
        for name, (x, y) in self.wheels.items():
            angle = q[1 + self.steer(name)] if name in self.steered else 0.0
            rate = v[self.steer(name)] if name in self.steered else 0.0
            along, across = directions(angle)
            P = np.zeros((2, self.size))
            P[:, :3] = [[1, 0, -y], [0, 1, x]]
            centre = np.array([u - w * y, slip + w * x])
            rolling = along @ P
            rolling[self.spin(name)] = -RADIUS
            rows += [rolling, across @ P]
            bias_acceleration += [rate * across @ centre, -rate * along @ centre]
        _, gradient, second = self.coupling(q)
        return np.vstack([*rows, gradient]), np.concatenate([bias_acceleration, second @ v @ v])

    def acceleration(self, q, v, T):
        """KKT, ``[M A'; A 0] [vdot; lambda] = [B T - w S v; -Adot v]``: all rows, the smallest multipliers."""
        M, S = self.inertia()
        A, bias_acceleration = self.rows(q, v)
        m = len(A)
        kkt = np.block([[M, A.T], [A, np.zeros((m, m))]])
        right = np.concatenate([self.force(T) - v[2] * S @ v, -bias_acceleration])
        return np.linalg.lstsq(kkt, right, rcond=1e-11)[0][: self.size]

    def motion(self, y, times):
        """Free motion (q, v) from (x, y, heading, curvature, spins, u, curvature rate), in these coordinates."""
        M, S = self.inertia()
        spins = [self.spin(name) for name in self.wheels]

        def rate(t, y):
            heading, curvature, own = y[2], y[3], y[-2:]
            R, R_dot = self.basis(curvature, own[1])
            v = R @ own
            own_dot = np.linalg.solve(R.T @ M @ R, -R.T @ (M @ R_dot @ own + v[2] * S @ v))
            place = own[0] * directions(heading)[0]
            return np.concatenate([place, [v[2], own[1]], v[spins], own_dot])

        states = integrated(rate, y, times)
        q = np.stack([self.q(y[:3], y[3], y[4:-2]) for y in states])
        v = np.stack([self.basis(y[3])[0] @ y[-2:] for y in states])
        return states, q, v


HALF = TRACK / 2
ACKERMANN = Car(
    {"fl": (2.1, HALF), "fr": (2.1, -HALF), "bl": (0.0, HALF), "br": (0.0, -HALF)}, ("fl", "fr"), (("fl", "fr"),)
)
# The turning centre is abeam of a point between the axles, not midway: the rear wheels turn less than the front ones.
FOUR_STEERED = Car(
    {"fl": (1.2, HALF), "fr": (1.2, -HALF), "bl": (-0.8, HALF), "br": (-0.8, -HALF)},
    ("fl", "fr", "bl", "br"),
    (("fl", "fr"), ("bl", "br"), ("fl", "bl")),
)
