"""Published and closed-form results beside what rnc_pin computes. Run ``python -m benchmarks.validation``."""

from benchmarks.validation import ball, bicycle, disk, floating_arm, grasping, kapitza, rolling_body, sleigh, snakeboard

PROBLEMS = {
    "bicycle": bicycle.rows,
    "disk": disk.rows,
    "sleigh": sleigh.rows,
    "ball": ball.rows,
    "floating_arm": floating_arm.rows,
    "grasping": grasping.rows,
    "snakeboard": snakeboard.rows,
    "rolling_body": rolling_body.rows,
    "kapitza": kapitza.rows,
}
