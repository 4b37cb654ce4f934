"""Recordings and live pages in a real browser: what is drawn, what plays, what can be switched."""

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import rnc_pin as rnc
from bodies import frame_placement
from browsing import changed, children, picture, place, sample, shape_place, visit, vivid
from patience import PATIENCE, eventually
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.visualization.browser.scene_server import SceneWindow
from rnc_pin.visualization.drawn_state import View
from rnc_pin.visualization.loop_view import LiveView
from rnc_pin.visualization.recording import Recording

SINGLE_PRECISION = 1e-5  # [m]; what WebGL computes in, over a few metres
VIEW = View(trail=["tip"], ground=-1.3)


@pytest.fixture(scope="module")
def space_robot():
    """Three seconds of the paper's figure 4: plan and result."""
    prepared = Scenario.load("space-robot", {"simulation.duration": 3.0, "simulation.dt": 0.01}).build()
    return prepared, execute(prepared)


@pytest.fixture(scope="module")
def fire_truck():
    prepared = Scenario.load("fire-truck", {"simulation.duration": 6.0, "simulation.dt": 0.01}).build()
    return prepared, execute(prepared)


def loaded(browser, recording, path, begin=None):
    """The page of a recording, read from a file with the network cut."""
    path.write_text(recording.html(begin), encoding="utf-8")
    page, problems = visit(browser, path.as_uri(), offline=True)
    page.wait_for_function("window.ready === true", timeout=1000 * PATIENCE)
    return page, problems


def row(page, label):
    """A figure in the overlay, once it is there."""
    page.wait_for_function("document.querySelector('#overlay tr td.value')?.textContent")
    return page.evaluate(
        "label => [...document.querySelectorAll('#overlay tr')]"
        ".find(line => line.cells[0].textContent === label).cells[1].textContent",
        label,
    )


def test_the_player_plays_scrubs_and_changes_speed(browser, space_robot, tmp_path):
    recording = Recording(space_robot[0].experiment.reduced, space_robot[1].trajectory, VIEW)
    page, problems = loaded(browser, recording, tmp_path / "page.html", begin=1.0)
    assert page.evaluate("viewer.animator.time") == pytest.approx(1.0)
    assert page.text_content("#clock") == "1.00 / 3.00 s"
    page.evaluate("const s = document.getElementById('slider'); s.value = 2.5; s.dispatchEvent(new Event('input'))")
    assert page.evaluate("viewer.animator.time") == pytest.approx(2.5)
    page.wait_for_function("document.getElementById('clock').value === '2.50 / 3.00 s'", timeout=1000 * PATIENCE)
    page.select_option("#speed", "0.1")
    assert page.evaluate("viewer.animator.mixer.timeScale") == pytest.approx(0.1)
    page.click("#play")
    # On a slow machine, two clicks from here could be further apart than the rest of the run.
    paused = "viewer.animator.time > 2.52 && (document.getElementById('play').click(), true)"
    page.wait_for_function(paused, timeout=1000 * PATIENCE)
    assert page.evaluate("viewer.animator.playing") is False
    assert problems == []
    page.context.close()


def test_everything_is_drawn_and_can_be_switched(browser, fire_truck, tmp_path):
    prepared, result = fire_truck
    experiment, run = prepared.experiment, result.trajectory
    recording = Recording(experiment.reduced, run, experiment.scenario.view, "Truck", result.comparisons)
    page, problems = loaded(browser, recording, tmp_path / "page.html", begin=4.0)
    # The viewer's own controls list what is there.
    layers = {"robot", "ground", "plan", "goal", "path", "tracks", "constraint forces"}
    assert layers | {"compared"} <= set(children(page))
    assert (len(children(page, "tracks")), len(children(page, "constraint forces", "rows"))) == (6, 3)
    assert page.evaluate("Object.keys(viewer.gui.__folders)") == ["Scene", "Save / Load / Capture", "Animations"]
    # The overlay says what the run says.
    i = 400
    position = [rnc.simulation.tracking_errors(run)[name][i] for name in ("tractor_x", "tractor_y")]
    assert (row(page, "time"), row(page, "error of tractor")) == ("4.00 s", f"{np.hypot(*position):.4f} m")
    assert row(page, "singularity margin") == f"{run.singular_value[i]:.4f}"
    # A force is where its axle is, and as long as its multiplier says.
    scales = []
    for k, frame in enumerate(("front_axle", "tractor_axle", "rear_axle")):
        axle = frame_placement(experiment.reduced.robot, run.q[i], frame)
        head = np.array(place(page, "constraint forces", "rows", str(k), "head"))
        away = head - axle.translation
        np.testing.assert_allclose(np.cross(away, axle.rotation[:, 1]), 0.0, atol=1e-4)
        scales.append(float(away @ axle.rotation[:, 1]) * run.multipliers[i, k])
    assert max(scales) < 0.0  # against the multiplier, which stands with the inertia
    # Switched off from the legend.
    before = picture(page)
    page.click("text=wheel tracks")
    assert page.evaluate("viewer.scene_tree.find(['meshcat', 'tracks']).object.visible") is False
    assert changed(before, picture(page)) > 30
    # Whose figures move as the animation does.
    page.evaluate("viewer.animator.seek(0.0)")
    page.wait_for_function("document.querySelector('#overlay td.value').textContent === '0.0000 s'")
    assert problems == []
    page.context.close()


