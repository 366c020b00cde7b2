"""Who is linked to a session, by certificate and address."""

from collections.abc import Callable

import zenoh
from zenoh.handlers import Callback


def callers(
    session: zenoh.Session, handler: Callable[[str, str | None, str], None]
) -> "zenoh.LinkEventsListener[None]":
    """Session id, name of the certificate, address: those already there, and whoever comes."""

    def forward(event: zenoh.LinkEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT:
            link = event.link
            handler(str(link.zid), link.auth_identifier, link.dst)

    callback = Callback(forward, indirect=False)
    return session.info.declare_link_events_listener(callback, history=True)
