"""A telescope: a tool that slides along its rail, and passes through it below 1.02 m."""

_INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'

_LINK = f'<link name="{{}}">{_INERTIAL}<collision><geometry><box size="{{}} 0.1 0.1"/></geometry></collision></link>'
_JOINT = (
    '<joint name="{}" type="prismatic"><parent link="{}"/><child link="{}"/><axis xyz="1 0 0"/>'
    '<limit lower="0" upper="{}" velocity="9" effort="99"/></joint>'
)


def telescope(reach: float) -> str:
    """URDF with joints "one", up to 0.01 m, and "two", up to ``reach`` [m]."""
    links = _LINK.format("rail", 2.0) + f'<link name="middle">{_INERTIAL}</link>' + _LINK.format("tool", 0.04)
    joints = _JOINT.format("one", "rail", "middle", 0.01) + _JOINT.format("two", "middle", "tool", reach)
    return f'<robot name="telescope">{links}{joints}</robot>'
