"""Complete scenario for one assumed base, tested by a trial run."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from rnc_pin.applications.init import assumptions, start_values
from rnc_pin.applications.init.evidence import mimic_drivers
from rnc_pin.applications.init.robot_at_start import RobotAtStart
from rnc_pin.applications.init.source import Source
from rnc_pin.applications.init.trial import FAR, MEANINGFUL, Trial, judged_trial, model_findings, write_draft
from rnc_pin.applications.scenario.builder import Experiment, build_experiment, build_system
from rnc_pin.applications.scenario.execution import Result, execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.io import Json, to_json_mapping
from rnc_pin.model import NonholonomicSystem
from rnc_pin.simulation import Outcome

_SHORT, _REST = 0.1, 1  # duration of the first trial run, and of the run after the end of the reference [s]
_PATIENCE = 20.0  # largest computing time of a trial run [s]
_ADAPTIVE = "adaptive needs no inertias; the alternative, tracker: computed_torque, needs all"
_INFORMED = "computed_torque knows the model; adaptive does not, and does not suit: {}"  # {}: the reason
_TRACKERS = {"adaptive": _ADAPTIVE, "computed_torque": _INFORMED}


class ScenarioCandidate:
    """Scenario for one assumed base.

    Args:
        mobility: assumptions about the base.
        source: the robot's file.
        at_start: the robot of the file, with its initial joint values.
    """

    def __init__(self, mobility: assumptions.BaseAssumptions, source: Source, at_start: RobotAtStart) -> None:
        # The order matters: locks change the robot, constraints its loose joints, and both the loads at the start.
        self.mobility, self.source, self.at_start = mobility, source, at_start
        self.robot = self.source.load(mobility.base, mobility.lock)
        mobility.lock = {**self.source.held, **mobility.lock}  # ``load`` may have held joints that move no mass
        self.start = {name: value for name, value in self.at_start.start.items() if name in self.robot.joint_names}
        mobility.mimic_drivers = mimic_drivers(self.robot, self.at_start.drives)
        mobility.passive |= set(mobility.mimic_drivers)
        self._undriven = assumptions.assume_motors(mobility, self.start, self.at_start.drives)
        assumptions.conserve_momentum_of_free_joints(mobility, self.robot)
        mobility.constraints += start_values.loop_closures(self.robot)
        self._hold_loose_joints()
        self.start, moved = start_values.with_regular_inertia(self.robot, self.start)
        mobility.notes += moved
        self._bear_weight()
        self.candidates = assumptions.actuator_candidates(mobility, self.robot, self.start, self._undriven)
        self.q0 = self._assembled_start(1.0)

    @cached_property
    def system(self) -> NonholonomicSystem:
        """System with all candidate actuators."""
        raw: dict[str, Json] = {
            "robot": self._robot_entry(),
            "constraints": [entry for entry, _ in self.mobility.constraints],
            "actuators": [entry for entry, _ in self.candidates.all],
            "outputs": {"reducing": [{"joint": "unused"}]},  # the schema wants one; nothing is reduced here
        }
        return build_system(validate(raw, "draft"), self.source.folder)

    def _assembled_start(self, share: float) -> np.ndarray:
        """Initial configuration (nq,) with a share of the usual motion, assembled: wheels on the ground."""
        q = self.robot.configuration({**self.start, **self.mobility.initial})
        lean = 0.05  # [rad]: half of the tilt for which inputs are weighted
        if self.mobility.lean is not None:
            pitched = pin.AngleAxis(lean * share, self.mobility.lean / np.linalg.norm(self.mobility.lean))
            q[3:7] = (pin.Quaternion(pitched) * pin.Quaternion(q[3:7])).coeffs()
        return self.system.assembled(q)

    def written(self) -> tuple[str, Trial]:
        """Return the text of the scenario with the controller that has the smallest tracking error, and its trial run.

        Raises:
            RncError: no controller completes the run.
        """
        mobility, chosen = self.mobility, self._chosen_outputs()
        if mobility.feedback is None:  # joints without effort and forces on the base only if the others are not enough
            mobility.actuators = self.candidates.enough(self.system.reduce(chosen.kinds).at(self.q0).input_matrix)
        else:  # feedback balances with fewer inputs than freedoms: rank tells nothing there
            mobility.actuators = [*self.candidates.sure, *self.candidates.wheels]
        against = [str(each[0]) for each in mobility.actuators if each in self.candidates.joints]
        idle = [name for name in self.start if name in mobility.without_effort and name not in against]
        why = "no actuator in the file" if self.source.is_mjcf else "effort 0 in the file"
        mobility.note(f"{why}, so that nothing drives them", idle)
        findings = model_findings(self.system, mobility, chosen.entries, against)
        is_loaded = not mobility.weightless and self.start and start_values.is_loaded(self.robot, self.q0, self.start)
        failures = ["gravity loads the robot, and it learns this load slowly"] if is_loaded else []
        best: tuple[str, Trial] | None = None
        for controller, dt, remark in self._controllers(is_loaded=bool(failures)):
            # A second period serves controllers that fail with the first. Of an adaptive one that runs, learning is the
            # error, and not sampling.
            if best is not None and controller.get("tracker") == "adaptive":
                continue
            simulation: dict[str, Json] = {"duration": assumptions.DURATION + _REST, "dt": dt}
            settings: dict[str, Json] = {"controller": controller, "simulation": simulation}
            try:
                trial = self._try_within_limits(chosen, settings)
            except RncError as error:  # in a draft, a failure is evidence: the remark on the next controller has it
                failures.append(str(error))
                continue
            if best is None or trial.relative_error < best[1].relative_error:
                trial = replace(trial, findings=(*findings, *trial.findings))
                raw, said = self._scenario(chosen, settings, trial.share), remark.format(*failures[:1])
                best = write_draft(self.robot.name, raw, said, trial, mobility), trial
            if trial.relative_error < FAR:
                break
            failures.append(f"its run {trial.failure_text}")
        if best is None:
            raise ConfigurationError(failures[-1])
        return best

    def _controllers(self, is_loaded: bool) -> list[tuple[Mapping[str, Json], float, str]]:
        """Settings, period [s] and remark of each candidate controller, the preferred one first."""
        if self.mobility.feedback is not None:
            periods = (0.002, 0.0005)  # small robots fall fast
            said = "uses the model: state feedback by linearize and lqr at the start"
            return [(self.mobility.feedback, dt, said) for dt in periods]
        return [
            ({"type": "reducing_outputs", "tracker": tracker, "preset": "scaled"}, dt, remark)
            for tracker, remark in _TRACKERS.items()
            for dt in (0.002, 0.001)  # [s]
            if not (is_loaded and tracker == "adaptive")
        ]

    # ------------------------------------------------------------------ trial runs

    def _try_within_limits(self, chosen: assumptions.ChosenOutputs, settings: Mapping[str, Json]) -> Trial:
        """Try the scenario; if it exceeds velocities or efforts of the file, reduce its motion until it keeps them.

        If no motion keeps them, the usual one stays.
        """
        trial = usual = self._try_out(chosen, settings, 1.0)
        most, least_share = 3, 0.05  # number of smaller motions that are tried, and the smallest share of the usual one
        with suppress(RncError):
            for _ in range(most):
                share = trial.share * trial.kept_share
                # Less than a twentieth of the motion would show nothing of the robot.
                if trial.kept_share == 1.0 or share < least_share:
                    break
                # Rounded down to percents, which the file states.
                trial = self._try_out(chosen, settings, math.floor(100 * share) / 100)
        return trial if trial.kept_share == 1.0 else usual

    def _try_out(self, chosen: assumptions.ChosenOutputs, settings: Mapping[str, Json], share: float) -> Trial:
        """Build the scenario with its preflight and run it: briefly, then as far as the computing time permits."""
        raw = self._scenario(chosen, settings, share)
        experiment = build_experiment(validate(raw, "draft"), self.source.folder)
        # A tenth of a second first: it tells the speed of this robot, and most failures.
        result, taken = self._run(raw, experiment, _SHORT)
        possible = round(_SHORT * _PATIENCE / max(taken, 1e-6), 1)
        if possible >= MEANINGFUL:
            result, _ = self._run(raw, experiment, min(assumptions.DURATION + _REST, possible))
        trial = judged_trial(result, self._motions(chosen, share), share, self.mobility, self.robot)
        return replace(trial, findings=(*trial.findings, *experiment.start_findings))

    def _run(self, raw: dict[str, Json], experiment: Experiment, duration: float) -> tuple[Result, float]:
        """Run a part of an experiment; return the result and the processor time of its samples [s]."""
        clock: list[float] = []  # of this process: other work on the machine changes no draft
        brief = replace(experiment, simulation=experiment.simulation.model_copy(update={"duration": duration}))
        made = Scenario("draft", raw, self.source.folder).built_with(content=experiment.scenario, experiment=brief)
        result = execute(made, lambda _: clock.append(time.process_time()))
        if result.error is not None:
            raise result.error
        if result.trajectory.outcome is not Outcome.COMPLETED:
            raise ConfigurationError(f"its run ends early: {result.trajectory.outcome.value}")
        return result, clock[-1] - clock[0]

    # ------------------------------------------------------------------ parts of the scenario

    def _hold_loose_joints(self) -> None:
        """Lock joints without an actuator in the file that no constraint couples to others; mimic joints together."""
        mobility, groups = self.mobility, self._coupled_by_mimics
        free = start_values.uncoupled_joints(mobility.constraints, self.robot, self.start)
        # A follower with a motor moves its leader: the group is loose only if all of it is.
        moved_together = (groups.get(name, {name}) for name in self._undriven)
        idle = {name for group in moved_together if group <= {*free} for name in group}
        loose = [name for name in self.start if name in idle]
        if loose:
            mobility.hold(loose, "locked, because neither an actuator nor a constraint moves them")
            self.robot = self.source.load(mobility.base, mobility.lock)
            self.start = {name: value for name, value in self.start.items() if name in self.robot.joint_names}

    @property
    def _coupled_by_mimics(self) -> dict[str, set[str]]:
        """Joints that move together by mimics of the file, by the name of each."""
        groups: dict[str, set[str]] = {}
        for joint, driver in self.mobility.mimic_drivers.items():
            groups.setdefault(driver, {driver}).add(joint)
        return {name: group for group in groups.values() for name in group}

    def _bear_weight(self) -> None:
        """Move the start of joints whose weight needs more than the efforts of the file."""
        mobility = self.mobility
        # In space nothing has weight, and feedback chooses its own equilibrium near the start.
        if mobility.weightless or mobility.feedback is not None:
            return
        others = {*mobility.passive, *self._undriven, *self._coupled_by_mimics}
        free = start_values.uncoupled_joints(mobility.constraints, self.robot, self.start)
        held = [name for name in free if name not in others]
        self.start, moved = start_values.with_bearable_loads(self.robot, self.start, held)
        mobility.notes += moved

    def _robot_entry(self) -> dict[str, Json]:
        """Robot entry of the scenario."""
        mobility = self.mobility
        lock: dict[str, Json] = {"lock": mobility.lock} if mobility.lock else {}
        gravity: dict[str, Json] = {"gravity": [0, 0, 0]} if mobility.weightless else {}
        return {**self.source.robot_entry(mobility.base), **lock, **gravity}

    def _motions(self, chosen: assumptions.ChosenOutputs, share: float) -> dict[str, float]:
        """Displacement of each reference by output; none of a robot that starts in motion, and keeps its speed."""
        steps = [] if self.mobility.v2 else zip(chosen.names, chosen.steps, strict=True)
        return {name: step * share for name, step in steps if name not in self.mobility.untracked}

    def _scenario(
        self, chosen: assumptions.ChosenOutputs, settings: Mapping[str, Json], share: float
    ) -> dict[str, Json]:
        """Scenario with the settings of a controller and a share of the usual motion."""
        mobility, motions = self.mobility, self._motions(chosen, share)
        primary = [name for name in chosen.names if name not in mobility.untracked]
        view: dict[str, Json] = {"trail": [mobility.frame] if mobility.base != "fixed" else []}
        if mobility.ground is not None or mobility.weightless:
            view["ground"] = None if mobility.ground is None else round(mobility.ground, 4) + 0.0  # no -0.0 in the file
        redundant = [name for name in chosen.names if name not in primary]
        scenario: dict[str, Json] = {
            "robot": self._robot_entry(),
            "constraints": [entry for entry, _ in mobility.constraints],
            "actuators": [entry for entry, _ in mobility.actuators],
            "outputs": {"reducing": chosen.entries, "vertical": mobility.vertical},
            "task": {"primary": primary, **({"redundant": redundant} if redundant else {})},
            "initial": self._initial(share),
            "view": view,
            **settings,
        }
        if motions:
            by = [round(step, 4) for step in motions.values()]
            scenario["reference"] = {"primary": {"minimum_jerk": {"by": by, "duration": assumptions.DURATION}}}
        return to_json_mapping(scenario, "draft")

    def _chosen_outputs(self) -> assumptions.ChosenOutputs:
        """Reducing outputs; their motion stays within the loops."""
        mobility = self.mobility
        wanted = assumptions.output_candidates(mobility, self.robot, self.start)
        chosen = assumptions.select_outputs(wanted, self.system, self.q0)
        # An output has one role: a reducing one is not vertical, too.
        mobility.vertical = [entry for entry in mobility.vertical if entry not in chosen.entries]
        if mobility.feedback is not None:
            return chosen
        coupled = {*self.start}.difference(start_values.uncoupled_joints(mobility.constraints, self.robot, self.start))
        mobility.notes += start_values.keep_within_loops(chosen, self.system, self.q0, coupled)
        return chosen

    def _initial(self, share: float) -> dict[str, Json]:
        """Joint values at the start, and rates of a robot that starts in motion: a steady speed, and a push."""
        mobility = self.mobility
        values = self.robot.joint_values(self._assembled_start(share))
        q: dict[str, Json] = {name: value for name, value in self.start.items() if value}
        q |= {name: (np.round(values[name], 9) + 0.0).tolist() for name in mobility.initial}
        kept = (mobility.feedback or {}).get("v2")
        steady = kept if isinstance(kept, Mapping) else {}
        v2 = {name: rate if name in steady else rate * share for name, rate in mobility.v2.items()}
        return {"q": q, "v2": v2} if v2 else {"q": q}
