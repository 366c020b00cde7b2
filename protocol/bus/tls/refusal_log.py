"""Sentences about refused sessions, made from the events of Zenoh's log.

The refused session chooses part of an event: the key, which may be long and may contain line
breaks. An event is therefore parsed from its beginning only, and the key is cut and cleaned.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Final, NamedTuple

from protocol.bus.tls.role_grants import grant_of

QUIET_NS: Final = 60_000_000_000
"""Period after which a sentence is repeated, with a count. Budgets apply to this period."""

MAX_SENTENCES: Final = 10
"""Sentences about one certificate in QUIET_NS; further ones are only counted."""

MAX_NAMES: Final = 200
MAX_CHARACTERS: Final = 200
"""Length of a key or a cause in a sentence."""

MAX_EVENTS: Final = 300
SIGNS: Final = (b"is unauthorized to", b". Hint: ")
"""Text in events about refusals. Most events are about permitted actions."""

BEGIN: Final = (
    r"\A\d{4}-\d\d-\d\dT[\d:.]+Z +(?P<level>[A-Z]+) +\S+ ThreadId\(\d+\) "
    r"(?:[\w=.:/ {}\[\]-]{0,200}?: )??"
)
DENIED: Final = re.compile(
    BEGIN + r"zenoh::net::routing::interceptor::access_control: "
    r"(?P<known>Using cached result: )?(?P<zid>[0-9a-f]{1,32})(?: on \S*)? is unauthorized to "
    r"(?P<what>[A-Z][A-Za-z/ ]{1,60}) \(ingress\) on (?P<key>.+)",
    re.DOTALL,
)
FAILED: Final = re.compile(BEGIN + r"zenoh_link_tls::unicast: (?P<why>.+?)\. Hint: ", re.DOTALL)
PRECOMPUTED: Final = "Declare/Undeclare"
"""Zenoh computes all permissions of a key at once and logs the missing ones as refusals."""

ACTIONS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "Put": "put on",
        "Delete": "delete",
        "Query": "query",
        "Reply": "answer on",
        "Declare Subscriber": "subscribe to",
        "Declare Queryable": "serve",
        "Liveliness Token": "announce itself as",
        "Liveliness Query": "query presence at",
        "Declare Liveliness Subscriber": "query presence at",
    }
)
WHEN: Final = re.compile(r"not valid (?P<which>after|before) (?P<s>\d{1,11})\b")
REASONS: Final = (
    ("InvalidContentType", "it uses plain TCP, and this endpoint accepts only TLS"),
    ("peer sent no certificates", "it shows no certificate"),
    ("UnknownIssuer", "its certificate is signed by another authority"),
    ("BadSignature", "its certificate is signed by another authority"),
    ("InvalidPurpose", "its certificate is not one for clients"),
    ("received fatal alert", "it rejects the certificate of this process"),
)
PROBE_CAUSES: Final = ("handshake eof", "reset by peer", "Broken pipe", "end of file")
"""Causes of a connection that only probed whether a process listens."""


class Caller(NamedTuple):
    """A session that dialled: common name of its certificate, and address."""

    name: str
    address: str


UNKNOWN: Final = Caller("unknown process", "an unknown address")


class Sentence(NamedTuple):
    """A sentence about the refused session with a certificate `name`."""

    name: str
    text: str


class Budget:
    """The sentences about one certificate within QUIET_NS, with their numbers of repetitions."""

    __slots__ = ("before", "begun_ns", "more", "reported")

    def __init__(self, begun_ns: int, before: dict[str, int]) -> None:
        self.begun_ns = begun_ns
        self.before = before
        self.reported: dict[str, int] = {}
        self.more = 0

    def is_over(self, now_ns: int) -> bool:
        """Return whether the period has ended."""
        return now_ns - self.begun_ns >= QUIET_NS


class RefusalLog:
    """Report each refusal once, and at most MAX_SENTENCES about one certificate in QUIET_NS."""

    def __init__(self) -> None:
        self._budgets: dict[str, Budget] = {}

    def sentences(
        self,
        events: Sequence[bytes],
        caller: Callable[[str], Caller],
        failed_hosts: Callable[[], Iterable[str]],
        now_ns: int,
    ) -> list[str]:
        """Return the sentences about some events of the log.

        `caller` returns the owner of a session id; `failed_hosts` the hosts of failed connections.
        """
        read = [event.decode(errors="replace") for event in events[:MAX_EVENTS]]
        found = (*denials(read, caller), *failed_handshakes(read, failed_hosts))
        return [*self.limited(found, now_ns), *self._ended(now_ns)]

    def limited(self, sentences: Iterable[Sentence], now_ns: int) -> list[str]:
        """Return the sentences that are to be reported now."""
        return [line for sentence in sentences for line in self._limited(sentence, now_ns)]

    def _limited(self, sentence: Sentence, now_ns: int) -> Iterator[str]:
        """Yield the sentence unless it was reported before or there were too many."""
        name, text = sentence
        budget = self._budgets.get(name)
        if budget is None or budget.is_over(now_ns):
            yield from summary(name, budget)
            budget = self._begun(name, now_ns, {} if budget is None else budget.reported)
        if text in budget.reported:
            budget.reported[text] += 1
        elif len(budget.reported) >= MAX_SENTENCES:
            budget.more += 1
        else:
            budget.reported[text] = 0
            before = budget.before.get(text, 0)
            yield f"{text} ({before} more times since the last report)" if before else text

    def _begun(self, name: str, now_ns: int, before: dict[str, int]) -> Budget:
        self._budgets.pop(name, None)
        while len(self._budgets) >= MAX_NAMES:
            del self._budgets[next(iter(self._budgets))]
        budget = self._budgets[name] = Budget(now_ns, before)
        return budget

    def _ended(self, now_ns: int) -> Iterator[str]:
        """Yield the summaries of floods that have ended."""
        for name, budget in self._budgets.items():
            if budget.is_over(now_ns):
                yield from summary(name, budget)
                budget.more = 0


def summary(name: str, budget: Budget | None) -> Iterator[str]:
    """Yield the number of sentences that were not reported one by one."""
    if budget is not None and budget.more:
        yield f"refused: {name}: {budget.more} other attempts in {QUIET_NS // 10**9} s"


def denials(events: Sequence[str], caller: Callable[[str], Caller]) -> Iterator[Sentence]:
    """Yield what sessions with a certificate tried without permission."""
    found = [one for event in events if (one := DENIED.match(event))]
    computed = {(one["zid"], one["key"]) for one in found if one["what"].startswith(PRECOMPUTED)}
    for one in found:
        is_attempt = one["known"] or (one["zid"], one["key"]) not in computed
        if one["what"] not in ACTIONS or not is_attempt:
            continue
        name, address = caller(one["zid"])
        grant = grant_of(name)
        why = f"{name} {grant.description}" if grant else "no role has the name of its certificate"
        key, action = cleaned(one["key"].removesuffix("\n")), ACTIONS[one["what"]]
        yield Sentence(name, f"refused: {name} at {address} may not {action} {key}: {why}")


def failed_handshakes(
    events: Sequence[str], failed_hosts: Callable[[], Iterable[str]]
) -> Iterator[Sentence]:
    """Yield the failed handshakes. Zenoh does not log their addresses."""
    found = [one["why"] for event in events if (one := FAILED.match(event))]
    causes = [why for why in found if not any(words in why for words in PROBE_CAUSES)]
    address = (", ".join(failed_hosts()) if causes else "") or UNKNOWN.address
    for cause in causes:
        text = f"connection refused: {UNKNOWN.name} at {address}: {in_words(cause)}"
        yield Sentence(UNKNOWN.name, text)


def cleaned(key: str) -> str:
    """Cut a key and replace its blanks and unprintable characters by question marks.

    After a blank, a key could imitate a part of the sentence.
    """
    shown = key[:MAX_CHARACTERS]
    text = "".join(c if c.isprintable() and c != " " else "?" for c in shown)
    return text if len(key) <= MAX_CHARACTERS else f"{text}..."


def in_words(why: str) -> str:
    """Return the cause of a failed handshake as text."""
    when = WHEN.search(why)
    if when:
        moment = f"{datetime.fromtimestamp(int(when['s']), UTC):%Y-%m-%d %H:%M} UTC"
        expired = when["which"] == "after"
        return (
            f"its certificate expired at {moment}"
            if expired
            else f"its certificate is not valid before {moment}; compare the clocks"
        )
    shown = "".join(c if c.isprintable() else "?" for c in why[:MAX_CHARACTERS])
    return next((words for sign, words in REASONS if sign in why), shown)
