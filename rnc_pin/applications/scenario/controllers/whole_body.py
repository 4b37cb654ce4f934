"""Whole-body control: tasks within limits, as programs in velocities over a velocity tracker, or in inputs.

To add a task or a limit, add its class to ``TaskItem`` or ``LimitSettings``.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from rnc_pin.applications.scenario.controllers.base import BuiltController, ControllerContext, ControllerSettings
from rnc_pin.applications.scenario.controllers.tracking import VelocityTrackerSettings
from rnc_pin.applications.scenario.schema.derived import ClassReader, one_of
from rnc_pin.applications.scenario.schema.kinds import OutputItem
from rnc_pin.applications.scenario.schema.motions import ReferenceItem
from rnc_pin.collision import Obstacle, PairSelection
from rnc_pin.errors import RncError
from rnc_pin.io import Strict
from rnc_pin.model import Axes, NotNegative, OutputKind, OutputStack, Positive
from rnc_pin.motion.whole_body import InverseDynamicsQP, VelocityQP, limits, tasks
from rnc_pin.motion.whole_body.tasks import ControlTask
from rnc_pin.outputs import CenterOfMass, FramePosition, FrameYaw

_Weight = float | list[float]


class _FollowingTask(Strict):
    """Task with a reference, which starts at the initial values of its outputs.

    Attributes:
        weight: weight of the squared error within the same priority; a number, or one for each row.
        gain: rate of convergence [1/s]; a number, or one for each row.
        priority: level of the task. Level 0 is strictly above level 1, and so on.
        reference: its reference.
    """

    task: ClassVar[Callable[..., ControlTask]]
    """Class of the task, whose arguments have the names of the keys."""

    weight: _Weight = 1.0
    gain: _Weight = 1.0
    priority: int = 0
    reference: ReferenceItem = Field({"hold": {}}, validate_default=True)

    @property
    @abstractmethod
    def outputs(self) -> list[OutputKind]:
        """Outputs that the reference describes."""


class OutputTaskSettings(_FollowingTask):
    """Output that follows a reference: ``J v = xd_dot + gain (xd - x)``.

    Attributes:
        output: the output, e.g. ``rnc.FramePosition("hand")``.
    """

    task = tasks.OutputTask
    output: OutputItem

    @property
    def outputs(self) -> list[OutputKind]:
        return [self.output]


class BasePoseSettings(_FollowingTask):
    """Frame of a base that follows a reference pose (x, y, yaw) in the plane.

    Attributes:
        frame: frame of the base, with x forward.
        reference: of x, y [m] and yaw [rad].
        lateral_gain: yaw rate per forward speed and lateral error [rad/m^2].
    """

    task = tasks.BasePoseTask
    frame: str
    lateral_gain: NotNegative = 0.0

    @property
    def outputs(self) -> list[OutputKind]:
        return [FramePosition(self.frame, "xy"), FrameYaw(self.frame)]


class CenterOfMassSettings(_FollowingTask):
    """Centre of mass of the robot that follows a reference in the world.

    Attributes:
        reference: of the coordinates [m].
        axes: world axes, e.g. "xy" or "xyz".
    """

    task = tasks.CenterOfMassTask
    axes: Axes = "xyz"

    @property
    def outputs(self) -> list[OutputKind]:
        return [CenterOfMass(self.axes)]


TaskItem = Annotated[
    ControlTask | _FollowingTask,
    one_of(
        output=OutputTaskSettings,
        posture=tasks.PostureTask,
        base_pose=BasePoseSettings,
        center_of_mass=CenterOfMassSettings,
        damping=tasks.DampingTask,
        singularity=tasks.SingularityTask,
    ),
]


class CollisionSettings(Strict):
    """Distances between links of the robot, and to the obstacles of the scenario.

    Attributes:
        links: True to check links against each other; obstacles always count.
        clearance: distance that remains [m].
        influence: distance from which a pair is slowed down [m]; larger than the clearance. To stop from an approach of
            speed u, it takes ``u^2 / (2 a) + a / (2 rate^2)`` more than the clearance.
        rate: largest rate of approach over remaining distance [1/s].
        deceleration: deceleration a of an approach [m/s^2]; by default from the effort limits.
    """

    links: bool = True
    clearance: NotNegative = 0.02
    influence: Positive = 0.15
    rate: Positive = 5.0
    deceleration: Positive | None = None

    def build(self, obstacles: Sequence[Obstacle], q0: np.ndarray) -> limits.CollisionAvoidance:
        """Limit of a robot that is free of collisions at a configuration (nq,).

        Args:
            obstacles: bodies in the world.
            q0: the configuration; pairs that overlap there do not count.
        """
        pairs, distances = PairSelection(links=self.links), (self.clearance, self.influence, self.rate)
        return limits.CollisionAvoidance(*distances, obstacles, pairs, q0, self.deceleration)


_PositionLimit = Annotated[limits.JointPositionLimit, ClassReader(limits.JointPositionLimit)]
_VelocityLimit = Annotated[limits.JointVelocityLimit, ClassReader(limits.JointVelocityLimit)]


class LimitSettings(Strict):
    """Limits of whole-body control. Null removes a limit.

    Attributes:
        joint_position: position limits of joints, from the robot's file by default.
        joint_velocity: velocity limits of joints, from the robot's file by default.
        acceleration: accelerations of the reduced velocities or of joints.
        base_speed: norm of the horizontal velocity of a base.
        regions: convex regions in which frames stay.
        collision: distances between links of the robot, and to obstacles; by default they count if the scenario has
            obstacles.
    """

    joint_position: _PositionLimit | None = limits.JointPositionLimit()
    joint_velocity: _VelocityLimit | None = limits.JointVelocityLimit()
    acceleration: Annotated[limits.AccelerationLimit, ClassReader(limits.AccelerationLimit)] | None = None
    base_speed: Annotated[limits.BaseSpeedLimit, ClassReader(limits.BaseSpeedLimit)] | None = None
    regions: list[Annotated[limits.RegionLimit, ClassReader(limits.RegionLimit)]] = []
    collision: CollisionSettings | None = None

    def build(self, context: ControllerContext) -> list[limits.ControlLimit]:
        """Limits of a run. Distances count by default if there are obstacles, and the robot has shapes.

        Args:
            context: what the scenario has built so far.
        """
        items = [item for _, value in self for item in (value if isinstance(value, list) else [value])]
        # Limits are fields, so that null removes one and the order is that of the class.
        found: list[limits.ControlLimit] = [item for item in items if isinstance(item, limits.ControlLimit)]
        wanted, stated = self.collision, "collision" in self.model_fields_set
        # "Not stated" is on, null is off; a robot without shapes has no distances to keep.
        if context.obstacles and not stated and context.reduced.robot.has_collision_shapes:
            wanted = CollisionSettings()
        if wanted is not None:
            found.append(wanted.build(context.obstacles, context.q0))
        return found


class WholeBodySettings(ControllerSettings):
    """Tasks and limits of whole-body control.

    Attributes:
        tasks: tasks, each with weight, gain and priority. References start at the initial values.
        limits: limits; by default position and velocity limits of the robot's file, and distances to obstacles.
    """

    follows: ClassVar[frozenset[str]] = frozenset()
    advice: ClassVar[str] = "; each task has its own reference"

    tasks: Annotated[list[TaskItem], Field(min_length=1)]
    limits: LimitSettings = LimitSettings()

    def _tasks(self, context: ControllerContext) -> list[ControlTask]:
        """Build the tasks, and raise errors with their place in the file."""
        reduced, found = context.reduced, list[ControlTask]()
        for index, item in enumerate(self.tasks):
            with RncError.at(f"controller.tasks.{index}"):
                if isinstance(item, ControlTask):
                    task = item
                else:
                    stack = OutputStack([kind.bind(reduced.robot) for kind in item.outputs])
                    start = stack.value(reduced.at(context.q0).position)
                    reference = item.reference.from_start(start, stack.coordinates)
                    task = item.task(**{**dict(item), "reference": reference})
                task.bind(reduced)  # again in the program, but there an error would not tell which task it is
            found.append(task)
        return found


class VelocityProgramSettings(WholeBodySettings, VelocityTrackerSettings):
    """Whole-body control: tasks within limits as a quadratic program, over a velocity tracker.

    Attributes:
        type: tasks within limits as a quadratic program in the reduced velocities, over a velocity tracker.
        damping: cost of the reduced velocity beside the tasks at every level, as the root of a weight. It bounds the
            velocity near singular configurations, and zero follows the tasks exactly.
    """

    type: Literal["qp"]
    damping: NotNegative = 0.0

    def _build(self, context: ControllerContext) -> BuiltController:
        parts = self._tasks(context), self.limits.build(context)
        with RncError.at("controller.limits"):
            program = VelocityQP(context.reduced, *parts, damping=self.damping)
        # The whole run: tasks within limits may still move when their references have ended.
        return self.track(context, program, horizon=context.simulation.seconds)


class InverseDynamicsSettings(WholeBodySettings):
    """Whole-body control with efforts: tasks within limits as a quadratic program in the inputs, with the model.

    Attributes:
        type: tasks within limits of motion, effort and grip as a quadratic program in the inputs. It uses the model.
        velocity_gain: rate at which velocity errors of tasks decay [1/s]; the rest of the motion comes to rest at the
            same rate.
        friction: coefficient of friction of the ground, for the friction cone of each contact; null if only normal
            forces have a limit.
        braking_time: longest braking motion that is verified [s]; null for no verification.
    """

    type: Literal["inverse_dynamics"]
    velocity_gain: Positive = 20.0
    friction: Positive | None = None
    braking_time: Positive | None = 2.0

    def _build(self, context: ControllerContext) -> BuiltController:
        reduced = context.reduced
        parts = self._tasks(context), self.limits.build(context)
        with RncError.at("controller.limits"):
            settings = self.values_of("velocity_gain", "friction", "braking_time")
            program = InverseDynamicsQP(reduced, *parts, dt=context.simulation.dt, **settings)
        # Each later step keeps a braking motion if the one before had one: the start has to have one.
        problem = program.braking_problem(0.0, context.q0, context.v2_0)
        unsafe = () if problem is None else (f"no braking motion from the start keeps all limits: {problem}",)
        return BuiltController(program, context.refuse_or_warn(unsafe))
