"""The scene server and the live view: who can connect, what a browser can do to a run, and what is listening."""

import gc
import re
import signal
import socket
import struct
import subprocess
import time
import warnings
from contextlib import closing

import meshcat
import meshcat.geometry as mg
import numpy as np
import pytest
import umsgpack

import rnc_pin as rnc
from browsing import listening, port_of, sample, watching
from held_memory import holding_at_most
from patience import PATIENCE, eventually
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.simulation import RunInfo, output_names
from rnc_pin.visualization.browser.page import in_order, is_loopback
from rnc_pin.visualization.browser.scene_server import SceneWindow
from rnc_pin.visualization.loop_view import LiveView
from rnc_pin.visualization.meshcat_scene import MeshcatScene
from rnc_pin.visualization.recording import Recording
from rnc_pin.visualization.scene_bodies import draw_robot
from terminal import UNDRAWN
from urdf_parts import write


@pytest.fixture(scope="module")
def prepared():
    """Two seconds of the paper's figure 4."""
    return Scenario.load("space-robot", {"simulation.duration": 2.0, "simulation.dt": 0.01, "comparisons": {}}).build()


@pytest.fixture(scope="module")
def run(prepared):
    return execute(prepared).trajectory


def can_connect(host, port):
    try:
        socket.create_connection((host, port), timeout=2).close()
    except ConnectionRefusedError:
        return False
    return True


def test_only_this_machine_can_connect():
    before = listening()
    with closing(SceneWindow()) as window:
        port = port_of(window.serve())
        assert listening() - before == {("0100007F", port)}  # 127.0.0.1, and neither 0.0.0.0 nor [::]
        assert can_connect("127.0.0.1", port)
        assert not can_connect("127.0.0.2", port)


def test_browsers_that_vanish_leave_no_trace(caplog):
    with closing(SceneWindow()) as window:
        port, scene = port_of(window.serve()), meshcat.Visualizer(window=window)
        for _ in range(8):
            connection = watching(port)
            assert eventually(lambda: window.browsers == 1)
            # Closed without a word, as by a crash, while the robot goes on.
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            connection.close()
            for _ in range(20):
                scene["robot"].delete()
            assert eventually(lambda: window.browsers == 0)
    gc.collect()  # asyncio tells of an error that nobody looked at once it is collected
    assert [record.getMessage() for record in caplog.records] == []


def test_a_port_that_is_taken_is_refused():
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(rnc.ConfigurationError, match=f"port {port} on 127.0.0.1"):
            SceneWindow().serve(port)


def test_nothing_listens_for_a_recording(robot, run, tmp_path):
    before = listening()
    Recording(robot, run).save(tmp_path / "page.html")
    assert listening() == before
    assert [each.name for each in tmp_path.iterdir()] == ["page.html"]


def test_what_counts_as_this_machine_only():
    addresses = ("127.0.0.1", "127.0.0.2", "::1", "localhost", "0.0.0.0", "::", "192.0.2.1", "nowhere.invalid")
    assert [is_loopback(address) for address in addresses] == [True] * 4 + [False] * 4


def test_a_browser_that_reads_no_more_costs_no_memory():
    window = SceneWindow()
    port, scene = port_of(window.serve()), meshcat.Visualizer(window=window)
    points = np.random.default_rng(0).normal(size=(3, 20_000)).astype(np.float32)
    connection = watching(port)
    try:
        assert eventually(lambda: window.browsers == 1)
        with holding_at_most(15):
            for _ in range(200):  # 100 MB in all
                scene["path"].set_object(mg.PointCloud(points, np.abs(points).clip(max=1)))
            scene["late"].set_transform(np.eye(4))
            assert eventually(lambda: "late" in {path.rsplit("/", 1)[-1] for path, _ in list(window.latest)})
        assert window.browsers == 1
    finally:
        connection.close()
        window.close()


def test_the_loop_does_not_wait_for_a_browser_that_reads_no_more(prepared, run):
    experiment = prepared.experiment
    info = RunInfo(output_names(experiment.reduced), provenance=experiment.provenance)
    live = LiveView(experiment.reduced, info=info, speed=0.0, open_browser=False)
    with closing(live), closing(watching(port_of(live.url))):
        assert live.wait_for_browser(PATIENCE)
        shown = execute(prepared, live).trajectory
    assert live.problem is None
    # Every sample is there, and is what it would be if nobody had watched.
    for name in ("time", "q", "v2", "T", "multipliers"):
        np.testing.assert_array_equal(getattr(shown, name), getattr(run, name))


