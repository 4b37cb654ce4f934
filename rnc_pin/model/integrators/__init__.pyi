"""Exports of ``rnc_pin.model.integrators``, which ``__init__.py`` imports at their first use."""

from .adaptive import AdaptiveIntegrator as AdaptiveIntegrator
from .exponential_coordinates import ExponentialCoordinates as ExponentialCoordinates
from .exponential_coordinates import Rate as Rate
from .exponential_runge_kutta import ExponentialRungeKutta4 as ExponentialRungeKutta4
from .exponential_runge_kutta import LinearPart as LinearPart
from .exponential_runge_kutta import phi_functions as phi_functions
from .lie_runge_kutta import LieRungeKutta4 as LieRungeKutta4
