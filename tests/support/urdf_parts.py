"""Parts of small URDF files: links, joints, wheels on pivots, and what names their motors."""

BOX = '<box size="0.6 0.3 0.1"/>'


def link(name, mass=1.0, shape="", turn="0 0 0", at="0 0 0"):
    moment = 0.01 * mass
    geometry = f'<collision><origin xyz="{at}" rpy="{turn}"/><geometry>{shape}</geometry></collision>' if shape else ""
    return (
        f'<link name="{name}"><inertial><origin xyz="{at}"/><mass value="{mass}"/><inertia ixx="{moment}" '
        f'iyy="{moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"/></inertial>{geometry}</link>'
    )


def joint(name, parent, child, at, axis="0 1 0", kind="continuous", effort=10.0, limits=None, rpy="0 0 0"):
    """A joint; ``effort=None`` states no limit at all."""
    bounds = "" if limits is None else f'lower="{limits[0]}" upper="{limits[1]}" '
    limit = "" if effort is None else f'<limit {bounds}effort="{effort}" velocity="20"/>'
    place = " ".join(f"{each:.9g}" for each in at)
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{place}" rpy="{rpy}"/><axis xyz="{axis}"/>{limit}</joint>'
    )


def wheel(name, parent, at, radius=0.1, effort=10.0, toe=0.0, shape=None):
    """A wheel about y, with the joint ``<name>_joint``; toe turns it about the vertical [rad]."""
    drawn = shape or f'<cylinder radius="{radius}" length="0.04"/>'
    return link(name, 0.5, drawn, turn="1.570796326794897 0 0") + joint(
        f"{name}_joint", parent, name, at, effort=effort, rpy=f"0 0 {toe}"
    )


def pivot(name, parent, at, effort=10.0, lean=0.0, turns_round=False):
    """A vertical joint ``<name>_joint`` that carries a small link."""
    kind, limits = ("continuous", None) if turns_round else ("revolute", (-1.0, 1.0))
    return link(name, 0.3) + joint(f"{name}_joint", parent, name, at, "0 0 1", kind, effort, limits, rpy=f"{lean} 0 0")


def caster(name, parent, at, radius=0.05, trail=0.04, effort=0.0):
    """A wheel behind a free swivel; ``at`` is the place of the swivel above the ground contact."""
    x, y, z = at
    return pivot(name, parent, (x, y, z), effort, turns_round=True) + wheel(
        f"{name}_roll", name, (-trail, 0, 0), radius, effort
    )


def transmissions(*joints):
    return "".join(f'<transmission name="t_{each}"><joint name="{each}"/></transmission>' for each in joints)


def plugin(filename, *joints):
    named = "".join(f"<joint_name>{each}</joint_name>" for each in joints)
    return f'<gazebo><plugin name="p" filename="{filename}">{named}</plugin></gazebo>'


def robot(*parts, name="unit_7"):
    return f'<robot name="{name}">{"".join(parts)}</robot>'
