"""Error over cost of free motions: ``python -m benchmarks.peers.work_precision [--systems NAME...] [--picture FILE]``.

All ways start at the same state and move for ten seconds. Adaptive ways give a sample every 20 ms, others one at each
of their fixed steps. The error is the largest displacement of a sample from that of DOP853 over the solution by hand at
its finest tolerance. Costs are processor times, medians of rounds taken in turn.

* ``free_motion``: ours, adaptive steps, at several tolerances;
* ``ReducedPlant``: ours, fixed Runge-Kutta steps of order 4, as ``simulate`` takes them;
* ``KKT by hand``: DOP853 of SciPy over ``hand_written.py``, at several tolerances;
* ``SymPy``: the same over compiled equations of planar systems;
* ``MuJoCo``: its Runge-Kutta method at several steps, for systems without constraint rows.
"""

from __future__ import annotations

import argparse
import importlib.util
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from rich import box
from rich.console import Console
from rich.table import Table
from scipy.integrate import solve_ivp
from scipy.linalg.lapack import dposv

import rnc_pin as rnc
from benchmarks.peers.cases import CASES, Case
from benchmarks.peers.motion import FINEST, Motion
from benchmarks.peers.sympy_equations import BASES, reduced_equations
from benchmarks.reduction import machine
from benchmarks.timing import in_turn, used_by
from rnc_pin.figures.style import STYLE, PrintFigure, line, save
from rnc_pin.lab.mujoco.contact_bodies import MuJoCoSettings

DURATION, ROUNDS = 10.0, 7
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
STEPS = (0.5, 0.2, 0.1, 0.04, 0.02)
"""Lengths of fixed steps [s], multiples of the time between two samples."""
TICKS = (2, 5, 10, 20, 50, 100, 200, 500)
SYSTEMS = ("space-robot", "mobile-manipulator", "tiago", "free-panda-joints")


@dataclass(frozen=True)
class Way:
    """A way to integrate a motion.

    Attributes:
        name: short name.
        settings: tolerances, or steps [s].
        samples: function from one of these to configurations (count, nq).
    """

    name: str
    settings: Sequence[float]
    samples: Callable[[float], np.ndarray]


@dataclass(frozen=True)
class Curve:
    """Errors [m or rad] and costs [s] of a way, one for each setting."""

    name: str
    settings: Sequence[float]
    errors: np.ndarray
    seconds: np.ndarray


def ways(case: Case, motion: Motion) -> Iterator[Way]:
    """Ways that can express a system and are installed."""
    yield Way("free_motion", TOLERANCES, motion.ours)
    yield Way("ReducedPlant", STEPS, lambda step: plant_motion(case, motion, step))
    yield Way("KKT by hand", TOLERANCES, lambda rtol: motion.configurations(motion.theirs(rtol)))
    if case.name in BASES:
        yield Way("SymPy", TOLERANCES, sympy_motion(case, motion))
    if case.free and importlib.util.find_spec("mujoco"):
        yield Way("MuJoCo", STEPS, lambda step: mujoco_motion(case, motion, step))


def plant_motion(case: Case, motion: Motion, step: float) -> np.ndarray:
    """Samples (count, nq) of a plant, one at each step [s]."""
    plant = rnc.ReducedPlant(case.reduced, actuator_limits=False, joint_damping=False)
    return _advanced(plant, case, motion, step)


def mujoco_motion(case: Case, motion: Motion, step: float) -> np.ndarray:
    """Samples (count, nq) of MuJoCo, one at each step [s]."""
    from rnc_pin.lab.mujoco import MuJoCoPlant

    settings = MuJoCoSettings(step=step, integrator="RK4", joint_limits=False, joint_damping=False)
    return _advanced(MuJoCoPlant(case.reduced, settings, motion.q0), case, motion, step)


def _advanced(plant: rnc.plants.Plant, case: Case, motion: Motion, step: float) -> np.ndarray:
    plant.reset(motion.q0, np.array(case.reduced.at(motion.q0, motion.v2_0).v))
    plant.apply(np.zeros(case.reduced.p))
    found = [motion.q0]
    for _ in range(round(motion.times[-1] / step)):
        plant.advance(step)
        found.append(np.array(plant.read()[0]))
    return np.array(found)


