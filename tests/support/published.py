"""Robots that others published, taken through ``init``, ``inspect`` and ``run``."""

import importlib.util
import json
import os
import re
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from base_kind import comments, kind_words
from rnc_pin.robots.robot_files import example_urdfs

SAMPLES = 8
DURATION = 1.0  # of the run [s]; init itself has tried its draft for longer
LIMIT = 400  # for one command [s]

_MESH = re.compile(r"""(<mesh\b[^>]*?filename\s*=\s*["'])[^"']*/""")
_DOUBT = re.compile(r"CHECK|MEASURE")
_EXAMPLES = "example-robot-data"


@dataclass(frozen=True)
class Published:
    """Location of a description.

    Args:
        package: on PyPI.
        module: the folder that the package installs.
        path: inside that folder; of example-robot-data the robot's name.
        complaint: what ``init`` says, where it refuses the file.
        remedy: pattern in the file and what to write instead, as the complaint asks for.
    """

    package: str
    module: str
    path: str
    complaint: str = ""
    remedy: tuple[str, str] | None = None

    def file(self) -> Path | None:
        """The file, or None where the package is not installed; nothing of the package is imported."""
        if self.package == _EXAMPLES:
            return example_urdfs()[self.path]
        found = importlib.util.find_spec(self.module)
        folders = found.submodule_search_locations if found else None
        return next((Path(folder) / self.path for folder in folders or ()), None)

    @property
    def installed(self) -> bool:
        file = self.file()
        return file is not None and file.is_file()


@dataclass(frozen=True)
class Finding:
    """Result of one description.

    Args:
        kind: of draft, in its own words.
        doubts: how many the draft has.
        doubt: the one that matters most.
        kept: independent rows.
        rows: all of them.
        r: degrees of freedom that are left.
        statuses: of the commands that ran, by their names.
        refusal: what the last of them said, where it failed.
        seconds: that all of them took.
    """

    kind: str
    doubts: int
    doubt: str
    kept: int
    rows: int
    r: int
    statuses: dict[str, int]
    refusal: str
    seconds: float

    @property
    def ran(self) -> bool:
        return list(self.statuses.values()) == [0, 0, 0]


def _examples() -> dict[str, Published]:
    """Of example-robot-data, some of what rolls, walks or flies; all of it is in the first table."""
    names = """
        tiago tiago_no_hand tiago_pro pr2 centauro a1 anymal_b_simple/anymal anymal_c_simple/anymal anymal-kinova
        b1 b1-z1 go1 go2 hyq_no_sensors laikago quadruped solo solo12 bolt alexander_v1.lowerBodyOnly g1_29dof_rev_1_0
        icub icub_reduced romeo simple_humanoid talos_reduced talos_full_v2 iris iris_simple quadrotor_base
        borinot_flying_arm_2 hextilt_flying_arm_5
    """
    return {name: Published(_EXAMPLES, "", name) for name in names.split()}


_ELSEWHERE = """
    upkie_description upkie_description upkie urdf/upkie.urdf
    pybullet pybullet_data husky husky/husky.urdf
    pybullet pybullet_data r2d2 r2d2.urdf
    pybullet pybullet_data racecar racecar/racecar.urdf
    pybullet pybullet_data racecar_differential racecar/racecar_differential.urdf
    pybullet pybullet_data bike bicycle/bike.urdf
    pybullet pybullet_data minitaur quadruped/minitaur.urdf
    pybullet pybullet_data minitaur_derpy quadruped/minitaur_derpy.urdf
    pybullet pybullet_data microtaur quadruped/microtaur/microtaur.urdf
    pybullet pybullet_data spirit40 quadruped/spirit40.urdf
    pybullet pybullet_data vision60 quadruped/vision60.urdf
    pybullet pybullet_data aliengo aliengo/aliengo.urdf
    pybullet pybullet_data mini_cheetah mini_cheetah/mini_cheetah.urdf
    pybullet pybullet_data cartpole cartpole.urdf
    pybullet pybullet_data humanoid humanoid/humanoid.urdf
    pybullet pybullet_data biped2d biped/biped2d_pybullet.urdf
    rtb-data rtbdata frankie xacro/qut_frankie_description/robots/frankie_arm_hand.urdf.xacro
    rtb-data rtbdata frankie_omni xacro/qut_frankie_description/robots/frankieOmni_arm_hand.urdf.xacro
    rtb-data rtbdata ridgeback xacro/clearpath_ridgeback_description/urdf/ridgeback.urdf.xacro
    gym-ignition-models gym_ignition_models icub_gazebo iCubGazeboV2_5/icub.urdf
    igibson igibson turtlebot examples/ros/igibson-ros/turtlebot/turtlebot.urdf
    mani_skill mani_skill fetch assets/robots/fetch/fetch.urdf
    mani_skill mani_skill mobile_panda assets/robots/panda/mobile_panda_single_arm.urdf
    genesis-world genesis cf2x assets/urdf/drones/cf2x.urdf
    genesis-world genesis racer assets/urdf/drones/racer.urdf
    genesis-world genesis wheel assets/urdf/wheel/wheel.urdf
    genesis-world genesis fancy_wheel assets/urdf/wheel/fancy_wheel.urdf
    genesis-world genesis iiwa_mobile assets/urdf/kuka_iiwa/model_mobile.urdf
    scikit-robot skrobot r8_6 data/robot_descriptions/urdf/r8_6.urdf
"""  # package, module, name and path
_REMEDIES = {  # what the package says of a file, and what to do to the file
    "humanoid": ("of type 'spherical'; expected one of: fixed, revolute", ('type="spherical"', 'type="fixed"')),
    "biped2d": ("lower value (-1.57.) is not a valid float", (r"1\.57\.", "1.57")),
}
ROBOTS: dict[str, Published] = _examples() | {
    name: Published(package, module, path, *_REMEDIES.get(name, ()))
    for package, module, name, path in map(str.split, _ELSEWHERE.strip().splitlines())
}


