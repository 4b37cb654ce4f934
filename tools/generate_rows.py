"""C of the rows that are wrenches on frames, from their Python formulas: ``python -m tools.generate_rows``.

It writes ``rnc_pin/_kernel/rows_generated.h``, and a test checks that this file is current. Each kind is a function of
directions d that a frame carries, and of constant parameters. With a motion (V, A) of the frame, each kind has

    wrench   W; it returns a length that is zero where W is not defined
    rates    W, and its rate for rates e of the directions
    slopes   the same, and the derivatives by the directions of the velocity W V and of the acceleration W A + Wd V.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rnc_pin._kernel import INTERFACE
from rnc_pin._kernel.kernel_rows import AT_GROUND, INTEGERS, NUMBERS, Form, KernelForce, Value
from rnc_pin.constraints.couplings import linkage
from rnc_pin.constraints.rolling_body import curved_gradient, curved_wrench
from rnc_pin.constraints.surfaces import support_point
from rnc_pin.constraints.wheels_and_blades import wheel_level, wheel_wrenches
from rnc_pin.math.linear_algebra import apply, apply_transposed, cross, dot
from rnc_pin.model.frame_rows import FLAT
from rnc_pin.outputs import TOGETHER, distance_force, level, tilt_wrench, yaw_wrench
from tools.formulas import Symbol, c_statements, forget, gradient, inputs, rate, symbol, total

PATH = Path(__file__).parent.parent / "rnc_pin" / "_kernel" / "rows_generated.h"
_HEAD = """/* Written by python -m tools.generate_rows from the formulas in Python: change those. */
/* clang-format off */
"""
_WIDTH = 115  # characters of a line of C, without its indentation
Vectors = Sequence[Sequence[Symbol]]


@dataclass(frozen=True)
class Kind:
    """Formula of a kind of rows.

    Attributes:
        directions: number of its directions.
        parameters: number of its parameters.
        wrench: wrench (6,) of directions and parameters.
        length: zero where the wrench is not defined.
        least: smallest length.
    """

    directions: int
    parameters: int
    wrench: Callable[[Vectors, Sequence[Symbol]], Sequence[Symbol]]
    length: Callable[[Vectors, Sequence[Symbol]], Symbol | float] = lambda d, p: 1.0
    least: float = FLAT


def _wheel(d: Vectors, p: Sequence[Symbol]) -> list[Symbol]:
    rows = wheel_wrenches(d[0], p[1:4], p[0])
    return [dot(p[4:7], column) for column in zip(*rows, strict=True)]


def _rolling(d: Vectors, p: Sequence[Symbol]) -> list[Symbol]:
    axes = np.array(d, dtype=object).T  # the directions are the columns of the rotation
    outward = -apply_transposed(axes, np.array(p[3:6]))  # of the shape, in its own axes
    arm = apply(axes, support_point(outward, np.array(p[6:9]), p[9], p[10]))
    return [*p[:3], *cross(arm.tolist(), p[:3])]


def _rolling_length(d: Vectors, p: Sequence[Symbol]) -> Symbol:
    outward = [-dot(each, p[3:6]) for each in d]
    return dot([S * each for S, each in zip(p[6:9], outward, strict=True)], outward) ** 0.5


def _curved_length(d: Vectors, p: Sequence[Symbol]) -> Symbol:
    gradient = curved_gradient(d[0], p[0], p[1:4])
    return dot(gradient, gradient) ** 0.5


KINDS = {
    Form.WORLD: Kind(0, 6, lambda d, p: p),
    Form.OWN: Kind(2, 0, lambda d, p: [*d[0], *d[1]]),
    Form.WHEEL: Kind(1, 7, _wheel, lambda d, p: wheel_level(d[0], p[1:4])),
    Form.YAW: Kind(1, 0, lambda d, p: yaw_wrench(d[0]), lambda d, p: level(d[0])),
    Form.TILT: Kind(1, 0, lambda d, p: tilt_wrench(d[0]), lambda d, p: level(d[0])),
    Form.ROLLING: Kind(3, 11, _rolling, _rolling_length),
    Form.CURVED: Kind(2, 9, lambda d, p: curved_wrench(*d, p[0], p[1:4], p[4], p[5:]), _curved_length),
    Form.DISTANCE: Kind(
        1, 0, lambda d, p: [*distance_force(d[0])[0], 0, 0, 0], lambda d, p: dot(d[0], d[0]) ** 0.5, TOGETHER
    ),
}


def generate() -> str:
    """Text of the file."""
    forget()
    parts = [_HEAD, _constants()]
    table = []
    for form, kind in KINDS.items():
        name = form.name.lower()
        parts += _functions(name, kind)
        table.append(
            f"    [{form.name}] = {{{kind.directions}, {kind.least}, {name}_wrench, {name}_rates, {name}_slopes}},"
        )
    d, p = inputs("d", 4), inputs("p", 2)
    parts.append(_function("void", "linkage", ("d", "p"), ("W",), _assigned(W=linkage(d[:2], d[2:], *p))))
    return "\n".join([*parts, "static const Kind KINDS[] = {", *table, "};", ""])


def _constants() -> str:
    """Ids and sizes that Python and C share."""
    sizes = {"INTERFACE": INTERFACE, "INTEGERS": 3 + INTEGERS, "NUMBERS": NUMBERS, "AT_GROUND": AT_GROUND}
    lines = [f"#define {name} {size}" for name, size in sizes.items()]
    forms, values = (", ".join(f"{each.name} = {each.value}" for each in ids) for ids in (Form, Value))
    force = ", ".join([*(f"F_{field.upper()}" for field in KernelForce._fields), "FORCE_NUMBERS"])
    lines += [f"enum {{ {forms} }};", f"enum {{ {values.replace('NONE', 'NO_VALUE')} }};", f"enum {{ {force} }};"]
    return "\n".join([*lines, _TYPES])


_TYPES = """
typedef struct {
    int directions; /* number of its directions, whose parameters follow in the numbers of a row */
    double least;   /* length below which the wrench is not defined */
    double (*wrench)(const double *d, const double *p, double *W);
    void (*rates)(const double *d, const double *e, const double *p, double *W, double *Wd);
    void (*slopes)(const double *d, const double *e, const double *p, const double *V, const double *A, double *k,
                   double *g);
} Kind;
"""


def _functions(name: str, kind: Kind) -> list[str]:
    flat, rates = inputs("d", 3 * kind.directions), inputs("e", 3 * kind.directions)
    p, V, A = (inputs(array, size) for array, size in (("p", kind.parameters), ("V", 6), ("A", 6)))
    d, moving = [flat[i : i + 3] for i in range(0, len(flat), 3)], dict(zip(flat, rates, strict=True))
    W = [symbol(each) for each in kind.wrench(d, p)]
    W_dot = [rate(each, moving) for each in W]
    velocity = total(a * b for a, b in zip(W, V, strict=True))
    acceleration = total(a * b for a, b in zip([*W, *W_dot], [*A, *V], strict=True))
    wrench = _assigned(W=W) | {"return": symbol(kind.length(d, p))}
    slopes = _assigned(k=gradient(velocity, flat), g=gradient(acceleration, flat))
    return [
        _function("double", f"{name}_wrench", ("d", "p"), ("W",), wrench),
        _function("void", f"{name}_rates", ("d", "e", "p"), ("W", "Wd"), _assigned(W=W, Wd=W_dot)),
        _function("void", f"{name}_slopes", ("d", "e", "p", "V", "A"), ("k", "g"), slopes),
    ]


def _assigned(**arrays: Sequence[Symbol]) -> dict[str, Symbol]:
    """Formulas by the left-hand sides of their assignments."""
    return {f"{name}[{i}] =": each for name, array in arrays.items() for i, each in enumerate(array)}


def _function(result: str, name: str, read: Sequence[str], written: Sequence[str], outputs: dict[str, Symbol]) -> str:
    lines = c_statements(outputs)
    arguments = [*(f"const double *{each}" for each in read), *(f"double *{each}" for each in written)]
    unused = [f"(void){each};" for each in (*read, *written) if not any(f"{each}[" in line for line in lines)]
    body = "".join(f"    {line}\n" for line in _filled((*unused, *lines)))
    return f"static {result} {name}({', '.join(arguments)})\n{{\n{body}}}\n"


def _filled(statements: Iterable[str]) -> list[str]:
    """Lines of short statements one after the other; a file with one statement a line is three times as long."""
    lines: list[str] = []
    for statement in statements:
        if lines and len(lines[-1]) + len(statement) < _WIDTH:
            lines[-1] += f" {statement}"
        else:
            lines.append(statement)
    return lines


if __name__ == "__main__":
    PATH.write_text(generate(), encoding="utf-8")
