"""Pictures of the bicycle: eigenvalues over speed, and what the nonlinear one does."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

import rnc_pin as rnc
from benchmarks.validation.bicycle import REAR, REFERENCE, bicycle, capsize_speed, linear, upright, weave_speed
from rnc_pin.figures.style import COLORS, STYLE

BLUE, ORANGE, GREEN = COLORS[0], COLORS[4], COLORS[2]


def make(folder: Path) -> None:
    """Write the pictures into a folder."""
    with mpl.rc_context(STYLE):
        eigenvalues(folder / "bicycle_eigenvalues.png")
        motion(folder / "bicycle_motion.png")


def eigenvalues(path: Path) -> None:
    """As figure 3 of the paper: real parts, and the imaginary part of the oscillation."""
    speeds = np.linspace(0, 10, 401)
    values = np.array([linear(speed).eigenvalues for speed in speeds])
    weave, capsize = weave_speed(), capsize_speed()
    figure = Figure(figsize=(6.4, 4.2))
    axes = figure.subplots()
    axes.axvspan(weave, capsize, color="0.93", lw=0)
    axes.axhline(0, color="0.4", lw=0.8)
    oscillating = np.abs(values.imag) > 1e-9
    every = np.repeat(speeds[:, None], 4, axis=1)
    axes.plot(every[~oscillating], values.real[~oscillating], ".", ms=2.4, color=BLUE, label="real eigenvalues")
    first = speeds[oscillating.any(axis=1)]
    pair = [row[many][0] for row, many in zip(values, oscillating, strict=True) if many.any()]
    axes.plot(first, np.real(pair), color=ORANGE, label="weave, real part")
    axes.plot(first, np.abs(np.imag(pair)), color=ORANGE, ls=(0, (4, 2)), lw=1.4, label="weave, imaginary part")
    for number, (speed, published) in enumerate(REFERENCE["linear"]["eigenvalues"].items()):
        real, imaginary = np.array(published["real"]), np.array(published["imag"])
        label = "published" if number == 0 else None
        axes.plot([float(speed)] * 4, real, "o", ms=4.5, mfc="none", mec="black", mew=0.8, label=label)
        shown = imaginary > 1e-9
        axes.plot([float(speed)] * shown.sum(), imaginary[shown], "o", ms=4.5, mfc="none", mec="black", mew=0.8)
    stable, style = f"stable\n{weave:.4f} to\n{capsize:.4f} m/s", {"ha": "center", "va": "bottom", "fontsize": 8.5}
    axes.text((weave + capsize) / 2, -9.4, stable, **style)
    axes.text(8.2, 0.45, "capsize", color=BLUE, fontsize=9)
    axes.text(1.2, -6.5, "caster", color=BLUE, fontsize=9)
    axes.set(xlim=(0, 10), ylim=(-10, 10), xlabel="forward speed [m/s]", ylabel="eigenvalue [1/s]")
    axes.set_title("Benchmark bicycle, upright and straight", loc="left")
    axes.legend(loc="upper left", ncols=2, fontsize=9)
    figure.savefig(path)


def motion(path: Path) -> None:
    """The full nonlinear bicycle after a push: it weaves below the weave speed and settles above."""
    reduced = bicycle()
    figure = Figure(figsize=(6.4, 4.2))
    panels = figure.subplots(2, 1, sharex=True)
    words = {4.0: "below the weave speed: it weaves wider and wider", 5.0: "self-stable: it settles"}
    for axes, (speed, word) in zip(panels, words.items(), strict=True):
        run = rnc.free_motion(reduced, upright(), np.array([0.2, 0.0, speed / REAR]), 5.0, dt=0.01)
        axes.axhline(0, color="0.4", lw=0.8)
        axes.plot(run.time, np.degrees(run.x1[:, 0]), color=BLUE, label="lean")
        axes.plot(run.time, np.degrees(run.q[:, 9]), color=ORANGE, label="steer")
        axes.set_ylabel("angle [deg]")
        axes.set_title(f"{speed:g} m/s, {word}", loc="left")
        axes.margins(x=0.01)
    panels[0].legend(loc="upper left", ncols=2)
    panels[1].set_xlabel("time after a push of 0.2 rad/s [s]")
    figure.savefig(path)
