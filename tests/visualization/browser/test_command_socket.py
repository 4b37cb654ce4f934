"""Commands of a page: only from our own page, with the secret of its address, and never too many."""

import asyncio
import json
from contextlib import closing, suppress
from itertools import count
from types import SimpleNamespace

import pytest
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import WebSocketClosedError, websocket_connect

from patience import PATIENCE
from rnc_pin.visualization.browser import scene_server
from rnc_pin.visualization.browser.scene_server import SceneWindow


@pytest.fixture
def served():
    """Host, secret and received messages of a page that takes commands."""
    received = []
    with closing(SceneWindow()) as window:
        address, _, secret = window.serve(panel=scene_server.ControlPanel("drive", received.append)).partition("#")
        yield address.split("/")[2], secret, received


async def connected(host, origin=None):
    headers = {"Host": host} if origin is None else {"Host": host, "Origin": origin}
    return await websocket_connect(HTTPRequest(f"ws://{host}/commands", headers=headers))


def sent(host, messages, taken=None):
    """Send messages from our own page; return the close code if the server hangs up, and None if it has taken them."""

    async def talk():
        connection = await connected(host, f"http://{host}")
        with suppress(WebSocketClosedError):  # the server has hung up already
            for message in messages:
                await connection.write_message(message, binary=isinstance(message, bytes))
        answer = asyncio.ensure_future(connection.read_message())
        while not answer.done() and not (taken and taken()):
            await asyncio.sleep(0.01)
        hung_up = answer.done()
        connection.close()
        assert not hung_up or answer.result() is None
        return connection.close_code if hung_up else None

    return asyncio.run(asyncio.wait_for(talk(), PATIENCE))


def test_messages_after_the_secret_arrive_in_order(served):
    host, secret, received = served
    told = [{"kind": "stop"}, [1, 2], "text"]
    messages = [json.dumps({"secret": secret}), *map(json.dumps, told), "{not json", b"\xff\xfe"]
    assert sent(host, messages, lambda: received == [*told, None, None]) is None


@pytest.mark.parametrize("first", ['{"kind": "stop"}', '{"secret": "guess"}', '{"secret": null}', "[]", "{", b"\xff"])
def test_without_the_secret_nothing_arrives(served, first):
    host, _, received = served
    assert sent(host, [first, '{"kind": "stop"}']) == 4003
    assert received == []


def test_other_pages_and_programs_without_an_origin_are_refused(served):
    host, _, _ = served

    def refused(origin, name=host):
        async def talk():
            request = HTTPRequest(f"ws://{host}/commands", headers={"Host": name, **origin})
            with pytest.raises(HTTPClientError) as refusal:
                await websocket_connect(request)
            return refusal.value.code

        return asyncio.run(asyncio.wait_for(talk(), PATIENCE))

    for origin in ("http://evil.com", "null", "file://", "http://localhost"):
        assert refused({"Origin": origin}) == 403, origin
    assert (refused({}), refused({"Origin": "http://evil.com"}, "evil.com")) == (403, 403)


def test_a_flood_is_dropped_and_a_long_message_ends_the_connection(served, monkeypatch):
    """200 messages at once, the secret among them, then 100 per second less those that were dropped."""
    host, secret, received = served
    first, calls = json.dumps({"secret": secret}), count()

    def clock():
        """Time 0 s for the connection and 250 messages, 1 s for 51 more, then 2 s."""
        call = next(calls)
        return float((call > 250) + (call > 301))

    monkeypatch.setattr(scene_server, "time", SimpleNamespace(monotonic=clock))
    expected = [1] * (199 + 50) + [2]
    assert sent(host, [first, *["1"] * 300, "2"], lambda: received[-1:] == [2]) is None
    assert received == expected
    assert sent(host, [first, json.dumps("x" * 2000)]) is not None
    assert received == expected


@pytest.mark.parametrize("silent", [False, True])
def test_a_page_that_closes_or_does_not_answer_says_farewell(silent):
    window, received = SceneWindow(), []
    panel = scene_server.ControlPanel("drive", received.append, farewell={"kind": "stop"})
    address, _, secret = window.serve(panel=panel).partition("#")
    host = address.split("/")[2]

    async def leave():
        with suppress(HTTPClientError):  # one that is never admitted has nothing to say
            (await connected(host, f"http://{host}")).close()
        page = await connected(host, f"http://{host}")
        await page.write_message(json.dumps({"secret": secret}))
        await page.write_message(json.dumps({"kind": "base_goal"}))
        if silent:
            page.protocol._handle_message = lambda opcode, data: None
        while not received:
            await asyncio.sleep(0.01)
        assert received == [{"kind": "base_goal"}]
        if not silent:
            page.close()
        while len(received) < 2:
            await asyncio.sleep(0.01)
        page.close()

    with closing(window):
        asyncio.run(asyncio.wait_for(leave(), PATIENCE))
        assert received == [{"kind": "base_goal"}, {"kind": "stop"}]


def test_a_page_that_only_shows_takes_no_commands():
    with closing(SceneWindow()) as window:
        address = window.serve()
        assert "#" not in address
        host = address.split("/")[2]
        with pytest.raises(HTTPClientError, match="404"):
            asyncio.run(connected(host, f"http://{host}"))
