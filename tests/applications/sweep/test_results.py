"""Results of a sweep: columns, statistics, and panels of its picture."""

import csv
import json
import math

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin import visualization
from rnc_pin.applications.sweep.results import sweep_statistics


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


def test_columns_and_statistics_of_rows_with_different_values(tmp_path):
    rows = [
        {"run": 2, "a": 1.5, "n": 3, "b": True, "what": [1, 2], "verdict": "failed", "finding": "goal"},
        {"run": 0, "a": 0.1, "n": None, "b": False, "redrawn": 4},
        {"run": 1, "a": 1, "n": 2, "b": True, "redrawn": 1, "final_error.x": 0.25},
    ]
    common = {"outcome": "completed", "verdict": "succeeded", "finding": "", "message": "a, b"}
    (tmp_path / "runs.jsonl").write_text("".join(json.dumps({**common, **row}) + "\n" for row in rows))
    (tmp_path / "specification.json").write_text('{"runs": 4, "build": "f"}')
    results = rnc.load_sweep(tmp_path)
    assert (len(results), results.complete) == (3, False)
    assert (results["run"].tolist(), results["a"].tolist()) == ([0, 1, 2], [0.1, 1.0, 1.5])
    assert results["n"].tolist() == pytest.approx([math.nan, 2.0, 3.0], nan_ok=True)
    assert (results["b"].dtype, results["what"].tolist()) == (bool, [None, None, [1, 2]])
    assert (results.drawn, results.verdicts) == (["a", "n", "b", "what"], {"succeeded": 2, "goal": 1})
    assert [row["run"] for row in results.failures()] == [2]
    found = sweep_statistics(results)
    assert (found["redrawn"], found["final_error"]) == (5, {"x": {"median": 0.25, "95 %": 0.25, "max": 0.25}})
    results.to_csv(tmp_path / "all.csv")
    with (tmp_path / "all.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert [row["a"] for row in table] == ["0.1", "1", "1.5"]
    assert (table[0]["n"], table[2]["what"], table[2]["message"]) == ("", "[1, 2]", "a, b")
    with pytest.raises(rnc.InputError, match="no column 'vedict'; did you mean 'verdict'"):
        results["vedict"]
    with pytest.raises(rnc.InputError, match="no finished run 3"):
        results.row(3)
