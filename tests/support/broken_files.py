# ruff: noqa: E501
"""Broken files for every reader: whatever they say, the answer is a value or an ``RncError`` in one line, and soon.

Inputs are files that are read (URDF, xacro, MJCF, scenarios, runs), changed at random: bits, pieces left out, doubled
or swapped, numbers that leave no room, and words of the formats in wrong places. The seed of each is its number.
"""

from __future__ import annotations

import multiprocessing
import random
import re
import tempfile
import time
import traceback
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from io import BytesIO
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

import rnc_pin as rnc
from rnc_pin.applications.scenario.files import find_scenario, read_yaml
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.robots.robot_files import shipped_directory

SLOWEST = 10.0  # [s] of processor time
LONGEST = 5000  # letters of a message

_XACRO = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
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

_MJCF = """<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"/><default><joint damping="0.1"/></default>
  <worldbody><body name="a" pos="0 0 1"><freejoint name="root"/><inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>
  <geom type="box" size="1 1 0.1"/><body name="b" pos="1 0 0" quat="1 0 0 0"><joint name="j" type="hinge" axis="0 1 0" range="-1 1"/>
  <geom type="capsule" fromto="0 0 0 1 0 0" size="0.1" mass="1"/><body name="c"><joint name="k" type="slide" axis="1 0 0"/>
  <geom type="sphere" size="0.1" density="100"/></body></body></body></worldbody>
  <equality><joint joint1="j" joint2="k" polycoef="0 1 0 0 0"/></equality></mujoco>"""

_SHORT_MJCF = """<mujoco><compiler settotalmass="6"/><default><joint damping="0.1"/></default><worldbody>
  <frame pos="0 0 1" euler="0 0 30"><body name="a"><joint name="root" axis="1 2 3"/><geom type="box" size="1 1 0.1"/>
  <replicate count="3" offset="0.5 0 0" euler="0 0 20"><body name="b" pos="1 0 0"><joint name="j" axis="0 1 0" range="-60 60"/>
  <geom type="capsule" fromto="0 0 0 1 0 0" size="0.1" density="700"/><frame euler="90 0 20"><body name="c"><joint name="k"
  type="slide" axis="1 0 1"/><geom type="sphere" size="0.1" pos="0 1 0"/><site name="tip"/></body></frame></body></replicate>
  </body></frame></worldbody></mujoco>"""

_WORDS = [
    "1e308", "-1e308", "1e-320", "nan", "inf", "-inf", "1e400", "0", "-1", "9" * 400, "0x10", "1_0", "1,5", "true", "null", "~", "",
    "${", "${1/0}", "${9**9**9}", "$(eval 1)", "$(env HOME)", "${[0]*9}", "${().__class__}", "$(find x)", "&amp;", "&lt;", "&#0;", "]]>",
    "<!--", "<a>", "</link>", "<link/>", "<joint/>", "<mimic joint='j'/>", "<body/>", "<frame/>", "\x00", "\x1b[31m", "é", "\ud83d\ude00".encode("utf-16", "surrogatepass").decode("utf-16"),
    "!!bool x", "!!python/object:os.system", "&a", "*a", "<<: *a", "{", "[", "- ", ": ", "? ", "| ", "%", "universe", "root_joint", "world",
    "fixed", "revolute", "planar", "floating", "mesh", "name", "x" * 5000, "\n" * 50, "\t",
]  # fmt: skip


def mutated(content: bytes, dice: random.Random) -> bytes:
    """A file with one to three changes, most of which leave it well formed."""
    for _ in range(dice.randint(1, 3)):
        (change,) = dice.choices(list(_CHANGES), list(_CHANGES.values()))
        content = change(content, dice)
    return content


def _mutated_member(content: bytes, dice: random.Random) -> bytes:
    """A zip file that is whole, with one broken file in it."""
    packed = BytesIO()
    with zipfile.ZipFile(BytesIO(content)) as before, zipfile.ZipFile(packed, "w") as after:
        chosen = dice.choice(before.namelist())
        for name in before.namelist():
            after.writestr(name, mutated(before.read(name), dice) if name == chosen else before.read(name))
    return packed.getvalue()


def _span(content: bytes, dice: random.Random, longest: int = 60) -> slice:
    start = dice.randrange(len(content) + 1)
    return slice(start, min(len(content), start + dice.randint(1, longest)))


def _flip(content: bytes, dice: random.Random) -> bytes:
    if not content:
        return content
    changed = bytearray(content)
    changed[dice.randrange(len(changed))] ^= 1 << dice.randrange(8)
    return bytes(changed)


def _drop(content: bytes, dice: random.Random) -> bytes:
    where = _span(content, dice)
    return content[: where.start] + content[where.stop :]


def _double(content: bytes, dice: random.Random) -> bytes:
    where = _span(content, dice, 400)
    return content[: where.stop] + content[where] * dice.choice((1, 1, 50)) + content[where.stop :]


def _swap(content: bytes, dice: random.Random) -> bytes:
    one, other = _span(content, dice), _span(content, dice)
    return content[: one.start] + content[other] + content[one.stop :]


