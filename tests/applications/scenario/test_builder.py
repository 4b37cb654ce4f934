"""Plants of scenario files: contacts that open and close."""

from pathlib import Path

import numpy as np

import rnc_pin as rnc
from refusals import refused
from rnc_pin.applications.scenario.builder import build_experiment
from rnc_pin.applications.scenario.schema.scenario import validate

AXES = [{"frame": "ball", "axis": axis} for axis in "xyz"]
BALL = {
    "robot": {"urdf": "rolling_ball.urdf", "base": "free"},
    "contacts": [{"constraint": {"rolling_ball": {"frame": "ball", "radius": 0.2}}, "restitution": 0.5}],
    "outputs": {"reducing": [{kind: each} for kind in ("frame_speed", "frame_angular_velocity") for each in AXES]},
    "initial": {"q": {"root_joint": [0, 0, 0.5, 0, 0, 0, 1]}},
    "simulation": {"duration": 0.6, "dt": 0.02},
}


def test_ball_bounces_on_a_slope():
    """The ground of the file is that of the contacts: along the normal it falls with ``g cos(slope)``."""
    slope, e = 0.2, 0.5
    normal = [float(np.sin(slope)), 0.0, float(np.cos(slope))]
    built = build_experiment(validate({**BALL, "ground": {"plane": {"normal": normal}}}, "ball.yaml"), Path())
    assert isinstance(built.plant, rnc.ContactPlant)
    run = rnc.simulate(built.reduced, built.controller, built.q0, 0.6, 0.02, plant=built.plant)
    g = 9.81 * np.cos(slope)
    fall = np.sqrt(2 * (0.5 * np.cos(slope) - 0.2) / g)
    starts = [phase.start for phase in run.info.phases[:3]]
    np.testing.assert_allclose(starts, [0.0, fall, fall * (1 + 2 * e)], rtol=1e-6)


test_refusals = refused([
    ({"plant": "mujoco"}, "plant: 'mujoco' does not support 'contacts'"),
    ({"faults": {"masses": 0.1}}, "faults: do not support 'contacts'"),
    ({"simulation": {"duration": 1.0, "on_lift_off": "stop"}}, "on_lift_off: 'contacts' lift off by themselves"),
    ({"contacts": [{"constraint": {"no_side_slip": {"frame": "ball"}}}]}, "NoSideSlip: .* found 0 height rows"),
    ({"contacts": [{"constraint": {"rolling_ball": {"frame": "ball", "radius": 0.2}}, "restitution": 2}]}, "to 1"),
], lambda changes: build_experiment(validate({**BALL, **changes}, "ball.yaml"), Path()),
    rnc.ConfigurationError)  # fmt: skip
