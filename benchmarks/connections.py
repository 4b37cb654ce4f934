"""Connections of many kinds to a live view: none leaves anything behind, and only correct ones are admitted.

    python -m benchmarks.connections --count 1700

A seed selects each client from ``CLIENTS``. Afterwards the view is closed with browsers connected, and
sockets, threads and memory are counted.
"""

from __future__ import annotations

import argparse
import gc
import os
import random
import socket
import struct
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import rnc_pin as rnc
from rnc_pin.visualization.live import LiveView

PATIENCE = 60.0  # [s]
GROWTH = 40.0  # [MB] of a process that serves; at 10 MB per client, as in earlier versions, 4 clients would exceed it

_KEY = "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ=="
_UPGRADE = f"Upgrade: websocket\r\nConnection: Upgrade\r\n{_KEY}"


class Client:
    """One connection, and the dice that say what it does."""

    def __init__(self, port: int, dice: random.Random) -> None:
        self.port, self.dice = port, dice
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)

    def send(self, content: bytes) -> bool:
        """Send as much as is taken; whether that was all."""
        try:
            self.socket.sendall(content)
        except OSError:
            return False
        return True

    def ask(self, path: str, *headers: str) -> int | None:
        """Status of an answer, None where there is none."""
        if not self.send("\r\n".join([f"GET {path} HTTP/1.1", *headers, "", ""]).encode("latin-1")):
            return None
        answer = self.read_until(b"\r\n")
        words = answer.split()
        return int(words[1]) if len(words) > 1 and words[1].isdigit() else None

    def open(self) -> int | None:
        """Open a web socket as the page does."""
        host = f"localhost:{self.port}"
        return self.ask("/", f"Host: {host}", f"Origin: http://{host}", _UPGRADE)

    def read_until(self, end: bytes) -> bytes:
        answer = b""
        with suppress(ConnectionResetError):
            while end not in answer:
                piece = self.socket.recv(4096)
                if not piece:
                    break
                answer += piece
        return answer

    def is_hung_up_on(self) -> bool:
        """Return True if the other end closes; its data is read first."""
        try:
            while self.socket.recv(65536):
                pass
        except TimeoutError:
            return False
        except OSError:
            pass
        return True


def frame(size: int, sent: int, opcode: int = 2, final: bool = True) -> bytes:
    """The beginning of a web socket's frame that says it is of a size, masked with zeros."""
    return struct.pack("!BBQ", (0x80 if final else 0) | opcode, 0x80 | 127, size) + bytes(4) + bytes(sent)


def garbage(client: Client) -> bool:
    client.send(client.dice.randbytes(client.dice.randint(1, 3000)) + b"\r\n\r\n")
    client.socket.shutdown(socket.SHUT_WR)
    return client.is_hung_up_on()


def half_a_request(client: Client) -> bool:
    whole = f"GET / HTTP/1.1\r\nHost: localhost:{client.port}\r\n{_UPGRADE}\r\n\r\n".encode()
    client.send(whole[: client.dice.randrange(len(whole) - 1)])
    return True  # and leaves


def strange_host(client: Client) -> bool:
    name = client.dice.choice(["evil.com", f"evil.com:{client.port}", "127.0.0.1.evil.com", "192.168.1.2", "a b", ""])
    headers = [f"Host: {name}", *([_UPGRADE] if client.dice.random() < 0.5 else [])]
    return client.ask("/", *headers) in (400, 403)


def strange_origin(client: Client) -> bool:
    origin = client.dice.choice(["http://evil.com", "null", "file://", "https://localhost", "x" * 5000, ""])
    return client.ask("/", f"Host: localhost:{client.port}", f"Origin: {origin}", _UPGRADE) in (400, 403)


def two_hosts(client: Client) -> bool:
    return client.ask("/", f"Host: localhost:{client.port}", "Host: evil.com", _UPGRADE) in (400, 403)


def endless_head(client: Client) -> bool:
    ends = [b"GET /" + b"a" * 300_000, b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 50_000]
    return not client.send(client.dice.choice(ends)) or client.is_hung_up_on()


def oversized_frame(client: Client) -> bool:
    if client.open() != 101:
        return False
    client.send(frame(10_000_000, client.dice.choice([0, 1_000_000])))
    return client.is_hung_up_on()


