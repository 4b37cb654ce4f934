"""Result of a run: its signals, figures and files for other programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rnc_pin.simulation.run_data import RunData

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rnc_pin.figures import Size


class Trajectory(RunData):
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
        from rnc_pin.simulation.export import export_run

        export_run(self, file, arrays)
