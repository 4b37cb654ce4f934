"""A mechanical system under Pfaffian constraints, from its kinetic energy: paper (1)-(3) written out."""

from collections.abc import Sequence

import mpmath as mp
import sympy as sp

DIGITS = 50
mp.mp.dps = DIGITS
Number = float | str | mp.mpf


def exact(numbers: Sequence[float]) -> list[mp.mpf]:
    """Decimals as a file prints them, not their nearest binary fractions."""
    return [mp.mpf(repr(number)) for number in numbers]


def nested(matrix: mp.matrix) -> list:
    """A matrix as rows, a column as a list."""
    if matrix.cols == 1:
        return list(matrix)
    return [[matrix[i, j] for j in range(matrix.cols)] for i in range(matrix.rows)]


class Mechanics:
    """``H qdd + C qd = M T + A^T lambda`` and ``A qd = 0``, without gravity.

    Args:
        names: of the coordinates.
        energy: ``energy(q, qd)``, the kinetic one.
        rows: ``rows(q, H)``, A.
        inputs: ``inputs(q)``, M.
        bases: for each basis by name ``J2(q)``: the reduced velocities are ``v = J2 qd``.
        outputs: for each basis by name ``(x1(q), x2(q))``, where it has any.
    """

    def __init__(self, names, energy, rows, inputs, bases, outputs=None):
        self.q, self.qd = sp.symbols(names), sp.symbols([f"{name}_d" for name in names])
        kinetic = energy(self.q, self.qd)
        self.H = sp.hessian(kinetic, self.qd)
        self.C = self._christoffel()
        self.A, self.M = rows(self.q, self.H), inputs(self.q)
        self.bases = {name: J2(self.q) for name, J2 in bases.items()}
        outputs = outputs or {}
        self._energy = sp.lambdify([self.q, self.qd], kinetic, "mpmath")
        self._values = self._compiled([self.H, self.C, self.A, self.M, *self.bases.values()])
        self._rates = self._compiled([self._rate(each) for each in (self.H, self.A, *self.bases.values())])
        self._outputs = {name: self._compiled([sp.Matrix(x) for x in pair]) for name, pair in outputs.items()}
        self._J1 = {name: sp.Matrix(pair[0]).jacobian(self.q) for name, pair in outputs.items()}
        self._connection = {name: self._compiled([J1, self._rate(J1)]) for name, J1 in self._J1.items()}

    def _christoffel(self) -> sp.Matrix:
        q, H, n = self.q, self.H, len(self.q)

        def entry(i, j):
            return (
                sum((H[i, j].diff(q[k]) + H[i, k].diff(q[j]) - H[j, k].diff(q[i])) * self.qd[k] for k in range(n)) / 2
            )

        return sp.Matrix(n, n, entry)

    def _rate(self, matrix: sp.Matrix) -> sp.Matrix:
        """Along qd."""
        return sum((matrix.diff(x) * rate for x, rate in zip(self.q, self.qd, strict=True)), sp.zeros(*matrix.shape))

    def _compiled(self, matrices):
        return sp.lambdify([self.q, self.qd], [sp.Matrix(each) for each in matrices], "mpmath", cse=True)

    def _at(self, q, qd):
        H, C, A, M, *J2 = (mp.matrix(each) for each in self._values(q, qd))
        H_dot, A_dot, *J2_dot = (mp.matrix(each) for each in self._rates(q, qd))
        return H, C, A, M, J2, H_dot, A_dot, J2_dot

    def velocity(self, q, basis, v):
        """The qd (n,) that has these reduced velocities."""
        _, _, A, _, J2, *_ = self._at(q, [mp.mpf(0)] * len(q))
        E = _stacked(A, J2[list(self.bases).index(basis)])
        return list(mp.lu_solve(E, mp.matrix([0] * A.rows + list(v))))

    def full(self, q, qd, free, T) -> dict:
        """Entries of the unreduced system at one state; ``free`` is a velocity that violates A."""
        H, C, A, M, _, H_dot, A_dot, _ = self._at(q, qd)
        _, C_free, _, _, _, H_dot_free, A_dot_free, _ = self._at(q, free)
        speed, off = mp.matrix(qd), mp.matrix(free)
        found = {
            "qd": qd, "H_star": nested(H), "C_star": nested(C), "C_star_qd": nested(C * speed),
            "Hdot_star": nested(H_dot), "C_star_free": nested(C_free), "C_star_free_qd_free": nested(C_free * off),
            "Hdot_star_free": nested(H_dot_free), "G_star": [mp.mpf(0)] * len(q), "A": nested(A), "Adot": nested(A_dot),
            "Adot_free": nested(A_dot_free), "M": nested(M), "kinetic_energy": self._energy(q, qd),
            "kinetic_energy_free": self._energy(q, free),
        }  # fmt: skip
        for name, inputs in (("", T), ("_zero_input", [mp.mpf(0)] * len(T))):
            found[f"qdd{name}"], found[f"lambda{name}"] = self._accelerations(H, C, A, M, A_dot, speed, inputs)
        return found

    def _accelerations(self, H, C, A, M, A_dot, speed, T):
        """Of the whole system (1), with its multipliers, from one linear system."""
        n, m = H.rows, A.rows
        K, right = mp.zeros(n + m), mp.zeros(n + m, 1)
        force, bias_acceleration = M * mp.matrix(T) - C * speed, -(A_dot * speed)
        for i in range(n):
            right[i] = force[i]
            for j in range(n):
                K[i, j] = H[i, j]
            for k in range(m):
                K[i, n + k], K[n + k, i] = -A[k, i], A[k, i]
        for k in range(m):
            right[n + k] = bias_acceleration[k]
        solution = list(mp.lu_solve(K, right))
        return solution[:n], solution[n:]

    def reduced(self, basis, q, qd, T) -> dict:
        """Entries of the reduced system at one state."""
        H_star, C, A, M, J2s, _, A_dot, J2_dots = self._at(q, qd)
        index = list(self.bases).index(basis)
        J2, J2_dot = J2s[index], J2_dots[index]
        E, E_dot = _stacked(A, J2), _stacked(A_dot, J2_dot)
        n, m, speed = len(q), A.rows, mp.matrix(qd)
        R = (E**-1)[:, m:]
        R_dot = -(E**-1) * E_dot * R
        H = R.T * H_star * R
        V = R.T * (H_star * R_dot + C * R)
        v = J2 * speed
        # Hdot directly, not as V + V^T.
        H_star_dot = mp.matrix(self._rates(q, qd)[0])
        H_dot = R_dot.T * H_star * R + R.T * H_star_dot * R + R.T * H_star * R_dot
        force = R.T * M
        matrices = {"v": v, "R": R, "Rdot": R_dot, "H": H, "Vcc": V, "Vcc_v": V * v, "Hdot": H_dot}
        found = {name: nested(matrix) for name, matrix in matrices.items()}
        found |= {"G": [mp.mpf(0)] * (n - m), "RtM": nested(force)}
        found["vdot"] = nested(mp.lu_solve(H, force * mp.matrix(T) - V * v))
        found["vdot_zero_input"] = nested(mp.lu_solve(H, -(V * v)))
        if basis in self._outputs:
            x1, x2 = (mp.matrix(each) for each in self._outputs[basis](q, qd))
            J1, J1_dot = (mp.matrix(each) for each in self._connection[basis](q, qd))
            found |= {"x1": nested(x1), "x2": nested(x2), "A_star": nested(J1 * R)}
            found["A_star_dot"] = nested(J1_dot * R + J1 * R_dot)
        return found


def _stacked(upper: mp.matrix, lower: mp.matrix) -> mp.matrix:
    rows = [*upper.tolist(), *lower.tolist()]
    return mp.matrix(rows)
