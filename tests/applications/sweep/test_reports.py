"""Reports of a sweep: panels of its picture, results in words, shares of findings over what was drawn, quantiles."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin import visualization
from rnc_pin.applications.sweep.reports import quantiles


def test_shares_have_bins_of_many_runs_and_no_seeds(tmp_path, monkeypatch):
    """Short runs with a tolerance of almost zero: all of them miss their goals."""
    options = {"simulation.duration": 0.02, "simulation.dt": 0.01, "goal_tolerance": 1e-12}
    draws = {"initial.q.joint_2": [1.5, 2.0], "faults.position_bias": [0.0, 1e-3]}
    results = rnc.sweep("space-robot", rnc.Draws(12, draws), out=tmp_path / "out", options=options)
    assert "seed" in results.drawn
    drawn = []
    draw = visualization.plot_distributions
    monkeypatch.setattr(
        visualization, "plot_distributions", lambda panels, *more: (drawn.extend(panels), draw(panels, *more))[1]
    )
    figure = results.plot(file=tmp_path / "picture.png")
    assert figure.get_figwidth() == pytest.approx(10.0)  # for the screen: three panels side by side
    assert results.plot(size="column").get_figwidth() == 3.4
    with pytest.raises(rnc.InputError, match=r"panels need a height of [\d.]+ inches"):
        results.plot(size=(7.0, 1.0))
    panels = {panel.name: panel for panel in drawn}
    assert {"final error of tip_x [m or rad]", "smallest singular value of E", *draws} <= set(panels)
    assert {name for name, panel in panels.items() if panel.shares} == set(draws)
    for name in draws:
        assert len(panels[name].edges) == 5  # twelve runs are too few for more bins
        assert list(panels[name].counts) == ["failed: goal"]
        assert np.sum(panels[name].counts["failed: goal"]) == 12
    assert (tmp_path / "picture.png").stat().st_size > 10_000


def test_quantiles_are_of_all_chunks_without_missing_numbers(tmp_path):
    values = np.random.default_rng(0).normal(size=2000)
    some = np.insert(values, [0, 5, 5], np.nan)
    fractions = (0.0, 0.01, 0.5, 0.95, 1.0)
    assert quantiles(np.array_split(some, 7), fractions, tmp_path) == np.quantile(values, fractions).tolist()
    assert quantiles([np.full(3, np.nan)], fractions, tmp_path) is None
    assert not any(tmp_path.iterdir())
