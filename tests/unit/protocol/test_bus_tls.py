"""TLS at the door: what it admits, the addresses and the log of refusals."""

import socket
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from ipaddress import ip_address
from pathlib import Path
from types import SimpleNamespace

import pytest

from protocol.bus import door
from protocol.bus.audit import (
    MAX_CHARACTERS,
    MAX_EVENTS,
    MAX_SENTENCES,
    QUIET_NS,
    UNKNOWN,
    Caller,
    RefusalLog,
    in_words,
)
from protocol.bus.door import BURST, LEAST_SHARE, UNAVAILABLE, UNPRIVILEGED, Door, Limits
from protocol.bus.sockets import (
    SO_ATTACH_FILTER,
    SO_ATTACH_REUSEPORT_CBPF,
    ClosingConnections,
    ConnectionEnd,
    Step,
    attach,
    choice_steps,
    end_in,
    end_of,
)
from tests.support.each import each
from tests.support.until import PATIENCE_S, until

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

    def attach_or_refuse(listener: socket.socket, steps: list[Step], option: int) -> None:
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
    limits = Limits()
    for _ in range(100):
        limits.arrived(ADA, 0.0)
        limits.linked(ADA)
    assert limits.shares(0.0) == {}


def test_share_falls_with_failures_and_others_keep_theirs() -> None:
    limits = Limits()
    for _ in range(BURST + 3):
        limits.arrived(EVE, 0.0)
    limits.arrived(ADA, 0.0)
    assert limits.shares(0.0) == {EVE: 0.125}


def test_no_address_is_shut_out() -> None:
    limits = Limits()
    for _ in range(10_000):
        limits.arrived(EVE, 0.0)
    assert limits.shares(0.0) == {EVE: LEAST_SHARE}
    for second in range(1, 13):
        limits.shares(float(second))
    assert limits.shares(13.0) == {}


def test_links_restore_a_share_at_once() -> None:
    """Forty robots behind one address dial at the same time after a restart of the router."""
    limits = Limits()
    for _ in range(40):
        limits.arrived(ADA, 0.0)
    assert limits.shares(0.0)[ADA] < 0.01
    for _ in range(40):
        limits.linked(ADA)
    assert limits.shares(0.0) == {}


def test_known_addresses_are_bounded() -> None:
    limits = Limits()
    for number in range(5000):
        for _ in range(BURST + 1):
            limits.arrived(ip_address(0x0A000000 + number), 0.0)
    assert len(limits.shares(0.0)) == door.MAX_LIMITED
    assert len(choice_steps(limits.shares(0.0))) < 4096, "the kernel's limit"


HEAD = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid\n"
OURS = 0x4427  # 17447
CLOSING = "06"


def row(local: str, remote: str, state: str = CLOSING) -> str:
    return (
        f"   0: {local} {remote} {state} 00000000:00000000 00:00000000 00000000 0 0 1603 1 0 20\n"
    )


@pytest.fixture
def table(tmp_path: Path) -> Path:
    return tmp_path / "tcp"


def test_an_address_is_read_as_linux_writes_it() -> None:
    assert end_of("0100007F:4427") == ConnectionEnd("127.0.0.1", 17447)
    assert end_of("00000000000000000000000001000000:0050") == ConnectionEnd("::1", 80)
    assert end_of("0000000000000000FFFF00000700000A:0050") == ConnectionEnd("10.0.0.7", 80)


def test_an_address_is_read_as_zenoh_writes_it() -> None:
    assert end_in("10.0.0.7:50000") == ConnectionEnd("10.0.0.7", 50000)
    assert end_in("[::1]:50000") == ConnectionEnd("::1", 50000)
    assert end_in("") == ConnectionEnd("", 0)


def test_closing_connection_counts_as_rejected_peer(table: Path) -> None:
    table.write_text(HEAD + row("0100007F:4427", "0700000A:C350"))
    assert ClosingConnections([OURS], [table]).new([]) == ["10.0.0.7"]


def test_local_peer_may_be_found_by_its_other_end(table: Path) -> None:
    table.write_text(HEAD + row("0200007F:C350", "0100007F:4427"))
    assert ClosingConnections([OURS], [table]).new([]) == ["127.0.0.2"]


