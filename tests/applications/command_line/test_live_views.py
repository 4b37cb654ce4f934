"""``--show`` and ``drive`` of robots with coupled joints: a live view has a copy of the model, made by pickling.

Coupled joints once held a joint model of Pinocchio, which cannot be pickled.
"""

import json

import numpy as np
import pytest
import yaml

import rnc_pin as rnc
from rnc_pin.applications.scenario.pictures import Drawn

INERTIA = '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
BOX = '<visual><geometry><box size="0.2 0.1 0.1"/></geometry></visual>'


def link(name):
    return f'<link name="{name}">{INERTIA}{BOX}</link>'


def joint(name, parent, child, place="0 0 0", more=""):
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{place}"/><axis xyz="0 0 1"/>'
    return f'<joint name="{name}" type="continuous">{ends}{more}</joint>'


def hand(more=""):
    fingers = joint("a", "palm", "finger_a"), joint("b", "palm", "finger_b", "0 0.2 0", more)
    return f'<robot name="hand">{link("palm")}{link("finger_a")}{link("finger_b")}{"".join(fingers)}</robot>'


FINGERS = {
    "robot": {"urdf": "r.urdf"},
    "actuators": ["a"],
    "outputs": {"reducing": [{"joint": "a"}]},
    "reference": {"primary": {"harmonic": {"amplitude": [0.02], "frequency": [1.0], "ramp": 0.05}}},
}
SETTINGS = {"controller": {"type": "reducing_outputs"}, "simulation": {"duration": 0.1, "dt": 0.01}}


@pytest.fixture(autouse=True)
def no_wait_for_a_browser(monkeypatch):
    monkeypatch.setattr("rnc_pin.visualization.live.LiveView.wait_for_browser", lambda *_: None)


def test_a_run_and_a_replay_with_coupled_joints_can_be_watched(call, tmp_path, monkeypatch, no_pictures):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "r.urdf").write_text(hand('<mimic joint="a" multiplier="-2"/>'))
    (tmp_path / "r.yaml").write_text(yaml.safe_dump({**FINGERS, **SETTINGS}))
    watched = "--show", "--no-browser", "--speed", 0
    status, _, said = call("run", "r.yaml", *watched, "--out", "out")
    assert "http://127.0.0.1:" in said
    assert status == 0, said
    q = rnc.Trajectory.load(tmp_path / "out" / "trajectory.npz").q
    a, b = (np.arctan2(q[:, k + 1], q[:, k]) for k in (0, 2))  # continuous joints are cosines and sines
    assert np.abs(b + 2 * a).max() < 1e-6
    assert np.abs(a).max() > 1e-3
    status, _, said = call("replay", "out", *watched)
    assert "http://127.0.0.1:" in said
    assert (status, "error" in said) == (0, False), said


def test_a_hand_with_mimic_joints_can_be_driven(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rnc_pin.applications.command_line.report.draw_pictures", lambda *_: Drawn())
    fast = "--no-browser", "--set", "simulation.dt=0.02"
    status, out, said = call("drive", "panda", *fast, "--duration", 0.1, "--out", "out", "--json")
    assert status == 0, said
    assert "http://127.0.0.1:" in said
    assert json.loads(out)["outcome"] == "completed"
    q = rnc.Trajectory.load(tmp_path / "out" / "trajectory.npz").q
    assert np.abs(q[:, -1] - q[:, -2]).max() < 1e-9  # both fingers