def test_pictures_are_dropped_when_drawing_is_slow(robot):
    drawn = []

    class Slow(LiveView):
        def draw(self, state):
            drawn.append(state.time)
            time.sleep(0.1)

    live = Slow(robot, speed=0.0, open_browser=False)
    for t in np.arange(0.0, 10.0, 0.01):
        live(sample(t, robot.configuration()))
    live.close()
    assert 1 <= len(drawn) < 500
    assert drawn == sorted(drawn)


def test_a_picture_that_fails_does_not_take_the_run_along(robot):
    class Broken(LiveView):
        def draw(self, state):
            raise ValueError("no ink")

    live = Broken(robot, speed=0.0, open_browser=False)
    live(sample(0.0, robot.configuration()))
    assert eventually(lambda: isinstance(live.problem, ValueError))
    live(sample(1.0, robot.configuration()))
    live.close()


def test_interruption_keeps_what_was_simulated(tmp_path):
    command = [*UNDRAWN, "run", "space-robot", "--show", "--no-browser", "--host", "0.0.0.0", "--out", "out"]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    try:
        told = [process.stderr.readline(), process.stderr.readline()]
        assert told[0] == "rnc-pin: warning: --host 0.0.0.0: everyone who can reach this address can watch\n"
        port = port_of(told[1].rpartition("http")[2])
        assert can_connect("127.0.0.1", port)
        assert can_connect("127.0.0.2", port)  # as asked for
        connection, seen = watching(port), b""
        while seen.count(b"set_transform") < 100:  # bodies have moved for some frames
            seen += connection.recv(65536)
        process.send_signal(signal.SIGINT)
        _, complaint = process.communicate(timeout=PATIENCE)
        connection.close()
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 1
    last = complaint.strip().splitlines()[-1]
    assert re.fullmatch(r"rnc-pin: error: interrupted at t = [\d.]+ s; results so far are in out", last)
    run = rnc.Trajectory.load(tmp_path / "out" / "trajectory.npz")
    assert run.outcome is rnc.Outcome.INTERRUPTED
    assert len(run.time) > 1
    assert not can_connect("127.0.0.1", port)


def test_the_live_view_keeps_to_its_speed(robot):
    q = robot.configuration({"joint_2": 1.0})
    live = LiveView(robot, speed=2.0, open_browser=False)
    begin = time.monotonic()
    for t in np.arange(0.0, 1.001, 0.01):
        live(sample(t, q))
    assert time.monotonic() - begin >= 0.45  # never faster; the last picture is due up to 1/30 s before the end
    live.close()


def test_a_robot_without_geometry_cannot_be_drawn(robot):
    before = listening()
    with pytest.raises(rnc.ModelError, match="'space_robot' has no visual or collision geometry to draw"):
        LiveView(rnc.Robot(robot.model), open_browser=False)
    assert listening() == before


def with_shapes(folder, shapes):
    """A robot of one link of 9 kg."""
    path = write(folder / "hull.urdf", f'<robot name="hull"><link name="hull">{shapes}</link></robot>')
    return rnc.Robot.from_urdf(path, base="planar", masses={"hull": 9.0})


def test_a_robot_with_collision_shapes_only_is_drawn_by_them(tmp_path):
    hull = '<geometry><box size="1 1 1"/></geometry>'
    for visual, count in (("", 2), (f"<visual>{hull}</visual>", 1)):
        window, shapes = SceneWindow(), visual + 2 * f"<collision>{hull}</collision>"
        draw_robot(with_shapes(tmp_path, shapes), MeshcatScene(window))
        assert len([key for key in window.latest if "set_object" in key and "hull" in str(key)]) == count


def test_drawing_visual_shapes_reads_no_collision_meshes(tmp_path):
    mesh = '<collision><geometry><mesh filename="missing.stl"/></geometry></collision>'
    box = '<visual><geometry><box size="1 1 1"/></geometry></visual>'
    robot = with_shapes(tmp_path, box + mesh)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert robot.drawn_geometry is robot.visual_model
    with pytest.warns(rnc.ModelWarning, match="1 mesh was not found"):
        _ = robot.collision_model


def test_the_latest_commands_stay_in_an_order_that_draws_the_scene():
    window = SceneWindow()
    for kind, path, size in (("set_transform", "a", 1), ("set_animation", "", 1), ("set_object", "a", 1),
                             ("set_object", "a/b", 1), ("set_transform", "/a", 2)):  # fmt: skip
        window.post({"type": kind, "path": path, "size": size})
    drawn = [umsgpack.unpackb(data) for data in in_order(window.latest)]
    assert [(each["path"], each["type"], each["size"]) for each in drawn] == [
        ("a", "set_object", 1), ("a/b", "set_object", 1), ("/a", "set_transform", 2), ("", "set_animation", 1),
    ]  # fmt: skip
    window.post({"type": "set_object", "path": "ab"})
    window.post({"type": "delete", "path": "a"})
    assert {path for path, _ in window.latest} == {"ab", ""}
