"""Calibration from logs: coverage of the standard deviations, time and memory, and a real tricycle.

    python -m benchmarks logs                       # 200 noisy logs of each vehicle
    python -m benchmarks logs --draws 20 --vehicle tricycle

The tricycle is measured if its log is there: ``../shared/data/logs/tricycle``, or the folder in RNC_PIN_LOGS.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
import tracemalloc
from pathlib import Path

import numpy as np

import rnc_pin as rnc
from benchmarks.rolled_logs import TRAILER, VEHICLES, Vehicle
from rnc_pin.identification import (
    EncoderOffset,
    EncoderScale,
    JointShift,
    SensorPlace,
    TimeShift,
    WheelRadius,
)

MEASURED = Path(os.environ.get("RNC_PIN_LOGS", Path(__file__).parents[2] / "shared" / "data" / "logs"))
"""Folder of measured logs, which are no part of the project."""
TURNS = 3.0
"""Standard deviations within which the true parameters have to be."""
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


def coverage(vehicle: Vehicle, draws: int) -> tuple[int, np.ndarray]:
    """Logs whose true parameters are all within three standard deviations, and the deviations (draws, P)."""
    true = np.array(list(vehicle.true.values()))
    with tempfile.TemporaryDirectory() as folder:
        system = vehicle.system(Path(folder))
        # Logs that hardly show a combination count too, e.g. those with little steering.
        limit = {"resolution": np.inf}
        found = [rnc.calibrate(system, vehicle.log(seed), vehicle.unknown, "sensor", **limit) for seed in range(draws)]
    sizes = np.array([(each.values - true) / each.std for each in found])
    return int(np.sum((np.abs(sizes) < TURNS).all(axis=1))), sizes


def long_log(duration: float = 2000.0) -> tuple[float, rnc.Calibration]:
    """Processor time [s] of a calibration of 12 parameters from 100,000 samples of each of three encoders."""
    unknown = [
        *TRAILER.unknown,
        SensorPlace("yaw"),
        TimeShift(),
        TimeShift("steer_joint"),
        EncoderScale("steer_joint"),
        EncoderScale("hitch_joint"),
        EncoderOffset("hitch_joint"),
    ]
    log = TRAILER.log(0, duration)
    with tempfile.TemporaryDirectory() as folder:
        system = TRAILER.system(Path(folder))
        begin = time.process_time()
        found = rnc.calibrate(system, log, unknown, "sensor")
        return time.process_time() - begin, found


def reading(samples: int, folder: Path) -> dict[str, tuple[float, float, float]]:
    """Processor time [s], peak of the memory and size of the log [MB] of reading 4 columns of files of 8."""
    import pyarrow
    from pyarrow import parquet

    generator = np.random.default_rng(0)
    table = np.column_stack([np.arange(samples) * 1e-3, generator.normal(size=(samples, 7))])
    names = ["time", *"abcdefg"]
    np.savetxt(folder / "log.csv", table, "%.9g", ",", header=",".join(names), comments="")
    np.savez(folder / "log.npz", **dict(zip(names, table.T, strict=True)))
    parquet.write_table(pyarrow.table(dict(zip(names, table.T, strict=True))), folder / "log.parquet")
    _write_mcap(folder / "mcap", table)
    columns = {"joints": {name: {"position": name} for name in "abc"}}
    topics = {"topics": {"/joint_states": {"joints": "all"}}}
    found = {}
    for name, keys in (("log.csv", columns), ("log.npz", columns), ("log.parquet", columns), ("mcap", topics)):
        begin = time.process_time()
        log = rnc.Log.read(folder / name, keys)
        seconds = time.process_time() - begin
        tracemalloc.start()
        rnc.Log.read(folder / name, keys)
        found[name] = seconds, tracemalloc.get_traced_memory()[1] / 1e6, log.size / 1e6
        tracemalloc.stop()
    return found


def _write_mcap(path: Path, table: np.ndarray) -> None:
    """A ROS 2 bag with three joints in each JointState."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    state, header, clock = (
        store.types[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        for row in table:
            stamp = round(row[0] * 1e9)
            stamped = header(stamp=clock(stamp // 10**9, stamp % 10**9), frame_id="")
            message = state(stamped, list("abc"), row[1:4].copy(), np.array([]), np.array([]))
            writer.write(topic, stamp, store.serialize_cdr(message, state.__msgtype__))


def tricycle_system(folder: Path) -> rnc.NonholonomicSystem:
    """The nominal tricycle: a steered and driven front wheel, and no side slip of the rear axle."""
    path = folder / "tricycle.urdf"
    path.write_text(TRICYCLE)
    robot = rnc.Robot.from_urdf(path, base="planar")
    return rnc.NonholonomicSystem(robot, [rnc.RollingWheel("front", RADIUS), rnc.NoSideSlip("base")])


def tricycle(delays: bool, held_out: float) -> rnc.Calibration:
    """Calibration of the real tricycle."""
    with tempfile.TemporaryDirectory() as folder:
        log = rnc.Log.read(MEASURED / "tricycle" / "dataset.txt", COLUMNS)
        unknown = (*UNKNOWN, *(DELAYS if delays else ()))
        return rnc.calibrate(tricycle_system(Path(folder)), log, unknown, "laser", held_out=held_out)


def main() -> None:
    """Print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=200, help="noisy logs of each vehicle")
    parser.add_argument("--vehicle", choices=VEHICLES, action="append", help="this vehicle only; may be repeated")
    parser.add_argument("--samples", type=int, default=10**6, help="samples of the files that are read")
    chosen = parser.parse_args()
    for name in chosen.vehicle or VEHICLES:
        inside, sizes = coverage(VEHICLES[name], chosen.draws)
        print(f"{name}: all parameters within {TURNS:g} standard deviations in {inside} of {chosen.draws} logs; root "
              f"mean square of deviations {np.sqrt(np.mean(sizes**2)):.2f}", flush=True)  # fmt: skip
    if chosen.vehicle:
        return
    with tempfile.TemporaryDirectory() as folder:
        for name, (seconds, peak, size) in reading(chosen.samples, Path(folder)).items():
            memory = f"{peak:.0f} MB while reading, {size:.0f} MB after it"
            print(f"{name}: {chosen.samples:,} samples of three joints in {seconds:.1f} s, {memory}", flush=True)
    seconds, found = long_log()
    print(f"{found.names and len(found.names)} parameters from 100,000 samples: {seconds:.1f} s of processor time")
    if not (MEASURED / "tricycle").is_dir():
        print(f"the log of the tricycle is not in {MEASURED}")
        return
    for delays in (False, True):
        for held_out in (0.0, 0.5):
            print(f"\ntricycle, delays {'estimated' if delays else 'zero'}, held out {held_out:.0%}")
            print(tricycle(delays, held_out))


if __name__ == "__main__":
    main()
