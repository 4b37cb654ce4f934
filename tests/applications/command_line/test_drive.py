"""``rnc-pin drive``: from the command line, and from a real browser."""

import json
import os
import re
import signal

import numpy as np
import pytest

import rnc_pin as rnc
from browsing import listening, place, visit
from drives import in_real_time, prepared
from patience import PATIENCE, eventually
from rnc_pin.applications.drive.page import DrivePage
from rnc_pin.applications.drive.run import CommandQueue, RealTimeClock
from rnc_pin.applications.scenario.execution import Drawn

QUICK = ["--no-browser", "--set", "simulation.dt=0.02"]


@pytest.fixture
def served(request):
    """A driven run, the queue of its page, and the page; a parameter is the title."""
    run = prepared("mobile-manipulator", controller=SLOW, simulation__dt=0.02)
    queue, before = CommandQueue(run.controls), listening()
    page = DrivePage(run, queue, getattr(request, "param", "Drive"), open_browser=False)
    assert {address for address, _ in listening() - before} == {"0100007F"}
    yield run, queue, page
    page.close()


def test_a_drive_is_a_normal_run(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rnc_pin.applications.scenario.execution._figure", lambda *_: None)
    status, out, said = call("drive", "mobile-manipulator", *QUICK, "--duration", 0.4, "--out", "one", "--json")
    assert status == 0, said
    assert "http://127.0.0.1:" in said
    summary = json.loads(out)
    assert {"trajectory.npz", "summary.json", "scenario.yaml", "animation.html"} <= {*summary["files"]}
    assert all((tmp_path / "one" / name).is_file() for name in summary["files"])


def test_ctrl_c_keeps_the_folder(call, tmp_path, monkeypatch):
    def interrupted(clock, t, wait=RealTimeClock.wait):
        if t > 0.2:
            signal.raise_signal(signal.SIGINT)
        wait(clock, t)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(RealTimeClock, "wait", interrupted)
    monkeypatch.setattr("rnc_pin.applications.command_line.report.draw_pictures", lambda *_: Drawn())
    status, _, said = call("drive", "mobile-manipulator", *QUICK, "--out", "kept")
    assert status == 1
    assert re.search(r"error: interrupted at t = [\d.]+ s; results so far are in kept", said)
    kept = rnc.Trajectory.load(tmp_path / "kept" / "trajectory.npz")
    assert kept.outcome is rnc.Outcome.INTERRUPTED
    assert len(kept.time) > 5


REFUSED = {
    "nothing": ([], "Missing argument 'SCENARIO|ROBOT'"),
    "an unknown name": (["space-robott"], "did you mean 'space-robot'"),
    "an unknown frame": (["mobile-manipulator", "--frame", "tipp"], "did you mean 'tip'"),
    "underactuated": (["snakeboard"], "snakeboard: cannot be driven by velocities"),
}


@pytest.mark.parametrize(("arguments", "words"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_driven_is_refused_in_one_line(arguments, words, call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, _, complaint = call("drive", *arguments, "--no-browser")
    assert status == 2
    assert words in complaint.splitlines()[-1]
    assert "Traceback" not in complaint
    assert os.listdir(tmp_path) == []


SLOW = {
    "type": "qp", "tracker": "computed_torque", "tasks": [{"damping": {}}],
    "limits": {"joint_velocity": {"joints": ["joint_1"], "limit": 0.2}},
}  # fmt: skip


def test_a_user_drives_from_a_real_browser(browser, served):
    drive_, queue, page_ = served
    with in_real_time(drive_, queue, page_) as results:
        page, problems = visit(browser, page_.url)
        page.set_viewport_size({"width": 1000, "height": 640})
        page.wait_for_selector("#drive button.stop", timeout=1000 * PATIENCE)
        page.wait_for_function("viewer.scene_tree.find(['meshcat', 'robot', 'visuals']).object.children.length > 0")

        def base():
            return np.array(place(page, "robot", "visuals", "base_0"))

        start = base()
        page.keyboard.down("w")
        assert eventually(lambda: base()[0] > start[0] + 0.2)
        page.keyboard.up("w")
        assert eventually(lambda: kinds(drive_)[-1] == ("base_velocity", 0.0))
        # A click on the ground: the page computes the point, the run says where it went.
        page.mouse.click(420, 430)
        assert eventually(lambda: [kind for kind, _ in kinds(drive_)][-1:] == ["base_goal"])
        wanted = drive_.log[-1].command
        eye = "[viewer.camera.position.x, -viewer.camera.position.z, viewer.camera.position.y]"
        assert np.linalg.norm(np.array([wanted.x, wanted.y]) - page.evaluate(eye)[:2]) < 20.0
        page.keyboard.press("Space")
        assert eventually(lambda: kinds(drive_)[-1][0] == "stop")
        # A slider asks for more than the velocity limit: a list names the limit.
        page.evaluate(
            "const s = document.querySelector('#drive > .slider input'); s.value = s.max;"
            "s.dispatchEvent(new Event('input'))"
        )
        assert eventually(lambda: kinds(drive_)[-1][0] == "joint_goal")
        active = "[...document.querySelectorAll('#limits li')].some(each => each.textContent === 'joint_1 velocity')"
        page.wait_for_function(active, timeout=1000 * PATIENCE)
        # Meshcat's own controls do not cover the button that stops the robot, open or not.
        page.click("#drive summary:has-text('Scene')")
        assert page.is_visible("#drive .dg.main li.title:has-text('Lights')")
        page.click("#drive button.stop", timeout=1000 * PATIENCE)
        assert eventually(lambda: kinds(drive_)[-1][0] == "stop")
        # Whatever a page sends, the run checks: the refusal is shown, and nothing moves by it.
        count = len(drive_.log)
        page.evaluate("drive_command({kind: 'base_goal', x: 1e9, y: 0})")
        said = "[...document.querySelectorAll('#messages li')].some(each => each.textContent.startsWith('refused'))"
        page.wait_for_function(said, timeout=1000 * PATIENCE)
        assert len(drive_.log) == count
        assert page.evaluate("document.querySelector('#drive .factor').textContent").endswith(" x")
        page.click("text=End run")
        assert eventually(lambda: results)
        page_.conclude(results[0].trajectory.verdict)
        words = "headline => [...document.querySelectorAll('#messages li')].some(each => each.textContent === headline)"
        headline = f"The run has ended. Verdict: {results[0].trajectory.verdict.word}"
        page.wait_for_function(words, arg=headline, timeout=1000 * PATIENCE)
        assert problems == []
        page.context.close()
    assert page_.problem is None
    assert results[0].trajectory.outcome is rnc.Outcome.COMPLETED
    kinds_seen = {kind for kind, _ in kinds(drive_)}
    assert {"base_velocity", "base_goal", "stop", "joint_goal", "end"} <= kinds_seen


def kinds(run_):
    """Kind and first number of the logged commands."""
    commands = [each.command for each in run_.log]
    return [(each.kind, next((value for _, value in each if isinstance(value, float)), None)) for each in commands]


def test_a_page_without_the_secret_may_watch_but_not_drive(browser, served):
    _, queue, page_ = served
    page, _ = visit(browser, page_.url.partition("#")[0])
    page.wait_for_selector("#messages li", state="attached", timeout=1000 * PATIENCE)
    assert "may only watch" in page.text_content("#messages")
    page.evaluate("drive_command({kind: 'stop'})")
    assert queue.take() == []
    page.context.close()


@pytest.mark.parametrize("leave", [lambda page: page.close(), lambda page: page.reload()])
def test_a_page_that_is_closed_stops_the_robot_whatever_it_was_told(leave, browser, served):
    (_, queue, page_), taken = served, []

    def last():
        taken.extend(each.kind for each in queue.take())
        return taken[-1:]

    page, _ = visit(browser, page_.url)
    page.wait_for_selector("#drive button.stop", timeout=1000 * PATIENCE)
    page.evaluate("drive_command({kind: 'base_goal', x: 3.0, y: 0.0})")
    assert eventually(lambda: last() == ["base_goal"])
    leave(page)
    assert eventually(lambda: last() == ["stop"])
    page.context.close()


@pytest.mark.parametrize(
    "served", ["Mobile manipulator: hand tracked, reach kept (section 4.2)"], indirect=True, ids=[""]
)
def test_a_phone_has_the_controls_below_the_picture(browser, served):
    """Neither the panel nor the overlay nor the legend covers another, and all of the panel can be reached."""
    drive_, queue, page_ = served
    with in_real_time(drive_, queue, page_):
        page, problems = visit(browser, page_.url)
        page.set_viewport_size({"width": 390, "height": 844})
        page.wait_for_selector("#drive button.stop", timeout=1000 * PATIENCE)
        page.wait_for_selector("#overlay td.value", timeout=1000 * PATIENCE)
        parts = ("#overlay", "#legend", "#drive")
        overlay, legend, panel = (page.eval_on_selector(part, BOX) for part in parts)
        for left, top, right, bottom in (overlay, legend, panel):
            assert 0 <= left < right <= 390
            assert 0 <= top < bottom <= 844
        assert overlay[3] <= legend[1] < legend[3] <= panel[1]
        assert eventually(lambda: page.eval_on_selector("#meshcat-pane canvas", BOX)[3] <= panel[1] + 1)
        page.locator("#drive summary:has-text('Scene')").scroll_into_view_if_needed()
        page.click("#drive summary:has-text('Scene')")
        assert problems == []
        queue.put({"kind": "end"})
        page.context.close()


BOX = "part => { const b = part.getBoundingClientRect(); return [b.left, b.top, b.right, b.bottom]; }"
