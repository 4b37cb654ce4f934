"""Robots that others published, taken through ``init``, ``inspect`` and ``run``."""

import importlib.util
import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

from base_kind import comments, kind_words
from rnc_pin.robots.robot_files import example_urdfs

SAMPLES = 8
DURATION = 1.0  # of the run [s]; init itself has tried its draft for longer
LIMIT = 400  # for one command [s]

_MESH = re.compile(r"""(<mesh\b[^>]*?filename\s*=\s*["'])[^"']*/""")
_EXAMPLES = "example-robot-data"


class Published(NamedTuple):
    """A package on PyPI, the folder that it installs, and a path in there; of example-robot-data the robot's name."""

    package: str
    module: str
    path: str

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


class Finding(NamedTuple):
    """Result of one description."""

    kind: str  # of draft, in its own words
    doubts: list[str]  # of the draft
    report: dict[str, object]  # of ``inspect``; empty if it did not run
    refusal: str  # the command that failed with what it said, or an empty string
    seconds: float  # that all commands took


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
ROBOTS: dict[str, Published] = _examples() | {
    name: Published(package, module, path)
    for package, module, name, path in map(str.split, _ELSEWHERE.strip().splitlines())
}


def measured(name: str, folder: Path) -> Finding:
    """Draft, inspect and run a robot of an installed package, each by its own process, without meshes of a URDF."""
    source = ROBOTS[name].file()
    assert source is not None
    if source.suffix == ".urdf":
        text = _MESH.sub(r"\1package://gone/", source.read_text(errors="replace"))
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
    refusal, report, begun = "", {}, time.perf_counter()
    for command, arguments in commands.items():
        done = subprocess.run([sys.executable, "-m", "rnc_pin", command, *arguments], cwd=folder, text=True,
                              env={**os.environ, "COLUMNS": "200"}, capture_output=True, timeout=LIMIT)  # fmt: skip
        if done.returncode:
            refusal = f"{command}: {done.stderr.strip().splitlines()[-1].removeprefix('rnc-pin: ')}"
            break
        report = json.loads(done.stdout) if command == "inspect" else report
    seconds = time.perf_counter() - begun
    text = draft.read_text() if draft.exists() else ""
    doubts = [each.removeprefix("Assumed: ") for each in comments(text) if each.startswith("Assumed: ")]
    beside = [each.partition("  # ")[2] for each in text.splitlines() if each[:1] == " "]
    doubts += [each for each in beside if "CHECK" in each or "MEASURE" in each]
    return Finding(kind_words(text), doubts, report, refusal, seconds)


def shortened(text: str, width: int = 100) -> str:
    """As much of it as fits, in whole words."""
    return text if len(text) <= width else text[:width].rsplit(" ", 1)[0].rstrip(",;:") + " ..."
