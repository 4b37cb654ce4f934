"""A cart on two wheels with an arm of two links that reaches below the floor."""

import rnc_pin as rnc

RADIUS = 0.1  # of the wheels [m]
WHEELS = ("wheel_left", "wheel_right")
INERTIA = """<inertial><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>"""
LINK = """
  <link name="{name}">{inertia}
    <collision><origin xyz="{place}" rpy="{angles}"/><geometry>{shape}</geometry></collision></link>"""
JOINT = """
  <joint name="{name}" type="{kind}"><parent link="{above}"/><child link="{link}"/>
    <origin xyz="{place}"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="3"/></joint>"""
LINKS = (
    ("cart", "0 0 0.25", "0 0 0", '<box size="0.4 0.3 0.2"/>'),
    *((name, "0 0 0", "1.5707963 0 0", f'<cylinder radius="{RADIUS}" length="0.04"/>') for name in WHEELS),
    *((name, "0.2 0 0", "0 0 0", '<box size="0.35 0.04 0.04"/>') for name in ("upper", "lower")),
)
JOINTS = (
    ("wheel_left_joint", "continuous", "cart", "wheel_left", "0 0.2 0.1"),
    ("wheel_right_joint", "continuous", "cart", "wheel_right", "0 -0.2 0.1"),
    ("shoulder", "revolute", "cart", "upper", "0.25 0 0.3"),
    ("elbow", "revolute", "upper", "lower", "0.4 0 0"),
)


def cart_urdf() -> str:
    """Robot file."""
    text = "<robot name='cart'>"
    for name, place, angles, shape in LINKS:
        text += LINK.format(name=name, place=place, angles=angles, shape=shape, inertia=INERTIA)
    for name, kind, above, link, place in JOINTS:
        text += JOINT.format(name=name, kind=kind, above=above, link=link, place=place)
    return text + "</robot>"


def cart_with_arm(folder) -> rnc.Robot:
    """The robot, with its file in a folder."""
    file = folder / "cart.urdf"
    file.write_text(cart_urdf())
    return rnc.Robot.from_urdf(file, base="planar")
