"""The layout of a figure has room for its labels."""

import matplotlib as mpl
import numpy as np

from rnc_pin.figures.style import STYLE, PrintFigure, save


def test_labels_have_room_if_the_layout_makes_tick_labels_wider(tmp_path):
    """In its final height the lower axes has ticks at each quarter, with two decimals in place of one."""
    with mpl.rc_context(STYLE):
        figure = PrintFigure((8.0, 4.7))
        upper, lower = figure.subplots(2, 1, sharex=True)
        time = np.linspace(0.0, 8.0, 50)
        upper.plot(time, time / 8)
        lower.plot(time, 1.29 * np.sin(time / 2.6) ** 2 - 0.19)
        upper.set_title("title")
        for axes in (upper, lower):
            axes.set_ylabel("position [m]")
        lower.set_xlabel("time [s]")
        figure.align_ylabels([upper, lower])
        save(figure, tmp_path / "figure.png")
        left = [axes.yaxis.label.get_window_extent().x0 for axes in (upper, lower)]
    assert left[0] == left[1] > 0.0
