"""Differential inverse kinematics on wheels beside pink and mink; see ``python -m benchmarks.ik_peers --help``."""