def test_runs_are_compared_in_one_scene(browser, space_robot, tmp_path):
    prepared, result = space_robot
    reduced, (label, other) = prepared.experiment.reduced, next(iter(result.comparisons.items()))
    recording = Recording(reduced, result.trajectory, VIEW, "Both", {label: other})
    page, problems = loaded(browser, recording, tmp_path / "page.html", begin=3.0)
    for path, run in ((("compared", "0", "robot"), other), (("robot", "visuals"), result.trajectory)):
        wanted = shape_place(reduced.robot, run.q[-1], "tip_0")
        np.testing.assert_allclose(place(page, *path, "tip_0"), wanted, atol=SINGLE_PRECISION)
    material = "viewer.scene_tree.find(['meshcat', 'compared', '0', 'robot', 'tip_0', '<object>']).object.material"
    assert page.evaluate(f"{material}.opacity") == pytest.approx(0.4)
    shown = picture(page)
    page.evaluate("viewer.scene_tree.find(['meshcat', 'compared']).set_property('visible', false)")
    page.evaluate("viewer.set_dirty()")
    assert changed(shown, picture(page)) > 1000
    assert problems == []
    page.context.close()


FOREIGN = """new Promise(done => {
    document.addEventListener("securitypolicyviolation", event => done(event.blockedURI));
    if (%r === "picture") new Image().src = "http://192.0.2.1/skin.png";
    else if (%r === "socket") { try { new WebSocket("ws://192.0.2.1/"); } catch { /* the event tells */ } }
    else fetch("http://192.0.2.1/skin.png").catch(() => null);
})"""


@pytest.mark.parametrize("how", ["picture", "socket", "request"])
@pytest.mark.parametrize("served", [False, True])
def test_no_page_reaches_another_host(browser, served, how, tmp_path):
    window, path = SceneWindow(), tmp_path / "page.html"
    path.write_text(window.page(), encoding="utf-8")
    try:
        page, _ = visit(browser, window.serve() if served else path.as_uri())
        page.wait_for_function("window.viewer !== undefined", timeout=1000 * PATIENCE)
        assert "192.0.2.1" in page.evaluate(FOREIGN % (how, how))
        page.context.close()
    finally:
        window.close()


def test_the_live_page_follows_the_robot_and_may_be_closed(browser, robot):
    start, later = (robot.configuration({"joint_1": angle, "joint_2": 1.0}) for angle in (-0.5, 1.0))
    live = LiveView(robot, VIEW, speed=0.0, open_browser=False)
    try:
        live(sample(0.0, start))
        page, problems = visit(browser, live.url)
        assert live.wait_for_browser(PATIENCE)
        assert eventually(lambda: vivid(picture(page)) > 1000)
        before = picture(page)
        live(sample(1.0, later))
        assert eventually(lambda: changed(before, picture(page)) > 1000)
        assert eventually(lambda: row(page, "time") == "1.00 s")
        assert problems == []
        with ThreadPoolExecutor(1) as pool:
            moving = pool.submit(keep_moving, live, np.linspace(2.0, 20.0, 200), later)
            page.context.close()
            moving.result()
        assert eventually(lambda: not live.wait_for_browser(0.0))
        live(sample(30.0, later))
        # Who comes later sees where the robot is by then, and its path.
        page, problems = visit(browser, live.url)
        assert live.wait_for_browser(PATIENCE)
        wanted = shape_place(robot, later, "tip_0")
        there = ("robot", "visuals", "tip_0")
        assert eventually(lambda: np.allclose(place(page, *there), wanted, rtol=0, atol=SINGLE_PRECISION))
        assert eventually(lambda: "000" in children(page, "path", "tip", "tip"))
        assert eventually(lambda: vivid(picture(page)) > 1000)
        assert problems == []
        page.context.close()
    finally:
        live.close()
    assert live.problem is None


def keep_moving(live, times, q):
    for t in times:
        live(sample(t, q + 0.1 * np.sin(t)))
        time.sleep(0.005)
