"""Builder of runs with phases from a scenario."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from rnc_pin.applications.scenario.builder import Experiment, check_plots, experiment_at, start_of
from rnc_pin.applications.scenario.plant_builder import refuse_plants, start_findings, warnings_of
from rnc_pin.applications.scenario.schema import ScenarioFile
from rnc_pin.applications.scenario.schema.scenario import PhaseSettings
from rnc_pin.constraints import LoopClosure, PrescribedMotion
from rnc_pin.errors import ConfigurationError, InputError, RncError
from rnc_pin.model import ConstraintKind, Kinematics, NonholonomicSystem, OffsetFrame, ReducedModel
from rnc_pin.robots import Robot
from rnc_pin.simulation import Phase, PhaseStart, sample_count

_OWN = ("constraints", "outputs", "task", "reference", "controller")


def build_phased(scenario: ScenarioFile, folder: Path) -> Experiment:
    """Build a run with phases.

    Models of all phases are built before the run. A controller is built when its phase starts, from the state there.

    Args:
        scenario: a validated scenario with phases.
        folder: base of relative paths.

    Raises:
        RncError: a part of the scenario does not fit the robot, or does not support phases.
    """
    _check_supported(scenario)
    assert scenario.simulation is not None
    robot = scenario.robot.build(folder)
    builders: list[_PhaseBuilder] = []
    for number, settings in enumerate(scenario.phases):
        with RncError.at(f"phases[{number}]"):
            builders.append(_PhaseBuilder(scenario, settings, robot, folder))
    check_plots(scenario, [builder.reduced for builder in builders])
    first = builders[0]
    if first.settings.capture_distance is not None or first.settings.impact:
        raise ConfigurationError("phases[0]: the first phase has no impact, omit 'capture_distance' and 'impact'")
    q0, v2_0 = start_of(first.scenario, first.reduced)
    experiment = experiment_at(first.scenario, folder, first.reduced, q0, v2_0)
    phases: list[Phase | PhaseStart] = [first.phase(experiment, first.reduced)]
    phases += [builder.start(number) for number, builder in enumerate(builders[1:], start=1)]
    longest = sum(builder.duration for builder in builders)
    found = dict.fromkeys(
        each for builder in builders for each in start_findings(builder.scenario, builder.reduced, q0)
    )
    return replace(
        experiment,
        start_findings=tuple(found),
        ends={},  # a phase may end before its references, as by an event
        warnings=tuple(dict.fromkeys([*warnings_of(found), *experiment.warnings])),
        scenario=scenario,
        simulation=scenario.simulation.model_copy(update={"duration": longest}),
        phases=tuple(phases),
    )


def _check_supported(scenario: ScenarioFile) -> None:
    if scenario.simulation is None:
        raise ConfigurationError("simulation: is missing; a run needs {duration: ..., dt: ...}")
    refuse_plants(scenario, "phases", "its contacts appear and vanish by themselves")
    for key in ("planner", "faults", "grip", "contacts"):
        if getattr(scenario, key):
            raise ConfigurationError(f"{key}: does not support phases")
    if scenario.simulation.on_lift_off != "ignore":
        raise ConfigurationError("simulation.on_lift_off: set it in the phases")


class _PhaseBuilder:
    """Builder of one phase.

    Args:
        scenario: the whole scenario.
        settings: settings of the phase.
        robot: robot of all phases.
        folder: base of relative paths.
    """

    def __init__(self, scenario: ScenarioFile, settings: PhaseSettings, robot: Robot, folder: Path) -> None:
        assert scenario.simulation is not None
        self.settings, self._robot, self._folder = settings, robot, folder
        own = {key: getattr(settings, key) for key in _OWN if getattr(settings, key) is not None}
        self.duration = settings.duration or scenario.simulation.duration
        simulation = scenario.simulation.model_copy(update={"duration": self.duration})
        self.scenario = scenario.model_copy(update={**own, "simulation": simulation, "phases": [], "plots": {}})
        try:
            sample_count(self.duration, simulation.dt)
        except InputError as error:
            raise ConfigurationError(str(error)) from None
        self.reduced = self._model(self.scenario.constraints)

    def _system(self, constraints: list[ConstraintKind]) -> NonholonomicSystem:
        scenario = self.scenario
        return NonholonomicSystem(self._robot, constraints, scenario.actuators, scenario.mimic, scenario.forces)

    def _model(self, constraints: list[ConstraintKind]) -> ReducedModel:
        return self.scenario.reduced(self._system(constraints))

    def phase(self, experiment: Experiment, reduced: ReducedModel, impact: NonholonomicSystem | None = None) -> Phase:
        """Phase with the controller and the plant of an experiment."""
        plant, controller = experiment.plant, experiment.controller
        return self.settings.build(reduced, duration=self.duration, controller=controller, impact=impact, plant=plant)

    def start(self, number: int) -> Callable[[np.ndarray, np.ndarray, float], Phase]:
        """Function from the state before the phase, and the time, to the phase."""

        def build(q: np.ndarray, v: np.ndarray, t: float) -> Phase:
            with RncError.at(f"phases[{number}]"):
                scenario, reduced = self.scenario, self.reduced
                distance, own = self.settings.capture_distance, self.settings.constraints is not None
                # Motions of the scenario continue; those of the phase itself start with it.
                continues = not own and any(isinstance(each, PrescribedMotion) for each in scenario.constraints)
                if distance is not None or continues:
                    constraints = [_continued(each, t) if continues else each for each in scenario.constraints]
                    if distance is not None:
                        constraints = captured_closures(constraints, self._robot, q, distance)
                    scenario = scenario.model_copy(update={"constraints": constraints})
                    reduced = self._model(constraints)
                impact = None
                if self.settings.impact:
                    impact = self._system([*scenario.constraints, *self.settings.impact])
                experiment = experiment_at(scenario, self._folder, reduced, q, reduced.at(q, v=v, t=0.0).v2)
                return self.phase(experiment, reduced, impact)

        return build


def _continued(kind: ConstraintKind, t: float) -> ConstraintKind:
    """Prescribed motion that goes on at time t [s] of the run; other constraints unchanged."""
    return replace(kind, start_time=kind.start_time + t) if isinstance(kind, PrescribedMotion) else kind


def captured_closures(
    kinds: Sequence[ConstraintKind], robot: Robot, q: np.ndarray, distance: float
) -> list[ConstraintKind]:
    """Constraints whose loop closures join their frames in the pose at a configuration.

    Args:
        kinds: the constraints.
        robot: the robot.
        q: configuration (nq,) at the start of the phase.
        distance: largest distance of the frames [m].
    """
    return [_captured(kind, robot, q, distance) if isinstance(kind, LoopClosure) else kind for kind in kinds]


def _captured(kind: LoopClosure, robot: Robot, q: np.ndarray, distance: float) -> LoopClosure:
    """Loop closure of frames in their present pose.

    Raises:
        ConfigurationError: the frames are too far apart.
    """
    at = Kinematics(robot).position(q)
    placed = (OffsetFrame(robot, kind.frame_a, (0.0, 0.0, 0.0)), OffsetFrame(robot, kind.frame_b, kind.offset_b))
    a, b = (pin.SE3(each.rotation, each.translation) for each in (frame.placement(at) for frame in placed))
    relative = a.actInv(b)
    apart = float(np.linalg.norm(relative.translation - np.array(kind.offset_a)))
    if apart > distance:
        raise ConfigurationError(
            f"capture_distance: '{kind.frame_a}' and '{kind.frame_b}' are {apart:.3g} m apart, limit {distance:g} m"
        )
    rpy = tuple(pin.rpy.matrixToRpy(relative.rotation).tolist()) if kind.kind == "frame" else kind.rpy
    return replace(kind, offset_a=tuple(relative.translation.tolist()), rpy=rpy)
