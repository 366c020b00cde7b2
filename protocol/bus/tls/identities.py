"""Which certificate a session id belongs to: a session id is public, so it proves nothing.

Zenoh admits one link per session id, whatever certificate it shows. A process that listens
therefore remembers which certificate used an id first, and ends each link of another one. Which
certificate an id belonged to before this process started cannot be known: whoever then comes first
keeps it. The rightful process opens a fresh session with another id (`lasting_session`).
"""

from collections.abc import Callable
from threading import Lock
from typing import Final, NamedTuple

import zenoh

from protocol.bus.tls.peers import address_of, declare_link_events

MAX_IDS: Final = 64
"""Ids remembered for each certificate, without those that are linked. The certificates are those of
one authority, and one that uses many ids pushes out only its own."""

ID_TAKEN: Final = "session id taken: "
"""Beginning of the texts about a link with the session id of another certificate."""


class RefusedLink(NamedTuple):
    """A link that used the session id of another certificate."""

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
        self._lock = Lock()

    def linked(self, zid: str, name: str | None, address: str) -> RefusedLink | None:
        """Note a new link; return it if the id belongs to another certificate."""
        with self._lock:
            holder = self._holders.setdefault(zid, name)
            if holder != name:
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
        """Call `report`, in a thread of Zenoh, for each link that is refused from now on."""
        self._report = report

    def _changed(self, event: zenoh.LinkEvent) -> None:
        zid, address = str(event.link.zid), address_of(event.link)
        if event.kind != zenoh.SampleKind.PUT:
            self._identities.unlinked(zid, address)
            return
        refused = self._identities.linked(zid, event.link.auth_identifier, address)
        if refused is not None:
            self._end(address)
            self._report(refused)