def _insert(content: bytes, dice: random.Random) -> bytes:
    start = dice.randrange(len(content) + 1)
    return content[:start] + dice.choice(_WORDS).encode() + content[start:]


def _replaced(pattern: bytes, content: bytes, dice: random.Random, words: Sequence[str] = _WORDS) -> bytes:
    found = list(re.finditer(pattern, content))
    if not found:
        return content
    match = dice.choice(found)
    return content[: match.start()] + dice.choice(words).encode() + content[match.end() :]


def _replace_number(content: bytes, dice: random.Random) -> bytes:
    number = dice.choice((1, -1, dice.random())) * 10.0 ** dice.randint(-20, 20)
    words = _WORDS if dice.random() < 0.2 else [repr(number), str(dice.randint(-2, 5))]
    return _replaced(rb"-?\d+(\.\d+)?(e-?\d+)?", content, dice, words)


def _replace_text(content: bytes, dice: random.Random) -> bytes:
    return _replaced(rb'(?<=")[^"<>]*(?=")|\b\w+\b', content, dice)


_CHANGES = {_flip: 2, _drop: 1, _double: 1, _swap: 1, _insert: 1, _replace_number: 12, _replace_text: 3}


def _read_urdf(path: Path) -> None:
    _use(rnc.Robot.from_urdf(path, base="planar"))


def _read_mjcf(path: Path) -> None:
    _use(rnc.Robot.from_mjcf(path))


def _use(robot: rnc.Robot) -> None:
    repr(robot)
    reduced = rnc.NonholonomicSystem(robot).reduce()
    reduced.at(robot.configuration(), np.zeros(reduced.r))


def _read_scenario(path: Path) -> None:
    validate(read_yaml(path), str(path))


def _read_run(path: Path) -> None:
    repr(rnc.Trajectory.load(path))


READERS: dict[str, tuple[str, Callable[[Path], None]]] = {
    "URDF": ("r.urdf", _read_urdf),
    "xacro": ("r.xacro", _read_urdf),
    "MJCF": ("r.xml", _read_mjcf),
    "scenario": ("s.yaml", _read_scenario),
    "run": ("t.npz", _read_run),
}


def sources(folder: Path) -> dict[str, list[bytes]]:
    """Files that are read as they are, by kind."""
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
    rnc.free_motion(reduced, robot.configuration(), [1.0, 0.5], duration=0.1).save(folder / "source.npz")
    scenarios = ("space-robot", "mobile-manipulator-two-phase", "fire-truck")
    return {
        "URDF": [
            (shipped_directory() / f"{name}.urdf").read_bytes() for name in ("mobile_manipulator", "chaplygin_sleigh")
        ],
        "xacro": [_XACRO.encode()],
        "MJCF": [_MJCF.encode(), _SHORT_MJCF.encode()],
        "scenario": [find_scenario(name).read_bytes() for name in scenarios],
        "run": [(folder / "source.npz").read_bytes()],
    }


def attack(kind: str, number: int, content: bytes, folder: Path) -> tuple[str, str | None]:
    """Read one broken file: how it ended, and what is wrong with that, or None."""
    name, read = READERS[kind]
    path = folder / name
    change = _mutated_member if kind == "run" and number % 2 else mutated
    path.write_bytes(change(content, random.Random(f"{kind} {number}")))
    start = time.process_time()  # a busy machine is nobody's fault
    fault = None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read(path)
        ending = "read"
    except rnc.RncError as error:
        ending, text = "refused", str(error)
        if not text.isprintable() or not 0 < len(text) < LONGEST:
            fault = f"a message that is no printable line: {text[:200]!r}"
    except Exception:
        ending, fault = "broken", traceback.format_exc(limit=-4)
    taken = time.process_time() - start
    if taken > SLOWEST:
        fault = f"{taken:.1f} s of processor time"
    return ending, fault


def run(count: int, kind: str) -> tuple[Counter[str], list[str]]:
    """Attack a reader with so many files: how often they ended how, and what went wrong."""
    endings: Counter[str] = Counter()
    faults = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        originals = sources(folder)
        for number, ending, fault in _attacked(kind, range(count), originals[kind], folder):
            endings[ending] += 1
            if fault is not None:
                faults.append(f"{kind} {number}: {fault}")
    return endings, faults


def _attacked(kind: str, numbers: range, originals: list[bytes], folder: Path) -> Iterator[tuple[int, str, str | None]]:
    """``attack`` in a process of its own: a file that ends it is a fault, and the next one goes on."""
    fork = multiprocessing.get_context("fork")
    while numbers:
        receiver, sender = fork.Pipe(duplex=False)
        child = fork.Process(target=_attack_all, args=(sender, kind, numbers, originals, folder))
        child.start()
        sender.close()
        with suppress(EOFError):
            while True:
                yield receiver.recv()
                numbers = numbers[1:]
        child.join()
        if numbers:
            yield numbers[0], "broken", f"the process ended with {child.exitcode}"
            numbers = numbers[1:]


def _attack_all(sender: Connection, kind: str, numbers: range, originals: list[bytes], folder: Path) -> None:
    for number in numbers:
        sender.send((number, *attack(kind, number, originals[number % len(originals)], folder)))
