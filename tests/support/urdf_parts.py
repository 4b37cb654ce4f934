"""Small URDF files, from parts: links, joints, wheels on pivots, and what names their motors."""

import rnc_pin as rnc

BOX = '<box size="0.6 0.3 0.1"/>'
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'


def inertial(mass=1, moment=1):
    tensor = f'<inertia ixx="{moment}" iyy="{moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"/>'
    return f'<inertial><mass value="{mass}"/>{tensor}</inertial>'


INERTIAL = inertial()


def write(path, content):
    """Write text or bytes, and the folders above; return the path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def link(name, mass=1.0, shape="", turn="0 0 0", at="0 0 0", moment=None, geometry="collision"):
    """A link with the same moment of inertia about all axes, by default of a body of 0.1 m [kg m^2]."""
    moment = 0.01 * mass if moment is None else moment
    drawn = f'<{geometry}><origin xyz="{at}" rpy="{turn}"/><geometry>{shape}</geometry></{geometry}>' if shape else ""
    return (
        f'<link name="{name}"><inertial><origin xyz="{at}"/><mass value="{mass}"/><inertia ixx="{moment}" '
        f'iyy="{moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"/></inertial>{drawn}</link>'
    )


def joint(name, parent, child, at=(0, 0, 0), axis="0 1 0", kind="continuous", effort=10.0, limits=None, rpy="0 0 0",
          speed=20):  # fmt: skip
    """A joint; ``effort=None`` states no limit at all."""
    bounds = "" if limits is None else f'lower="{limits[0]}" upper="{limits[1]}" '
    limit = "" if effort is None else f'<limit {bounds}effort="{effort}" velocity="{speed}"/>'
    place = " ".join(f"{each:.9g}" for each in at)
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{place}" rpy="{rpy}"/><axis xyz="{axis}"/>{limit}</joint>'
    )


def wheel(name, parent, at, radius=0.1, effort=10.0, toe=0.0, shape=None):
    """A wheel about y, with the joint ``<name>_joint``; toe turns it about the vertical [rad]."""
    drawn = shape or f'<cylinder radius="{radius}" length="0.04"/>'
    rolls = joint(f"{name}_joint", parent, name, at, effort=effort, rpy=f"0 0 {toe}")
    return link(name, 0.5, drawn, turn="1.570796326794897 0 0") + rolls


def pivot(name, parent, at, effort=10.0, lean=0.0, turns_round=False):
    """A vertical joint ``<name>_joint`` that carries a small link."""
    kind, limits = ("continuous", None) if turns_round else ("revolute", (-1.0, 1.0))
    return link(name, 0.3) + joint(f"{name}_joint", parent, name, at, "0 0 1", kind, effort, limits, rpy=f"{lean} 0 0")


def caster(name, parent, at, radius=0.05, trail=0.04, effort=0.0):
    """A wheel behind a free swivel; ``at`` is the place of the swivel above the ground contact."""
    x, y, z = at
    roll = wheel(f"{name}_roll", name, (-trail, 0, 0), radius, effort)
    return pivot(name, parent, (x, y, z), effort, turns_round=True) + roll


def transmissions(*joints):
    return "".join(f'<transmission name="t_{each}"><joint name="{each}"/></transmission>' for each in joints)


def plugin(filename, *joints):
    named = "".join(f"<joint_name>{each}</joint_name>" for each in joints)
    return f'<gazebo><plugin name="p" filename="{filename}">{named}</plugin></gazebo>'


def robot(*parts, name="unit_7"):
    return f'<robot name="{name}">{"".join(parts)}</robot>'


def read(path, *parts, **options):
    """Robot of a file of these parts, which is written first."""
    return rnc.Robot.from_urdf(write(path, robot(*parts, name=path.stem)), **options)


def cart(**axles):
    """Two wheels on each axle, of which a plugin drives those of the axle called rear; places of axles [m] by name."""
    places = {f"{end}_{side}": (x, y, 0) for end, x in axles.items() for side, y in (("left", 0.2), ("right", -0.2))}
    wheels = [wheel(name, "base", place) for name, place in places.items()]
    drive = plugin("libgazebo_ros_diff_drive.so", "rear_left_joint", "rear_right_joint")
    return robot(link("base", 10.0, BOX), *wheels, drive, name="cart")
