"""Who is linked to a session, by certificate and address."""

import time
from collections.abc import Callable
from typing import Any, Final

import zenoh
from zenoh.handlers import Callback

from protocol.bus.network import Network
from protocol.bus.tls.access import impostor
from runtime.errors import NotLetIn

QUIET_S: Final = 10.0
REPLACED: Final = "nothing is taken from it or sent to it; find out who listens there, by whose key"


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


class DialledPeers:
    """Judges each process that a session has dialled by its certificate, after each reconnection.

    `own` is the common name of the certificate of this process, None where no door is locked;
    `robot` is the robot it is about. The access control of the session sees to it that a wrong
    process neither brings nor gets anything. Raises NotLetIn when one answers the first call.
    """

    def __init__(
        self, session: zenoh.Session, network: Network, own: str | None, robot: str
    ) -> None:
        self._own, self._robot, self._revoked = own, robot, network.revoked
        self._wrong: dict[tuple[str, str], tuple[str, str]] = {}
        self._told_s = -QUIET_S
        self._tell: Callable[[str], None] = lambda _why: None
        if own is None or network.listen:
            return
        for link in session.info.links():
            self._came(link)
        if self._wrong:
            closing: Any = session
            closing.close()
            raise NotLetIn(*next(iter(self._wrong.values())))
        callback = Callback(self._changed, indirect=False)
        self._listener: Any = session.info.declare_link_events_listener(callback, history=True)

    @property
    def wrong(self) -> str:
        """Return why the dialled process is the wrong one; empty if it is the right one."""
        return next((": ".join(wrong) for wrong in tuple(self._wrong.values())), "")

    def on_wrong(self, tell: Callable[[str], None]) -> None:
        """Call `tell` with the reason when a link to a wrong process comes, once in QUIET_S.

        It is called in a thread of Zenoh.
        """
        self._tell, self._told_s = tell, -QUIET_S
        if self.wrong:
            self._say(self.wrong)

    def _changed(self, event: zenoh.LinkEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT:
            self._came(event.link)
        else:
            self._wrong.pop(place_of(event.link), None)

    def _came(self, link: zenoh.Link) -> None:
        name = link.auth_identifier
        why = impostor(name, self._own or "", self._robot)
        if name in self._revoked:
            why = f"shows the certificate of {name!r}, which is revoked"
        if why and place_of(link) not in self._wrong:
            self._wrong[place_of(link)] = f"the process at {link.dst} {why}", REPLACED
            self._say(self.wrong)

    def _say(self, why: str) -> None:
        """Hand it on, unless something was a moment ago: it may come and go all the time."""
        now_s = time.monotonic()
        if now_s - self._told_s >= QUIET_S:
            self._told_s = now_s
            self._tell(why)


def place_of(link: zenoh.Link) -> tuple[str, str]:
    return str(link.zid), link.dst