def sympy_motion(case: Case, motion: Motion) -> Callable[[float], np.ndarray]:
    """Function from a tolerance to samples (count, nq): DOP853 over compiled equations, which are made here."""
    equations, entries = reduced_equations(case)
    n, no_input = case.model.nv, [0.0] * len(entries)
    u0 = np.array(case.reduced.at(motion.q0, motion.v2_0).v)[entries]

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        x, u = y[:n], y[n:]
        H, right = (np.array(each) for each in equations(x.tolist(), u.tolist(), no_input))
        acceleration = dposv(H, right)[1][-len(u) :]
        if case.free:  # the momentum gives the first velocity
            return np.concatenate([[-H[0, 1:].dot(u) / H[0, 0]], u, acceleration])
        return np.concatenate([[np.cos(x[2]) * u[0], np.sin(x[2]) * u[0]], u[1:], acceleration])

    def samples(rtol: float) -> np.ndarray:
        start = np.concatenate([case.coordinates.of(motion.q0), u0])
        found = solve_ivp(rate, (0.0, motion.times[-1]), start, "DOP853", motion.times, rtol=rtol, atol=rtol)
        return motion.configurations(found.y[:n].T)

    return samples


def curves(case: Case, duration: float, rounds: int) -> list[Curve]:
    """Errors and costs of all ways for a motion."""
    motion = Motion(case, duration)
    reference = motion.configurations(motion.theirs(FINEST))
    found = list(ways(case, motion))
    runs = [(way, setting) for way in found for setting in way.settings]
    samples = [way.samples(setting) for way, setting in runs]
    errors = [motion.displacement(each, reference[:: (len(reference) - 1) // (len(each) - 1)]) for each in samples]
    measured = [used_by(lambda way=way, setting=setting: way.samples(setting), 1) for way, setting in runs]
    seconds = [float(figure[0]) for figure in in_turn(measured, rounds)]
    made = []
    for way in found:
        here = [k for k, (each, _) in enumerate(runs) if each is way]
        made.append(Curve(way.name, way.settings, np.array(errors)[here], np.array(seconds)[here]))
    return made


def _range_of(values: np.ndarray) -> tuple[float, float]:
    """Limits of a logarithmic axis with a margin."""
    return 0.8 * float(values.min()), 1.25 * float(values.max())


@mpl.rc_context(STYLE)
def figure_of(found: dict[str, list[Curve]]) -> Figure:
    """Error over cost, one panel for each system."""
    columns = min(2, len(found))
    rows = -(-len(found) // columns)
    figure = PrintFigure((4.2 * columns, 3.0 * rows + 0.4))
    figure.set_layout_engine("constrained")
    names = list(dict.fromkeys(curve.name for each in found.values() for curve in each))
    panels = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    for axes, (system, each) in zip(panels, found.items(), strict=False):
        for curve in each:
            k = names.index(curve.name)
            line(axes, k, len(names), 1e3 * curve.seconds, curve.errors).set(label=curve.name, markevery=None)
        axes.set(xscale="log", yscale="log", xlabel="processor time [ms]")
        axes.set_xticks(TICKS, [str(each) for each in TICKS])
        axes.set_xlim(*_range_of(1e3 * np.concatenate([curve.seconds for curve in each])))
        axes.minorticks_off()
        axes.set_title(system, loc="left")
    for axes in panels[::columns]:
        axes.set_ylabel("largest error [m or rad]")
    handles = {text: handle for axes in panels for handle, text in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=len(handles))
    return figure


def main(given: Sequence[str] | None = None) -> None:
    """Measure, print a table, and draw the picture."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers.work_precision")
    parser.add_argument("--systems", nargs="+", choices=SYSTEMS, default=list(SYSTEMS), metavar="NAME")
    parser.add_argument("--duration", type=float, default=DURATION, metavar="S", help="default: %(default)s")
    parser.add_argument("--rounds", type=int, default=ROUNDS, metavar="N", help="default: %(default)s")
    parser.add_argument("--picture", type=Path, metavar="FILE")
    options = parser.parse_args(given)
    found = {name: curves(CASES[name](), options.duration, options.rounds) for name in options.systems}
    table = Table("system", "way", "setting", "error", "ms", box=box.SIMPLE_HEAD)
    for system, each in found.items():
        for curve in each:
            for setting, error, seconds in zip(curve.settings, curve.errors, curve.seconds, strict=True):
                table.add_row(system, curve.name, f"{setting:g}", f"{error:.0e}", f"{1e3 * seconds:.1f}")
    Console(highlight=False, width=100).print(table)
    print(", ".join(f"{name} {value}" for name, value in machine().items()))
    if options.picture is not None:
        save(figure_of(found), options.picture)


if __name__ == "__main__":
    main()
