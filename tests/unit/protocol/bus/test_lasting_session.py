"""A session that is replaced has all that was declared, in the same order, on the fresh one."""

import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest
import zenoh

from protocol.bus import session as lasting_session
from protocol.bus.session import LastingSession
from tests.support.until import until


class Session:
    """A session whose link the test makes and breaks."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.linked = True
        self.closed = False
        self.changed: Callable[[Any], None] = lambda _event: None
        self.info = SimpleNamespace(
            links=lambda: ["link"] if self.linked else [],
            declare_link_events_listener=self._listen,
        )

    def _listen(self, callback: Any, *, history: bool) -> object:
        self.changed = callback
        return object()

    def lose(self) -> None:
        self.linked = False
        self.changed(SimpleNamespace(kind=zenoh.SampleKind.DELETE))

    def close(self) -> None:
        self.closed = True


@pytest.fixture(autouse=True)
def plain_callbacks(monkeypatch: pytest.MonkeyPatch) -> None:
    def declare(session: Any, handler: Any) -> object:
        return session.info.declare_link_events_listener(handler, history=True)

    monkeypatch.setattr(lasting_session, "declare_link_events", declare)


def lasting(
    first: Session, fresh: list[Session], accepts: Callable[[], bool] | None = None
) -> LastingSession:
    def open_fresh() -> zenoh.Session | None:
        return cast(zenoh.Session, fresh.pop(0)) if fresh else None

    return LastingSession(cast(zenoh.Session, first), open_fresh, accepts)


class Thing:
    """Something declared on a session; it notes its end."""

    def __init__(self, session: Any, ended: list[str]) -> None:
        self.on = session.name
        self._ended = ended

    def undeclare(self) -> None:
        self._ended.append(self.on)


def test_all_is_declared_again_in_the_same_order() -> None:
    first, second = Session("first"), Session("second")
    session, made, ended = lasting(first, [second]), list[str](), list[str]()

    def declared(name: str) -> Any:
        def declare(one: Any) -> Thing:
            made.append(f"{name} on {one.name}")
            return Thing(one, ended)

        return session.declare(declare)

    kept, dropped, left = declared("a"), declared("b"), declared("c")
    session.undeclare(dropped)
    assert ended == ["first"]
    assert session.replace(session.now)
    assert made[3:] == ["a on second", "c on second"]
    assert (kept.now.on, left.now.on) == ("second", "second")
    assert first.closed
    assert not second.closed
    session.undeclare(kept)
    assert ended == ["first", "second"]


def test_session_remains_when_nobody_accepts_a_fresh_one() -> None:
    first = Session("first")
    session = lasting(first, [])
    assert not session.replace(session.now)
    assert not first.closed
    assert session.now is cast(object, first)


def test_lost_session_is_replaced_once_connections_are_accepted() -> None:
    first, second, accepted = Session("first"), Session("second"), threading.Event()
    session = lasting(first, [second], accepted.is_set)
    first.lose()
    assert session.now is cast(object, first)
    accepted.set()
    until(lambda: session.now is cast(object, second))
    until(lambda: first.closed)
    session.close()
    assert second.closed


def test_session_whose_link_returns_meanwhile_is_kept() -> None:
    first, second = Session("first"), Session("second")

    def open_fresh() -> zenoh.Session:
        first.linked = True
        return cast(zenoh.Session, second)

    session = LastingSession(cast(zenoh.Session, first), open_fresh, lambda: True)
    first.lose()
    until(lambda: second.closed)
    assert session.now is cast(object, first)
    session.close()
    assert first.closed


def test_closed_session_is_not_replaced() -> None:
    first, second = Session("first"), Session("second")
    session = lasting(first, [second])
    session.close()
    assert not session.replace(session.now)
    assert second.closed
