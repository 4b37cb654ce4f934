"""What a system can do, before it is controlled."""

from rnc_pin.analysis.growth import growth_vector
from rnc_pin.analysis.lemma_1 import lemma_1_residuals
from rnc_pin.analysis.redundancy import Redundancy, classify
from rnc_pin.analysis.report import Report, analyze

__all__ = ["Redundancy", "Report", "analyze", "classify", "growth_vector", "lemma_1_residuals"]
