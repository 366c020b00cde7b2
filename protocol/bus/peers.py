"""The processes linked to a session by certificate and address, and which id belongs to which.

A session id is public, so it proves nothing. Zenoh admits one link per session id, whatever
certificate it shows. A process that listens therefore remembers which certificate used an id first,
and ends each link of another one. From then on it ends those of the first one, too: where two links
with one id follow each other quickly, Zenoh 1.10 may leave the second without data for ever,
although it is there and its queries are answered. Which certificate an id belonged to before this
process started cannot be known: whoever then comes first keeps it. The rightful process opens a
fresh session with another id (`protocol.bus.session`).
"""

import time
from collections.abc import Callable
from threading import Lock
from typing import Any, Final, NamedTuple

import zenoh

from protocol.bus.callbacks import zenoh_callback
from protocol.bus.network import Network
from protocol.bus.rights import impostor
from runtime.errors import AccessDeniedError

QUIET_S: Final = 10.0
REPLACED: Final = "no data is exchanged with it; find out which process listens there with this key"


def declare_link_events(
    session: zenoh.Session, handler: Callable[[zenoh.LinkEvent], None]
) -> "zenoh.LinkEventsListener[None]":
    """Call `handler` for each present and new link, and for the end of each."""
    return session.info.declare_link_events_listener(zenoh_callback(handler), history=True)


def callers(
    session: zenoh.Session, handler: Callable[[str, str | None, str], None]
) -> "zenoh.LinkEventsListener[None]":
    """Call `handler` for each present and new link: session id, name of certificate, address."""

    def forward(event: zenoh.LinkEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT:
            link = event.link
            handler(str(link.zid), link.auth_identifier, address_of(link))

    return declare_link_events(session, forward)


def address_of(link: zenoh.Link) -> str:
    """Return HOST:PORT of the other end of a link."""
    return link.dst.partition("/")[2].partition("#")[0].partition("?")[0]


class DialledPeers:
    """Check the certificate of each process that a session has dialled, after each reconnection.

    `own` is the common name of this process's certificate, None without TLS; `robot` is the robot
    it works for. The access control of the session blocks all data to and from a wrong process.
    """

    def __init__(
        self, session: zenoh.Session, network: Network, own: str | None, robot: str
    ) -> None:
        self._own, self._robot, self._revoked = own, robot, network.revoked
        self._wrong: dict[tuple[str, str], tuple[str, str]] = {}
        self._reported_s = -QUIET_S
        self._report: Callable[[str], None] = lambda _why: None
        self._session: Any = session
        if own is None or network.listen:
            return
        for link in session.info.links():
            self._check(link)
        self._listener = declare_link_events(session, self._changed)

    def refuse(self) -> None:
        """Close the session and raise AccessDeniedError if the dialled process is the wrong one."""
        if self._wrong:
            self._session.close()
            raise AccessDeniedError(*next(iter(self._wrong.values())))

    @property
    def wrong(self) -> str:
        """Return why the dialled process is the wrong one; empty if it is the right one."""
        return next((": ".join(wrong) for wrong in tuple(self._wrong.values())), "")

    def on_wrong(self, report: Callable[[str], None]) -> None:
        """Call `report` with the reason when a wrong process is linked, at most once in QUIET_S.

        The call comes from a thread of Zenoh.
        """
        self._report, self._reported_s = report, -QUIET_S
        if self.wrong:
            self._report_wrong(self.wrong)

    def _changed(self, event: zenoh.LinkEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT:
            self._check(event.link)
        else:
            self._wrong.pop(place_of(event.link), None)

    def _check(self, link: zenoh.Link) -> None:
        name = link.auth_identifier
        why = impostor(name, self._own or "", self._robot)
        if name in self._revoked:
            why = f"shows the certificate of {name!r}, which is revoked"
        if why and place_of(link) not in self._wrong:
            self._wrong[place_of(link)] = f"the process at {link.dst} {why}", REPLACED
            self._report_wrong(self.wrong)

    def _report_wrong(self, why: str) -> None:
        """Report a reason unless one was reported recently: links may flap."""
        now_s = time.monotonic()
        if now_s - self._reported_s >= QUIET_S:
            self._reported_s = now_s
            self._report(why)


def place_of(link: zenoh.Link) -> tuple[str, str]:
    """Return the session id and address of a link."""
    return str(link.zid), link.dst


MAX_IDS: Final = 64
"""Ids remembered for each certificate, without those that are linked. The certificates are those of
one authority, and one that uses many ids pushes out only its own."""

ID_TAKEN: Final = "session id taken: "
"""Beginning of the texts about a link with the session id of another certificate."""


class RefusedLink(NamedTuple):
    """A link with a session id that several certificates have used; `holder` used it first."""

    zid: str
    name: str | None
    address: str
    holder: str | None


class Identities:
    """The certificate of each session id. May be used from any thread."""

    def __init__(self) -> None:
        self._holders: dict[str, str | None] = {}
        self._ids: dict[str | None, dict[str, None]] = {}
        """The ids of each certificate, the one used last at the end."""
        self._links: dict[str, set[str]] = {}
        self._contested: set[str] = set()
        self._lock = Lock()

    def linked(self, zid: str, name: str | None, address: str) -> RefusedLink | None:
        """Note a new link; return it if another certificate has used the id, now or before."""
        with self._lock:
            holder = self._holders.setdefault(zid, name)
            if holder != name:
                self._contested.add(zid)
            if zid in self._contested:
                return RefusedLink(zid, name, address, holder)
            self._links.setdefault(zid, set()).add(address)
            ids = self._ids.setdefault(name, {})
            ids.pop(zid, None)
            ids[zid] = None
            self._forget(ids)
            return None

    def unlinked(self, zid: str, address: str) -> None:
        """Note the end of a link."""
        with self._lock:
            links = self._links.get(zid, set())
            links.discard(address)
            if not links:
                self._links.pop(zid, None)

    def _forget(self, ids: dict[str, None]) -> None:
        """Forget the ids of one certificate that were not used for longest and are not linked."""
        idle = [zid for zid in ids if zid not in self._links]
        for zid in idle[: max(0, len(idle) - MAX_IDS)]:
            del ids[zid], self._holders[zid]
            self._contested.discard(zid)


class AcceptedPeers:
    """Keep the certificates that link to a session apart, by the ids that they use.

    `end` ends the link to an address.
    """

    def __init__(self, session: zenoh.Session, end: Callable[[str], None]) -> None:
        self._end = end
        self._identities = Identities()
        self._report: Callable[[RefusedLink], None] = lambda _refused: None
        self._listener = declare_link_events(session, self._changed)

    def on_refused(self, report: Callable[[RefusedLink], None]) -> None:
        """Call `report`, in a thread of Zenoh, for each link of another certificate from now on."""
        self._report = report

    def _changed(self, event: zenoh.LinkEvent) -> None:
        zid, address = str(event.link.zid), address_of(event.link)
        if event.kind != zenoh.SampleKind.PUT:
            self._identities.unlinked(zid, address)
            return
        refused = self._identities.linked(zid, event.link.auth_identifier, address)
        if refused is not None:
            self._end(address)
            if refused.name != refused.holder:
                self._report(refused)