def measured(name: str, folder: Path, remedied: bool = False) -> Finding:
    """Draft, inspect and run a robot, without its meshes where it is a URDF, each by its own process.

    Args:
        name: in ROBOTS; its package is installed.
        folder: empty, to work in.
        remedied: after what the refusal asks for was done to the file.
    """
    robot = ROBOTS[name]
    source = robot.file()
    assert source is not None
    if source.suffix == ".urdf":
        text = _MESH.sub(r"\1package://gone/", source.read_text(errors="replace"))
        if remedied and robot.remedy:
            text = re.sub(*robot.remedy, text)
        source = folder / source.name
        source.write_text(text)
    draft = folder / "draft.yaml"
    # The end of the reference comes later.
    short = ["--set", f"simulation.duration={DURATION}", "--set", "accept=[goal]"]
    commands = {
        "init": [str(source), "--out", str(draft)],
        "inspect": [str(draft), "--samples", str(SAMPLES), "--json"],
        "run": [str(draft), "--out", str(folder / "out"), *short],
    }
    statuses: dict[str, int] = {}
    refusal, report, begun = "", None, time.perf_counter()
    for command, arguments in commands.items():
        statuses[command], output, said = _rnc_pin(command, arguments, folder)
        if statuses[command]:
            refusal = said.strip().splitlines()[-1].removeprefix("rnc-pin: ") if said.strip() else "no message"
            break
        report = json.loads(output) if command == "inspect" else report
    seconds = time.perf_counter() - begun
    kept, dropped, r = (len(report["kept_rows"]), len(report["dropped_rows"]), report["r"]) if report else (0, 0, 0)
    kind, doubts = _read(draft.read_text()) if draft.exists() else ("", [])
    worst = min(doubts, key=_rank, default="")
    return Finding(kind, len(doubts), worst, kept, kept + dropped, r, statuses, refusal, seconds)


def _rnc_pin(command: str, arguments: list[str], folder: Path) -> tuple[int, str, str]:
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "200"}
    full = [sys.executable, "-m", "rnc_pin", command, *arguments]
    try:
        done = subprocess.run(full, cwd=folder, env=environment, capture_output=True, text=True, timeout=LIMIT)
    except subprocess.TimeoutExpired:
        return 124, "", f"{command} takes longer than {LIMIT} s"
    return done.returncode, done.stdout, done.stderr


def _read(draft: str) -> tuple[str, list[str]]:
    """(kind, doubts) of a draft: what its comments say."""
    doubts = [each.removeprefix("Assumed: ") for each in comments(draft) if each.startswith("Assumed: ")]
    beside = [each.partition("  # ")[2] for each in draft.splitlines() if each[:1] == " "]
    return kind_words(draft), doubts + [each for each in beside if _DOUBT.search(each)]


def _rank(doubt: str) -> int:
    """Rank of a doubt: does not run, assumed, to check, to measure."""
    order = ("which does not run", "CHECK", "MEASURE")
    return {0: 0, 1: 2, 2: 3}.get(next((k for k, each in enumerate(order) if each in doubt), -1), 1)


def shortened(text: str, width: int = 100) -> str:
    """As much of it as fits, in whole words."""
    return text if len(text) <= width else text[:width].rsplit(" ", 1)[0].rstrip(",;:") + " ..."
