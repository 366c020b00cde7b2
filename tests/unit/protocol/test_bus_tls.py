"""TLS at the door: what it admits, the addresses and the log of refusals."""

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from ipaddress import ip_address
from types import SimpleNamespace

import pytest

from checks.harness.until import PATIENCE_S, until
from protocol.bus import door
from protocol.bus.audit import (
    MAX_CHARACTERS,
    MAX_LINES,
    QUIET_NS,
    UNKNOWN,
    Caller,
    RefusalLog,
    in_words,
    refusals_in,
)
from protocol.bus.door import BURST, LEAST_SHARE, UNAVAILABLE, UNPRIVILEGED, AddressShares, Door
from protocol.bus.sockets import (
    SO_ATTACH_FILTER,
    SO_ATTACH_REUSEPORT_CBPF,
    ConnectionEnd,
    FilterStep,
    attach,
    choice_steps,
    end_in,
)
from tests.support.each import each

HELLO = bytes.fromhex("1603010200010001fc0303")
HERE, THERE = "127.0.0.1", "127.0.0.2"
ADA, EVE = ip_address("10.0.0.7"), ip_address("10.0.0.66")


@contextmanager
def guarded(host: str = HERE) -> Iterator[tuple[socket.socket, Door, list[str]]]:
    """Return a listening socket with a door, and what the door reports."""
    said: list[str] = []
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.create_server((host, 0), family=family) as listener:
        listener.settimeout(PATIENCE_S)
        one = Door([listener.getsockname()[1]], said.append)
        try:
            yield listener, one, said
        finally:
            one.close()


def dial(listener: socket.socket, first: bytes, source: str = "") -> socket.socket:
    """Connect, and send these bytes at once."""
    near = (source, 0) if source else None
    one = socket.create_connection(listener.getsockname()[:2], PATIENCE_S, near)
    one.sendall(first)
    return one


