"""Sessions: replaced, lingering, without a host; the person and the presence behind them."""

import errno
import os
import pwd
import re
import socket
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from collections.abc import Set as AbstractSet
from contextlib import contextmanager, suppress
from pathlib import Path
from resource import RLIMIT_NOFILE, getrlimit, setrlimit
from types import SimpleNamespace
from typing import Any, cast

import pytest
import zenoh

from checks.harness.until import until
from protocol.bus import callbacks, network, sockets
from protocol.bus import session as lasting_session
from protocol.bus.bus import Presence, TokenSet, presence_in
from protocol.bus.callbacks import zenoh_callback
from protocol.bus.network import Network, Tls
from protocol.bus.session import LastingSession, unconnected, unknown_host
from protocol.bus.sockets import LinkCloser, stop_lingering
from protocol.topic import MAX_PERSON, PERSON, operator_in, person_of
from protocol.wire.message import Message
from protocol.wire.messages import LeaseStatus
from runtime.errors import UserError
from tests.support.each import each
from tests.support.hostile import TEXT


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
            declare_transport_events_listener=lambda *_, **__: object(),
        )

    def _listen(self, callback: Any, *, history: bool) -> object:
        self.changed = callback
        return object()

    def lose(self) -> None:
        self.linked = False
        event = SimpleNamespace(kind=zenoh.SampleKind.DELETE, link=SimpleNamespace(zid="hub"))
        self.changed(event)

    def close(self) -> None:
        self.closed = True


@pytest.fixture
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


@pytest.mark.usefixtures("plain_callbacks")
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


@pytest.mark.usefixtures("plain_callbacks")
def test_session_remains_when_nobody_accepts_a_fresh_one() -> None:
    first = Session("first")
    session = lasting(first, [])
    assert not session.replace(session.now)
    assert not first.closed
    assert session.now is cast(object, first)


@pytest.mark.usefixtures("plain_callbacks")
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


@pytest.mark.usefixtures("plain_callbacks")
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


@pytest.mark.usefixtures("plain_callbacks")
def test_session_whose_link_returns_for_a_moment_is_replaced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A hub that ends each link of an id lets one begin before it does so."""
    first, second, looks = Session("first"), Session("second"), [True, True]
    monkeypatch.setattr(lasting_session, "is_linked", lambda _: bool(looks and looks.pop()))
    session = lasting(first, [second])
    assert session.replace(session.now, if_lost=True)
    assert session.now is cast(object, second)
    session.close()


@pytest.mark.usefixtures("plain_callbacks")
def test_closed_session_is_not_replaced() -> None:
    first, second = Session("first"), Session("second")
    session = lasting(first, [second])
    session.close()
    assert not session.replace(session.now)
    assert second.closed


LINGER = struct.pack("ii", 1, 10)


def lingers(one: socket.socket) -> bool:
    return one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)[0] != 0


@pytest.fixture
def lingering() -> Iterator[socket.socket]:
    with socket.socket() as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER)
        yield one
        one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, sockets.OFF)


@contextmanager
def no_descriptor_left() -> Iterator[None]:
    """Prevent this process from opening more files."""
    limits = getrlimit(RLIMIT_NOFILE)
    top = max(map(int, os.listdir("/proc/self/fd")))
    held: list[int] = []
    setrlimit(RLIMIT_NOFILE, (top + 1, limits[1]))
    try:
        with suppress(OSError):
            while True:
                held.append(os.dup(0))
        yield
    finally:
        setrlimit(RLIMIT_NOFILE, limits)
        for one in held:
            os.close(one)


def test_shortage_of_descriptors_is_raised(lingering: socket.socket) -> None:
    with no_descriptor_left(), pytest.raises(OSError, match="Too many open files"):
        stop_lingering()
    assert lingers(lingering)
    stop_lingering()
    assert not lingers(lingering)


def test_socket_that_cannot_be_copied_counts_as_open(
    lingering: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    def dup(_: int) -> int:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(os, "dup", dup)
    with pytest.raises(OSError, match="Too many open files"):
        stop_lingering()
    assert lingers(lingering)


def test_linger_is_cleared_once_descriptors_are_available(
    lingering: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise each link closed later blocks the subscribers for up to 10 s."""
    calls: list[str] = []
    real = sockets.stop_lingering

    def stop() -> None:
        calls.append("stop")
        if len(calls) == 1:
            raise OSError(errno.EMFILE, "Too many open files")
        real()

    monkeypatch.setattr(sockets, "stop_lingering", stop)
    one = LinkCloser()
    one.stop_lingering()
    until(lambda: not lingers(lingering), what="the second attempt")
    one.close()


