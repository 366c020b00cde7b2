"""The session of a bus, which a fresh one replaces when its hub does not take it back.

A hub admits one link per session id, and an id is public: after an interruption another process may
have taken its place, and Zenoh dials with the same id for ever. What was declared is therefore kept
and declared again on a fresh session, whose id nobody knows yet.
"""

import logging
import threading
from collections.abc import Callable
from itertools import count
from time import monotonic
from typing import Any, Final, Generic, TypeVar
from weakref import WeakValueDictionary

import zenoh

from protocol.bus.tls.peers import declare_link_events
from runtime.load import slowdown

LOG = logging.getLogger(__name__)
T = TypeVar("T")
SILENT_S: Final = 1.0
"""Time for which a process accepts connections, and no link, before a fresh session is opened."""

KEEPER_SILENT_S: Final = 5.0
"""The same for robot and plant: a fresh session has none of the events that the old one cached."""

STEADY_S: Final = 0.5
"""Time for which a link must last until it counts: a hub may accept it and end it at once."""

POLL_S: Final = 0.1
PROBE_S: Final = 0.5
"""Between two attempts to connect without TLS; the hub may pay for each with a pause of 100 ms."""

LONGEST_S: Final = 8.0
"""Longest pause between two attempts that fail; each doubles the one before."""

CLOSING_S: Final = 2.0
"""Time for an attempt under way to end when the session is closed."""


class Declared(Generic[T]):
    """What was declared on a session, and is declared again on the next one. It ends when dropped.

    `now` is the one on the present session.
    """

    def __init__(self, declare: Callable[[zenoh.Session], T], session: zenoh.Session) -> None:
        self.declare = declare
        self.now = declare(session)


class LastingSession:
    """A Zenoh session that can be replaced; `now` is the present one.

    `open_fresh` opens another session with a single attempt; it returns None if no process accepts
    it. `accepts` returns whether a dialled process accepts a TCP connection; if it is given, the
    session is replaced when its link does not come back for `silent_s`, longer while this machine
    is busy. No thread runs before the first loss.
    """

    def __init__(
        self,
        session: zenoh.Session,
        open_fresh: Callable[[], zenoh.Session | None],
        accepts: Callable[[], bool] | None,
        silent_s: float = SILENT_S,
    ) -> None:
        self.now = session
        self._silent_s = silent_s
        self._open_fresh = open_fresh
        self._accepts = accepts or (lambda: False)
        self._all: WeakValueDictionary[int, Declared[Any]] = WeakValueDictionary()
        self._numbers = count()
        self._declaring = threading.RLock()
        self._replacing = threading.Lock()
        self._lost = threading.Event()
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None
        self._links = None if accepts is None else self.declare(self._declare_links)

    def declare(self, declare: Callable[[zenoh.Session], T]) -> Declared[T]:
        """Declare something on this session and on each that replaces it, in the same order."""
        with self._declaring:
            one = Declared(declare, self.now)
            self._all[next(self._numbers)] = one
            return one

    def undeclare(self, one: Declared[Any]) -> None:
        """End what was declared."""
        with self._declaring:
            for number, other in tuple(self._all.items()):
                if other is one:
                    del self._all[number]
        one.now.undeclare()

    def close(self) -> None:
        """Close the session."""
        self._closed.set()
        self._lost.set()
        with self._declaring:
            close_session(self.now)
        if self._thread is not None:
            self._thread.join(timeout=CLOSING_S)

    def replace(self, before: zenoh.Session, *, if_lost: bool = False) -> bool:
        """Open a fresh session in place of `before`; return whether a process has accepted it.

        `if_lost`: keep the session if it is linked again.
        """
        with self._replacing:
            if self.now is not before:
                return True
            fresh = self._open_fresh()
            if fresh is None:
                return False
            with self._declaring:
                if self._closed.is_set() or (if_lost and is_linked(before)):
                    close_session(fresh)
                    return False
                self.now = fresh
                for one in tuple(self._all.values()):
                    one.now = one.declare(fresh)
            close_session(before)
        return True

    def _declare_links(self, session: zenoh.Session) -> Any:
        """Follow the links of a session."""

        def changed(event: zenoh.LinkEvent) -> None:
            if event.kind != zenoh.SampleKind.PUT and session is self.now:
                self._lost.set()
                if self._thread is None and not self._closed.is_set():
                    thread = threading.Thread(target=self._run, name="links", daemon=True)
                    thread.start()  # first: `close` joins what it finds
                    self._thread = thread

        return declare_link_events(session, changed)

    def _run(self) -> None:
        while not self._closed.is_set():
            self._lost.wait()
            try:
                self._await_link()
            except Exception:  # the next loss needs this thread again
                LOG.exception("a session could not be replaced")

    def _patience_s(self) -> float:
        return self._silent_s * slowdown()

    def _await_link(self) -> None:
        """Return when a link lasts; replace the session while it is kept out."""
        steady_s = silent_s = probe_s = monotonic()
        pause_s = self._patience_s()
        while not self._closed.wait(POLL_S):
            session, now_s, lost = self.now, monotonic(), self._lost.is_set()
            self._lost.clear()
            linked = is_linked(session) and not lost
            if linked and now_s - steady_s >= STEADY_S:
                return
            if linked:
                continue
            steady_s = now_s
            if now_s < probe_s:
                continue
            if not self._accepts():
                silent_s, pause_s = monotonic(), self._patience_s()
            elif now_s - silent_s >= pause_s:
                self.replace(session, if_lost=True)
                silent_s, pause_s = monotonic(), min(2 * pause_s, LONGEST_S)
            probe_s = monotonic() + PROBE_S


def is_linked(session: zenoh.Session) -> bool:
    """Return whether a session has a link."""
    try:
        return bool(list(session.info.links()))
    except zenoh.ZError:  # it was closed
        return False


def close_session(session: Any) -> None:
    """Close a session. This may take as long as one attempt to dial."""
    session.close()
