"""Exports of ``rnc_pin.motion``, which ``__init__.py`` imports at their first use."""

from . import optimal as optimal
from . import planning as planning
from . import whole_body as whole_body
