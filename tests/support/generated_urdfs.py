"""URDFs of a snake on passive wheels, a spherical robot and a cart."""

INERTIA = (
    '<inertial><origin xyz="{at}"/><mass value="{m}"/><inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/>'
    "</inertial>"
)


def link(name, mass, geometry="", at="0 0 0", turn="0 0 0"):
    shape = f'<collision><origin rpy="{turn}"/><geometry>{geometry}</geometry></collision>' if geometry else ""
    return f'<link name="{name}">{INERTIA.format(at=at, m=mass, i=2e-3 * mass)}{shape}</link>'


def joint(name, parent, child, at, axis, kind="continuous", effort=5.0):
    ends = 'lower="-1.4" upper="1.4" ' if kind == "revolute" else ""
    limit = f'<limit {ends}effort="{effort}" velocity="5"/>' if kind != "fixed" else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}"/><axis xyz="{axis}"/>{limit}</joint>'
    )


def snake(bodies=8, forward=-1, yaw="yaw_{}", effort=5.0, extra="", drawn=False):
    """Bodies 0.2 m long with two wheels each in their middles, and joints halfway between them.

    Args:
        bodies: how many.
        forward: 1 where the body lies ahead of its root.
        yaw: names of the joints between bodies.
        effort: of those.
        extra: elements besides.
        drawn: whether wheels are only drawn.
    """
    parts = []
    for k in range(bodies):
        name = f"body_{k}"
        parts.append(link(name, 1.0, '<box size="0.16 0.06 0.04"/>', f"{forward * 0.1 * (k > 0)} 0 0"))
        middle = forward * 0.1 * (k > 0)
        if k:
            start = f"{forward * (0.1 if k == 1 else 0.2)} 0 0"
            parts.append(joint(yaw.format(k), f"body_{k - 1}", name, start, "0 0 1", "revolute", effort))
        for side, y in (("left", 0.05), ("right", -0.05)):
            shape = '<cylinder radius="0.03" length="0.01"/>'
            parts.append(link(f"{name}_{side}", 0.05, shape, turn="1.570796 0 0").replace("collision", "visual"))
            kind = "fixed" if drawn else "continuous"
            at = f"{middle} {y} -0.01"
            parts.append(joint(f"{name}_{side}_joint", name, f"{name}_{side}", at, "0 1 0", kind, 0.0))
    return f'<robot name="crawler">{"".join(parts)}{extra}</robot>'


def ball(shell='<sphere radius="0.3"/>', effort=8.0):
    """A shell with a yoke that turns about y, and a pendulum on it that leans about x."""
    parts = [
        link("shell", 2.0, shell).replace("0.004", "0.1"),
        link("yoke", 0.3),
        link("pendulum", 3.0, '<sphere radius="0.05"/>').replace("<origin rpy", '<origin xyz="0 0 -0.15" rpy'),
        joint("drive", "shell", "yoke", "0 0 0", "0 1 0", effort=effort),
        joint("lean", "yoke", "pendulum", "0 0 0", "1 0 0", "revolute", effort=effort),
    ]
    parts[2] = parts[2].replace('<origin xyz="0 0 0"/>', '<origin xyz="0 0 -0.15"/>', 1)
    return f'<robot name="roller">{"".join(parts)}</robot>'


def cart(**axles):
    """Two wheels on each axle, of which a plugin drives those of the axle called rear; places of axles [m] by name."""
    parts = [link("base", 10.0, '<box size="0.6 0.3 0.1"/>')]
    for end, x in axles.items():
        for side, y in (("left", 0.2), ("right", -0.2)):
            parts.append(link(f"{end}_{side}", 0.5, '<cylinder radius="0.1" length="0.04"/>', turn="1.570796 0 0"))
            parts.append(joint(f"{end}_{side}_joint", "base", f"{end}_{side}", f"{x} {y} 0", "0 1 0"))
    drive = "<left_joint>rear_left_joint</left_joint><right_joint>rear_right_joint</right_joint>"
    plugin = f'<gazebo><plugin name="drive" filename="libgazebo_ros_diff_drive.so">{drive}</plugin></gazebo>'
    return f'<robot name="cart">{"".join(parts)}{plugin}</robot>'
