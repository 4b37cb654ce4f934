"""Exports of ``rnc_pin.model.integrators``, which ``__init__.py`` imports at their first use."""

from .exponential_runge_kutta import ExponentialRungeKutta4 as ExponentialRungeKutta4
from .exponential_runge_kutta import LinearPart as LinearPart
from .exponential_runge_kutta import phi_functions as phi_functions
from .runge_kutta import AdaptiveIntegrator as AdaptiveIntegrator
from .runge_kutta import ExponentialCoordinates as ExponentialCoordinates
from .runge_kutta import LieRungeKutta4 as LieRungeKutta4
from .runge_kutta import Rate as Rate
