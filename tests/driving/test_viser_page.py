"""Viser page of a driven run: controls send commands, and limits are drawn and named."""

import numpy as np
import pytest

from browsing import listening, opened, visit
from drives import in_real_time, point_of, prepared
from patience import eventually
from rnc_pin.driving.drive_log import CommandQueue

SLOW = {
    "type": "qp", "tracker": "computed_torque", "tasks": [{"damping": {}}],
    "limits": {"joint_velocity": {"joints": ["joint_1"], "limit": 0.04}},
}  # fmt: skip
BALL = {"sphere": {"name": "ball", "radius": 0.1, "position": [3.0, 2.0, 0.48]}}


def test_a_user_drives_in_viser():
    pytest.importorskip("viser", reason="viser is an optional extra and not installed")
    from rnc_pin.driving.viser_page import ViserDrivePage

    run = prepared("mobile-manipulator", controller=SLOW, simulation__dt=0.02, obstacles=[BALL])
    queue, before = CommandQueue(run.controls), listening()
    page = ViserDrivePage(run, queue, "Drive", open_browser=False)
    with opened() as launched, in_real_time(run, queue, page) as results:
        assert {address for address, _ in listening() - before} == {"0100007F"}
        shown, _ = visit(launched, page.url)
        shown.wait_for_selector("text=Forward (W)")
        shown.dispatch_event("button:has-text('Forward (W)')", "click")
        assert eventually(lambda: logged(run, "BaseVelocity"))
        assert logged(run, "BaseVelocity")[0].forward == 1.0
        viewer = page._viewer
        begun = np.array(viewer._gizmos["tip"].position)
        queue.put({"kind": "joint_goal", "joint": "joint_1", "position": 3.0})
        assert eventually(lambda: "joint_1 velocity" in viewer._texts.content)
        assert eventually(lambda: {"link_1_0", "link_1_1", "link_1_2"} <= set(viewer._lit))
        assert eventually(lambda: abs(viewer._sliders["joint_1"].value - 3.0) < 0.02)
        assert eventually(lambda: viewer._lit["link_1_0"].visible)
        assert eventually(lambda: np.linalg.norm(viewer._gizmos["tip"].position - begun) > 0.01)
        shown.dispatch_event("button:has-text('End run')", "click")
    assert page.problem is None
    # The gizmo of a frame without a goal has followed the frame; the last status may be late on a busy machine.
    way = np.array([point_of(run, q, "tip") for q in results[0].trajectory.q])
    assert np.linalg.norm(way - viewer._gizmos["tip"].position, axis=1).min() < 1e-3
    assert str(results[0].trajectory.outcome) == "completed"


def logged(run, name):
    return [each.command for each in run.log.commands if type(each.command).__name__ == name]
