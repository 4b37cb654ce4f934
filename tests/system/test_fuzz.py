# ruff: noqa: E501
"""Files of every reader, changed at random: the answer is a value or an ``RncError`` in one line, and soon."""

import multiprocessing
import random
import re
import time
import traceback
import warnings
import zipfile
from collections import Counter
from io import BytesIO

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.applications.scenario.files import find_scenario, read_yaml
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.robots.robot_files import shipped_directory

SLOWEST = 10.0  # [s] of processor time
LONGEST = 5000  # letters of a message

XACRO = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="size" default="0.1"/>
  <xacro:property name="mass" value="${2 * pi}"/>
  <xacro:property name="table" value="${dict(a=1, b=[2, 3])}"/>
  <xacro:macro name="body" params="name mass:=1 *shape **rest">
    <link name="${name}"><inertial><mass value="${mass}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <xacro:insert_block name="shape"/></link><xacro:insert_block name="rest"/>
  </xacro:macro>
  <xacro:body name="a" mass="${mass}"><visual><geometry><box size="1 1 $(arg size)"/></geometry></visual><rest/></xacro:body>
  <xacro:body name="b"><visual><geometry><sphere radius="${max([k / 10 for k in range(1, 4)])}"/></geometry></visual><rest/></xacro:body>
  <xacro:if value="${table['b'][0] == 2}">
    <joint name="j" type="continuous"><parent link="a"/><child link="b"/><origin xyz="${sin(radians(30))} 0 0"/><axis xyz="0 0 1"/></joint>
  </xacro:if>
  <xacro:unless value="$(eval size > 1)"><material name="${'m' + '_'.join(['a', 'b'])}"><color rgba="1 0 0 1"/></material></xacro:unless>
