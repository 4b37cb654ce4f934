"""Viser page of a driven run: controls send commands, and limits are drawn and named."""

import threading

import numpy as np
import pytest

from browsing import listening, opened
from drives import point_of, prepared
from patience import PATIENCE, eventually
from rnc_pin.driving.drive_log import CommandQueue
from rnc_pin.driving.drive_run import drive
from rnc_pin.driving.real_time import RealTimeClock

SLOW = {
    "type": "qp", "tracker": "computed_torque", "tasks": [{"damping": {}}],
    "limits": {"joint_velocity": {"joints": ["joint_1"], "limit": 0.04}},
}  # fmt: skip
BALL = {"sphere": {"name": "ball", "radius": 0.1, "position": [3.0, 2.0, 0.48]}}


def test_a_user_drives_in_viser():
    pytest.importorskip("viser", reason="viser is an optional extra and not installed")
    from rnc_pin.driving.viser_page import ViserDrivePage

    run = prepared("mobile-manipulator", controller=SLOW, simulation__dt=0.02, obstacles=[BALL])
    queue, before, results = CommandQueue(run.controls), listening(), []
    page = ViserDrivePage(run, queue, "Drive", open_browser=False)
    thread = threading.Thread(target=lambda: results.append(drive(run, queue, 20_000, RealTimeClock(), page)))
    try:
        assert {address for address, _ in listening() - before} == {"0100007F"}
        thread.start()
        with opened() as launched:
            shown = launched.new_page(viewport={"width": 640, "height": 420})
            shown.goto(page.url)
            shown.wait_for_selector("text=Forward (W)", timeout=1000 * PATIENCE)
            shown.dispatch_event("button:has-text('Forward (W)')", "click")
            assert eventually(lambda: logged(run, "BaseVelocity"))
            assert logged(run, "BaseVelocity")[0].forward == 1.0
            viewer = page._viewer
            queue.put({"kind": "joint_goal", "joint": "joint_1", "position": 3.0})
            assert eventually(lambda: "joint_1 velocity" in viewer._texts.content)
            assert eventually(lambda: {"link_1_0", "link_1_1", "link_1_2"} <= set(viewer._lit))
            assert eventually(lambda: abs(viewer._sliders["joint_1"].value - 3.0) < 0.02)
            assert eventually(lambda: viewer._lit["link_1_0"].visible)
            shown.dispatch_event("button:has-text('End run')", "click")
            thread.join(timeout=10 * PATIENCE)
            assert not thread.is_alive()
    finally:
        queue.put({"kind": "end"})
        if thread.is_alive():
            thread.join(timeout=PATIENCE)
        page.close()
    assert page.problem is None
    # The gizmo of a frame without a goal has followed the frame; the last status may be late on a busy machine.
    way = np.array([point_of(run, q, "tip") for q in results[0].trajectory.q])
    gizmo = np.array(viewer._gizmos["tip"].position)
    moved = np.linalg.norm(way - way[0], axis=1)
    nearest = int(np.linalg.norm(way - gizmo, axis=1).argmin())
    assert moved[-1] > 0.01
    assert np.linalg.norm(way[nearest] - gizmo) < 1e-3
    assert moved[nearest] > 0.2 * moved[-1]
    assert str(results[0].trajectory.outcome) == "completed"


def logged(run, name):
    return [each.command for each in run.log.commands if type(each.command).__name__ == name]
