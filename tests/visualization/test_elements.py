"""Forces of constraints that act during a part of a run, as pages draw them."""

from dataclasses import replace

import numpy as np

from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.visualization.browser.scene_server import SceneWindow
from rnc_pin.visualization.drawn_state import RATE, View, recorded_states
from rnc_pin.visualization.meshcat_scene import MeshcatScene
from rnc_pin.visualization.run_scene import RunScene
from urdf_parts import write

DROP = """
robot: {urdf: rolling_ball.urdf, base: free}
contacts:
  - {constraint: {rolling_ball: {frame: ball, radius: 0.2}}}
outputs:
  reducing:
    - frame_speed: {frame: ball, axis: x}
    - frame_speed: {frame: ball, axis: y}
    - frame_speed: {frame: ball, axis: z}
    - frame_angular_velocity: {frame: ball, axis: x}
    - frame_angular_velocity: {frame: ball, axis: y}
    - frame_angular_velocity: {frame: ball, axis: z}
initial: {q: {root_joint: [0.5, 0, 0.3, 0, 0, 0, 1]}}
simulation: {duration: 0.4, dt: 0.02}
"""


def test_ground_carries_a_ball_after_its_landing(tmp_path):
    """No force in flight; then the weight of 1 kg, upwards at the contact point. The scene has a layer for it."""
    prepared = Scenario.load(str(write(tmp_path / "drop.yaml", DROP))).build()
    run = execute(prepared).trajectory
    drawn = prepared.experiment.drawn_model
    states = list(recorded_states(drawn.robot, run))
    for model, layers in ((replace(drawn, switching=()), 0), (drawn, 1)):
        scene = RunScene(model, run.info, View(), MeshcatScene(SceneWindow("drop"), RATE), states[0], run)
        assert [line["label"] for line in scene.legend()].count("constraint force") == layers
        scene.update(states[-1])
    (arrows,) = [each for each in scene.elements if each.entry.label == "constraint force"]
    newton = np.abs(run.multipliers).max() / (0.7 * scene.size)  # the longest arrow is 0.7 of the robot
    total = [newton * arrows.vectors(state)[1].sum(axis=0) for state in (states[0], states[-1])]
    np.testing.assert_allclose(total, [[0, 0, 0], [0, 0, 9.81]], atol=1e-9)
    np.testing.assert_allclose(arrows.vectors(states[-1])[0], [[0.5, 0, 0]] * arrows.count, atol=1e-9)
