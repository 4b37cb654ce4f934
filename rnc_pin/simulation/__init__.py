"""Simulation of controllers in closed loop with a plant."""

from rnc_pin.plants import ReducedPlant
from rnc_pin.simulation.distance_findings import SHORTFALL, distance_findings
from rnc_pin.simulation.free_motion import free_motion
from rnc_pin.simulation.friction_demand import FrictionDemand, grip_along, within_grip
from rnc_pin.simulation.judgement import judge
from rnc_pin.simulation.limit_replay import Clearance, LimitReplay, LimitUse, obstacles_passed, replay_limits
from rnc_pin.simulation.phase_events import ContactLoss, OutputCrossing
from rnc_pin.simulation.phases import Phase, simulate_phases
from rnc_pin.simulation.preflight import Margins, margins_along, preflight
from rnc_pin.simulation.record import output_names
from rnc_pin.simulation.rollout import Rollout, kinematic_rollout
from rnc_pin.simulation.rollout_evaluation import Margin, RolloutEvaluation
from rnc_pin.simulation.run_info import (
    Columns,
    FallbackUse,
    Outcome,
    OutputNames,
    PhaseInfo,
    PlannedPath,
    Provenance,
    RunInfo,
    TaskNames,
)
from rnc_pin.simulation.simulate import sample_count, simulate
from rnc_pin.simulation.simulation_options import Observer, Sample, SimulationOptions
from rnc_pin.simulation.stop import Stop
from rnc_pin.simulation.summary import Summary, add_limits, add_verdict, summarize, tracking_errors
from rnc_pin.simulation.trajectory import Trajectory
from rnc_pin.simulation.trajectory_batch import TrajectoryBatch
from rnc_pin.simulation.tuned_tracker import tuned_tracker

__all__ = [
    "SHORTFALL",
    "Clearance",
    "Columns",
    "ContactLoss",
    "FallbackUse",
    "FrictionDemand",
    "LimitReplay",
    "LimitUse",
    "Margin",
    "Margins",
    "Observer",
    "Outcome",
    "OutputCrossing",
    "OutputNames",
    "Phase",
    "PhaseInfo",
    "PlannedPath",
    "Provenance",
    "ReducedPlant",
    "Rollout",
    "RolloutEvaluation",
    "RunInfo",
    "Sample",
    "SimulationOptions",
    "Stop",
    "Summary",
    "TaskNames",
    "Trajectory",
    "TrajectoryBatch",
    "add_limits",
    "add_verdict",
    "distance_findings",
    "free_motion",
    "grip_along",
    "judge",
    "kinematic_rollout",
    "margins_along",
    "obstacles_passed",
    "output_names",
    "preflight",
    "replay_limits",
    "sample_count",
    "simulate",
    "simulate_phases",
    "summarize",
    "tracking_errors",
    "tuned_tracker",
    "within_grip",
]
