"""Zenoh's log of refusals becomes sentences: certificate, address, action and reason."""

from collections.abc import Iterable

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
from tests.support.each import each

ZID = "8c120e5a285b3f0ac3672d47388fa857"
HEAD = "2026-11-21T22:13:59.056613Z TRACE  rx-0 ThreadId(09) demux{zid=7dc0 src=x}: "
ACCESS = f"{HEAD}zenoh::net::routing::interceptor::access_control: "
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
