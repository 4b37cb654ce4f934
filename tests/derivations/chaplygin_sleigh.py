"""tests/data/chaplygin_sleigh.json: a knife edge, the centre of mass a distance ahead of it."""

import mpmath as mp
import sympy as sp

from .mechanics import Mechanics, exact

M, INERTIA, A = sp.Integer(2), sp.Rational(1, 2), sp.Rational(3, 10)


def energy(q, qd):
    x, y, theta = q
    centre = sp.Matrix([x + A * sp.cos(theta), y + A * sp.sin(theta)])
    velocity = centre.jacobian(q) * sp.Matrix(qd)
    return M / 2 * velocity.dot(velocity) + INERTIA / 2 * qd[2] ** 2


def sleigh() -> Mechanics:
    def ahead(q):
        return sp.Matrix([[sp.cos(q[2]), sp.sin(q[2]), 0], [0, 0, 1]])

    return Mechanics(
        ["x", "y", "theta"], energy, rows=lambda q, H: sp.Matrix([[-sp.sin(q[2]), sp.cos(q[2]), 0]]),
        inputs=lambda q: ahead(q).T, bases={"S4": ahead},
    )  # fmt: skip


def states(data, count=None):
    """Results of the derivation at the states of the file, in the form of the file."""
    system, found = sleigh(), []
    for state in data["states"][:count]:
        q, T, free = (exact(state[key]) for key in ("q", "T", "qd_free"))
        qd = system.velocity(q, "S4", exact(state["bases"]["S4"]["v"]))
        found.append({**system.full(q, qd, free, T), "bases": {"S4": system.reduced("S4", q, qd, T)}})
    return found


def trajectory(data):
    """The motion without inputs in closed form, its place by quadrature; v' = a w^2, c^2 w' = -a v w."""
    a, c = mp.mpf(3) / 10, mp.sqrt(mp.mpf("0.68") / 2)
    v0, w0 = mp.mpf(1), mp.mpf(8) / 10
    V = mp.sqrt(v0**2 + c**2 * w0**2)
    start = mp.atanh(v0 / V)

    def speeds(t):
        phase = a * V * t / c**2 + start
        return V * mp.tanh(phase), V / c * mp.sech(phase)

    def heading(t):
        phase = a * V * t / c**2 + start
        return c / a * (mp.atan(mp.sinh(phase)) - mp.atan(mp.sinh(start)))

    found, x, y, before = {"q": [], "v": []}, mp.mpf(0), mp.mpf(0), mp.mpf(0)
    with mp.workdps(30):
        for time in exact(data["trajectory"]["t"]):
            if time > before:
                x += mp.quad(lambda s: speeds(s)[0] * mp.cos(heading(s)), [before, time])
                y += mp.quad(lambda s: speeds(s)[0] * mp.sin(heading(s)), [before, time])
            before = time
            found["q"].append([x, y, heading(time)])
            found["v"].append(list(speeds(time)))
    return found


def derived(data):
    """All of it."""
    return {"states": states(data), "trajectory": trajectory(data)}