@pytest.fixture
def names(monkeypatch: pytest.MonkeyPatch) -> None:
    def look_up(host: str, port: object, *_: object) -> list[object]:
        if host != "::1" and not host[0].isdigit():
            raise socket.gaierror(-2, "Name or service not known")
        return []

    monkeypatch.setattr(socket, "getaddrinfo", look_up)


@pytest.mark.usefixtures("names")
@pytest.mark.parametrize(
    ("endpoints", "host"),
    [
        (("tcp/nohost:7447",), "nohost"),
        (("tls/nohost.lan:7447#x=1",), "nohost.lan"),
        (("tcp/127.0.0.1:7447",), ""),
        (("tcp/[::1]:7447",), ""),
        (("tcp/nohost:7447", "tcp/127.0.0.1:7447"), ""),
        (("unixsock-stream/tmp/nohost",), ""),
        ((), ""),
    ],
)
def test_the_host_that_does_not_resolve(endpoints: tuple[str, ...], host: str) -> None:
    assert unknown_host(endpoints) == host


@pytest.mark.usefixtures("names")
def test_the_error_names_the_host_and_the_endpoint() -> None:
    network = Network(mode="client", connect=("tcp/nohost:7447",))
    assert str(unconnected("tcp/nohost:7447", network)) == (
        "the name nohost of tcp/nohost:7447 does not resolve: correct the endpoint"
    )


TLS = Tls(ca="ca.pem", certificate="ground.pem", key="ground.key")


@pytest.fixture
def _unnamed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(network.VARIABLE, raising=False)


@pytest.mark.usefixtures("_unnamed")
def test_programs_of_a_user_find_the_same_person() -> None:
    login = pwd.getpwuid(os.getuid()).pw_name
    found = network.person_here()
    assert found == network.person_here()
    assert re.fullmatch(rf"{re.escape(login)[:14]}-[0-9a-f]{{8}}", found)
    assert re.fullmatch(PERSON, found)


