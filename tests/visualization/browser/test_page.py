"""Pages that are served: to whom, and what a connection may cost; and modules that are imported at their first use."""

from __future__ import annotations

import gc
import os
import socket
import struct
import subprocess
import sys
import threading
import tracemalloc
from contextlib import closing, suppress
from pathlib import Path

import pytest

from browsing import asked, port_of, watching
from held_memory import holding_at_most
from patience import PATIENCE
from rnc_pin.visualization.browser.page import RequestFilter
from rnc_pin.visualization.browser.scene_server import SceneWindow
from rnc_pin.visualization.loop_view import LiveView
from urdf_parts import write


def sockets():
    found = 0
    for file in Path("/proc/self/fd").iterdir():
        try:
            found += os.readlink(file).startswith("socket:")
        except FileNotFoundError:
            continue
    return found


@pytest.fixture
def port():
    with closing(SceneWindow()) as window:
        yield port_of(window.serve())


def status(*arguments, **options):
    connection, code = asked(*arguments, **options)
    connection.close()
    return code


OURS = ["127.0.0.1", "localhost", "LOCALHOST", "[::1]", "127.0.0.5"]
OTHERS = [
    "evil.com", "127.0.0.1.evil.com", "localhost.evil.com", "evil.com:80@127.0.0.1", "192.168.1.2", "[::1", "", "a b",
    "localhost.", "127.0.0.1/evil.com", "127.1", "0.0.0.0",
]  # fmt: skip


@pytest.mark.parametrize("path", ["/static/", "/static/main.min.js", "/favicon.ico", "/nothing"])
def test_a_page_is_served_to_those_who_ask_for_this_computer(path, port):
    for name in OURS:
        assert status(port, path, f"Host: {name}:{port}") in (200, 204, 404)
    for name in OTHERS:
        assert status(port, path, f"Host: {name}") in (400, 403), name
    assert status(port, path, "Host: localhost", "Host: evil.com") in (400, 403)
    assert status(port, path, version="1.0") in (400, 403)


def test_a_web_socket_is_opened_for_our_own_page_alone(port):
    for name in OURS:
        host = f"{name}:{port}"
        assert status(port, "/", f"Host: {host}", f"Origin: http://{host}", upgrade=True) == 101
        assert status(port, "/", f"Host: {host}", upgrade=True) == 101  # no browser
    origins = ["http://evil.com", "null", "", "file://", f"http://localhost:{port + 1}", "http://localhost", "x" * 5000]
    for origin in origins:
        assert status(port, "/", f"Host: localhost:{port}", f"Origin: {origin}", upgrade=True) == 403, origin
        told = ["Sec-Fetch-Site: same-origin"]  # what it says of itself changes nothing
        assert status(port, "/", f"Host: localhost:{port}", f"Origin: {origin}", *told, upgrade=True) == 403
    assert status(port, "/", f"Host: evil.com:{port}", f"Origin: http://evil.com:{port}", upgrade=True) == 403


def test_who_is_admitted_elsewhere():
    everywhere, one = RequestFilter("0.0.0.0"), RequestFilter("192.0.2.7")
    here = socket.gethostname()
    for requests, hosts in ((everywhere, ["192.0.2.9:80", "[2001:db8::1]:80", here]), (one, ["192.0.2.7:80"])):
        assert all(requests.allows(host, f"http://{host}") for host in hosts)
        assert not requests.allows("evil.com", "http://evil.com")
        assert not requests.allows("evil.com", None)
        assert not requests.allows(None, None)
        assert not requests.allows("", None)
        assert not requests.allows(hosts[0], "http://evil.com")
    assert not one.allows("192.0.2.9", None)


def frame(size, sent, opcode=2, final=True):
    """The beginning of a web socket's frame that says it is of a size, masked with zeros."""
    return struct.pack("!BBQ", (0x80 if final else 0) | opcode, 0x80 | 127, size) + bytes(4) + bytes(sent)


def closed(connection):
    """Return True if the other end hangs up."""
    connection.settimeout(PATIENCE)
    try:
        while connection.recv(65536):
            pass
    except ConnectionResetError:
        pass
    except TimeoutError:
        return False
    return True


def test_messages_that_are_not_finished_cost_nothing(port):
    begun, first, further = frame(10_000_000, 9_900_000), *(frame(50_000, 50_000, code, final=False) for code in (2, 0))
    connections = []
    with holding_at_most(15):  # 120 MB are sent
        for k in range(12):
            connections.append(watching(port))
            with suppress(BrokenPipeError, ConnectionResetError):
                for piece in [begun] if k % 2 else [first, *[further] * 199]:
                    connections[-1].sendall(piece)
        assert all(map(closed, connections))
    for connection in connections:
        connection.close()


def test_a_request_that_is_too_long_is_not_waited_for(port):
    for text in (b"GET /" + b"a" * 1_000_000, b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 100_000):
        with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as connection:
            try:
                connection.sendall(text)
            except (BrokenPipeError, ConnectionResetError):
                continue
            assert closed(connection)
    body = f"POST /static/ HTTP/1.1\r\nHost: localhost:{port}\r\nContent-Length: 1000000000\r\n\r\n".encode()
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as connection:
        connection.sendall(body)
        assert closed(connection)


def test_closing_with_a_browser_connected_leaves_no_socket_and_no_memory(caplog, robot):

    def once():
        live = LiveView(robot, open_browser=False)
        port = port_of(live.url)
        connection = watching(port)
        assert live.wait_for_browser(PATIENCE)
        idle, code = asked(port, "/static/", f"Host: localhost:{port}")
        assert code == 200
        live.close()
        for each in (connection, idle):
            assert closed(each)
            each.close()

    for _ in range(3):
        once()
    gc.collect()
    before, threads = sockets(), threading.active_count()
    tracemalloc.start()
    try:
        for _ in range(10):
            once()
        gc.collect()
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert sockets() == before
    assert threading.active_count() == threads
    assert kept < 1e6  # it was 0.9 MB each
    assert [record.getMessage() for record in caplog.records if record.levelname == "ERROR"] == []


_NAMES = ("viser", "trimesh", "imageio", "IPython")
_PAGE = f"""
import sys
import rnc_pin.visualization.recording
found = [name for name in {_NAMES} if name in sys.modules]
assert not found, found
"""


def test_the_packages_of_pages_are_imported_only_when_they_are_used(tmp_path: Path) -> None:
    for name in _NAMES:  # found before those of the environment, which may lack them
        write(tmp_path / name / "__init__.py", "")
    write(tmp_path / "IPython/display.py", "HTML = str")
    searched = {**os.environ, "PYTHONPATH": str(tmp_path)}
    subprocess.run([sys.executable, "-c", _PAGE], check=True, timeout=PATIENCE, env=searched)