def endless_fragments(client: Client) -> bool:
    if client.open() != 101:
        return False
    for k in range(200):
        if not client.send(frame(50_000, 50_000, opcode=0 if k else 2, final=False)):
            break
    return client.is_hung_up_on()


def rubbish_in_frames(client: Client) -> bool:
    if client.open() != 101:
        return False
    for _ in range(client.dice.randint(1, 5)):
        content = client.dice.randbytes(client.dice.randint(0, 100))
        client.send(struct.pack("!BB", 0x82, 0x80 | len(content)) + bytes(4) + content)
    return True


def reads_nothing(client: Client) -> bool:
    client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    return client.open() == 101


def leaves_at_once(client: Client) -> bool:
    linger = struct.pack("ii", 1, 0)  # closing then resets
    client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
    return client.dice.random() < 0.5 or client.open() == 101


def proper(client: Client) -> bool:
    if client.dice.random() < 0.5:
        return client.ask("/static/", f"Host: localhost:{client.port}", "Connection: close") in (200, 404)
    ping = struct.pack("!BB", 0x89, 0x80) + bytes(4)
    return client.open() == 101 and client.send(ping) and len(client.socket.recv(4096)) > 0


CLIENTS: Sequence[Callable[[Client], bool]] = (
    *(garbage, half_a_request, strange_host, strange_origin, two_hosts, endless_head, oversized_frame),
    *(endless_fragments, rubbish_in_frames, reads_nothing, leaves_at_once, proper),
)


def memory() -> float:
    """Resident memory of this process [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def sockets() -> int:
    found = 0
    for file in Path("/proc/self/fd").iterdir():
        with suppress(FileNotFoundError):
            found += os.readlink(file).startswith("socket:")
    return found


def eventually(true: Callable[[], bool]) -> bool:
    end = time.monotonic() + PATIENCE
    while not true():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


def connect(count: int, seed: int = 0) -> tuple[Counter[str], list[str], dict[str, float]]:
    """Let so many clients come to a live view, and close it while some are there.

    Returns:
        How many of each kind came, what went wrong, and what is left: sockets, threads, and memory [MB].
    """
    _connect_clients(2 * len(CLIENTS), random.Random(-1))  # what is loaded once is not growth
    gc.collect()
    before = sockets(), threading.active_count(), memory()
    counts, faults = _connect_clients(count, random.Random(seed))
    eventually(lambda: sockets() <= before[0])
    gc.collect()
    left = {
        "sockets": sockets() - before[0],
        "threads": threading.active_count() - before[1],
        "megabytes": memory() - before[2],
    }
    if left["sockets"] > 0 or left["threads"] > 0 or left["megabytes"] > GROWTH:
        faults.append(f"left behind: {left}")
    return counts, faults, left


def _connect_clients(count: int, dice: random.Random) -> tuple[Counter[str], list[str]]:
    counts: Counter[str] = Counter()
    faults: list[str] = []
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    live = LiveView(robot, open_browser=False)
    staying: list[Client] = []
    try:
        port = int(live.url.split(":")[2].split("/")[0])
        for number in range(count):
            act = CLIENTS[number % len(CLIENTS)]
            counts[act.__name__] += 1
            client = Client(port, random.Random(dice.random()))
            try:
                if not act(client):
                    faults.append(f"{number}: {act.__name__} was not ended as it should be")
            except Exception as error:
                faults.append(f"{number}: {act.__name__}: {type(error).__name__}: {error}")
            staying.append(client)
            if len(staying) > 8:
                staying.pop(dice.randrange(8)).socket.close()
        with_browser = Client(port, dice)
        staying.append(with_browser)
        if with_browser.open() != 101:
            faults.append("a proper client is not let in at the end")
        if live.problem is not None:
            faults.append(f"the view stopped: {live.problem}")
    finally:
        live.close()
        for client in staying:
            client.socket.close()
    return counts, faults


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1700, help="number of clients")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    start = time.perf_counter()
    counts, faults, left = connect(options.count, options.seed)
    for kind, number in counts.items():
        print(f"{kind:20} {number:6,}")
    print(
        f"{sum(counts.values()):,} connections in {time.perf_counter() - start:.0f} s, {len(faults)} faults; "
        f"left: {left['sockets']:.0f} sockets, {left['threads']:.0f} threads, {left['megabytes']:.1f} MB"
    )
    for fault in faults[:20]:
        print(fault)
    raise SystemExit(bool(faults))


if __name__ == "__main__":
    main()
