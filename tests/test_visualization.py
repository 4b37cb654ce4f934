"""Pictures: plots, recordings and the live page, the latter two in a real browser, and who can connect to them."""

import gc
import http.client
import io
import os
import shutil
import socket
import struct
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import meshcat
import numpy as np
import pinocchio as pin
import pytest
from matplotlib import image

import rnc_pin as rnc
from rnc_pin.scenario.run import execute, plan
from rnc_pin.visualization.live import LiveView
from rnc_pin.visualization.plots import plot_outputs, plot_overview
from rnc_pin.visualization.recording import RATE, record_html, sample_configurations
from rnc_pin.visualization.scene import Scene
from rnc_pin.visualization.scene_server import SceneWindow

VIEW = {"camera": [1.2, -2.3, 2.4], "target": [0.5, 0.1, -0.3], "ground": -1.3}
SINGLE_PRECISION = 1e-5  # [m]; what WebGL computes in, over a few metres
PATIENCE = 15.0  # [s]; for a browser without a graphics card on a busy machine


@pytest.fixture(scope="module")
def run():
    """Three seconds of the paper's figure 4."""
    options = {"simulation.duration": 3.0, "simulation.dt": 0.01, "comparisons": {}}
    return execute(plan("space-robot", options)).trajectory


@pytest.fixture(scope="module")
def robot():
    return rnc.Robot.from_urdf("space_robot.urdf")


def eventually(condition):
    """Whether a condition comes true before patience runs out."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.05)
    return False


# ---------------------------------------------------------------------- who can connect


def listening():
    """Addresses and ports on which this process listens, as the kernel has them."""
    inodes = set()
    for file in Path("/proc/self/fd").iterdir():
        try:
            inodes.add(os.readlink(file).removeprefix("socket:[").removesuffix("]"))
        except FileNotFoundError:  # the listing's own
            continue
    found = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/self/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and fields[9] in inodes:
                address, port = fields[1].split(":")
                found.add((address, int(port, 16)))
    return found


def can_connect(host, port):
    try:
        socket.create_connection((host, port), timeout=2).close()
    except ConnectionRefusedError:
        return False
    return True


def test_only_this_machine_can_connect():
    before, window = listening(), SceneWindow()
    port = int(window.serve().split(":")[2].split("/")[0])
    try:
        assert listening() - before == {("0100007F", port)}  # 127.0.0.1, and neither 0.0.0.0 nor [::]
        assert can_connect("127.0.0.1", port)
        assert not can_connect("127.0.0.2", port)
    finally:
        window.close()


def ask_to_watch(host, origin):
    """Ask for the web socket as a page of that origin does: (connection, status; 101 is yes)."""
    connection = http.client.HTTPConnection(host, timeout=PATIENCE)
    headers = {"Upgrade": "websocket", "Connection": "Upgrade", "Origin": origin}
    headers |= {"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version": "13"}
    connection.request("GET", "/", headers=headers)
    return connection, connection.getresponse().status


def test_other_web_sites_cannot_watch():
    window = SceneWindow()
    host = window.serve().split("/")[2]
    try:
        answers = {}
        for origin in (f"http://{host}", "http://elsewhere.example"):
            connection, answers[origin] = ask_to_watch(host, origin)
            connection.close()
        assert list(answers.values()) == [101, 403]
    finally:
        window.close()


def test_browsers_that_vanish_leave_no_trace(caplog):
    window = SceneWindow()
    host = window.serve().split("/")[2]
    scene = meshcat.Visualizer(window=window)
    try:
        for _ in range(20):
            connection, status = ask_to_watch(host, f"http://{host}")
            assert status == 101
            assert eventually(lambda: window.browsers == 1)
            # Closed without a word, as by a crash, while the robot goes on.
            connection.sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            connection.close()
            for _ in range(20):
                scene["robot"].delete()
            assert eventually(lambda: window.browsers == 0)
    finally:
        window.close()
    gc.collect()  # asyncio tells of an error that nobody looked at once it is collected
    assert [record.getMessage() for record in caplog.records] == []


def test_close_frees_the_port():
    window = SceneWindow()
    port = int(window.serve().split(":")[2].split("/")[0])
    window.close()
    assert not can_connect("127.0.0.1", port)
    again = SceneWindow()
    again.serve(port)
    again.close()
    again.close()  # a second time does no harm


def test_a_port_that_is_taken_is_refused():
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(rnc.ConfigurationError, match=f"port {port} on 127.0.0.1"):
            SceneWindow().serve(port)


def test_nothing_listens_for_a_recording(robot, run, tmp_path):
    before = listening()
    scene = Scene(robot)
    scene.animate(run.q[:3], RATE)
    assert listening() == before
    record_html(robot, run, tmp_path / "page.html")
    assert listening() == before


# ---------------------------------------------------------------------- in a browser


def give_up(reason):
    """Browsers may be missing on somebody's machine, but not where changes are checked."""
    if os.environ.get("CI"):
        pytest.fail(reason)
    pytest.skip(reason)


