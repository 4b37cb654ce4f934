"""Motions of loops stay away from their dead centres, and loops do not start there."""

import numpy as np
import pytest
import yaml

from rnc_pin.applications.init import DraftOptions, draft
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario

pytest.importorskip("mujoco", reason="mujoco is an optional extra and not installed")
pytestmark = pytest.mark.usefixtures("brief")  # the runs below are whole

BEAM = '<geom type="capsule" fromto="0 0 0 {}" size="0.01"/>'


def four_bar(angle, motor, lengths=(0.1, 0.3, 0.2, 0.3), sense=1, rocker=""):
    """A crank, a coupler and a rocker in the plane x, z.

    Args:
        angle: angle of the crank in the file [rad], where its joints are at zero.
        motor: joint with a motor.
        lengths: crank, coupler, rocker, and distance of the two bearings [m].
        sense: -1 to turn the axes of crank and rocker.
        rocker: more attributes of the rocker's joint.
    """
    crank, coupler, arm, apart = lengths
    tip = crank * np.array([np.cos(angle), np.sin(angle)])
    diagonal = np.array([apart, 0.0]) - tip
    length = np.linalg.norm(diagonal)
    elbow = np.arccos(np.clip((coupler**2 + length**2 - arm**2) / (2 * coupler * length), -1, 1))
    along = np.arctan2(diagonal[1], diagonal[0]) + elbow
    beam = coupler * np.array([np.cos(along), np.sin(along)])
    end = tip + beam - [apart, 0.0]
    tip, beam, end = (f"{x:.12g} 0 {z:.12g}" for x, z in (tip, beam, end))
    axis = f'axis="0 {-sense} 0"'
    return (
        '<mujoco model="four_bar"><compiler angle="radian"/><worldbody>'
        f'<body name="crank"><joint name="crank" {axis}/>{BEAM.format(tip)}'
        f'<body name="coupler" pos="{tip}"><joint name="coupler" axis="0 -1 0"/>{BEAM.format(beam)}</body></body>'
        f'<body name="rocker" pos="{apart} 0 0"><joint name="rocker" {axis} {rocker}/>{BEAM.format(end)}</body>'
        f'</worldbody><equality><connect body1="coupler" body2="rocker" anchor="{beam}"/></equality>'
        f'<actuator><motor joint="{motor}"/></actuator></mujoco>'
    )


def drafted(text, folder):
    (folder / "loop.xml").write_text(text)
    written = draft(str(folder / "loop.xml"), folder, DraftOptions())
    (folder / "loop.yaml").write_text(written)
    run = execute(Scenario.load(str(folder / "loop.yaml"), {"simulation.dt": 0.01})).trajectory
    assert run.verdict.succeeded
    return written.replace("\n# ", " "), yaml.safe_load(written), run


@pytest.mark.parametrize("angle", [0.3, 0.7, 0.9])
def test_a_motion_turns_away_from_the_dead_centre(angle, tmp_path):
    """The rocker turns back where crank and coupler are in line, at 0.505 rad of the crank; the run diverged there."""
    text, content, run = drafted(four_bar(angle, "rocker", sense=-1), tmp_path)
    assert content["reference"]["primary"]["minimum_jerk"]["by"] == [-0.2]
    assert run.x2[-1, 0] - run.x2[0, 0] == pytest.approx(-0.2, abs=1e-3)
    assert "its loop ends" not in text


def test_a_loop_with_little_room_moves_little(tmp_path):
    """A dead centre is 0.02 rad ahead of the crank, and a limit of the rocker behind it."""
    folded = np.pi / 3 - 0.02
    text, content, run = drafted(four_bar(folded, "crank", (0.3, 0.1, 0.2, 0.3), rocker='range="-0.01 0.5"'), tmp_path)
    (step,) = content["reference"]["primary"]["minimum_jerk"]["by"]
    assert 0.005 < step < 0.02
    assert f"crank moves by {step:g} only: its loop ends at a dead centre" in text
    assert run.q[:, 2].min() > -0.01


def test_a_loop_that_is_drawn_at_a_dead_centre_of_its_motor_starts_beside_it(tmp_path):
    in_line = np.arccos((0.4**2 + 0.3**2 - 0.2**2) / (2 * 0.4 * 0.3))
    text, content, run = drafted(four_bar(in_line, "rocker"), tmp_path)
    assert content["task"]["primary"] == ["rocker"]
    assert abs(content["initial"]["q"]["crank"]) > 0.1
    assert "loops start where rocker can move them: the file draws a dead centre" in text
    assert run.position_residual.max() < 1e-8


def test_a_loop_far_from_its_dead_centres_moves_as_usual(tmp_path):
    text, content, _ = drafted(four_bar(1.5, "crank"), tmp_path)
    assert content["reference"]["primary"]["minimum_jerk"]["by"] == [0.2]
    assert "loop" not in text.partition("title:")[0]
    assert "initial" not in content or not content["initial"]["q"]
