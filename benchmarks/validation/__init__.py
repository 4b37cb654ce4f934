"""Published and closed-form results beside what rnc_pin computes. Run ``python -m benchmarks.validation``."""

from benchmarks.validation import (
    ball,
    bicycle,
    carried,
    disk,
    floating_arm,
    grasping,
    kapitza,
    measured_bicycles,
    roller_racer,
    rolling_body,
    sleigh,
    slope,
    snakeboard,
    trailers,
)

PROBLEMS = {
    "bicycle": bicycle.rows,
    "measured_bicycles": measured_bicycles.rows,
    "disk": disk.rows,
    "sleigh": sleigh.rows,
    "slope": slope.rows,
    "ball": ball.rows,
    "floating_arm": floating_arm.rows,
    "grasping": grasping.rows,
    "snakeboard": snakeboard.rows,
    "roller_racer": roller_racer.rows,
    "rolling_body": rolling_body.rows,
    "carried": carried.rows,
    "kapitza": kapitza.rows,
    "trailers": trailers.rows,
}
