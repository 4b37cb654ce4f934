"""Commands of a page: only from our own page, with the secret of its address, and never too many."""

import asyncio
import json
from contextlib import suppress

import pytest
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import WebSocketClosedError, websocket_connect

from patience import PATIENCE, eventually
from rnc_pin.visualization.browser.drawing_commands import SceneWindow


@pytest.fixture
def served():
    """Host, secret and received messages of a page that takes commands."""
    window, received = SceneWindow(), []
    address, _, secret = window.serve(receive=received.append).partition("#")
    yield address.split("/")[2], secret, received
    window.close()


async def connected(host, origin=None):
    headers = {"Host": host} if origin is None else {"Host": host, "Origin": origin}
    return await websocket_connect(HTTPRequest(f"ws://{host}/commands", headers=headers))


def sent(host, messages):
    """Send messages from our own page; return the close code if the server hangs up, else None."""

    async def talk():
        connection = await connected(host, f"http://{host}")
        with suppress(WebSocketClosedError):  # the server has hung up already
            for message in messages:
                await connection.write_message(message, binary=isinstance(message, bytes))
        try:
            answer = await asyncio.wait_for(connection.read_message(), 0.3)
        except TimeoutError:
            connection.close()
            return None
        assert answer is None
        return connection.close_code

    return asyncio.run(asyncio.wait_for(talk(), PATIENCE))


def test_messages_after_the_secret_arrive_in_order(served):
    host, secret, received = served
    told = [{"kind": "stop"}, [1, 2], "text"]
    assert sent(host, [json.dumps({"secret": secret}), *map(json.dumps, told), "{not json", b"\xff\xfe"]) is None
    assert eventually(lambda: received == [*told, None, None])


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
    assert refused({}) == 403
    assert refused({"Origin": "http://evil.com"}, "evil.com") == 403


def test_a_flood_is_dropped_and_a_long_message_ends_the_connection(served):
    host, secret, received = served
    first = json.dumps({"secret": secret})
    assert sent(host, [first, *["1"] * 5000]) is None
    assert eventually(lambda: len(received) >= 150)
    assert len(received) < 1500  # 200 at once and 100 per second
    before = len(received)
    assert sent(host, [first, json.dumps("x" * 2000)]) is not None
    assert len(received) == before


def test_a_page_that_only_shows_takes_no_commands():
    window = SceneWindow()
    address = window.serve()
    try:
        assert "#" not in address
        host = address.split("/")[2]
        with pytest.raises(HTTPClientError, match="404"):
            asyncio.run(connected(host, f"http://{host}"))
    finally:
        window.close()
