"""Joint couplings and loop closures as MuJoCo equality constraints."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.constraints import (
    AckermannSteering,
    Caster,
    LoopClosure,
    MomentumConservation,
    NoSideSlip,
    RollingBall,
    RollingWheel,
)
from rnc_pin.constraints.ackermann_steering import AckermannRow
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.coupling import CouplingRow
from rnc_pin.model.rows import Rows
from rnc_pin.plants.mujoco.engine import mujoco
from rnc_pin.plants.mujoco.parts import scalar_first
from rnc_pin.plants.mujoco.settings import MuJoCoSettings
from rnc_pin.plants.mujoco.tree import Tree

_ON_GROUND = (RollingWheel, RollingBall, Caster, NoSideSlip)
_RIGID = 0.999
_MADE = (
    "rolling wheels and balls, knife edges, casters, couplings of joints, Ackermann steering, loops and the "
    "conservation of momentum"
)


class Coupling(ABC):
    """Coupling of two joints; the polynomial of MuJoCo is updated at the current angles."""

    @abstractmethod
    def set(self, model: mujoco.MjModel, qpos: np.ndarray, fresh: bool) -> None:
        """Write the polynomial coefficients; ``fresh`` is True at the start of a run."""


@dataclass(frozen=True)
class _Gear(Coupling):
    """Coupling ``q = ratio * q_driver + offset``; the offset includes the initial full turns of both joints."""

    equality: int
    joint: int
    driver: int | None
    ratio: float

    def set(self, model: mujoco.MjModel, qpos: np.ndarray, fresh: bool) -> None:
        if fresh:
            offset = qpos[self.joint] - (0.0 if self.driver is None else self.ratio * qpos[self.driver])
            model.eq_data[self.equality, :5] = offset, 0.0 if self.driver is None else self.ratio, 0.0, 0.0, 0.0


@dataclass(frozen=True)
class _Steering(Coupling):
    """Ackermann steering ``cot(r) - cot(l) = k``: angle l as a function of r, and its slope."""

    equality: int
    left: int
    right: int
    signs: tuple[float, float]
    ratio: float

    def set(self, model: mujoco.MjModel, qpos: np.ndarray, fresh: bool) -> None:
        r, k = self.signs[1] * qpos[self.right], self.ratio
        sine, cosine = np.sin(r), np.cos(r) - k * np.sin(r)  # tan(l) = sin r / (cos r - k sin r)
        angle, slope = np.arctan2(sine, cosine), 1.0 / (sine * sine + cosine * cosine)
        angle += np.pi * np.round((self.signs[0] * qpos[self.left] - angle) / np.pi)
        first = self.signs[0] * slope * self.signs[1]
        model.eq_data[self.equality, :5] = self.signs[0] * angle - first * qpos[self.right], first, 0.0, 0.0, 0.0


class Couplings:
    """Equality constraints of a MuJoCo model: joint couplings and loop closures.

    Args:
        spec: specification that receives them; it has the bodies of ``tree``.
        blocks: bound constraints.

    Raises:
        ConfigurationError: a constraint has no equivalent in MuJoCo.
    """

    def __init__(self, spec: mujoco.MjSpec, tree: Tree, blocks: Sequence[Rows], settings: MuJoCoSettings) -> None:
        self._spec, self._settings = spec, settings
        self._gears: list[tuple[str, CouplingRow]] = []
        self._steerings: list[tuple[str, AckermannSteering, AckermannRow]] = []
        for block in blocks:
            kind = block.kind
            if isinstance(block, CouplingRow):
                self._gears.append((self._tie(block.names[0], block.joint, block.driver), block))
            elif isinstance(kind, AckermannSteering) and isinstance(block, AckermannRow):
                self._steerings.append((self._tie(block.names[0], kind.left, kind.right), kind, block))
            elif isinstance(kind, LoopClosure):
                self._close(tree, kind, block.names[0])
            elif not isinstance(kind, (MomentumConservation, *_ON_GROUND)):
                what = type(kind or block).__name__
                raise ConfigurationError(f"MuJoCo: {block.names[0]} ({what}) has no equivalent; supported are {_MADE}")

    def compiled(self, model: mujoco.MjModel) -> list[Coupling]:
        """Return the couplings that depend on the current angles, for a compiled model."""

        def place(joint: str) -> int:
            return int(model.joint(joint).qposadr[0])

        found: list[Coupling] = []
        for name, row in self._gears:
            driver = None if row.driver is None else place(row.driver)
            found.append(_Gear(model.equality(name).id, place(row.joint), driver, row.ratio))
        for name, kind, steering in self._steerings:
            where = model.equality(name).id, place(kind.left), place(kind.right)
            found.append(_Steering(*where, steering.signs, steering.ratio))
        return found

    def _tie(self, name: str, joint: str, driver: str | None) -> str:
        tied = self._spec.add_equality(name=name, type=mujoco.mjtEq.mjEQ_JOINT, name1=joint, **self._firmness())
        if driver is not None:
            tied.name2 = driver
        return name

    def _close(self, tree: Tree, kind: LoopClosure, name: str) -> None:
        back = pin.rpy.rpyToMatrix(np.asarray(kind.rpy, dtype=float)).T
        ends = (kind.frame_a, kind.offset_a, np.eye(3)), (kind.frame_b, kind.offset_b, back)
        sites = []
        for number, (frame_name, offset, turn) in enumerate(ends):
            frame = tree.robot.model.frames[tree.robot.frame_id(frame_name)]
            placement = frame.placement * pin.SE3(turn, np.asarray(offset, dtype=float))
            quaternion = scalar_first(pin.Quaternion(placement.rotation).coeffs())
            sites.append(f"{name}/{number}")
            tree.bodies[frame.parentJoint].add_site(name=sites[-1], pos=placement.translation, quat=quaternion)
        equality = mujoco.mjtEq.mjEQ_CONNECT if kind.kind == "point" else mujoco.mjtEq.mjEQ_WELD
        closed = self._spec.add_equality(
            name=name,
            type=equality,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=sites[0],
            name2=sites[1],
            **self._firmness(),
        )
        if kind.kind != "point":
            closed.data[10] = 1.0  # rotation and translation have equal weights

    def _firmness(self) -> dict[str, list[float]]:
        return {"solref": [2 * self._settings.step, 1.0], "solimp": [_RIGID, _RIGID, 0.001, 0.5, 2.0]}