@pytest.fixture(scope="module")
def browser():
    names = ("chromium", "chromium-browser", "google-chrome")
    executable = next(filter(None, map(shutil.which, names)), None)
    if executable is None:
        give_up(f"no browser: none of {', '.join(names)} is installed")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        give_up("playwright is not installed")
    flags = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(
            executable_path=executable, args=[*flags, "--disable-background-networking"]
        )
        yield launched
        launched.close()


def visit(browser, url, offline=False):
    """A page, and a list that collects whatever goes wrong in it, such as a request that leaves the site."""
    context = browser.new_context(offline=offline, viewport={"width": 480, "height": 360})
    page, problems = context.new_page(), []
    home = (url.split("/static/")[0], "data:", "blob:")
    page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("requestfailed", lambda request: problems.append(f"failed: {request.url[:100]}"))
    page.on("request", lambda request: None if request.url.startswith(home) else problems.append(request.url[:100]))
    page.goto(url)
    return page, problems


def picture(page):
    """What the page shows once it has drawn, (height, width, 3) in [0, 1]."""
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return image.imread(io.BytesIO(page.screenshot()))[..., :3]


def vivid(shot):
    """Number of pixels in strong colours: the robot has them, the stage is grey and pale blue."""
    return int((np.ptp(shot, axis=-1) > 0.35).sum())


def changed(shot, other):
    """Number of pixels that clearly differ."""
    return int((np.abs(shot - other).max(axis=-1) > 0.1).sum())


def place(page, name):
    """Where a part of the robot is in the page [m]."""
    return page.evaluate(f"viewer.scene_tree.find(['meshcat', 'robot', 'visuals', '{name}']).object.position.toArray()")


def expected_place(robot, q, name):
    geometry = robot.visual_model
    data, shapes = robot.model.createData(), geometry.createData()
    pin.updateGeometryPlacements(robot.model, data, geometry, shapes, q)
    return shapes.oMg[geometry.getGeometryId(name)].translation


def test_a_recording_plays_in_a_browser_without_a_network(browser, robot, run, tmp_path):
    title = "Tip & <platform>"
    path = record_html(robot, run, tmp_path / "page.html", trail=["tip"], title=title, **VIEW)
    assert [each.name for each in tmp_path.iterdir()] == ["page.html"]
    page, problems = visit(browser, path.as_uri(), offline=True)
    assert page.title() == title
    page.wait_for_function("viewer.animator.time > 0.1", timeout=1000 * PATIENCE)  # it starts by itself
    page.evaluate("viewer.animator.pause()")
    assert page.evaluate("viewer.animator.duration") == pytest.approx(3.0)
    shots, trails = [], []
    frames = sample_configurations(robot, run)
    for frame in (0, 70, 0):
        page.evaluate(f"viewer.animator.seek({frame / RATE})")
        shots.append(picture(page))
        np.testing.assert_allclose(
            place(page, "tip_0"), expected_place(robot, frames[frame], "tip_0"), atol=SINGLE_PRECISION
        )
        pieces = "Object.values(viewer.scene_tree.find(['meshcat', 'trail', 'tip']).children)"
        trails.append(page.evaluate(f"{pieces}.filter(piece => piece.object.visible).length"))
    assert all(vivid(shot) > 1000 for shot in shots)
    assert changed(shots[0], shots[1]) > 1000
    assert changed(shots[0], shots[2]) < 100  # or the comparison above would mean nothing
    assert trails[0] == trails[2] < 3 < 30 < trails[1]
    assert problems == []
    page.context.close()


