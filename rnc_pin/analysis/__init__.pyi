"""Exports of ``rnc_pin.analysis``, which ``__init__.py`` imports at their first use."""

from rnc_pin.constraints.wheeled_base import wheel_height_findings as wheel_height_findings

from .contact_forces import Grip as Grip
from .derivatives import StateDerivatives as StateDerivatives
from .derivatives import state_derivatives as state_derivatives
from .equilibrium import Equilibrium as Equilibrium
from .equilibrium import equilibrium as equilibrium
from .exploration import Exploration as Exploration
from .exploration import Use as Use
from .exploration import default_candidates as default_candidates
from .exploration import explore as explore
from .exploration import short_names as short_names
from .exploration import tip_positions as tip_positions
from .growth import GrowthEvidence as GrowthEvidence
from .growth import growth_vector as growth_vector
from .linearization import Linearization as Linearization
from .linearization import check_sampling as check_sampling
from .linearization import linearize as linearize
from .linearization import lqr as lqr
from .normal_forces import LiftOff as LiftOff
from .normal_forces import NormalForces as NormalForces
from .normal_forces import first_lift_off as first_lift_off
from .normal_forces import near_lift_off as near_lift_off
from .privileged_coordinates import PrivilegedCoordinates as PrivilegedCoordinates
from .privileged_coordinates import privileged_coordinates as privileged_coordinates
from .redundancy_class import Evidence as Evidence
from .redundancy_class import Redundancy as Redundancy
from .redundancy_class import Singularity as Singularity
from .redundancy_class import classify as classify
from .report import Integrability as Integrability
from .report import Report as Report
from .report import analyze as analyze
from .report import integrability as integrability
from .report import lemma_1_residuals as lemma_1_residuals