@pytest.mark.usefixtures("_unnamed")
def test_users_computers_and_starts_are_told_apart(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    found = {network.person_here()}
    monkeypatch.setattr(os, "getuid", lambda: 4_000_000_000)
    found.add(network.person_here())
    monkeypatch.setattr(socket, "gethostname", lambda: "elsewhere")
    found.add(network.person_here())
    (tmp_path / "boot_id").write_text("another\n", encoding="ascii")
    monkeypatch.setattr(network, "BOOT_ID", tmp_path / "boot_id")
    found.add(network.person_here())
    monkeypatch.setattr(network, "BOOT_ID", tmp_path / "none")
    found.add(network.person_here())
    assert len(found) == 5
    assert all(re.fullmatch(PERSON, one) for one in found)
    assert len([one for one in found if one.startswith("user4000000000-")]) == 4


@pytest.mark.usefixtures("_unnamed")
def test_a_login_that_no_key_may_contain_is_written_in_ascii() -> None:
    for login in ("jürgen/von*#?", "a" * 200, ""):
        found = network.with_digits(login)
        assert re.fullmatch(PERSON, found)
        assert len(found) <= MAX_PERSON
    assert network.with_digits("jürgen").startswith("j_rgen-")


@pytest.mark.usefixtures("_unnamed")
def test_the_gateway_is_another_person_than_its_user(monkeypatch: pytest.MonkeyPatch) -> None:
    gateway = network.gateway_here()
    assert re.fullmatch(r"gateway-[0-9a-f]{8}", gateway)
    monkeypatch.setenv(network.VARIABLE, "ada")
    assert network.gateway_here() == gateway
    assert network.person_here() == "ada"


@pytest.mark.usefixtures("_unnamed")
@each("name", ["", "a/b", "a b", "ä", "a" * 24, "ada\n", "*"])
def test_a_bad_name_is_refused_with_the_rule(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UserError, match="use 1 to 23 of the characters"):
        network.checked_person(name)
    if not name:
        return
    with pytest.raises(UserError, match="use 1 to 23 of the characters"):
        Network(person=name)
    monkeypatch.setenv(network.VARIABLE, name)
    with pytest.raises(UserError, match="SIDESTEP_PERSON"):
        network.person_here()


@pytest.mark.usefixtures("_unnamed")
def test_with_a_certificate_no_person_is_configured() -> None:
    assert Network(person="ada").person == "ada"
    with pytest.raises(UserError, match="the certificate names the operator"):
        Network(person="ada", tls=TLS)


@pytest.mark.usefixtures("_unnamed")
def test_the_longest_identity_fits_into_the_lease() -> None:
    identity = f"{'p' * MAX_PERSON}/{'f' * 32}"
    assert operator_in(identity) == identity
    assert person_of(identity) == "p" * MAX_PERSON
    status: Message = LeaseStatus(time_ns=1, lapses_ms=1, held=1, holder=identity, name="")
    assert status


@pytest.mark.usefixtures("_unnamed")
def test_an_identity_that_names_nobody_has_no_person() -> None:
    assert person_of("") == ""


def test_token_contains_robot_role_and_session() -> None:
    assert presence_in("sidestep/r1/alive/robot/4f2a") == Presence("r1", "robot", "4f2a")
    assert presence_in("a/b/r-2/alive/ground/0") == Presence("r-2", "ground", "0")


@each(
    "key",
    [
        f"sidestep/r{TEXT}/alive/robot/4f2a",
        f"sidestep/r1/alive/{TEXT}/4f2a",
        f"sidestep/r1/alive/robot/{TEXT}",
        "sidestep/r1\n/alive/robot/4f2a",
        "sidestep/R1/alive/robot/4f2a",
        f"sidestep/{'r' * 17}/alive/robot/4f2a",
        "sidestep/r1/alive/nobody/4f2a",
        f"sidestep/r1/alive/robot/{'0' * 33}",
        "sidestep//alive/robot/4f2a",
    ],
)
def test_malformed_token_is_ignored(key: str) -> None:
    assert presence_in(key) is None


FIRST, SECOND, THIRD = (Presence("r1", "robot", zid) for zid in ("1", "2", "3"))


class Interrupted(frozenset[Presence]):
    """A set in which another thread adds a token just before each change."""

    other: threading.Thread

    def interrupt(self) -> None:
        if self.other.ident is None:
            self.other.start()
            self.other.join(timeout=0.2)

    def __or__(self, others: AbstractSet[Any]) -> frozenset[Any]:
        self.interrupt()
        return super().__or__(others)

    def __sub__(self, others: AbstractSet[Any]) -> frozenset[Presence]:
        self.interrupt()
        return super().__sub__(others)


@each(("came", "there"), [(True, [FIRST, SECOND, THIRD]), (False, [THIRD])])
def test_tokens_added_by_two_threads_at_once_are_all_kept(
    came: bool, there: list[Presence]
) -> None:
    """Keep each token: a lost one hid a second robot of one name, or kept it for ever."""
    seen: list[Presence] = []
    tokens = TokenSet(lambda who, _: seen.append(who))
    tokens.there = before = Interrupted({FIRST})
    before.other = threading.Thread(target=tokens.take, args=(THIRD,), kwargs={"appeared": True})
    tokens.take(SECOND if came else FIRST, appeared=came)
    before.other.join()
    assert sorted(tokens.there) == there
    assert seen == [SECOND if came else FIRST, THIRD]


def test_what_interrupts_a_callback_is_left_to_the_hook(monkeypatch: pytest.MonkeyPatch) -> None:
    ignored: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda args: ignored.append(args.exc_value))
    error = KeyboardInterrupt()

    def interrupted(_value: object) -> None:
        raise error

    def ended() -> None:
        raise error

    callback = zenoh_callback(interrupted, ended)
    callback.callback("a sample")
    assert ignored == [error]
    assert callback.drop is not None
    callback.drop()
    assert ignored == [error, error]


def test_no_other_module_gives_zenoh_a_function() -> None:
    """Zenoh would log a ctrl+c that arrives in it, and the program would go on."""
    bus = Path(callbacks.__file__).parent
    others = [path.name for path in bus.glob("*.py") if "Callback(" in path.read_text()]
    assert others == ["callbacks.py"]
