"""The measured tricycle: its log, which is no part of the project, and its nominal robot."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

import rnc_pin as rnc
from rnc_pin.lab.calibration import EncoderOffset, EncoderScale, JointShift, SensorPlace, TimeShift, WheelRadius

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
            "position": {"column": 4, "ticks": 5000, "wrap": 4294967296, "scale": 0.0106141 / (2 * np.pi * RADIUS)}
        },
    },
    "frames": {"laser": {"x": 10, "y": 11, "yaw": 12}},
}
TRICYCLE = """<robot name="tricycle">
<link name="base"><inertial><mass value="100"/>
<inertia ixx="10" iyy="10" izz="10" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="laser"/><joint name="mount" type="fixed"><parent link="base"/><child link="laser"/>
<origin xyz="1.5 0 1"/></joint>
<link name="fork"><inertial><mass value="5"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
</link>
<joint name="steering" type="continuous"><parent link="base"/><child link="fork"/><origin xyz="1.4 0 0.1"/>
<axis xyz="0 0 1"/></joint>
<link name="front"><inertial><mass value="5"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
</link>
<joint name="traction" type="continuous"><parent link="fork"/><child link="front"/><axis xyz="0 1 0"/></joint>
</robot>"""
"""The nominal tricycle of the log: wheelbase 1.4 m, laser 1.5 m ahead of the rear axle."""
UNKNOWN = (
    EncoderScale("steering"),
    EncoderOffset("steering"),
    WheelRadius("front"),
    JointShift("steering", "x"),
    SensorPlace("x"),
    SensorPlace("y"),
)
"""Parameters of the tricycle."""
DELAYS = (TimeShift("steering"), TimeShift())
"""Delays of the steering encoder and of the tracker."""


def tricycle_system(folder: Path) -> rnc.NonholonomicSystem:
    """The nominal tricycle: a steered and driven front wheel, and no side slip of the rear axle."""
    path = folder / "tricycle.urdf"
    path.write_text(TRICYCLE)
    robot = rnc.Robot.from_urdf(path, base="planar")
    return rnc.NonholonomicSystem(robot, [rnc.RollingWheel("front", RADIUS), rnc.NoSideSlip("base")])
