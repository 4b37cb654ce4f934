"""Kinds of findings about a motion, and their severity: names without imports, for the command line too."""

from __future__ import annotations

from enum import StrEnum


class Severity(StrEnum):
    """Weight of a finding: a motion with one that fails has not succeeded."""

    FAILS = "fails"
    DEGRADES = "degrades"
    NOTE = "note"


class FindingKind(StrEnum):
    """Kinds of findings. Their values are the names for ``--accept`` and for ``accept`` in scenario files."""

    ENDED_EARLY = "ended_early"
    """The run did not reach its end: it diverged, met a stop condition, failed or was interrupted."""
    SINGULAR = "singular"
    """The run reached a configuration where the outputs do not determine the motion."""
    NOT_FINITE = "not_finite"
    """A measurement, a state or an input was not a finite number."""
    GOAL = "goal"
    """The motion ended away from its goal."""
    POSITION = "position"
    """A joint left the range of the robot's file."""
    VELOCITY = "velocity"
    """A joint was faster than the robot's file allows."""
    EFFORT = "effort"
    """An actuator gave more than the robot's file allows."""
    ACCELERATION = "acceleration"
    """A joint accelerated more than a stated limit."""
    COLLISION = "collision"
    """Two bodies penetrate each other."""
    CLEARANCE = "clearance"
    """Two bodies came nearer than the distance that was asked for."""
    LIFT_OFF = "lift_off"
    """A contact that cannot pull had to pull."""
    SLIP = "slip"
    """A contact needed more friction than was stated."""
    FALLBACK = "fallback"
    """A fallback command was in use, because the loop had a fault or a program was late or failed."""
    BRAKING = "braking"
    """A program braked to keep its limits, or no braking motion could be verified."""
    SATURATION = "saturation"
    """An input was at its bound for a large part of the run."""
    PLAN = "plan"
    """A plan was driven whose re-integration does not confirm it."""
    MODEL = "model"
    """A property of the model was assumed or is not trusted, e.g. nearly dependent rows or an assumed radius."""
    INTEGRATION = "integration"
    """The integration of the motion was less accurate than its tolerance."""
    LIMIT_GAVE_WAY = "limit_gave_way"
    """A limit of a whole-body program gave way to others."""
