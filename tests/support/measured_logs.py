"""The measured tricycle: its log, which is no part of the project, and its nominal robot."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

import rnc_pin as rnc
from rnc_pin.lab.calibration import EncoderOffset, EncoderScale, JointShift, SensorPlace, TimeShift, WheelRadius
from urdf_parts import joint, link, read

MEASURED = Path(os.environ.get("RNC_PIN_LOGS", Path(__file__).parents[3] / "shared" / "data" / "logs"))
"""Folder of measured logs, which are no part of the project."""
RADIUS = 0.1
"""Nominal radius of the tricycle's wheel [m]. Its log tells only the way for a turn of the encoder."""
COLUMNS = {
    "separator": "space",
    "time": 1,
    "joints": {
        "steering": {"position": {"column": 3, "ticks": 8192, "wrap": 8192, "scale": 0.1}},
        "traction": {
            "position": {"column": 4, "ticks": 5000, "wrap": 2**32, "scale": 0.0106141 / (2 * np.pi * RADIUS)}
        },
    },
    "frames": {"laser": {"x": 10, "y": 11, "yaw": 12}},
}
UNKNOWN = (EncoderScale("steering"), EncoderOffset("steering"), WheelRadius("front"), JointShift("steering", "x"),
           SensorPlace("x"), SensorPlace("y"))  # fmt: skip
"""Parameters of the tricycle."""
DELAYS = (TimeShift("steering"), TimeShift())
"""Delays of the steering encoder and of the tracker."""


def tricycle_system(folder: Path) -> rnc.NonholonomicSystem:
    """The nominal tricycle: wheelbase 1.4 m, laser 1.5 m ahead of the rear axle, which does not slip."""
    parts = [link("base", 100), link("fork", 5), link("front", 5), '<link name="laser"/>']
    parts += [joint("mount", "base", "laser", (1.5, 0, 1), kind="fixed"), joint("traction", "fork", "front")]
    parts += [joint("steering", "base", "fork", (1.4, 0, 0.1), "0 0 1")]
    robot = read(folder / "tricycle.urdf", *parts, base="planar")
    return rnc.NonholonomicSystem(robot, [rnc.RollingWheel("front", RADIUS), rnc.NoSideSlip("base")])
