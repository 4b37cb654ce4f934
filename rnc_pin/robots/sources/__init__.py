"""Readers of robot descriptions: URDF, xacro and MJCF, with reports of what Pinocchio ignores."""