@pytest.fixture
def stopped_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no time pass for the door: a share grows with it, and a busy machine is slow."""
    monkeypatch.setattr(door, "time", SimpleNamespace(monotonic=lambda: 0.0))


@each("host", [HERE, "::1"])
@each("bytes_sent", [b"", b"this is no TLS 123", b"GET / HTTP/1.1\r\n\r\n", b"\x00", b"\x16"])
def test_only_a_tls_record_completes_a_connection(host: str, bytes_sent: bytes) -> None:
    with guarded(host) as (listener, _, _):
        other = dial(listener, bytes_sent)
        other.close()
        with dial(listener, HELLO) as good:
            accepted, peer = listener.accept()
            with accepted:
                assert peer[:2] == good.getsockname()[:2], "the other came first"
                assert accepted.recv(100) == HELLO


def test_accepted_connection_is_free_of_the_filter() -> None:
    with guarded() as (listener, _, _), dial(listener, HELLO) as good:
        accepted, _ = listener.accept()
        with accepted:
            accepted.settimeout(PATIENCE_S)
            assert accepted.recv(100) == HELLO
            good.sendall(b"begins in the middle of a record")  # sent again until it is taken
            assert accepted.recv(100) == b"begins in the middle of a record"
            good.close()
            assert accepted.recv(100) == b""


def test_address_without_a_share_is_not_answered() -> None:
    with guarded() as (listener, _, _), socket.socket() as shut:
        steps = choice_steps({ip_address("::1"): 0.5, ip_address(THERE): 0.0})
        attach(listener, steps, SO_ATTACH_REUSEPORT_CBPF)
        dial(listener, HELLO, THERE).close()
        shut.bind((THERE, 0))
        shut.setblocking(False)
        assert shut.connect_ex(listener.getsockname()) != 0
        with dial(listener, HELLO) as good:
            accepted, peer = listener.accept()
            accepted.close()
            assert peer == good.getsockname()
        assert shut.connect_ex(listener.getsockname()) != 0, "it is still connecting"


@pytest.mark.usefixtures("stopped_clock")
def test_too_many_connections_without_a_link_are_reported() -> None:
    with guarded() as (listener, one, said):
        callers = [dial(listener, HELLO, THERE) for _ in range(BURST + 1)]
        taken = [listener.accept()[0] for _ in callers]
        until(lambda: said, what="a report")
        assert f"from {THERE} come faster than they become links" in said[0]
        for _ in callers:
            one.linked("id", "ground", f"{THERE}:1")
        dial(listener, HELLO, HERE).close()
        for connection in (*callers, *taken):
            connection.close()


def test_closed_door_leaves_the_port_as_it_was() -> None:
    with socket.create_server((HERE, 0)) as listener:
        Door([listener.getsockname()[1]], pytest.fail).close()
        listener.settimeout(PATIENCE_S)
        with dial(listener, b"anything") as any_one:
            accepted, peer = listener.accept()
            accepted.close()
            assert peer == any_one.getsockname()


def refuse(patch: pytest.MonkeyPatch, *options: int) -> None:
    """Let the system refuse some programs."""

    def attach_or_refuse(listener: socket.socket, steps: list[FilterStep], option: int) -> None:
        if option in options:
            raise PermissionError(option)
        attach(listener, steps, option)

    patch.setattr(door, "attach", attach_or_refuse)


@pytest.mark.usefixtures("stopped_clock")
def test_silence_stays_out_and_shares_are_kept_without_the_privilege(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    refuse(monkeypatch, SO_ATTACH_FILTER)
    with guarded() as (listener, _, said), dial(listener, b""):
        assert said == [UNPRIVILEGED]
        callers = [dial(listener, b"GET /", THERE) for _ in range(BURST + 1)]
        taken = [listener.accept() for _ in callers]
        assert {peer[0] for _, peer in taken} == {THERE}
        until(lambda: len(said) == 2, what="a report")
        assert f"from {THERE} come faster than they become links" in said[1]
        for connection in (*callers, *(one for one, _ in taken)):
            connection.close()


def test_system_without_filters_is_named_and_lets_all_in(monkeypatch: pytest.MonkeyPatch) -> None:
    refuse(monkeypatch, SO_ATTACH_FILTER, SO_ATTACH_REUSEPORT_CBPF)
    with guarded() as (listener, _, said):
        assert said == [UNAVAILABLE]
        with dial(listener, b"") as silent:
            accepted, peer = listener.accept()
            accepted.close()
            assert peer == silent.getsockname()


def test_links_cost_an_address_nothing() -> None:
    limits = AddressShares()
    for _ in range(100):
        limits.arrived(ADA, 0.0)
        limits.linked(ADA)
    assert limits.shares(0.0) == {}


def test_share_falls_with_failures_and_others_keep_theirs() -> None:
    limits = AddressShares()
    for _ in range(BURST + 3):
        limits.arrived(EVE, 0.0)
    limits.arrived(ADA, 0.0)
    assert limits.shares(0.0) == {EVE: 0.125}


def test_no_address_is_shut_out() -> None:
    limits = AddressShares()
    for _ in range(10_000):
        limits.arrived(EVE, 0.0)
    assert limits.shares(0.0) == {EVE: LEAST_SHARE}
    for second in range(1, 13):
        limits.shares(float(second))
    assert limits.shares(13.0) == {}


def test_links_restore_a_share_at_once() -> None:
    """Forty robots behind one address dial at the same time after a restart of the router."""
    limits = AddressShares()
    for _ in range(40):
        limits.arrived(ADA, 0.0)
    assert limits.shares(0.0)[ADA] < 0.01
    for _ in range(40):
        limits.linked(ADA)
    assert limits.shares(0.0) == {}


def test_known_addresses_are_bounded() -> None:
    limits = AddressShares()
    for number in range(5000):
        for _ in range(BURST + 1):
            limits.arrived(ip_address(0x0A000000 + number), 0.0)
    assert len(limits.shares(0.0)) == door.MAX_LIMITED
    assert len(choice_steps(limits.shares(0.0))) < 4096, "the kernel's limit"


def test_an_address_is_read_as_zenoh_writes_it() -> None:
    assert end_in("10.0.0.7:50000") == ConnectionEnd("10.0.0.7", 50000)
    assert end_in("[::1]:50000") == ConnectionEnd("::1", 50000)
    assert end_in("") == ConnectionEnd("", 0)


ZID = "8c120e5a285b3f0ac3672d47388fa857"
LOG_HEAD = "2026-11-21T22:13:59.056613Z TRACE  rx-0 ThreadId(09) demux{zid=7dc0 src=x}: "
ACCESS = f"{LOG_HEAD}zenoh::net::routing::interceptor::access_control: "
SUBJECT = f"{ZID} on Interface(lo)+CertCommonName(viewer)+Transport(Tls)+{ZID}"
HANDSHAKE = "2026-11-21T22:13:20.385349Z  WARN acc-0 ThreadId(06) zenoh_link_tls::unicast: "
HINT = ". Hint: increase the system open file limit.\n"


def cached(what: str, key: str) -> str:
    return f"{ACCESS}Using cached result: {ZID} is unauthorized to {what} on {key}\n"


def judged(what: str, key: str, allowed: str = "unauthorized") -> str:
    return f"{ACCESS}{SUBJECT} is {allowed} to {what} on {key}\n"


def failed(why: str) -> str:
    return f"{HANDSHAKE}{why}{HINT}"


def viewer(zid: str) -> Caller:
    return Caller("viewer", "tls/10.0.0.7:50000") if zid == ZID else UNKNOWN


def stranger(_zid: str) -> Caller:
    return Caller("stranger", "there")


def lines(log: str, caller: Callable[[str], Caller] = viewer) -> list[str]:
    """Return what is reported of a log with one event per line."""
    return [line for _, line in refusals_in(events(log), caller)]


def told(
    refusals: RefusalLog, log: str, at_ns: int, caller: Callable[[str], Caller] = viewer
) -> list[str]:
    """Return what is reported of a log at a time."""
    return refusals.report(refusals_in(events(log), caller), at_ns)


def events(log: str) -> list[bytes]:
    return [line.encode() for line in log.splitlines(keepends=True)]


def test_forged_sample_is_logged_with_sender_key_and_reason() -> None:
    assert lines(cached("Put (ingress)", "sidestep/r1/op/teleop")) == [
        "refused: viewer at tls/10.0.0.7:50000 may not put on sidestep/r1/op/teleop: "
        "viewer only observes"
    ]


@each(
    ("what", "says"),
    [
        ("Query", "may not query on k"),
        ("Delete", "may not delete on k"),
        ("Reply", "may not reply on k"),
        ("Declare Queryable", "may not declare queryable on k"),
        ("Declare Subscriber", "may not declare subscriber on k"),
        ("Liveliness Token", "may not liveliness token on k"),
        ("Liveliness Query", "may not liveliness query on k"),
    ],
)
def test_each_kind_of_attempt_has_its_line(what: str, says: str) -> None:
    (line,) = lines(judged(f"{what} (ingress)", "k"))
    assert says in line


def test_end_of_what_was_refused_is_no_attempt() -> None:
    assert lines(judged("Undeclare Subscriber (ingress)", "k")) == []


def test_wildcard_is_logged_as_it_was_put() -> None:
    (line,) = lines(judged("Put (ingress)", "sidestep/**"))
    assert "may not put on sidestep/**" in line


@each("key", ["k", f"k is unauthorized to Put (ingress) on k on {ZID}"])
def test_allowed_access_is_not_logged(key: str) -> None:
    assert lines(judged("Put (ingress)", key, "authorized")) == []


@each("key", ["k", "k (ingress) on k"])
def test_filtered_outgoing_sample_is_not_logged(key: str) -> None:
    """Samples are withheld from clients without the right all the time."""
    assert lines(cached("Put (egress)", key)) == []


def test_key_resolution_is_not_logged_as_refusal() -> None:
    learnt = [
        judged("Query (ingress)", "k"),
        judged("Put (ingress)", "k"),
        judged("Declare/Undeclare Queryable (ingress)", "k"),
    ]
    assert lines("".join(learnt)) == []
    (line,) = lines("".join([*learnt, cached("Put (ingress)", "k")]))
    assert "may not put on k" in line


def test_certificate_name_without_a_role_is_logged() -> None:
    assert lines(cached("Put (ingress)", "k"), stranger) == [
        "refused: stranger at there may not put on k: no role has the name of its certificate"
    ]


@each(
    ("why", "says"),
    [
        ("received corrupt message of type InvalidContentType", "it uses plain TCP"),
        ("peer sent no certificates", "it shows no certificate"),
        ("invalid peer certificate: UnknownIssuer", "signed by another authority"),
        ("invalid peer certificate: BadSignature", "signed by another authority"),
        ("received fatal alert: UnknownCA", "it rejects the certificate of this process"),
        (
            "invalid peer certificate: certificate expired: verification time 1795299203 (UNIX), "
            "but certificate is not valid after 1795212798 (86405 seconds ago)",
            "certificate is not valid after 1795212798 (86405 seconds ago)",
        ),
        ("something nobody has thought of", "something nobody has thought of"),
        ("an escape \x1b[2J", "an escape ?[2J"),
    ],
)
def test_each_failed_handshake_has_its_line(why: str, says: str) -> None:
    (line,) = lines(failed(why))
    assert line.startswith("connection refused: ")
    assert says in line


def test_broken_connection_is_not_logged() -> None:
    probed = failed("tls handshake eof") + failed("Connection reset by peer (os error 104)")
    assert lines(probed) == []


def test_session_without_a_link_is_named_unknown() -> None:
    (line,) = lines(cached("Put (ingress)", "k").replace(ZID, "ab"))
    assert line.startswith("refused: unknown process at an unknown address may not put on k")


def test_repeated_refusal_is_logged_later_with_its_count() -> None:
    refusals = RefusalLog()
    log = cached("Put (ingress)", "k")
    assert len(told(refusals, log * 3, 0)) == 1
    assert told(refusals, log * 5, QUIET_NS - 1) == []
    count, again = told(refusals, log, QUIET_NS)
    assert count == "refused: viewer: 7 more times in 60 s"
    assert "may not put on k" in again


def test_flood_of_different_keys_gives_few_lines_and_a_count() -> None:
    refusals = RefusalLog()
    reported = []
    for look in range(100):
        log = "".join(cached("Put (ingress)", f"{look}/{number}") for number in range(50))
        reported += told(refusals, log, look)
    assert len(reported) == MAX_LINES
    assert told(refusals, "", QUIET_NS) == [
        f"refused: viewer: {5000 - MAX_LINES} more times in 60 s"
    ]
    assert told(refusals, "", 2 * QUIET_NS) == []


def test_flood_of_one_certificate_hides_no_other() -> None:
    def caller(zid: str) -> Caller:
        return Caller("viewer" if zid == ZID else "plant", "there")

    refusals = RefusalLog()
    flood = "".join(cached("Put (ingress)", f"{number}") for number in range(50))
    told(refusals, flood, 0, caller)
    (line,) = told(refusals, cached("Put (ingress)", "k").replace(ZID, "ab"), 1, caller)
    assert line.startswith("refused: plant at there may not put on k")


def test_long_key_is_cut() -> None:
    (line,) = lines(cached("Put (ingress)", "k" * 60_000))
    assert "k" * MAX_CHARACTERS + "...: viewer only observes" in line
    assert len(line) < 2 * MAX_CHARACTERS


@each("between", ["\n", " ", "\r\n", "\t", "\u2028", "\n\n"])
def test_line_break_in_a_key_accuses_no_other_session(between: str) -> None:
    forged = cached("Put (ingress)", "sidestep/r1/srv/command").replace(ZID, "ab").rstrip("\n")

    def caller(zid: str) -> Caller:
        return Caller("plant" if zid == "ab" else "viewer", "there")

    event = cached("Put (ingress)", f"k{between}{forged}").encode()
    ((_, line),) = refusals_in([event], caller)
    assert line.startswith("refused: viewer at there may not put on k?")
    assert "plant" not in line
    assert "\n" not in line


def test_forgery_after_other_words_is_not_read() -> None:
    (line,) = lines(failed(f"other words {cached('Put (ingress)', 'k').rstrip()}"))
    assert line.startswith("connection refused: other words")
    (line,) = lines(cached("Put (ingress)", failed("expired").rstrip()))
    assert line.startswith("refused: viewer at tls/10.0.0.7:50000 may not put on ")


@each("character", ["\u202e", "\x1b", "\x07", "\x9b", " "])
def test_unprintable_characters_of_a_key_are_replaced(character: str) -> None:
    (line,) = lines(cached("Put (ingress)", f"a{character}b"))
    assert "may not put on a?b: " in line


def test_text_that_is_not_a_log_gives_no_line() -> None:
    assert lines("") == lines("\x00\xff\n\n is unauthorized to ") == []
    assert in_words("") == ""