def test_peer_is_reported_once(table: Path) -> None:
    strangers = ClosingConnections([OURS], [table])
    table.write_text(HEAD + row("0100007F:4427", "0700000A:C350"))
    assert strangers.new([]) == ["10.0.0.7"]
    assert strangers.new([]) == []
    table.write_text(HEAD + row("0100007F:4427", "0700000A:C351"))
    assert strangers.new([]) == ["10.0.0.7"]


def test_peer_admitted_before_is_not_reported(table: Path) -> None:
    table.write_text(HEAD + row("0100007F:4427", "0700000A:C350"))
    assert ClosingConnections([OURS], [table]).new([ConnectionEnd("10.0.0.7", 0xC350)]) == []


@pytest.mark.parametrize("state", ["01", "03", "0A"])
def test_open_or_opening_connection_is_not_reported(table: Path, state: str) -> None:
    table.write_text(HEAD + row("0100007F:4427", "0700000A:C350", state))
    assert ClosingConnections([OURS], [table]).new([]) == []


def test_connections_to_other_ports_are_ignored(table: Path) -> None:
    table.write_text(HEAD + row("0100007F:0016", "0700000A:C350"))
    assert ClosingConnections([OURS], [table]).new([]) == []


def test_missing_connection_table_gives_no_peer(tmp_path: Path) -> None:
    assert ClosingConnections([OURS], [tmp_path / "nowhere"]).new([]) == []


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


def sentences(log: str, strangers: Iterable[str] = (), at_ns: int = 0) -> list[str]:
    """Return the sentences of a log with one event per line."""
    return RefusalLog().sentences(events(log), viewer, lambda: strangers, at_ns)


def events(log: str) -> list[bytes]:
    return [line.encode() for line in log.splitlines(keepends=True)]


def test_forged_sample_is_logged_with_sender_key_and_reason() -> None:
    assert sentences(cached("Put (ingress)", "sidestep/r1/op/teleop")) == [
        "refused: viewer at tls/10.0.0.7:50000 may not put on sidestep/r1/op/teleop: "
        "viewer only observes"
    ]


@each(
    ("what", "says"),
    [
        ("Query", "may not query k"),
        ("Delete", "may not delete k"),
        ("Reply", "may not answer on k"),
        ("Declare Queryable", "may not serve k"),
        ("Declare Subscriber", "may not subscribe to k"),
        ("Liveliness Token", "may not announce itself as k"),
        ("Liveliness Query", "may not query presence at k"),
    ],
)
def test_each_kind_of_attempt_has_its_sentence(what: str, says: str) -> None:
    (told,) = sentences(judged(f"{what} (ingress)", "k"))
    assert says in told


def test_wildcard_is_logged_as_it_was_put() -> None:
    (told,) = sentences(judged("Put (ingress)", "sidestep/**"))
    assert "may not put on sidestep/**" in told


def test_allowed_access_is_not_logged() -> None:
    assert sentences(judged("Put (ingress)", "k", "authorized")) == []


def test_filtered_outgoing_sample_is_not_logged() -> None:
    """Samples are withheld from clients without the right all the time."""
    assert sentences(cached("Put (egress)", "k")) == []


def test_key_resolution_is_not_logged_as_refusal() -> None:
    learnt = [
        judged("Query (ingress)", "k"),
        judged("Put (ingress)", "k"),
        judged("Declare/Undeclare Queryable (ingress)", "k"),
    ]
    assert sentences("".join(learnt)) == []
    (told,) = sentences("".join([*learnt, cached("Put (ingress)", "k")]))
    assert "may not put on k" in told


def test_certificate_name_without_a_role_is_logged() -> None:
    def stranger(_zid: str) -> Caller:
        return Caller("stranger", "there")

    (told,) = RefusalLog().sentences(events(cached("Put (ingress)", "k")), stranger, list, 0)
    assert told == (
        "refused: stranger at there may not put on k: no role has the name of its certificate"
    )


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
            "its certificate expired at 2026-11-20 22:13 UTC",
        ),
        (
            "invalid peer certificate: certificate not valid yet: verification time 1795299204 "
            "(UNIX), but certificate is not valid before 1795385598 (86394 seconds in future)",
            "its certificate is not valid before 2026-11-22 22:13 UTC; compare the clocks",
        ),
        ("something nobody has thought of", "something nobody has thought of"),
    ],
)
def test_each_failed_handshake_has_its_sentence(why: str, says: str) -> None:
    (told,) = sentences(failed(why), ["10.0.0.9"])
    assert told.startswith("connection refused: unknown process at 10.0.0.9: ")
    assert says in told


