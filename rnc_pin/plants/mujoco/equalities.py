"""Joint couplings and loop closures as MuJoCo equality constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError
from rnc_pin.model.mechanisms import FrameAnchor, JointCoupler
from rnc_pin.model.rows import Rows
from rnc_pin.plants.mujoco.body_tree import BodyTree
from rnc_pin.plants.mujoco.engine import mujoco
from rnc_pin.plants.mujoco.joint_coordinates import scalar_first
from rnc_pin.plants.mujoco.settings import MuJoCoSettings

_RIGID = 0.999
_SUPPORTED = (
    "rolling wheels and balls, knife edges, casters, couplings of joints, Ackermann steering, loops and the "
    "conservation of momentum"
)


@dataclass(frozen=True)
class JointEquality:
    """JointEquality of two joints; the polynomial of MuJoCo is updated at the current positions.

    Attributes:
        equality: index of the equality constraint.
        joint, driver: indices in qpos of the joint that follows and of the one that leads, if any.
        coupler: how the joint follows.
    """

    equality: int
    joint: int
    driver: int | None
    coupler: JointCoupler

    def set(self, model: mujoco.MjModel, qpos: np.ndarray, fresh: bool) -> None:
        """Write the polynomial coefficients; ``fresh`` is True at the start of a run.

        The offset of a constant ratio includes the initial full turns of both joints.
        """
        driver = 0.0 if self.driver is None else qpos[self.driver]
        if self.coupler.function is not None:
            position, slope = self.coupler.function(driver)
            period = self.coupler.period
            position += period * np.round((qpos[self.joint] - position) / period)
        elif fresh:
            position, slope = qpos[self.joint], self.coupler.ratio
        else:
            return
        model.eq_data[self.equality, :5] = position - slope * driver, slope, 0.0, 0.0, 0.0


class EqualityConstraints:
    """Equality constraints of a MuJoCo model: joint couplings and loop closures.

    Args:
        spec: specification that receives them; it has the bodies of ``tree``.
        blocks: bound constraints.

    Raises:
        ConfigurationError: a constraint has no equivalent in MuJoCo.
    """

    def __init__(self, spec: mujoco.MjSpec, tree: BodyTree, blocks: Sequence[Rows], settings: MuJoCoSettings) -> None:
        self._spec, self._settings = spec, settings
        self._couplers: list[tuple[str, JointCoupler]] = []
        for block in blocks:
            mechanisms = block.mechanisms()
            if not mechanisms and block.conserved is None:
                what = type(block.kind or block).__name__
                raise ConfigurationError(
                    f"MuJoCo: {block.names[0]} ({what}) has no equivalent; supported are {_SUPPORTED}"
                )
            for number, mechanism in enumerate(mechanisms):
                name = f"{block.names[0]}/{number}" if number else block.names[0]
                if isinstance(mechanism, JointCoupler):
                    self._couple(mechanism, name)
                elif isinstance(mechanism, FrameAnchor):
                    self._close(tree, mechanism, name)

    def compiled(self, model: mujoco.MjModel) -> list[JointEquality]:
        """Return the couplings, for a compiled model."""

        def place(joint: str) -> int:
            return int(model.joint(joint).qposadr[0])

        return [
            JointEquality(
                model.equality(name).id, place(each.joint), None if each.driver is None else place(each.driver), each
            )
            for name, each in self._couplers
        ]

    def _couple(self, coupler: JointCoupler, name: str) -> None:
        added = self._spec.add_equality(
            name=name, type=mujoco.mjtEq.mjEQ_JOINT, name1=coupler.joint, **self._solver_parameters()
        )
        if coupler.driver is not None:
            added.name2 = coupler.driver
        self._couplers.append((name, coupler))

    def _close(self, tree: BodyTree, anchor: FrameAnchor, name: str) -> None:
        sites = [f"{name}/{side}" for side in "ab"]
        for site, parent, offset in zip(sites, anchor.frames, anchor.placements, strict=True):
            frame = tree.robot.model.frames[tree.robot.frame_id(parent)]
            placement = frame.placement * offset
            quaternion = scalar_first(pin.Quaternion(placement.rotation).coeffs())
            tree.bodies[frame.parentJoint].add_site(name=site, pos=placement.translation, quat=quaternion)
        closed = self._spec.add_equality(
            name=name,
            type=mujoco.mjtEq.mjEQ_CONNECT if anchor.point else mujoco.mjtEq.mjEQ_WELD,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=sites[0],
            name2=sites[1],
            **self._solver_parameters(),
        )
        if not anchor.point:
            closed.data[10] = 1.0  # rotation and translation have equal weights

    def _solver_parameters(self) -> dict[str, list[float]]:
        return {"solref": [2 * self._settings.step, 1.0], "solimp": [_RIGID, _RIGID, 0.001, 0.5, 2.0]}
