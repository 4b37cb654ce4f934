"""Analysis of a reduced system before control: singularities, redundancy, integrability, equilibria, linearization."""

from rnc_pin.analysis.boundedness import Approach, Boundedness, boundedness
from rnc_pin.analysis.continuation import SteadyMotion, continuation
from rnc_pin.analysis.derivatives import StateDerivatives, state_derivatives
from rnc_pin.analysis.equilibrium import Equilibrium, equilibrium
from rnc_pin.analysis.grip import Grip, lift_off_along
from rnc_pin.analysis.growth import GrowthEvidence, growth_vector
from rnc_pin.analysis.integrability import Integrability, integrability
from rnc_pin.analysis.lemma_1 import lemma_1_residuals
from rnc_pin.analysis.limit_effects import LimitEffect
from rnc_pin.analysis.linearization import Linearization, linearize
from rnc_pin.analysis.normal_forces import LiftOff, NormalForces, first_lift_off
from rnc_pin.analysis.redundancy_class import Block, Evidence, Redundancy, Spread, classify
from rnc_pin.analysis.regulator import lqr
from rnc_pin.analysis.report import Report, analyze
from rnc_pin.analysis.singularities import Singularity

__all__ = [
    "Approach",
    "Block",
    "Boundedness",
    "Equilibrium",
    "Evidence",
    "Grip",
    "GrowthEvidence",
    "Integrability",
    "LiftOff",
    "LimitEffect",
    "Linearization",
    "NormalForces",
    "Redundancy",
    "Report",
    "Singularity",
    "Spread",
    "StateDerivatives",
    "SteadyMotion",
    "analyze",
    "boundedness",
    "classify",
    "continuation",
    "equilibrium",
    "first_lift_off",
    "growth_vector",
    "integrability",
    "lemma_1_residuals",
    "lift_off_along",
    "linearize",
    "lqr",
    "state_derivatives",
]
