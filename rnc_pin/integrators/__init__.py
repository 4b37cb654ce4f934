"""Integrators on the configuration manifold."""

from rnc_pin.integrators.adaptive import AdaptiveIntegrator
from rnc_pin.integrators.exponential_coordinates import ExponentialCoordinates, Rate
from rnc_pin.integrators.exponential_runge_kutta import ExponentialRungeKutta4, LinearPart, phi_functions
from rnc_pin.integrators.lie_runge_kutta import LieRungeKutta4

__all__ = [
    "AdaptiveIntegrator",
    "ExponentialCoordinates",
    "ExponentialRungeKutta4",
    "LieRungeKutta4",
    "LinearPart",
    "Rate",
    "phi_functions",
]
