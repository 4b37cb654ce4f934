"""tests/data/bicycle_linear.json: the linear equations of appendix A of Meijaard et al. 2007, from their table 1."""

from types import SimpleNamespace

import mpmath as mp
import sympy as sp

from . import mechanics

assert mp.mp.dps == mechanics.DIGITS


def matrices(parameters):
    """M, C1, K0 and K2 (2, 2), in roll and steer; exact but for sines and cosines of the steering axis's tilt."""
    p = SimpleNamespace(**{name: sp.Rational(repr(value)) for name, value in parameters.items()})
    tilt = sp.pi * p.lam_deg / 180 if hasattr(p, "lam_deg") else p.lam
    s, k = sp.sin(tilt), sp.cos(tilt)
    # The whole bicycle.
    m_t = p.mR + p.mB + p.mH + p.mF
    x_t = (p.xB * p.mB + p.xH * p.mH + p.w * p.mF) / m_t
    z_t = (-p.rR * p.mR + p.zB * p.mB + p.zH * p.mH - p.rF * p.mF) / m_t
    t_xx = p.IRxx + p.IBxx + p.IHxx + p.IFxx + p.mR * p.rR**2 + p.mB * p.zB**2 + p.mH * p.zH**2 + p.mF * p.rF**2
    t_xz = p.IBxz + p.IHxz - p.mB * p.xB * p.zB - p.mH * p.xH * p.zH + p.mF * p.w * p.rF
    t_zz = p.IRxx + p.IBzz + p.IHzz + p.IFxx + p.mB * p.xB**2 + p.mH * p.xH**2 + p.mF * p.w**2
    # The front assembly, handlebar and wheel, about its own centre of mass and about the steering axis.
    m_a = p.mH + p.mF
    x_a, z_a = (p.xH * p.mH + p.w * p.mF) / m_a, (p.zH * p.mH - p.rF * p.mF) / m_a
    a_xx = p.IHxx + p.IFxx + p.mH * (p.zH - z_a) ** 2 + p.mF * (p.rF + z_a) ** 2
    a_xz = p.IHxz - p.mH * (p.xH - x_a) * (p.zH - z_a) + p.mF * (p.w - x_a) * (p.rF + z_a)
    a_zz = p.IHzz + p.IFxx + p.mH * (p.xH - x_a) ** 2 + p.mF * (p.w - x_a) ** 2
    u = (x_a - p.w - p.c) * k - z_a * s
    l_l = m_a * u**2 + a_xx * s**2 + 2 * a_xz * s * k + a_zz * k**2
    l_x = -m_a * u * z_a + a_xx * s + a_xz * k
    l_z = m_a * u * x_a + a_xz * s + a_zz * k
    # Trail over wheelbase, spins of the wheels, and a static moment.
    mu = p.c / p.w * k
    spin_f = p.IFyy / p.rF
    spin = p.IRyy / p.rR + spin_f
    moment = m_a * u + mu * m_t * x_t
    coupling = l_x + mu * t_xz
    found = {
        "M": [[t_xx, coupling], [coupling, l_l + 2 * mu * l_z + mu**2 * t_zz]],
        "C1": [
            [0, mu * spin + spin_f * k + t_xz / p.w * k - mu * m_t * z_t],
            [-(mu * spin + spin_f * k), l_z / p.w * k + mu * (moment + t_zz / p.w * k)],
        ],
        "K0": [[m_t * z_t, -moment], [-moment, -moment * s]],
        "K2": [[0, (spin - m_t * z_t) / p.w * k], [0, (moment + spin_f * s) / p.w * k]],
    }
    return {name: mp.matrix([[mp.mpf(sp.N(x, 50)) for x in row] for row in rows]) for name, rows in found.items()}


def polynomial(found, v, g):
    """Of ``det(M s^2 + v C1 s + g K0 + v^2 K2)``: coefficients from s^4 to s^0."""
    v = mp.mpf(v)
    M, C, K = found["M"], v * found["C1"], g * found["K0"] + v**2 * found["K2"]

    def product(a, b, c, d):
        (a2, a1, a0), (b2, b1, b0) = ([X[i] for X in (M, C, K)] for i in ((a, b), (c, d)))
        return [a2 * b2, a2 * b1 + a1 * b2, a2 * b0 + a1 * b1 + a0 * b2, a1 * b0 + a0 * b1, a0 * b0]

    return [x - y for x, y in zip(product(0, 0, 1, 1), product(0, 1, 1, 0), strict=True)]


def eigenvalues(found, v, g):
    """Sorted as in the file, by real part and then by imaginary part."""
    roots = mp.polyroots(polynomial(found, v, g), maxsteps=500, extraprec=200)
    return sorted(roots, key=lambda root: (round(float(root.real), 9), float(root.imag)))


def special_speeds(found, g):
    """Speeds at which two real eigenvalues become a pair, and at which weave and capsize change their sign."""

    def weave(v):
        a, b, c, d, e = polynomial(found, v, g)
        return b * c * d - a * d**2 - b**2 * e

    def apart(v):
        """Discriminant, as the square of the difference of the two largest roots that meet."""
        roots = sorted(mp.polyroots(polynomial(found, v, g), maxsteps=500, extraprec=200), key=lambda root: -root.real)
        return ((roots[0] - roots[1]) ** 2).real

    K0, K2 = g * found["K0"], found["K2"]
    # det(K0 + v^2 K2) is linear in v^2: the first column of K2 is zero.
    capsize = mp.sqrt(-mp.det(K0) / (K0[0, 0] * K2[1, 1] - K0[1, 0] * K2[0, 1]))
    v_w = mp.findroot(weave, (mp.mpf(4), mp.mpf(5)), solver="anderson")
    v_d = mp.findroot(apart, (mp.mpf("0.65"), mp.mpf("0.7")), solver="secant", tol=mp.mpf(10) ** -40, maxsteps=80)
    _, b, _, d, _ = polynomial(found, v_w, g)
    double = sorted(mp.polyroots(polynomial(found, v_d, g), maxsteps=900, extraprec=400), key=lambda root: -root.real)
    return {
        "v_d": v_d,
        "lambda_d": (double[0].real + double[1].real) / 2,
        "v_w": v_w,
        "omega_w": mp.sqrt(d / b),
        "v_c": capsize,
    }


def derived(data):
    """All of it."""
    found, g = matrices(data["parameters"]), mp.mpf(repr(data["parameters"]["g"]))
    inverse = found["M"] ** -1
    result = {name: matrix.tolist() for name, matrix in found.items()}
    products = {f"minus_Minv_{name}": -(inverse * found[name]) for name in ("K2", "C1")}
    all_matrices = {"Minv": inverse, "minus_Minv_gK0": -g * inverse * found["K0"], **products}
    result["state_matrix"] = {name: matrix.tolist() for name, matrix in all_matrices.items()}
    result["eigenvalues"] = {}
    for speed in data["linear"]["eigenvalues"]:
        roots = eigenvalues(found, speed, g)
        result["eigenvalues"][speed] = {"real": [x.real for x in roots], "imag": [x.imag for x in roots]}
    result["special_speeds"] = special_speeds(found, g)
    return {"linear": result}