</robot>"""

MJCF = """<mujoco><compiler settotalmass="6"/><default><joint damping="0.1"/></default><worldbody>
  <frame pos="0 0 1" euler="0 0 30"><body name="a"><joint name="root" axis="1 2 3"/><geom type="box" size="1 1 0.1"/>
  <replicate count="3" offset="0.5 0 0" euler="0 0 20"><body name="b" pos="1 0 0"><joint name="j" axis="0 1 0" range="-60 60"/>
  <geom type="capsule" fromto="0 0 0 1 0 0" size="0.1" density="700"/><frame euler="90 0 20"><body name="c"><joint name="k"
  type="slide" axis="1 0 1"/><geom type="sphere" size="0.1" pos="0 1 0"/><site name="tip"/></body></frame></body></replicate>
  </body></frame></worldbody></mujoco>"""

WORDS = [
    "1e308", "-1e308", "1e-320", "nan", "inf", "-inf", "1e400", "0", "-1", "9" * 400, "0x10", "1_0", "1,5", "true", "null", "~", "",
    "${", "${1/0}", "${9**9**9}", "$(eval 1)", "$(env HOME)", "${[0]*9}", "${().__class__}", "$(find x)", "&amp;", "&lt;", "&#0;", "]]>",
    "<!--", "<a>", "</link>", "<link/>", "<joint/>", "<mimic joint='j'/>", "<body/>", "<frame/>", "\x00", "\x1b[31m", "é", "😀",
    "!!bool x", "!!python/object:os.system", "&a", "*a", "<<: *a", "{", "[", "- ", ": ", "? ", "| ", "%", "universe", "root_joint", "world",
    "fixed", "revolute", "planar", "floating", "mesh", "name", "x" * 5000, "\n" * 50, "\t",
]  # fmt: skip


def mutated(content, dice):
    """A file with one to three changes, most of which leave it well formed."""
    kinds = ("flip", "drop", "double", "swap", "insert", "number", "text")
    for kind in dice.choices(kinds, (2, 1, 1, 1, 1, 12, 3), k=dice.randint(1, 3)):
        begin, other = (dice.randrange(len(content) + 1) for _ in range(2))
        end = min(len(content), begin + dice.randint(1, 60))
        head, piece, tail = content[:begin], content[begin:end], content[end:]
        word = dice.choice(WORDS).encode()
        if kind == "flip" and piece:
            content = head + bytes([piece[0] ^ 1 << dice.randrange(8)]) + piece[1:] + tail
        elif kind == "drop":
            content = head + tail
        elif kind == "double":
            content = head + piece * dice.choice((2, 2, 50)) + tail
        elif kind == "swap":
            content = head + content[other : other + 60] + tail
        elif kind == "insert":
            content = head + word + piece + tail
        elif kind == "number":
            value = dice.choice((1, -1, dice.random())) * 10.0 ** dice.randint(-20, 20)
            number = dice.choice((repr(value), str(dice.randint(-2, 5)))).encode()
            content = replaced(rb"-?\d+(\.\d+)?(e-?\d+)?", content, dice, word if dice.random() < 0.2 else number)
        else:
            content = replaced(rb'(?<=")[^"<>]*(?=")|\b\w+\b', content, dice, word)
    return content


def replaced(pattern, content, dice, word):
    found = list(re.finditer(pattern, content))
    if not found:
        return content
    match = dice.choice(found)
    return content[: match.start()] + word + content[match.end() :]


def mutated_member(content, dice):
    """A zip file that is whole, with one broken file in it."""
    packed = BytesIO()
    with zipfile.ZipFile(BytesIO(content)) as before, zipfile.ZipFile(packed, "w") as after:
        chosen = dice.choice(before.namelist())
        for name in before.namelist():
            after.writestr(name, mutated(before.read(name), dice) if name == chosen else before.read(name))
    return packed.getvalue()


def use(robot):
    repr(robot)
    reduced = rnc.NonholonomicSystem(robot).reduce()
    reduced.at(robot.configuration(), np.zeros(reduced.r))


READERS = {
    "URDF": ("r.urdf", lambda path: use(rnc.Robot.from_urdf(path, base="planar"))),
    "xacro": ("r.xacro", lambda path: use(rnc.Robot.from_urdf(path, base="planar"))),
    "MJCF": ("r.xml", lambda path: use(rnc.Robot.from_mjcf(path))),
    "scenario": ("s.yaml", lambda path: validate(read_yaml(path), str(path))),
    "run": ("t.npz", lambda path: repr(rnc.Trajectory.load(path))),
}


def sources(kind, folder):
    """Files of a kind that are read as they are."""
    if kind == "URDF":
        names = ("mobile_manipulator", "chaplygin_sleigh")
        return [(shipped_directory() / f"{name}.urdf").read_bytes() for name in names]
    if kind == "scenario":
        names = ("space-robot", "mobile-manipulator-two-phase", "fire-truck")
        return [find_scenario(name).read_bytes() for name in names]
    if kind == "run":
        robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        rnc.free_motion(reduced, robot.configuration(), [1.0, 0.5], duration=0.1).save(folder / "source.npz")
        return [(folder / "source.npz").read_bytes()]
    return [{"xacro": XACRO, "MJCF": MJCF}[kind].encode()]


def attack(kind, number, content, folder):
    """Read one broken file: how it ended, and what is wrong with that, or None."""
    name, read = READERS[kind]
    path, dice = folder / name, random.Random(f"{kind} {number}")
    path.write_bytes((mutated_member if kind == "run" and number % 2 else mutated)(content, dice))
    start, fault = time.process_time(), None  # a busy machine is nobody's fault
    try:
        with warnings.catch_warnings(action="ignore"):
            read(path)
        ending = "read"
    except rnc.RncError as error:
        ending, text = "refused", str(error)
        if not text.isprintable() or not 0 < len(text) < LONGEST:
            fault = f"a message that is no printable line: {text[:200]!r}"
    except Exception:
        ending, fault = "broken", traceback.format_exc(limit=-4)
    taken = time.process_time() - start
    return ending, f"{taken:.1f} s of processor time" if taken > SLOWEST else fault


def attack_all(sender, kind, count, originals, folder):
    for number in range(count):
        sender.send((number, *attack(kind, number, originals[number % len(originals)], folder)))


@pytest.mark.parametrize("kind", READERS)
def test_broken_files_end_in_errors_of_ours(kind, tmp_path):
    """In a process of its own: a file that ends it is a fault."""
    originals, count = sources(kind, tmp_path), 120 if kind == "run" else 30  # few changes of a zip file do no harm
    for content in originals:
        (tmp_path / READERS[kind][0]).write_bytes(content)
        READERS[kind][1](tmp_path / READERS[kind][0])
    fork, endings, faults = multiprocessing.get_context("fork"), Counter(), []
    receiver, sender = fork.Pipe(duplex=False)
    child = fork.Process(target=attack_all, args=(sender, kind, count, originals, tmp_path))
    child.start()
    sender.close()
    for _ in range(count):
        number, ending, fault = receiver.recv()  # EOFError: the child died of the next file
        endings[ending] += 1
        faults += [] if fault is None else [f"{kind} {number}: {fault}"]
    child.join()
    assert faults == []
    assert endings["read"] > 0, "some changes do no harm, so that more than the first check is reached"
    assert endings["refused"] > 0
