"""tests/data/space_robot.json: a platform and three links with point masses at their ends, relative joint angles."""

import mpmath as mp
import sympy as sp

from .mechanics import Mechanics, exact

J, MASS, LENGTH = 10, 10, 1
START = {"q": ["0.1", "0.4", "0.9", "-0.5"], "v": [0, 0, 0]}
PERIOD, STEPS, COLUMNS = mp.mpf(1) / 2, 5, 10  # of samples; extrapolations in one; order 20


def tip(q):
    """Ends of the links, the last one last."""
    ends, angle, x, y = [], q[0], sp.Integer(0), sp.Integer(0)
    for joint in q[1:]:
        angle = angle + joint
        x, y = x + LENGTH * sp.cos(angle), y + LENGTH * sp.sin(angle)
        ends.append(sp.Matrix([x, y]))
    return ends


def energy(q, qd):
    total = sp.Rational(J, 2) * qd[0] ** 2
    for end in tip(q):
        velocity = end.jacobian(q) * sp.Matrix(qd)
        total += sp.Rational(MASS, 2) * velocity.dot(velocity)
    return total


def in_tip(q):
    return sp.Matrix([*tip(q)[-1], q[1]])


def space_robot() -> Mechanics:
    names = ["phi", "th1", "th2", "th3"]
    q = sp.symbols(names)
    return Mechanics(
        names,
        energy,
        rows=lambda q, H: H[0, :],  # angular momentum about the pin
        inputs=lambda q: sp.Matrix(4, 3, lambda i, j: int(i == j + 1)),
        bases={"S1a": lambda q: sp.eye(4)[1:, :], "S1b": lambda q: in_tip(q).jacobian(q)},
        outputs={"S1a": ([q[0]], q[1:]), "S1b": ([q[0]], list(in_tip(q)))},
    )


def states(data, count=None):
    """Results of the derivation at the states of the file, in the form of the file."""
    system, found = space_robot(), []
    for state in data["states"][:count]:
        q, T, free = (exact(state[key]) for key in ("q", "T", "qd_free"))
        qd = system.velocity(q, "S1a", exact(state["bases"]["S1a"]["v"]))
        bases = {each: system.reduced(each, q, qd, T) for each in system.bases}
        found.append({**system.full(q, qd, free, T), "bases": bases})
    return found


def simulation(data):
    """The open-loop run: torques given, by extrapolation of the midpoint rule (Gragg, Bulirsch, Stoer)."""
    system = space_robot()

    def rate(t, y):
        q, v = list(y[:4]), list(y[4:7])
        T = [2 * mp.sin(t), mp.mpf(-3) / 2 * mp.cos(2 * t), mp.mpf(7) / 10 * mp.sin(3 * t)]
        qd = system.velocity(q, "S1a", v)
        reduced = system.reduced("S1a", q, qd, T)
        return mp.matrix([*qd, *reduced["vdot"], sum(a * b for a, b in zip(T, v, strict=True))])

    y = mp.matrix([*(mp.mpf(each) for each in START["q"]), *START["v"], 0])
    found = {"q": [], "v": [], "qd": [], "work": []}
    with mp.workdps(25):
        for sample, t in enumerate(data["simulation"]["t"]):
            if sample:
                h = PERIOD / STEPS
                for k in range(STEPS):
                    y = _extrapolated(rate, (sample - 1) * PERIOD + k * h, y, h)
            assert mp.mpf(t) == sample * PERIOD
            q, v = list(y[:4]), list(y[4:7])
            for key, value in (("q", q), ("v", v), ("qd", system.velocity(q, "S1a", v)), ("work", y[7])):
                found[key].append(value)
    return found


def _extrapolated(rate, t, y, h):
    """One step of the midpoint rule with 2, 4, 6, ... substeps, extrapolated in their length squared."""
    table = []
    for column in range(1, COLUMNS + 1):
        n = 2 * column
        small = h / n
        before, here = y, y + small * rate(t, y)
        for k in range(1, n):
            before, here = here, before + 2 * small * rate(t + k * small, here)
        row = [(before + here + small * rate(t + h, here)) / 2]
        for j, older in enumerate(table[-1] if table else [], start=1):
            row.append(row[-1] + (row[-1] - older) / ((mp.mpf(n) / (n - 2 * j)) ** 2 - 1))
        table.append(row)
    return table[-1][-1]


def derived(data):
    """All of it."""
    return {"states": states(data), "simulation": simulation(data)}
