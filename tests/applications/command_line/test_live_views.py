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


def fixed(name, parent, child, place="0 0 0"):
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{place}"/>'
    return f'<link name="{child}"/><joint name="{name}" type="fixed">{ends}</joint>'


def hand(more=""):
    fingers = joint("a", "palm", "finger_a"), joint("b", "palm", "finger_b", "0 0.2 0", more)
    return f'<robot name="hand">{link("palm")}{link("finger_a")}{link("finger_b")}{"".join(fingers)}</robot>'


CAR = "".join(
    [
        '<robot name="car">',
        *map(link, ("chassis", "left_wheel", "right_wheel")),
        joint("left", "chassis", "left_wheel", "1.5 0.5 0"),
        joint("right", "chassis", "right_wheel", "1.5 -0.5 0"),
        fixed("axle_joint", "chassis", "axle"),
        "</robot>",
    ]
)
FINGERS = {
    "actuators": ["a"],
    "outputs": {"reducing": [{"joint": "a"}]},
    "reference": {"primary": {"harmonic": {"amplitude": [0.02], "frequency": [1.0], "ramp": 0.05}}},
}
SCENARIOS = {
    "mimic joint": (hand('<mimic joint="a" multiplier="-2"/>'), {**FINGERS, "robot": {"urdf": "r.urdf"}}),
    "joint coupling": (
        hand(),
        {
            **FINGERS,
            "robot": {"urdf": "r.urdf"},
            "constraints": [{"joint_coupling": {"joint": "b", "driver": "a", "ratio": -2.0}}],
        },
    ),
    "Ackermann steering": (
        CAR,
        {
            "robot": {"urdf": "r.urdf", "base": "planar"},
            "constraints": [
                {"no_side_slip": {"frame": "axle"}},
                {"no_side_slip": {"frame": "left_wheel"}},
                {"ackermann": {"left": "left", "right": "right", "axle": "axle"}},
            ],
            "actuators": [{"force": {"frame": "axle", "axis": "x"}}, "left"],
            "outputs": {"reducing": [{"frame_speed": {"frame": "axle", "axis": "x"}}, {"joint": "left"}]},
            "reference": {"primary": {"harmonic": {"amplitude": [0.0, 0.02], "frequency": [1.0, 1.0], "ramp": 0.05}}},
        },
    ),
}
SETTINGS = {"controller": {"type": "reducing_outputs"}, "simulation": {"duration": 0.1, "dt": 0.01}}


@pytest.fixture(autouse=True)
def no_wait_for_a_browser(monkeypatch):
    monkeypatch.setattr("rnc_pin.visualization.live.LiveView.wait_for_browser", lambda *_: None)


def residual(kind, trajectory):
    """Distance of the coupled joints from their closed form, and how far the first of them moved."""
    q = trajectory.q
    if kind != "Ackermann steering":  # continuous joints are cosines and sines
        a, b = (np.arctan2(q[:, k + 1], q[:, k]) for k in (0, 2))
        return np.abs(b + 2 * a).max(), np.abs(a).max()
    left, right = (np.arctan2(q[:, k + 1], q[:, k]) for k in (4, 6))
    return np.abs(np.sin(left - right) - np.sin(left) * np.sin(right) / 1.5).max(), np.abs(left).max()


@pytest.mark.parametrize("kind", SCENARIOS)
def test_a_run_and_a_replay_with_coupled_joints_can_be_watched(kind, call, tmp_path, monkeypatch, no_pictures):
    urdf, scenario = SCENARIOS[kind]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "r.urdf").write_text(urdf)
    (tmp_path / "r.yaml").write_text(yaml.safe_dump({**scenario, **SETTINGS}))
    watched = "--show", "--no-browser", "--speed", 0
    status, _, said = call("run", "r.yaml", *watched, "--out", "out")
    assert "http://127.0.0.1:" in said
    assert status == 0, said
    error, moved = residual(kind, rnc.Trajectory.load(tmp_path / "out" / "trajectory.npz"))
    assert error < 1e-6
    assert moved > 1e-3
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
