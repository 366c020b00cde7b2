"""Sentences about what Zenoh refused, made from the events of its log.

Part of an event is chosen by the refused session: the key, which may be long and may contain line
breaks. An event is therefore read from its beginning only, and what it names is cut and cleaned.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Final, NamedTuple

from protocol.bus.tls.access import grant_of

QUIET_NS: Final = 60_000_000_000
"""A sentence is repeated only after this long, with a count. Budgets are for this long, too."""

MAX_TOLD: Final = 10
"""Sentences about one certificate in QUIET_NS; more are only counted."""

MAX_NAMES: Final = 200
MAX_CHARACTERS: Final = 200
"""Of a key or a cause in a sentence."""

MAX_EVENTS: Final = 300
SIGNS: Final = (b"is unauthorized to", b". Hint: ")
"""Of an event that counts. Most of the log says what was allowed."""

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
UNWELCOME: Final = re.compile(BEGIN + r"zenoh_link_tls::unicast: (?P<why>.+?)\. Hint: ", re.DOTALL)
LEARNT: Final = "Declare/Undeclare"
"""Zenoh works out all that may be done with a key at once, and logs that as refusals."""

WOULD: Final[Mapping[str, str]] = MappingProxyType(
    {
        "Put": "put on",
        "Delete": "delete",
        "Query": "ask",
        "Reply": "answer on",
        "Declare Subscriber": "listen to",
        "Declare Queryable": "serve",
        "Liveliness Token": "show itself as",
        "Liveliness Query": "look who is at",
        "Declare Liveliness Subscriber": "look who is at",
    }
)
WHEN: Final = re.compile(r"not valid (?P<which>after|before) (?P<s>\d{1,11})\b")
REASONS: Final = (
    ("InvalidContentType", "it speaks plain TCP, and this door takes only TLS"),
    ("peer sent no certificates", "it shows no certificate"),
    ("UnknownIssuer", "its certificate is signed by another authority"),
    ("BadSignature", "its certificate is signed by another authority"),
    ("InvalidPurpose", "its certificate is not one to dial with"),
    ("received fatal alert", "it does not believe the certificate that it was shown"),
)
NOBODY: Final = ("handshake eof", "reset by peer", "Broken pipe", "end of file")
"""Causes of a connection that only looked whether a process listens."""


class Caller(NamedTuple):
    """A session that dialled: the common name of its certificate, and its address."""

    name: str
    address: str


UNKNOWN: Final = Caller("somebody", "an unknown address")


class Told(NamedTuple):
    """A sentence, and the certificate that it is about."""

    name: str
    sentence: str


class Budget:
    """The sentences about one certificate since a moment, each with how often it was repeated."""

    __slots__ = ("before", "begun_ns", "more", "said")

    def __init__(self, begun_ns: int, before: dict[str, int]) -> None:
        self.begun_ns = begun_ns
        self.before = before
        self.said: dict[str, int] = {}
        self.more = 0

    def is_over(self, now_ns: int) -> bool:
        return now_ns - self.begun_ns >= QUIET_NS


class Refusals:
    """Say each refusal once, and at most MAX_TOLD about one certificate in QUIET_NS."""

    def __init__(self) -> None:
        self._budgets: dict[str, Budget] = {}

    def heard(
        self,
        events: Sequence[bytes],
        caller: Callable[[str], Caller],
        strangers: Callable[[], Iterable[str]],
        now_ns: int,
    ) -> list[str]:
        """Return the sentences to tell of some events of the log.

        `caller` returns the owner of a session id; `strangers` the hosts of failed connections.
        """
        read = [event.decode(errors="replace") for event in events[:MAX_EVENTS]]
        known = (*denials(read, caller), *unwelcome(read, strangers))
        lines = [line for told in known for line in self._said(told, now_ns)]
        return [*lines, *self._ended(now_ns)]

    def _said(self, told: Told, now_ns: int) -> Iterator[str]:
        """The sentence, unless it was said before or there were too many."""
        budget = self._budgets.get(told.name)
        if budget is None or budget.is_over(now_ns):
            yield from summary(told.name, budget)
            budget = self._begun(told.name, now_ns, {} if budget is None else budget.said)
        if told.sentence in budget.said:
            budget.said[told.sentence] += 1
        elif len(budget.said) >= MAX_TOLD:
            budget.more += 1
        else:
            budget.said[told.sentence] = 0
            before = budget.before.get(told.sentence, 0)
            since = f" ({before} more times since it was told)" if before else ""
            yield f"{told.sentence}{since}"

    def _begun(self, name: str, now_ns: int, before: dict[str, int]) -> Budget:
        self._budgets.pop(name, None)
        while len(self._budgets) >= MAX_NAMES:
            del self._budgets[next(iter(self._budgets))]
        budget = self._budgets[name] = Budget(now_ns, before)
        return budget

    def _ended(self, now_ns: int) -> Iterator[str]:
        """What remains to be told of floods that have ended."""
        for name, budget in self._budgets.items():
            if budget.is_over(now_ns):
                yield from summary(name, budget)
                budget.more = 0


def summary(name: str, budget: Budget | None) -> Iterator[str]:
    """How many were not told one by one."""
    if budget is not None and budget.more:
        yield f"refused: {name}: {budget.more} other attempts in {QUIET_NS // 10**9} s"


def denials(events: Sequence[str], caller: Callable[[str], Caller]) -> Iterator[Told]:
    """What a session with a certificate tried that its role may not do."""
    found = [one for event in events if (one := DENIED.match(event))]
    learnt = {(one["zid"], one["key"]) for one in found if one["what"].startswith(LEARNT)}
    for one in found:
        if one["what"] not in WOULD or (not one["known"] and (one["zid"], one["key"]) in learnt):
            continue
        name, address = caller(one["zid"])
        grant = grant_of(name)
        may = f"{name} {grant.says}" if grant else "no role has the name of its certificate"
        key = cleaned(one["key"].removesuffix("\n"))
        yield Told(name, f"refused: {name} at {address} may not {WOULD[one['what']]} {key}: {may}")


def unwelcome(events: Sequence[str], strangers: Callable[[], Iterable[str]]) -> Iterator[Told]:
    """Handshakes that failed. Zenoh does not log the address of these."""
    found = [one["why"] for event in events if (one := UNWELCOME.match(event))]
    whys = [why for why in found if not any(words in why for words in NOBODY)]
    address = (", ".join(strangers()) if whys else "") or UNKNOWN.address
    for why in whys:
        words = in_words(why)
        yield Told(UNKNOWN.name, f"not let in: {UNKNOWN.name} at {address}: {words}")


def cleaned(key: str) -> str:
    """Cut a key and replace its blanks and unprintable characters by question marks.

    A blank in a key could begin what reads like a part of the sentence.
    """
    shown = key[:MAX_CHARACTERS]
    text = "".join(c if c.isprintable() and c != " " else "?" for c in shown)
    return text if len(key) <= MAX_CHARACTERS else f"{text}..."


def in_words(why: str) -> str:
    """Return the cause of a failed handshake for a person."""
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
