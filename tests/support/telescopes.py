"""A telescope: a tool that slides along its rail, and passes through it below 1.02 m."""

from urdf_parts import joint, link, robot


def telescope(reach: float) -> str:
    """URDF with joints "one", up to 0.01 m, and "two", up to ``reach`` [m]."""
    slides = {"axis": "1 0 0", "kind": "prismatic", "effort": 99, "speed": 9}
    return robot(
        link("rail", shape='<box size="2 0.1 0.1"/>'), link("middle"), link("tool", shape='<box size="0.04 0.1 0.1"/>'),
        joint("one", "rail", "middle", limits=(0, 0.01), **slides),
        joint("two", "middle", "tool", limits=(0, reach), **slides), name="telescope",
    )  # fmt: skip