def test_broken_connection_is_not_logged() -> None:
    assert (
        sentences(failed("tls handshake eof") + failed("Connection reset by peer (os error 104)"))
        == []
    )


def test_unknown_peer_address_is_named_unknown() -> None:
    (told,) = sentences(failed("peer sent no certificates"))
    assert "unknown process at an unknown address" in told


def test_repeated_refusal_is_logged_later_with_its_count() -> None:
    refusals = RefusalLog()
    line = events(cached("Put (ingress)", "k"))
    assert len(refusals.sentences(line * 3, viewer, list, 0)) == 1
    assert refusals.sentences(line * 5, viewer, list, QUIET_NS - 1) == []
    (told,) = refusals.sentences(line, viewer, list, QUIET_NS)
    assert told.endswith("(7 more times since the last report)")


def test_flood_of_different_keys_gives_few_lines_and_a_count() -> None:
    refusals = RefusalLog()
    told = []
    for look in range(100):
        log = "".join(cached("Put (ingress)", f"{look}/{number}") for number in range(50))
        told += refusals.sentences(events(log), viewer, list, look)
    assert len(told) == MAX_SENTENCES
    (summary,) = refusals.sentences([], viewer, list, QUIET_NS)
    assert summary == f"refused: viewer: {5000 - MAX_SENTENCES} other attempts in 60 s"
    assert refusals.sentences([], viewer, list, 2 * QUIET_NS) == []


def test_flood_of_one_certificate_hides_no_other() -> None:
    def caller(zid: str) -> Caller:
        return Caller("viewer" if zid == ZID else "plant", "there")

    refusals = RefusalLog()
    flood = "".join(cached("Put (ingress)", f"{number}") for number in range(50))
    refusals.sentences(events(flood), caller, list, 0)
    line = cached("Put (ingress)", "k").replace(ZID, "ab")
    (told,) = refusals.sentences(events(line), caller, list, 1)
    assert told.startswith("refused: plant at there may not put on k")


def test_only_the_start_of_a_flood_is_parsed() -> None:
    flood = judged("Put (ingress)", "early") + cached("Put (egress)", "k") * MAX_EVENTS
    (told,) = sentences(flood + cached("Put (ingress)", "late"))
    assert "may not put on early" in told


def test_long_key_is_cut() -> None:
    (told,) = sentences(cached("Put (ingress)", "k" * 60_000))
    assert "k" * MAX_CHARACTERS + "...: viewer only observes" in told
    assert len(told) < 2 * MAX_CHARACTERS


@each("between", ["\n", " ", "\r\n", "\t", "\u2028", "\n\n"])
def test_line_break_in_a_key_accuses_no_other_session(between: str) -> None:
    forged = cached("Put (ingress)", "sidestep/r1/srv/command").replace(ZID, "ab").rstrip("\n")

    def caller(zid: str) -> Caller:
        return Caller("plant" if zid == "ab" else "viewer", "there")

    event = cached("Put (ingress)", f"k{between}{forged}").encode()
    (told,) = RefusalLog().sentences([event], caller, list, 0)
    assert told.startswith("refused: viewer at there may not put on k?")
    assert "plant" not in told
    assert "\n" not in told


def test_forgery_after_unrelated_words_is_not_read() -> None:
    assert sentences(f"something else {cached('Put (ingress)', 'k')}") == []


@each("character", ["\u202e", "\x1b", "\x07", "\x9b", " "])
def test_unprintable_characters_of_a_key_are_replaced(character: str) -> None:
    (told,) = sentences(cached("Put (ingress)", f"a{character}b"))
    assert "may not put on a?b: " in told


def test_text_that_is_not_a_log_gives_no_sentence() -> None:
    assert sentences("") == sentences("\x00\xff\n\n is unauthorized to ") == []
    assert in_words("") == ""
