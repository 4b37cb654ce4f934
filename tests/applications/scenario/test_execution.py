"""A run, its comparisons and its pictures, one after the other, in the forms that the scenario states."""

import re
import signal

import pytest

import rnc_pin as rnc
from refusals import refused
from rnc_pin.applications.scenario.execution import draw_pictures, execute, picture_names
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.simulation import Outcome

QUICK = {"simulation.duration": 0.1}


def test_comparisons_follow_the_run_and_their_progress_adds_up():
    shown = []
    prepared = Scenario.load("space-robot", QUICK).build()
    result = execute(prepared, progress=lambda done, name: shown.append((done, name)))
    (label,) = result.comparisons
    assert (result.summary["comparisons"].keys(), shown) == ({label}, sorted(shown, key=lambda each: each[0]))
    assert [name for _, name in (shown[0], shown[-1])] == ["space-robot", f"space-robot: {label}"]
    assert shown[-1][0] == pytest.approx(prepared.total_duration)


def test_no_comparison_follows_one_that_is_interrupted():
    comparisons = {name: {"controller.type": "reducing_outputs"} for name in ("first", "second")}
    prepared = Scenario.load("space-robot", {**QUICK, "comparisons": comparisons}).build()

    def interrupt(done, name):
        if name.endswith("first") and done > 0.15:
            signal.raise_signal(signal.SIGINT)

    result = execute(prepared, progress=interrupt)
    assert result.interrupted
    assert list(result.comparisons) == ["first"]
    assert result.comparisons["first"].outcome is Outcome.INTERRUPTED


def test_pictures_are_those_that_are_promised(tmp_path):
    prepared = Scenario.load("space-robot", {**QUICK, "plots": {}, "comparisons": {}}).build()
    drawn = draw_pictures(prepared, execute(prepared), tmp_path)
    assert drawn.written == [name for name in picture_names(prepared) if name in drawn.written]
    assert {path.name for path in tmp_path.iterdir()} == set(drawn.written) >= {"overview.png", "animation.html"}
    assert not drawn.failures


SHORT = ["--set", "simulation.duration=0.1", "--set", "comparisons={}"]
MEDIA_BOX = re.compile(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+) ?\]")


def test_a_run_keeps_its_vector_pictures(call, tmp_path, request):
    """One plot as PDF for a column, the others as SVG; texts of SVG files are texts."""
    options = (
        "figures.formats=[svg]",
        "figures.labels={platform: $\\phi$, time: t, joint_1: first}",
        "plots={angle: {outputs: [platform, inputs], formats: [pdf, png], size: column}}",
    )
    arguments = [each for option in options for each in ("--set", option)]
    status, _, error = call("run", "space-robot", *SHORT, *arguments, "--out", tmp_path / "out")
    assert (status, "drawn" in error) == (0, False)
    names = {path.name for path in (tmp_path / "out").iterdir() if path.suffix in (".png", ".pdf", ".svg")}
    assert names == {"angle.pdf", "angle.png", "overview.svg", "top_view.svg", "limits.svg"}
    width, _ = MEDIA_BOX.search((tmp_path / "out" / "angle.pdf").read_bytes()).groups()
    assert float(width) == pytest.approx(3.4 * 72.0)
    overview = (tmp_path / "out" / "overview.svg").read_text()
    assert ">first</text>" in overview
    assert ">t [s]</text>" in overview
    request.getfixturevalue("no_pictures")
    status, _, error = call("run", "space-robot", *SHORT, *arguments, "--out", tmp_path / "out")
    assert (status, "did not create" in error) == (0, False)  # it removes its own files
    assert not (tmp_path / "out" / "overview.svg").exists()


test_other_forms_are_refused = refused([
    ({"figures.size": "colum"}, "figures.size: size 'colum': .*did you mean 'column'"),
    ({"figures.size": [3.4]}, "figures.size: size .3.4,.: expected"),
    ({"figures.formats": ["eps"]}, "figures.formats.0.: expected 'png', 'pdf' or 'svg', found 'eps'"),
    ({"figures.formats": []}, "figures.formats: expected at least 1 item"),
], lambda changes: Scenario.load("space-robot", changes).build(), rnc.ConfigurationError)  # fmt: skip
