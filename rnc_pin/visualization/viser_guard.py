"""Access check for viser, which has none: it answers only requests that ``RequestFilter`` admits."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from typing import Any

from rnc_pin.errors import ConfigurationError
from rnc_pin.visualization.visitors import RequestFilter

_LONGEST_MESSAGE = 1_000_000  # [bytes]; messages contain camera poses and clicks


@contextmanager
def with_request_filter(visitors: RequestFilter) -> Iterator[None]:
    """Add the access check to a viser server that is started inside the ``with`` block.

    Viser has no setting for it, but it serves through ``websockets``, which can refuse a request before the handshake.
    So this function replaces ``websockets``' ``serve`` while the viser server starts.

    Raises:
        ConfigurationError: the server did not start through ``websockets``.
    """
    from websockets.asyncio import server

    usual, guards = server.serve, []

    def serve(*arguments: Any, **settings: Any) -> Any:
        guards.append(True)
        inner = settings.pop("process_request", None)
        settings["max_size"] = _LONGEST_MESSAGE
        settings["logger"] = _log()
        return usual(*arguments, **settings, process_request=_checked(visitors, inner))

    server.serve = serve  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        server.serve = usual  # type: ignore[misc]
    if not guards:
        raise ConfigurationError(
            "PINOCCHIO_VIEWER=viser: this version of viser would answer any web site; install another version, or use "
            "PINOCCHIO_VIEWER=meshcat"
        )


def _log() -> logging.Logger:
    """Logger of refused and invalid requests; silent unless the application adds a handler."""
    log = logging.getLogger("rnc_pin.viser")
    if not log.handlers:
        log.addHandler(logging.NullHandler())
    return log


def _checked(visitors: RequestFilter, inner: Callable[..., Any] | None) -> Callable[..., Any]:
    def check(connection: Any, request: Any) -> Any:
        headers = request.headers
        hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
        if len(hosts) != 1 or len(origins) > 1 or not visitors.allows(hosts[0], origins[0] if origins else None):
            return connection.respond(HTTPStatus.FORBIDDEN, "")
        return None if inner is None else inner(connection, request)

    return check
