"""A real browser for tests, and what it sees."""

import io
import os
import socket
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from matplotlib import image

import rnc_pin as rnc
from patience import PATIENCE
from rnc_pin.visualization.recording import browser


def give_up(reason):
    """Browsers may be missing on somebody's machine, but not where changes are checked."""
    if os.environ.get("CI"):
        pytest.fail(reason)
    pytest.skip(reason)


@contextmanager
def opened():
    try:
        context = browser()
        launched = context.__enter__()
    except rnc.ConfigurationError as error:
        give_up(str(error))
    try:
        yield launched
    finally:
        context.__exit__(None, None, None)


def sample(t, q):
    """Sample that an observer of a bare robot gets."""
    return rnc.simulation.Sample(t, rnc.Measurement(q=q), rnc.control.Command(), np.empty(0))


def visit(launched, url, offline=False):
    """A page, and a list that collects whatever goes wrong in it, such as a request that leaves the site."""
    context = launched.new_context(offline=offline, viewport={"width": 640, "height": 420})
    context.set_default_timeout(1000 * PATIENCE)
    page, problems = context.new_page(), []
    home = (url.split("/static/")[0], "data:", "blob:", "about:srcdoc")
    page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("requestfailed", lambda request: problems.append(f"failed: {request.url[:100]}"))
    page.on("request", lambda request: None if request.url.startswith(home) else problems.append(request.url[:100]))
    page.goto(url)
    return page, problems


def port_of(url):
    """Port of the address of a page."""
    return int(url.split(":")[2].split("/")[0])


def asked(port, path, *headers, upgrade=False, version="1.1"):
    """Connection and status of a request with these headers."""
    lines = [f"GET {path} HTTP/{version}", *headers]
    if upgrade:
        lines += ["Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13"]
        lines += ["Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ=="]
    connection = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)
    connection.sendall(("\r\n".join(lines) + "\r\n\r\n").encode("latin-1"))
    answer = b""
    while b"\r\n" not in answer:
        piece = connection.recv(4096)
        if not piece:
            break
        answer += piece
    return connection, int(answer.split()[1]) if answer else None


def watching(port):
    """Connection of a web socket that our own page asks for."""
    headers = f"Host: localhost:{port}", f"Origin: http://localhost:{port}"
    connection, status = asked(port, "/", *headers, upgrade=True)
    assert status == 101
    return connection


def picture(page):
    """Picture of a drawn page, without overlay and player, (height, width, 3) in [0, 1]."""
    page.evaluate("document.body.classList.add('still')")
    page.evaluate("document.querySelectorAll('#overlay, #foot').forEach(part => { part.style.visibility = 'hidden'; })")
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    shot = image.imread(io.BytesIO(page.screenshot(timeout=1000 * PATIENCE)))[..., :3]
    page.evaluate("document.querySelectorAll('#overlay, #foot').forEach(part => { part.style.visibility = ''; })")
    return shot


def vivid(shot):
    """Number of pixels in strong colours: the robot has them, the stage is grey and pale blue."""
    return int((np.ptp(shot, axis=-1) > 0.35).sum())


def changed(shot, other):
    """Number of pixels that clearly differ."""
    return int((np.abs(shot - other).max(axis=-1) > 0.1).sum())


def place(page, *path):
    """Position of a part in the page [m]."""
    names = ", ".join(f"'{name}'" for name in ("meshcat", *path))
    return page.evaluate(f"viewer.scene_tree.find([{names}]).object.position.toArray()")


def shape_place(robot, q, name):
    """Position of a shape of a robot at a configuration, by Pinocchio [m]."""
    geometry = robot.visual_model
    data, shapes = robot.model.createData(), geometry.createData()
    pin.updateGeometryPlacements(robot.model, data, geometry, shapes, q)
    return shapes.oMg[geometry.getGeometryId(name)].translation


def children(page, *path):
    """Names of the parts of a group, as the viewer's controls list them."""
    names = ", ".join(f"'{name}'" for name in ("meshcat", *path))
    return page.evaluate(f"Object.keys(viewer.scene_tree.find([{names}]).children)")


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
