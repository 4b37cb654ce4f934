"""Result of a run: its record with its verdict, its file, figures, and tables for other programs."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from rnc_pin.errors import ConfigurationError, InputError, RncError, place_of
from rnc_pin.io.json import atomic_file, dump_json
from rnc_pin.printing import ObjectSummary, SummaryMixin
from rnc_pin.simulation.run_data import RunData, columns_of_array
from rnc_pin.verdict import Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rnc_pin.figures import Size
    from rnc_pin.simulation.summary import PrintedSummary


class Trajectory(RunData, SummaryMixin):
    """Run sampled at N times, with the same arrays as the file of ``save``.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> run = rnc.free_motion(reduced, robot.configuration(), [1.0, 0.5], duration=1.0, dt=0.1)
        >>> run
        Trajectory: succeeded, 1 s in 11 samples
        >>> run.q.shape, run.time[-1].item()
        ((11, 4), 1.0)
        >>> bool(np.ptp(run.energy) < 1e-9 * run.energy[0])  # no input, so energy is constant
        True
    """

    @cached_property
    def verdict(self) -> Verdict:
        """Findings about the run: it succeeded only if none fails. Computed at its first use.

        Runs of ``simulate`` and ``free_motion`` are judged by the limits of the robot's file, by distances between its
        links, by contacts and by the commands of the loop. Runs of scenarios are also judged by their goals and
        obstacles, by ``judged_summary`` in ``applications/scenario/simulated_run.py``. ``save`` writes it too.

        Raises:
            ConfigurationError: the run is from a file, and nothing could judge it before it was saved.
        """
        from rnc_pin.simulation.judgement import verdict_of  # a run alone starts without it

        return verdict_of(self)

    def save(self, path: str | Path) -> None:
        """Write a ``.npz`` file with the verdict, for ``load``. An error leaves no partial file.

        Args:
            path: path of the file; an existing one is replaced.
        """
        path = Path(path)
        run: RunData = self
        with suppress(RncError):  # samples that nothing can judge are kept too
            run = self.with_verdict(self.verdict)  # in the file, because it cannot be judged without the robot
        with atomic_file(path) as partial, partial.open("wb") as file:
            np.savez(file, allow_pickle=False, meta=np.array(dump_json(run.meta)), **run.arrays)

    def plot(
        self,
        outputs: Sequence[str] | str | None = None,
        *,
        title: str | None = None,
        comparisons: Mapping[str, Trajectory] | None = None,
        size: Size | None = None,
        labels: Mapping[str, str] | None = None,
        name: str | None = None,
        file: str | Path | None = None,
    ) -> Figure:
        """Plot the run: paths from above, and outputs, errors, inputs and distance from singularity over time.

        Args:
            outputs: names of outputs and of quantities, in the order of the panels; all by default. Quantities are
                "top_view", "rates", "outputs", "errors", "inputs", "estimates", "prediction_error", "normal_forces"
                and "margin".
            title: title above the plots.
            comparisons: other runs by label, dashed.
            size: "column" or "page" of a paper (3.4 and 7 inches wide), or width and height [inches]. Text has 8
                points on these. By default the figure is for the screen, and its size follows from its panels.
            labels: text by name of an output, an input, a run or an axis, such as ``{"joint_1": r"$\\theta_1$"}``.
            name: legend entry of this run beside others; the name of its scenario by default.
            file: file to write: .png, .pdf or .svg. An existing one is replaced.

        Returns:
            Matplotlib figure.

        Raises:
            InputError: the run has fewer than two samples, a name is unknown, or the panels do not fit the size.
            ConfigurationError: the file has another ending.
        """
        from rnc_pin.figures.style import save  # Matplotlib takes a second to import
        from rnc_pin.simulation.run_figure import plot_run

        figure = plot_run(self, outputs, title, comparisons or {}, size, labels or {}, name)
        if file is not None:
            save(figure, file)
        return figure

    def export(self, file: str | Path, arrays: Sequence[str] | None = None) -> None:
        """Write the run as a table for other programs. An existing file is replaced.

        There is one header per column, such as ``x2.tip_x [m]``: array, name and unit. ``save`` writes arrays.

        Args:
            file: name that ends in .csv.
            arrays: names of the arrays, such as ``["x2", "T"]``; ``time`` is always written. All by default.

        Raises:
            ConfigurationError: the file has another ending.
            InputError: unknown array.
        """
        export_run(self, file, arrays)

    def _summary(self) -> ObjectSummary:
        from rnc_pin.simulation.summary import add_verdict, summarize  # a run alone starts without it

        found = summarize(self)
        with suppress(RncError):  # samples that nothing can judge print their outcome
            add_verdict(found, self.verdict)
        return cast("PrintedSummary", found).summary_of("Trajectory")


def export_run(run: RunData, path: str | Path, arrays: Sequence[str] | None = None, replace: bool = True) -> Path:
    """Write the arrays of a run as ``Trajectory.export`` does. An error leaves no partial file.

    Args:
        run: the run.
        path: name of the file.
        arrays: names of the arrays; all by default.
        replace: True replaces an existing file.

    Raises:
        ConfigurationError: the name has another ending than .csv.
        InputError: unknown array.
        OSError: the file cannot be written.
    """
    path = Path(path)
    if path.suffix != ".csv":
        raise ConfigurationError(f"{path}: expected a name that ends in .csv")
    known = list(run.arrays)
    chosen = known if arrays is None else ["time", *(name for name in arrays if name != "time")]
    for name in chosen:
        place_of(name, known, "arrays: the run has no", InputError)
    headers = [
        f"{name}{each.name and '.' + each.name}{each.unit and f' [{each.unit}]'}"
        for name in chosen
        for each in columns_of_array(run, name)
    ]
    with atomic_file(path, replace) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        # By the library: names of a user's outputs may have commas and quotes.
        csv.writer(file, lineterminator="\n").writerow(headers)
        # 17 digits give every float back to the bit.
        np.savetxt(file, np.column_stack([getattr(run, name) for name in chosen]), fmt="%.17g", delimiter=",")
    return path