def test_the_live_page_follows_the_robot_and_may_be_closed(browser, robot):
    start, later = (robot.configuration({"joint_1": angle, "joint_2": 1.0}) for angle in (-0.5, 1.0))
    live = LiveView(robot, trail=["tip"], speed=0.0, open_browser=False, **VIEW)
    try:
        live(0.0, start)
        page, problems = visit(browser, live.url)
        assert live.wait_for_browser(PATIENCE)
        assert eventually(lambda: vivid(picture(page)) > 1000)
        before = picture(page)
        live(1.0, later)
        assert eventually(lambda: changed(before, picture(page)) > 1000)
        assert problems == []
        with ThreadPoolExecutor(1) as pool:
            moving = pool.submit(keep_moving, live, np.linspace(2.0, 20.0, 200), later)
            page.context.close()
            moving.result()
        assert eventually(lambda: not live.wait_for_browser(0.0))
        live(30.0, later)
        # Who comes later sees where the robot is by then, and its path.
        page, problems = visit(browser, live.url)
        assert live.wait_for_browser(PATIENCE)
        wanted = expected_place(robot, later, "tip_0")
        # The scene arrives piece by piece, so on a busy machine the picture comes before the last of them.
        assert eventually(lambda: np.allclose(place(page, "tip_0"), wanted, rtol=0, atol=SINGLE_PRECISION))
        assert eventually(lambda: page.evaluate("'tip' in viewer.scene_tree.find(['meshcat', 'trail']).children"))
        assert eventually(lambda: vivid(picture(page)) > 1000)
        assert problems == []
        page.context.close()
    finally:
        live.close()


def keep_moving(live, times, q):
    for t in times:
        live(t, q + 0.1 * np.sin(t))
        time.sleep(0.005)


# ---------------------------------------------------------------------- without a browser


def test_the_live_view_keeps_to_its_speed(robot):
    q = robot.configuration({"joint_2": 1.0})
    taken = {}
    for speed in (2.0, 0.0):
        live = LiveView(robot, speed=speed, open_browser=False)
        begin = time.monotonic()
        for t in np.arange(0.0, 1.001, 0.01):
            live(t, q)
        taken[speed] = time.monotonic() - begin
        live.close()
    assert taken[2.0] >= 0.45  # the last picture is due up to 1/30 s before the end
    assert taken[0.0] < 0.45


def test_a_recording_has_even_frames_on_the_trajectory(robot, run):
    frames = sample_configurations(robot, run)
    # Every fourth sample of 0.01 s is a frame of 0.04 s.
    np.testing.assert_allclose(frames, run.q[::4], atol=1e-12)


def test_frames_between_samples_stay_on_the_manifold():
    robot = rnc.Robot.from_urdf("fire_truck.urdf", base="planar")
    turns = np.stack([robot.configuration({"root_joint": [0, 0, 3 * t]}) for t in (0.0, 1.0)])
    frames = sample_configurations(robot, SimpleNamespace(time=np.array([0.0, 1.0]), q=turns))
    assert len(frames) == RATE + 1
    np.testing.assert_allclose(np.hypot(frames[:, 2], frames[:, 3]), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.unwrap(np.arctan2(frames[:, 3], frames[:, 2])), np.linspace(0, 3, 26), atol=1e-9)


def test_a_robot_without_geometry_cannot_be_drawn(robot):
    before = listening()
    bare = rnc.Robot(robot.model)
    with pytest.raises(rnc.ModelError, match="'space_robot' has no visual geometry to draw"):
        LiveView(bare, open_browser=False)
    assert listening() == before


def test_an_unknown_frame_has_no_trail(robot, run, tmp_path):
    with pytest.raises(rnc.ModelError, match="did you mean 'tip'"):
        record_html(robot, run, tmp_path / "page.html", trail=["tpi"])
    assert list(tmp_path.iterdir()) == []


# ---------------------------------------------------------------------- plots


def ink(path):
    """Share of pixels that are not white, of a PNG."""
    assert path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    return float((image.imread(path)[..., :3] < 0.99).any(axis=-1).mean())


def test_a_plot_of_outputs(run, tmp_path):
    path = plot_outputs(run, ["tip_x", "tip_y", "platform"], tmp_path / "plot.png", "Tip & platform")
    assert image.imread(path).shape[:2] == (720, 1280)
    assert 0.02 < ink(path) < 0.5


def test_an_overview(run, tmp_path):
    path = plot_overview(run, tmp_path / "overview.png", "All")
    assert image.imread(path).shape[:2] == (1280, 1280)
    assert 0.02 < ink(path) < 0.5


def test_every_comparison_is_drawn(run, tmp_path):
    others = {f"run {k}": replace(run, x2=run.x2 + 0.1 * k) for k in range(1, 6)}
    shots = []
    for count in range(6):
        shown = dict(list(others.items())[:count])
        path = plot_outputs(run, ["tip_x"], tmp_path / f"{count}.png", comparisons=shown)
        shots.append(image.imread(path)[..., :3])
    assert [count for count, (one, other) in enumerate(pairwise(shots), 1) if changed(one, other) < 1000] == []
