"""Check of the motion of a kinematic controller before a run."""

from __future__ import annotations

from rnc_pin.applications.scenario.controllers.context import MIN_SINGULAR_VALUE, ControllerContext, refuse_or_warn
from rnc_pin.applications.scenario.controllers.task_goals import TaskGoals
from rnc_pin.control import KinematicController, VelocityQP, VelocityTarget
from rnc_pin.control.whole_body import ProgramState
from rnc_pin.errors import InfeasibleError
from rnc_pin.model import Measurement, Task
from rnc_pin.simulation import Margins, margins_along, obstacles_passed

_ROLLOUT_STEP = 0.05  # [s]; a coarse step is enough, because the inertia varies smoothly


def check_motion(
    context: ControllerContext,
    kinematic: KinematicController,
    task: Task | None = None,
    horizon: float | None = None,
    goals: TaskGoals | None = None,
    stands_in: bool = False,
) -> tuple[Margins, tuple[str, ...], tuple[str, ...]]:
    """Roll out a kinematic controller. Return the margins of the motion, complaints, and doubts about goals.

    Args:
        context: inputs for building the controller.
        kinematic: computes the rates of the reducing outputs.
        task: task whose A4 the kinematic controller inverts, if any.
        horizon: duration of the motion to check [s]; by default that of the references of the scenario.
        goals: goals of a controller that may give goals up.
        stands_in: True if another controller will run, so that the motion may differ.

    Raises:
        InfeasibleError: there are complaints, and preflight refuses such a motion.
    """
    reduced, horizon = context.reduced, context.horizon if horizon is None else horizon
    if isinstance(kinematic, VelocityQP):
        kinematic = _OncePerSample(kinematic)
    margins = margins_along(reduced, kinematic, context.q0, horizon, _ROLLOUT_STEP, task, context.grip)
    passed = obstacles_passed(reduced.robot, margins.time, margins.q, context.obstacles)
    complaints = (
        *margins.complaints(MIN_SINGULAR_VALUE),
        *(f"the reference passes through obstacle '{each.names[1]}': {each}" for each in passed),
    )
    if stands_in:
        complaints = tuple(f"{each} (in a roll-out by velocities, the run may differ)" for each in complaints)
    doubts: tuple[str, ...] = ()
    given_up: tuple[str, ...] = ()
    if goals is not None and margins.singular is None:
        doubts, given_up = goals.doubts(float(margins.time[-1]), margins.q[-1], context.goal_tolerance)
    try:
        return margins, refuse_or_warn(context.preflight, complaints, given_up), doubts
    except InfeasibleError as error:
        error.of_motion, weakest = True, margins.stack
        if weakest.value < MIN_SINGULAR_VALUE:
            error.q, error.time, error.rows = weakest.q, weakest.time, weakest.rows
            error.singular_value, error.near_singular = weakest.value, True
        raise


class _OncePerSample:
    """Program whose velocity is computed once per sample of a roll-out: within a sample it does not read q."""

    def __init__(self, program: VelocityQP) -> None:
        self._program = program
        self._last: tuple[ProgramState, tuple[VelocityTarget, ProgramState]] | None = None

    def initial_state(self, measurement: Measurement) -> ProgramState:
        return self._program.initial_state(measurement)

    def step(self, t: float, measurement: Measurement, state: ProgramState) -> tuple[VelocityTarget, ProgramState]:
        if self._last is None or self._last[0] is not state:
            self._last = state, self._program.step(t, measurement, state)
        return self._last[1]
