"""Where outputs should go."""

from rnc_pin.planning.references import (
    Harmonic,
    Hold,
    Joined,
    MinimumJerk,
    Reference,
    ReferencePoint,
    TaskReference,
    ViaPoints,
)

__all__ = ["Harmonic", "Hold", "Joined", "MinimumJerk", "Reference", "ReferencePoint", "TaskReference", "ViaPoints"]
