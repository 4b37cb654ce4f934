"""Access check of a local server: a request must name this computer by one of its own names.

A web site can resolve its own name to 127.0.0.1 (DNS rebinding). Its pages can then read everything that is served
there. The names reveal the attack: a browser sends the requested name as Host and the name of the page as Origin.
"""

from __future__ import annotations

import ipaddress
import re
import socket

LOOPBACK = "127.0.0.1"


def addresses_of(host: str) -> set[str]:
    """Addresses to which this computer resolves a name; empty if there are none."""
    try:
        return {str(info[4][0]).partition("%")[0] for info in socket.getaddrinfo(host, None)}
    except (OSError, UnicodeError):
        return set()


def is_loopback(host: str) -> bool:
    """True if only this computer can reach an address. A host name is resolved first."""
    found = addresses_of(host)
    return bool(found) and all(ipaddress.ip_address(address).is_loopback for address in found)


class RequestFilter:
    """Check of the request headers Host and Origin.

    Args:
        host: name or address that the server listens on.
    """

    def __init__(self, host: str) -> None:
        addresses = addresses_of(host)
        names = {"localhost", host.lower(), *addresses}
        patterns = [r"127(\.\d{1,3}){3}", r"\[::1\]"]
        if any(ipaddress.ip_address(address).is_unspecified for address in addresses):
            # A server on all addresses accepts any numeric address: no list is complete, and DNS cannot redirect them.
            names |= {socket.gethostname().lower(), socket.getfqdn().lower()}
            patterns = [r"\d{1,3}(\.\d{1,3}){3}", r"\[[\da-f:.]+\]"]
        patterns += [re.escape(f"[{name}]" if ":" in name else name) for name in names if name]
        self._own = re.compile(f"({'|'.join(patterns)})(:\\d+)?")

    def allows(self, host: str | None, origin: str | None) -> bool:
        """Return True if the server may answer a request.

        Args:
            host: header Host, with or without a port.
            origin: header Origin. Browsers always send it with a web socket; other programs may omit it.
        """
        if not host or not self._own.fullmatch(host.lower()):
            return False
        return origin is None or origin.lower() in (f"http://{host.lower()}", f"https://{host.lower()}")
