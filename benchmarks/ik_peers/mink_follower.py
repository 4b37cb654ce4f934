"""mink: rolling as a task of twelve lines, because it has none; as equality constraints, or as costs."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version

import mink
import mujoco
import numpy as np
import pinocchio as pin

from benchmarks.ik_peers.hand_path import DAMPING, DT, GAIN, HAND, RADIUS, ROLLING, WHEELS, Case, Follower, Motion
from rnc_pin.plants.mujoco.body_tree import BodyTree
from rnc_pin.plants.mujoco.joint_coordinates import RobotCoordinates, scalar_first


def followers(given: Case) -> list[Follower]:
    """Equalities with our gain and with its default gain of one a sample, and costs."""
    return [
        _Mink(given, GAIN * DT, equalities=True),
        _Mink(given, 1.0, equalities=True),
        _Mink(given, 1.0, equalities=False),
    ]


class _RollingTask(mink.Task):
    """Point of a wheel at the ground that does not move along the heading, nor along the axle if ``lateral``."""

    def __init__(self, site: str, lateral: bool, cost: float) -> None:
        super().__init__(cost=np.full(1 + lateral, cost))
        self._site, self._lateral = site, lateral

    def compute_error(self, configuration: mink.Configuration) -> np.ndarray:
        return np.zeros(1 + self._lateral)

    def compute_jacobian(self, configuration: mink.Configuration) -> np.ndarray:
        model, data = configuration.model, configuration.data
        linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        site = model.site(self._site).id
        mujoco.mj_jacSite(model, data, linear, angular, site)
        x, y, _ = data.site_xmat[site].reshape(3, 3)[:, 2]  # the axle
        rows = np.array([[y, -x], [x, y]]) @ (linear[:2] - RADIUS * np.array([angular[1], -angular[0]]))
        return rows[: 1 + self._lateral]


class _Mink:
    def __init__(self, given: Case, gain: float, equalities: bool) -> None:
        self.name = f"mink {version('mink')}, gain {gain:g} a sample"
        self.rolling = "equalities" if equalities else "costs"
        self._reference = given.reference
        spec = mujoco.MjSpec()
        tree = BodyTree(spec, given.robot, "as it is", joint_limits=True)
        for name in (HAND, *(f"{wheel}_link" for wheel in WHEELS)):
            frame = given.robot.model.frames[given.robot.frame_id(name)]
            tree.bodies[frame.parentJoint].add_site(
                name=name,
                pos=frame.placement.translation,
                quat=scalar_first(pin.Quaternion(frame.placement.rotation).coeffs()),
            )
        model = spec.compile()
        self._joints = RobotCoordinates(tree.coordinates(model), given.robot.nq, given.robot.nv)
        qpos, qvel = np.zeros(model.nq), np.zeros(model.nv)
        self._joints.write(given.q0, np.zeros(given.robot.nv), qpos, qvel)
        self._at = mink.Configuration(model, q=qpos)
        self._hand = mink.FrameTask(HAND, "site", position_cost=1.0, orientation_cost=0.0, gain=gain)
        costs = np.zeros(model.nv)
        costs[[int(model.joint(name).dofadr[0]) for name in given.joints]] = np.sqrt(DAMPING)
        cost = float(np.sqrt(ROLLING))
        # Both wheels have the same axle: with its row twice, daqp finds no solution of these equalities.
        rolling = [_RollingTask(f"{wheel}_link", wheel == WHEELS[0], cost) for wheel in WHEELS]
        self._tasks: Sequence[mink.Task] = [self._hand, mink.DampingTask(model, costs)]
        self._constraints: Sequence[mink.Task] = rolling
        if not equalities:
            self._tasks, self._constraints = [*self._tasks, *rolling], []
        fastest = given.robot.model.upperVelocityLimit
        speeds = {name: fastest[given.robot.velocity_indices(name)] for name in given.joints}
        self._limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, speeds)]

    def command(self, t: float) -> None:
        self._at.update()
        self._hand.set_target(mink.SE3.from_translation(self._reference.at(t + DT).position))
        self._v = mink.solve_ik(
            self._at, self._tasks, DT, solver="daqp", limits=self._limits, constraints=self._constraints
        )

    def motion(self, elapsed: float) -> Motion:
        return Motion(*self._joints.read(self._at.integrate(self._v, elapsed), self._v))

    def advance(self) -> None:
        self._at.update(self._at.integrate(self._v, DT))
