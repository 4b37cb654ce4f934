"""The C of the rows is that of their formulas in Python; tests of the kernel compare what both compute."""

import numpy as np
import pytest

from tools.formulas import c_statements, forget, gradient, inputs, rate, total
from tools.generate_rows import PATH, generate


def test_the_formulas_of_the_kernel_are_current():
    assert PATH.read_text() == generate(), "run python -m tools.generate_rows"


def evaluate(formulas, **arrays):
    """Values of formulas by their C, which is Python too but for its declarations and marks."""
    lines = c_statements({f"out_{i} =": each for i, each in enumerate(formulas)})
    names = {"sqrt": np.sqrt, **arrays}
    exec("\n".join(lines).replace("const double ", "").replace(";", ""), names)
    return np.array([names[f"out_{i}"] for i in range(len(formulas))])


def formula(x, y, z):
    s = (x * x + y * y) ** 0.5
    return -(x - z) / s - (2.0 - y * -z) * (-s) + 1.0 / (z * s) - (x + y) * (z - 1.0)


def test_derivatives_and_c_of_a_formula_are_those_of_numbers():
    """Rates, gradients and their rates, beside the complex step."""
    x, e = np.array([0.3, -0.7, 1.1]), np.array([0.2, 0.5, -0.4])
    d, rates = inputs("d", 3), inputs("e", 3)
    value = formula(*d)
    moving, slopes = rate(value, dict(zip(d, rates, strict=True))), gradient(value, d)
    found = evaluate([value, moving, *slopes], d=x, e=e)
    step = 1e-30j
    expected = [np.imag(formula(*(x + step * each))) / 1e-30 for each in (e, *np.eye(3))]
    np.testing.assert_allclose(found, [formula(*x), *expected], rtol=1e-14)
    second = gradient(moving, d)
    steps = 1e-6 * np.eye(3)
    near = [evaluate([moving], d=x + h, e=e)[0] - evaluate([moving], d=x - h, e=e)[0] for h in steps]
    np.testing.assert_allclose(evaluate(second, d=x, e=e), np.array(near) / 2e-6, rtol=1e-7)


def test_parts_that_are_equal_are_computed_once():
    forget()
    x, y = inputs("d", 2)
    assert x * y is y * x
    assert total([x, 0.0, -x * 0.0]) is x
    assert c_statements({"a =": (x + y) * (y + x), "b =": -(x + y)}) == [
        "const double x0 = d[0] + d[1];",
        "a = x0 * x0;",
        "b = -x0;",
    ]
    with pytest.raises(ValueError, match=r"power 2 of a symbol: expected -1 or 0\.5"):
        x**2
