"""A telescope: a tool that slides along its rail, and passes through it below 1.02 m."""

_INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def _box(name: str, length: float) -> str:
    shape = f'<collision><geometry><box size="{length} 0.1 0.1"/></geometry></collision>'
    return f'<link name="{name}">{_INERTIAL}{shape}</link>'


def _joint(name: str, parent: str, child: str, reach: float) -> str:
    limit = f'<limit lower="0" upper="{reach}" velocity="9" effort="99"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/><axis xyz="1 0 0"/>'
    return f'<joint name="{name}" type="prismatic">{ends}{limit}</joint>'


def telescope(reach: float) -> str:
    """URDF with joints "one", up to 0.01 m, and "two".

    Args:
        reach: upper limit of "two" [m].
    """
    links = f'{_box("rail", 2.0)}<link name="middle">{_INERTIAL}</link>{_box("tool", 0.04)}'
    joints = _joint("one", "rail", "middle", 0.01) + _joint("two", "middle", "tool", reach)
    return f'<robot name="telescope">{links}{joints}</robot>'
